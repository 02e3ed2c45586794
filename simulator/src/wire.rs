//! From bodies to the bytes of a real suit.

use equipoise_adapters::wire::mvn;
use equipoise_adapters::wire::mvn::header::{Header, Oversized};
use equipoise_adapters::wire::mvn::joint_angles::BODY_JOINT_POINTS;
use equipoise_core::body::{JOINTS, SEGMENTS, Segment};
use nalgebra::{UnitQuaternion, Vector3};

use crate::kinematics::origins_m;
use crate::person::Person;

/// One sample of a suit, in the suit's world (Z up), with what MVN would send of it. Lengths in metres, angles in
/// degrees; `None` is not sent.
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
}

fn single<const N: usize>(value: [f64; N]) -> [f32; N] {
    value.map(|number| number as f32)
}

impl SuitFrame {
    /// The datagrams of this sample, type 02 first.
    ///
    /// # Errors
    /// Never for a body's 23 segments; the encoders' own.
    pub fn datagrams(&self) -> Result<Vec<Vec<u8>>, Oversized> {
        let header = Header::new(self.sample_counter, self.time_code_ms, self.avatar);
        let mut datagrams = Vec::new();
        let mut append = |encode: &dyn Fn(&mut Vec<u8>) -> Result<(), Oversized>| {
            let mut bytes = Vec::new();
            encode(&mut bytes).map(|()| datagrams.push(bytes))
        };
        let poses: [mvn::SegmentPose; SEGMENTS] = std::array::from_fn(|i| mvn::SegmentPose {
            segment_id: i as u32 + 1,
            position_m: single(self.position_m[i]),
            orientation_wxyz: single(self.orientation_wxyz[i]),
        });
        append(&|out| mvn::pose_quaternion::encode(&header, &poses, out))?;
        if let Some(angles) = self.joint_angle_deg {
            let items: [mvn::JointAngle; JOINTS] = std::array::from_fn(|j| mvn::JointAngle {
                parent_point: BODY_JOINT_POINTS[j].0,
                child_point: BODY_JOINT_POINTS[j].1,
                angle_deg: single(angles[j]),
            });
            append(&|out| mvn::joint_angles::encode(&header, &items, out))?;
        }
        if let Some(motion) = self.motion {
            let items: [mvn::LinearKinematics; SEGMENTS] = std::array::from_fn(|i| mvn::LinearKinematics {
                segment_id: i as u32 + 1,
                position_m: single(self.position_m[i]),
                velocity_m_per_s: single(motion[i][0]),
                acceleration_m_per_s2: single(motion[i][1]),
            });
            append(&|out| mvn::linear_kinematics::encode(&header, &items, out))?;
        }
        if let Some(com) = self.com_m {
            let com = mvn::CentreOfMass { position_m: single(com), motion: None };
            append(&|out| mvn::centre_of_mass::encode(&header, &com, out))?;
        }
        Ok(datagrams)
    }
}

/// Who it is and how long its segments are, as MVN tells once a second: types 12 and 13.
///
/// # Errors
/// Never for 23 segments; the encoders' own.
pub fn introduction(person: &Person, avatar: u8) -> Result<[Vec<u8>; 2], Oversized> {
    let header = Header::new(0, 0, avatar);
    let (mut meta, mut scale) = (Vec::new(), Vec::new());
    mvn::meta::encode(
        &header,
        &[("color", "e96417"), ("name", "Simulated"), ("timeOffset", "0")],
        &mut meta,
    )?;
    let height = crate::pose::straight_height_m(person);
    let origin = origins_m(person, Vector3::z() * height, &[UnitQuaternion::identity(); SEGMENTS]);
    let segments: [mvn::scale::NullPoseSegment; SEGMENTS] =
        std::array::from_fn(|i| mvn::scale::NullPoseSegment {
            // MVN writes these two with a capital inside.
            name: match Segment::ALL[i] {
                Segment::RightForearm => "RightForeArm",
                Segment::LeftForearm => "LeftForeArm",
                segment => segment.name(),
            },
            origin_m: single(origin[i].into()),
        });
    mvn::scale::encode(&header, &segments, &[], &mut scale)?;
    Ok([meta, scale])
}

/// Joint angles as MVN has them (Euler ZXY in ISB axes: X forward, Y up, Z right): abduction, axial rotation, flexion.
///
/// Signs: the left side mirrors the right, and knees bend positively.
pub fn joint_angles_deg(parent_from_segment: &[UnitQuaternion<f64>; SEGMENTS]) -> [[f64; 3]; JOINTS] {
    std::array::from_fn(|j| {
        let segment = Segment::ALL[j + 1];
        let r = parent_from_segment[j + 1].to_rotation_matrix();
        // ISB's axes are our X, Z and −Y.
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
    fn the_introduction_names_every_segment_in_the_null_pose() {
        let [meta, scale] = introduction(&Person::nominal(1.77, 72.0), 0).unwrap();
        assert!(matches!(Datagram::parse(&meta), Ok(Datagram::Meta(..))));
        let Ok(Datagram::Scale(_, scale)) = Datagram::parse(&scale) else { panic!("not a scale") };
        let segments: Vec<_> = scale.segments().collect();
        assert_eq!(segments.len(), SEGMENTS);
        assert!((0.9..1.0).contains(&segments[0].origin_m[2]));
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
