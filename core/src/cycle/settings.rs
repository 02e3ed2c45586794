//! What a cycle is told once: the worker, the method, the thresholds.

use crate::body::Sex;
use crate::effect::Model;
use crate::math;
pub use crate::motion::Accelerations;
use crate::overload::TorqueLimits;
use crate::pose_suggestion::Posture;
use crate::sesc::ReductionKind;
pub use crate::sesc::Similar;
use crate::static_pose::Thresholds;

/// What is believed before the first pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PriorKind {
    /// Nothing.
    None,
    /// The anthropometric table with its spread.
    Table,
    /// A stored worker of similar build: [`Settings::similar`]; the table while there is none.
    SimilarSubject,
}

/// What is learnt from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Held poses, as in the paper.
    Static,
    /// Held poses, and natural motion without a load by the moment and force rows.
    StaticAndDynamic,
}

/// How the next pose is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoseChoice {
    /// Eq. 11: farthest from the poses performed, weighted by P_jj.
    Paper,
    /// The largest drop of `log det P`.
    DOptimal,
    /// The largest drop of `tr P`.
    AOptimal,
    /// The largest drop of the predicted CoP variance over the poses of the work.
    IOptimal,
}

/// How overload is told while the worker moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// The body's own inertia is taken out, by accelerations over a window of suit samples around each sample.
    Compensated {
        /// Half the window, ns: everything told lies this far behind the newest suit sample.
        half_window_ns: u64,
    },
    /// The paper's static equations, told in motion too, where they are wrong.
    Paper,
}

/// When identification is finished.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StopRule {
    /// The paper's: every P_jj below this, m². The paper uses 0.002, which is 45 mm as a standard deviation.
    Paper {
        /// Bound on every variance, m².
        variance_m2: f64,
    },
    /// The predicted 1-σ of the CoP, root mean square over the poses of the library in this stance, below this, m.
    PredictedCop {
        /// Bound, m.
        sigma_m: f64,
    },
}

/// A pose that a model file asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Asked {
    /// Index into [`Settings::library`].
    pub pose: usize,
    /// How far to turn for it, rad to the left.
    pub turn_rad: f64,
}

/// Half the window over which motion is looked at unless told otherwise, ns.
const HALF_WINDOW_NS: u64 = 70_000_000;

