//! Stored data of a subject: what a later start needs and cannot recompute.
//!
//! It excludes the stance offset and its covariance with θ: after a restart there is a gap in the data, and the offset
//! starts again; its value is part of the stored registration. The part of P for θ alone is its marginal, so it remains
//! correct without the offset.

use bytemuck::{Pod, Zeroable};

use super::{BodySource, Consistency, Identification, SKELETON_SAMPLES, Weighing};
use crate::body::{JOINTS, SEGMENTS};
use crate::cycle::settings::Settings;
use crate::kalman::Filter;
use crate::pose_suggestion::Performed;

/// Upper bound of a bone length, m.
const BONE_MAX_M: f64 = 3.0;

/// A subject as stored in a profile. About 77 kB.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct StoredSubject {
    /// 1 once the bone lengths are available; there is nothing to store before.
    pub has_body: u64,
    /// Bone lengths: each segment's origin in its parent, m.
    pub skeleton_m: [[f64; 3]; SEGMENTS],
    /// Body mass, kg; 0 if unavailable.
    pub mass_kg: f64,
    /// Its 1-σ, kg, if it was weighed, otherwise 0.
    pub mass_sigma_kg: f64,
    /// θ and P; the part for the stance is not restored.
    pub filter: Filter,
    /// Poses performed, as compared by Eq. 11.
    pub performed: Performed,
    /// One bit per pose of the library that was suggested already.
    pub suggested_before: u64,
    /// One bit per pose of the library that the subject could not hold.
    pub unholdable: u64,
    /// The pose of the library that is suggested now, or [`super::NO_POSE`].
    pub suggested: u64,
    /// Consistency of the measurements with the prior.
    pub consistency: Consistency,
    /// Static poses that updated the filter.
    pub poses_used: u64,
    /// 1 while static poses update the filter.
    pub identifying: u64,
    /// 1 once identification is complete.
    pub identified: u64,
    /// Variance of the model error per axis, m².
    pub misfit_m2: [f64; 2],
    /// `parent_from_segment` of the last pose used, scalar first: the filter does not use it again.
    pub last_pose_wxyz: [[f64; 4]; JOINTS],
}

impl Identification {
    /// Copies the data to be stored.
    pub fn store(&self, stored: &mut StoredSubject) {
        stored.has_body = u64::from(self.has_body());
        stored.skeleton_m = self.skeleton_m;
        stored.mass_kg = self.mass_kg;
        stored.mass_sigma_kg = self.weighed_sigma_kg().unwrap_or(0.0);
        stored.filter.copy_from(&self.filter);
        stored.performed.copy_from(&self.performed);
        [stored.suggested_before, stored.unholdable] = self.planner.history();
        stored.suggested = self.suggested;
        stored.consistency = self.consistency;
        stored.poses_used = self.poses_used;
        stored.identifying = self.identifying;
        stored.identified = self.identified;
        stored.misfit_m2 = self.misfit_variance_m2();
        stored.last_pose_wxyz = self.last_pose_wxyz;
    }

    /// Restores a stored subject. Returns whether it fits the settings; if not, the subject must not be used.
    pub fn restore(&mut self, stored: &StoredSubject, settings: &Settings) -> bool {
        let mut bones = stored.skeleton_m.iter().flatten();
        if stored.has_body != 1 || !bones.all(|metres| metres.is_finite() && metres.abs() < BONE_MAX_M) {
            return false;
        }
        self.start(settings);
        self.skeleton_m = stored.skeleton_m;
        self.skeleton_samples = SKELETON_SAMPLES;
        self.bones_from = BodySource::Stored as u64;
        self.mass_kg = stored.mass_kg;
        self.weighing = Weighing::stored(stored.mass_kg, stored.mass_sigma_kg);
        self.reset_to_prior(settings);
        if stored.filter.count() != self.reduction.count()
            || !stored.filter.is_sound()
            || !stored.filter.is_within_reach(settings.height_m)
        {
            return false;
        }
        self.filter = stored.filter;
        self.new_stance(settings);
        self.performed = stored.performed;
        self.planner.restore([stored.suggested_before, stored.unholdable]);
        if stored.suggested < settings.library.len() as u64 {
            self.suggested = stored.suggested;
        }
        self.consistency = stored.consistency;
        self.misfit.restore(stored.misfit_m2);
        self.poses_used = stored.poses_used;
        self.identified = u64::from(stored.identified == 1);
        self.identifying = u64::from(stored.identifying == 1 && stored.identified != 1);
        self.last_pose_wxyz = stored.last_pose_wxyz;
        self.is_sound()
    }
}
