//! Valid inputs, generated rather than recorded, as starting points of mutations.

use std::net::SocketAddr;

use bytemuck::Zeroable;
use equipoise_adapters::capture::PcapWriter;
use equipoise_adapters::recording::{Recorder, RecordingHeader};
use equipoise_adapters::wire::ati_rdt::{Record, Request};
use equipoise_adapters::wire::mvn::centre_of_mass::CentreOfMass;
use equipoise_adapters::wire::mvn::scale::{NullPoseSegment, SegmentPoint};
use equipoise_adapters::wire::mvn::{
    AngularKinematics, Datagram, EulerPose, Header, JointAngle, LinearKinematics, SegmentPose,
    angular_kinematics, centre_of_mass, joint_angles, linear_kinematics, meta, pose_euler, pose_quaternion,
    scale,
};
use equipoise_core::body::{JOINTS, Segment, Skeleton};
use equipoise_core::message::{GroundSample, SuitSample};

/// The generated datagrams of one sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    PoseQuaternion,
    PoseEuler,
    LinearKinematics,
    AngularKinematics,
    JointAngles,
    CentreOfMass,
    Meta,
    Scale,
}

impl Part {
    /// All of them.
    pub(crate) const ALL: [Part; 8] = [
        Part::PoseQuaternion,
        Part::PoseEuler,
        Part::LinearKinematics,
        Part::AngularKinematics,
        Part::JointAngles,
        Part::CentreOfMass,
        Part::Meta,
        Part::Scale,
    ];
}

/// One datagram of a person in the T pose who turns.
pub(crate) fn part(part: Part, counter: u32, time_s: f64) -> Vec<u8> {
    let header = Header::new(counter, (time_s * 1e3) as u32, 0);
    let [cos, sin] = [(time_s * 0.2).cos() as f32, (time_s * 0.2).sin() as f32];
    let poses = poses(cos, sin);
    let mut out = Vec::new();
    match part {
        Part::PoseQuaternion => pose_quaternion::encode(&header, &poses, &mut out),
        Part::PoseEuler => {
            let euler: Vec<_> = poses.iter().map(EulerPose::from_z_up).collect();
            pose_euler::encode(&header, &euler, &mut out)
        }
        Part::LinearKinematics => {
            let items: Vec<_> = poses.iter().map(|pose| linear(pose, cos, sin)).collect();
            linear_kinematics::encode(&header, &items, &mut out)
        }
        Part::AngularKinematics => {
            let items: Vec<_> = poses.iter().map(angular).collect();
            angular_kinematics::encode(&header, &items, &mut out)
        }
        Part::JointAngles => {
            let items: Vec<_> = (0..JOINTS as u32).map(|joint| angles(joint, sin)).collect();
            joint_angles::encode(&header, &items, &mut out)
        }
        Part::CentreOfMass => {
            let com = CentreOfMass { position_m: [0.0, 0.0, 1.0], motion: None };
            centre_of_mass::encode(&header, &com, &mut out)
        }
        Part::Meta => meta::encode(&header, &[("name", "anon-1"), ("timeOffset", "-3600000")], &mut out),
        Part::Scale => {
            let segments: Vec<_> = Segment::ALL
                .into_iter()
                .zip(&poses)
                .map(|(segment, pose)| NullPoseSegment { name: segment.name(), origin_m: pose.position_m })
                .collect();
            let point = SegmentPoint {
                segment_id: 18,
                point_id: 3,
                name: "pRightHeelFoot",
                flags: 0,
                offset_m: [-0.04, 0.0, -0.08],
            };
            scale::encode(&header, &segments, &[point], &mut out)
        }
    }
    .unwrap();
    assert!(Datagram::parse(&out).is_ok());
    out
}

fn poses(cos: f32, sin: f32) -> Vec<SegmentPose> {
    let origins = Skeleton::nominal(1.75).t_pose_m().map(|[x, y, z]| [x as f32, y as f32, z as f32 + 0.95]);
    let pose = |(index, position_m): (usize, [f32; 3])| SegmentPose {
        segment_id: index as u32 + 1,
        position_m,
        orientation_wxyz: [cos, 0.0, 0.0, sin],
    };
    origins.into_iter().enumerate().map(pose).collect()
}

fn linear(pose: &SegmentPose, cos: f32, sin: f32) -> LinearKinematics {
    LinearKinematics {
        segment_id: pose.segment_id,
        position_m: pose.position_m,
        velocity_m_per_s: [0.1, sin, 0.0],
        acceleration_m_per_s2: [0.0, cos, 0.0],
    }
}

