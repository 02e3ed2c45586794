//! What the ground does to each foot, with the load and as it would be without it.
//!
//! With one plate only the common centre of pressure is known. Both feet's forces are then taken to act there. Eq. 15
//! gives both the same shares ζ before and after; [`Sharing::zeta_without_load`] may hold others, for a load to one side
//! moves weight from foot to foot.
//!
//! Where each foot is measured by itself, its force acts at its own centre of pressure: a common one, between the
//! feet, would give every joint of a leg a moment about the walking direction that is not there. What each foot would
//! bear *without* the load cannot be measured, but the sums are known: weight W, acting at Ĉ_wo. Of the displacement
//! from C_wt back to Ĉ_wo the part along the line between the two centres is a shift of weight from foot to foot, for
//! soles are narrow and legs are what shifts weight sideways; what is left (across that line, or once a foot is
//! empty) moves both feet's centres alike, as ankles do it. So Σ f_k = W and Σ f_k c_k = W Ĉ_wo hold by construction,
//! and with both centres in one place the rule is Eq. 15 again.

use super::Loading;
use super::sharing::TOO_CLOSE_M;

/// The ground's vertical force on one foot.
#[derive(Debug, Clone, Copy)]
pub(super) struct FootReaction {
    /// ζ_k: share of the ground reaction with the load.
    pub(super) share: f64,
    /// Where it acts with the load, m.
    pub(super) with_m: [f64; 2],
    /// Force without the load, N, and where it acts, m.
    pub(super) without_n: f64,
    pub(super) without_m: [f64; 2],
    /// How both follow the estimated centre of pressure: N/m by its axis, and m/m by own axis and its axis.
    without_n_slope: [f64; 2],
    without_m_slope: [[f64; 2]; 2],
}

impl FootReaction {
    /// Moment arm times force that the load adds, about a joint at `origin`, along one axis, N m.
    pub(super) fn added(&self, axis: usize, origin: f64, vertical_n: f64) -> f64 {
        self.share * vertical_n * (self.with_m[axis] - origin)
            - self.without_n * (self.without_m[axis] - origin)
    }

    /// Change of [`Self::added`] with the estimated centre of pressure along `by`, N.
    pub(super) fn by_estimate(&self, axis: usize, origin: f64, by: usize) -> f64 {
        -(self.without_n_slope[by] * (self.without_m[axis] - origin)
            + self.without_n * self.without_m_slope[axis][by])
    }

    /// Change of [`Self::added`] with this foot's share, N m.
    pub(super) fn by_share(&self, axis: usize, origin: f64, loading: &Loading) -> f64 {
        loading.vertical_n * (self.with_m[axis] - origin)
            - loading.weight_n() * (self.without_m[axis] - origin)
    }
}

/// Left and right foot.
pub(super) fn reactions(loading: &Loading) -> [FootReaction; 2] {
    let zeta = loading.sharing.zeta;
    match loading.sharing.foot_cop_m {
        None => core::array::from_fn(|foot| FootReaction {
            share: zeta[foot],
            with_m: loading.cop_measured_m,
            without_n: loading.sharing.zeta_without_load[foot] * loading.weight_n(),
            without_m: loading.cop_estimated_m,
            without_n_slope: loading.sharing.zeta_slope_per_m[foot].map(|slope| slope * loading.weight_n()),
            without_m_slope: IDENTITY,
        }),
        Some(foot_cop_m) => measured(loading, foot_cop_m),
    }
}

const IDENTITY: [[f64; 2]; 2] = [[1.0, 0.0], [0.0, 1.0]];

