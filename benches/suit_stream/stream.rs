//! A second of all MVN streams, repeated with advancing counters.

use equipoise_adapters::wire::mvn::{
    AngularKinematics, CentreOfMass, Header, JointAngle, LinearKinematics, SegmentPose, angular_kinematics,
    centre_of_mass, joint_angles, joint_angles::BODY_JOINT_POINTS, linear_kinematics, pose_quaternion,
};
use equipoise_simulator::wires::mvn::Stamp;
use equipoise_simulator::wires::mvn::describe::time_of_day;
use equipoise_simulator::wires::mvn::items::{Tracker, trackers};

/// Sample rate of a suit with cables.
pub(crate) const RATE_HZ: usize = 240;
const PERIOD_NS: u64 = 1_000_000_000 / RATE_HZ as u64;
/// Segments that wear a motion tracker.
const TRACKERS: usize = 17;
/// Joints of the body and the ergonomic ones.
const JOINTS: usize = 28;
/// Finger segments of both hands.
const FINGERS: usize = 40;

/// The datagrams of a second, sample by sample.
pub(crate) struct Stream {
    datagrams: Vec<Vec<u8>>,
    per_sample: usize,
    seconds: u32,
}

impl Stream {
    pub(crate) fn new(gloves: bool) -> Stream {
        let samples: Vec<Vec<Vec<u8>>> = (0..RATE_HZ).map(|index| sample(index as u32, gloves)).collect();
        let per_sample = samples.first().map_or(0, Vec::len);
        Stream { datagrams: samples.concat(), per_sample, seconds: 0 }
    }

    /// The next second: the same bodies with later counters, each datagram with its arrival.
    pub(crate) fn next_second(&mut self) -> impl Iterator<Item = (&[u8], u64)> {
        let first = self.seconds * RATE_HZ as u32;
        self.seconds += 1;
        let per_sample = self.per_sample;
        self.datagrams.iter_mut().enumerate().map(move |(index, datagram)| {
            let counter = first + (index / per_sample) as u32;
            datagram[6..10].copy_from_slice(&counter.to_be_bytes());
            (&datagram[..], 1_000_000_000 + u64::from(counter) * PERIOD_NS)
        })
    }

    /// The same as a byte stream.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        self.datagrams.concat()
    }

    pub(crate) fn datagrams(&self) -> usize {
        self.datagrams.len()
    }
}

/// All datagrams of one sample of a standing, swaying person.
fn sample(counter: u32, gloves: bool) -> Vec<Vec<u8>> {
    let segments = if gloves { 23 + FINGERS } else { 23 };
    let sway = (counter as f32 * 0.026).sin();
    let header = Header {
        finger_segments: if gloves { FINGERS as u8 } else { 0 },
        ..Header::new(counter, counter * 25 / 6, 0)
    };
    let ids = 1..=segments as u32;
    let orientation_wxyz = [(1.0 - 0.01 * sway * sway).sqrt(), 0.1 * sway, 0.0, 0.0];
    let position = |id: u32| {
        let height = if id > 15 { 0.1 } else { 0.9 + id as f32 / 20.0 };
        [0.02 * sway, 0.01 * id as f32, height]
    };
    let motion = [0.01 * sway, -0.02 * sway, 0.003];
    let poses: Vec<_> = ids
        .clone()
        .map(|segment_id| SegmentPose { segment_id, position_m: position(segment_id), orientation_wxyz })
        .collect();
    let linear: Vec<_> = ids
        .clone()
        .map(|segment_id| LinearKinematics {
            segment_id,
            position_m: position(segment_id),
            velocity_m_per_s: motion,
            acceleration_m_per_s2: motion,
        })
        .collect();
    let angular: Vec<_> = ids
        .map(|segment_id| AngularKinematics {
            segment_id,
            orientation_wxyz,
            angular_velocity_rad_per_s: motion,
            angular_acceleration_rad_per_s2: motion,
        })
        .collect();
    let joints: Vec<_> = (0..JOINTS)
        .map(|index| {
            let (parent_point, child_point) =
                BODY_JOINT_POINTS.get(index).copied().unwrap_or((0x0500, 0x0700));
            JointAngle { parent_point, child_point, angle_deg: motion }
        })
        .collect();
    // The adapters do not read these types, but MVN sends them.
    let stamp = Stamp {
        segments: [23, 0, header.finger_segments],
        ..Stamp::of_a_body(counter, header.time_code_ms, 0)
    };
    let tracker = Tracker {
        segment_id: 1,
        orientation_wxyz,
        free_acceleration: motion,
        felt: Some([[0.0, 0.0, 9.81], motion]),
        magnetic: [0.4, 0.0, -0.8],
    };
    let moving = centre_of_mass::Motion { velocity_m_per_s: motion, acceleration_m_per_s2: motion };
    let com = CentreOfMass { position_m: [0.0, 0.0, 1.0], motion: Some(moving) };
    let at_ms = 57_586_000 + counter * 25 / 6;
    let mut datagrams = Vec::new();
    let mut append = |encode: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = Vec::new();
        encode(&mut bytes);
        datagrams.push(bytes);
    };
    const FITS: &str = "63 items fit one datagram";
    append(&|out| pose_quaternion::encode(&header, &poses, out).expect(FITS));
    append(&|out| joint_angles::encode(&header, &joints, out).expect(FITS));
    append(&|out| linear_kinematics::encode(&header, &linear, out).expect(FITS));
    append(&|out| angular_kinematics::encode(&header, &angular, out).expect(FITS));
    append(&|out| out.extend(trackers(&stamp, &[tracker; TRACKERS]).expect(FITS)));
    append(&|out| centre_of_mass::encode(&header, &com, out).expect(FITS));
    append(&|out| out.extend(time_of_day(&stamp, at_ms, true).expect(FITS)));
    datagrams
}
