//! What of a worker is kept for good: what a later start needs, without what it can work out again.
//!
//! The stance's offset is not in it, nor what θ has in common with it: whoever starts again has not seen the worker for
//! a while, and then the offset begins anew (`monitoring`, `lose_sight_after_a_gap`). What P says of θ alone is the
//! marginal of both, so it stays right without the other.

use bytemuck::{Pod, Zeroable};

use super::{BodySource, Consistency, Identification, SKELETON_SAMPLES};
use crate::body::{JOINTS, SEGMENTS};
use crate::cycle::settings::Settings;
use crate::kalman::Filter;
use crate::pose_suggestion::Performed;

/// Bones longer than this are nobody's, m.
const BONE_MAX_M: f64 = 3.0;

/// A worker as a profile keeps one. About 77 kB.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct KeptWorker {
    /// 1 once the bones are known; before that there is nothing to keep.
    pub has_body: u64,
    /// Bones: each segment's origin in its parent, m.
    pub skeleton_m: [[f64; 3]; SEGMENTS],
    /// Body mass, kg; 0 while unknown.
    pub mass_kg: f64,
    /// θ and P; what it says of the stance is not put back.
    pub filter: Filter,
    /// Poses performed, as Eq. 11 compares them.
    pub performed: Performed,
    /// One bit per pose of the library that was asked for already.
    pub asked: u64,
    /// One bit per pose of the library that this worker could not hold.
    pub unholdable: u64,
    /// The pose of the library that is asked for now, or [`super::NO_POSE`].
    pub suggested: u64,
    /// Whether what was measured agrees with what was believed.
    pub consistency: Consistency,
    /// Held poses that entered the filter.
    pub poses_used: u64,
    /// 1 while held poses enter the filter.
    pub learning: u64,
    /// 1 once identification was finished.
    pub identified: u64,
    /// `parent_from_segment` of the last pose used, scalar first: it is not used again.
    pub last_pose_wxyz: [[f64; 4]; JOINTS],
}

impl Identification {
    /// Copies what is to be kept.
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

    /// Puts a kept worker in place. Whether it fits; if not, the worker must not be used.
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