fn angular(pose: &SegmentPose) -> AngularKinematics {
    AngularKinematics {
        segment_id: pose.segment_id,
        orientation_wxyz: pose.orientation_wxyz,
        angular_velocity_rad_per_s: [0.0, 0.0, 0.4],
        angular_acceleration_rad_per_s2: [0.0; 3],
    }
}

fn angles(joint: u32, sin: f32) -> JointAngle {
    JointAngle {
        parent_point: (joint + 1) << 8 | 2,
        child_point: (joint + 2) << 8 | 1,
        angle_deg: [1.0, sin * 10.0, 20.0],
    }
}

/// One of each type.
pub(crate) fn mvn_datagrams() -> Vec<Vec<u8>> {
    let json = b"{\"type\":\"transport\",\"value\":\"record\"}".to_vec();
    // As in the specification, without a length before the text.
    let bare_time = b"MXTP25\0!\0\0\x02\x80\x01\0\0\0\x08\0\x17\0\0\0\0\x0c07:59:46.280".to_vec();
    Part::ALL.into_iter().map(|kind| part(kind, 7, 0.5)).chain([json, bare_time]).collect()
}

/// Choices for [`super::suit::assembler`]: whole samples in order, then a new session.
pub(crate) fn mvn_sessions() -> Vec<Vec<u8>> {
    let plain: Vec<u8> = (0..60).flat_map(|_| [0, 8, 1, 0]).collect();
    let all_types: Vec<u8> = (0..20_u8)
        .flat_map(|_| (0..6_u8).flat_map(|kind| [kind, u8::from(kind == 0) * 8, u8::from(kind == 0), 0]))
        .collect();
    let restarted: Vec<u8> = [&plain[..], &[0, 8, 255, 0, 0, 0], &plain[..]].concat();
    vec![plain, all_types, restarted]
}

/// Requests, one record, several, and a sequence of datagrams.
pub(crate) fn rdt() -> Vec<Vec<u8>> {
    let record = |sequence: u32| Record {
        rdt_sequence: sequence,
        ft_sequence: sequence * 7,
        status: 0,
        force_counts: [1_000_000, -2_000_000, -700_000_000],
        torque_counts: [10, -20, 30],
    };
    let one = record(1).to_bytes().to_vec();
    let three: Vec<u8> = (1..4).flat_map(|sequence| record(sequence).to_bytes()).collect();
    let sequence: Vec<u8> =
        (1..40).flat_map(|index| [&[36, 0, 10][..], &record(index).to_bytes()].concat()).collect();
    let requests = [vec![0x12, 0x34, 0, 2, 0, 0, 0, 0], vec![0x12, 0x34, 0, 0, 0, 0, 0, 1]];
    assert!(requests.iter().all(|bytes| Request::parse(bytes).is_ok()));
    [one, three, sequence].into_iter().chain(requests).collect()
}

/// A capture of suit and plate, and the same bytes after other headers.
pub(crate) fn pcap() -> Vec<Vec<u8>> {
    let address = |text: &str| text.parse::<SocketAddr>().unwrap();
    let mut writer = PcapWriter::new(Vec::new()).unwrap();
    let [suit, daemon] = [address("192.168.0.7:51000"), address("192.168.0.9:9763")];
    writer.write_udp(1_700_000_000_000_000_000, suit, daemon, &part(Part::CentreOfMass, 1, 0.0)).unwrap();
    let [plate, daemon] = [address("[::1]:49152"), address("[::1]:51001")];
    writer.write_udp(1_700_000_000_004_000_000, plate, daemon, &rdt()[0]).unwrap();
    let raw = writer.finish().unwrap();
    let mut null = raw.clone();
    null[20] = 0;
    vec![raw, null, pcapng(1), pcapng(113)]
}

/// A section, an interface and a packet that is not IP.
fn pcapng(link_type: u8) -> Vec<u8> {
    let block = |kind: u32, body: &[u8]| {
        let length = (12 + body.len() as u32).to_le_bytes();
        [&kind.to_le_bytes()[..], &length, body, &length].concat()
    };
    let section = [&0x1a2b_3c4d_u32.to_le_bytes()[..], &[1, 0, 0, 0], &u64::MAX.to_le_bytes()].concat();
    let packet = [&[0; 12][..], &[32, 0, 0, 0, 32, 0, 0, 0], &[0x45; 32]].concat();
    [block(0x0a0d_0d0a, &section), block(1, &[link_type, 0, 0, 0, 0, 0, 0, 0]), block(6, &packet)].concat()
}

