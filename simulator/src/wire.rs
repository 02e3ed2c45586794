//! Encodes bodies as the datagrams of a real suit.

pub mod introduction;

use equipoise_core::body::{JOINTS, SEGMENTS, Segment};
use nalgebra::UnitQuaternion;

pub use self::introduction::introduction;
use crate::wires::mvn::describe::time_of_day;
use crate::wires::mvn::items::{self, ERGONOMIC_POINTS, JOINT_POINTS, Tracker, UNITY_ORDER};
use crate::wires::mvn::{Stamp, TooLong};

/// One sample of a suit, in the suit's world (Z up), with the data that MVN would send of it. Lengths in metres, angles
/// in degrees; `None` is not sent.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SuitFrame {
    /// MVN's sample counter, +1 per sample of the suit.
    pub sample_counter: u32,
    /// Milliseconds of the suit's own clock.
    pub time_code_ms: u32,
    /// Character id.
    pub avatar: u8,
    /// Segment origins, m.
    pub position_m: [[f64; 3]; SEGMENTS],
    /// `suitworld_from_segment`, scalar first.
    pub orientation_wxyz: [[f64; 4]; SEGMENTS],
    /// Velocity (m/s) and acceleration (m/s²) of the origins: type 21.
    pub motion: Option<[[[f64; 3]; 2]; SEGMENTS]>,
    /// Abduction, axial rotation, flexion, degrees: type 20.
    pub joint_angle_deg: Option<[[f64; 3]; JOINTS]>,
    /// Centre of mass by the suit's own model, m: type 24.
    pub com_m: Option<[f64; 3]>,
    /// Less common streams.
    pub more: More,
}

/// Optional MVN streams, each if selected.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct More {
    /// Leave out type 02, as if only Euler angles are selected.
    pub without_quaternions: bool,
    /// Type 01.
    pub euler: bool,
    /// Type 05.
    pub unity: bool,
    /// Type 03: points and their positions, m.
    pub markers_m: Vec<(u32, [f64; 3])>,
    /// The six ergonomic angles behind the joints of type 20, degrees.
    pub ergonomic_deg: Option<[[f64; 3]; 6]>,
    /// Angular velocity (rad/s) and acceleration (rad/s²): type 22.
    pub angular: Option<[[[f64; 3]; 2]; SEGMENTS]>,
    /// Type 23.
    pub trackers: Vec<Tracker>,
    /// Velocity (m/s) and acceleration (m/s²) of the centre of mass: type 24 with 36 bytes.
    pub com_motion: Option<[[f64; 3]; 2]>,
    /// Time of day, ms: type 25.
    pub time_of_day_ms: Option<u32>,
    /// Types 23 to 25 in the shorter sizes of older versions.
    pub old_sizes: bool,
    /// Props after the body's segments: position (m) and orientation.
    pub props: Vec<([f64; 3], [f64; 4])>,
    /// The finger segments of both hands, left first, 40 in all; empty without gloves.
    pub fingers: Vec<([f64; 3], [f64; 4])>,
}

/// Rounds to the wire's precision.
pub(crate) fn single<const N: usize>(value: [f64; N]) -> [f32; N] {
    value.map(|number| number as f32)
}

/// Segment ids of a body without props and fingers.
fn bodily<Item>(item: impl Fn(usize) -> Item) -> [(u32, Item); SEGMENTS] {
    core::array::from_fn(|index| (index as u32 + 1, item(index)))
}

