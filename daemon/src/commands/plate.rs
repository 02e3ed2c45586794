//! The command that tares the plate.

use std::time::{Duration, Instant};

use equipoise_core::GRAVITY_M_PER_S2;
use equipoise_core::cycle::memory::EMPTY_PLATE_N;
use equipoise_core::message::command::CommandKind;
use equipoise_core::message::{State, Validity};

use super::{Answer, PLATE_LOADED_RECENTLY, PLATE_SILENT, push_command};
use crate::rings::CommandEnds;

/// Time without a load on the plate that a tare requires: the loop uses its last 0.3 s, and published states lag slightly
/// behind the plate.
const EMPTY_MIN_NS: u64 = 500_000_000;
/// A reading that changes less than this, N, for `STEADY_NS` may be that of an empty device with an offset.
const STEADY_N: f64 = 10.0;
const STEADY_NS: u64 = 1_000_000_000;
/// A person's weight is at least this much larger than a reading that may be an offset.
const WEIGHT_FACTOR: f64 = 2.0;
/// Body weight if the mass is unknown, N: that of a light adult.
const WEIGHT_N: f64 = 400.0;
/// Maximum wait for the loop's result.
const RESULT_TIMEOUT: Duration = Duration::from_secs(1);
const RESULT_POLL_INTERVAL: Duration = Duration::from_millis(2);

/// The plate's readings so far.
#[derive(Debug, Default)]
pub(super) struct PlateHistory {
    /// When a state last showed a load on the plate, or no valid force, CLOCK_MONOTONIC; 0 for never.
    occupied_ns: u64,
    /// Reading since `steady_since_ns`, N.
    steady_n: f64,
    steady_since_ns: u64,
}

impl PlateHistory {
    pub(super) fn update(&mut self, state: &State) {
        let is_valid = !state.validity().any_of(Validity::INVALIDATES_GROUND_FORCE);
        let force_n = state.ground_force_n[2];
        // An invalid force is zero in the state: the plate may be loaded.
        if !is_valid || force_n.abs() > EMPTY_PLATE_N {
            self.occupied_ns = state.time_ns;
        }
        if !is_valid || (force_n - self.steady_n).abs() > STEADY_N {
            (self.steady_n, self.steady_since_ns) = (force_n, state.time_ns);
        }
    }

    /// Why the plate cannot be tared.
    fn refusal(&self, latest: Option<&State>) -> Option<String> {
        let valid = latest.filter(|state| !state.validity().any_of(Validity::INVALIDATES_GROUND_FORCE));
        let Some(state) = valid else { return Some(PLATE_SILENT.to_owned()) };
        let force_n = state.ground_force_n[2];
        if force_n.abs() > EMPTY_PLATE_N {
            let weight_n = if state.mass_kg > 0.0 { GRAVITY_M_PER_S2 * state.mass_kg } else { WEIGHT_N };
            let is_steady = state.time_ns.saturating_sub(self.steady_since_ns) >= STEADY_NS;
            let offset = if is_steady && WEIGHT_FACTOR * force_n.abs() < weight_n {
                format!(
                    "; if nothing stands on it, zero the device itself (its software, amplifier or `bias`): a tare \
                     removes at most {EMPTY_PLATE_N:.0} N"
                )
            } else {
                String::new()
            };
            return Some(format!("{force_n:.0} N stand on the plate; step off and ask again{offset}"));
        }
        (state.time_ns.saturating_sub(self.occupied_ns) < EMPTY_MIN_NS)
            .then(|| PLATE_LOADED_RECENTLY.to_owned())
    }
}

/// Tares the plate and waits for the loop's result.
pub(super) fn tare(ends: &mut CommandEnds, latest: Option<&State>, plate: &PlateHistory) -> Answer {
    if let Some(refusal) = plate.refusal(latest) {
        return Err(refusal);
    }
    let before = ends.control.tares();
    push_command(ends, CommandKind::Tare)?;
    let started = Instant::now();
    loop {
        // Checked before the counters: a loop that has ended does not change them any more.
        let ended = ends.control.has_ended();
        let now = ends.control.tares();
        if now.tared > before.tared {
            return Ok("the readings of the empty plate are zero from now on".to_owned());
        }
        if now.refused > before.refused {
            return Err(PLATE_LOADED_RECENTLY.to_owned());
        }
        if ended || started.elapsed() >= RESULT_TIMEOUT {
            return Err("the loop has not tared the plate within a second; see `equipoise status`".to_owned());
        }
        std::thread::sleep(RESULT_POLL_INTERVAL);
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    fn state(time_s: f64, force_n: f64, mass_kg: f64, invalid: Validity) -> State {
        State {
            time_ns: (time_s * 1e9) as u64,
            ground_force_n: [0.0, 0.0, force_n],
            mass_kg,
            valid: invalid.0,
            ..State::zeroed()
        }
    }

    /// The refusal after readings every 0.1 s.
    fn refusal(readings: &[f64], mass_kg: f64) -> Option<String> {
        let mut plate = PlateHistory::default();
        let mut newest = None;
        for (step, force_n) in readings.iter().enumerate() {
            // NaN: the device is silent, and the published force is zero.
            let (force_n, invalid) = if force_n.is_nan() {
                (0.0, Validity::GROUND_STALE)
            } else {
                (*force_n, Validity::default())
            };
            let state = state(10.0 + 0.1 * step as f64, force_n, mass_kg, invalid);
            plate.update(&state);
            newest = Some(state);
        }
        plate.refusal(newest.as_ref())
    }

    #[test]
    fn a_plate_without_data_does_not_count_as_empty() {
        assert_eq!(refusal(&[], 70.0).as_deref(), Some(PLATE_SILENT));
        assert_eq!(refusal(&[700.0, f64::NAN], 70.0).as_deref(), Some(PLATE_SILENT));
        let silent = [&[700.0][..], &[f64::NAN; 20], &[2.0; 3]].concat();
        assert_eq!(refusal(&silent, 70.0).as_deref(), Some(PLATE_LOADED_RECENTLY));
        assert_eq!(refusal(&[&silent[..], &[2.0; 4]].concat(), 70.0), None);
    }

    #[test]
    fn a_steady_reading_far_below_the_weight_may_be_the_device_s_offset() {
        let says_zero =
            |readings: &[f64], mass_kg: f64| refusal(readings, mass_kg).unwrap().contains("zero the device");
        assert!(says_zero(&[160.0; 20], 70.0) && says_zero(&[-160.0; 20], 0.0));
        assert!(!says_zero(&[160.0; 5], 70.0), "not for long enough");
        assert!(!says_zero(&[700.0; 20], 70.0) && !says_zero(&[500.0; 20], 0.0));
        let moving: Vec<f64> = (0..20).map(|step| 160.0 + 20.0 * f64::from(step % 2)).collect();
        assert!(!says_zero(&moving, 70.0));
    }
}
