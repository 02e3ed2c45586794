//! This worker: bones, mass, what the filter has learnt, which poses it has seen.

use bytemuck::{Pod, Zeroable};

use super::settings::{PriorKind, Settings, StopRule};
use crate::body::{Anthropometry, JOINTS, SEGMENTS, Skeleton};
use crate::frame::{Pose, StationWorld, SuitWorld, rotation};
use crate::kalman::Filter;
use crate::math;
use crate::pose_suggestion::{Performed, coordinates, posture};
use crate::sesc::suit_error::effective_vectors;
use crate::sesc::{Phi, Prior, Reduction};
use crate::static_pose::{Stillness, Window, largest_joint_angle};

mod measurement;

/// Suit samples averaged for the bones.
const SKELETON_SAMPLES: u64 = 20;
/// No pose is suggested.
pub const NO_POSE: u64 = u64::MAX;

/// Everything about this worker that outlives a window: what a profile stores.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Identification {
    /// Sum (while counting) or mean of the bones' offsets, parent axes, m.
    skeleton_m: [[f64; 3]; SEGMENTS],
    skeleton_samples: u64,
    /// Body mass in use, kg; 0 while unknown.
    pub mass_kg: f64,
    /// The table laid on the bones; all zero before they are known.
    anthropometry: Anthropometry,
    /// Which parameters are free.
    pub reduction: Reduction,
    /// θ, the stance's offset, and P of both.
    pub filter: Filter,
    /// The stance that the filter's offset belongs to.
    stance: u64,
    performed: Performed,
    /// Held poses that entered the filter.
    pub poses_used: u64,
    /// 1 while held poses enter the filter.
    pub learning: u64,
    /// 1 once the stop rule was met, or a person stopped the learning.
    pub identified: u64,
    last_pose_wxyz: [[f64; 4]; JOINTS],
    /// Index of the suggested pose, or [`NO_POSE`].
    pub suggested: u64,
    /// Normalised innovation squared of the last pose, two degrees of freedom.
    pub nis: f64,
    /// Predicted 1-σ of the CoP over the library, m.
    pub predicted_cop_sigma_m: f64,
}

/// What a profile keeps of a worker, beside the covariance.
#[derive(Debug, Clone, Copy)]
pub struct Stored<'a> {
    /// Bones: each segment's origin in its parent, m.
    pub skeleton_m: [[f64; 3]; SEGMENTS],
    /// Body mass, kg; 0 while unknown.
    pub mass_kg: f64,
    /// θ, m.
    pub theta_m: &'a [f64],
    /// Held poses that entered the filter.
    pub poses_used: u64,
    /// Whether identification was finished.
    pub identified: bool,
    /// `parent_from_segment` of the last pose used, scalar first: it is not used again.
    pub last_pose_wxyz: [[f64; 4]; JOINTS],
}

