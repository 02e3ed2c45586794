//! Who carries what: the ground reaction between the feet (ζ), the load between the hands (η).
//!
//! With one plate neither is measured, but both follow from geometry: the ground reaction acts at the centre of
//! pressure, so its projection on the line between the ankles shares it; and the load acts where the two centres of
//! pressure say, `p = (C_wt (W + ΔF) − Ĉ_wo W)/ΔF`, so its projection on the line between the grips shares that.
//!
//! Where each foot is measured by itself (two plates, insoles), ζ is what was measured: [`Sharing::with_feet`].

use nalgebra::Vector3;

use crate::body::Side;
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::message::ground::Feet;

/// Shares, each pair summing to one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sharing {
    /// Share of the ground reaction: left, right foot.
    pub zeta: [f64; 2],
    /// The same as it would be without the load; equal to `zeta` in the paper's Eq. 15.
    pub zeta_without_load: [f64; 2],
    /// How `zeta_without_load` follows the estimated centre of pressure, by foot and axis, 1/m.
    pub zeta_slope_per_m: [[f64; 2]; 2],
    /// Share of the load: left, right hand.
    pub eta: [f64; 2],
    /// Horizontal distance from the load to the line between the grips, m; large if the load is not in the hands.
    pub load_distance_m: f64,
    /// Centre of pressure under each foot, world x and y, m; `None` where only the common one is known.
    pub foot_cop_m: Option<[[f64; 2]; 2]>,
}

/// 1-σ of how far from even people share a load between their hands.
const EVEN_SIGMA: f64 = 0.2;
/// Points closer than this are one point; a line between them has no direction, m.
pub(super) const TOO_CLOSE_M: f64 = 0.05;
/// 1-σ of where on its sole a foot presses, off its ankle along the line between the feet, m: soles are about four
/// times as wide.
const PRESS_SIGMA_M: f64 = 0.02;
/// 1-σ of where a measured foot would press without the load, per axis, beside what sums and rule say, m.
pub const FOOT_WITHOUT_LOAD_SIGMA_M: f64 = 0.01;
/// Feet's centres of pressure that miss the common one by more than this are not of this plate, m.
const FEET_OFF_MAX_M: f64 = 0.03;

impl Sharing {
    /// Shares that are the same with and without the load, of feet and hands.
    pub const fn of(zeta: [f64; 2], eta: [f64; 2]) -> Sharing {
        Sharing {
            zeta,
            zeta_without_load: zeta,
            zeta_slope_per_m: [[0.0; 2]; 2],
            eta,
            load_distance_m: 0.0,
            foot_cop_m: None,
        }
    }

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
        let (right_foot_without_load, _) = project(cop_estimated_m, ankle);
        let slope = slope_of_projection(cop_estimated_m, ankle);
        Sharing {
            zeta: [1.0 - right_foot, right_foot],
            zeta_without_load: [1.0 - right_foot_without_load, right_foot_without_load],
            zeta_slope_per_m: [slope.map(|slope| -slope), slope],
            eta: [1.0 - right_hand, right_hand],
            load_distance_m,
            foot_cop_m: None,
        }
    }

    /// Shares between the feet as in Eq. 15: the same with and without the load.
    #[must_use]
    pub fn as_in_the_paper(self) -> Sharing {
        Sharing { zeta_without_load: self.zeta, zeta_slope_per_m: [[0.0; 2]; 2], ..self }
    }

    /// The hands' shares with the belief that people use both, and the 1-σ of the right hand's.
    ///
    /// `eta_sigma` is that of the share by geometry. Where it says little, the load is somewhere between the hands: even
    /// shares, give or take `EVEN_SIGMA`.
    #[must_use]
    pub fn with_both_hands(self, eta_sigma: f64) -> (Sharing, f64) {
        let (even, measured) = (EVEN_SIGMA * EVEN_SIGMA, eta_sigma * eta_sigma);
        let right = 0.5 + (self.eta[1] - 0.5) * even / (even + measured);
        (Sharing { eta: [1.0 - right, right], ..self }, math::sqrt(even * measured / (even + measured)))
    }

    /// The same with what was measured under each foot in place of geometry.
    ///
    /// Both feet's centres are moved alike until their sum is the common centre of pressure, which a tare may have
    /// moved; if they miss it by centimetres they are not believed, and the shares alone are used.
    #[must_use]
    pub fn with_feet(self, feet: &Feet, cop_measured_m: [f64; 2]) -> Sharing {
        let zeta = feet.shares();
        let foot_cop_m = feet.cop_m.and_then(|[left, right]| {
            let off = [0, 1].map(|axis| cop_measured_m[axis] - zeta[0] * left[axis] - zeta[1] * right[axis]);
            let moved = [left, right].map(|cop| [cop[0] + off[0], cop[1] + off[1]]);
            (math::hypot(off) <= FEET_OFF_MAX_M).then_some(moved)
        });
        // The load moves as much weight from foot to foot as geometry says, from where it was measured.
        let moved = self.zeta_without_load[1] - self.zeta[1];
        let right = (zeta[1] + moved).clamp(0.0, 1.0);
        Sharing { zeta, zeta_without_load: [1.0 - right, right], foot_cop_m, ..self }
    }

    /// 1-σ of a ζ that comes from geometry: nobody knows where on its sole each foot presses.
    pub fn zeta_sigma_by_geometry(pose: &Pose<StationWorld>) -> f64 {
        let [left, right] = Side::BOTH.map(|side| horizontal(&pose.origin_of(side.foot())));
        let apart_m = math::hypot([right[0] - left[0], right[1] - left[1]]);
        (PRESS_SIGMA_M / apart_m.max(TOO_CLOSE_M)).min(0.5)
    }
}

fn horizontal(point: &Vector3<f64>) -> [f64; 2] {
    [point.x, point.y]
}

/// How the projection's share follows the point, by axis, 1/m; zero where it is clamped.
fn slope_of_projection(point: [f64; 2], [from, to]: [[f64; 2]; 2]) -> [f64; 2] {
    let along = [to[0] - from[0], to[1] - from[1]];
    let square = along[0] * along[0] + along[1] * along[1];
    let share = ((point[0] - from[0]) * along[0] + (point[1] - from[1]) * along[1]) / square.max(1e-9);
    let free = square > TOO_CLOSE_M * TOO_CLOSE_M && (0.0..=1.0).contains(&share);
    if free { along.map(|along| along / square) } else { [0.0; 2] }
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

    #[test]
    fn measured_shares_stand_in_place_of_geometry_and_the_common_centre_decides_where_they_differ() {
        let geometry = Sharing { load_distance_m: 0.1, ..Sharing::of([0.5; 2], [0.2, 0.8]) };
        let feet = Feet { vertical_n: [200.0, 600.0], cop_m: Some([[0.02, 0.12], [0.06, -0.12]]) };
        let (common, tared) = ([0.05, -0.06], [0.055, -0.06]);
        let sharing = geometry.with_feet(&feet, common);
        assert_eq!((sharing.zeta, sharing.eta), ([0.25, 0.75], [0.2, 0.8]));
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        let moved = geometry.with_feet(&feet, tared).foot_cop_m.unwrap();
        assert!(near(sharing.foot_cop_m.unwrap()[0][0], 0.02) && near(moved[0][0], 0.025));
        let wrong = geometry.with_feet(&feet, [0.15, -0.06]);
        assert_eq!((wrong.zeta, wrong.foot_cop_m), ([0.25, 0.75], None));
    }
}
