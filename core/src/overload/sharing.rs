//! Who carries what: the ground reaction between the feet (ζ), the load between the hands (η).
//!
//! With one plate neither is measured, but both follow from geometry: the ground reaction acts at the centre of
//! pressure, so its projection on the line between the ankles shares it; and the load acts where the two centres of
//! pressure say, `p = (C_wt (W + ΔF) − Ĉ_wo W)/ΔF`, so its projection on the line between the grips shares that.

use nalgebra::Vector3;

use crate::body::Side;
use crate::frame::{Pose, StationWorld};
use crate::math;

/// Shares, each pair summing to one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sharing {
    /// Share of the ground reaction: left, right foot.
    pub zeta: [f64; 2],
    /// Share of the load: left, right hand.
    pub eta: [f64; 2],
    /// Horizontal distance from the load to the line between the grips, m; large if the load is not in the hands.
    pub load_distance_m: f64,
}

/// Points closer than this are one point; a line between them has no direction, m.
const TOO_CLOSE_M: f64 = 0.05;

impl Sharing {
    /// The shares for a load `delta_f_n` (not zero) on a body of weight `vertical_n − delta_f_n`.
    pub fn from_geometry(
        pose: &Pose<StationWorld>,
        cop_measured_m: [f64; 2],
        cop_estimated_m: [f64; 2],
        vertical_n: f64,
        delta_f_n: f64,
        grip_m: &[Vector3<f64>; 2],
    ) -> Sharing {
        let ankle = Side::BOTH.map(|side| horizontal(&pose.origin_of(side.foot())));
        let weight_n = vertical_n - delta_f_n;
        let load_m = core::array::from_fn(|axis| {
            (cop_measured_m[axis] * vertical_n - cop_estimated_m[axis] * weight_n) / delta_f_n
        });
        let grip = [horizontal(&grip_m[0]), horizontal(&grip_m[1])];
        let (right_hand, load_distance_m) = project(load_m, grip);
        let (right_foot, _) = project(cop_measured_m, ankle);
        Sharing { zeta: [1.0 - right_foot, right_foot], eta: [1.0 - right_hand, right_hand], load_distance_m }
    }
}

fn horizontal(point: &Vector3<f64>) -> [f64; 2] {
    [point.x, point.y]
}

/// Where a point projects on the line from `from` to `to`, clamped to [0, 1], and its distance from that place.
fn project(point: [f64; 2], [from, to]: [[f64; 2]; 2]) -> (f64, f64) {
    let along = [to[0] - from[0], to[1] - from[1]];
    let square = along[0] * along[0] + along[1] * along[1];
    let share = if square > TOO_CLOSE_M * TOO_CLOSE_M {
        (((point[0] - from[0]) * along[0] + (point[1] - from[1]) * along[1]) / square).clamp(0.0, 1.0)
    } else {
        0.5
    };
    let off = [point[0] - from[0] - share * along[0], point[1] - from[1] - share * along[1]];
    (share, math::hypot(off))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_on_the_line_shares_by_distance_and_one_beyond_it_is_clamped() {
        let line = [[0.0, 0.2], [0.0, -0.2]];
        assert_eq!(project([0.0, 0.1], line), (0.25, 0.0));
        assert_eq!(project([0.3, 0.0], line), (0.5, 0.3));
        let (share, distance) = project([0.0, -0.5], line);
        assert!((share - 1.0).abs() < 1e-15 && (distance - 0.3).abs() < 1e-12);
    }

    #[test]
    fn hands_together_share_evenly() {
        assert_eq!(project([0.5, 0.0], [[0.4, 0.01], [0.4, -0.01]]).0, 0.5);
    }
}
