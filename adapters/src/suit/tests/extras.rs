//! Additional and alternative data of a body: props, gloves, ergonomic joints, other pose types, another upward axis.

use super::*;
use crate::suit::UpAxis;
use crate::wire::mvn::joint_angles::BODY_JOINT_POINTS;
use crate::wire::mvn::{
    AngularKinematics, CentreOfMass, DatagramType, JointAngle, Layout, NullPoseSegment, SegmentPoint,
    angular_kinematics, centre_of_mass, joint_angles, scale, unity,
};

/// Two props between the body and 40 finger segments, with consecutive ids (24 …) as MVN's newest senders number them,
/// or with those of the specification (25 …); the result must not depend on them.
fn with_props_and_gloves(first_prop_id: u32) -> Vec<SegmentPose> {
    let far = |segment_id| SegmentPose {
        segment_id,
        position_m: [50.0, 60.0, -70.0],
        orientation_wxyz: [0.0, 1.0, 0.0, 0.0],
    };
    standing().into_iter().chain((0..42).map(|index| far(first_prop_id + index))).collect()
}

fn gloved(counter: u32) -> Header {
    Header { props: 2, finger_segments: 40, ..Header::new(counter, counter * 4, 0) }
}

fn only(required: TypeSet) -> SuitAssembler {
    SuitAssembler::new(SuitSettings { required: Some(required), ..SuitSettings::default() })
}

/// The inverse of `y_up_to_z_up`: motion in a Y-up world.
fn to_y_up([forward, left, up]: [f32; 3]) -> [f32; 3] {
    [left, up, forward]
}

fn y_up(pose: &SegmentPose) -> SegmentPose {
    let [w, x, y, z] = pose.orientation_wxyz;
    let [x, y, z] = to_y_up([x, y, z]);
    SegmentPose { position_m: to_y_up(pose.position_m), orientation_wxyz: [w, x, y, z], ..*pose }
}

#[test]
fn props_and_fingers_are_counted_and_the_body_stays_the_body() {
    let all = TypeSet::POSE_QUATERNION.and(TypeSet::LINEAR_KINEMATICS).and(TypeSet::ANGULAR_KINEMATICS);
    for first_prop_id in [24, 25] {
        let mut assembler = only(all);
        let poses = with_props_and_gloves(first_prop_id);
        let linear: Vec<_> = poses
            .iter()
            .map(|pose| LinearKinematics {
                segment_id: pose.segment_id,
                position_m: pose.position_m,
                velocity_m_per_s: [pose.segment_id as f32; 3],
                acceleration_m_per_s2: [-(pose.segment_id as f32); 3],
            })
            .collect();
        let angular: Vec<_> = poses
            .iter()
            .map(|pose| AngularKinematics {
                segment_id: pose.segment_id,
                orientation_wxyz: pose.orientation_wxyz,
                angular_velocity_rad_per_s: [pose.segment_id as f32 / 10.0; 3],
                angular_acceleration_rad_per_s2: [0.0; 3],
            })
            .collect();
        let (mut bytes, mut sent) = (Vec::new(), Vec::new());
        pose_quaternion::encode(&gloved(1), &poses, &mut bytes).unwrap();
        assert_eq!(bytes.len(), 24 + 65 * 32);
        sent.push(bytes.clone());
        linear_kinematics::encode(&gloved(1), &linear, &mut bytes).unwrap();
        sent.push(bytes.clone());
        angular_kinematics::encode(&gloved(1), &angular, &mut bytes).unwrap();
        sent.push(bytes.clone());
        let samples = feed(&mut assembler, &sent, 0);
        let [sample] = &samples[..] else { panic!("{:?}", assembler.counts()) };
        for (index, pose) in standing().iter().enumerate() {
            assert_eq!(sample.position_m[index], pose.position_m.map(f64::from));
            assert_eq!(sample.velocity_m_per_s[index], [index as f64 + 1.0; 3]);
            assert_eq!(sample.acceleration_m_per_s2[index], [-(index as f64) - 1.0; 3]);
            assert!((sample.angular_velocity_rad_per_s[index][0] - (index as f64 + 1.0) / 10.0).abs() < 1e-6);
        }
        assert_eq!(assembler.layout(), Some(Layout { body: 23, props: 2, fingers: 40 }));
        assert_eq!(assembler.counts().refused.iter().sum::<u64>(), 0);
    }
}

