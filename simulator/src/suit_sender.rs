//! A motion-capture suit as MVN streams it: frames to datagrams to an address.

use std::io;
use std::net::SocketAddr;

use crate::devices::line::Line;
use crate::devices::tcp::TcpOutPort;
use crate::devices::udp::UdpPort;
use crate::faults::Faults;
use crate::kinematics::{centre_m, relative_to_parents};
use crate::motion::Worker;
use crate::noise::Suit;
use crate::suit_more::{SegmentPoses, more};
use crate::wire::{More, SuitFrame, introduction, joint_angles_deg};

/// Half the span of the differences for velocity and acceleration, s.
const DIFFERENCE_S: f64 = 0.004;

/// Selected optional datagrams, as in MVN's streaming options.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Streams {
    /// Type 20.
    pub joint_angles: bool,
    /// Type 21.
    pub linear_kinematics: bool,
    /// Type 24.
    pub centre_of_mass: bool,
    /// Leave out type 02, which is sent by default.
    pub without_quaternions: bool,
    /// Type 01.
    pub euler: bool,
    /// Type 05.
    pub unity: bool,
    /// Type 03.
    pub markers: bool,
    /// Ergonomic angles behind the joints of type 20.
    pub ergonomic: bool,
    /// Type 22.
    pub angular: bool,
    /// Type 23.
    pub trackers: bool,
    /// Velocity and acceleration in type 24.
    pub com_motion: bool,
    /// Type 25.
    pub time_of_day: bool,
    /// Types 23 to 25 in the sizes of older versions.
    pub old_sizes: bool,
    /// With gloves: 40 finger segments with every pose.
    pub fingers: bool,
    /// Props in the right hand, 0 to 4.
    pub props: u8,
}

impl Streams {
    /// Type 02 alone.
    pub const NONE: Streams = Streams {
        joint_angles: false,
        linear_kinematics: false,
        centre_of_mass: false,
        without_quaternions: false,
        euler: false,
        unity: false,
        markers: false,
        ergonomic: false,
        angular: false,
        trackers: false,
        com_motion: false,
        time_of_day: false,
        old_sizes: false,
        fingers: false,
        props: 0,
    };

    /// All streams, without gloves and props.
    pub const ALL: Streams = Streams {
        joint_angles: true,
        linear_kinematics: true,
        centre_of_mass: true,
        euler: true,
        unity: true,
        markers: true,
        ergonomic: true,
        angular: true,
        trackers: true,
        com_motion: true,
        time_of_day: true,
        ..Streams::NONE
    };
}

impl Default for Streams {
    fn default() -> Streams {
        Streams { joint_angles: true, linear_kinematics: true, centre_of_mass: true, ..Streams::NONE }
    }
}

/// The suit's world in the station's: a rotation about Z and a translation.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SuitWorld {
    /// Origin of the suit's world in the station's, m.
    pub origin_m: [f64; 3],
    /// Rotation of the suit's axes in the station's, rad.
    pub yaw_rad: f64,
}

/// The suit's frame of a worker at a time; the counter is the number of the sample.
pub fn frame(
    worker: &Worker,
    suit: &Suit,
    world: SuitWorld,
    streams: Streams,
    avatar: u8,
    (sample_counter, rate_hz): (u32, f64),
) -> SuitFrame {
    let time_s = f64::from(sample_counter) / rate_hz;
    // MVN truncates the counter's time to whole milliseconds.
    let device = (sample_counter, (time_s * 1000.0) as u32);
    frame_at(worker, suit, world, streams, avatar, time_s, device)
}

