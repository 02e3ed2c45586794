//! The published limit ratio of a hold: the mean over its states.

use nalgebra::Vector3;

use super::experience::LimitRatio;
use super::worst::{HandFractions, Worst, worst};
use crate::body::JOINTS;
use crate::message::{State, Validity};

/// Sums over the states of a hold.
#[derive(Debug, Clone, Copy, Default)]
pub struct HoldMean {
    states: u32,
    /// By joint, N m. Vectors, because a mean of magnitudes would include the noise perpendicular to the torque.
    torque_nm: [Vector3<f64>; JOINTS],
    limit_nm: [f64; JOINTS],
    sigma_nm: [f64; JOINTS],
    eta: [f64; 2],
    eta_sigma: f64,
}

impl HoldMean {
    /// Adds a state if its pose is static and its torques are valid. Returns whether it was added.
    pub fn add(&mut self, state: &State) -> bool {
        if state.static_pose != 1 || state.validity().any_of(Validity::INVALIDATES_TORQUES) {
            return false;
        }
        self.states += 1;
        for joint in 0..JOINTS {
            self.torque_nm[joint] += Vector3::from(state.torque_nm[joint]);
            self.limit_nm[joint] += state.torque_limit_nm[joint];
            self.sigma_nm[joint] += state.torque_sigma_nm[joint];
        }
        self.eta[0] += state.hand_load_fraction[0];
        self.eta[1] += state.hand_load_fraction[1];
        self.eta_sigma += state.hand_load_fraction_sigma;
        true
    }

    /// Mean torque over mean limit of each joint; its 1-σ is the mean 1-σ, because the errors of the states of one hold
    /// are treated as equal.
    /// NaN for a joint without a limit.
    pub fn limit_ratios(&self) -> [LimitRatio; JOINTS] {
        core::array::from_fn(|joint| LimitRatio {
            value: self.torque_nm[joint].norm() / self.limit_nm[joint],
            sigma: self.sigma_nm[joint] / self.limit_nm[joint],
        })
    }

    /// The worst joint; `None` without a usable state.
    pub fn worst(&self) -> Option<Worst> {
        if self.states == 0 {
            return None;
        }
        let states = f64::from(self.states);
        let hands = HandFractions { eta: self.eta.map(|eta| eta / states), sigma: self.eta_sigma / states };
        worst(&self.limit_ratios(), &hands)
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;
    use crate::body::Joint;

    #[test]
    fn the_worst_joint_is_that_of_the_mean_torques_of_valid_static_states() {
        let mut mean = HoldMean::default();
        let mut held = |static_pose: u32, noise_nm: f64, valid: Validity| {
            let mut state = State { static_pose, valid: valid.0, ..State::zeroed() };
            (state.torque_nm[2], state.torque_limit_nm[2]) = ([0.0, 30.0, noise_nm], 100.0);
            (state.torque_sigma_nm[2], state.torque_sigma_nm[5]) = (8.0, 1.0);
            // Noise alone exceeds the other joint's ratio.
            (state.torque_nm[5], state.torque_limit_nm[5]) = ([noise_nm, 0.0, 1.0], 50.0);
            mean.add(&state)
        };
        assert!(held(1, 40.0, Validity(0)) && held(1, -40.0, Validity(0)));
        assert!(!held(0, 400.0, Validity(0)) && !held(1, 400.0, Validity::SUIT_STALE));
        let expected = Worst { joint: Joint::ALL[2], ratio: LimitRatio { value: 0.3, sigma: 0.08 } };
        assert_eq!(mean.worst(), Some(expected));
        assert_eq!(HoldMean::default().worst(), None);
    }
}
