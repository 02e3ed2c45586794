//! Real MVN datagrams, and real values of a recording in MVN's framing. The files may not be redistributed: where they
//! are absent, these tests print a note and pass.

use equipoise_adapters::suit::{SuitAssembler, SuitSettings, TypeSet};
use equipoise_adapters::wire::mvn::{Cut, Datagram, DatagramType, Layout, StreamCutter};
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
    let body = Some(Layout { body: 23, props: 0, fingers: 0 });
    assert_eq!((euler_header.layout(), header.layout()), (body, body));
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

/// Verifies the statements of docs/identification.md about one null pose and one pose of a person.
#[test]
fn bones_of_the_null_pose_are_those_of_the_pose() {
    let (Some(scale), Some(pose)) = (wire_file("mxtp13.bin"), wire_file("mxtp02.bin")) else { return };
    let settings = SuitSettings { required: Some(TypeSet::POSE_QUATERNION), ..SuitSettings::default() };
    let mut assembler = SuitAssembler::new(settings);
    assert!(assembler.receive(&scale, 1).is_none());
    let sample = assembler.receive(&pose, 2).expect("a sample");
    let null_pose_m = assembler.subject().null_pose.origins_m.expect("a null pose");
    let length_m = |at_m: &[[f64; 3]; SEGMENTS], segment: Segment, parent: Segment| {
        let (to, from) = (at_m[segment.index()], at_m[parent.index()]);
        (0..3).map(|axis| (to[axis] - from[axis]).powi(2)).sum::<f64>().sqrt()
    };
    let differences_mm = Segment::ALL.into_iter().filter_map(|segment| {
        let parent = segment.parent()?;
        let lengths_m = [&sample.position_m, &null_pose_m].map(|at_m| length_m(at_m, segment, parent));
        Some(1e3 * (lengths_m[0] - lengths_m[1]).abs())
    });
    let largest_mm = differences_mm.fold(0.0, f64::max);
    assert!((2.2..2.25).contains(&largest_mm), "{largest_mm} mm");
}

/// The datagrams of a file with a big-endian u32 length before each.
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
    // Types 02, 20, 21, 22 and 24; as required types, so that no frame waits for its successor.
    let required = [
        TypeSet::POSE_QUATERNION,
        TypeSet::JOINT_ANGLES,
        TypeSet::LINEAR_KINEMATICS,
        TypeSet::ANGULAR_KINEMATICS,
        TypeSet::CENTRE_OF_MASS,
    ];
    let required = required.into_iter().reduce(TypeSet::and);
    let mut assembler = SuitAssembler::new(SuitSettings { required, ..SuitSettings::default() });
    let mut samples: Vec<SuitSample> = Vec::new();
    for (index, datagram) in datagrams.iter().enumerate() {
        if let Err(malformed) = Datagram::parse(datagram) {
            panic!("datagram {index}: {malformed}");
        }
        samples.extend(assembler.receive(datagram, 1_000_000 * index as u64));
    }
    let frames = expected["frames"].as_array().unwrap();
    assert_eq!((samples.len(), datagrams.len()), (frames.len(), 7 * frames.len()));
    let lengths: Vec<usize> = datagrams[..7].iter().map(|datagram| datagram.len()).collect();
    assert_eq!(lengths, [760, 464, 944, 1036, 1180, 36, 40]);
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
    assert_rates(&samples);
    assert_eq!(assembler.counts().refused.iter().sum::<u64>(), 0);
}

