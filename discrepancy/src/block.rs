//! A block: means of predictions and measurements over a fraction of a second of a session.

use equipoise_core::body::{SEGMENTS, Segment, Side};
use equipoise_core::effect::Observation;
use nalgebra::{UnitQuaternion, Vector3};

pub use crate::constants::{CUTOFFS_HZ, LAGS_S};

/// A change or a rate: of the centre of pressure, m (m/s), and of the force, N (N/s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Of the centre of pressure, m.
    pub cop_m: [f64; 2],
    /// Of the force, N.
    pub force_n: [f64; 3],
}

impl Change {
    /// No change.
    pub const NONE: Change = Change { cop_m: [0.0; 2], force_n: [0.0; 3] };

    /// Adds another one, scaled.
    pub(crate) fn add(&mut self, scale: f64, other: &Change) {
        self.cop_m.iter_mut().zip(other.cop_m).for_each(|(sum, other_m)| *sum += scale * other_m);
        self.force_n.iter_mut().zip(other.force_n).for_each(|(sum, other_n)| *sum += scale * other_n);
    }
}

/// Phase of the recording to which a block belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// Poses from which the worker was identified.
    Identify,
    /// Work declared clean.
    Reference,
    /// Work in question.
    Work,
}

/// Means over a block of suit samples. Differentiated quantities and ground signals pass through the same smoothing, so
/// that filtering does not appear as an effect.
#[derive(Debug, Clone)]
pub struct Block {
    /// Its phase.
    pub phase: Phase,
    /// Number of the stance: the feet have not moved within one.
    pub stance: u64,
    /// Whether the whole block is a static pose.
    pub still: bool,
    /// Means of the inputs of all effects; `time_s` is the mean time of its suit samples, s since the start of the
    /// recording.
    pub observation: Observation,
    /// Velocity of the centre of mass, m/s.
    pub com_velocity_m_per_s: [f64; 3],
    /// Shift of the centre of pressure by the rotation of trunk, right arm, left arm, legs (sum: `turning_m`), m.
    pub turning_by_group_m: [[f64; 2]; 4],
    /// Rotation vector of each segment relative to its parent (pelvis: relative to the feet's heading), rad.
    pub joint_rad: [[f64; 3]; SEGMENTS],
    /// Second derivative of each component of `joint_rad` times the segment's rotation matrix, rad/s².
    pub joint_weighted_rotation_acceleration: [[[[f64; 3]; 3]; 3]; SEGMENTS],
    /// Heading of the standing feet, rad.
    pub heading_rad: f64,
    /// Change by each of [`LAGS_S`].
    pub by_lag: [Change; LAGS_S.len()],
    /// Change by each of [`CUTOFFS_HZ`].
    pub by_cutoff: [Change; CUTOFFS_HZ.len()],
}

/// Rotation vector of each segment relative to its parent; of the pelvis relative to the feet's heading.
pub(crate) fn joint_rad(
    rotation: &[UnitQuaternion<f64>; SEGMENTS],
    heading_rad: f64,
) -> [[f64; 3]; SEGMENTS] {
    let turned = |segment: Segment| rotation[segment.index()];
    let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad);
    Segment::ALL.map(|segment| {
        let parent = segment.parent().map_or(heading, turned);
        (parent.inverse() * turned(segment)).scaled_axis().into()
    })
}

/// Common heading of the feet, rad from forward, left positive.
pub(crate) fn heading_rad(rotation: &[UnitQuaternion<f64>; SEGMENTS]) -> f64 {
    let forward = |side: &Side| rotation[side.foot().index()] * Vector3::x();
    let sum: Vector3<f64> = Side::BOTH.iter().map(forward).sum();
    sum.y.atan2(sum.x)
}
