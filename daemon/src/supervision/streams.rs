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
pub(super) const NEVER_CAME_AFTER_NS: u64 = 5_000_000_000;
/// Samples arrive, but the newest one accepted by the loop has not changed for this long. A restart of a device or of a
/// clock fit takes less.
const STALE_AFTER_NS: u64 = 1_000_000_000;

/// Description of the device, for messages.
pub(super) struct Wire {
    /// "the suit", "the plate".
    pub(super) what: &'static str,
    /// Advice if nothing arrives.
    pub(super) check: String,
    /// The adapter's names of refusal reasons, in order.
    pub(super) reasons: &'static [&'static str],
    /// Advice for refusals.
    pub(super) refused: &'static str,
    /// Indices of the reasons which mean that time does not advance.
    pub(super) of_time: &'static [usize],
}

/// Observations of one evaluation interval.
#[derive(Debug, Clone, Copy)]
pub(super) struct StreamLook {
    /// Observed time since the last evaluation.
    pub(super) gap_ns: u64,
    /// Samples in this interval that the loop ingested or ingress refused.
    pub(super) taken: u64,
    /// Sample time of the newest accepted sample.
    pub(super) newest_ns: Option<u64>,
}

/// Condition of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// Samples arrive and are used, or it is too early to decide.
    Fine,
    /// No sample since the start.
    NeverCame,
    /// No more samples.
    Silent,
    /// The device repeats the same sample; the adapter refuses it.
    Repeats,
    /// Samples arrive, and the loop refuses them.
    Refused,
}

/// Monitors one stream.
pub(super) struct StreamWatch {
    wire: Wire,
    came: bool,
    quiet_ns: u64,
    /// Time in which samples arrived without a change of the newest accepted one.
    still_ns: u64,
    newest_ns: Option<u64>,
    /// Last health message of the adapter.
    health: Option<AdapterHealth>,
    /// Samples received and refused between the last two health messages, and the observed time since the last.
    received: u64,
    refused: [u64; REASONS],
    heard_ns: u64,
}

/// Maximum age of a health message, which is published once a second.
const HEALTH_HOLDS_NS: u64 = 2_500_000_000;

impl StreamWatch {
    pub(super) fn new(wire: Wire) -> StreamWatch {
        StreamWatch {
            wire,
            came: false,
            quiet_ns: 0,
            still_ns: 0,
            newest_ns: None,
            health: None,
            received: 0,
            refused: [0; REASONS],
            heard_ns: u64::MAX,
        }
    }

