//! Body dimensions that the suit reports: accepted once the suit's own poses agree with them.
//!
//! The null pose gives directly and exactly what many poses give on average. But it arrives in another datagram at
//! another time: it may belong to another character, to a session that has ended, or to a body with wrong dimensions.

use bytemuck::{Pod, Zeroable};

use super::identification::{BodySource, Identification};
use super::placement::Followed;
use crate::body::Skeleton;
use crate::frame::{Pose, SuitWorld};
use crate::message::state::FootOutlineSource;
use crate::message::{SuitBody, SuitSample};
use crate::time::NS_PER_S;

/// Poses and null pose of one suit have equal bone lengths; above this difference they belong to different bodies, m.
/// (Recorded null pose and pose of one person: 2 mm, from rounding.)
pub const BONES_AGREE_M: f64 = 0.03;
/// Identification results from other bone lengths are kept if the lengths differ by no more than this, m.
const BONES_REFINED_M: f64 = 0.005;
/// Number of consecutive contradicting poses after which the null pose is rejected: a single sample may be an outlier.
const CONTRADICTIONS: u64 = 20;
/// The suit reports the body once per second; an older message was delayed in transit, ns.
const STALE_AFTER_NS: u64 = 5 * NS_PER_S;
/// A body message dated farther ahead than this uses another clock, ns.
const AHEAD_MAX_NS: u64 = NS_PER_S;

/// Why the last reported body is not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum BodyRejection {
    /// It is used, or none was reported.
    None = 0,
    /// The dimensions are anatomically impossible.
    Impossible = 1,
    /// The message is old: published long ago, or in a session of the suit that has ended.
    Stale = 2,
    /// It belongs to another character than the poses.
    OtherCharacter = 3,
    /// The poses have other bone lengths; the poses take precedence.
    ContradictsPoses = 4,
    /// The poses agree, but the identified subject has other bone lengths and is kept: the profile may be the wrong
    /// one.
    ContradictsWorker = 5,
}

impl BodyRejection {
    const ALL: [BodyRejection; 6] = [
        BodyRejection::None,
        BodyRejection::Impossible,
        BodyRejection::Stale,
        BodyRejection::OtherCharacter,
        BodyRejection::ContradictsPoses,
        BodyRejection::ContradictsWorker,
    ];

    /// The variant of a message's number, `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<BodyRejection> {
        Self::ALL.into_iter().nth(number as usize)
    }

    /// The public name.
    pub fn name(self) -> &'static str {
        match self {
            BodyRejection::None => "none",
            BodyRejection::Impossible => "impossible",
            BodyRejection::Stale => "stale",
            BodyRejection::OtherCharacter => "other_character",
            BodyRejection::ContradictsPoses => "contradicts_poses",
            BodyRejection::ContradictsWorker => "contradicts_worker",
        }
    }
}

/// Body dimensions reported by the suit, and their state of acceptance.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct ReportedBody {
    /// The last plausible message; valid if `published_ns` is not 0.
    message: SuitBody,
    /// 1 once a pose agreed.
    accepted: u64,
    /// Number of consecutive poses that contradicted.
    contradictions: u64,
    /// A [`BodyRejection`].
    refused: u64,
}

impl ReportedBody {
    /// The accepted body dimensions.
    pub fn body(&self) -> Option<&SuitBody> {
        (self.accepted == 1).then_some(&self.message)
    }

    /// Why the last message is not used; the number of a [`BodyRejection`].
    pub(super) fn refused(&self) -> u32 {
        self.refused as u32
    }

    /// Source of the foot outlines.
    pub(super) fn foot_outline_source(&self) -> FootOutlineSource {
        match self.body() {
            Some(body) if body.foot_points != [0; 2] => FootOutlineSource::Suit,
            _ => FootOutlineSource::Stature,
        }
    }

    fn refuse(&mut self, refusal: BodyRejection) {
        self.refused = refusal as u64;
    }

