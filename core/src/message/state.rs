//! The result of each cycle: the message for every consumer.

use super::layout::{ZeroCopySend, message};
use super::validity::Validity;
use crate::body::{JOINTS, SEGMENTS};

message! {
    /// Result of one cycle. All vectors are in the station's world: X forward, Y left, Z up, origin of the station.
    ///
    /// A value is valid only if no flag that invalidates it ([`Validity`]) is raised in `valid`; invalid values are
    /// zero. No value is NaN, and no value is repeated after its maximum age.
    ///
    /// All results refer to one time, `suit_sample_time_ns`. The compensation of the body's inertia needs samples
    /// before and after that time, so it is `group_delay_ns` before the newest suit sample.
    as "equipoise/State/5", 2752 bytes,
    pub struct State {
        /// Number of the cycle since the daemon's start, from 1.
        pub cycle: u64,
        /// Due time of the cycle, CLOCK_MONOTONIC ns.
        pub time_ns: u64,
        /// Sample time that the results refer to, CLOCK_MONOTONIC ns; 0 before the first sample.
        pub suit_sample_time_ns: u64,
        /// Age of the newest suit sample at `time_ns`, ns.
        pub suit_age_ns: u64,
        /// Age of the newest ground sample at `time_ns`, ns; `u64::MAX` before the first.
        pub ground_age_ns: u64,
        /// Delay of `suit_sample_time_ns` behind the newest processed suit sample, ns.
        pub group_delay_ns: u64,
        /// Invalid reasons: bits of [`Validity`]; 0 if all values are valid.
        pub valid: u64,
        /// A [`Phase`].
        pub phase: u32,
        /// 1 while the pose is static (window of 20 samples).
        pub static_pose: u32,
        /// 1 after the stop criterion of the identification is met.
        pub converged: u32,
        /// Number of static poses that updated the filter.
        pub poses_used: u32,
        /// Number of the stance: increments at every step of the feet.
        pub stance: u32,
        /// Index of the suggested pose in `core::pose_suggestion::LIBRARY`; `u32::MAX` if none is suggested.
        pub suggested_pose: u32,
        /// Number of motion samples that updated the filter (`method = "static+dynamic"`).
        pub motion_samples_used: u32,
        /// Source of `foot_load_fraction`: a [`SharingSource`].
        pub sharing_source: u32,
        /// Index of the joint closest to its torque limit; `u32::MAX` while no torque is valid.
        pub worst_joint: u32,
        /// Number of lifts in the cumulative dose.
        pub lifts: u32,
        /// Source of the segment lengths: a `core::cycle::BodySource`.
        pub body_source: u32,
        /// Source of the foot outlines: a [`FootOutlineSource`].
        pub foot_outline_source: u32,
        /// Reason why the last body dimensions from the suit are not used: a `core::cycle::BodyRejection`.
        pub body_rejected: u32,
        /// Quantities that this station's sensors do not provide: a union of [`Unavailable`] bits. They are zero and
        /// invalid, regardless of `valid`.
        pub unavailable: u32,
        /// Source of the body's accelerations: an [`AccelerationSource`].
        pub acceleration_source: u32,
        /// Devices in the ground sample: a union of `GroundDevice` bits.
        pub ground_devices: u32,
        /// Overload level of each joint: a `core::overload::Level`.
        pub joint_level: [u32; JOINTS],
        /// Measured centre of pressure, world x and y, m.
        pub cop_measured_m: [f64; 2],
        /// 1-σ of `cop_measured_m` per axis, m.
        pub cop_measured_sigma_m: [f64; 2],
        /// Centre of pressure of the same motion without the load, by the identified model, world x and y, m.
        pub cop_estimated_m: [f64; 2],
        /// 1-σ of `cop_estimated_m` per axis, m.
        pub cop_sigma_m: [f64; 2],
        /// Estimated centre of mass of the unloaded body, world, m.
        pub com_m: [f64; 3],
        /// Centre of mass computed by the suit's software, anchored to the floor as the segments are, world, m; see
        /// `unavailable`.
        pub suit_com_m: [f64; 3],
        /// Ground reaction force on the person, world axes, N; see `unavailable` for its horizontal part.
        pub ground_force_n: [f64; 3],
        /// External force: measured ground reaction minus that of the unloaded body in the same motion, world axes, N;
        /// x and y: always 0, not published.
        pub delta_f_n: [f64; 3],
        /// 1-σ of the vertical component of `delta_f_n`, N.
        pub delta_f_sigma_n: f64,
        /// Body mass in use, kg.
        pub mass_kg: f64,
        /// ζ: fraction of the ground reaction under the left and the right foot, 0 to 1.
        pub foot_load_fraction: [f64; 2],
        /// η: fraction of the load in the left and the right hand, 0 to 1.
        pub hand_load_fraction: [f64; 2],
        /// 1-σ of `foot_load_fraction`; the errors of the two feet are equal and opposite.
        pub foot_load_fraction_sigma: f64,
        /// 1-σ of `hand_load_fraction`; the errors of the two hands are equal and opposite.
        pub hand_load_fraction_sigma: f64,
        /// Horizontal distance of the load from the line between the hands, m.
        pub load_hand_distance_m: f64,
        /// Mass of the load in the hands, kg.
        pub lifted_mass_kg: f64,
        /// 1-σ of `lifted_mass_kg`, kg.
        pub lifted_mass_sigma_kg: f64,
        /// Horizontal distance of the load from the midpoint of the ankles, m.
        pub reach_m: f64,
        /// 1-σ of `reach_m`, m.
        pub reach_sigma_m: f64,
        /// Largest variance of an identified parameter, m² (P_jj in the paper).
        pub variance_max_m2: f64,
        /// Predicted 1-σ of the centre of pressure over the pose library, m.
        pub predicted_cop_sigma_m: f64,
        /// Normalised innovation squared of the last static pose, 2 degrees of freedom; 0 before the first.
        pub nis: f64,
        /// Factor on the prior's covariance after a conflict with the first poses, ≥ 1; 1 without a conflict, 0 before
        /// the filter's start.
        pub prior_inflation: f64,
        /// Difference from the suggested pose: RMS joint angle, or the remaining rotation of the whole body, rad.
        pub pose_mismatch_rad: f64,
        /// Skew: estimated delay of the suit's sample times relative to the ground's, s.
        pub suit_skew_s: f64,
        /// 1-σ of `suit_skew_s`, s; 0 until unloaded motion has determined the skew.
        pub suit_skew_sigma_s: f64,
        /// Net moment of upper body and load at L5/S1 about the horizontal axes, N m.
        pub l5s1_moment_nm: f64,
        /// 1-σ of `l5s1_moment_nm`, N m.
        pub l5s1_moment_sigma_nm: f64,
        /// Estimated compression of the L5/S1 disc, N.
        pub l5s1_compression_n: f64,
        /// 1-σ of `l5s1_compression_n`, N.
        pub l5s1_compression_sigma_n: f64,
        /// Cumulative damage of the low back, 1 at failure (LiFFT, Gallagher et al. 2017).
        pub dose_damage: f64,
        /// Probability of a high-risk job at this dose, 0 to 1.
        pub dose_probability: f64,
        /// Direction in which a motion of the load relieves the worst joint: unit vector, world axes; zero if no motion
        /// does.
        pub advice_direction: [f64; 3],
        /// Reduction of the worst joint's torque by a motion in that direction, N m per cm.
        pub advice_gain_nm_per_cm: f64,
        /// Segment origins (proximal joint centres) in MVN order, world, m; with `position_unknown`, their position and
        /// heading on the floor are not those of the station.
        pub segment_origin_m: [[f64; 3]; SEGMENTS],
        /// Overload torque of each joint (Eq. 15), world axes, N m.
        pub torque_nm: [[f64; 3]; JOINTS],
        /// 1-σ of the magnitude of each overload torque, N m.
        pub torque_sigma_nm: [f64; JOINTS],
        /// Covariance of the horizontal components of each overload torque: xx, xy, yy, (N m)². The vertical component
        /// has none.
        pub torque_covariance_nm2: [[f64; 3]; JOINTS],
        /// Torque limit τ_max of each joint of this subject, N m.
        pub torque_limit_nm: [f64; JOINTS],
        /// Overloading fatigue of each joint, 0 to 1 (Lorenzini et al. 2019).
        pub fatigue: [f64; JOINTS],
        /// Time at which egress passed the state to the bus, CLOCK_MONOTONIC ns; 0 within the loop. The only field that
        /// differs in a replay.
        pub published_ns: u64,
    }
}