/// Everything constant of a cycle.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Stature, m.
    pub height_m: f64,
    /// Which column of the table.
    pub sex: Sex,
    /// Body mass, kg; measured from the plate in the first still window if not given.
    pub mass_kg: Option<f64>,
    /// Which parameters are identified. `Merged` by default: under a prior with its whole covariance more parameters
    /// cost no poses, and a worker who is not symmetric is not promised too much, as under `Symmetric`; `Full` finds
    /// nothing more and its updates take two and a half times as long (`cycle/tests/planning.rs`).
    pub reduction: ReductionKind,
    /// What is believed before the first pose.
    pub prior: PriorKind,
    /// The similar worker of [`PriorKind::SimilarSubject`].
    pub similar: Option<Similar>,
    /// What is learnt from.
    pub method: Method,
    /// Whether natural motion without a load goes on teaching after identification is finished.
    pub passive: bool,
    /// Soft constraint: 1-σ of how much a left limb's parameter differs from its mirror image, m.
    pub symmetry_sigma_m: f64,
    /// Soft constraint: 1-σ of how far a limb's centre lies off its long axis, m.
    pub long_axis_sigma_m: f64,
    /// How the next pose is chosen. I-optimal by default: it and A-optimal err least after few poses
    /// (docs/identification.md).
    pub pose_choice: PoseChoice,
    /// When identification is finished.
    pub stop: StopRule,
    /// Never finished before this many poses.
    pub poses_min: u64,
    /// Q: growth of each parameter's variance per pose, m² (Eq. 7).
    pub process_variance_m2: f64,
    /// 1-σ of a held pose's measurement beside the suit's and the plate's, m: sway, whose centre of pressure leaves
    /// the centre of mass by a millimetre or two, and the breath, which moves masses that the chain holds fixed.
    pub measurement_sigma_m: f64,
    /// 1-σ of one measured CoP in a cycle, m.
    pub cop_sigma_m: f64,
    /// 1-σ of the vertical force and body weight together, N.
    pub force_sigma_n: f64,
    /// 1-σ of one CoP by insoles alone, m. Assumed: what a pair of insoles errs by is its maker's affair. Where in the shoe
    /// they lie is not in it, for that is the stance's offset.
    pub insole_cop_sigma_m: f64,
    /// 1-σ of the vertical force by insoles alone and body weight together, N. Assumed, likewise.
    pub insole_force_sigma_n: f64,
    /// What counts as still.
    pub still: Thresholds,
    /// External forces below this are not a load, N.
    pub load_threshold_n: f64,
    /// A load farther than this from the line between the hands is not in the hands, m.
    pub load_distance_max_m: f64,
    /// 1-σ per axis of how each segment's orientation is off for good (sensor to segment), rad.
    pub suit_misalignment_rad: f64,
    /// 1-σ per axis of how each segment's orientation wanders, rad.
    pub suit_wander_rad: f64,
    /// How overload is told while the worker moves.
    pub motion: Motion,
    /// Where the body's accelerations come from, if the suit sends its own (docs/motion.md says how this was chosen).
    pub accelerations: Accelerations,
    /// What the suit's adapter takes off its sample times, ns: so much older a sample is when it comes.
    pub suit_latency_ns: u64,
    /// The same of the ground's adapter, ns.
    pub ground_latency_ns: u64,
    /// Whether the skew between both streams is corrected where the motion shows it.
    pub align_streams: bool,
    /// Whether the suit's position drifts, so that the standing feet must be held; optical markers do not.
    pub suit_drifts: bool,
    /// Whether identification starts by itself.
    pub start_identifying: bool,
    /// A level is left downwards only this far below its bound, as a share of τ_max.
    pub level_margin_share: f64,
    /// τ_max per joint.
    pub limits: TorqueLimits,
    /// What the model has beside the body: effects that were found and named.
    pub model: Model,
    /// What to ask for once the worker is known, to tell explanations of the model's data apart.
    pub asked: Option<Asked>,
    /// Poses that may be suggested, at most [`crate::pose_suggestion::LIBRARY_MAX`].
    pub library: &'static [Posture],
}

impl Settings {
    /// Half the window over which motion is looked at, ns; 0 where it is not. Terms of a model look at motion even where
    /// the paper's equations do not.
    pub fn half_window_ns(&self) -> u64 {
        match self.motion {
            Motion::Compensated { half_window_ns } => half_window_ns,
            Motion::Paper if !self.model.is_empty() => HALF_WINDOW_NS,
            Motion::Paper => 0,
        }
    }

    /// 1-σ of a segment's orientation: what is constant and what wanders, rad.
    pub(crate) fn suit_orientation_sigma_rad(&self) -> f64 {
        math::hypot([self.suit_misalignment_rad, self.suit_wander_rad])
    }

    /// Defaults for a worker of this stature.
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
            still: Thresholds::default(),
            load_threshold_n: 15.0,
            load_distance_max_m: 0.35,
            suit_misalignment_rad: 0.6f64.to_radians(),
            suit_wander_rad: 0.3f64.to_radians(),
            motion: Motion::Compensated { half_window_ns: HALF_WINDOW_NS },
            accelerations: Accelerations::Blend,
            suit_latency_ns: 0,
            ground_latency_ns: 0,
            align_streams: true,
            suit_drifts: true,
            start_identifying: true,
            level_margin_share: 0.02,
            limits: TorqueLimits::default(),
            model: Model::default(),
            asked: None,
            library: &[],
        }
    }
}
