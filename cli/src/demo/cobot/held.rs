//! Published and true limit ratios while the worker holds a part.

use equipoise_core::body::Joint;
use equipoise_core::frame::{Pose, StationWorld};
use equipoise_core::handover::experience::LimitRatio;
use equipoise_core::handover::measure::HoldMean;
use equipoise_core::message::State;
use equipoise_core::overload::TorqueLimits;
use equipoise_simulator::truth::Truth;
use equipoise_simulator::truth::hold::TrueHold;

/// Limit ratio of the worst joint in a hold: its overload over its limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct HoldResult {
    /// The joint with the largest published ratio.
    pub(super) joint: Joint,
    /// The worst joint's ratio as published.
    pub(super) ratio: LimitRatio,
    /// The largest true ratio of a joint.
    pub(super) truth: f64,
}

/// Sums of a hold in progress.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct HoldSums {
    published: HoldMean,
    truth: TrueHold,
}

impl HoldSums {
    /// Adds a state, and the truth of the same instant, if the pose is static and the torques are valid.
    pub(super) fn add(&mut self, state: &State, limits: &TorqueLimits, truth: impl FnOnce() -> Truth) {
        if self.published.add(state) {
            let truth = truth();
            let pose: Pose<StationWorld> = Pose::new(truth.body.origin_m, truth.body.world_from_segment);
            let limit_nm = limits.along_nm(&pose, &truth.overload_nm.map(Into::into));
            self.truth.add(&truth.overload_nm, &limit_nm);
        }
    }

    /// The means; `None` without a usable state.
    pub(super) fn mean(&self) -> Option<HoldResult> {
        let worst = self.published.worst()?;
        Some(HoldResult { joint: worst.joint, ratio: worst.ratio, truth: self.truth.worst() })
    }
}
