//! Change of the measurements by timing errors: a lag of the suit, a filter in the plate.
//!
//! The changes are those of the plate's own signals, whose noise is far below that of the suit's accelerations. Changes
//! of the prediction would contain the suit's noise, as the residual does, and the two agree as if the plate filtered
//! (errors in variables).

use std::collections::VecDeque;

use super::point::Point;
use crate::block::Change;
use crate::constants::{INTERPOLATION_GAP_S, LAGS_S};

/// Mean change over a block by each lag: the measurement minus that `tau` earlier. If the suit's stamps are late by
/// `tau`, its sample at a time shows the state `tau` earlier.
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
            sum.add(share, &now.measured_motion());
            let (neighbours, weights) = around(points, now.time_s - lag_s)?;
            for (point, weight) in neighbours.zip(weights) {
                sum.add(-share * weight, &point.measured_motion());
            }
        }
    }
    Some(sums)
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
