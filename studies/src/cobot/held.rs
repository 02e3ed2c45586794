//! Published and true limit ratios while a worker holds a part.

use equipoise_core::body::{JOINTS, Joint};
use equipoise_core::handover::experience::LimitRatio;
use equipoise_core::handover::measure::HoldMean;
use equipoise_core::message::State;
use equipoise_core::overload::TorqueLimits;
use equipoise_simulator::motion::BodyState;
use equipoise_simulator::person::Person;
use equipoise_simulator::truth::hold::TrueHold;

use crate::handover::true_overload;

/// Limit ratios of one hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HoldResult {
    /// The joint with the largest published ratio.
    pub joint: Joint,
    /// The worst joint's ratio as published.
    pub measured: LimitRatio,
    /// The largest true ratio of a joint.
    pub truth: f64,
    /// Published and true ratio of each joint.
    pub joints: [(LimitRatio, f64); JOINTS],
}

/// Sums of a hold in progress.
#[derive(Debug, Clone, Copy, Default)]
pub struct HoldSums {
    published: HoldMean,
    truth: TrueHold,
}

impl HoldSums {
    /// Adds a published state and the body at its instant; only static poses with valid torques count.
    pub fn add(&mut self, state: &State, limits: &TorqueLimits, person: &Person, body: &BodyState) {
        if self.published.add(state) {
            let (torque_nm, limit_nm) = true_overload(limits, person, body);
            self.truth.add(&torque_nm, &limit_nm);
        }
    }

    /// The means; `None` without a usable state, as when the worker did not reach the part.
    pub fn mean(&self) -> Option<HoldResult> {
        let worst = self.published.worst()?;
        let (published, truth) = (self.published.limit_ratios(), self.truth.limit_ratios());
        Some(HoldResult {
            joint: worst.joint,
            measured: worst.ratio,
            truth: self.truth.worst(),
            joints: std::array::from_fn(|joint| (published[joint], truth[joint])),
        })
    }
}
