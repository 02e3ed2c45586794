//! Stage `anchor`: position and heading of the body on the plate.
//!
//! [`follow`] detects gaps and restarts of the suit and rotates its world, [`anchor`] holds the standing feet.

use bytemuck::{Pod, Zeroable};

use super::alignment::Aligned;
use super::identification::Identification;
use super::registration::{NewRegistration, RegistrationEstimator};
use super::settings::{Motion, Settings};
use super::stored_state::{Registration, SHIFT_VALID_NS};
use super::streams::Streams;
use super::{foot_outline, insoles};
use crate::anchor::Anchor;
use crate::frame::{Pose, SuitWorld, Turn};
use crate::math;
use crate::message::suit::SuitBlocks;
use crate::message::{GroundSample, SuitBody, SuitSample};
use crate::motion::Snapshot;

/// After a gap this long in the suit's samples the subject may stand elsewhere, ns.
const GAP_RESET_NS: u64 = 300_000_000;
/// Tolerance of the gap's length by the suit's counter: a fraction of it …
const COUNTER_TOLERANCE: f64 = 0.2;
/// … plus this constant, s.
const COUNTER_SLACK_S: f64 = 0.5;

/// State of the stage.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Placement {
    /// Positions of the standing feet.
    pub(super) anchor: Anchor,
    /// Registration of the suit world on the plate.
    pub(super) registration: RegistrationEstimator,
    /// Time of the newest suit sample.
    pub(super) suit_time_ns: u64,
    /// The suit's session in that sample.
    session: u64,
    /// The suit's own counter in that sample.
    pub(super) suit_counter: u64,
    /// The suit's counter in the last sample in which it continued from the sample before, and that sample's time.
    steady_counter: u64,
    steady_ns: u64,
    /// 1 while the anchor's shift stems from before the start and no suit sample has confirmed it.
    shift_unconfirmed: u64,
}

/// Continuity of the suit's samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Continuity {
    /// Without a gap.
    Continuous,
    /// The subject may stand elsewhere.
    Gap,
    /// The suit has another world.
    NewWorld,
}

/// A suit sample with the heading of the station world.
pub(super) struct Followed {
    pub(super) suit: SuitSample,
    pub(super) in_suit_world: Pose<SuitWorld>,
    pub(super) continuity: Continuity,
    ground: Option<GroundSample>,
}

/// Compares the sample with the previous one, and rotates it to the station's heading.
pub(super) fn follow(
    settings: &Settings,
    state: &mut Placement,
    aligned: &Aligned,
    streams: &Streams,
) -> Followed {
    let period_s = streams.suit_period_ns as f64 * 1e-9;
    state.confirm_shift(settings, &aligned.suit, period_s);
    let continuity = state.continuity(settings, &aligned.suit, streams, period_s);
    let suit = state.registration.rotated_to_station(&aligned.suit);
    state.suit_time_ns = suit.sample_time_ns;
    let in_suit_world = suit.pose();
    Followed { suit, in_suit_world, continuity, ground: aligned.ground }
}

/// Transforms the sample into the station's world, with the standing feet held to the floor, and places the insoles.
pub(super) fn anchor(
    settings: &Settings,
    state: &mut Placement,
    followed: &Followed,
    subject: &Identification,
    suit_body: Option<&SuitBody>,
) -> Snapshot {
    let (suit, mut in_suit_world) = (&followed.suit, followed.in_suit_world);
    if subject.has_body() && settings.motion != Motion::Paper {
        in_suit_world = in_suit_world.halfway_along(&subject.skeleton());
    }
    let anchor = &mut state.anchor;
    let pose = if settings.suit_drifts { anchor.hold(&in_suit_world) } else { anchor.track(&in_suit_world) };
    let mut snapshot = Snapshot::new(suit.sample_time_ns, &in_suit_world, &pose, subject.anthropometry());
    (snapshot.stance, snapshot.stance_sigma_m) = (anchor.stance(), anchor.stance_sigma_m());
    snapshot.both_feet_stand = u64::from(anchor.both_feet_stand());
    state.registration.ingest_stance(snapshot.stance, snapshot.stance_sigma_m);
    snapshot.time_sigma_ns = suit.sample_time_sigma_ns;
    if suit.has(SuitBlocks::CentreOfMass) {
        let ([x, y, z], [shift_x, shift_y]) = (suit.com_m, snapshot.station_from_suit_m);
        (snapshot.suit_com_m, snapshot.has_suit_com) = ([x + shift_x, y + shift_y, z], 1);
    }
    if suit.has(SuitBlocks::LinearKinematics) {
        (snapshot.acceleration_m_per_s2, snapshot.has_acceleration) = (suit.acceleration_m_per_s2, 1);
    }
    if let Some(ground) = followed.ground {
        // Each stream has its own clock fit. An unknown σ, `u64::MAX`, remains one.
        let sigmas_ns = [snapshot.time_sigma_ns, ground.sample_time_sigma_ns].map(|sigma_ns| sigma_ns as f64);
        snapshot.time_sigma_ns = math::hypot(sigmas_ns) as u64;
        let outlines = foot_outline::both(&pose, suit_body, settings.height_m);
        snapshot.ground = insoles::to_world(&ground, &pose, &outlines);
        snapshot.has_ground = 1;
        state.registration.ingest_ground(&snapshot.ground);
    }
    snapshot
}

