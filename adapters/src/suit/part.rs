//! The contribution of one datagram to a sample, validated before any change of state.

use super::refusal::SuitRefusal;
use super::settings::{TypeSet, UpAxis};
use crate::wire::mvn::{AngularKinematics, CentreOfMass, JointAngle, LinearKinematics, SegmentPose};
use equipoise_core::body::{JOINTS, SEGMENTS, Segment};
use equipoise_core::message::SuitSample;
use equipoise_core::message::suit::SuitBlocks;

/// Rounding to f32 and streaming keep the norm within 1e-6 of 1; a larger deviation is data corruption.
const NORM_TOLERANCE: f64 = 0.05;
/// Minimum height of head or pelvis above the feet: also satisfied by a person squatting, stooping or kneeling upright.
const MIN_STATURE_M: f64 = 0.3;

/// Upper bound of any coordinate (m), velocity, acceleration or angle of a person, in its unit.
const LARGEST: f32 = 1e4;
/// Minimum ratio of the squared distances to the pose that decides between the two worlds.
const APART: f64 = 9.0;
/// Upper bound of the distance of a segment's origin from the pelvis.
const REACH_M: f64 = 3.0;

/// Positions (m) and orientations (scalar first, unit norm) of all segments.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pose {
    position_m: [[f64; 3]; SEGMENTS],
    orientation_wxyz: [[f64; 4]; SEGMENTS],
}

/// A validated datagram.
#[derive(Debug, Clone, Copy)]
pub(super) enum Part {
    /// From a datagram of type `kind`.
    Pose {
        pose: Pose,
        kind: TypeSet,
    },
    Linear {
        velocity_m_per_s: [[f64; 3]; SEGMENTS],
        acceleration_m_per_s2: [[f64; 3]; SEGMENTS],
    },
    Angular {
        velocity_rad_per_s: [[f64; 3]; SEGMENTS],
    },
    Joints {
        angle_deg: [[f64; 3]; JOINTS],
    },
    Com {
        position_m: [f64; 3],
    },
}

impl Part {
    pub(super) fn pose(
        items: impl Iterator<Item = SegmentPose>,
        kind: TypeSet,
        check_up: bool,
    ) -> Result<Part, SuitRefusal> {
        let mut pose = Pose { position_m: [[0.0; 3]; SEGMENTS], orientation_wxyz: [[0.0; 4]; SEGMENTS] };
        by_segment(
            items,
            |item| item.segment_id,
            |index, item| {
                pose.position_m[index] = finite(item.position_m)?;
                pose.orientation_wxyz[index] = unit(finite(item.orientation_wxyz)?)?;
                Ok(())
            },
        )?;
        if !pose.holds_together() {
            return Err(SuitRefusal::Implausible);
        }
        if check_up && !pose.stands() {
            return Err(SuitRefusal::UpsideDown);
        }
        Ok(Part::Pose { pose, kind })
    }

    /// From a world whose axis `up` points up.
    pub(super) fn linear(
        items: impl Iterator<Item = LinearKinematics>,
        up: UpAxis,
    ) -> Result<Part, SuitRefusal> {
        match up {
            UpAxis::Z => Self::linear_z_up(items),
            UpAxis::Y => Self::linear_z_up(items.map(|item| item.y_up_to_z_up())),
        }
    }

    fn linear_z_up(items: impl Iterator<Item = LinearKinematics>) -> Result<Part, SuitRefusal> {
        let mut velocity_m_per_s = [[0.0; 3]; SEGMENTS];
        let mut acceleration_m_per_s2 = [[0.0; 3]; SEGMENTS];
        by_segment(
            items,
            |item| item.segment_id,
            |index, item| {
                velocity_m_per_s[index] = finite(item.velocity_m_per_s)?;
                acceleration_m_per_s2[index] = finite(item.acceleration_m_per_s2)?;
                Ok(())
            },
        )?;
        Ok(Part::Linear { velocity_m_per_s, acceleration_m_per_s2 })
    }

    pub(super) fn angular(items: impl Iterator<Item = AngularKinematics>) -> Result<Part, SuitRefusal> {
        let mut velocity_rad_per_s = [[0.0; 3]; SEGMENTS];
        by_segment(
            items,
            |item| item.segment_id,
            |index, item| {
                velocity_rad_per_s[index] = finite(item.angular_velocity_rad_per_s)?;
                Ok(())
            },
        )?;
        Ok(Part::Angular { velocity_rad_per_s })
    }

    /// The 22 joints of the body come first and in order; ergonomic joints may follow.
    pub(super) fn joints(items: impl Iterator<Item = JointAngle>) -> Result<Part, SuitRefusal> {
        let mut angle_deg = [[0.0; 3]; JOINTS];
        let mut count = 0;
        for (index, (angle, item)) in angle_deg.iter_mut().zip(items).enumerate() {
            // Joint j ends at segment j + 1, whose id is j + 2; the local point ids differ between versions.
            if item.child_point >> 8 != index as u32 + 2 {
                return Err(SuitRefusal::UnknownJoint);
            }
            *angle = finite(item.angle_deg)?;
            count += 1;
        }
        if count < JOINTS {
            return Err(SuitRefusal::MissingSegment);
        }
        Ok(Part::Joints { angle_deg })
    }

    pub(super) fn com(com: &CentreOfMass) -> Result<Part, SuitRefusal> {
        Ok(Part::Com { position_m: finite(com.position_m)? })
    }