/// What sensors may not give, as bits of `unavailable`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
/// Quantities that sensors may not provide, as bits of `unavailable`.
pub enum Unavailable {
    /// `suit_com_m`: the suit does not send it (MVN type 24).
    SuitCom = 1,
    /// Horizontal components of `ground_force_n`: insoles measure only normal forces.
    Shear = 1 << 1,
}

impl Unavailable {
    /// All bits with their public names, lowest first.
    pub const NAMES: [(Unavailable, &'static str); 2] =
        [(Unavailable::SuitCom, "suit_com"), (Unavailable::Shear, "shear")];
}

/// Where the outline of the soles comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
/// Source of the foot outlines.
pub enum FootOutlineSource {
    /// Fractions of the stature.
    Stature = 0,
    /// Points of the feet from the suit's software (MVN type 13).
    Suit = 1,
}

impl FootOutlineSource {
    /// Source with this number; `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<FootOutlineSource> {
        [FootOutlineSource::Stature, FootOutlineSource::Suit].into_iter().nth(number as usize)
    }

    /// Public name.
    pub fn name(self) -> &'static str {
        match self {
            FootOutlineSource::Stature => "stature",
            FootOutlineSource::Suit => "suit",
        }
    }
}

/// Where the accelerations of the body come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
/// Source of the body's accelerations.
pub enum AccelerationSource {
    /// Second derivative of the positions of several samples.
    Positions = 0,
    /// Accelerations of the segments from the suit (MVN type 21).
    Suit = 1,
}

