//! What is published while the worker holds a part, and what is true meanwhile.

use equipoise_core::body::{JOINTS, Joint};
use equipoise_core::handover::experience::LimitRatio;
use equipoise_core::message::{State, Validity};
use nalgebra::Vector3;

/// Limit ratio of the worst joint in a hold: its overload over its limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Held {
    /// The joint with the largest published ratio of mean torque to mean limit.
    pub(super) joint: Joint,
    /// That ratio, and its mean 1-σ, as if the errors of all states were the same.
    pub(super) ratio: LimitRatio,
    /// Largest ratio of the mean true static overload of a joint to its mean published limit.
    pub(super) truth: f64,
}

/// Sums of a hold in progress.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct HeldSums {
    /// By joint, N m: torque, its 1-σ, its limit, true torque. The mean of a length would contain the noise across it.
    joints: [(Vector3<f64>, f64, f64, f64); JOINTS],
}

impl HeldSums {
    /// Adds a state, and the true static overload of the same instant (N m), if the pose is static and the torques are
    /// valid.
    pub(super) fn add(&mut self, state: &State, true_nm: impl FnOnce() -> [Vector3<f64>; JOINTS]) {
        if state.static_pose != 1 || state.validity().any_of(Validity::INVALIDATES_TORQUES) {
            return;
        }
        let true_nm = true_nm();
        for (joint, (torque_nm, sigma_nm, limit_nm, sum_nm)) in self.joints.iter_mut().enumerate() {
            *torque_nm += Vector3::from(state.torque_nm[joint]);
            *sigma_nm += state.torque_sigma_nm[joint];
            *limit_nm += state.torque_limit_nm[joint];
            *sum_nm += true_nm[joint].norm();
        }
    }

    /// The means; `None` without a usable state.
    pub(super) fn mean(&self) -> Option<Held> {
        let ratios =
            Joint::ALL.into_iter().zip(&self.joints).filter(|(_, (_, _, limit_nm, _))| *limit_nm > 0.0);
        let published = ratios.clone().map(|(joint, (torque_nm, sigma_nm, limit_nm, _))| {
            (joint, LimitRatio { value: torque_nm.norm() / limit_nm, sigma: sigma_nm / limit_nm })
        });
        let (joint, ratio) = published.max_by(|(_, a), (_, b)| a.value.total_cmp(&b.value))?;
        let truth = ratios.map(|(_, (_, _, limit_nm, true_nm))| true_nm / limit_nm).fold(0.0, f64::max);
        Some(Held { joint, ratio, truth })
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    #[test]
    fn the_worst_joint_is_that_of_the_mean_torques_of_valid_static_states() {
        let mut sums = HeldSums::default();
        let mut held = |static_pose: u32, noise_nm: f64, valid: Validity| {
            let mut state = State { static_pose, valid: valid.0, ..State::zeroed() };
            (state.torque_nm[2], state.torque_limit_nm[2]) = ([0.0, 30.0, noise_nm], 100.0);
            (state.torque_sigma_nm[2], state.torque_sigma_nm[5]) = (8.0, 1.0);
            // Noise alone exceeds the other joint's ratio.
            (state.torque_nm[5], state.torque_limit_nm[5]) = ([noise_nm, 0.0, 1.0], 50.0);
            sums.add(&state, || [Vector3::new(0.0, 0.0, 20.0); JOINTS]);
        };
        held(1, 40.0, Validity(0));
        held(1, -40.0, Validity(0));
        held(0, 400.0, Validity(0));
        held(1, 400.0, Validity::SUIT_STALE);
        let mean = sums.mean().unwrap();
        assert_eq!((mean.joint, mean.ratio), (Joint::ALL[2], LimitRatio { value: 0.3, sigma: 0.08 }));
        assert_eq!(mean.truth, 0.4);
        assert_eq!(HeldSums::default().mean(), None);
    }
}
