//! Change of the prediction by timing errors: a lag of the suit, a filter in the plate.
//!
//! Measured shear already contains the plate's delay and filter; where it enters the prediction it is held constant,
//! and only quantities from the suit are shifted.

use std::collections::VecDeque;
use std::f64::consts::TAU;

use super::point::Point;
use crate::block::Change;
use crate::constants::{CUTOFFS_HZ, INTERPOLATION_GAP_S, LAGS_S};

/// Mean change over a block by each lag: the prediction `tau` later minus the present one. If the suit's stamps are
/// late by `tau`, its sample at a time shows the state `tau` earlier, so the prediction `tau` later is correct.
///
/// `None` if the points do not cover all lags.
pub(super) fn by_lag(points: &VecDeque<Point>, [from_s, to_s]: [f64; 2]) -> Option<[Change; LAGS_S.len()]> {
    let mut sums = [Change::NONE; LAGS_S.len()];
    let first = points.partition_point(|point| point.time_s < from_s);
    let last = points.partition_point(|point| point.time_s < to_s);
    if first == last {
        return None;
    }
    let share = 1.0 / (last - first) as f64;
    for now in points.range(first..last) {
        for (sum, lag_s) in sums.iter_mut().zip(LAGS_S) {
            let (before, after, part) = between(points, now.time_s + lag_s)?;
            let then = [before, after].map(|point| Prediction::of(point, now));
            let at_present = Prediction::of(now, now);
            let moved =
                |earlier: f64, later: f64, now: f64| share * (earlier + part * (later - earlier) - now);
            for axis in 0..2 {
                sum.cop_m[axis] += moved(then[0].cop_m[axis], then[1].cop_m[axis], at_present.cop_m[axis]);
            }
            for axis in 0..3 {
                sum.force_n[axis] +=
                    moved(then[0].force_n[axis], then[1].force_n[axis], at_present.force_n[axis]);
            }
        }
    }
    Some(sums)
}

/// The neighbouring points of a time, and its relative position between them.
fn between(points: &VecDeque<Point>, time_s: f64) -> Option<(&Point, &Point, f64)> {
    let after = points.partition_point(|point| point.time_s < time_s);
    let (earlier, later) = (points.get(after.checked_sub(1)?)?, points.get(after)?);
    let apart_s = later.time_s - earlier.time_s;
    (apart_s < INTERPOLATION_GAP_S).then(|| (earlier, later, (time_s - earlier.time_s) / apart_s))
}

/// Prediction of the suit at a point; a measured slope is held constant.
#[derive(Debug, Clone, Copy)]
struct Prediction {
    cop_m: [f64; 2],
    force_n: [f64; 3],
}

impl Prediction {
    fn of(point: &Point, now: &Point) -> Prediction {
        let held = now.slope_is_measured.then_some(now.slope);
        Prediction { cop_m: point.by_suit_m(held), force_n: point.force_predicted_n }
    }
}

/// The prediction through a first-order filter of each cutoff.
#[derive(Debug, Default)]
pub(super) struct Filters {
    last: Option<(f64, Prediction)>,
    filtered: [Option<Prediction>; CUTOFFS_HZ.len()],
}

impl Filters {
    /// Ingests the next point and returns the change by each filter. Filters start in steady state.
    pub(super) fn step(&mut self, point: &Point) -> [Change; CUTOFFS_HZ.len()] {
        // The slope at which the filter is in steady state is irrelevant: measured shear has passed through the plate's
        // filter.
        let held = point.slope_is_measured.then_some([0.0; 2]);
        let now = Prediction { cop_m: point.by_suit_m(held), force_n: point.force_predicted_n };
        let mut changes = [Change::NONE; CUTOFFS_HZ.len()];
        for ((filtered, change), cutoff_hz) in self.filtered.iter_mut().zip(&mut changes).zip(CUTOFFS_HZ) {
            let next = match (*filtered, self.last) {
                (Some(filtered), Some((before_s, before))) => {
                    let turn = TAU * cutoff_hz * (point.time_s - before_s);
                    filtered.filtered(&before, &now, turn)
                }
                _ => now,
            };
            for axis in 0..2 {
                change.cop_m[axis] = next.cop_m[axis] - now.cop_m[axis];
            }
            for axis in 0..3 {
                change.force_n[axis] = next.force_n[axis] - now.force_n[axis];
            }
            *filtered = Some(next);
        }
        self.last = Some((point.time_s, now));
        changes
    }
}

impl Prediction {
    /// One step of `τ ẏ = x − y` over `turn` = Δt/τ, exact for a linearly interpolated input.
    fn filtered(&self, before: &Prediction, now: &Prediction, turn: f64) -> Prediction {
        let decay = (-turn).exp();
        let mean = if turn > 1e-9 { (1.0 - decay) / turn } else { 1.0 };
        let step =
            |state: f64, before: f64, now: f64| decay * state + (mean - decay) * before + (1.0 - mean) * now;
        Prediction {
            cop_m: std::array::from_fn(|axis| step(self.cop_m[axis], before.cop_m[axis], now.cop_m[axis])),
            force_n: std::array::from_fn(|axis| {
                step(self.force_n[axis], before.force_n[axis], now.force_n[axis])
            }),
        }
    }
}