impl SuitFrame {
    /// The datagrams of this sample, poses first.
    ///
    /// # Errors
    /// [`TooLong`] with more props or points than a datagram's header can count.
    pub fn datagrams(&self) -> Result<Vec<Vec<u8>>, TooLong> {
        let more = &self.more;
        let stamp = Stamp {
            segments: [SEGMENTS as u8, more.props.len() as u8, more.fingers.len() as u8],
            ..Stamp::of_a_body(self.sample_counter, self.time_code_ms, self.avatar)
        };
        let poses = self.poses();
        let mut datagrams = Vec::new();
        if !more.without_quaternions {
            let single = |(id, place, turn): &(u32, [f64; 3], [f64; 4])| (*id, single(*place), single(*turn));
            datagrams.push(items::pose_quaternion(&stamp, &poses.iter().map(single).collect::<Vec<_>>())?);
        }
        if more.euler {
            let euler: Vec<_> =
                poses.iter().map(|(id, place, turn)| y_up_euler(*id, *place, *turn)).collect();
            datagrams.push(items::pose_euler(&stamp, &euler)?);
        }
        if more.unity {
            datagrams.push(items::pose_unity(&stamp, &self.unity_poses())?);
        }
        if !more.markers_m.is_empty() {
            let y_up_cm = |[x, y, z]: [f64; 3]| single([y, z, x].map(|metres| 100.0 * metres));
            let points: Vec<_> = more.markers_m.iter().map(|(id, place)| (*id, y_up_cm(*place))).collect();
            datagrams.push(items::markers(&stamp, &points)?);
        }
        if let Some(angles) = self.joint_angle_deg {
            let ergonomic = more.ergonomic_deg.iter().flatten();
            let joints: Vec<_> = (JOINT_POINTS.into_iter().chain(ERGONOMIC_POINTS))
                .zip(angles.iter().chain(ergonomic))
                .map(|(points, angle_deg)| (points, single(*angle_deg)))
                .collect();
            datagrams.push(items::joint_angles(&stamp, &joints)?);
        }
        if let Some(motion) = self.motion {
            let segments = bodily(|i| [self.position_m[i], motion[i][0], motion[i][1]].map(single));
            datagrams.push(items::linear_kinematics(&stamp, &segments)?);
        }
        if let Some(angular) = more.angular {
            let segments = bodily(|i| (single(self.orientation_wxyz[i]), angular[i].map(single)))
                .map(|(id, (orientation, motion))| (id, orientation, motion));
            datagrams.push(items::angular_kinematics(&stamp, &segments)?);
        }
        if !more.trackers.is_empty() {
            let measured = |tracker: &Tracker| tracker.measured.filter(|_| !more.old_sizes);
            let trackers: Vec<_> = more
                .trackers
                .iter()
                .map(|tracker| Tracker { measured: measured(tracker), ..*tracker })
                .collect();
            datagrams.push(items::trackers(&stamp, &trackers)?);
        }
        if let Some(com_m) = self.com_m {
            let motion = more.com_motion.filter(|_| !more.old_sizes).map(|motion| motion.map(single));
            datagrams.push(items::centre_of_mass(&stamp, single(com_m), motion)?);
        }
        if let Some(at_ms) = more.time_of_day_ms {
            datagrams.push(time_of_day(&stamp, at_ms, !more.old_sizes)?);
        }
        Ok(datagrams)
    }

    /// All items of a pose, in their order: body, props, fingers.
    fn poses(&self) -> Vec<(u32, [f64; 3], [f64; 4])> {
        let body = self.position_m.iter().copied().zip(self.orientation_wxyz);
        let others = self.more.props.iter().chain(&self.more.fingers).copied();
        (1..).zip(body.chain(others)).map(|(id, (place, turn))| (id, place, turn)).collect()
    }

    /// Type 05: forward is Unity's Z, left its −X, up its Y; the pelvis in the world, all others from their parents.
    /// That X, Y and Z result from these is this project's reading of "Y up, left-handed".
    fn unity_poses(&self) -> Vec<items::Pose<4>> {
        let turn = |i: usize| {
            let [w, x, y, z] = self.orientation_wxyz[i];
            UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z))
        };
        let place = |i: usize| nalgebra::Vector3::from(self.position_m[i]);
        let left_handed = |place: nalgebra::Vector3<f64>, turn: UnitQuaternion<f64>| {
            (single([-place.y, place.z, place.x]), single([turn.w, turn.j, -turn.k, -turn.i]))
        };
        UNITY_ORDER
            .into_iter()
            .map(|id| {
                let i = id - 1;
                let (place, turn) = match Segment::ALL[i].parent() {
                    None => left_handed(place(i), turn(i)),
                    Some(parent) => {
                        let (p, from_world) = (parent.index(), turn(parent.index()).inverse());
                        left_handed(from_world * (place(i) - place(p)), from_world * turn(i))
                    }
                };
                (id as u32, place, turn)
            })
            .collect()
    }
}