impl AccelerationSource {
    /// Source with this number; `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<AccelerationSource> {
        [AccelerationSource::Positions, AccelerationSource::Suit].into_iter().nth(number as usize)
    }

    /// Public name.
    pub fn name(self) -> &'static str {
        match self {
            AccelerationSource::Positions => "positions",
            AccelerationSource::Suit => "suit",
        }
    }
}

/// How the feet's shares of the ground reaction are known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
/// Source of the foot load fractions.
pub enum SharingSource {
    /// Position of the centre of pressure between the ankles.
    Geometry = 0,
    /// Measured force under each foot.
    Measured = 1,
}

impl SharingSource {
    /// Source with this number; `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<SharingSource> {
        [SharingSource::Geometry, SharingSource::Measured].into_iter().nth(number as usize)
    }

    /// Public name.
    pub fn name(self) -> &'static str {
        match self {
            SharingSource::Geometry => "geometry",
            SharingSource::Measured => "measured",
        }
    }
}

/// What the pipeline is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
/// Phase of the pipeline.
pub enum Phase {
    /// Sensors provide no samples, or identification is not started.
    Waiting = 0,
    /// Static poses update the filter.
    Identifying = 1,
    /// The model is identified; overload is published.
    Monitoring = 2,
    /// A sensor is silent; the model is kept, and the previous phase returns with the sensor.
    Degraded = 3,
}

impl Phase {
    /// Phase with this number; `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<Phase> {
        [Phase::Waiting, Phase::Identifying, Phase::Monitoring, Phase::Degraded]
            .into_iter()
            .nth(number as usize)
    }

    /// Public name.
    pub fn name(self) -> &'static str {
        match self {
            Phase::Waiting => "waiting",
            Phase::Identifying => "identifying",
            Phase::Monitoring => "monitoring",
            Phase::Degraded => "degraded",
        }
    }
}

impl State {
    /// Invalid reasons of this state.
    pub fn validity(&self) -> Validity {
        Validity(self.valid)
    }

    /// Public name of the phase.
    pub fn phase_name(&self) -> &'static str {
        Phase::from_number(self.phase).map_or("unknown", Phase::name)
    }

    /// Whether the station's sensors provide a quantity.
    pub fn provides(&self, what: Unavailable) -> bool {
        self.unavailable & what as u32 == 0
    }

    /// Centre of mass computed by the suit's software, world, m; `None` if it is unavailable, or if the pose or its
    /// position is invalid.
    pub fn suit_com_m(&self) -> Option<[f64; 3]> {
        self.unless(Validity::INVALIDATES_SUIT_COM, self.suit_com_m)
            .filter(|_| self.provides(Unavailable::SuitCom))
    }

    /// Segment origins, world, m; `None` while the pose is invalid. With [`Validity::POSITION_UNKNOWN`] their
    /// position and heading on the floor are arbitrary.
    pub fn segment_origin_m(&self) -> Option<&[[f64; 3]; SEGMENTS]> {
        self.unless(Validity::INVALIDATES_POSE, &self.segment_origin_m)
            .filter(|_| self.suit_sample_time_ns != 0)
    }

    /// Difference from the suggested pose, rad; `None` if none is suggested or the pose is invalid.
    pub fn pose_mismatch_rad(&self) -> Option<f64> {
        self.unless(Validity::INVALIDATES_POSE, self.pose_mismatch_rad)
            .filter(|_| self.suggested_pose != u32::MAX)
    }

    /// `value`, or `None` if a flag of `invalidating` is raised.
    pub fn unless<T>(&self, invalidating: Validity, value: T) -> Option<T> {
        (!self.validity().any_of(invalidating)).then_some(value)
    }
}