/// Type 22 against type 02: for a rotating segment, the angular rate equals the difference of its orientations, in
/// rad/s. Uses the median, as a foot that is anchored to the floor jumps without a rate.
fn assert_rates(samples: &[SuitSample]) {
    const PERIOD_S: f64 = 1.0 / 240.0;
    const TURNS_RAD_PER_S: f64 = 5e-3;
    let mut ratios = Vec::new();
    for pair in samples.windows(2) {
        for segment in 0..SEGMENTS {
            let [bw, bx, by, bz] = pair[0].orientation_wxyz[segment];
            let [aw, ax, ay, az] = pair[1].orientation_wxyz[segment];
            // Twice the vector part of `after · before⁻¹` is the rotation, for small angles.
            let turn_rad = [
                2.0 * (-aw * bx + ax * bw - ay * bz + az * by),
                2.0 * (-aw * by + ax * bz + ay * bw - az * bx),
                2.0 * (-aw * bz - ax * by + ay * bx + az * bw),
            ];
            for (axis, turn_rad) in turn_rad.into_iter().enumerate() {
                let rates = [0, 1].map(|at: usize| pair[at].angular_velocity_rad_per_s[segment][axis]);
                let rate = (rates[0] + rates[1]) / 2.0;
                if rate.abs() > TURNS_RAD_PER_S {
                    ratios.push(turn_rad / PERIOD_S / rate);
                }
            }
        }
    }
    ratios.sort_by(f64::total_cmp);
    assert!(ratios.len() > 50, "{} turns", ratios.len());
    let median = ratios[ratios.len() / 2];
    assert!((0.95..1.05).contains(&median), "{median}: not rad/s");
}

#[test]
fn real_datagrams_are_cut_out_of_a_byte_stream_as_they_were() {
    let names = ["mxtp01.bin", "mxtp02.bin", "mxtp12.bin", "mxtp13.bin"];
    let Some(mut sent) = names.into_iter().map(wire_file).collect::<Option<Vec<_>>>() else { return };
    let Some(recording) = wire_file("meri020.mxtp.bin") else { return };
    sent.extend(length_prefixed(&recording).into_iter().map(<[u8]>::to_vec));
    let stream = sent.concat();
    for portion in [1, 7, 1448, 65_536] {
        let mut cutter = StreamCutter::new();
        let mut cut = Vec::new();
        for bytes in stream.chunks(portion) {
            cutter.push(bytes);
            while let Some(what) = cutter.advance() {
                assert_eq!(what, Cut::Datagram, "in portions of {portion}");
                cut.push(cutter.datagram().to_vec());
            }
        }
        assert_eq!(cut, sent, "in portions of {portion}");
    }
}

#[test]
fn euler_poses_alone_make_the_sample_that_quaternions_make() {
    let (Some(euler), Some(quaternion)) = (wire_file("mxtp01.bin"), wire_file("mxtp02.bin")) else { return };
    let sample = |required, bytes: &[u8]| {
        let settings = SuitSettings { required: Some(required), ..SuitSettings::default() };
        SuitAssembler::new(settings).receive(bytes, 1).expect("a sample")
    };
    let from_euler = sample(TypeSet::POSE_EULER, &euler);
    let from_quaternion = sample(TypeSet::POSE_QUATERNION, &quaternion);
    assert_eq!((from_euler.device_counter, from_euler.device_time_ms), (6681, 27837));
    for segment in 0..SEGMENTS {
        for axis in 0..3 {
            let apart = from_euler.position_m[segment][axis] - from_quaternion.position_m[segment][axis];
            assert!(apart.abs() < 2e-7, "{segment}: {apart} m");
        }
    }
    // Both in one sample: the quaternions are used, in either order.
    for datagrams in [[&euler, &quaternion], [&quaternion, &euler]] {
        let required = Some(TypeSet::POSE_EULER.and(TypeSet::POSE_QUATERNION));
        let mut assembler = SuitAssembler::new(SuitSettings { required, ..SuitSettings::default() });
        assert!(assembler.receive(datagrams[0], 1).is_none());
        let both = assembler.receive(datagrams[1], 1).expect("a sample");
        assert_eq!(both.position_m, from_quaternion.position_m);
    }
}

#[test]
fn lengths_and_types_are_what_the_headers_say() {
    for (name, length, kind) in [
        ("mxtp01.bin", 668, DatagramType::POSE_EULER),
        ("mxtp02.bin", 760, DatagramType::POSE_QUATERNION),
        ("mxtp12.bin", 82, DatagramType::META),
        ("mxtp13.bin", 595, DatagramType::SCALE),
    ] {
        let Some(bytes) = wire_file(name) else { return };
        let header = *Datagram::parse(&bytes).unwrap().header().expect("a header");
        assert_eq!((bytes.len(), header.datagram_type), (length, kind), "{name}");
        assert_eq!(usize::from(header.payload_size), length - 24, "{name}");
        for cut in 0..bytes.len() {
            assert!(Datagram::parse(&bytes[..cut]).is_err(), "{name} cut at {cut}");
        }
    }
}
