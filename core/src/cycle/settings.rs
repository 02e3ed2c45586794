//! Constant settings of a cycle: subject, method, thresholds.

use crate::body::Sex;
use crate::effect::Model;
use crate::math;
pub use crate::motion::Accelerations;
use crate::overload::TorqueLimits;
use crate::pose_suggestion::Posture;
use crate::sesc::ReductionKind;
pub use crate::sesc::Similar;
use crate::static_pose::Thresholds;

/// Distribution of the parameters before the first pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PriorKind {
    /// No prior information.
    None,
    /// The anthropometric table and its spread.
    Table,
    /// A stored subject of similar build, [`Settings::similar`]; the table if there is none.
    SimilarSubject,
}

/// Measurements that update the filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Static poses, as in the paper.
    Static,
    /// Static poses, and natural motion without a load through the moment and force rows.
    StaticAndDynamic,
}

/// Criterion for the next suggested pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoseChoice {
    /// Eq. 11: largest distance from the poses performed, weighted by P_jj.
    Paper,
    /// Largest decrease of `log det P`.
    DOptimal,
    /// Largest decrease of `tr P`.
    AOptimal,
    /// Largest decrease of the predicted CoP variance over the poses of the work.
    IOptimal,
}

/// How overload is estimated in motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// Compensates the body's own inertia with accelerations over a window of suit samples around each sample.
    Compensated {
        /// Half the window, ns: the group delay of all results.
        half_window_ns: u64,
    },
    /// The paper's static equations, applied in motion too, where they do not hold.
    Paper,
}

/// When identification is complete.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StopRule {
    /// The paper's criterion: every P_jj below this, m². The paper uses 0.002, a standard deviation of 45 mm.
    Paper {
        /// Bound on every variance, m².
        variance_m2: f64,
    },
    /// Predicted 1-σ of the CoP, root mean square over the poses of the library in this stance, below this, m.
    PredictedCop {
        /// Bound, m.
        sigma_m: f64,
    },
}

/// Largest number of poses that a model file requests.
pub const POSE_REQUESTS_MAX: usize = 4;

/// A pose that the model file requests.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseRequest {
    /// Index into [`Settings::library`].
    pub pose: usize,
    /// Turn of the body for this pose, rad to the left.
    pub turn_rad: f64,
}

/// Default half window of the motion, ns.
const HALF_WINDOW_NS: u64 = 70_000_000;

/// All constants of a cycle.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Stature, m.
    pub height_m: f64,
    /// Column of the anthropometric table.
    pub sex: Sex,
    /// Body mass, kg; measured by the plate in the first static window if `None`.
    pub mass_kg: Option<f64>,
    /// Parameters to identify. Default `Merged`: with a prior that has a full covariance, more parameters need no more
    /// poses, and the covariance of an asymmetric subject is not underestimated as under `Symmetric`; `Full` improves
    /// no result, and its updates take 2.5 times as long (`cycle/tests/planning.rs`).
    pub reduction: ReductionKind,
    /// Distribution of the parameters before the first pose.
    pub prior: PriorKind,
    /// The similar subject of [`PriorKind::SimilarSubject`].
    pub similar: Option<Similar>,
    /// Measurements that update the filter.
    pub method: Method,
    /// Whether natural motion without a load continues to update the filter after identification is complete.
    pub passive: bool,
    /// Soft constraint: 1-σ of the difference between a left limb's parameter and its mirror image, m.
    pub symmetry_sigma_m: f64,
    /// Soft constraint: 1-σ of the distance of a limb's centre of mass from its long axis, m.
    pub long_axis_sigma_m: f64,
    /// Criterion for the next suggested pose. Default I-optimal: it and A-optimal have the smallest errors after few
    /// poses (docs/identification.md).
    pub pose_choice: PoseChoice,
    /// When identification is complete.
    pub stop: StopRule,
    /// Minimum number of poses before identification is complete.
    pub poses_min: u64,
    /// Q: increase of each parameter's variance per pose, m² (Eq. 7).
    pub process_variance_m2: f64,
    /// 1-σ of the measurement in a static pose in addition to the errors of suit and plate, m: sway, in which the CoP
    /// deviates from the CoM by one or two millimetres, and breathing, which moves masses that the chain treats as
    /// fixed.
    pub measurement_sigma_m: f64,
    /// 1-σ of one measured CoP in a cycle, m.
    pub cop_sigma_m: f64,
    /// 1-σ of the difference between vertical force and body weight, N.
    pub force_sigma_n: f64,
    /// 1-σ of one CoP measured by insoles alone, m. Assumed, because insole makers do not publish the error of a pair.
    /// Excludes the position of the insoles in the shoes, which is part of the stance offset.
    pub insole_cop_sigma_m: f64,
    /// 1-σ of the difference between the vertical force by insoles alone and body weight, N. Assumed as well.
    pub insole_force_sigma_n: f64,
    /// Thresholds of a static pose.
    pub static_pose: Thresholds,
    /// External forces below this are not a load, N.
    pub load_threshold_n: f64,
    /// A load farther than this from the line between the hands is not at the hands, m.
    pub load_distance_max_m: f64,
    /// 1-σ per axis of the constant error of each segment's orientation (sensor to segment), rad.
    pub suit_misalignment_rad: f64,
    /// 1-σ per axis of the varying error (drift) of each segment's orientation, rad.
    pub suit_drift_rad: f64,
    /// How overload is estimated in motion.
    pub motion: Motion,
    /// Source of the body's accelerations if the suit sends its own (docs/motion.md explains the choice).
    pub accelerations: Accelerations,
    /// Latency that the suit adapter subtracts from its sample times, ns: samples arrive this much older.
    pub suit_latency_ns: u64,
    /// Likewise for the ground adapter, ns.
    pub ground_latency_ns: u64,
    /// Whether the skew between the streams is corrected when the motion reveals it.
    pub align_streams: bool,
    /// Whether the registration is marked as lost if measured and estimated CoP remain far apart.
    pub watch_registration: bool,
    /// Whether the suit's position drifts, so that the anchor must hold the standing feet; false for optical markers.
    pub suit_drifts: bool,
    /// Whether identification starts automatically.
    pub start_identifying: bool,
    /// Hysteresis: a level decreases only when the torque is this far below the level's bound, as a fraction of τ_max.
    pub level_margin_fraction: f64,
    /// τ_max per joint.
    pub limits: TorqueLimits,
    /// Model terms besides the body: effects that were identified and named.
    pub model: Model,
    /// Poses requested after identification, which discriminate between explanations of the model's data.
    pub pose_requests: [Option<PoseRequest>; POSE_REQUESTS_MAX],
    /// Poses that may be suggested, at most [`crate::pose_suggestion::LIBRARY_MAX`].
    pub library: &'static [Posture],
}