impl Placement {
    /// Resumes with a stored registration, which the next suit sample must confirm.
    pub(super) fn resume(&mut self, registration: &Registration) {
        self.anchor.resume(registration.station_from_suit_m);
        self.registration
            .resume(registration.station_from_suit_rad, registration.station_from_suit_sigma_rad);
        self.suit_time_ns = registration.suit_time_ns;
        self.suit_counter = registration.suit_counter;
        (self.steady_counter, self.steady_ns) = (0, 0);
        self.shift_unconfirmed = 1;
    }

    /// Moves the anchor to a new registration.
    pub(super) fn apply(&mut self, new: &NewRegistration) {
        self.anchor.move_world(new.turn, new.by_m);
    }

    /// Moves the body on the plate, m.
    pub(super) fn displace(&mut self, by_m: [f64; 2]) {
        self.anchor.move_world(Turn::by(0.0), by_m);
        self.registration.displace(by_m);
    }

    /// Drops a shift from before the start unless this sample shows that the same suit continued after a short gap.
    fn confirm_shift(&mut self, settings: &Settings, suit: &SuitSample, period_s: f64) {
        if self.shift_unconfirmed == 0 {
            return;
        }
        self.shift_unconfirmed = 0;
        let gap_ns = suit.sample_time_ns.saturating_sub(self.suit_time_ns);
        let suit_continued = self.suit_continued(suit, period_s);
        if !suit_continued || gap_ns > SHIFT_VALID_NS {
            self.anchor = Zeroable::zeroed();
            self.suit_time_ns = 0;
            let heading_sigma_rad =
                if suit_continued { settings.suit_orientation_sigma_rad() } else { core::f64::consts::PI };
            self.registration.mark_lost(heading_sigma_rad);
        }
    }

    /// After a gap in the samples or a restart of the suit the subject may stand elsewhere.
    fn continuity(
        &mut self,
        settings: &Settings,
        suit: &SuitSample,
        streams: &Streams,
        period_s: f64,
    ) -> Continuity {
        let gap_ns = suit.sample_time_ns.saturating_sub(self.suit_time_ns);
        let is_new_world = self.has_restarted(suit, period_s) || streams.moved_ns == suit.sample_time_ns;
        let is_new_session = u64::from(suit.session) != self.session;
        let is_restart = self.suit_time_ns > 0 && (gap_ns > GAP_RESET_NS || is_new_session || is_new_world);
        if is_new_session || self.counter_advanced(suit, period_s) {
            (self.steady_counter, self.steady_ns) = (u64::from(suit.device_counter), suit.sample_time_ns);
        }
        self.session = u64::from(suit.session);
        self.suit_counter = u64::from(suit.device_counter);
        if !is_restart {
            return Continuity::Continuous;
        }
        if settings.suit_drifts {
            self.anchor.mark_lost();
            if is_new_world {
                self.registration.mark_lost(core::f64::consts::PI);
            } else if gap_ns > SHIFT_VALID_NS {
                self.registration.mark_lost(settings.suit_orientation_sigma_rad());
            }
        }
        if is_new_world { Continuity::NewWorld } else { Continuity::Gap }
    }

    /// Whether the suit's counter has advanced since the last sample in proportion to the time.
    fn suit_continued(&self, suit: &SuitSample, period_s: f64) -> bool {
        counted_since(suit, self.suit_counter, self.suit_time_ns, period_s).is_some()
    }

    /// Likewise, by at least one.
    fn counter_advanced(&self, suit: &SuitSample, period_s: f64) -> bool {
        counted_since(suit, self.suit_counter, self.suit_time_ns, period_s).is_some_and(|counted| counted > 0)
    }

    /// Whether the suit restarted: its counter started at zero and is not larger than the elapsed time allows. A
    /// counter that jumps to another value is no restart. An adapter that restarts with the suit may have the same
    /// session; then the counter must be lower in two consecutive samples, because a single one may be an error.
    fn has_restarted(&self, suit: &SuitSample, period_s: f64) -> bool {
        let started_since = |time_ns: u64| {
            let counted_s = f64::from(suit.device_counter) * period_s;
            counted_s <= COUNTER_SLACK_S + (1.0 + COUNTER_TOLERANCE) * since_s(suit, time_ns)
        };
        if u64::from(suit.session) != self.session {
            return !self.suit_continued(suit, period_s) && started_since(self.suit_time_ns);
        }
        self.counter_advanced(suit, period_s)
            && u64::from(suit.device_counter) < self.steady_counter
            && counted_since(suit, self.steady_counter, self.steady_ns, period_s).is_none()
            && started_since(self.steady_ns)
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        self.anchor.is_sound() && self.registration.is_sound() && self.shift_unconfirmed <= 1
    }
}

/// Time from `time_ns` to the sample, s.
fn since_s(suit: &SuitSample, time_ns: u64) -> f64 {
    suit.sample_time_ns.saturating_sub(time_ns) as f64 * 1e-9
}

/// Samples that the suit has counted since it had this counter at `time_ns`; `None` if the time contradicts them. The
/// counter wraps.
fn counted_since(suit: &SuitSample, counter: u64, time_ns: u64, period_s: f64) -> Option<u32> {
    let (counted, gap_s) = (suit.device_counter.wrapping_sub(counter as u32), since_s(suit, time_ns));
    let off_s = (f64::from(counted) * period_s - gap_s).abs();
    (off_s <= COUNTER_SLACK_S + COUNTER_TOLERANCE * gap_s).then_some(counted)
}
