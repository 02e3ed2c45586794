//! Classifies one stream of samples: silent, repeating, refused, or fine.
//!
//! `valid` informs consumers of silence within two sample periods. An incident is for people: it begins slightly later
//! and contains advice.

use equipoise_core::message::AdapterHealth;
use equipoise_core::message::health::REASONS;

/// Silence after which an active stream counts as ended. By then a plate that lost a request has been polled again
/// (after 0.1 s), and a short radio interruption is over.
pub(super) const SILENT_AFTER_NS: u64 = 500_000_000;
/// Time after the start in which sensors may still be switched on.
pub(super) const NEVER_STARTED_AFTER_NS: u64 = 5_000_000_000;
/// Samples arrive, but the newest one accepted by the loop has not changed for this long. A restart of a device or of a
/// clock fit takes less.
const STALE_AFTER_NS: u64 = 1_000_000_000;

/// Description of the device, for messages.
pub(super) struct StreamDescription {
    /// "the suit", "the plate".
    pub(super) what: &'static str,
    /// Advice if nothing arrives.
    pub(super) check: String,
    /// The adapter's names of refusal reasons, in order.
    pub(super) reasons: &'static [&'static str],
    /// Advice for refusals.
    pub(super) refused: &'static str,
    /// Indices of the reasons which mean that time does not advance.
    pub(super) time_reasons: &'static [usize],
}

/// Observations of one evaluation interval.
#[derive(Debug, Clone, Copy)]
pub(super) struct StreamSample {
    /// Observed time since the last evaluation.
    pub(super) gap_ns: u64,
    /// Samples in this interval that the loop ingested or ingress refused.
    pub(super) ingested: u64,
    /// Sample time of the newest accepted sample.
    pub(super) newest_ns: Option<u64>,
}

/// Condition of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// Samples arrive and are used, or it is too early to decide.
    Healthy,
    /// No sample since the start.
    NeverStarted,
    /// No more samples.
    Silent,
    /// The device repeats the same sample; the adapter refuses it.
    Repeats,
    /// Samples arrive, and the loop refuses them.
    Refused,
}

/// Monitors one stream.
pub(super) struct StreamMonitor {
    description: StreamDescription,
    started: bool,
    quiet_ns: u64,
    /// Time in which samples arrived without a change of the newest accepted one.
    unchanged_ns: u64,
    newest_ns: Option<u64>,
    /// Last health message of the adapter.
    health: Option<AdapterHealth>,
    /// Samples received and refused between the last two health messages, and the observed time since the last.
    received: u64,
    refused: [u64; REASONS],
    health_age_ns: u64,
}

/// Maximum age of a health message, which is published once a second.
const HEALTH_VALID_NS: u64 = 2_500_000_000;

impl StreamMonitor {
    pub(super) fn new(description: StreamDescription) -> StreamMonitor {
        StreamMonitor {
            description,
            started: false,
            quiet_ns: 0,
            unchanged_ns: 0,
            newest_ns: None,
            health: None,
            received: 0,
            refused: [0; REASONS],
            health_age_ns: u64::MAX,
        }
    }