impl Settings {
    /// Half the motion window, ns; 0 without a window. Terms of a model need the window even if the paper's equations
    /// do not.
    pub fn half_window_ns(&self) -> u64 {
        match self.motion {
            Motion::Compensated { half_window_ns } => half_window_ns,
            Motion::Paper if !self.model.is_empty() => HALF_WINDOW_NS,
            Motion::Paper => 0,
        }
    }

    /// Settings that determine the measured errors of motion: source of the accelerations, and half the window, ns.
    pub(super) fn differentiation(&self) -> [u64; 2] {
        let half_window_ns = match self.motion {
            Motion::Compensated { half_window_ns } => half_window_ns,
            Motion::Paper => 0,
        };
        [self.accelerations as u64, half_window_ns]
    }

    /// 1-σ of a segment's orientation, rad: constant and varying error combined.
    pub(crate) fn suit_orientation_sigma_rad(&self) -> f64 {
        math::hypot([self.suit_misalignment_rad, self.suit_drift_rad])
    }

    /// Defaults for a subject of this stature.
    pub fn for_height(height_m: f64) -> Settings {
        Settings {
            height_m,
            sex: Sex::Unstated,
            mass_kg: None,
            reduction: ReductionKind::Merged,
            prior: PriorKind::Table,
            similar: None,
            method: Method::StaticAndDynamic,
            passive: false,
            symmetry_sigma_m: 0.005,
            long_axis_sigma_m: 0.005,
            pose_choice: PoseChoice::IOptimal,
            stop: StopRule::PredictedCop { sigma_m: 0.0015 },
            poses_min: 6,
            process_variance_m2: 0.0,
            measurement_sigma_m: 0.002,
            cop_sigma_m: 0.001,
            force_sigma_n: 2.0,
            insole_cop_sigma_m: 0.006,
            insole_force_sigma_n: 12.0,
            static_pose: Thresholds::default(),
            load_threshold_n: 15.0,
            load_distance_max_m: 0.35,
            suit_misalignment_rad: 0.6f64.to_radians(),
            suit_drift_rad: 0.3f64.to_radians(),
            motion: Motion::Compensated { half_window_ns: HALF_WINDOW_NS },
            accelerations: Accelerations::Blend,
            suit_latency_ns: 0,
            ground_latency_ns: 0,
            align_streams: true,
            watch_registration: true,
            suit_drifts: true,
            start_identifying: true,
            level_margin_fraction: 0.02,
            limits: TorqueLimits::default(),
            model: Model::default(),
            pose_requests: [None; POSE_REQUESTS_MAX],
            library: &[],
        }
    }
}
