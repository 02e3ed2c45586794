//! State of the subject's identification: bone lengths, mass, filter, poses performed.

use bytemuck::{Pod, Zeroable};

use super::reported_body::BoneUpdate;
use super::residual::ROWS_PER_INDEPENDENT;
use super::settings::{Settings, StopRule};
use crate::anchor::STANCE_SIGMA_M;
use crate::body::{Anthropometry, JOINTS, SEGMENTS, Skeleton};
use crate::frame::{Pose, StationWorld, SuitWorld, rotation};
use crate::kalman::Filter;
use crate::message::SuitBody;
use crate::pose_suggestion::{Performed, Planner, coordinates};
use crate::sesc::Reduction;
use crate::sesc::reduction::Rows;
use crate::static_pose::{PoseStatistics, Window, largest_joint_angle};

mod consistency;
mod handover_body;
mod measurement;
mod misfit;
mod planning;
mod prior;
mod progress;
mod stored_subject;
mod weighing;

pub use consistency::Consistency;
pub(super) use measurement::REGISTRATION_SIGMA_M;
pub use measurement::StanceSigma;
use misfit::Misfit;
use progress::{Progress, ROWS_PER_POSE};
pub use stored_subject::StoredSubject;
pub(super) use weighing::OTHER_MASS_SIGMA_KG;
use weighing::Weighing;

/// Number of suit samples averaged for the bone lengths.
const SKELETON_SAMPLES: u64 = 20;
/// Value for "no pose is suggested".
pub const NO_POSE: u64 = u64::MAX;

/// Source of the subject's bone lengths.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum BodySource {
    /// Unavailable.
    Unknown = 0,
    /// The mean over the suit's first poses.
    Poses = 1,
    /// The suit's null pose.
    NullPose = 2,
    /// A stored profile.
    Stored = 3,
}

impl BodySource {
    /// The source of a message's number, `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<BodySource> {
        [BodySource::Unknown, BodySource::Poses, BodySource::NullPose, BodySource::Stored]
            .into_iter()
            .nth(number as usize)
    }

    /// The public name.
    pub fn name(self) -> &'static str {
        match self {
            BodySource::Unknown => "unknown",
            BodySource::Poses => "poses",
            BodySource::NullPose => "null_pose",
            BodySource::Stored => "stored",
        }
    }
}

/// All data of the subject that outlive a window; a profile stores them.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Identification {
    /// Sum (while counting) or mean of the bone offsets, parent axes, m.
    skeleton_m: [[f64; 3]; SEGMENTS],
    /// Poses in that sum, up to [`SKELETON_SAMPLES`].
    skeleton_samples: u64,
    /// A [`BodySource`].
    bones_from: u64,
    /// Body mass in use, kg; 0 if unavailable.
    pub mass_kg: f64,
    /// The table scaled to the bone lengths; all zero before they are available.
    anthropometry: Anthropometry,
    /// The free parameters.
    pub reduction: Reduction,
    /// θ, the stance offset, and the covariance P of both.
    pub filter: Filter,
    /// Stance of the filter's offset.
    stance: u64,
    /// Static poses that updated the filter, as coordinates.
    performed: Performed,
    /// Selects the suggested poses.
    planner: Planner,
    /// Test of the filter by its normalised innovations.
    consistency: Consistency,
    /// Static poses that updated the filter.
    pub poses_used: u64,
    /// 1 while static poses update the filter.
    pub identifying: u64,
    /// 1 once the stop rule is met, or identification was stopped by command.
    pub identified: u64,
    /// Joint rotations of the last pose that updated the filter.
    last_pose_wxyz: [[f64; 4]; JOINTS],
    /// Index of the suggested pose, or [`NO_POSE`].
    pub suggested: u64,
    /// Suit time since which the suggested pose has been requested, ns.
    suggested_ns: u64,
    /// Normalised innovation squared of the last pose, two degrees of freedom.
    pub nis: f64,
    /// Predicted 1-σ of the CoP over the library in this stance, including the model error, m; 0 before it is
    /// available.
    pub predicted_cop_sigma_m: f64,
    /// Model error: variance of the innovations beyond P and R.
    misfit: Misfit,
    /// Estimate of the body mass.
    weighing: Weighing,
    /// Decrease of the predicted CoP σ, for the stop rule.
    progress: Progress,
}

impl Identification {
    /// Initialises for a subject without data.
    pub fn start(&mut self, settings: &Settings) {
        *self = Zeroable::zeroed();
        self.mass_kg = settings.mass_kg.unwrap_or(0.0);
        self.identifying = u64::from(settings.start_identifying);
        self.suggested = NO_POSE;
        self.consistency = Consistency::start();
        self.planner.start();
    }