/// Two small files, of version 3 and 4, with two frames.
pub(crate) fn mvnx() -> Vec<Vec<u8>> {
    let origins = Skeleton::nominal(1.75).t_pose_m();
    let segments: String = Segment::ALL
        .into_iter()
        .map(|segment| format!("<segment label=\"{}\"><points><point label=\"p\"><pos_b>0 0 0.1</pos_b></point></points></segment>", segment.name()))
        .collect();
    let joints: String = Segment::ALL
        .into_iter()
        .skip(1)
        .map(|segment| format!("<joint label=\"j\"><connector2>{}/j</connector2></joint>", segment.name()))
        .collect();
    let turn = "1 0 0 0 ".repeat(Segment::ALL.len());
    let place: String = origins.iter().flatten().map(|metres| format!("{metres} ")).collect();
    let pose = format!("<orientation>{turn}</orientation><position>{place}</position>");
    let file = |version: u32, null: &str| {
        let frames: String = (0..2)
            .map(|index| {
                let angles = "1 2 3 ".repeat(JOINTS);
                let ms = 1_700_000_000_000_u64 + index * 4;
                format!(
                    "<frame time=\"{}\" index=\"{index}\" ms=\"{ms}\" type=\"normal\">{pose}<jointAngle>{angles}</jointAngle>\
                     <centerOfMass>0 0 1</centerOfMass></frame>", index * 4)
            })
            .collect();
        format!(
            "<mvnx version=\"{version}\"><subject label=\"a &amp; b\" frameRate=\"240\"><segments>{segments}</segments>\
             <joints>{joints}</joints><frames><frame type=\"{null}\">{pose}</frame>{frames}</frames></subject></mvnx>"
        )
        .into_bytes()
    };
    vec![file(3, "npose"), file(4, "identity")]
}

/// The three layouts; the first byte selects the declarations.
pub(crate) fn bioware() -> Vec<Vec<u8>> {
    let texts = [
        (
            0,
            "abs time (s)\tFx\tFy\tFz\tMx\tMy\tMz\ns\tN\tN\tN\tN.m\tN.m\tN.m\n0\t1\t2\t700\t1\t2\t3\n0,001\t1\t2\t7e2\t1\t2\t3\n",
        ),
        (1, "BioWare\nabs time;Fx;Fy;Fz;Ax;Ay;Tz\n0;1;2;700;0,1;0,2;1\n0,001;1;2;700;0,1;0,2;1\n"),
        (5, "time,fx12,fx34,fy14,fy23,fz1,fz2,fz3,fz4\n0,1,2,3,4,100,200,100,200\n0.5,1,2,3,4,1,2,3,4\n"),
        (
            0x22,
            "time (s),Fx (N),Fy (N),Fz (N),Ax (mm),Ay (mm),Fx (N),Fy (N),Fz (N),Ax (mm),Ay (mm)\n0,1,2,3,4,5,6,7,8,9,10\n",
        ),
    ];
    texts.into_iter().map(|(declared, text)| [&[declared], text.as_bytes()].concat()).collect()
}

/// Two rows of the standard layout.
pub(crate) fn csv() -> Vec<Vec<u8>> {
    let mut head = "t_s".to_owned();
    let mut row = String::new();
    for segment in Segment::ALL {
        for part in ["px_m", "py_m", "pz_m", "qw", "qx", "qy", "qz"] {
            head += &format!(",{}_{part}", segment.name());
        }
        row += ",0,0,1,1,0,0,0";
    }
    vec![
        format!("{head},Fx_N,Fy_N,Fz_N,Mx_Nm,My_Nm,Mz_Nm\n0{row},1,2,700,3,4,5\n0.01{row},1,2,700,3,4,5\n")
            .into_bytes(),
    ]
}

/// A short recording.
pub(crate) fn recordings() -> Vec<Vec<u8>> {
    let header =
        RecordingHeader { config_toml: "station = \"a\"\n".to_owned(), ..RecordingHeader::default() };
    let mut recorder = Recorder::in_memory("seed.mcap", &header).unwrap();
    for index in 1..4_u64 {
        recorder.write(index * 1000, &SuitSample { sequence: index, ..Zeroable::zeroed() }).unwrap();
        recorder.write(index * 1000 + 1, &GroundSample { sequence: index, ..Zeroable::zeroed() }).unwrap();
    }
    vec![recorder.into_bytes().unwrap()]
}

/// Two streams with a stomp each.
pub(crate) fn stomps() -> Vec<Vec<u8>> {
    let mut seed = vec![100];
    for step in 0..200_u16 {
        let hit = (80..86).contains(&(step % 120));
        let force: u16 = if hit { 60_000 } else { 20_000 };
        // Increasing downward speed, then at rest.
        let falls = (60..80).contains(&(step % 120));
        let speed = if falls { (-4 * (step % 120 - 60).cast_signed()) as i8 } else { 0 }.cast_unsigned();
        seed.extend([40, 40]);
        seed.extend(force.to_le_bytes());
        seed.extend([speed, 0]);
    }
    vec![seed]
}