/// The same at a time other than the counter's; `device` is the suit's own counter and time, ms.
pub fn frame_at(
    worker: &Worker,
    suit: &Suit,
    world: SuitWorld,
    streams: Streams,
    avatar: u8,
    time_s: f64,
    (sample_counter, time_code_ms): (u32, u32),
) -> SuitFrame {
    let suit_from_station = nalgebra::Isometry3::new(
        nalgebra::Vector3::from(world.origin_m),
        nalgebra::Vector3::z() * world.yaw_rad,
    )
    .inverse();
    let see = |time_s: f64| {
        let (origin_m, rotation) = suit.see(worker.person(), &worker.sample(time_s));
        let origin_m = origin_m.map(|origin| suit_from_station * nalgebra::Point3::from(origin));
        (origin_m, rotation.map(|rotation| suit_from_station.rotation * rotation))
    };
    let (origin_m, rotation) = see(time_s);
    let h = DIFFERENCE_S;
    let differs = streams.linear_kinematics || streams.angular || streams.trackers || streams.com_motion;
    // Evaluate the neighbouring times only if derivatives are sent: they triple the work.
    let [before, after] =
        if differs { [-h, h].map(|step_s| see(time_s + step_s)) } else { [(origin_m, rotation); 2] };
    let motion_of = |[before, now, after]: [nalgebra::Vector3<f64>; 3]| {
        let velocity = (after - before) / (2.0 * h);
        let acceleration = ((after - now) - (now - before)) / (h * h);
        [velocity.into(), acceleration.into()]
    };
    let motion = streams.linear_kinematics.then(|| {
        std::array::from_fn(|i| motion_of([before.0[i].coords, origin_m[i].coords, after.0[i].coords]))
    });
    let com = |(origin_m, rotation): &SegmentPoses| {
        // MVN's own model is an average body, not this subject's.
        let average = crate::person::Person::nominal(worker.person().height_m, worker.person().mass_kg);
        let coms: Vec<_> =
            (0..origin_m.len()).map(|i| origin_m[i].coords + rotation[i] * average.com_m[i]).collect();
        centre_m(&average.segment_mass_kg, &coms)
    };
    let now = (origin_m, rotation);
    let com_motion = streams.com_motion.then(|| motion_of([&before, &now, &after].map(com)));
    let com_m = streams.centre_of_mass.then(|| com(&now).into());
    let grip_m = &worker.person().grip_m;
    SuitFrame {
        sample_counter,
        time_code_ms,
        avatar,
        position_m: origin_m.map(|origin| origin.coords.into()),
        orientation_wxyz: rotation.map(|q| [q.w, q.i, q.j, q.k]),
        motion,
        joint_angle_deg: streams.joint_angles.then(|| joint_angles_deg(&relative_to_parents(&rotation))),
        com_m,
        more: More { com_motion, ..more(streams, time_code_ms, grip_m, &[before, now, after], h) },
    }
}

/// Sends frames over UDP, or over TCP to a listening receiver.
pub struct SuitSender(Line);

impl SuitSender {
    /// A sender to an address over UDP.
    ///
    /// # Errors
    /// Those of the socket.
    pub fn new(target: SocketAddr, faults: Faults, seed: u64) -> io::Result<SuitSender> {
        Ok(SuitSender::over(Line::new(Box::new(UdpPort::to(target)?), seed), faults))
    }

    /// A sender that connects to an address over TCP, retrying until it succeeds.
    pub fn over_tcp(target: SocketAddr, faults: Faults, seed: u64) -> SuitSender {
        SuitSender::over(Line::new(Box::new(TcpOutPort::to(target)), seed), faults)
    }

    fn over(mut line: Line, faults: Faults) -> SuitSender {
        line.set_faults(faults);
        SuitSender(line)
    }

    /// Replaces the faults from the next datagram on.
    pub fn set_faults(&mut self, faults: Faults) {
        self.0.set_faults(faults);
    }

    /// Sends all datagrams of a frame.
    ///
    /// # Errors
    /// Those of the socket.
    pub fn send(&mut self, frame: &SuitFrame) -> io::Result<()> {
        self.send_all(frame.datagrams().map_err(io::Error::other)?)
    }

    /// Sends name and null pose of a person.
    ///
    /// # Errors
    /// Those of the socket.
    pub fn introduce(&mut self, person: &crate::person::Person, avatar: u8) -> io::Result<()> {
        self.send_all(introduction(person, avatar).map_err(io::Error::other)?)
    }

    fn send_all(&mut self, datagrams: impl IntoIterator<Item = Vec<u8>>) -> io::Result<()> {
        // Over TCP this connects the sender and detects a closed receiver.
        let _ignored = self.0.port().receive()?;
        datagrams.into_iter().try_for_each(|datagram| self.0.send(&datagram, 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Habits;
    use crate::noise::SuitNoise;
    use crate::person::Person;
    use core::f64::consts::FRAC_PI_2;

    #[test]
    fn a_suit_turned_to_the_left_sees_the_toes_to_its_right() {
        let worker = Worker::with_habits(Person::nominal(1.77, 72.0), 1, Habits::NONE);
        let suit = Suit::new(SuitNoise::NONE, 1);
        let world = SuitWorld { origin_m: [0.5, 0.0, 0.0], yaw_rad: FRAC_PI_2 };
        let seen = frame(&worker, &suit, world, Streams::default(), 0, (6, 60.0));
        let ankle = worker.stance().ankle_m[0];
        let foot = seen.position_m[equipoise_core::body::Segment::LeftFoot.index()];
        assert!((foot[0] - ankle.y).abs() < 1e-9 && (foot[1] - (0.5 - ankle.x)).abs() < 1e-9, "{foot:?}");
        let toe = seen.position_m[equipoise_core::body::Segment::LeftToe.index()];
        assert!(toe[1] < foot[1] - 0.1);
    }

    #[test]
    fn a_seed_gives_the_same_frames_and_another_seed_others() {
        let at = |seed: u64| {
            let worker = Worker::new(Person::new(seed, 1.77, 72.0), seed);
            let suit = Suit::new(SuitNoise::ORDINARY, seed);
            frame(&worker, &suit, SuitWorld::default(), Streams::default(), 0, (600, 60.0))
        };
        assert_eq!(at(1), at(1));
        assert_ne!(at(1), at(2));
    }
}
