//! Stage `validate`: validity flags of an instant.

use super::differentiate::Instant;
use super::ground::Ground;
use super::identify::Identified;
use super::lag_test::LagVerdict;
use super::loading::Overload;
use super::stillness::Stillness;
use super::streams::Streams;
use crate::message::Validity;
use crate::motion::Snapshot;

/// Device time with a larger σ counts as not tied to host time, ns.
pub(super) const CLOCK_SIGMA_MAX_S: f64 = 0.02;

/// Reasons why values of an instant must not be used.
#[derive(Debug, Clone, Copy)]
pub(super) struct Withheld(Validity);

impl Withheld {
    /// The reasons.
    pub(super) fn reasons(&self) -> Validity {
        self.0
    }

    /// Whether force and motion may belong to different times.
    pub(super) fn is_unsynchronised(&self) -> bool {
        self.0.any_of(Validity::CLOCK_UNSYNCHRONISED)
    }
}

/// Whether a device time of the snapshot is not tied to host time.
pub(super) fn time_is_uncertain(snapshot: &Snapshot) -> bool {
    snapshot.time_sigma_ns as f64 * 1e-9 > CLOCK_SIGMA_MAX_S
}

/// Combines the flags of all stages.
pub(super) fn validate(
    instant: &Instant,
    ground: &Ground,
    stillness: &Stillness,
    overload: Option<&Overload>,
    lag: LagVerdict,
    subject: Identified<'_>,
    streams: &Streams,
) -> Withheld {
    let by_load = overload.map_or(Validity::default(), |overload| overload.invalid);
    let mut invalid = ground.invalid.and(stillness.invalid()).and(by_load);
    let is_unsynchronised = time_is_uncertain(&instant.snapshot) || streams.lag_is_off || lag.is_off;
    invalid.raise(Validity::CLOCK_UNSYNCHRONISED, is_unsynchronised);
    // The results belong to the snapshot, which may predate the body.
    invalid.raise(Validity::BODY_UNKNOWN, !subject.has_body());
    invalid.raise(Validity::POSITION_UNKNOWN, instant.place_is_lost);
    Withheld(invalid)
}
