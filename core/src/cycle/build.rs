//! This worker's build as the suit tells it: believed once the suit's own poses agree with it.
//!
//! The null pose says at once and exactly what many poses say on average. But it is another datagram, of another time:
//! it may be of another character, of a session that has ended, or of a body that was entered wrongly.

use bytemuck::{Pod, Zeroable};

use super::identification::BodySource;
use super::memory::Memory;
use super::settings::Settings;
use crate::body::Skeleton;
use crate::frame::{Pose, SuitWorld};
use crate::message::state::SoleSource;
use crate::message::{SuitBody, SuitSample};
use crate::time::NS_PER_S;

/// Poses and null pose of one suit have bones of one length; so far apart they are not of one body, m. (A recorded
/// null pose and pose of one person: 2 mm, from rounding.)
pub const BONES_AGREE_M: f64 = 0.03;
/// What was learnt on other bones stays if they differ by no more than this, m.
const BONES_REFINED_M: f64 = 0.005;
/// So many poses in a row must contradict before the null pose is dropped: one odd sample is no proof.
const CONTRADICTIONS: u64 = 20;
/// A build is told once a second; one that was published longer ago was waiting somewhere, ns.
const STALE_AFTER_NS: u64 = 5 * NS_PER_S;
/// A build dated farther ahead than this is of another clock, ns.
const AHEAD_MAX_NS: u64 = NS_PER_S;

/// Why the build that the suit told last is not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum BodyRefusal {
    /// It is used, or none was told.
    None = 0,
    /// No person is built like that.
    Impossible = 1,
    /// It is old: published long ago, or told in a session of the suit that has ended.
    Stale = 2,
    /// It is another character's than the poses'.
    OtherCharacter = 3,
    /// The poses have bones of other lengths; the poses are believed.
    ContradictsPoses = 4,
    /// The poses agree, but what was learnt of this worker has other bones, and is kept: is it the right profile?
    ContradictsWorker = 5,
}

impl BodyRefusal {
    const ALL: [BodyRefusal; 6] = [
        BodyRefusal::None,
        BodyRefusal::Impossible,
        BodyRefusal::Stale,
        BodyRefusal::OtherCharacter,
        BodyRefusal::ContradictsPoses,
        BodyRefusal::ContradictsWorker,
    ];

    /// The reason of a message's number, `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<BodyRefusal> {
        Self::ALL.into_iter().nth(number as usize)
    }

    /// The public name.
    pub fn name(self) -> &'static str {
        match self {
            BodyRefusal::None => "none",
            BodyRefusal::Impossible => "impossible",
            BodyRefusal::Stale => "stale",
            BodyRefusal::OtherCharacter => "other_character",
            BodyRefusal::ContradictsPoses => "contradicts_poses",
            BodyRefusal::ContradictsWorker => "contradicts_worker",
        }
    }
}

/// What the suit says of this worker's build.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Build {
    /// The last that could be; means something if it was published.
    told: SuitBody,
    /// 1 once a pose agreed.
    believed: u64,
    /// Poses in a row that contradicted.
    contradicting: u64,
    /// A [`BodyRefusal`].
    refused: u64,
}

impl Build {
    /// What is believed of the worker's build.
    pub fn body(&self) -> Option<&SuitBody> {
        (self.believed == 1).then_some(&self.told)
    }

    /// Why the last one told is not used; a [`BodyRefusal`]'s number.
    pub(super) fn refused(&self) -> u32 {
        self.refused as u32
    }

    /// Where the outline of the soles comes from.
    pub(super) fn sole_source(&self) -> SoleSource {
        match self.body() {
            Some(body) if body.foot_points != [0; 2] => SoleSource::Suit,
            _ => SoleSource::Stature,
        }
    }

    fn refuse(&mut self, refusal: BodyRefusal) {
        self.refused = refusal as u64;
    }

