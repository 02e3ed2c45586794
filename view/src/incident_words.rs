//! Incidents in plain English: what each kind means, and what to do about it. `docs/operation.md` has the same table.

use equipoise_core::message::{Incident, Incidents};
use equipoise_core::time::seconds;

/// What a kind of incident means, and what to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Words {
    /// What has happened.
    pub meaning: &'static str,
    /// What a person does about it.
    pub to_do: &'static str,
}

/// The words of a kind.
pub const fn words(kind: Incident) -> Words {
    let (meaning, to_do) = match kind {
        Incident::SuitSilent => (
            "no suit sample for half a second, or none within 5 s of the start",
            "look at MVN: is the Network Streamer on, not paused, and does it send to suit.listen?",
        ),
        Incident::GroundSilent => (
            "no ground sample for half a second, or none within 5 s of the start",
            "look at the plate: power, cable, ground.address; has another client taken its stream?",
        ),
        Incident::SuitStampsStale => (
            "suit samples come, but their time does not advance, or the loop refuses them",
            "start MVN's stream anew; run a separate adapter on this computer, outside containers",
        ),
        Incident::GroundStampsStale => (
            "ground samples come, but their time does not advance, or the loop refuses them",
            "start the plate anew; run a separate adapter on this computer, outside containers",
        ),
        Incident::SuitAdapterDown => (
            "the suit's adapter has ended by itself",
            "nothing if it ends soon: it is started again after 0.25 s to 8 s; else the journal has its last words",
        ),
        Incident::GroundAdapterDown => (
            "the ground's adapter has ended by itself",
            "nothing if it ends soon: it is started again after 0.25 s to 8 s; else the journal has its last words",
        ),
        Incident::InputOverflow => (
            "the ring before the loop was full and lost samples",
            "see loop_stalled; a plate that sends more than the loop takes in needs a lower rate, or a higher loop.rate_hz",
        ),
        Incident::OutputOverflow => (
            "the ring behind the loop was full and lost states",
            "give the machine a free core; see `equipoise doctor`",
        ),
        Incident::ClockTrouble => (
            "the computer slept, its clock source was changed, or samples bear stamps of another clock",
            "the journal says which; switch suspend off, and run adapters beside the daemon",
        ),
        Incident::DeadlineMissed => (
            "a cycle was ready only after the next was due, within the last 10 s",
            "see `equipoise latency` for where the time went, and `equipoise doctor`",
        ),
        Incident::LoopStalled => (
            "the loop skipped 50 ms of its schedule at once, or stands now",
            "see `equipoise doctor`: governor, isolated core, throttling; is another real-time program on the core?",
        ),
        Incident::RealTimeRefused => (
            "real-time priority, a core or locked memory was asked for and not granted",
            "run under the shipped systemd unit, or as root; loop.strict refuses to start without",
        ),
        Incident::PageFaults => (
            "the loop took page faults after its warm-up",
            "lock memory: loop.lock_memory, LimitMEMLOCK=infinity",
        ),
        Incident::ParticipantDied => (
            "a process on the bus was killed; what it left behind was cleared away",
            "nothing, unless it was one of yours: then start it again",
        ),
        Incident::ModelNoLongerExplains => (
            "what is measured is no longer what the model predicts of this worker",
            "has the worker put something on, or the suit slipped? Tare, identify anew, or `equipoise reconcile`",
        ),
        Incident::NotSaved => (
            "what was learnt cannot be written to disk",
            "make room in the state directory, or make it writable; what was learnt is kept in memory until then",
        ),
        Incident::LatencyNotLogged => (
            "the latency log or a flight record cannot be written",
            "make room where latency.hlog lies, or choose another place",
        ),
        Incident::ReloadRefused => (
            "the configuration was read again and refused; the one before stays in force",
            "`equipoise check FILE` says what is wrong",
        ),
    };
    Words { meaning, to_do }
}

/// The incidents that go on, on one line, with how long; `None` if there are none. `now_ns` is CLOCK_MONOTONIC.
pub fn line(incidents: &Incidents, now_ns: u64) -> Option<String> {
    let told: Vec<String> = incidents
        .active()
        .map(|kind| {
            let since_ns = now_ns.saturating_sub(incidents.last_begun_ns[kind as usize]);
            format!("{} for {}", kind.name(), span(since_ns))
        })
        .collect();
    (!told.is_empty()).then(|| told.join(", "))
}

/// A span for people: seconds, minutes or hours.
pub fn span(span_ns: u64) -> String {
    let whole_s = seconds(span_ns).round() as u64;
    match whole_s {
        0..120 => format!("{whole_s} s"),
        120..7200 => format!("{} min", whole_s / 60),
        _ => format!("{} h", whole_s / 3600),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn every_kind_has_words_of_its_own_that_stand_on_one_line_of_a_table() {
        for kind in Incident::ALL {
            let Words { meaning, to_do } = words(*kind);
            assert!(meaning.len() > 20 && to_do.len() > 20, "{}", kind.name());
            assert!(!meaning.contains('|') && !to_do.contains('|'), "{}", kind.name());
        }
    }

    #[test]
    fn the_document_has_the_same_words() {
        let document = include_str!("../../docs/operation.md");
        for kind in Incident::ALL {
            let Words { meaning, to_do } = words(*kind);
            let row = format!("| `{}` | {meaning} | {to_do} |", kind.name());
            assert!(document.lines().any(|line| line == row), "docs/operation.md lacks this row:\n{row}");
        }
    }

    #[test]
    fn the_line_names_what_goes_on_and_for_how_long() {
        let mut incidents = Incidents::zeroed();
        incidents.begun[Incident::NotSaved as usize] = 3;
        assert_eq!(line(&incidents, 5), None, "what is over is not on it");
        for (kind, since_s) in [(Incident::SuitSilent, 12), (Incident::DeadlineMissed, 9000)] {
            incidents.active |= 1 << kind as u32;
            incidents.last_begun_ns[kind as usize] = 10_000_000_000_000 - since_s * 1_000_000_000;
        }
        assert_eq!(
            line(&incidents, 10_000_000_000_000).as_deref(),
            Some("suit_silent for 12 s, deadline_missed for 2 h")
        );
    }
}