/// A pose in the convention of type 01: Y up (Z forward, X left), centimetres, degrees of `Rz Ry Rx`.
fn y_up_euler(id: u32, [x, y, z]: [f64; 3], [w, i, j, k]: [f64; 4]) -> items::Pose<3> {
    let turned = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, j, k, i));
    let (about_x, about_y, about_z) = turned.euler_angles();
    let angles = [about_x, about_y, about_z].map(f64::to_degrees);
    (id, single([y, z, x].map(|metres| 100.0 * metres)), single(angles))
}

/// Joint angles as MVN has them (Euler ZXY in ISB axes: X forward, Y up, Z right): abduction, axial rotation, flexion.
///
/// Signs: the left side mirrors the right, and knees bend positively.
pub fn joint_angles_deg(parent_from_segment: &[UnitQuaternion<f64>; SEGMENTS]) -> [[f64; 3]; JOINTS] {
    std::array::from_fn(|j| {
        let segment = Segment::ALL[j + 1];
        let r = parent_from_segment[j + 1].to_rotation_matrix();
        // ISB's axes are X, Z and −Y here.
        let isb = |row: usize, column: usize| {
            let (axis, sign) = ([0, 2, 1], [1.0, 1.0, -1.0]);
            sign[row] * sign[column] * r[(axis[row], axis[column])]
        };
        let abduction = isb(2, 1).clamp(-1.0, 1.0).asin();
        let axial = (-isb(2, 0)).atan2(isb(2, 2));
        let flexion = (-isb(0, 1)).atan2(isb(1, 1));
        let mirror = if segment.mirrored() < segment { -1.0 } else { 1.0 };
        let knee = matches!(segment, Segment::RightLowerLeg | Segment::LeftLowerLeg);
        [mirror * abduction, mirror * axial, if knee { -flexion } else { flexion }].map(f64::to_degrees)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use equipoise_adapters::wire::mvn::Datagram;
    use nalgebra::Vector3;

    #[test]
    fn a_frame_is_read_back_from_its_datagrams() {
        let frame = SuitFrame {
            sample_counter: 60,
            time_code_ms: 1000,
            motion: Some([[[1.0; 3]; 2]; SEGMENTS]),
            joint_angle_deg: Some([[2.0; 3]; JOINTS]),
            com_m: Some([3.0; 3]),
            ..SuitFrame::default()
        };
        let datagrams = frame.datagrams().unwrap();
        assert_eq!(datagrams.iter().map(Vec::len).collect::<Vec<_>>(), [760, 464, 944, 36]);
        for bytes in &datagrams {
            assert_eq!(Datagram::parse(bytes).unwrap().header().unwrap().sample_counter, 60);
        }
    }

    #[test]
    fn angles_have_the_signs_of_the_clinic() {
        let about = |axis: Vector3<f64>, degrees: f64| {
            UnitQuaternion::from_scaled_axis(axis * f64::to_radians(degrees))
        };
        let mut relative = [UnitQuaternion::identity(); SEGMENTS];
        relative[Segment::RightLowerLeg.index()] = about(Vector3::y(), 40.0);
        relative[Segment::LeftUpperLeg.index()] = about(Vector3::y(), -30.0);
        let angles = joint_angles_deg(&relative);
        assert!((angles[Segment::RightLowerLeg.index() - 1][2] - 40.0).abs() < 1e-9);
        assert!((angles[Segment::LeftUpperLeg.index() - 1][2] - 30.0).abs() < 1e-9);
    }
}
