//! Limits of the streams' latencies, individually and relative to each other.

use super::ground::GroundConfig;
use super::method::Checked;
use super::overload::OverloadConfig;
use super::suit::SuitConfig;

/// Maximum latency of a stream, ms.
pub(super) const LATENCY_MAX_MS: f64 = 1000.0;
/// Number of ground samples that the loop stores for a late suit (`core::cycle::alignment`), less a fifth for network
/// delays. They cover the latency and both halves of the motion window …
const GROUND_SAMPLES_STORED: f64 = 1024.0 * 0.8;
/// … at this rate, Hz, if the plate's rate is not configured.
const DEFAULT_HZ: f64 = 1000.0;
/// Maximum difference between the streams in either direction, ms: the loop stores 128 suit samples (0.53 s at 240 Hz)
/// for a late plate.
const LATENCY_DIFFERENCE_MAX_MS: f64 = 500.0;

/// Converts checked milliseconds, neither negative nor too large, to ns.
pub(super) fn span_ns(milliseconds: f64) -> u64 {
    (milliseconds * 1e6).round() as u64
}

/// Checks that the alignment of both streams can compensate the difference.
pub(super) fn check(suit: &SuitConfig, ground: &GroundConfig, overload: &OverloadConfig) -> Checked {
    let suit_later_ms = suit.latency_ms - ground.latency_ms;
    let stored_ms = GROUND_SAMPLES_STORED / ground.configured_rate_hz().unwrap_or(DEFAULT_HZ) * 1e3;
    let window_ms = 2.0 * overload.half_window_ms();
    let suit_later_max_ms = (stored_ms - window_ms).min(LATENCY_DIFFERENCE_MAX_MS);
    if suit_later_ms > suit_later_max_ms && suit_later_ms > 0.0 {
        return Err((
            "suit.latency_ms",
            format!(
                "the streams are {suit_later_ms:.0} ms apart; with this ground and overload.motion_window_ms the suit may \
                 be {:.0} ms later",
                suit_later_max_ms.max(0.0)
            ),
        ));
    }
    if suit_later_ms > suit_later_max_ms {
        return Err((
            "overload.motion_window_ms",
            format!(
                "the window spans {window_ms:.0} ms, and {stored_ms:.0} ms of this ground are stored; set a shorter window, \
                 or a lower rate of the ground"
            ),
        ));
    }
    let ground_later_ms = ground.latest_ms() - suit.latency_ms;
    if ground_later_ms > LATENCY_DIFFERENCE_MAX_MS {
        let (key, reason) = match ground.gathers() {
            Some(key) => (key, ", since it gathers its samples into blocks: a higher rate has shorter ones"),
            None => ("ground.latency_ms", ""),
        };
        return Err((
            key,
            format!(
                "the streams are {ground_later_ms:.0} ms apart{reason}; the ground may be {LATENCY_DIFFERENCE_MAX_MS:.0} ms later \
                 than the suit"
            ),
        ));
    }
    Ok(())
}
