//! A motion-capture suit as MVN streams it: frames to datagrams to an address.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

use crate::faults::{Faults, FaultySender};
use crate::kinematics::{centre_m, relative_to_parents};
use crate::motion::Worker;
use crate::noise::Suit;
use crate::wire::{SuitFrame, introduction, joint_angles_deg};

/// Half the span of the differences that give velocity and acceleration, s.
const DIFFERENCE_S: f64 = 0.004;

/// Which optional datagrams are ticked in MVN's streaming options.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Streams {
    /// Type 20.
    pub joint_angles: bool,
    /// Type 21.
    pub linear_kinematics: bool,
    /// Type 24.
    pub centre_of_mass: bool,
}

impl Default for Streams {
    fn default() -> Streams {
        Streams { joint_angles: true, linear_kinematics: true, centre_of_mass: true }
    }
}

/// How the suit's world lies in the station's: a turn about Z and a shift.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SuitWorld {
    /// Origin of the suit's world in the station's, m.
    pub origin_m: [f64; 3],
    /// Turn of the suit's axes in the station's, rad.
    pub yaw_rad: f64,
}

/// The frame that the suit sends of a worker at a time; the counter is the number of the sample.
pub fn frame(
    worker: &Worker,
    suit: &Suit,
    world: SuitWorld,
    streams: Streams,
    avatar: u8,
    (sample_counter, rate_hz): (u32, f64),
) -> SuitFrame {
    let time_s = f64::from(sample_counter) / rate_hz;
    // MVN cuts the counter's time to whole milliseconds.
    let device = (sample_counter, (time_s * 1000.0) as u32);
    frame_at(worker, suit, world, streams, avatar, time_s, device)
}

/// The same at a time that is not the counter's; `device` is the suit's own counter and time, ms.
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
    let motion = streams.linear_kinematics.then(|| {
        let h = DIFFERENCE_S;
        let ((before, _), (after, _)) = (see(time_s - h), see(time_s + h));
        std::array::from_fn(|i| {
            let velocity = (after[i] - before[i]) / (2.0 * h);
            let acceleration = ((after[i] - origin_m[i]) - (origin_m[i] - before[i])) / (h * h);
            [velocity.into(), acceleration.into()]
        })
    });
    let com = |origin_m: &[nalgebra::Point3<f64>]| {
        // MVN's own model is an average body, not this one.
        let average = crate::person::Person::nominal(worker.person().height_m, worker.person().mass_kg);
        let coms: Vec<_> =
            (0..origin_m.len()).map(|i| origin_m[i].coords + rotation[i] * average.com_m[i]).collect();
        centre_m(&average.segment_mass_kg, &coms).into()
    };
    SuitFrame {
        sample_counter,
        time_code_ms,
        avatar,
        position_m: origin_m.map(|origin| origin.coords.into()),
        orientation_wxyz: rotation.map(|q| [q.w, q.i, q.j, q.k]),
        motion,
        joint_angle_deg: streams.joint_angles.then(|| joint_angles_deg(&relative_to_parents(&rotation))),
        com_m: streams.centre_of_mass.then(|| com(&origin_m)),
    }
}

/// Sends frames over UDP.
#[derive(Debug)]
pub struct SuitSender {
    socket: UdpSocket,
    target: SocketAddr,
    network: FaultySender,
}

impl SuitSender {
    /// A sender to an address.
    ///
    /// # Errors
    /// Those of the socket.
    pub fn new(target: SocketAddr, faults: Faults, seed: u64) -> io::Result<SuitSender> {
        let any: SocketAddr = match target {
            SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
            SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
        };
        Ok(SuitSender { socket: UdpSocket::bind(any)?, target, network: FaultySender::new(faults, seed) })
    }

    /// The network is another from the next datagram on.
    pub fn set_faults(&mut self, faults: Faults) {
        self.network.set_faults(faults);
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
        for datagram in datagrams {
            self.network.send(&self.socket, &datagram, self.target)?;
        }
        Ok(())
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
