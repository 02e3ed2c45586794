//! The numbers of one frame, converted to the internal order and axes.

use std::io::BufRead;

use equipoise_core::body::{JOINTS, SEGMENTS, Segment};
use equipoise_core::frame::{SuitWorld, wxyz};
use equipoise_core::message::SuitSample;
use equipoise_core::message::suit::SuitBlocks;
use nalgebra::{Quaternion, Unit, UnitQuaternion};

use super::head::{Columns, Head, JOINTS_MAX, SEGMENTS_MAX};
use super::xml::{Fault, Token, Xml};

/// Tolerance of a quaternion's norm, as quaternions are written with six digits.
const NORM_TOLERANCE: f64 = 0.05;
/// Upper bound of any number in a frame, in its unit.
const LARGEST: f64 = 1e4;
/// Maximum distance of a segment from its joint: shoulder blades slide by millimetres; a larger distance means that the
/// segment's orientation is expressed in other axes.
const JOINT_GAP_MAX_M: f64 = 0.1;
/// Maximum count of numbers in an element that is read.
const NUMBERS_MAX: usize = if SEGMENTS_MAX * 4 > JOINTS_MAX * 3 { SEGMENTS_MAX * 4 } else { JOINTS_MAX * 3 };

/// The elements of a frame that are read.
#[derive(Debug, Clone, Copy)]
enum Block {
    Orientation,
    Position,
    Velocity,
    Acceleration,
    AngularVelocity,
    JointAngle,
    CentreOfMass,
}

const BLOCKS: [(&str, Block); 7] = [
    ("orientation", Block::Orientation),
    ("position", Block::Position),
    ("velocity", Block::Velocity),
    ("acceleration", Block::Acceleration),
    ("angularVelocity", Block::AngularVelocity),
    ("jointAngle", Block::JointAngle),
    ("centerOfMass", Block::CentreOfMass),
];

/// A frame as in the file.
#[derive(Debug, Clone, Default)]
pub(super) struct Frame {
    /// Line of its start, from 1.
    pub(super) line: u64,
    /// `normal`, or one of the calibration poses.
    pub(super) kind: String,
    pub(super) index: Option<i64>,
    /// Time since the start, ms.
    pub(super) time_ms: Option<i64>,
    /// Time since 1970, ms.
    pub(super) unix_ms: Option<i64>,
    numbers: [Vec<f64>; BLOCKS.len()],
}

impl Frame {
    /// Reads the next frame; `false` at the end of `<frames>`.
    pub(super) fn read<R: BufRead>(&mut self, xml: &mut Xml<R>, frames_depth: usize) -> Result<bool, Fault> {
        loop {
            let depth = xml.depth();
            let line = xml.line();
            match xml.next()? {
                Token::Start(element) if depth == frames_depth && element.name() == "frame" => {
                    let whole = |name| element.attribute(name).and_then(|text| text.trim().parse().ok());
                    self.line = line;
                    self.kind = element.attribute("type").unwrap_or_else(|| "normal".to_owned());
                    (self.index, self.time_ms, self.unix_ms) = (whole("index"), whole("time"), whole("ms"));
                    return self.read_numbers(xml, frames_depth);
                }
                Token::End if depth <= frames_depth => return Ok(false),
                Token::Eof => return Ok(false),
                _ => {}
            }
        }
    }

    fn read_numbers<R: BufRead>(&mut self, xml: &mut Xml<R>, frames_depth: usize) -> Result<bool, Fault> {
        for numbers in &mut self.numbers {
            numbers.clear();
        }
        let mut block = None;
        loop {
            let depth = xml.depth();
            match xml.next()? {
                Token::Start(element) => {
                    // Only direct children of the frame.
                    block = BLOCKS
                        .iter()
                        .find(|(name, _)| depth == frames_depth + 1 && *name == element.name())
                        .map(|(_, block)| *block);
                }
                Token::Text(text) => {
                    if let Some(block) = block {
                        let numbers = &mut self.numbers[block as usize];
                        let room = (NUMBERS_MAX + 1).saturating_sub(numbers.len());
                        let read = text.split_ascii_whitespace().map(|text| text.parse().unwrap_or(f64::NAN));
                        numbers.extend(read.take(room));
                    }
                }
                Token::Reference => {
                    if let Some(block) = block {
                        self.numbers[block as usize].push(f64::NAN);
                    }
                }
                Token::End => {
                    block = None;
                    if xml.depth() == frames_depth {
                        return Ok(true);
                    }
                }
                Token::Eof => return Ok(false),
            }
        }
    }

