//! What the suit says: one sample of the whole body.

use nalgebra::Vector3;

use super::layout::{Message, ZeroCopySend, message};
use crate::body::SEGMENTS;
use crate::frame::{Pose, SuitWorld, Turn, rotation};

message! {
    /// One sample of a motion-capture suit, in the suit's own world (X forward, Y left, Z up, metres).
    ///
    /// The suit's global position drifts; only `core::anchor` may turn it into the station's world.
    /// Written by the suit adapter only. Segments stand in MVN order ([`crate::body::Segment`]).
    as "equipoise/Suit/1", 3584 bytes,
    pub struct SuitSample {
        /// When the sample was taken, on the host's CLOCK_MONOTONIC, by the stream's clock fit.
        pub sample_time_ns: u64,
        /// 1-σ of `sample_time_ns`; `u64::MAX` while the clock fit has too few points.
        pub sample_time_sigma_ns: u64,
        /// Kernel receive stamp of the sample's first datagram, CLOCK_MONOTONIC.
        pub arrival_ns: u64,
        /// When the adapter published it, CLOCK_MONOTONIC.
        pub published_ns: u64,
        /// Counts the samples this adapter published, from 1.
        pub sequence: u64,
        /// The suit's own sample counter (MVN header, bytes 6–9).
        pub device_counter: u32,
        /// The suit's own time code, ms (MVN header, bytes 12–15).
        pub device_time_ms: u32,
        /// Grows by one whenever the suit's counter restarts.
        pub session: u32,
        /// MVN character id.
        pub avatar: u32,
        /// Which optional blocks below were sent: a union of [`SuitBlocks`] bits. Others are all zero and mean nothing.
        pub blocks: u32,
        /// Always zero.
        pub reserved: u32,
        /// Segment origins (proximal joint centres), m.
        pub position_m: [[f64; 3]; SEGMENTS],
        /// `suitworld_from_segment`, scalar first, unit norm.
        pub orientation_wxyz: [[f64; 4]; SEGMENTS],
        /// Velocity of the segment origins, m/s (type 21).
        pub velocity_m_per_s: [[f64; 3]; SEGMENTS],
        /// Acceleration of the segment origins, m/s² (type 21).
        pub acceleration_m_per_s2: [[f64; 3]; SEGMENTS],
        /// Angular velocity in the suit's world, rad/s (type 22).
        pub angular_velocity_rad_per_s: [[f64; 3]; SEGMENTS],
        /// Joint angles: abduction, axial rotation, flexion; degrees (type 20).
        pub joint_angle_deg: [[f64; 3]; SEGMENTS - 1],
        /// The suit maker's own centre of mass, m (type 24).
        pub com_m: [f64; 3],
        /// Always zero; fills the message to a multiple of 64 bytes.
        pub reserved_tail: [u64; 3],
    }
}

/// The optional blocks of a [`SuitSample`], as bits of `blocks`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum SuitBlocks {
    /// `velocity_m_per_s` and `acceleration_m_per_s2` are there.
    LinearKinematics = 1,
    /// `angular_velocity_rad_per_s` is there.
    AngularKinematics = 1 << 1,
    /// `joint_angle_deg` is there.
    JointAngles = 1 << 2,
    /// `com_m` is there.
    CentreOfMass = 1 << 3,
}

/// No body is farther from the origin, m.
const POSITION_MAX_M: f64 = 1e4;

impl SuitSample {
    /// Whether its numbers can be a body's: finite, not out of the world, unit quaternions.
    pub fn is_possible(&self) -> bool {
        let is_turn = |q: &[f64; 4]| (q.iter().map(|part| part * part).sum::<f64>() - 1.0).abs() < 1e-3;
        self.is_finite()
            && self.position_m.iter().flatten().all(|metres| metres.abs() < POSITION_MAX_M)
            && self.orientation_wxyz.iter().all(is_turn)
    }

    /// Where the body is, in the suit's own world. The adapter has normalised the quaternions.
    pub fn pose(&self) -> Pose<SuitWorld> {
        Pose::new(self.position_m.map(Vector3::from), self.orientation_wxyz.map(rotation))
    }

    /// The same sample, its world turned about the vertical through its origin.
    #[must_use]
    pub fn turned(&self, turn: Turn) -> SuitSample {
        let vectors = |vectors: &[[f64; 3]; SEGMENTS]| vectors.map(|vector| turn.of_vector(vector));
        SuitSample {
            position_m: vectors(&self.position_m),
            orientation_wxyz: self.orientation_wxyz.map(|orientation| turn.of_wxyz(orientation)),
            velocity_m_per_s: vectors(&self.velocity_m_per_s),
            acceleration_m_per_s2: vectors(&self.acceleration_m_per_s2),
            angular_velocity_rad_per_s: vectors(&self.angular_velocity_rad_per_s),
            com_m: turn.of_vector(self.com_m),
            ..*self
        }
    }

    /// Whether an optional block was sent with this sample.
    pub fn has(&self, block: SuitBlocks) -> bool {
        self.blocks & block as u32 != 0
    }
}
