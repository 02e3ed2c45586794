//! Vertical ground reaction on each foot, with the load and without it.
//!
//! Each foot's force acts under that foot. With one plate only the common CoP is measured: each foot is then assumed to
//! press at its ankle, with both points shifted equally so that the resultant acts at the CoP, `c_k = ankle_k + (C − Σ
//! ζ ankle)`, and ζ is the projection of the CoP on the line between the ankles.
//!
//! The forces *without* the load cannot be measured, but their resultant is determined: weight W, acting at Ĉ_wo. Of
//! the displacement from C_wt back to Ĉ_wo, the part along the line between the ankles shifts weight between the feet;
//! the rest (across that line, or beyond the point at which a foot is unloaded) shifts both feet's centres equally:
//! people who stand side by side balance sideways by loading the other leg, and forward by both ankles (Winter et al.,
//! Journal of Neurophysiology 75 (1996) 2334–2343). So Σ f_k = W and Σ f_k c_k = W Ĉ_wo hold by construction, and with
//! both centres in one position the rule is Eq. 15.

use super::Loading;
use super::sharing::{TOO_CLOSE_M, project};
use crate::math;

/// Available information on the distribution of the ground reaction between the feet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FootLoads {
    /// Foot load fractions ζ that apply with and without the load, and both forces at the common CoP: Eq. 15 as
    /// published.
    Common {
        /// ζ: left, right.
        zeta: [f64; 2],
    },
    /// Only the common CoP is measured.
    Geometry {
        /// Point of action under each foot, from its ankle, world x and y, m.
        press_m: [[f64; 2]; 2],
        /// Which feet are on the floor: left, right.
        stands: [bool; 2],
    },
    /// ζ is measured, the CoPs of the feet are not.
    Fractions {
        /// ζ: left, right.
        zeta: [f64; 2],
        /// As in [`FootLoads::Geometry`], m.
        press_m: [[f64; 2]; 2],
    },
    /// ζ and the CoPs of the feet are measured.
    Measured {
        /// ζ: left, right.
        zeta: [f64; 2],
        /// Centres of pressure of the feet, world x and y, m.
        cop_m: [[f64; 2]; 2],
    },
}

/// Deviation from what [`FootLoads`] assumes. It does not apply to [`FootLoads::Common`], and not to one foot alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FootDeviation {
    /// Point of action under the left foot from the line common to both feet, while both carry the same force, world x
    /// and y, m; that under the right foot is opposite. Foot k of any two has `2 (1 − ζ_k)` times as much, so the
    /// resultant and ζ do not change.
    pub apart_m: [f64; 2],
    /// The same in addition, without the load only.
    pub unloaded_apart_m: [f64; 2],
    /// Right foot's ζ without the load, while both feet carry the same force.
    pub unloaded_zeta: f64,
    /// Right foot's fraction of the horizontal forces and of the free moment less its ζ, while both carry the same.
    pub shear: f64,
}

impl FootDeviation {
    /// None.
    pub const NONE: FootDeviation =
        FootDeviation { apart_m: [0.0; 2], unloaded_apart_m: [0.0; 2], unloaded_zeta: 0.0, shear: 0.0 };

    /// Fractions of both feet that deviate by this from ζ while both carry the same force; a foot that carries nothing
    /// does not deviate.
    pub(super) fn divided(deviation: f64, zeta: [f64; 2]) -> [f64; 2] {
        let moved = 4.0 * zeta[0] * zeta[1] * deviation;
        [zeta[0] - moved, zeta[1] + moved].map(|zeta| zeta.clamp(0.0, 1.0))
    }
}

/// Deviation of the points of action under both feet with these load fractions, m.
fn opposite_m(apart_m: [f64; 2], zeta: [f64; 2]) -> [[f64; 2]; 2] {
    [2.0 * zeta[1], -2.0 * zeta[0]].map(|weight| apart_m.map(|apart_m| weight * apart_m))
}

/// Maximum deviation of the feet's CoPs from the common one, m; beyond it they belong to another plate.
const FEET_OFF_MAX_M: f64 = 0.03;

