//! Incidents by validity flags: invalid input that the loop detects. It is no failure of the daemon, but requires a
//! person's attention.

use equipoise_core::message::{Incident, Validity};
use equipoise_core::time::NS_PER_S;

use crate::incidents::IncidentBoard;

/// A validity flag and the incident that it raises.
struct ValidityIncident {
    reason: Validity,
    incident: Incident,
    /// Minimum duration before the incident begins, since short interruptions are part of normal work, ns.
    after_ns: u64,
    message: &'static str,
}

const VALIDITY_INCIDENTS: [ValidityIncident; 5] = [
    ValidityIncident {
        reason: Validity::POSITION_UNKNOWN,
        incident: Incident::PositionUnknown,
        after_ns: 0,
        message: "the worker's position on the plate is no longer known, because the suit was restarted, jumped or was \
                   silent for long, the computer was restarted, or the plate was moved; it is estimated again while the \
                   worker moves without a load",
    },
    ValidityIncident {
        reason: Validity::GROUND_IMPLAUSIBLE,
        incident: Incident::GroundImplausible,
        after_ns: 0,
        message: "the plate's values jump, also over a gap, repeat, pull upwards as under no person or exceed what a person \
                   lifts; they are used again once they show the worker's weight alone: the worker puts down the load, or \
                   steps off and on; if it recurs, check the plate's gain and cable",
    },
    ValidityIncident {
        reason: Validity::SUIT_IMPLAUSIBLE,
        incident: Incident::SuitImplausible,
        after_ns: 0,
        message: "poses of the suit repeat, jump or separate at the joints, and are not used; if the profile in use \
                   is another worker's, load the right one with `equipoise subject load`",
    },
    ValidityIncident {
        reason: Validity::WEIGHT_MISSING,
        incident: Incident::WeightMissing,
        after_ns: 3 * NS_PER_S,
        message: "the ground carries less than the worker weighs: a foot next to the plate, a hand that leans on something, \
                   or a plate whose gain or zero has changed (tare it while it is empty)",
    },
    ValidityIncident {
        reason: Validity::LOAD_NOT_AT_HANDS,
        incident: Incident::LoadNotAtHands,
        after_ns: 10 * NS_PER_S,
        message: "the ground carries more than the worker weighs, and not where the hands are: something lies on the plate \
                   or is worn, or the plate's zero or gain, its place, or the worker's identification is wrong",
    },
];

/// Begins, updates and ends the incidents of the flags.
#[derive(Debug, Default)]
pub(super) struct ValidityIncidents {
    /// Since when each flag is raised, CLOCK_MONOTONIC; `None` while it is not.
    since_ns: [Option<u64>; VALIDITY_INCIDENTS.len()],
}

impl ValidityIncidents {
    /// Ingests the flags of the newest state at `now_ns`, CLOCK_MONOTONIC.
    pub(super) fn update(&mut self, valid: Validity, now_ns: u64, board: &IncidentBoard) {
        for (entry, since_ns) in VALIDITY_INCIDENTS.iter().zip(&mut self.since_ns) {
            if !valid.any_of(entry.reason) {
                *since_ns = None;
                board.end(entry.incident);
                continue;
            }
            let lasts_ns = now_ns.saturating_sub(*since_ns.get_or_insert(now_ns));
            if lasts_ns < entry.after_ns {
                continue;
            }
            board.set_with_details(entry.incident, entry.message, |count| match lasts_ns / NS_PER_S {
                0 => format!("{count} so far, the last just now"),
                seconds => format!("{count} so far, the last began {seconds} s ago"),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_message_of_a_lost_position_names_every_cause() {
        let entry =
            VALIDITY_INCIDENTS.iter().find(|entry| entry.reason == Validity::POSITION_UNKNOWN).unwrap();
        for cause in
            ["suit was restarted", "jumped", "silent for long", "computer was restarted", "plate was moved"]
        {
            assert!(entry.message.contains(cause), "{cause}: {}", entry.message);
        }
    }

    #[test]
    fn each_of_five_flags_becomes_the_incident_of_its_name_after_its_time_and_ends_with_the_flag() {
        for (name, after_s) in [
            ("position_unknown", 0),
            ("ground_implausible", 0),
            ("suit_implausible", 0),
            ("weight_missing", 3),
            ("load_not_at_hands", 10),
        ] {
            let named = Validity::NAMES.iter().find(|(_, flag)| *flag == name);
            let (flag, _) = named.copied().unwrap();
            let (mut incidents, board) = (ValidityIncidents::default(), IncidentBoard::default());
            let mut active = |valid: Validity, at_s: u64| {
                incidents.update(valid, at_s * NS_PER_S, &board);
                board.messages().keys().cloned().collect::<Vec<_>>()
            };
            assert!(active(Validity::BELOW_LOAD_THRESHOLD, 99).is_empty(), "{name}");
            if after_s > 0 {
                assert!(active(flag, 100).is_empty(), "{name}: too short");
                assert!(active(flag, 100 + after_s - 1).is_empty(), "{name}: too short");
            }
            let begun_s = if after_s > 0 { 100 + after_s } else { 100 };
            assert_eq!(active(flag, begun_s), [name]);
            assert_eq!(active(flag.and(Validity::MOVING), begun_s + 1), [name]);
            assert!(active(Validity::MOVING, begun_s + 2).is_empty(), "{name}");
            let kind = Incident::ALL.iter().copied().find(|kind| kind.name() == name).unwrap();
            assert_eq!(board.message().begun[kind as usize], 1, "{name}");
        }
    }

    #[test]
    fn the_message_has_the_current_count_and_time() {
        let (mut incidents, board) = (ValidityIncidents::default(), IncidentBoard::default());
        let mut message = |valid: Validity, at_s: u64| {
            incidents.update(valid, at_s * NS_PER_S, &board);
            board.messages().get("ground_implausible").cloned().unwrap_or_default()
        };
        let flag = Validity::GROUND_IMPLAUSIBLE;
        assert!(message(flag, 10).ends_with("(1 so far, the last just now)"));
        assert!(message(flag, 14).ends_with("(1 so far, the last began 4 s ago)"));
        assert_eq!(message(Validity::default(), 15), "");
        assert!(message(flag, 20).ends_with("(2 so far, the last just now)"));
        let last = message(flag, 27);
        assert!(last.starts_with("the plate's values jump") && last.ends_with("began 7 s ago)"), "{last}");
    }
}