#[test]
fn gloves_alone_are_the_2040_bytes_of_one_datagram() {
    let mut assembler = only(TypeSet::POSE_QUATERNION);
    let mut poses = with_props_and_gloves(24);
    poses.truncate(63);
    let header = Header { props: 0, ..gloved(1) };
    let mut bytes = Vec::new();
    pose_quaternion::encode(&header, &poses, &mut bytes).unwrap();
    assert_eq!((bytes.len(), bytes[11]), (2040, 63));
    assert!(assembler.receive(&bytes, 0).is_some());
    assert_eq!(assembler.layout(), Some(Layout { body: 23, props: 0, fingers: 40 }));
}

#[test]
fn joints_beyond_the_body_s_22_are_passed_over_however_many_and_whatever_their_ids() {
    // Six ergonomic joints, two of them with the same pair of ids, followed by joints as gloves may add.
    let ergonomic = [
        (0x0500, 0x0700),
        (0x0500, 0x0d00),
        (0x0500, 0x0900),
        (0x0100, 0x0500),
        (0x0100, 0x0100),
        (0x0100, 0x0500),
    ];
    let fingers = (0..38u32).map(|index| (0x1700 + index, 0x1800 + index));
    let all: Vec<JointAngle> = BODY_JOINT_POINTS
        .into_iter()
        .chain(ergonomic)
        .chain(fingers)
        .enumerate()
        .map(|(index, (parent_point, child_point))| JointAngle {
            parent_point,
            child_point,
            angle_deg: [index as f32; 3],
        })
        .collect();
    for count in [22, 26, 28, 66] {
        let mut assembler = only(TypeSet::POSE_QUATERNION.and(TypeSet::JOINT_ANGLES));
        let mut joints = Vec::new();
        joint_angles::encode(&Header::new(1, 4, 0), &all[..count], &mut joints).unwrap();
        let samples = feed(&mut assembler, &[pose_datagram(1, &standing()), joints], 0);
        assert_eq!(
            samples[0].joint_angle_deg,
            core::array::from_fn(|joint| [joint as f64; 3]),
            "{count} joints"
        );
    }
    let mut assembler = only(TypeSet::POSE_QUATERNION);
    let mut joints = Vec::new();
    joint_angles::encode(&Header::new(1, 4, 0), &all[..21], &mut joints).unwrap();
    assert!(assembler.receive(&joints, 0).is_none());
    assert_eq!(refused(&assembler, SuitRefusal::MissingSegment), 1);
}

#[test]
fn a_body_for_unity_stands_in_where_nothing_better_is_sent() {
    let body: [SegmentPose; 23] = standing().try_into().unwrap();
    let mut bytes = Vec::new();
    unity::encode(&Header::new(1, 4, 0), &body, &mut bytes).unwrap();
    let mut assembler = only(TypeSet::POSE_UNITY);
    let sample = assembler.receive(&bytes, 7).unwrap();
    for (index, pose) in body.iter().enumerate() {
        for axis in 0..3 {
            assert!(
                (sample.position_m[index][axis] - f64::from(pose.position_m[axis])).abs() < 1e-5,
                "{index}"
            );
        }
        assert!((sample.orientation_wxyz[index][0].abs() - 0.6).abs() < 1e-5, "{index}");
    }
    // With 02 in the same sample, before or after, 02 is used.
    let mut moved = standing();
    moved.iter_mut().for_each(|pose| pose.position_m[0] += 1.0);
    for swapped in [false, true] {
        let mut assembler = only(TypeSet::POSE_UNITY.and(TypeSet::POSE_QUATERNION));
        let mut sent = [bytes.clone(), pose_datagram(1, &moved)];
        if swapped {
            sent.reverse();
        }
        let samples = feed(&mut assembler, &sent, 0);
        assert_eq!(samples[0].position_m[0], moved[0].position_m.map(f64::from));
    }
}

