//! What the loop knows: one message per cycle, for every consumer.

use super::layout::{ZeroCopySend, message};
use super::validity::Validity;
use crate::body::{JOINTS, SEGMENTS};

message! {
    /// Everything the pipeline says, once per cycle. World: X forward, Y left, Z up, the station's origin.
    ///
    /// A value may be used only if none of its invalid reasons ([`Validity`]) is raised in `valid`; an invalid value is zero
    /// and means nothing. Nothing here is ever NaN, and nothing is repeated past its age.
    ///
    /// Everything measured belongs to one time, `suit_sample_time_ns`. Compensating inertia needs samples from both
    /// sides of that time, so it lies `group_delay_ns` behind the newest suit sample; the ages say the whole truth.
    as "equipoise/State/5", 2752 bytes,
    pub struct State {
        /// The cycle's number in this daemon's life, from 1.
        pub cycle: u64,
        /// When the cycle was due, CLOCK_MONOTONIC.
        pub time_ns: u64,
        /// The suit sample that the values below belong to; 0 before the first.
        pub suit_sample_time_ns: u64,
        /// Age of the newest suit sample at `time_ns`.
        pub suit_age_ns: u64,
        /// Age of the newest ground sample at `time_ns`.
        pub ground_age_ns: u64,
        /// How far `suit_sample_time_ns` lies behind the newest suit sample that was worked through.
        pub group_delay_ns: u64,
        /// Reasons why values must not be used: bits of [`Validity`].
        pub valid: u64,
        /// A [`Phase`].
        pub phase: u32,
        /// 1 while the worker holds still (20-sample window).
        pub static_pose: u32,
        /// 1 once the stop rule of the identification is met.
        pub converged: u32,
        /// Held poses that entered the filter.
        pub poses_used: u32,
        /// Grows by one with every step of the feet.
        pub stance: u32,
        /// Index of the suggested pose in `core::pose_suggestion::LIBRARY`; `u32::MAX` when none is asked for.
        pub suggested_pose: u32,
        /// Suit samples in motion that entered the filter (`method = "static+dynamic"`).
        pub motion_samples_used: u32,
        /// Where `zeta` comes from: a [`SharingSource`].
        pub sharing_source: u32,
        /// Index of the joint that comes closest to its limit; `u32::MAX` while no torque is published.
        pub worst_joint: u32,
        /// Lifts that entered the cumulative dose.
        pub lifts: u32,
        /// Where the worker's bones come from: a `core::cycle::BodySource`.
        pub body_source: u32,
        /// Where the outline of the soles comes from: a [`SoleSource`].
        pub sole_source: u32,
        /// Why the body dimensions that the suit sent last are not used: a `core::cycle::BodyRefusal`.
        pub body_refused: u32,
        /// What this station's sensors do not give: a union of [`NotGiven`] bits. Those values are zero and mean
        /// nothing, whatever `valid` says.
        pub not_given: u32,
        /// Where the body's accelerations come from: an [`AccelerationSource`].
        pub acceleration_source: u32,
        /// What the ground's sample was made of: a union of `GroundDevice` bits.
        pub ground_devices: u32,
        /// Overload level per joint: a `core::overload::Level`.
        pub joint_level: [u32; JOINTS],
        /// Measured centre of pressure, m.
        pub cop_measured_m: [f64; 2],
        /// 1-σ of `cop_measured_m`, m.
        pub cop_measured_sigma_m: [f64; 2],
        /// Centre of pressure that the unloaded body would have in this motion, by the identified model, m.
        pub cop_estimated_m: [f64; 2],
        /// 1-σ of `cop_estimated_m`, m.
        pub cop_sigma_m: [f64; 2],
        /// Estimated centre of mass of the unloaded body, m.
        pub com_m: [f64; 3],
        /// The suit maker's own centre of mass, held to the floor as the segments are, m; see `not_given`.
        pub suit_com_m: [f64; 3],
        /// Ground reaction force on the person, N; see `not_given` for its horizontal part.
        pub ground_force_n: [f64; 3],
        /// External force carried: measured ground reaction less what the body alone needs in this motion, N.
        pub delta_f_n: [f64; 3],
        /// 1-σ of the vertical `delta_f_n`, N.
        pub delta_f_sigma_n: f64,
        /// Body mass in use, kg.
        pub mass_kg: f64,
        /// Share of the ground reaction under the left and the right foot.
        pub zeta: [f64; 2],
        /// Share of the load in the left and the right hand.
        pub eta: [f64; 2],
        /// 1-σ of `zeta`: the two errors are equal and opposite.
        pub zeta_sigma: f64,
        /// 1-σ of `eta`: the two errors are equal and opposite.
        pub eta_sigma: f64,
        /// Horizontal distance from the load to the line between the hands, m.
        pub load_distance_m: f64,
        /// Mass in the hands, kg.
        pub lifted_mass_kg: f64,
        /// 1-σ of `lifted_mass_kg`, kg.
        pub lifted_mass_sigma_kg: f64,
        /// Horizontal distance from the middle of the ankles to the load, m.
        pub reach_m: f64,
        /// 1-σ of `reach_m`, m.
        pub reach_sigma_m: f64,
        /// Largest variance of an identified parameter, m² (the paper's P_jj).
        pub variance_max_m2: f64,
        /// Predicted 1-σ of the CoP over the poses of the library, m.
        pub predicted_cop_sigma_m: f64,
        /// Normalised innovation squared of the last pose (2 degrees of freedom); 0 before the first.
        pub nis: f64,
        /// How much the prior's covariance was inflated because this worker did not fit it; 1 if not at all.
        pub prior_inflation: f64,
        /// How far the worker is from the suggested pose: RMS joint angle, or the turn of the body that is still to be
        /// made, rad.
        pub pose_mismatch_rad: f64,
        /// How much later than the ground's the suit's sample times are than they should be, s.
        pub suit_skew_s: f64,
        /// 1-σ of `suit_skew_s`, s; 0 while the motion has not shown the skew.
        pub suit_skew_sigma_s: f64,
        /// Net moment at L5/S1 of upper body and load about the horizontal axes, N m.
        pub l5s1_moment_nm: f64,
        /// 1-σ of `l5s1_moment_nm`, N m.
        pub l5s1_moment_sigma_nm: f64,
        /// Estimated compression of the L5/S1 disc, N.
        pub l5s1_compression_n: f64,
        /// 1-σ of `l5s1_compression_n`, N.
        pub l5s1_compression_sigma_n: f64,
        /// Cumulative damage of the low back after LiFFT (Gallagher 2017), 1 being failure.
        pub dose_damage: f64,
        /// Probability of a high-risk job by that dose, in [0, 1].
        pub dose_probability: f64,
        /// Unit vector, world: where the load should move to relieve the worst joint; zero if nowhere.
        pub advice_direction: [f64; 3],
        /// By how much that relieves it, N m per centimetre.
        pub advice_gain_nm_per_cm: f64,
        /// Segment origins in the station's world, m.
        pub segment_origin_m: [[f64; 3]; SEGMENTS],
        /// Overload torque per joint (Eq. 15), world axes, N m.
        pub torque_nm: [[f64; 3]; JOINTS],
        /// 1-σ of each torque's magnitude, N m.
        pub torque_sigma_nm: [f64; JOINTS],
        /// Covariance of the horizontal components of each torque, (N m)²: xx, xy, yy. The vertical component has no σ.
        pub torque_covariance_nm2: [[f64; 3]; JOINTS],
        /// τ_max of each joint for this worker, N m.
        pub torque_limit_nm: [f64; JOINTS],
        /// Overloading fatigue of each joint, in [0, 1] (Lorenzini et al. 2019).
        pub fatigue: [f64; JOINTS],
        /// When egress handed the state to the bus, CLOCK_MONOTONIC; 0 while the loop has it. The one field that a replay
        /// does not repeat.
        pub published_ns: u64,
    }
}