impl FootLoads {
    /// Fractions and CoPs measured under each foot.
    ///
    /// Both CoPs are shifted equally until their resultant is the common one, which a tare may have shifted; if they
    /// deviate from it by more than 30 mm, only the fractions are used.
    pub fn measured(feet: &crate::message::ground::Feet, cop_measured_m: [f64; 2]) -> FootLoads {
        let zeta = feet.fractions();
        let moved = feet.cop_m.and_then(|cop_m| {
            let off = offset_from_resultant(cop_measured_m, zeta, cop_m);
            (math::hypot(off) <= FEET_OFF_MAX_M)
                .then(|| cop_m.map(|cop_m| [cop_m[0] + off[0], cop_m[1] + off[1]]))
        });
        match moved {
            Some(cop_m) => FootLoads::Measured { zeta, cop_m },
            None => FootLoads::Fractions { zeta, press_m: [[0.0; 2]; 2] },
        }
    }

    /// The same relative to a body that is moved by `by_m`: points fixed to the plate move the other way.
    pub(super) fn relative_to(self, by_m: [f64; 2]) -> FootLoads {
        match self {
            FootLoads::Measured { zeta, cop_m } => FootLoads::Measured {
                zeta,
                cop_m: cop_m.map(|cop_m| [cop_m[0] - by_m[0], cop_m[1] - by_m[1]]),
            },
            other => other,
        }
    }
}

/// Vertical force of the ground on one foot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FootReaction {
    /// Force with the load, N.
    pub with_n: f64,
    /// Its point of action, m.
    pub with_m: [f64; 2],
    /// Force without the load, N.
    pub without_n: f64,
    /// Its point of action, m.
    pub without_m: [f64; 2],
}

impl FootReaction {
    /// Difference of moment arm times force with and without the load about a point, along one axis, N m.
    pub(super) fn added_nm(&self, axis: usize, origin_m: f64) -> f64 {
        self.with_n * (self.with_m[axis] - origin_m) - self.without_n * (self.without_m[axis] - origin_m)
    }
}

/// Left and right foot; `ankle_m`: left and right ankle, world x and y, m.
pub fn reactions(loading: &Loading, ankle_m: [[f64; 2]; 2]) -> [FootReaction; 2] {
    let (cop_m, weight_n) = (loading.cop_measured_m, loading.weight_n());
    let pressed_m = |press_m: [[f64; 2]; 2]| -> [[f64; 2]; 2] {
        core::array::from_fn(|foot| [0, 1].map(|axis| ankle_m[foot][axis] + press_m[foot][axis]))
    };
    let under_feet = |zeta: [f64; 2], at_m: [[f64; 2]; 2]| {
        let off = offset_from_resultant(cop_m, zeta, at_m);
        reactions_at(loading, ankle_m, zeta, at_m.map(|at_m| sum(at_m, off)))
    };
    match loading.feet {
        FootLoads::Common { zeta } => zeta.map(|zeta| FootReaction {
            with_n: zeta * loading.vertical_n,
            with_m: cop_m,
            without_n: zeta * weight_n,
            without_m: loading.cop_estimated_m,
        }),
        FootLoads::Geometry { press_m, stands: [true, true] } => {
            let at_m = pressed_m(press_m);
            let (right, _) = project(cop_m, at_m);
            under_feet([1.0 - right, right], at_m)
        }
        FootLoads::Geometry { stands: [left, _], .. } => {
            let all_on = |stands: bool| if stands { 1.0 } else { 0.0 };
            [left, !left].map(|stands| FootReaction {
                with_n: all_on(stands) * loading.vertical_n,
                with_m: cop_m,
                without_n: all_on(stands) * weight_n,
                without_m: loading.cop_estimated_m,
            })
        }
        FootLoads::Fractions { zeta, press_m } => under_feet(zeta, pressed_m(press_m)),
        FootLoads::Measured { zeta, cop_m } => reactions_at(loading, ankle_m, zeta, cop_m),
    }
}

/// Vector from the resultant of both feet's forces to a point, m.
fn offset_from_resultant(point_m: [f64; 2], zeta: [f64; 2], [left, right]: [[f64; 2]; 2]) -> [f64; 2] {
    [0, 1].map(|axis| point_m[axis] - zeta[0] * left[axis] - zeta[1] * right[axis])
}

