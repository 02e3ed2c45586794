//! Limits of the streams' latencies, individually and relative to each other.

use super::ground::GroundConfig;
use super::method::Checked;
use super::suit::SuitConfig;

/// Maximum latency of a stream, ms.
pub(super) const LATENCY_MAX_MS: f64 = 1000.0;
/// Number of ground samples that the loop stores for a late suit (`core::cycle::alignment`), less a fifth for network
/// delays; two windows of motion, 0.14 s, are subtracted …
const GROUND_SAMPLES_STORED: f64 = 1024.0 * 0.8;
const WINDOWS_MS: f64 = 140.0;
/// … with this rate, Hz, if the plate's rate is not configured …
const DEFAULT_HZ: f64 = 1000.0;
/// Maximum difference between the streams in either direction, ms: the loop stores 128 suit samples (0.53 s at 240 Hz)
/// for a late plate.
const LATENCY_DIFFERENCE_MAX_MS: f64 = 500.0;

/// Converts checked milliseconds, neither negative nor too large, to ns.
pub(super) fn span_ns(milliseconds: f64) -> u64 {
    (milliseconds * 1e6).round() as u64
}

/// Checks that the alignment of both streams can compensate the difference.
pub(super) fn check(suit: &SuitConfig, ground: &GroundConfig) -> Checked {
    let suit_later_ms = suit.latency_ms - ground.latency_ms;
    let stored_ms = GROUND_SAMPLES_STORED / ground.configured_rate_hz().unwrap_or(DEFAULT_HZ) * 1e3;
    let suit_later_max_ms = (stored_ms - WINDOWS_MS).min(LATENCY_DIFFERENCE_MAX_MS);
    if suit_later_ms > suit_later_max_ms {
        return Err((
            "suit.latency_ms",
            format!(
                "the streams are {suit_later_ms:.0} ms apart; the suit may be {suit_later_max_ms:.0} ms later than this \
                 ground"
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
