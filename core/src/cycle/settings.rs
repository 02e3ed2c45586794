//! What a cycle is told once: the worker, the method, the thresholds.

use crate::body::Sex;
use crate::overload::TorqueLimits;
use crate::pose_suggestion::Posture;
use crate::sesc::ReductionKind;
use crate::static_pose::Thresholds;

/// What is believed before the first pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PriorKind {
    /// Nothing.
    None,
    /// The anthropometric table with its spread.
    Table,
}

/// When identification is finished.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StopRule {
    /// The paper's: every P_jj below this, m². The paper uses 0.002, which is 45 mm as a standard deviation.
    Paper {
        /// Bound on every variance, m².
        variance_m2: f64,
    },
    /// The predicted 1-σ of the CoP, root mean square over the poses of the library, below this, m.
    PredictedCop {
        /// Bound, m.
        sigma_m: f64,
    },
}

/// Everything constant of a cycle.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Stature, m.
    pub height_m: f64,
    /// Which column of the table.
    pub sex: Sex,
    /// Body mass, kg; measured from the plate in the first still window if not given.
    pub mass_kg: Option<f64>,
    /// Which parameters are identified.
    pub reduction: ReductionKind,
    /// What is believed before the first pose.
    pub prior: PriorKind,
    /// When identification is finished.
    pub stop: StopRule,
    /// Never finished before this many poses.
    pub poses_min: u64,
    /// Q: growth of each parameter's variance per pose, m² (Eq. 7).
    pub process_variance_m2: f64,
    /// Floor of the measurement's 1-σ beside the stance's, m: body and suit are not rigid.
    pub measurement_sigma_m: f64,
    /// 1-σ of one measured CoP in a cycle, m.
    pub cop_sigma_m: f64,
    /// 1-σ of the vertical force and body weight together, N.
    pub force_sigma_n: f64,
    /// What counts as still.
    pub still: Thresholds,
    /// External forces below this are not a load, N.
    pub load_threshold_n: f64,
    /// A load farther than this from the line between the hands is not in the hands, m.
    pub load_distance_max_m: f64,
    /// Whether the suit's position drifts, so that the standing feet must be held; optical markers do not.
    pub suit_drifts: bool,
    /// Whether identification starts by itself.
    pub start_identifying: bool,
    /// τ_max per joint.
    pub limits: TorqueLimits,
    /// Poses that may be suggested, at most [`crate::pose_suggestion::LIBRARY_MAX`].
    pub library: &'static [Posture],
}

impl Settings {
    /// Defaults for a worker of this stature.
    pub fn for_height(height_m: f64) -> Settings {
        Settings {
            height_m,
            sex: Sex::Unstated,
            mass_kg: None,
            reduction: ReductionKind::Symmetric,
            prior: PriorKind::Table,
            stop: StopRule::PredictedCop { sigma_m: 0.0025 },
            poses_min: 12,
            process_variance_m2: 0.0,
            measurement_sigma_m: 0.005,
            cop_sigma_m: 0.001,
            force_sigma_n: 3.0,
            still: Thresholds::default(),
            load_threshold_n: 15.0,
            load_distance_max_m: 0.35,
            suit_drifts: true,
            start_identifying: true,
            limits: TorqueLimits::default(),
            library: &[],
        }
    }
}