    /// Continues identification from the present estimate, for at least as many rows as one evaluation needs.
    pub(super) fn continue_identification(&mut self) {
        self.identifying = 1;
        self.identified = 0;
        self.progress = Zeroable::zeroed();
    }

    /// Whether the bone lengths, and with them the prior, are available.
    pub fn has_body(&self) -> bool {
        self.skeleton_samples >= SKELETON_SAMPLES
    }

    /// Source of the bone lengths.
    pub fn body_source(&self) -> BodySource {
        let source = BodySource::from_number(self.bones_from as u32).unwrap_or(BodySource::Unknown);
        if self.has_body() { source } else { BodySource::Unknown }
    }

    /// Adopts these bone lengths and scales the table to them. With `stays`, results from slightly different bone
    /// lengths of the same body are kept: φ hardly depends on millimetres, and θ contains what it needs of them.
    pub(super) fn adopt_bones(&mut self, bones: &Skeleton, stays: bool, settings: &Settings) {
        self.skeleton_m = bones.offset_m;
        self.skeleton_samples = SKELETON_SAMPLES;
        self.bones_from = BodySource::NullPose as u64;
        if stays {
            self.anthropometry = Anthropometry::de_leva(bones, settings.height_m, settings.sex);
        } else {
            self.reset_to_prior(settings);
        }
    }

    /// Updates the bone lengths by one more pose. Returns whether the body model is another one afterwards.
    pub(super) fn update_bones(
        &mut self,
        update: BoneUpdate,
        suit_body: Option<&SuitBody>,
        pose: &Pose<SuitWorld>,
        settings: &Settings,
    ) -> bool {
        let had_body = self.has_body();
        match (update, suit_body) {
            (BoneUpdate::Adopt { stays }, Some(body)) => self.adopt_bones(&body.skeleton(), stays, settings),
            (BoneUpdate::Reset, _) => self.reset_bones(),
            _ => {}
        }
        self.update_skeleton(pose, settings);
        self.has_body() && (!had_body || matches!(update, BoneUpdate::Adopt { .. }))
    }

    /// Resets the bone lengths; the next poses determine them.
    pub(super) fn reset_bones(&mut self) {
        self.skeleton_m = [[0.0; 3]; SEGMENTS];
        self.skeleton_samples = 0;
    }

    /// The bone lengths.
    pub fn skeleton(&self) -> Skeleton {
        Skeleton { offset_m: self.skeleton_m }
    }

    /// The table scaled to these bone lengths; all zero before they are available.
    pub fn anthropometry(&self) -> &Anthropometry {
        &self.anthropometry
    }

    /// Ingests the bone lengths of one more pose; after enough poses, scales the table to their mean.
    pub fn update_skeleton(&mut self, pose: &Pose<SuitWorld>, settings: &Settings) {
        if self.has_body() {
            return;
        }
        let pose_skeleton = Skeleton::of(pose);
        for (sum, offset) in self.skeleton_m.iter_mut().flatten().zip(pose_skeleton.offset_m.iter().flatten())
        {
            *sum += offset;
        }
        self.skeleton_samples += 1;
        if self.has_body() {
            for sum in self.skeleton_m.iter_mut().flatten() {
                *sum /= SKELETON_SAMPLES as f64;
            }
            self.bones_from = BodySource::Poses as u64;
            self.reset_to_prior(settings);
        }
    }

    /// Discards all poses and the stance offset, which [`super::Memory::reset_to_prior`] moves into the anchor; the
    /// bone lengths are kept.
    pub fn reset_to_prior(&mut self, settings: &Settings) {
        self.initialise_prior(settings);
        self.performed = Zeroable::zeroed();
        self.planner.start();
        self.suggested = NO_POSE;
        self.poses_used = 0;
        self.identified = 0;
        self.nis = 0.0;
        self.predicted_cop_sigma_m = 0.0;
        self.misfit = Zeroable::zeroed();
        self.progress = Zeroable::zeroed();
    }

    /// Whether the pose of the window's newest sample was already used.
    pub fn has_used(&self, window: &Window, settings: &Settings) -> bool {
        self.poses_used > 0
            && window.newest().is_some_and(|sample| {
                largest_joint_angle(&sample.joint_wxyz, &self.last_pose_wxyz) < settings.static_pose.leave_rad
            })
    }

