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

/// A standing, swaying person at one instant.
struct Person {
    /// Deflection, −1 to 1.
    sway: f32,
}

impl Person {
    fn position(&self, segment_id: u32) -> [f32; 3] {
        let height = if segment_id > 15 { 0.1 } else { 0.9 + segment_id as f32 / 20.0 };
        [0.02 * self.sway, 0.01 * segment_id as f32, height]
    }

    fn orientation_wxyz(&self) -> [f32; 4] {
        [(1.0 - 0.01 * self.sway * self.sway).sqrt(), 0.1 * self.sway, 0.0, 0.0]
    }

    /// Every velocity, acceleration and angle.
    fn motion(&self) -> [f32; 3] {
        [0.01 * self.sway, -0.02 * self.sway, 0.003]
    }

    fn pose(&self, segment_id: u32) -> SegmentPose {
        SegmentPose {
            segment_id,
            position_m: self.position(segment_id),
            orientation_wxyz: self.orientation_wxyz(),
        }
    }

    fn linear(&self, segment_id: u32) -> LinearKinematics {
        LinearKinematics {
            segment_id,
            position_m: self.position(segment_id),
            velocity_m_per_s: self.motion(),
            acceleration_m_per_s2: self.motion(),
        }
    }

    fn angular(&self, segment_id: u32) -> AngularKinematics {
        AngularKinematics {
            segment_id,
            orientation_wxyz: self.orientation_wxyz(),
            angular_velocity_rad_per_s: self.motion(),
            angular_acceleration_rad_per_s2: self.motion(),
        }
    }

    fn joint(&self, index: usize) -> JointAngle {
        let (parent_point, child_point) = BODY_JOINT_POINTS.get(index).copied().unwrap_or((0x0500, 0x0700));
        JointAngle { parent_point, child_point, angle_deg: self.motion() }
    }

    fn tracker(&self) -> Tracker {
        Tracker {
            segment_id: 1,
            orientation_wxyz: self.orientation_wxyz(),
            free_acceleration: self.motion(),
            measured: Some([[0.0, 0.0, 9.81], self.motion()]),
            magnetic: [0.4, 0.0, -0.8],
        }
    }

    fn com(&self) -> CentreOfMass {
        let (velocity_m_per_s, acceleration_m_per_s2) = (self.motion(), self.motion());
        let motion = centre_of_mass::Motion { velocity_m_per_s, acceleration_m_per_s2 };
        CentreOfMass { position_m: [0.0, 0.0, 1.0], motion: Some(motion) }
    }
}

/// All datagrams of one sample.
fn sample(counter: u32, gloves: bool) -> Vec<Vec<u8>> {
    let segments = if gloves { 23 + FINGERS } else { 23 };
    let person = Person { sway: (counter as f32 * 0.026).sin() };
    let header = Header {
        finger_segments: if gloves { FINGERS as u8 } else { 0 },
        ..Header::new(counter, counter * 25 / 6, 0)
    };
    let ids = 1..=segments as u32;
    let poses: Vec<_> = ids.clone().map(|id| person.pose(id)).collect();
    let linear: Vec<_> = ids.clone().map(|id| person.linear(id)).collect();
    let angular: Vec<_> = ids.map(|id| person.angular(id)).collect();
    let joints: Vec<_> = (0..JOINTS).map(|index| person.joint(index)).collect();
    let com = person.com();
    // The adapters do not read these types, but MVN sends them.
    let stamp = Stamp {
        segments: [23, 0, header.finger_segments],
        ..Stamp::of_a_body(counter, header.time_code_ms, 0)
    };
    let trackers_of_body = [person.tracker(); TRACKERS];
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
    append(&|out| out.extend(trackers(&stamp, &trackers_of_body).expect(FITS)));
    append(&|out| centre_of_mass::encode(&header, &com, out).expect(FITS));
    append(&|out| out.extend(time_of_day(&stamp, at_ms, true).expect(FITS)));
    datagrams
}