fn measured(loading: &Loading, foot_cop_m: [[f64; 2]; 2]) -> [FootReaction; 2] {
    let Loading { cop_measured_m, cop_estimated_m, sharing, .. } = loading;
    let weight_n = loading.weight_n();
    let [left, right] = foot_cop_m;
    let along = [right[0] - left[0], right[1] - left[1]];
    let square = along[0] * along[0] + along[1] * along[1];
    // Share of the right foot by metre of displacement, by axis.
    let share_slope = if square > TOO_CLOSE_M * TOO_CLOSE_M { along.map(|a| a / square) } else { [0.0; 2] };
    let moved: f64 =
        (0..2).map(|axis| share_slope[axis] * (cop_estimated_m[axis] - cop_measured_m[axis])).sum();
    let wanted = sharing.zeta[1] + moved;
    let right_share = wanted.clamp(0.0, 1.0);
    let share_slope = if right_share == wanted { share_slope } else { [0.0; 2] };
    let without_share = [1.0 - right_share, right_share];
    let rest = [0, 1]
        .map(|axis| cop_estimated_m[axis] - without_share[0] * left[axis] - without_share[1] * right[axis]);
    core::array::from_fn(|foot| FootReaction {
        share: sharing.zeta[foot],
        with_m: foot_cop_m[foot],
        without_n: without_share[foot] * weight_n,
        without_m: [0, 1].map(|axis| foot_cop_m[foot][axis] + rest[axis]),
        without_n_slope: share_slope
            .map(|slope| if foot == 1 { slope * weight_n } else { -slope * weight_n }),
        without_m_slope: [0, 1]
            .map(|axis| [0, 1].map(|by| IDENTITY[axis][by] - along[axis] * share_slope[by])),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::overload::{Sharing, Swing};
    use nalgebra::Vector3;

    fn loading(foot_cop_m: Option<[[f64; 2]; 2]>, right_share: f64, estimated_m: [f64; 2]) -> Loading {
        let zeta = [1.0 - right_share, right_share];
        let [left, right] = foot_cop_m.unwrap_or([[0.05, 0.0]; 2]);
        Loading {
            cop_measured_m: [0, 1].map(|axis| zeta[0] * left[axis] + zeta[1] * right[axis]),
            cop_estimated_m: estimated_m,
            vertical_n: 800.0,
            delta_f_n: 100.0,
            grip_m: [Vector3::zeros(); 2],
            sharing: Sharing { foot_cop_m, ..Sharing::of(zeta, [0.5; 2]) },
            swing: Swing::NONE,
        }
    }

    const APART: [[f64; 2]; 2] = [[0.02, 0.14], [0.09, -0.12]];

    #[test]
    fn the_sums_agree_with_and_without_the_load() {
        for right_share in [0.0, 0.02, 0.3, 0.5, 0.9, 1.0] {
            for estimated_m in [[0.05, 0.0], [0.01, 0.1], [-0.03, -0.3], [0.05, 0.2]] {
                for feet in [Some(APART), Some([[0.03, 0.01], [0.03, -0.01]]), None] {
                    let loading = loading(feet, right_share, estimated_m);
                    let feet = reactions(&loading);
                    let without_n: f64 = feet.iter().map(|foot| foot.without_n).sum();
                    assert!((without_n - loading.weight_n()).abs() < 1e-9);
                    assert!(feet.iter().all(|foot| foot.without_n >= 0.0));
                    for (axis, estimated_m) in estimated_m.into_iter().enumerate() {
                        let with: f64 = feet.iter().map(|foot| foot.share * foot.with_m[axis]).sum();
                        assert!((with - loading.cop_measured_m[axis]).abs() < 1e-12);
                        let moment: f64 = feet.iter().map(|foot| foot.without_n * foot.without_m[axis]).sum();
                        assert!((moment - loading.weight_n() * estimated_m).abs() < 1e-9);
                    }
                }
            }
        }
    }

    #[test]
    fn weight_that_shifts_sideways_changes_shares_and_leaves_the_soles() {
        let side_by_side = [[0.04, 0.13], [0.04, -0.13]];
        // With the load 0.6 on the right; without it even, and 2 cm farther back.
        let feet = reactions(&loading(Some(side_by_side), 0.6, [0.02, 0.0]));
        for (foot, y) in feet.iter().zip([0.13, -0.13]) {
            assert!((foot.without_n - 350.0).abs() < 1e-9);
            assert!((foot.without_m[0] - 0.02).abs() < 1e-12 && (foot.without_m[1] - y).abs() < 1e-12);
        }
    }

    #[test]
    fn slopes_are_the_differences() {
        const STEP: f64 = 1e-6;
        for (feet, right_share) in [(Some(APART), 0.4), (Some(APART), 0.98), (None, 0.4)] {
            let base = loading(feet, right_share, [0.03, -0.01]);
            for by in 0..2 {
                let mut moved = base;
                moved.cop_estimated_m[by] += STEP;
                for (before, after) in reactions(&base).iter().zip(reactions(&moved)) {
                    for axis in 0..2 {
                        let change = after.added(axis, 0.07, 800.0) - before.added(axis, 0.07, 800.0);
                        let told = before.by_estimate(axis, 0.07, by) * STEP;
                        assert!((change - told).abs() < 1e-6 * STEP.sqrt(), "{change} {told}");
                    }
                }
            }
        }
    }
}
