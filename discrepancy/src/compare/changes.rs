//! Changes by timing errors: a lag of the suit, a filter in the plate.
//!
//! Measurement and prediction both show the motion, each with its own noise. A column that contains the noise of the
//! same instant agrees with the residual a little whatever is true (errors in variables): a filter's by the prediction,
//! a lag's by both signals. From the prediction alone a filter is favoured, from the measurement alone a lag; with the
//! mean of both they profit alike. Columns that are antisymmetric in time avoid the bias, but their noise is larger, and
//! they decide worse (blind bench). Measured shear, where the prediction uses it, has the plate's timing in both and is
//! excluded.

use std::collections::VecDeque;
use std::f64::consts::TAU;

use super::point::Point;
use crate::block::Change;
use crate::constants::{CUTOFFS_HZ, INTERPOLATION_GAP_S, LAGS_S, RATE_STEP_S};

/// Changes of a block by timing errors.
pub(super) struct Timing {
    /// Change by each of [`LAGS_S`]. If the suit's stamps are late by `tau`, its sample at a time shows the state `tau`
    /// earlier: the measurement minus that `tau` earlier, and the prediction `tau` later minus the present one.
    pub(super) by_lag: [Change; LAGS_S.len()],
    /// Rate of the measurements, m/s and N/s.
    rate: Change,
}

impl Timing {
    /// Change by the filter of a number in [`CUTOFFS_HZ`], from the sum of the changes of `count` predictions. A filter
    /// passes `m = x − τ ṁ` of what acts, `x`.
    pub(super) fn by_cutoff(&self, number: usize, of_predictions: &Change, count: f64) -> Change {
        let mut change = Change::NONE;
        change.add(0.5 / count, of_predictions);
        change.add(-0.5 / (TAU * CUTOFFS_HZ[number]), &self.rate);
        change
    }
}

/// The mean changes over a block by timing errors. `None` if the points do not cover all lags.
pub(super) fn timing(points: &VecDeque<Point>, [from_s, to_s]: [f64; 2]) -> Option<Timing> {
    let mut timing = Timing { by_lag: [Change::NONE; LAGS_S.len()], rate: Change::NONE };
    let first = points.partition_point(|point| point.time_s < from_s);
    let last = points.partition_point(|point| point.time_s < to_s);
    if first == last {
        return None;
    }
    let weight = 1.0 / (last - first) as f64;
    for now in points.range(first..last) {
        let [measured, predicted] = [now.measured_motion(), now.predicted_motion()];
        for (sum, lag_s) in timing.by_lag.iter_mut().zip(LAGS_S) {
            let [earlier, later] = [-lag_s, lag_s].map(|shift_s| around(points, now.time_s + shift_s));
            sum.add(0.5 * weight, &measured);
            add_mean(sum, -0.5 * weight, earlier?, Point::measured_motion);
            add_mean(sum, 0.5 * weight, later?, Point::predicted_motion);
            sum.add(-0.5 * weight, &predicted);
        }
        for step_s in [-RATE_STEP_S, RATE_STEP_S] {
            let then = around(points, now.time_s + step_s)?;
            add_mean(&mut timing.rate, 0.5 * weight / step_s, then, Point::measured_motion);
        }
    }
    Some(timing)
}

/// Adds the weighted mean of a quantity of some points.
fn add_mean<'a>(
    sum: &mut Change,
    scale: f64,
    (neighbours, weights): (impl Iterator<Item = &'a Point>, [f64; 4]),
    of: fn(&Point) -> Change,
) {
    neighbours.zip(weights).for_each(|(point, weight)| sum.add(scale * weight, &of(point)));
}

/// The four points around a time and their weights for the cubic through them (Lagrange). A line would flatten motion as
/// a filter does: by up to Δt²/8 of the second derivative, at 60 Hz as much as a lag of 8 ms.
fn around(points: &VecDeque<Point>, time_s: f64) -> Option<(impl Iterator<Item = &Point>, [f64; 4])> {
    let after = points.partition_point(|point| point.time_s < time_s);
    let (earlier, later) = (points.get(after.checked_sub(1)?)?, points.get(after)?);
    if later.time_s - earlier.time_s >= INTERPOLATION_GAP_S {
        return None;
    }
    let first = after.saturating_sub(2).min(points.len().checked_sub(4)?);
    let neighbours = points.range(first..first + 4);
    let mut times_s = [0.0; 4];
    times_s.iter_mut().zip(neighbours.clone()).for_each(|(time_s, point)| *time_s = point.time_s);
    let weights = [0, 1, 2, 3].map(|of| {
        let others = (0..4).filter(|other| *other != of);
        others.map(|other| (time_s - times_s[other]) / (times_s[of] - times_s[other])).product()
    });
    Some((neighbours, weights))
}

/// The prediction through a first-order filter of each cutoff.
#[derive(Debug, Default)]
pub(super) struct Filters {
    last: Option<(f64, Change)>,
    filtered: [Option<Change>; CUTOFFS_HZ.len()],
}

impl Filters {
    /// Ingests the next point and returns the change by each filter. Filters start in steady state.
    pub(super) fn step(&mut self, point: &Point) -> [Change; CUTOFFS_HZ.len()] {
        let now = point.predicted_motion();
        let mut changes = [Change::NONE; CUTOFFS_HZ.len()];
        for ((filtered, change), cutoff_hz) in self.filtered.iter_mut().zip(&mut changes).zip(CUTOFFS_HZ) {
            let next = match (*filtered, self.last) {
                (Some(filtered), Some((before_s, before))) => {
                    let turn = TAU * cutoff_hz * (point.time_s - before_s);
                    filtered_step(&filtered, &before, &now, turn)
                }
                _ => now,
            };
            change.add(1.0, &next);
            change.add(-1.0, &now);
            *filtered = Some(next);
        }
        self.last = Some((point.time_s, now));
        changes
    }
}

/// One step of `τ ẏ = x − y` over `turn` = Δt/τ, exact for a linearly interpolated input.
fn filtered_step(state: &Change, before: &Change, now: &Change, turn: f64) -> Change {
    let decay = (-turn).exp();
    let mean = if turn > 1e-9 { (1.0 - decay) / turn } else { 1.0 };
    let mut next = Change::NONE;
    for (weight, part) in [(decay, state), (mean - decay, before), (1.0 - mean, now)] {
        next.add(weight, part);
    }
    next
}
