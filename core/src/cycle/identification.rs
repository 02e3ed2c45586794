//! This worker: bones, mass, what the filter has learnt, which poses it has seen.

use bytemuck::{Pod, Zeroable};

use super::settings::{PriorKind, Settings, StopRule};
use crate::anchor::STANCE_SIGMA_M;
use crate::body::{Anthropometry, JOINTS, SEGMENTS, Skeleton};
use crate::frame::{Pose, StationWorld, SuitWorld, rotation};
use crate::kalman::Filter;
use crate::math;
use crate::pose_suggestion::{Performed, coordinates, posture};
use crate::sesc::{Phi, Prior, Reduction};
use crate::static_pose::{Stillness, WINDOW, Window, largest_joint_angle};

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
    /// Which parameters are free.
    pub reduction: Reduction,
    /// θ and P.
    pub filter: Filter,
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

    /// The table laid on these bones.
    pub fn anthropometry(&self, settings: &Settings) -> Anthropometry {
        Anthropometry::de_leva(&self.skeleton(), settings.height_m, settings.sex)
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
        let (skeleton, body) = (self.skeleton(), self.anthropometry(settings));
        self.reduction = Reduction::new(settings.reduction, &Phi::of(&skeleton, &body));
        let prior = match settings.prior {
            PriorKind::None => Prior::none(&self.reduction),
            PriorKind::Table | PriorKind::SimilarSubject => Prior::table(&self.reduction, &skeleton, &body),
        };
        self.filter.reset(self.reduction.count(), &prior);
        self.performed = Zeroable::zeroed();
        self.poses_used = 0;
        self.identified = 0;
        self.nis = 0.0;
        self.predicted_cop_sigma_m = self.predict_cop_sigma(settings);
        self.suggest(settings);
    }

    /// Φ as it stands.
    pub fn phi(&self) -> Phi {
        self.reduction.phi(self.filter.theta_m())
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
        let Some(newest) = window.newest() else { return false };
        let (mut h, mut offset_m) = ([[0.0; crate::sesc::PARAMETERS]; 2], [0.0; 2]);
        for held in window.samples() {
            let rows = self.reduction.rows(&pose_of(held), [0.0; 2]);
            for axis in 0..2 {
                offset_m[axis] += rows.offset_m[axis] / WINDOW as f64;
                for (mean, value) in h[axis].iter_mut().zip(rows.h[axis]) {
                    *mean += value / WINDOW as f64;
                }
            }
        }
        self.filter.predict(settings.process_variance_m2);
        let mut nis = 0.0;
        for axis in 0..2 {
            let noise = stillness.cop_sigma_m[axis];
            let r_m2 = STANCE_SIGMA_M * STANCE_SIGMA_M
                + settings.measurement_sigma_m * settings.measurement_sigma_m
                + noise * noise / WINDOW as f64;
            let Some(innovation) = self.filter.update(&h[axis], stillness.cop_m[axis] - offset_m[axis], r_m2)
            else {
                return false;
            };
            nis += innovation.normalised_square();
        }
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

    /// shim
    pub fn predict_cop_m(&self, rows: &crate::sesc::reduction::Rows) -> [f64; 2] {
        [0, 1].map(|axis| rows.offset_m[axis] + self.filter.project(&rows.h[axis]))
    }
    /// shim
    pub fn cop_variance_m2(&self, rows: &crate::sesc::reduction::Rows) -> [f64; 2] {
        [0, 1].map(|axis| self.filter.projected_variance_m2(&rows.h[axis]) + STANCE_SIGMA_M * STANCE_SIGMA_M)
    }
    /// shim
    pub fn wander_variance_m2(&self, _: &Pose<StationWorld>, _: &Settings) -> [f64; 2] {
        [0.0; 2]
    }
    /// shim
    pub fn learn_motion(
        &mut self,
        rows: &crate::sesc::reduction::Rows,
        cop_m: [f64; 2],
        variance_m2: [f64; 2],
        _: &Settings,
    ) -> bool {
        (0..2).all(|axis| {
            self.filter.update(&rows.h[axis], cop_m[axis] - rows.offset_m[axis], variance_m2[axis]).is_some()
        })
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
                sum += self.filter.projected_variance_m2(h);
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