    pub(super) fn what(&self) -> &'static str {
        self.description.what
    }

    /// Ingests a health message.
    pub(super) fn ingest_health(&mut self, health: &AdapterHealth) {
        // A new process or a restarted adapter counts from zero.
        let before = self
            .health
            .filter(|before| before.process_id == health.process_id && before.received <= health.received);
        let (received, refused) =
            before.map_or((0, [0; REASONS]), |before| (before.received, before.refused));
        self.received = health.received - received;
        self.refused = std::array::from_fn(|reason| health.refused[reason].saturating_sub(refused[reason]));
        self.health = Some(*health);
        self.health_age_ns = 0;
    }

    /// Evaluates one interval.
    pub(super) fn update(&mut self, sample: StreamSample) -> Verdict {
        self.health_age_ns = self.health_age_ns.saturating_add(sample.gap_ns);
        if sample.ingested > 0 {
            (self.started, self.quiet_ns) = (true, 0);
        } else {
            self.quiet_ns += sample.gap_ns;
        }
        let advanced = sample.newest_ns != self.newest_ns;
        self.newest_ns = sample.newest_ns;
        let unchanged_ns = if self.started && self.quiet_ns == 0 {
            self.unchanged_ns + sample.gap_ns
        } else {
            self.unchanged_ns
        };
        self.unchanged_ns = if advanced { 0 } else { unchanged_ns };

        let timeout_ns = if self.started { SILENT_AFTER_NS } else { NEVER_STARTED_AFTER_NS };
        if self.quiet_ns < timeout_ns {
            return if self.unchanged_ns >= STALE_AFTER_NS { Verdict::Refused } else { Verdict::Healthy };
        }
        let repeats = self.description.time_reasons.iter().any(|reason| self.refused[*reason] > 0);
        if self.started && repeats && self.health_age_ns < HEALTH_VALID_NS {
            Verdict::Repeats
        } else if self.started {
            Verdict::Silent
        } else {
            Verdict::NeverStarted
        }
    }

    /// Description and advice for a verdict.
    pub(super) fn message(&self, verdict: Verdict) -> String {
        let StreamDescription { what, check, refused, .. } = &self.description;
        match verdict {
            Verdict::Healthy => format!("{what} is fine"),
            Verdict::NeverStarted | Verdict::Silent => {
                let state = if verdict == Verdict::Silent {
                    "sends nothing any more"
                } else {
                    "has sent nothing yet"
                };
                match self.refusals() {
                    Some(refusals) => format!(
                        "{what} brings no sample: {} datagrams came in the last second, and were refused: \
                         {refusals}{refused}",
                        self.received
                    ),
                    None => format!("{what} {state}: {check}"),
                }
            }
            Verdict::Repeats => format!(
                "{what} sends the same samples again and again ({}): its stream is paused, or its device hangs; \
                 restart the stream",
                self.refusals().unwrap_or_default()
            ),
            Verdict::Refused => format!(
                "samples of {what} come, but the loop refuses them: their time does not advance, lies in the future, \
                 or their numbers are impossible; restart its adapter on this computer's clock"
            ),
        }
    }

    /// Refusals between the last two health messages, most frequent first.
    fn refusals(&self) -> Option<String> {
        let mut counted: Vec<(u64, &str)> = self
            .refused
            .iter()
            .copied()
            .zip(self.description.reasons.iter().copied())
            .filter(|(n, _)| *n > 0)
            .collect();
        if counted.is_empty() || self.health_age_ns >= HEALTH_VALID_NS {
            return None;
        }
        counted.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
        Some(counted.iter().map(|(count, name)| format!("{count} {name}")).collect::<Vec<_>>().join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    const GAP_NS: u64 = 50_000_000;

    fn monitor() -> StreamMonitor {
        StreamMonitor::new(StreamDescription {
            what: "the suit",
            check: "is it on?".to_owned(),
            reasons: &["length", "duplicate"],
            refused: "; doctor",
            time_reasons: &[1],
        })
    }

    /// Evaluates `count` intervals with samples whose time increases by `step_ns` each; returns the last verdict.
    fn updates(monitor: &mut StreamMonitor, count: u64, ingested: u64, step_ns: u64) -> Verdict {
        let mut verdict = Verdict::Healthy;
        for _ in 0..count {
            let newest_ns = monitor.newest_ns.map(|newest| newest + step_ns).or((ingested > 0).then_some(1));
            verdict = monitor.update(StreamSample { gap_ns: GAP_NS, ingested, newest_ns });
        }
        verdict
    }

    fn health(received: u64, duplicates: u64, length: u64) -> AdapterHealth {
        let mut health = AdapterHealth { received, process_id: 7, ..AdapterHealth::zeroed() };
        (health.refused[0], health.refused[1]) = (length, duplicates);
        health
    }

    #[test]
    fn silence_since_the_start_is_reported_after_five_seconds_and_ends_with_the_first_sample() {
        let mut monitor = monitor();
        assert_eq!(updates(&mut monitor, 99, 0, 0), Verdict::Healthy);
        assert_eq!(updates(&mut monitor, 1, 0, 0), Verdict::NeverStarted);
        assert_eq!(monitor.message(Verdict::NeverStarted), "the suit has sent nothing yet: is it on?");
        assert_eq!(updates(&mut monitor, 1, 3, 50), Verdict::Healthy);
    }

    #[test]
    fn a_stream_that_ends_is_silent_after_half_a_second_and_recovers() {
        let mut monitor = monitor();
        assert_eq!(updates(&mut monitor, 100, 3, 50), Verdict::Healthy);
        assert_eq!(updates(&mut monitor, 9, 0, 0), Verdict::Healthy);
        assert_eq!(updates(&mut monitor, 1, 0, 0), Verdict::Silent);
        assert_eq!(updates(&mut monitor, 1000, 0, 0), Verdict::Silent);
        assert_eq!(updates(&mut monitor, 1, 1, 50), Verdict::Healthy);
    }

    #[test]
    fn a_slow_suit_is_not_silent() {
        let mut monitor = monitor();
        for _ in 0..100 {
            assert_eq!(updates(&mut monitor, 1, 1, 50), Verdict::Healthy);
            assert_eq!(updates(&mut monitor, 4, 0, 0), Verdict::Healthy);
        }
    }

    #[test]
    fn samples_with_constant_time_are_refused_until_it_advances() {
        let mut monitor = monitor();
        assert_eq!(updates(&mut monitor, 10, 3, 50), Verdict::Healthy);
        assert_eq!(updates(&mut monitor, 19, 3, 0), Verdict::Healthy);
        assert_eq!(updates(&mut monitor, 1, 3, 0), Verdict::Refused);
        assert_eq!(updates(&mut monitor, 1, 3, 50), Verdict::Healthy);
    }

    #[test]
    fn a_stream_whose_samples_were_all_refused_is_reported() {
        let mut monitor = monitor();
        for _ in 0..30 {
            monitor.update(StreamSample { gap_ns: GAP_NS, ingested: 2, newest_ns: None });
        }
        let last = monitor.update(StreamSample { gap_ns: GAP_NS, ingested: 2, newest_ns: None });
        assert_eq!(last, Verdict::Refused);
    }

    #[test]
    fn a_paused_stream_is_repeating_not_silent() {
        let mut monitor = monitor();
        monitor.ingest_health(&health(100, 0, 0));
        updates(&mut monitor, 20, 3, 50);
        monitor.ingest_health(&health(160, 60, 0));
        assert_eq!(updates(&mut monitor, 10, 0, 0), Verdict::Repeats);
        assert!(monitor.message(Verdict::Repeats).contains("60 duplicate"));
        monitor.ingest_health(&health(160, 60, 0));
        assert_eq!(updates(&mut monitor, 1, 0, 0), Verdict::Silent, "now it sends nothing at all");
    }

    #[test]
    fn a_stream_of_invalid_samples_is_reported_with_its_reasons() {
        let mut monitor = monitor();
        monitor.ingest_health(&health(50, 0, 50));
        assert_eq!(updates(&mut monitor, 100, 0, 0), Verdict::NeverStarted);
        // Five seconds later the health message is outdated.
        assert_eq!(monitor.message(Verdict::NeverStarted), "the suit has sent nothing yet: is it on?");
        monitor.ingest_health(&health(90, 0, 90));
        let verdict = updates(&mut monitor, 1, 0, 0);
        let output = monitor.message(verdict);
        assert!(output.contains("40 datagrams") && output.contains("40 length; doctor"), "{output}");
    }
}
