//! What is measured while a worker holds a part, and what is true meanwhile.

use equipoise_core::body::JOINTS;
use equipoise_core::handover::experience::LimitRatio;
use equipoise_core::message::State;
use equipoise_core::overload::TorqueLimits;
use equipoise_simulator::motion::BodyState;
use equipoise_simulator::person::Person;
use nalgebra::Vector3;

use crate::handover::true_worst_limit_ratio;
use crate::tally::Sums;
use crate::tasks::publishes_torques;

/// Limit ratio of the worst joint in a hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Held {
    /// As published in static poses with valid torques: the joint with the largest ratio of mean torque to mean limit, and
    /// its mean 1-σ, as if the errors of all states were the same.
    pub measured: LimitRatio,
    /// Mean of the true static overload over the limit.
    pub truth: f64,
}

/// Sums of a hold in progress.
#[derive(Debug, Clone, Copy, Default)]
pub struct HeldSums {
    states: u32,
    /// By joint: torque, N m; its limit, N m; its 1-σ, N m. The mean of a length would contain the noise across it.
    torque_nm: [Vector3<f64>; JOINTS],
    limit_nm: [f64; JOINTS],
    sigma_nm: [f64; JOINTS],
    truth: Sums,
}

impl HeldSums {
    /// Adds a published state if its pose is static and its torques are valid.
    pub fn add(&mut self, state: &State) {
        if state.static_pose != 1 || !publishes_torques(state) {
            return;
        }
        self.states += 1;
        for joint in 0..JOINTS {
            self.torque_nm[joint] += Vector3::from(state.torque_nm[joint]);
            self.limit_nm[joint] += state.torque_limit_nm[joint];
            self.sigma_nm[joint] += state.torque_sigma_nm[joint];
        }
    }

    /// Adds a true state of the body.
    pub fn add_truth(&mut self, limits: &TorqueLimits, person: &Person, body: &BodyState) {
        self.truth.add(true_worst_limit_ratio(limits, person, body));
    }

    /// The means; `None` without a usable state, as when the worker did not reach the part.
    pub fn mean(&self) -> Option<Held> {
        if self.states == 0 {
            return None;
        }
        let ratio = |joint: usize| LimitRatio {
            value: self.torque_nm[joint].norm() / self.limit_nm[joint],
            sigma: self.sigma_nm[joint] / self.limit_nm[joint],
        };
        let measured = (0..JOINTS)
            .map(ratio)
            .filter(|ratio| ratio.value.is_finite())
            .max_by(|a, b| a.value.total_cmp(&b.value))?;
        Some(Held { measured, truth: self.truth.mean()? })
    }
}