    /// `N` numbers for each internal part; `None` if the block is missing.
    fn block<const N: usize, const PARTS: usize>(
        &self,
        block: Block,
        columns: &Columns<PARTS>,
    ) -> Result<Option<[[f64; N]; PARTS]>, &'static str> {
        let numbers = &self.numbers[block as usize];
        if numbers.is_empty() {
            return Ok(None);
        }
        if numbers.len() != columns.count * N {
            return Err("wrong_count");
        }
        let mut parts = [[0.0; N]; PARTS];
        for (part, index) in parts.iter_mut().zip(&columns.indices) {
            part.copy_from_slice(&numbers[index * N..(index + 1) * N]);
            check(part)?;
        }
        Ok(Some(parts))
    }

    /// Orientations and positions of all segments, as in the file.
    pub(super) fn pose(&self, head: &Head) -> Result<Pose, &'static str> {
        let orientation_wxyz = self.block(Block::Orientation, &head.segments)?.ok_or("no_pose")?;
        let mut world_from_segment = [UnitQuaternion::identity(); SEGMENTS];
        for (turn, wxyz) in world_from_segment.iter_mut().zip(orientation_wxyz) {
            *turn = rotation(wxyz)?;
        }
        let origin_m: [[f64; 3]; SEGMENTS] = self.block(Block::Position, &head.segments)?.ok_or("no_pose")?;
        Ok(Pose::new(origin_m.map(Into::into), world_from_segment))
    }

    /// Writes everything except the times into a sample; after an error the sample must not be used.
    pub(super) fn fill(&self, head: &Head, null: &Pose, sample: &mut SuitSample) -> Result<(), &'static str> {
        let pose = in_axes_of(&self.pose(head)?, null);
        if !holds_together(&pose, null) {
            return Err("joints_apart");
        }
        sample.orientation_wxyz = pose.world_from_segment.map(|turn| wxyz(&turn));
        sample.position_m = pose.origin.map(Into::into);
        let velocity = self.block(Block::Velocity, &head.segments)?;
        let acceleration = self.block(Block::Acceleration, &head.segments)?;
        if let (Some(velocity), Some(acceleration)) = (velocity, acceleration) {
            sample.velocity_m_per_s = velocity;
            sample.acceleration_m_per_s2 = acceleration;
            sample.blocks |= SuitBlocks::LinearKinematics as u32;
        }
        if let Some(velocity) = self.block(Block::AngularVelocity, &head.segments)? {
            sample.angular_velocity_rad_per_s = velocity;
            sample.blocks |= SuitBlocks::AngularKinematics as u32;
        }
        if let Some(joints) = &head.joints
            && let Some(angles) = self.block::<3, JOINTS>(Block::JointAngle, joints)?
        {
            sample.joint_angle_deg = angles;
            sample.blocks |= SuitBlocks::JointAngles as u32;
        }
        // Newer files append its velocity and acceleration.
        if let [x, y, z, rest @ ..] = &self.numbers[Block::CentreOfMass as usize][..]
            && matches!(rest.len(), 0 | 6)
        {
            sample.com_m = [*x, *y, *z];
            check(&sample.com_m)?;
            sample.blocks |= SuitBlocks::CentreOfMass as u32;
        }
        Ok(())
    }
}

/// Poses of all segments.
pub(super) type Pose = equipoise_core::frame::Pose<SuitWorld>;

/// Version 3 has different arm axes (ISB), defined by its null pose; the internal axes are equal for all segments in the
/// null pose.
fn in_axes_of(pose: &Pose, null: &Pose) -> Pose {
    let turn = |index: usize| pose.world_from_segment[index] * null.world_from_segment[index].inverse();
    Pose::new(pose.origin, core::array::from_fn(turn))
}

/// Whether every segment begins at its parent's joint, by the null pose.
fn holds_together(pose: &Pose, null: &Pose) -> bool {
    Segment::ALL.into_iter().all(|segment| {
        let Some(parent) = segment.parent() else { return true };
        let offset_m = null.origin_of(segment) - null.origin_of(parent);
        let gap_m = (pose.origin_of(segment) - pose.point_on(parent, offset_m.into())).norm();
        gap_m <= JOINT_GAP_MAX_M
    })
}

fn check(numbers: &[f64]) -> Result<(), &'static str> {
    if numbers.iter().any(|number| !number.is_finite()) {
        return Err("not_a_number");
    }
    if numbers.iter().any(|number| number.abs() > LARGEST) {
        return Err("implausible");
    }
    Ok(())
}

fn rotation([w, x, y, z]: [f64; 4]) -> Result<UnitQuaternion<f64>, &'static str> {
    let (rotation, norm) = Unit::new_and_get(Quaternion::new(w, x, y, z));
    if (norm - 1.0).abs() > NORM_TOLERANCE { Err("not_a_rotation") } else { Ok(rotation) }
}