#[test]
fn y_up_is_refused_where_z_is_expected_and_turned_where_it_is_said() {
    let poses: Vec<SegmentPose> = standing().iter().map(y_up).collect();
    let linear = |turn: fn([f32; 3]) -> [f32; 3]| {
        let items: Vec<_> = standing()
            .iter()
            .map(|pose| LinearKinematics {
                segment_id: pose.segment_id,
                position_m: turn(pose.position_m),
                velocity_m_per_s: turn([1.0, 2.0, 3.0]),
                acceleration_m_per_s2: turn([4.0, 5.0, 6.0]),
            })
            .collect();
        let mut bytes = Vec::new();
        linear_kinematics::encode(&Header::new(1, 4, 0), &items, &mut bytes).unwrap();
        bytes
    };
    let mut expecting_z = only(TypeSet::POSE_QUATERNION);
    assert!(expecting_z.receive(&pose_datagram(1, &poses), 0).is_none());
    assert_eq!(refused(&expecting_z, SuitRefusal::UpsideDown), 1);

    for turn in [to_y_up, |v| v] {
        let required = Some(TypeSet::POSE_QUATERNION.and(TypeSet::LINEAR_KINEMATICS));
        let mut assembler =
            SuitAssembler::new(SuitSettings { required, up: UpAxis::Y, ..SuitSettings::default() });
        let mut com = Vec::new();
        let position_m = [0.0, 0.0, 1.0];
        centre_of_mass::encode(&Header::new(1, 4, 0), &CentreOfMass { position_m, motion: None }, &mut com)
            .unwrap();
        let samples = feed(&mut assembler, &[pose_datagram(1, &poses), com, linear(turn)], 0);
        let [sample] = &samples[..] else { panic!("{:?}", assembler.counts()) };
        assert_eq!(sample.position_m[6], standing()[6].position_m.map(f64::from));
        for (got, want) in sample.orientation_wxyz[6].iter().zip(standing()[6].orientation_wxyz) {
            assert!((got - f64::from(want)).abs() < 1e-6);
        }
        assert_eq!(sample.velocity_m_per_s[6], [1.0, 2.0, 3.0], "in either form of type 21");
        assert_eq!(sample.acceleration_m_per_s2[6], [4.0, 5.0, 6.0]);
        assert!(!sample.has(SuitBlocks::CentreOfMass), "in which world it comes is not known");
    }
    let mut said_wrongly = SuitAssembler::new(SuitSettings { up: UpAxis::Y, ..SuitSettings::default() });
    assert!(said_wrongly.receive(&pose_datagram(1, &standing()), 0).is_none());
    assert_eq!(refused(&said_wrongly, SuitRefusal::UpsideDown), 1);
}