    /// Updates the filter from a static pose window: mean rows, mean CoP (Eq. 6–10). Returns whether the filter
    /// accepted it. `lasting_m` is the part of the CoP's 1-σ that the window does not average out, per axis, m.
    pub fn update_from_pose(
        &mut self,
        window: &Window,
        statistics: &PoseStatistics,
        lasting_m: [f64; 2],
        settings: &Settings,
    ) -> bool {
        let (Some(newest), Some(rows)) = (window.newest(), self.mean_rows(window)) else { return false };
        let variance_m2 = self.pose_variance_m2(&pose_of(&newest), statistics, lasting_m, settings);
        // No effect in the cycle, which updates the stance at every snapshot.
        self.update_stance(newest.stance, [STANCE_SIGMA_M; 2], settings);
        self.filter.predict(settings.process_variance_m2);
        if self.update_from_rows(&rows, statistics.cop_m, variance_m2).is_none() {
            return false;
        }
        self.last_pose_wxyz = newest.joint_wxyz;
        self.finish_pose(&pose_of(&newest), settings);
        true
    }

    /// After a pose: checks the stop rule and, if it is not met, selects the next pose.
    pub(super) fn finish_pose(&mut self, pose: &Pose<StationWorld>, settings: &Settings) {
        self.performed.push(coordinates(pose));
        self.update_predicted_cop_sigma(settings);
        let enough = self.poses_used >= settings.poses_min && self.meets_stop_rule(settings);
        self.finish(enough, ROWS_PER_POSE, settings);
        self.withdraw_suggestion();
    }

    /// After a row in motion: stops if the bound holds, as after poses, or if more of the same work would add little.
    pub(super) fn finish_row(&mut self, settings: &Settings) {
        self.update_predicted_cop_sigma(settings);
        let enough = self.progress.has_evaluated() && self.meets_stop_rule(settings);
        self.finish(enough, 1.0, settings);
    }

    fn finish(&mut self, enough: bool, rows: f64, settings: &Settings) {
        let settled = match settings.stop {
            StopRule::Paper { .. } => false,
            StopRule::PredictedCop { .. } => {
                self.has_evaluated_library(settings)
                    && self.progress.is_settled(rows, self.parameter_sigma_m())
            }
        };
        if enough || settled {
            self.identified = 1;
            self.identifying = 0;
        }
    }

    /// Updates the filter with a pose's rows; the first ones also test the prior. Returns the NIS.
    pub(super) fn update_from_rows(
        &mut self,
        rows: &Rows,
        cop_m: [f64; 2],
        variance_m2: [f64; 2],
    ) -> Option<f64> {
        self.update_misfit(rows, cop_m, variance_m2, ROWS_PER_INDEPENDENT);
        self.test_prior(rows, cop_m, variance_m2);
        let nis = self.update_from_cop(rows, cop_m, variance_m2)?;
        self.nis = nis;
        self.consistency.push(nis);
        self.poses_used += 1;
        Some(nis)
    }

    /// Whether the stop rule's bound holds. It depends on P alone: no further pose reduces the model error, which
    /// [`Identification::predicted_cop_sigma_m`] includes.
    pub fn meets_stop_rule(&self, settings: &Settings) -> bool {
        match settings.stop {
            StopRule::Paper { variance_m2 } => self.filter.variance_max_m2() < variance_m2,
            StopRule::PredictedCop { sigma_m } => {
                self.has_evaluated_library(settings) && self.parameter_sigma_m() < sigma_m
            }
        }
    }

    /// Whether every count and number is in range; a stored subject is checked before use.
    pub fn is_sound(&self) -> bool {
        self.skeleton_m.iter().flatten().all(|value| value.is_finite())
            && self.mass_kg.is_finite()
            && (0.0..1000.0).contains(&self.mass_kg)
            && self.bones_from <= BodySource::Stored as u64
            // Created with the bone lengths, and not used before.
            && (!self.has_body() || self.reduction.is_sound())
            && self.anthropometry.is_sound()
            && self.filter.is_sound()
            && self.filter.count() == self.reduction.count()
            && self.performed.is_sound()
            && self.planner.is_sound()
            && self.consistency.is_sound()
            && self.nis.is_finite()
            && self.predicted_cop_sigma_m.is_finite()
            && self.misfit.is_sound()
            && self.weighing.is_sound()
            && self.progress.is_sound()
            && self.poses_used < 1 << 32
            && self.last_pose_wxyz.iter().flatten().all(|value| value.is_finite())
    }
}

fn pose_of(sample: &crate::static_pose::WindowSample) -> Pose<StationWorld> {
    Pose::new(sample.origin_m.map(Into::into), sample.orientation_wxyz.map(rotation))
}