    pub(super) fn what(&self) -> &'static str {
        self.wire.what
    }

    /// Ingests a health message.
    pub(super) fn hear(&mut self, health: &AdapterHealth) {
        // A new process or a restarted adapter counts from zero.
        let before = self
            .health
            .filter(|before| before.process_id == health.process_id && before.received <= health.received);
        let (received, refused) =
            before.map_or((0, [0; REASONS]), |before| (before.received, before.refused));
        self.received = health.received - received;
        self.refused = std::array::from_fn(|reason| health.refused[reason].saturating_sub(refused[reason]));
        self.health = Some(*health);
        self.heard_ns = 0;
    }

    /// Evaluates one interval.
    pub(super) fn look(&mut self, look: StreamLook) -> Verdict {
        self.heard_ns = self.heard_ns.saturating_add(look.gap_ns);
        if look.taken > 0 {
            (self.came, self.quiet_ns) = (true, 0);
        } else {
            self.quiet_ns += look.gap_ns;
        }
        let advanced = look.newest_ns != self.newest_ns;
        self.newest_ns = look.newest_ns;
        let still_ns =
            if self.came && self.quiet_ns == 0 { self.still_ns + look.gap_ns } else { self.still_ns };
        self.still_ns = if advanced { 0 } else { still_ns };

        let patience_ns = if self.came { SILENT_AFTER_NS } else { NEVER_CAME_AFTER_NS };
        if self.quiet_ns < patience_ns {
            return if self.still_ns >= STALE_AFTER_NS { Verdict::Refused } else { Verdict::Fine };
        }
        let repeats = self.wire.of_time.iter().any(|reason| self.refused[*reason] > 0);
        if self.came && repeats && self.heard_ns < HEALTH_HOLDS_NS {
            Verdict::Repeats
        } else if self.came {
            Verdict::Silent
        } else {
            Verdict::NeverCame
        }
    }

    /// Description and advice for a verdict.
    pub(super) fn sentence(&self, verdict: Verdict) -> String {
        let Wire { what, check, refused, .. } = &self.wire;
        match verdict {
            Verdict::Fine => format!("{what} is fine"),
            Verdict::NeverCame | Verdict::Silent => {
                let begins = if verdict == Verdict::Silent {
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
                    None => format!("{what} {begins}: {check}"),
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
            .zip(self.wire.reasons.iter().copied())
            .filter(|(n, _)| *n > 0)
            .collect();
        if counted.is_empty() || self.heard_ns >= HEALTH_HOLDS_NS {
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

    fn watch() -> StreamWatch {
        StreamWatch::new(Wire {
            what: "the suit",
            check: "is it on?".to_owned(),
            reasons: &["length", "duplicate"],
            refused: "; doctor",
            of_time: &[1],
        })
    }

    /// Evaluates `count` intervals with samples whose time increases by `step_ns` each; returns the last verdict.
    fn looks(watch: &mut StreamWatch, count: u64, taken: u64, step_ns: u64) -> Verdict {
        let mut verdict = Verdict::Fine;
        for _ in 0..count {
            let newest_ns = watch.newest_ns.map(|newest| newest + step_ns).or((taken > 0).then_some(1));
            verdict = watch.look(StreamLook { gap_ns: GAP_NS, taken, newest_ns });
        }
        verdict
    }

    fn heard(received: u64, duplicates: u64, length: u64) -> AdapterHealth {
        let mut health = AdapterHealth { received, process_id: 7, ..AdapterHealth::zeroed() };
        (health.refused[0], health.refused[1]) = (length, duplicates);
        health
    }

    #[test]
    fn silence_since_the_start_is_reported_after_five_seconds_and_ends_with_the_first_sample() {
        let mut watch = watch();
        assert_eq!(looks(&mut watch, 99, 0, 0), Verdict::Fine);
        assert_eq!(looks(&mut watch, 1, 0, 0), Verdict::NeverCame);
        assert_eq!(watch.sentence(Verdict::NeverCame), "the suit has sent nothing yet: is it on?");
        assert_eq!(looks(&mut watch, 1, 3, 50), Verdict::Fine);
    }

    #[test]
    fn a_stream_that_ends_is_silent_after_half_a_second_and_comes_back() {
        let mut watch = watch();
        assert_eq!(looks(&mut watch, 100, 3, 50), Verdict::Fine);
        assert_eq!(looks(&mut watch, 9, 0, 0), Verdict::Fine);
        assert_eq!(looks(&mut watch, 1, 0, 0), Verdict::Silent);
        assert_eq!(looks(&mut watch, 1000, 0, 0), Verdict::Silent);
        assert_eq!(looks(&mut watch, 1, 1, 50), Verdict::Fine);
    }

    #[test]
    fn a_slow_suit_brings_nothing_in_many_looks_and_is_not_silent() {
        let mut watch = watch();
        for _ in 0..100 {
            assert_eq!(looks(&mut watch, 1, 1, 50), Verdict::Fine);
            assert_eq!(looks(&mut watch, 4, 0, 0), Verdict::Fine);
        }
    }

    #[test]
    fn samples_whose_time_stands_still_are_refused_and_then_not() {
        let mut watch = watch();
        assert_eq!(looks(&mut watch, 10, 3, 50), Verdict::Fine);
        assert_eq!(looks(&mut watch, 19, 3, 0), Verdict::Fine);
        assert_eq!(looks(&mut watch, 1, 3, 0), Verdict::Refused);
        assert_eq!(looks(&mut watch, 1, 3, 50), Verdict::Fine);
    }

    #[test]
    fn a_stream_that_was_never_accepted_is_refused_too() {
        let mut watch = watch();
        for _ in 0..30 {
            watch.look(StreamLook { gap_ns: GAP_NS, taken: 2, newest_ns: None });
        }
        let last = watch.look(StreamLook { gap_ns: GAP_NS, taken: 2, newest_ns: None });
        assert_eq!(last, Verdict::Refused);
    }

    #[test]
    fn a_paused_stream_repeats_itself_and_is_not_called_silent() {
        let mut watch = watch();
        watch.hear(&heard(100, 0, 0));
        looks(&mut watch, 20, 3, 50);
        watch.hear(&heard(160, 60, 0));
        assert_eq!(looks(&mut watch, 10, 0, 0), Verdict::Repeats);
        assert!(watch.sentence(Verdict::Repeats).contains("60 duplicate"));
        watch.hear(&heard(160, 60, 0));
        assert_eq!(looks(&mut watch, 1, 0, 0), Verdict::Silent, "now it sends nothing at all");
    }

    #[test]
    fn a_stream_of_invalid_samples_is_reported_with_its_reasons() {
        let mut watch = watch();
        watch.hear(&heard(50, 0, 50));
        assert_eq!(looks(&mut watch, 100, 0, 0), Verdict::NeverCame);
        // Five seconds later the health message is outdated.
        assert_eq!(watch.sentence(Verdict::NeverCame), "the suit has sent nothing yet: is it on?");
        watch.hear(&heard(90, 0, 90));
        let verdict = looks(&mut watch, 1, 0, 0);
        let said = watch.sentence(verdict);
        assert!(said.contains("40 datagrams") && said.contains("40 length; doctor"), "{said}");
    }
}
