//! What is measured while a worker holds a part, and what is true meanwhile.

use equipoise_core::message::State;
use equipoise_core::overload::TorqueLimits;
use equipoise_simulator::motion::BodyState;
use equipoise_simulator::person::Person;
use nalgebra::Vector3;

use crate::handover::true_worst_share;
use crate::tally::Sums;
use crate::tasks::publishes_torques;

/// Worst joint's share of its limit in a hold: as published, its 1-σ, and true.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Held {
    /// Mean of the published torque over the published limit, of static poses with valid torques.
    pub measured: f64,
    /// Mean of the published 1-σ over the limit.
    pub sigma: f64,
    /// Mean of the true static overload over the limit.
    pub truth: f64,
}

/// Sums of a hold in progress.
#[derive(Debug, Clone, Copy, Default)]
pub struct HeldSums {
    measured: Sums,
    sigma: Sums,
    truth: Sums,
}

impl HeldSums {
    /// Adds a published state if its pose is static and its torques are valid.
    pub fn add(&mut self, state: &State) {
        let worst = state.worst_joint as usize;
        let Some(limit_nm) = state.torque_limit_nm.get(worst) else { return };
        if state.static_pose == 1 && publishes_torques(state) {
            self.measured.add(Vector3::from(state.torque_nm[worst]).norm() / limit_nm);
            self.sigma.add(state.torque_sigma_nm[worst] / limit_nm);
        }
    }

    /// Adds a true state of the body.
    pub fn add_truth(&mut self, limits: &TorqueLimits, person: &Person, body: &BodyState) {
        self.truth.add(true_worst_share(limits, person, body));
    }

    /// The means; `None` without a usable state, as when the worker did not reach the part.
    pub fn mean(&self) -> Option<Held> {
        Some(Held { measured: self.measured.mean()?, sigma: self.sigma.mean()?, truth: self.truth.mean()? })
    }
}