fn reactions_at(
    loading: &Loading,
    ankle_m: [[f64; 2]; 2],
    zeta: [f64; 2],
    foot_cop_m: [[f64; 2]; 2],
) -> [FootReaction; 2] {
    let Loading { cop_measured_m, cop_estimated_m, .. } = loading;
    let between = |[from, to]: [[f64; 2]; 2]| [to[0] - from[0], to[1] - from[1]];
    let line = between(ankle_m);
    let length_m = math::hypot(line);
    let along_m = |[x, y]: [f64; 2]| (line[0] * x + line[1] * y) / length_m;
    let apart_m = along_m(between(foot_cop_m));
    let moved_m = along_m(between([*cop_measured_m, *cop_estimated_m]));
    // False for NaN.
    let moved = if apart_m > TOO_CLOSE_M { moved_m / apart_m } else { 0.0 };
    let right_without = (zeta[1] + moved).clamp(0.0, 1.0);
    let deviation = &loading.deviation;
    let without = FootDeviation::divided(deviation.unloaded_zeta, [1.0 - right_without, right_without]);
    let rest = offset_from_resultant(*cop_estimated_m, without, foot_cop_m);
    let off_with_m = opposite_m(deviation.apart_m, zeta);
    let off_without_m = opposite_m(sum(deviation.apart_m, deviation.unloaded_apart_m), without);
    core::array::from_fn(|foot| FootReaction {
        with_n: zeta[foot] * loading.vertical_n,
        with_m: sum(foot_cop_m[foot], off_with_m[foot]),
        without_n: without[foot] * loading.weight_n(),
        without_m: sum(sum(foot_cop_m[foot], rest), off_without_m[foot]),
    })
}

