//! Real MVN datagrams, and real values of a recording in MVN's framing. The files may not be shipped: where they are
//! absent, these tests say so and pass.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking, in its helpers too")]

use equipoise_adapters::suit::{SuitAssembler, SuitSettings};
use equipoise_adapters::wire::mvn::{Datagram, TrackerKinematics};
use equipoise_core::body::{Joint, SEGMENTS, Segment};
use equipoise_core::message::SuitSample;
use equipoise_core::message::suit::SuitBlocks;
use std::path::PathBuf;

fn wire_file(name: &str) -> Option<Vec<u8>> {
    let shared = std::env::var_os("EQUIPOISE_SHARED")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")), PathBuf::from);
    let path = shared.join("data/wire").join(name);
    match std::fs::read(&path) {
        Ok(bytes) => Some(bytes),
        Err(error) => {
            println!("skipped: {} cannot be read ({error}); set EQUIPOISE_SHARED", path.display());
            None
        }
    }
}

#[test]
fn euler_and_quaternion_poses_of_one_sample_agree() {
    let (Some(euler), Some(quaternion)) = (wire_file("mxtp01.bin"), wire_file("mxtp02.bin")) else { return };
    let Ok(Datagram::PoseEuler(euler_header, euler)) = Datagram::parse(&euler) else { panic!("not type 01") };
    let Ok(Datagram::PoseQuaternion(header, poses)) = Datagram::parse(&quaternion) else {
        panic!("not type 02")
    };
    for header in [euler_header, header] {
        assert_eq!(
            (header.sample_counter, header.time_code_ms, header.datagram_counter),
            (6681, 27837, 0x80)
        );
        assert_eq!((header.items, header.avatar, header.body_segments, header.props), (23, 0, 23, 0));
    }
    assert_eq!((euler_header.payload_size, header.payload_size), (644, 736));
    assert_eq!((euler.len(), poses.len()), (SEGMENTS, SEGMENTS));
    for (index, (wire, pose)) in euler.zip(poses).enumerate() {
        assert_eq!((wire.segment_id, pose.segment_id), (index as u32 + 1, index as u32 + 1));
        let converted = wire.to_z_up();
        for axis in 0..3 {
            let apart_cm = 100.0 * f64::from(converted.position_m[axis] - pose.position_m[axis]).abs();
            assert!(apart_cm < 2e-5, "segment {}: {apart_cm} cm", pose.segment_id);
        }
        let dot: f64 = (0..4)
            .map(|part| f64::from(converted.orientation_wxyz[part]) * f64::from(pose.orientation_wxyz[part]))
            .sum();
        assert!((dot.abs() - 1.0).abs() < 1e-6, "segment {}: {dot}", pose.segment_id);
        let norm = pose.orientation_wxyz.iter().map(|part| part * part).sum::<f32>().sqrt();
        assert!((norm - 1.0).abs() < 1e-6);
    }
}

#[test]
fn the_wearer_and_the_null_pose_are_read() {
    let (Some(meta), Some(scale)) = (wire_file("mxtp12.bin"), wire_file("mxtp13.bin")) else { return };
    let mut assembler = SuitAssembler::new(SuitSettings::default());
    assert!(assembler.receive(&meta, 1).is_none() && assembler.receive(&scale, 2).is_none());
    assert_eq!(assembler.counts().refused.iter().sum::<u64>(), 0);
    assert_eq!(assembler.subject().name.as_deref(), Some("Factory"));
    assert_eq!(assembler.subject().time_offset_ms, Some(-3_600_000));
    let origins = assembler.subject().null_pose.origins_m.expect("a null pose");
    for (segment, height_m) in [
        (Segment::RightUpperLeg, 1.052),
        (Segment::RightLowerLeg, 0.575),
        (Segment::RightFoot, 0.109),
        (Segment::RightUpperArm, 1.610),
    ] {
        assert!(
            (origins[segment.index()][2] - height_m).abs() < 1e-3,
            "{segment:?}: {:?}",
            origins[segment.index()]
        );
    }
    assert!(origins[Segment::LeftHand.index()][1] > 0.0 && origins[Segment::LeftToe.index()][0] > 0.0);

    let Ok(Datagram::Scale(header, scale)) = Datagram::parse(&scale) else { panic!("not type 13") };
    assert_eq!((header.sample_counter, header.datagram_counter, header.items), (0, 0, 0));
    // MVN writes "ForeArm" here and "Forearm" elsewhere.
    let names: Vec<String> = scale.segments().map(|segment| segment.name.to_lowercase()).collect();
    assert_eq!(names, Segment::ALL.map(|segment| segment.name().to_lowercase()));
    assert_eq!(scale.points().count(), 0);

    let Ok(Datagram::Meta(_, meta)) = Datagram::parse(&meta) else { panic!("not type 12") };
    let tags = [("color", "e96417"), ("count", "1"), ("name", "Factory"), ("timeOffset", "-3600000")];
    assert_eq!(meta.tags().collect::<Vec<_>>(), tags);
}