/// What sensors may not give, as bits of `not_given`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum NotGiven {
    /// `suit_com_m`: the suit does not send it (MVN type 24).
    SuitCom = 1,
    /// The horizontal part of `ground_force_n`: insoles feel only what presses on them.
    Shear = 1 << 1,
}

impl NotGiven {
    /// All, lowest bit first, with their public names.
    pub const NAMES: [(NotGiven, &'static str); 2] =
        [(NotGiven::SuitCom, "suit_com"), (NotGiven::Shear, "shear")];
}

/// Where the outline of the soles comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum SoleSource {
    /// Shares of stature.
    Stature = 0,
    /// The suit's points of the feet (MVN type 13).
    Suit = 1,
}

impl SoleSource {
    /// The source of a message's number, `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<SoleSource> {
        [SoleSource::Stature, SoleSource::Suit].into_iter().nth(number as usize)
    }

    /// The public name.
    pub fn name(self) -> &'static str {
        match self {
            SoleSource::Stature => "stature",
            SoleSource::Suit => "suit",
        }
    }
}

/// Where the accelerations of the body come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum AccelerationSource {
    /// The positions of several samples, differentiated twice.
    Positions = 0,
    /// The suit's own accelerations of the segments (MVN type 21).
    Suit = 1,
}

impl AccelerationSource {
    /// The source of a message's number, `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<AccelerationSource> {
        [AccelerationSource::Positions, AccelerationSource::Suit].into_iter().nth(number as usize)
    }

    /// The public name.
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
pub enum SharingSource {
    /// From where the centre of pressure lies between the ankles.
    Geometry = 0,
    /// Measured under each foot.
    Measured = 1,
}

impl SharingSource {
    /// The source of a message's number, `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<SharingSource> {
        [SharingSource::Geometry, SharingSource::Measured].into_iter().nth(number as usize)
    }

    /// The public name.
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
pub enum Phase {
    /// Sensors are not there yet, or identification is not started.
    Waiting = 0,
    /// Held poses feed the filter.
    Identifying = 1,
    /// The model is identified; overload is published.
    Monitoring = 2,
    /// A sensor fell silent; the model is kept and the phase before it returns by itself.
    Degraded = 3,
}

impl Phase {
    /// The phase of a message's number, `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<Phase> {
        [Phase::Waiting, Phase::Identifying, Phase::Monitoring, Phase::Degraded]
            .into_iter()
            .nth(number as usize)
    }

    /// The public name, lower case.
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
    /// The reasons raised in this state.
    pub fn validity(&self) -> Validity {
        Validity(self.valid)
    }

    /// The public name of the phase.
    pub fn phase_name(&self) -> &'static str {
        Phase::from_number(self.phase).map_or("unknown", Phase::name)
    }

    /// Whether the station's sensors give something.
    pub fn gives(&self, what: NotGiven) -> bool {
        self.not_given & what as u32 == 0
    }

    /// The suit maker's own centre of mass, m; `None` unless it is sent and the suit is there.
    pub fn suit_com_m(&self) -> Option<[f64; 3]> {
        self.unless(Validity::SUIT_STALE, self.suit_com_m).filter(|_| self.gives(NotGiven::SuitCom))
    }

    /// `value` unless a reason of `spoilers` is raised.
    pub fn unless<T>(&self, spoilers: Validity, value: T) -> Option<T> {
        (!self.validity().any_of(spoilers)).then_some(value)
    }
}