fn sum(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::overload::{FootDeviation, Swing};
    use nalgebra::Vector3;

    const ANKLE_M: [[f64; 2]; 2] = [[0.0, 0.13], [0.01, -0.13]];
    const SIDE_BY_SIDE_M: [[f64; 2]; 2] = [[0.0, 0.13], [0.0, -0.13]];
    const NO_PRESS: [[f64; 2]; 2] = [[0.0; 2]; 2];
    const APART: [[f64; 2]; 2] = [[0.02, 0.14], [0.09, -0.12]];

    fn loading(feet: FootLoads, cop_measured_m: [f64; 2], cop_estimated_m: [f64; 2]) -> Loading {
        Loading {
            cop_measured_m,
            cop_estimated_m,
            vertical_n: 800.0,
            delta_f_n: 100.0,
            grip_m: [Vector3::zeros(); 2],
            eta: [0.5; 2],
            feet,
            deviation: FootDeviation::NONE,
            swing: Swing::NONE,
        }
    }

    fn measured(zeta: [f64; 2], cop_m: [[f64; 2]; 2], estimated_m: [f64; 2]) -> Loading {
        let common = [0, 1].map(|axis| zeta[0] * cop_m[0][axis] + zeta[1] * cop_m[1][axis]);
        loading(FootLoads::Measured { zeta, cop_m }, common, estimated_m)
    }

    #[test]
    fn the_sums_agree_with_and_without_the_load() {
        for right in [0.0, 0.02, 0.3, 0.5, 0.9, 1.0] {
            let zeta = [1.0 - right, right];
            for estimated_m in [[0.05, 0.0], [0.01, 0.1], [-0.03, -0.3], [0.05, 0.2]] {
                let common = [0.05, 0.13 - 0.26 * right];
                for loading in [
                    measured(zeta, APART, estimated_m),
                    measured(zeta, [[0.03, 0.01], [0.03, -0.01]], estimated_m),
                    loading(FootLoads::Common { zeta }, common, estimated_m),
                    loading(FootLoads::Fractions { zeta, press_m: NO_PRESS }, common, estimated_m),
                    loading(
                        FootLoads::Geometry { press_m: NO_PRESS, stands: [true; 2] },
                        common,
                        estimated_m,
                    ),
                    loading(FootLoads::Geometry { press_m: APART, stands: [true; 2] }, common, estimated_m),
                    loading(
                        FootLoads::Geometry { press_m: NO_PRESS, stands: [false, true] },
                        common,
                        estimated_m,
                    ),
                ] {
                    let deviation = FootDeviation {
                        apart_m: [0.03, -0.01],
                        unloaded_apart_m: [0.01, 0.02],
                        unloaded_zeta: -0.04,
                        shear: 0.1,
                    };
                    let feet = reactions(&Loading { deviation, ..loading }, ANKLE_M);
                    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b} {loading:?}");
                    near(feet.iter().map(|foot| foot.with_n).sum(), loading.vertical_n);
                    near(feet.iter().map(|foot| foot.without_n).sum(), loading.weight_n());
                    assert!(feet.iter().all(|foot| foot.with_n >= 0.0 && foot.without_n >= 0.0));
                    for axis in 0..2 {
                        let with: f64 = feet.iter().map(|foot| foot.with_n * foot.with_m[axis]).sum();
                        near(with, loading.vertical_n * loading.cop_measured_m[axis]);
                        let without: f64 =
                            feet.iter().map(|foot| foot.without_n * foot.without_m[axis]).sum();
                        near(without, loading.weight_n() * loading.cop_estimated_m[axis]);
                    }
                }
            }
        }
    }

    #[test]
    fn weight_that_shifts_sideways_changes_fractions_and_not_the_places_of_the_feet() {
        let side_by_side = [[0.04, 0.13], [0.04, -0.13]];
        // With the load 0.6 on the right; without it equal, and 2 cm farther back.
        let feet = reactions(&measured([0.4, 0.6], side_by_side, [0.02, 0.0]), SIDE_BY_SIDE_M);
        for (foot, y) in feet.iter().zip([0.13, -0.13]) {
            assert!((foot.without_n - 350.0).abs() < 1e-9);
            assert!((foot.without_m[0] - 0.02).abs() < 1e-12 && (foot.without_m[1] - y).abs() < 1e-12);
        }
    }

    #[test]
    fn a_shift_across_the_line_between_the_ankles_moves_the_places_and_not_the_fractions() {
        let pressing = [[0.02, 0.13], [0.08, -0.13]];
        let zeta = [0.4, 0.6];
        let common_x = 0.4 * 0.02 + 0.6 * 0.08;
        let feet = reactions(&measured(zeta, pressing, [common_x - 0.04, 0.26 * 0.4 - 0.13]), SIDE_BY_SIDE_M);
        for ((foot, zeta), [x, y]) in feet.iter().zip(zeta).zip(pressing) {
            assert!((foot.without_n - 700.0 * zeta).abs() < 1e-9, "{feet:?}");
            assert!((foot.without_m[0] - (x - 0.04)).abs() < 1e-12 && (foot.without_m[1] - y).abs() < 1e-12);
        }
    }

    #[test]
    fn with_one_plate_each_force_acts_next_to_its_own_ankle() {
        let feet = FootLoads::Geometry { press_m: NO_PRESS, stands: [true; 2] };
        let [left, right] = reactions(&loading(feet, [0.06, 0.065], [0.05, 0.0]), ANKLE_M);
        assert!((left.with_n / 800.0 - 0.75).abs() < 0.01, "{left:?}");
        assert!((left.with_m[1] - 0.13).abs() < 0.005 && (right.with_m[1] + 0.13).abs() < 0.005);
        assert!((left.with_m[0] - 0.06).abs() < 0.01 && (right.with_m[0] - 0.06).abs() < 0.015);
    }

    #[test]
    fn a_foot_in_the_air_carries_nothing() {
        let feet = FootLoads::Geometry { press_m: NO_PRESS, stands: [true, false] };
        let [left, right] = reactions(&loading(feet, [0.06, 0.10], [0.05, 0.09]), ANKLE_M);
        assert_eq!((left.with_n, left.with_m, left.without_n), (800.0, [0.06, 0.10], 700.0));
        assert_eq!((right.with_n, right.without_n), (0.0, 0.0));
    }

    #[test]
    fn measured_centres_are_moved_to_the_common_one_and_wrong_ones_are_not_used() {
        let feet = crate::message::ground::Feet {
            vertical_n: [200.0, 600.0],
            cop_m: Some([[0.02, 0.12], [0.06, -0.12]]),
        };
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        let FootLoads::Measured { zeta, cop_m } = FootLoads::measured(&feet, [0.055, -0.06]) else {
            panic!()
        };
        assert_eq!(zeta, [0.25, 0.75]);
        near(cop_m[0][0], 0.025);
        let wrong = FootLoads::measured(&feet, [0.15, -0.06]);
        assert_eq!(wrong, FootLoads::Fractions { zeta: [0.25, 0.75], press_m: NO_PRESS });
    }
}