/// The datagrams of a file that puts a big-endian u32 length before each.
fn length_prefixed(mut bytes: &[u8]) -> Vec<&[u8]> {
    let mut datagrams = Vec::new();
    while let Some((length, rest)) = bytes.split_first_chunk::<4>() {
        let (datagram, rest) = rest.split_at(u32::from_be_bytes(*length) as usize);
        datagrams.push(datagram);
        bytes = rest;
    }
    datagrams
}

fn assert_near(got: &[f64], want: &serde_json::Value, what: &str) {
    let want: Vec<f64> = serde_json::from_value(want.clone()).unwrap();
    assert_eq!(got.len(), want.len(), "{what}");
    for (got, want) in got.iter().zip(&want) {
        assert!((got - want).abs() < 1e-6 * (1.0 + want.abs()), "{what}: {got} for {want}");
    }
}

#[test]
fn a_recording_of_all_types_is_assembled_to_its_values() {
    let (Some(bytes), Some(expected)) = (wire_file("meri020.mxtp.bin"), wire_file("meri020.expected.json"))
    else {
        return;
    };
    let expected: serde_json::Value = serde_json::from_slice(&expected).unwrap();
    let datagrams = length_prefixed(&bytes);
    let mut assembler = SuitAssembler::new(SuitSettings::default());
    let mut samples: Vec<SuitSample> = Vec::new();
    let mut times_of_day = Vec::new();
    for (index, datagram) in datagrams.iter().enumerate() {
        match Datagram::parse(datagram) {
            Ok(Datagram::TimeCode(_, time)) => times_of_day.push(time.to_string()),
            Ok(Datagram::TrackerKinematics(_, trackers)) => {
                let trackers: Vec<TrackerKinematics> = trackers.collect();
                assert_eq!(trackers.len(), 17);
                assert!(trackers.iter().all(|tracker| tracker.inertial.is_some()));
            }
            Ok(_) => {}
            Err(malformed) => panic!("datagram {index}: {malformed}"),
        }
        samples.extend(assembler.receive(datagram, 1_000_000 * index as u64));
    }
    let frames = expected["frames"].as_array().unwrap();
    // The last frame still waits for its successor: with so few, the set of types is not settled.
    assert!(samples.len() + 1 >= frames.len(), "{} samples of {} frames", samples.len(), frames.len());
    for (sample, frame) in samples.iter().zip(frames) {
        assert_eq!(u64::from(sample.device_counter), frame["sample"].as_u64().unwrap());
        assert_eq!(u64::from(sample.device_time_ms), frame["time_ms"].as_u64().unwrap());
        assert_near(&sample.position_m[0], &frame["pelvis_pos_m"], "position");
        assert_near(&sample.velocity_m_per_s[0], &frame["pelvis_vel"], "velocity");
        assert_near(&sample.acceleration_m_per_s2[0], &frame["pelvis_acc"], "acceleration");
        assert_near(&sample.angular_velocity_rad_per_s[0], &frame["pelvis_angvel_rad_s"], "angular velocity");
        assert_near(&sample.com_m, &frame["com_m"], "centre of mass");
        let knee = Joint::named("RightKnee").unwrap();
        assert_near(&sample.joint_angle_deg[knee.index()], &frame["right_knee_deg_xyz"], "knee");
        assert_near(&sample.orientation_wxyz[0], &frame["pelvis_quat_wxyz"], "orientation");
        for block in [
            SuitBlocks::LinearKinematics,
            SuitBlocks::AngularKinematics,
            SuitBlocks::JointAngles,
            SuitBlocks::CentreOfMass,
        ] {
            assert!(sample.has(block), "{block:?}");
        }
    }
    let expected_times: Vec<&str> = frames.iter().map(|frame| frame["tc"].as_str().unwrap()).collect();
    assert_eq!(times_of_day, expected_times);
    assert_eq!(assembler.counts().refused.iter().sum::<u64>(), 0);
}
