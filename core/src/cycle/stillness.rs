//! Stage `detect_static`: whether the pose is static, and which accelerations the later stages use.

use super::differentiate::Instant;
use super::ground::Ground;
use super::settings::{Motion, Settings};
use super::streams::Streams;
use crate::message::Validity;
use crate::message::state::AccelerationSource;
use crate::motion::Inertia;
use crate::static_pose::{PoseStatistics, Window, WindowSample};

/// Within this multiple of the static pose thresholds the static equations are accurate enough to publish torques.
const NEARLY_STATIC: f64 = 3.0;

/// Motion of the subject at one instant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stillness {
    /// Statistics of the static pose window; `None` while it fills.
    pub(super) statistics: Option<PoseStatistics>,
    /// Whether the pose is static.
    pub(super) is_static: bool,
    /// Accelerations in use; `None` if the subject moves faster than the equations allow.
    pub(super) inertia: Option<Inertia>,
}

impl Stillness {
    /// Validity flags raised by the stage.
    pub(super) fn invalid(&self) -> Validity {
        if self.inertia.is_none() { Validity::MOVING } else { Validity::default() }
    }

    /// Source of the accelerations.
    pub(super) fn source(&self) -> AccelerationSource {
        let by_suit = self.inertia.is_some_and(|inertia| inertia.is_by_suit);
        if by_suit { AccelerationSource::Suit } else { AccelerationSource::Positions }
    }
}

/// Adds the instant to the static pose window and evaluates it.
pub(super) fn detect_static(
    settings: &Settings,
    window: &mut Window,
    instant: &Instant,
    ground: &Ground,
    streams: &Streams,
) -> Stillness {
    let Instant { snapshot, pose, inertia, .. } = instant;
    match ground.standing_m {
        Some(cop_m) => {
            let sample = WindowSample {
                time_ns: snapshot.time_ns,
                stance: snapshot.stance,
                cop_m,
                vertical_n: snapshot.ground.force_n[2],
                ..bytemuck::Zeroable::zeroed()
            };
            window.push(pose, sample, streams.suit_period_ns);
        }
        None => window.clear(),
    }
    let statistics = window.statistics();
    let is_static = statistics.is_some_and(|window| window.is_static(&settings.static_pose));
    let is_nearly_static =
        statistics.is_some_and(|window| window.is_within(&settings.static_pose, NEARLY_STATIC));
    let inertia = match (settings.motion, inertia) {
        (Motion::Paper, _) => Some(Inertia::REST),
        (_, Some(inertia)) if inertia.is_moderate() => Some(*inertia),
        (_, None) if is_nearly_static => Some(Inertia::REST),
        _ => None,
    };
    Stillness { statistics, is_static, inertia }
}