    /// Ingests a body message at `now_ns`; `newest` is the suit's newest sample.
    pub(super) fn ingest(&mut self, body: &SuitBody, newest: Option<&SuitSample>, now_ns: u64) {
        if !body.is_plausible() || body.published_ns > now_ns.saturating_add(AHEAD_MAX_NS) {
            return self.refuse(BodyRejection::Impossible);
        }
        if now_ns.saturating_sub(body.published_ns) > STALE_AFTER_NS
            || newest.is_some_and(|suit| body.session < suit.session)
        {
            return self.refuse(BodyRejection::Stale);
        }
        if newest.is_some_and(|suit| body.avatar != suit.avatar) {
            return self.refuse(BodyRejection::OtherCharacter);
        }
        if self.message.published_ns > 0 && self.message.has_same_dimensions(body) {
            // A repetition; the comparison with the poses stays valid.
            let of_this_one = [BodyRejection::ContradictsPoses, BodyRejection::ContradictsWorker];
            if !of_this_one.iter().any(|refusal| self.refused == *refusal as u64) {
                self.refuse(BodyRejection::None);
            }
            return;
        }
        *self = ReportedBody { message: *body, ..Zeroable::zeroed() };
    }

    /// Withdraws the acceptance after a change of subject: the body is compared with the next poses again.
    pub(super) fn compare_again(&mut self) {
        (self.accepted, self.contradictions) = (0, 0);
        if self.message.published_ns > 0 {
            self.refuse(BodyRejection::None);
        }
    }

    /// Compares one suit pose with the body; returns whether the body has just been accepted.
    fn compare(&mut self, pose: &Pose<SuitWorld>, suit: &SuitSample) -> bool {
        // The suit's software may send the body before the first pose of a session.
        let is_early = self.message.session > suit.session && self.accepted == 0;
        if self.message.published_ns == 0 || is_early {
            return false;
        }
        if self.message.session != suit.session || self.message.avatar != suit.avatar {
            // The suit restarted, or its adapter, which counts sessions from zero; the body of the present wearer will
            // be sent again.
            *self = Zeroable::zeroed();
            self.refuse(BodyRejection::Stale);
            return false;
        }
        if self.message.skeleton().differs_by_m(&Skeleton::of(pose)) <= BONES_AGREE_M {
            self.contradictions = 0;
            let newly = self.accepted == 0;
            if newly {
                self.accepted = 1;
                self.refuse(BodyRejection::None);
            }
            return newly;
        }
        self.contradictions = (self.contradictions + 1).min(CONTRADICTIONS);
        if self.contradictions == CONTRADICTIONS {
            self.accepted = 0;
            self.refuse(BodyRejection::ContradictsPoses);
        }
        false
    }

    /// Whether numbers are in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        (self.message.published_ns == 0 || self.message.is_plausible())
            && self.accepted <= 1
            && (self.accepted == 0 || self.message.published_ns > 0)
            && self.contradictions <= CONTRADICTIONS
            && BodyRejection::from_number(self.refused as u32).is_some()
    }
}

/// Consequence of a pose for the subject's bone lengths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum BoneUpdate {
    /// The poses determine them, as before.
    FromPoses,
    /// Those of the null pose are no longer valid; the next poses determine them.
    Reset,
    /// Those of the null pose are adopted; with `stays`, earlier results are kept.
    Adopt { stays: bool },
}

/// Stage `validate_body`: compares the body with one more pose. Bone lengths measured from poses are replaced by those
/// of the null pose; the bone lengths of a stored profile are kept. `has_results`: whether identification results
/// depend on the bone lengths.
pub(super) fn validate_body(
    state: &mut ReportedBody,
    placed: &Followed,
    subject: &Identification,
    has_results: bool,
) -> BoneUpdate {
    let was_accepted = state.accepted == 1;
    let newly = state.compare(&placed.in_suit_world, &placed.suit);
    if was_accepted && state.accepted == 0 {
        let is_in_use = !has_results && subject.body_source() == BodySource::NullPose;
        return if is_in_use { BoneUpdate::Reset } else { BoneUpdate::FromPoses };
    }
    let Some(body) = state.body() else { return BoneUpdate::FromPoses };
    if !newly && subject.has_body() {
        return BoneUpdate::FromPoses;
    }
    if !subject.has_body() {
        return BoneUpdate::Adopt { stays: false };
    }
    let bones = body.skeleton();
    let differs_by_m = subject.skeleton().differs_by_m(&bones);
    let is_from_suit = subject.body_source() != BodySource::Stored;
    if is_from_suit && (!has_results || differs_by_m <= BONES_REFINED_M) {
        if subject.skeleton() != bones || subject.body_source() != BodySource::NullPose {
            return BoneUpdate::Adopt { stays: has_results };
        }
    } else if differs_by_m > BONES_AGREE_M {
        state.refuse(BodyRejection::ContradictsWorker);
    }
    BoneUpdate::FromPoses
}