    /// Writes the part into a sample; cannot fail.
    pub(super) fn apply(&self, sample: &mut SuitSample) {
        match self {
            Part::Pose { pose, .. } => {
                sample.position_m = pose.position_m;
                sample.orientation_wxyz = pose.orientation_wxyz;
            }
            Part::Linear { velocity_m_per_s, acceleration_m_per_s2 } => {
                sample.velocity_m_per_s = *velocity_m_per_s;
                sample.acceleration_m_per_s2 = *acceleration_m_per_s2;
                sample.blocks |= SuitBlocks::LinearKinematics as u32;
            }
            Part::Angular { velocity_rad_per_s } => {
                sample.angular_velocity_rad_per_s = *velocity_rad_per_s;
                sample.blocks |= SuitBlocks::AngularKinematics as u32;
            }
            Part::Joints { angle_deg } => {
                sample.joint_angle_deg = *angle_deg;
                sample.blocks |= SuitBlocks::JointAngles as u32;
            }
            Part::Com { position_m } => {
                sample.com_m = *position_m;
                sample.blocks |= SuitBlocks::CentreOfMass as u32;
            }
        }
    }
}

/// The axis along which a body is upright, from its segments' ids and origins (m); `None` if along neither, or both.
pub(super) fn upright_axis(origins: impl Iterator<Item = (u32, [f32; 3])>) -> Option<UpAxis> {
    let mut heights_m = [[None; 2]; SEGMENTS];
    for (segment_id, [_, y, z]) in origins {
        if let Some(heights) = heights_m.get_mut((segment_id as usize).wrapping_sub(1)) {
            *heights = [Some(f64::from(y)), Some(f64::from(z))];
        }
    }
    let stands = |axis: usize| {
        let height = |segment: Segment| heights_m[segment.index()][axis];
        let feet = height(Segment::LeftFoot)?.min(height(Segment::RightFoot)?);
        Some(height(Segment::Head)?.max(height(Segment::Pelvis)?) - feet > MIN_STATURE_M)
    };
    match (stands(0)?, stands(1)?) {
        (true, false) => Some(UpAxis::Y),
        (false, true) => Some(UpAxis::Z),
        _ => None,
    }
}

/// The world in which these items match the segments of a pose (in Z up, m), in any posture; `None` if they match in
/// neither.
pub(super) fn axis_like_pose(
    items: impl Iterator<Item = LinearKinematics>,
    pose_m: &[[f64; 3]; SEGMENTS],
) -> Option<UpAxis> {
    let (mut z_up_m2, mut y_up_m2) = (0.0, 0.0);
    for item in items {
        let Some(pose_m) = pose_m.get((item.segment_id as usize).wrapping_sub(1)) else { continue };
        let apart_m2 = |position_m: [f32; 3]| -> f64 {
            position_m.iter().zip(pose_m).map(|(a, b)| (f64::from(*a) - b).powi(2)).sum()
        };
        z_up_m2 += apart_m2(item.position_m);
        y_up_m2 += apart_m2(item.y_up_to_z_up().position_m);
    }
    if z_up_m2 * APART < y_up_m2 {
        Some(UpAxis::Z)
    } else if y_up_m2 * APART < z_up_m2 {
        Some(UpAxis::Y)
    } else {
        None
    }
}

impl Pose {
    /// Whether head or pelvis is above the feet, as for any person on their feet, in any posture.
    fn stands(&self) -> bool {
        let height = |segment: Segment| self.position_m[segment.index()][2];
        let feet = height(Segment::LeftFoot).min(height(Segment::RightFoot));
        height(Segment::Head).max(height(Segment::Pelvis)) - feet > MIN_STATURE_M
    }

    /// Whether all segments are within reach of the pelvis.
    fn holds_together(&self) -> bool {
        let pelvis = self.position_m[Segment::Pelvis.index()];
        let distances = self
            .position_m
            .iter()
            .map(|origin| (0..3).map(|axis| (origin[axis] - pelvis[axis]).powi(2)).sum());
        distances.into_iter().all(|square: f64| square <= REACH_M * REACH_M)
    }
}

/// Passes each body segment's item to `take`, and verifies that each occurs exactly once. Skips props and fingers,
/// which follow the body.
fn by_segment<T>(
    items: impl Iterator<Item = T>,
    segment_id: impl Fn(&T) -> u32,
    mut take: impl FnMut(usize, T) -> Result<(), SuitRefusal>,
) -> Result<(), SuitRefusal> {
    let mut seen = [false; SEGMENTS];
    for item in items {
        let index = (segment_id(&item) as usize).wrapping_sub(1);
        let Some(seen) = seen.get_mut(index) else { continue };
        if core::mem::replace(seen, true) {
            return Err(SuitRefusal::DuplicateSegment);
        }
        take(index, item)?;
    }
    if seen.contains(&false) { Err(SuitRefusal::MissingSegment) } else { Ok(()) }
}

fn finite<const N: usize>(values: [f32; N]) -> Result<[f64; N], SuitRefusal> {
    if values.iter().any(|value| !value.is_finite()) {
        Err(SuitRefusal::NotFinite)
    } else if values.iter().any(|value| value.abs() > LARGEST) {
        Err(SuitRefusal::Implausible)
    } else {
        Ok(values.map(f64::from))
    }
}

fn unit(quaternion: [f64; 4]) -> Result<[f64; 4], SuitRefusal> {
    let norm = quaternion.iter().map(|part| part * part).sum::<f64>().sqrt();
    if (norm - 1.0).abs() <= NORM_TOLERANCE {
        Ok(quaternion.map(|part| part / norm))
    } else {
        Err(SuitRefusal::NotUnitQuaternion)
    }
}
