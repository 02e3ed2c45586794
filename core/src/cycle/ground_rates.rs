//! Contribution of an uncertain sample time to σ of the ground sample: σ(t) times the recent rate of change.

use super::memory::Memory;
use crate::math;
use crate::message::{State, Validity};
use crate::motion::Snapshot;

/// Maximum interval between snapshots for a rate of change, s: two samples of the slowest suit, 30 Hz.
const RATE_STEP_MAX_S: f64 = 0.07;

/// Vertical force, N, and centre of pressure, m, of a subject on the plate.
pub(super) struct PlateReading {
    pub(super) vertical_n: f64,
    pub(super) cop_m: [f64; 2],
}

impl PlateReading {
    /// Change of the force, N, and distance between the centres of pressure, m.
    fn since(&self, before: &PlateReading) -> [f64; 2] {
        let apart_m = math::hypot([0, 1].map(|axis| self.cop_m[axis] - before.cop_m[axis]));
        [(self.vertical_n - before.vertical_n).abs(), apart_m]
    }
}

impl Memory {
    /// Plate measurement at the previous snapshot, `step_s` earlier, if both are close enough in time to give a rate.
    pub(super) fn previous_reading(&self, step_s: f64) -> Option<PlateReading> {
        let invalid = Validity::INVALIDATES_COP_MEASURED.and(Validity::IMPLAUSIBLE);
        let is_usable = step_s > 0.0 && step_s < RATE_STEP_MAX_S && !self.invalid_reasons().any_of(invalid);
        let State { ground_force_n: [_, _, vertical_n], cop_measured_m: cop_m, .. } = self.estimate;
        is_usable.then_some(PlateReading { vertical_n, cop_m })
    }

    /// Adds to σ of the ground sample the contribution of its uncertain time: σ(t) times the recent rate of change. The
    /// uncertainty of the lag between the streams is part of that time.
    pub(super) fn add_time_error(
        &mut self,
        snapshot: &Snapshot,
        before: Option<PlateReading>,
        now: Option<PlateReading>,
        step_s: f64,
    ) {
        let rates = match (before, now) {
            (Some(before), Some(now)) => now.since(&before).map(|change| change / step_s),
            _ => [0.0; 2],
        };
        let mut recent = rates;
        for (recent, (envelope, rate)) in recent.iter_mut().zip(self.ground_rates.iter_mut().zip(rates)) {
            *recent = envelope.update(rate, step_s);
        }
        let time_sigma_s = math::hypot([snapshot.time_sigma_ns as f64 * 1e-9, self.skew.lag_sigma_s()]);
        self.ground_sigma.add_time_error(time_sigma_s, recent);
        self.estimate.cop_measured_sigma_m = [self.ground_sigma.cop_m; 2];
    }
}