    /// Takes in what the suit says at `now_ns`; `newest` is its newest sample.
    fn hear(&mut self, body: &SuitBody, newest: Option<&SuitSample>, now_ns: u64) {
        if !body.is_plausible() || body.published_ns > now_ns.saturating_add(AHEAD_MAX_NS) {
            return self.refuse(BodyRefusal::Impossible);
        }
        if now_ns.saturating_sub(body.published_ns) > STALE_AFTER_NS
            || newest.is_some_and(|suit| body.session < suit.session)
        {
            return self.refuse(BodyRefusal::Stale);
        }
        if newest.is_some_and(|suit| body.avatar != suit.avatar) {
            return self.refuse(BodyRefusal::OtherCharacter);
        }
        if self.told.published_ns > 0 && self.told.is_same_build(body) {
            // Said again; what the poses said of it holds.
            let of_this_one = [BodyRefusal::ContradictsPoses, BodyRefusal::ContradictsWorker];
            if !of_this_one.iter().any(|refusal| self.refused == *refusal as u64) {
                self.refuse(BodyRefusal::None);
            }
            return;
        }
        *self = Build { told: *body, ..Zeroable::zeroed() };
    }

    /// Holds one pose of the suit against it; whether it has just become believed.
    fn compare(&mut self, pose: &Pose<SuitWorld>, suit: &SuitSample) -> bool {
        // The suit's software may tell of the wearer before the first pose of a session.
        let is_early = self.told.session > suit.session && self.believed == 0;
        if self.told.published_ns == 0 || is_early {
            return false;
        }
        if self.told.session != suit.session || self.told.avatar != suit.avatar {
            // The suit was started anew, or its adapter, which counts sessions from zero: whoever wears it now is told of
            // again.
            *self = Zeroable::zeroed();
            self.refuse(BodyRefusal::Stale);
            return false;
        }
        if self.told.skeleton().differs_by_m(&Skeleton::of(pose)) <= BONES_AGREE_M {
            self.contradicting = 0;
            let newly = self.believed == 0;
            if newly {
                self.believed = 1;
                self.refuse(BodyRefusal::None);
            }
            return newly;
        }
        self.contradicting = (self.contradicting + 1).min(CONTRADICTIONS);
        if self.contradicting == CONTRADICTIONS {
            self.believed = 0;
            self.refuse(BodyRefusal::ContradictsPoses);
        }
        false
    }

    /// Whether numbers are in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        (self.told.published_ns == 0 || self.told.is_plausible())
            && self.believed <= 1
            && (self.believed == 0 || self.told.published_ns > 0)
            && self.contradicting <= CONTRADICTIONS
            && BodyRefusal::from_number(self.refused as u32).is_some()
    }
}

impl Memory {
    /// Takes in what the suit says of its wearer's build.
    pub(super) fn hear_build(&mut self, body: &SuitBody, now_ns: u64) {
        let newest = self.alignment.newest_suit().copied();
        self.build.hear(body, newest.as_ref(), now_ns);
    }

    /// Holds the build against one more pose. Bones that the poses showed become the null pose's; a stored profile's
    /// stay.
    pub(super) fn follow_build(&mut self, pose: &Pose<SuitWorld>, suit: &SuitSample, settings: &Settings) {
        let was_believed = self.build.believed == 1;
        let newly = self.build.compare(pose, suit);
        let untaught = self.is_untaught();
        let worker = &mut self.identification;
        if was_believed && self.build.believed == 0 {
            if untaught && worker.body_source() == BodySource::NullPose {
                worker.forget_bones();
            }
            return;
        }
        let Some(body) = self.build.body() else { return };
        if !newly && worker.has_body() {
            return;
        }
        let bones = body.skeleton();
        if !worker.has_body() {
            worker.adopt_bones(&bones, false, settings);
            return;
        }
        let differs_by_m = worker.skeleton().differs_by_m(&bones);
        let shown_by_the_suit = worker.body_source() != BodySource::Stored;
        if shown_by_the_suit && (untaught || differs_by_m <= BONES_REFINED_M) {
            if worker.skeleton() != bones || worker.body_source() != BodySource::NullPose {
                worker.adopt_bones(&bones, !untaught, settings);
                // Another body from one moment to the next would look like a leap of its centre of mass.
                self.history.clear();
            }
        } else if differs_by_m > BONES_AGREE_M {
            self.build.refuse(BodyRefusal::ContradictsWorker);
        }
    }

    /// Whether nothing was learnt yet that rests on the bones.
    fn is_untaught(&self) -> bool {
        let worker = &self.identification;
        worker.poses_used == 0 && worker.identified == 0 && self.known.motion_samples_used == 0
    }
}
