//! Pose that a model file requests because it discriminates between two explanations of the data: suggested after
//! identification, until it was held.

use bytemuck::{Pod, Zeroable};

use super::memory::Memory;
use super::settings::{PoseRequest, Settings};
use super::{NO_POSE, POSE_REACHED_RAD};
use crate::body::{JOINTS, Segment};
use crate::frame::{Pose, StationWorld, wxyz};
use crate::math;
use crate::static_pose::rms_joint_angle;

/// Tolerance of a requested turn of the body, rad.
const TURNED_WITHIN_RAD: f64 = core::f64::consts::FRAC_PI_6;

/// State of the requested pose.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct PoseRequestState {
    /// 1 once it was held, or skipped by command.
    done: u64,
    /// 1 once it was first requested.
    begun: u64,
    /// Heading of the subject at that time, rad to the left of world X.
    heading_rad: f64,
}

impl PoseRequestState {
    /// Resets the reference heading, for example for another subject.
    pub(super) fn restart(&mut self) {
        self.begun = 0;
    }

    /// Whether flags and number are in range; a stored memory is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        self.done <= 1 && self.begun <= 1 && self.heading_rad.is_finite()
    }
}

impl Memory {
    /// The pose that the model file requests now: none during identification, and none twice.
    fn requested_pose(&self, settings: &Settings) -> Option<PoseRequest> {
        let is_identified = self.identification.identified == 1 && self.identification.identifying == 0;
        settings.pose_request.filter(|request| {
            is_identified && self.pose_request.done == 0 && request.pose < settings.library.len()
        })
    }

    /// Index of the suggested pose: that of the identification, else that of the model file; [`NO_POSE`] for none.
    pub(super) fn suggested(&self, settings: &Settings) -> u64 {
        match self.requested_pose(settings) {
            Some(request) => request.pose as u64,
            None => self.identification.suggested,
        }
    }

    /// Skips the pose that the model file requests; `false` if none is requested.
    pub(super) fn skip_requested_pose(&mut self, settings: &Settings) -> bool {
        let is_requested = self.requested_pose(settings).is_some();
        self.pose_request.done |= u64::from(is_requested);
        is_requested
    }

    /// Publishes the distance from the suggested pose, and checks whether the requested pose is held.
    pub(super) fn compare_with_suggestion(
        &mut self,
        pose: &Pose<StationWorld>,
        is_static: bool,
        settings: &Settings,
    ) {
        self.estimate.pose_mismatch_rad = 0.0;
        let suggested = self.suggested(settings);
        let Some(posture) = settings.library.get(suggested as usize).filter(|_| suggested != NO_POSE) else {
            return;
        };
        let joints = |rotations: [nalgebra::UnitQuaternion<f64>; JOINTS]| rotations.map(|r| wxyz(&r));
        let mut mismatch_rad =
            rms_joint_angle(&joints(pose.joint_rotations()), &joints(posture.joint_rotations()));
        if let Some(request) = self.requested_pose(settings) {
            let remaining_rad = self.remaining_turn_rad(pose, request);
            if remaining_rad > TURNED_WITHIN_RAD {
                mismatch_rad = mismatch_rad.max(remaining_rad);
            }
            self.pose_request.done = u64::from(is_static && mismatch_rad < POSE_REACHED_RAD);
        }
        self.estimate.pose_mismatch_rad = mismatch_rad;
    }

    /// Remaining turn, in either direction, relative to the heading at the first request, rad.
    fn remaining_turn_rad(&mut self, pose: &Pose<StationWorld>, request: PoseRequest) -> f64 {
        let (_, _, heading_rad) = pose.world_from_segment[Segment::Pelvis.index()].euler_angles();
        if self.pose_request.begun == 0 {
            (self.pose_request.begun, self.pose_request.heading_rad) = (1, heading_rad);
        }
        let off_rad = heading_rad - self.pose_request.heading_rad - request.turn_rad;
        let (_, cosine) = math::sin_cos(off_rad);
        math::acos(cosine.clamp(-1.0, 1.0))
    }
}
