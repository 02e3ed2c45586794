//! Samples of the suit: the whole body.

use nalgebra::Vector3;

use super::layout::{Message, ZeroCopySend, message};
use crate::body::SEGMENTS;
use crate::frame::{Pose, SuitWorld, Turn, rotation};

message! {
    /// Sample of a motion-capture suit, in the suit's own world (X forward, Y left, Z up, m).
    ///
    /// The suit's global position drifts; only `core::anchor` transforms it to the station's world. Only the suit
    /// adapter publishes it. Segments are in MVN order ([`crate::body::Segment`]).
    as "equipoise/Suit/1", 3584 bytes,
    pub struct SuitSample {
        /// Time of the measurement by the stream's clock fit, CLOCK_MONOTONIC ns of the host.
        pub sample_time_ns: u64,
        /// 1-σ of `sample_time_ns`, ns; `u64::MAX` while the clock fit has too few points, or if
        /// the time since the previous sample is unknown.
        pub sample_time_sigma_ns: u64,
        /// Kernel's receive stamp of the sample's first datagram, CLOCK_MONOTONIC ns.
        pub arrival_ns: u64,
        /// Time of publication by the adapter, CLOCK_MONOTONIC ns.
        pub published_ns: u64,
        /// Number of the sample since the adapter's start, from 1.
        pub sequence: u64,
        /// Sample counter of the suit (MVN header, bytes 6–9).
        pub device_counter: u32,
        /// Time code of the suit, ms (MVN header, bytes 12–15).
        pub device_time_ms: u32,
        /// Increments when the suit's counter restarts.
        pub session: u32,
        /// Character ID in MVN.
        pub avatar: u32,
        /// Optional blocks in this sample: a union of [`SuitBlocks`] bits. Other blocks are zero and invalid.
        pub blocks: u32,
        /// Increments when `sample_time_ns` moves relative to the counter by more than 50 ms: the delay has changed, or
        /// the suit paused.
        pub clock_epoch: u32,
        /// Segment origins (proximal joint centres), suit world, m.
        pub position_m: [[f64; 3]; SEGMENTS],
        /// Rotation `suitworld_from_segment`, unit quaternion, scalar first.
        pub orientation_wxyz: [[f64; 4]; SEGMENTS],
        /// Velocity of the segment origins, suit world, m/s (MVN type 21).
        pub velocity_m_per_s: [[f64; 3]; SEGMENTS],
        /// Acceleration of the segment origins, suit world, m/s² (MVN type 21).
        pub acceleration_m_per_s2: [[f64; 3]; SEGMENTS],
        /// Angular velocity of the segments, suit world, rad/s (MVN type 22).
        pub angular_velocity_rad_per_s: [[f64; 3]; SEGMENTS],
        /// Joint angles: abduction, axial rotation, flexion, degrees (MVN type 20).
        pub joint_angle_deg: [[f64; 3]; SEGMENTS - 1],
        /// Centre of mass computed by the suit's software, suit world, m (MVN type 24).
        pub com_m: [f64; 3],
        /// Always zero; pads the message to a multiple of 64 bytes.
        pub reserved_tail: [u64; 3],
    }
}

/// The optional blocks of a [`SuitSample`], as bits of `blocks`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
/// Optional blocks of a [`SuitSample`], as bits of `blocks`.
pub enum SuitBlocks {
    /// `velocity_m_per_s` and `acceleration_m_per_s2`.
    LinearKinematics = 1,
    /// `angular_velocity_rad_per_s`.
    AngularKinematics = 1 << 1,
    /// `joint_angle_deg`.
    JointAngles = 1 << 2,
    /// `com_m`.
    CentreOfMass = 1 << 3,
}

/// Maximum distance of a body from the origin, m.
const POSITION_MAX_M: f64 = 1e4;

impl SuitSample {
    /// Whether the numbers are possible for a body: finite, within bounds, with unit quaternions.
    pub fn is_possible(&self) -> bool {
        let is_turn = |q: &[f64; 4]| (q.iter().map(|part| part * part).sum::<f64>() - 1.0).abs() < 1e-3;
        self.is_finite()
            && self.position_m.iter().flatten().all(|metres| metres.abs() < POSITION_MAX_M)
            && self.orientation_wxyz.iter().all(is_turn)
    }

    /// Pose of the body in the suit's world. The adapter has normalised the quaternions.
    pub fn pose(&self) -> Pose<SuitWorld> {
        Pose::new(self.position_m.map(Vector3::from), self.orientation_wxyz.map(rotation))
    }

    /// This sample in a world rotated about the vertical axis through its origin.
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

    /// Whether this sample contains an optional block.
    pub fn has(&self, block: SuitBlocks) -> bool {
        self.blocks & block as u32 != 0
    }
}
