//! Changes by timing errors: a lag of the suit, a filter in the plate.
//!
//! Measurement and prediction both show the motion, each with its own noise, and the residual contains both. A column
//! that contains the noise of the same instant agrees with it whatever is true (errors in variables). Columns are
//! therefore antisymmetric in time: their noise is uncorrelated with that of the instant itself. Measured shear, where
//! the prediction uses it, has the plate's timing in both and is excluded.

use std::collections::VecDeque;

use super::point::Point;
use crate::block::Change;
use crate::constants::{INTERPOLATION_GAP_S, LAGS_S, RATE_STEP_S};

/// Changes of a block by timing errors.
pub(super) struct Timing {
    /// Change by each of [`LAGS_S`]: the mean over both signals of that half a lag later minus that half a lag earlier.
    /// If the suit's stamps are late by `tau`, a motion `s(t)` is predicted as `s(t − tau)`. The residual
    /// `s(t) − s(t − tau)` and `(s(t + tau/2) − s(t − 3 tau/2))/2` have the same phase; amplitudes differ by
    /// cos(ω tau/2).
    pub(super) by_lag: [Change; LAGS_S.len()],
    /// Rate of the measurements, m/s and N/s.
    pub(super) rate: Change,
}

/// The mean changes over a block by timing errors. `None` if the points do not cover all lags.
pub(super) fn timing(points: &VecDeque<Point>, [from_s, to_s]: [f64; 2]) -> Option<Timing> {
    let mut timing = Timing { by_lag: [Change::NONE; LAGS_S.len()], rate: Change::NONE };
    let first = points.partition_point(|point| point.time_s < from_s);
    let last = points.partition_point(|point| point.time_s < to_s);
    if first == last {
        return None;
    }
    let share = 1.0 / (last - first) as f64;
    for now in points.range(first..last) {
        for (sum, lag_s) in timing.by_lag.iter_mut().zip(LAGS_S) {
            for (scale, at_s) in [(0.5 * share, 0.5 * lag_s), (-0.5 * share, -0.5 * lag_s)] {
                let (neighbours, weights) = around(points, now.time_s + at_s)?;
                for (point, weight) in neighbours.zip(weights) {
                    sum.add(scale * weight, &point.measured_motion(now.slope_is_measured));
                    sum.add(scale * weight, &point.predicted_motion(now.slope_is_measured));
                }
            }
        }
        for step_s in [-RATE_STEP_S, RATE_STEP_S] {
            let (neighbours, weights) = around(points, now.time_s + step_s)?;
            for (point, weight) in neighbours.zip(weights) {
                let motion = point.measured_motion(now.slope_is_measured);
                timing.rate.add(0.5 * share * weight / step_s, &motion);
            }
        }
    }
    Some(timing)
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