impl Identification {
    /// What a profile keeps; `None` before the bones are known.
    pub fn stored(&self) -> Option<Stored<'_>> {
        self.has_body().then(|| Stored {
            skeleton_m: self.skeleton_m,
            mass_kg: self.mass_kg,
            theta_m: &self.filter.theta_m()[..self.filter.count()],
            poses_used: self.poses_used,
            identified: self.identified == 1,
            last_pose_wxyz: self.last_pose_wxyz,
        })
    }

    /// Puts a stored worker in place. Whether it fits; if not, the worker must not be used.
    pub fn restore(&mut self, stored: &Stored<'_>, covariance_m2: &[f64], settings: &Settings) -> bool {
        if !stored.skeleton_m.iter().flatten().all(|metres| metres.is_finite() && metres.abs() < 3.0) {
            return false;
        }
        self.skeleton_m = stored.skeleton_m;
        self.skeleton_samples = SKELETON_SAMPLES;
        self.mass_kg = stored.mass_kg;
        self.return_to_prior(settings);
        let fits = stored.theta_m.len() == self.reduction.count()
            && self.filter.restore(stored.theta_m, covariance_m2);
        self.new_stance(settings);
        self.poses_used = stored.poses_used;
        self.last_pose_wxyz = stored.last_pose_wxyz;
        self.identified = u64::from(stored.identified);
        self.learning = u64::from(!stored.identified && settings.start_identifying);
        self.predicted_cop_sigma_m = self.predict_cop_sigma(settings);
        if stored.identified {
            self.suggested = NO_POSE;
        } else {
            self.suggest(settings);
        }
        fits && self.is_sound()
    }

    /// An unknown worker.
    pub fn start(&mut self, settings: &Settings) {
        *self = Zeroable::zeroed();
        self.mass_kg = settings.mass_kg.unwrap_or(0.0);
        self.learning = u64::from(settings.start_identifying);
        self.suggested = NO_POSE;
    }

    /// Whether the bones are known and with them the prior.
    pub fn has_body(&self) -> bool {
        self.skeleton_samples >= SKELETON_SAMPLES
    }

    /// The bones.
    pub fn skeleton(&self) -> Skeleton {
        Skeleton { offset_m: self.skeleton_m }
    }

    /// The table laid on these bones; all zero before they are known.
    pub fn anthropometry(&self) -> &Anthropometry {
        &self.anthropometry
    }

    /// Takes in the bones of one more pose; after enough of them lays the table on their mean.
    pub fn learn_skeleton(&mut self, pose: &Pose<SuitWorld>, settings: &Settings) {
        if self.has_body() {
            return;
        }
        let seen = Skeleton::of(pose);
        for (sum, offset) in self.skeleton_m.iter_mut().flatten().zip(seen.offset_m.iter().flatten()) {
            *sum += offset;
        }
        self.skeleton_samples += 1;
        if self.has_body() {
            for sum in self.skeleton_m.iter_mut().flatten() {
                *sum /= SKELETON_SAMPLES as f64;
            }
            self.return_to_prior(settings);
        }
    }

    /// Forgets every pose; the bones stay.
    pub fn return_to_prior(&mut self, settings: &Settings) {
        let skeleton = self.skeleton();
        let body = Anthropometry::de_leva(&skeleton, settings.height_m, settings.sex);
        self.anthropometry = body;
        self.reduction = Reduction::new(settings.reduction, &Phi::of(&skeleton, &body));
        let mut prior = match settings.prior {
            PriorKind::None => Prior::none(&self.reduction),
            PriorKind::Table | PriorKind::SimilarSubject => Prior::table(&self.reduction, &skeleton, &body),
        };
        let psi = effective_vectors(&Phi::of(&skeleton, &body), &skeleton, settings.suit_drifts);
        prior.add_misalignment(&self.reduction, &psi, settings.suit_misalignment_rad);
        self.filter.reset(self.reduction.count(), &prior);
        self.new_stance(settings);
        self.performed = Zeroable::zeroed();
        self.poses_used = 0;
        self.identified = 0;
        self.nis = 0.0;
        self.predicted_cop_sigma_m = self.predict_cop_sigma(settings);
        self.suggest(settings);
    }

    /// Whether the pose of the window's newest sample was already used.
    pub fn has_used(&self, window: &Window, settings: &Settings) -> bool {
        self.poses_used > 0
            && window.newest().is_some_and(|held| {
                largest_joint_angle(&held.joint_wxyz, &self.last_pose_wxyz) < settings.still.leave_rad
            })
    }

    /// One update from a still window: mean rows, mean CoP (Eq. 6–10). Returns whether the filter took it.
    pub fn learn_pose(&mut self, window: &Window, stillness: &Stillness, settings: &Settings) -> bool {
        let (Some(newest), Some(rows)) = (window.newest(), self.mean_rows(window)) else { return false };
        let variance_m2 = self.pose_variance_m2(&pose_of(&newest), stillness, settings);
        self.follow_stance(newest.stance, settings);
        self.filter.predict(settings.process_variance_m2);
        let Some(nis) = self.take_in(&rows, stillness.cop_m, variance_m2) else { return false };
        self.nis = nis;
        self.poses_used += 1;
        self.last_pose_wxyz = newest.joint_wxyz;
        self.performed.push(coordinates(&pose_of(&newest)));
        self.predicted_cop_sigma_m = self.predict_cop_sigma(settings);
        if self.poses_used >= settings.poses_min && self.meets(settings.stop) {
            self.identified = 1;
            self.learning = 0;
            self.suggested = NO_POSE;
        } else {
            self.suggest(settings);
        }
        true
    }

    /// Whether a stop rule holds now.
    pub fn meets(&self, rule: StopRule) -> bool {
        match rule {
            StopRule::Paper { variance_m2 } => self.filter.variance_max_m2() < variance_m2,
            StopRule::PredictedCop { sigma_m } => self.predicted_cop_sigma_m < sigma_m,
        }
    }

    fn suggest(&mut self, settings: &Settings) {
        let variance = self.reduction.raw_variance(|index| self.filter.variance_m2(index));
        self.suggested =
            self.performed.suggest(settings.library, &variance).map_or(NO_POSE, |index| index as u64);
    }

    /// Root mean square of the predicted 1-σ of the CoP over the library and both axes, m.
    fn predict_cop_sigma(&self, settings: &Settings) -> f64 {
        let (mut sum, mut rows_seen) = (0.0, 0.0);
        for posture in settings.library {
            let rows = self.reduction.rows(&posture::pose_of(posture, &self.skeleton(), [0.0; 3]), [0.0; 2]);
            for h in &rows.h {
                sum += self.theta_variance_m2(h);
                rows_seen += 1.0;
            }
        }
        if rows_seen > 0.0 { math::sqrt(sum / rows_seen) } else { 0.0 }
    }

    /// Whether every count and number is in range; a stored worker is checked before use.
    pub fn is_sound(&self) -> bool {
        self.skeleton_m.iter().flatten().all(|value| value.is_finite())
            && self.mass_kg.is_finite()
            && (0.0..1000.0).contains(&self.mass_kg)
            // Made with the bones; nobody looks at it before.
            && (!self.has_body() || self.reduction.is_sound())
            && self.anthropometry.is_sound()
            && self.filter.is_sound()
            && self.filter.count() == self.reduction.count()
            && self.performed.is_sound()
            && self.nis.is_finite()
            && self.predicted_cop_sigma_m.is_finite()
            && self.last_pose_wxyz.iter().flatten().all(|value| value.is_finite())
    }
}

fn pose_of(held: &crate::static_pose::Held) -> Pose<StationWorld> {
    Pose::new(held.origin_m.map(Into::into), held.orientation_wxyz.map(rotation))
}
