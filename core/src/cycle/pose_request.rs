//! Stage `compare_with_suggestion`: distance from the suggested pose.
//!
//! Also the poses that a model file requests because they discriminate between explanations of the data: suggested after
//! identification, one after the other, each until it was held.

use bytemuck::{Pod, Zeroable};

use super::differentiate::Instant;
use super::identification::Identification;
use super::settings::{POSE_REQUESTS_MAX, PoseRequest, Settings};
use super::stillness::Stillness;
use super::{NO_POSE, POSE_REACHED_RAD};
use crate::body::{JOINTS, Segment};
use crate::frame::{Pose, StationWorld, wxyz};
use crate::math;
use crate::static_pose::rms_joint_angle;

/// Tolerance of a requested turn of the body, rad.
const TURNED_WITHIN_RAD: f64 = core::f64::consts::FRAC_PI_6;

/// State of the requested poses.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct PoseRequestState {
    /// Number of poses that were held, or skipped by command.
    done: u64,
    /// 1 once the first was requested.
    begun: u64,
    /// Heading of the subject at that time, rad to the left of world X.
    heading_rad: f64,
    /// Hash of the requests that `done` counts.
    requests: u64,
}

impl PoseRequestState {
    /// Resets the reference heading, for example for another subject; other requests begin with the first one.
    pub(super) fn restart(&mut self, settings: &Settings) {
        self.begun = 0;
        let requests = hash(&settings.pose_requests);
        if self.requests != requests {
            (self.requests, self.done) = (requests, 0);
        }
    }

    /// The pose that the model file requests now: none during identification.
    fn requested(&self, settings: &Settings, subject: &Identification) -> Option<PoseRequest> {
        let is_identified = subject.identified == 1 && subject.identifying == 0;
        let next = settings.pose_requests.get(self.done as usize).copied().flatten();
        next.filter(|request| is_identified && request.pose < settings.library.len())
    }

    /// Index of the suggested pose: that of the identification, else that of the model file; [`NO_POSE`] for none.
    pub(super) fn suggested(&self, settings: &Settings, subject: &Identification) -> u64 {
        match self.requested(settings, subject) {
            Some(request) => request.pose as u64,
            None => subject.suggested,
        }
    }

    /// Skips the pose that the model file requests; `false` if none is requested.
    pub(super) fn skip(&mut self, settings: &Settings, subject: &Identification) -> bool {
        let is_requested = self.requested(settings, subject).is_some();
        self.done += u64::from(is_requested);
        is_requested
    }

    /// Remaining turn, in either direction, relative to the heading at the first request, rad.
    fn remaining_turn_rad(&mut self, pose: &Pose<StationWorld>, request: PoseRequest) -> f64 {
        let (_, _, heading_rad) = pose.world_from_segment[Segment::Pelvis.index()].euler_angles();
        if self.begun == 0 {
            (self.begun, self.heading_rad) = (1, heading_rad);
        }
        let off_rad = heading_rad - self.heading_rad - request.turn_rad;
        let (_, cosine) = math::sin_cos(off_rad);
        math::acos(cosine.clamp(-1.0, 1.0))
    }

    /// Whether flags and number are in range; a stored memory is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        self.done <= POSE_REQUESTS_MAX as u64 && self.begun <= 1 && self.heading_rad.is_finite()
    }
}

/// Hash of poses and turns.
fn hash(requests: &[Option<PoseRequest>]) -> u64 {
    let requests = requests.iter().flatten();
    math::hash(requests.flat_map(|request| [request.pose as u64, request.turn_rad.to_bits()]))
}

/// Distance from the suggested pose, rad; ends the request once the requested pose is held.
pub(super) fn compare_with_suggestion(
    settings: &Settings,
    state: &mut PoseRequestState,
    instant: &Instant,
    stillness: &Stillness,
    subject: &Identification,
) -> f64 {
    let suggested = state.suggested(settings, subject);
    let Some(posture) = settings.library.get(suggested as usize).filter(|_| suggested != NO_POSE) else {
        return 0.0;
    };
    let joints = |rotations: [nalgebra::UnitQuaternion<f64>; JOINTS]| rotations.map(|r| wxyz(&r));
    let mut mismatch_rad =
        rms_joint_angle(&joints(instant.pose.joint_rotations()), &joints(posture.joint_rotations()));
    if let Some(request) = state.requested(settings, subject) {
        let remaining_rad = state.remaining_turn_rad(&instant.pose, request);
        if remaining_rad > TURNED_WITHIN_RAD {
            mismatch_rad = mismatch_rad.max(remaining_rad);
        }
        state.done += u64::from(stillness.is_static && mismatch_rad < POSE_REACHED_RAD);
    }
    mismatch_rad
}