/// A body that stoops along a horizontal axis of the world is upright along both.
#[test]
fn a_stooping_worker_keeps_the_accelerations_where_y_is_up() {
    let stooping = |reach_m: f32| -> Vec<SegmentPose> {
        let place = |pose: SegmentPose| {
            let along = (pose.position_m[2] - 0.1) * reach_m;
            SegmentPose { position_m: [along, along, 0.1 + (pose.position_m[2] - 0.1) * 0.6], ..pose }
        };
        standing().into_iter().map(place).collect()
    };
    for turn in [to_y_up, |v| v] {
        let required = Some(TypeSet::POSE_QUATERNION.and(TypeSet::LINEAR_KINEMATICS));
        let mut assembler =
            SuitAssembler::new(SuitSettings { required, up: UpAxis::Y, ..SuitSettings::default() });
        // Type 21 before its pose, with stooping in any direction.
        for (counter, reach_m) in [(0, 0.0), (1, 0.0), (2, 0.5), (3, -0.5), (4, 0.7), (5, -0.7)] {
            let poses = stooping(reach_m);
            let items: Vec<_> = poses
                .iter()
                .map(|pose| LinearKinematics {
                    segment_id: pose.segment_id,
                    position_m: turn(pose.position_m),
                    velocity_m_per_s: turn([1.0, 2.0, 3.0]),
                    acceleration_m_per_s2: turn([4.0, 5.0, 6.0]),
                })
                .collect();
            let mut linear = Vec::new();
            linear_kinematics::encode(&Header::new(counter, counter * 4, 0), &items, &mut linear).unwrap();
            let pose = pose_datagram(counter, &poses.iter().map(y_up).collect::<Vec<_>>());
            let samples = feed(&mut assembler, &[linear, pose], u64::from(counter) * 4_000_000);
            let [sample] = &samples[..] else { panic!("{:?}", assembler.counts()) };
            assert!(sample.has(SuitBlocks::LinearKinematics), "{counter}");
            assert_eq!(sample.acceleration_m_per_s2[6], [4.0, 5.0, 6.0]);
        }
        assert_eq!(assembler.counts().refused.iter().sum::<u64>(), 0);
    }
}

#[test]
fn unused_types_change_nothing_and_are_not_refused() {
    let mut assembler = SuitAssembler::new(SuitSettings::default());
    for kind in [DatagramType::VIRTUAL_MARKERS, DatagramType::TRACKER_KINEMATICS, DatagramType::TIME_CODE] {
        let mut bytes = pose_datagram(1, &standing());
        bytes[4..6].copy_from_slice(&kind.0);
        assert!(assembler.receive(&bytes, 0).is_none());
    }
    assert_eq!((assembler.counts().received, assembler.counts().refused.iter().sum::<u64>()), (3, 0));
}

#[test]
fn a_null_pose_in_several_datagrams_is_merged_in_any_order() {
    let names: Vec<String> = (1..=23).map(|index| format!("Segment{index}")).collect();
    let segments: Vec<_> =
        names.iter().map(|name| NullPoseSegment { name, origin_m: [0.0, 0.1, 1.0] }).collect();
    let point = |index: u16| SegmentPoint {
        segment_id: 1 + index / 6,
        point_id: 1 + index % 6,
        name: "pPoint",
        flags: 0,
        offset_m: [f32::from(index), 0.0, 0.0],
    };
    let points: Vec<_> = (0..123).map(point).collect();
    // The order in which MVN sends: the segments first, with a counter of 0 and without an end mark, then points in
    // fours.
    let mut sent = Vec::new();
    let mut datagram = |counter: u8, segments: &[NullPoseSegment<'_>], points: &[SegmentPoint<'_>]| {
        let mut bytes = Vec::new();
        let header = Header { datagram_counter: counter, ..Header::new(0, 0, 0) };
        scale::encode(&header, segments, points, &mut bytes).unwrap();
        sent.push(bytes);
    };
    datagram(0, &segments, &[]);
    for (index, points) in points.chunks(31).enumerate() {
        let last = if index == 3 { 0x80 } else { 0 };
        datagram((index as u8 + 1) | last, &[], points);
    }
    assert_eq!(sent.len(), 5);
    for turn in 0..5 {
        let mut assembler = SuitAssembler::new(SuitSettings::default());
        let mut shuffled = sent.clone();
        shuffled.rotate_left(turn);
        // Sent repeatedly: points that arrive before the segments may be discarded the first time.
        for _ in 0..2 {
            assert!(feed(&mut assembler, &shuffled, 0).is_empty());
        }
        assert_eq!(assembler.counts().refused.iter().sum::<u64>(), 0);
        let null_pose = &assembler.subject().null_pose;
        assert_eq!(null_pose.origins_m, Some([[0.0, f64::from(0.1f32), 1.0]; 23]));
        assert_eq!(null_pose.points.len(), 123);
        assert_eq!(null_pose.points[&(2, 1)].1, [6.0, 0.0, 0.0]);
    }
}
