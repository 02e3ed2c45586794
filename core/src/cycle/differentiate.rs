//! Stage `differentiate`: releases a snapshot from the history once the samples of half a window after it arrived, with
//! the accelerations at its time.

use super::align::AlignState;
use super::identification::Identification;
use super::placement::Placement;
use super::settings::{Motion, Settings};
use super::{foot_outline, insoles};
use crate::body::gyration_m2;
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::message::SuitBody;
use crate::motion::{History, Inertia, MassDistribution, Snapshot};

/// Body and ground at one time, to which all later stages refer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Instant {
    /// The snapshot.
    pub(super) snapshot: Snapshot,
    /// Its pose.
    pub(super) pose: Pose<StationWorld>,
    /// Accelerations; `None` without samples on both sides.
    pub(super) inertia: Option<Inertia>,
    /// Time since the previous instant, s.
    pub(super) step_s: f64,
    /// Body dimensions reported by the suit, if they were accepted.
    pub(super) suit_body: Option<SuitBody>,
    /// Whether position or heading of the body on the plate are unavailable.
    pub(super) place_is_lost: bool,
    /// 1-σ of the heading, rad.
    pub(super) heading_sigma_rad: f64,
}

impl Instant {
    /// Whether both feet stand.
    pub(super) fn both_feet_stand(&self) -> bool {
        self.snapshot.both_feet_stand == 1
    }

    /// 1-σ of a segment's orientation in the station world, rad.
    pub(super) fn orientation_sigma_rad(&self, settings: &Settings) -> f64 {
        math::hypot([settings.suit_orientation_sigma_rad(), self.heading_sigma_rad])
    }
}

/// The next snapshot whose window is complete.
pub(super) fn differentiate(
    settings: &Settings,
    history: &mut History,
    align: &AlignState,
    placement: &Placement,
    subject: &Identification,
    suit_body: Option<&SuitBody>,
) -> Option<Instant> {
    let before_ns = history.released_ns();
    let half_ns = settings.half_window_ns();
    let gyration_m2 = gyration_m2(&subject.skeleton(), settings.height_m);
    let masses = MassDistribution { body: subject.anthropometry(), gyration_m2: &gyration_m2 };
    let (mut snapshot, inertia) = history.next(half_ns, settings.accelerations, &masses)?;
    let pose = snapshot.pose();
    // The force that belongs to accelerations by positions is the mean over the same window.
    let by_positions = inertia.is_some_and(|inertia| !inertia.is_by_suit);
    if by_positions
        && settings.motion != Motion::Paper
        && let Some(time_ns) = snapshot.ground().map(|ground| ground.sample_time_ns)
        && let Some(ground) = align.alignment.ground_around(time_ns, half_ns)
    {
        let outlines = foot_outline::both(&pose, suit_body, settings.height_m);
        snapshot.ground = insoles::to_world(&ground, &pose, &outlines);
    }
    Some(Instant {
        snapshot,
        pose,
        inertia,
        step_s: snapshot.time_ns.saturating_sub(before_ns) as f64 * 1e-9,
        suit_body: suit_body.copied(),
        place_is_lost: placement.registration.is_lost(),
        heading_sigma_rad: placement.registration.heading_sigma_rad(),
    })
}
