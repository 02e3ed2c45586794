//! Stored data of a subject: what a later start needs and cannot recompute.
//!
//! It excludes the stance offset and its covariance with θ: after a restart there is a gap in the data, and the offset
//! starts again (`monitoring`, `lose_sight_after_a_gap`). The part of P for θ alone is its marginal, so it remains
//! correct without the offset.

use bytemuck::{Pod, Zeroable};

use super::{BodySource, Consistency, Identification, SKELETON_SAMPLES};
use crate::body::{JOINTS, SEGMENTS};
use crate::cycle::settings::Settings;
use crate::kalman::Filter;
use crate::pose_suggestion::Performed;

/// Upper bound of a bone length, m.
const BONE_MAX_M: f64 = 3.0;

/// A subject as stored in a profile. About 77 kB.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct KeptWorker {
    /// 1 once the bone lengths are available; there is nothing to store before.
    pub has_body: u64,
    /// Bone lengths: each segment's origin in its parent, m.
    pub skeleton_m: [[f64; 3]; SEGMENTS],
    /// Body mass, kg; 0 if unavailable.
    pub mass_kg: f64,
    /// θ and P; the part for the stance is not restored.
    pub filter: Filter,
    /// Poses performed, as compared by Eq. 11.
    pub performed: Performed,
    /// One bit per pose of the library that was suggested already.
    pub asked: u64,
    /// One bit per pose of the library that the subject could not hold.
    pub unholdable: u64,
    /// The pose of the library that is suggested now, or [`super::NO_POSE`].
    pub suggested: u64,
    /// Consistency of the measurements with the prior.
    pub consistency: Consistency,
    /// Static poses that updated the filter.
    pub poses_used: u64,
    /// 1 while static poses update the filter.
    pub learning: u64,
    /// 1 once identification is complete.
    pub identified: u64,
    /// `parent_from_segment` of the last pose used, scalar first: the filter does not use it again.
    pub last_pose_wxyz: [[f64; 4]; JOINTS],
}

impl Identification {
    /// Copies the data to be stored.
    pub fn keep(&self, kept: &mut KeptWorker) {
        kept.has_body = u64::from(self.has_body());
        kept.skeleton_m = self.skeleton_m;
        kept.mass_kg = self.mass_kg;
        kept.filter.copy_from(&self.filter);
        kept.performed.copy_from(&self.performed);
        [kept.asked, kept.unholdable] = self.planner.history();
        kept.suggested = self.suggested;
        kept.consistency = self.consistency;
        kept.poses_used = self.poses_used;
        kept.learning = self.learning;
        kept.identified = self.identified;
        kept.last_pose_wxyz = self.last_pose_wxyz;
    }

    /// Restores a stored subject. Returns whether it fits the settings; if not, the subject must not be used.
    pub fn restore(&mut self, kept: &KeptWorker, settings: &Settings) -> bool {
        let mut bones = kept.skeleton_m.iter().flatten();
        if kept.has_body != 1 || !bones.all(|metres| metres.is_finite() && metres.abs() < BONE_MAX_M) {
            return false;
        }
        self.start(settings);
        self.skeleton_m = kept.skeleton_m;
        self.skeleton_samples = SKELETON_SAMPLES;
        self.bones_from = BodySource::Stored as u64;
        self.mass_kg = kept.mass_kg;
        self.return_to_prior(settings);
        if kept.filter.count() != self.reduction.count() || !kept.filter.is_sound() {
            return false;
        }
        self.filter = kept.filter;
        self.new_stance(settings);
        self.performed = kept.performed;
        self.planner.remember([kept.asked, kept.unholdable]);
        if kept.suggested < settings.library.len() as u64 {
            self.suggested = kept.suggested;
        }
        self.consistency = kept.consistency;
        self.poses_used = kept.poses_used;
        self.identified = u64::from(kept.identified == 1);
        self.learning = u64::from(kept.learning == 1 && kept.identified != 1);
        self.last_pose_wxyz = kept.last_pose_wxyz;
        self.is_sound()
    }
}
