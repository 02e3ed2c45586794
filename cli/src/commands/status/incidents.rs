//! Incidents of the station as `status` prints them: active ones first, then counts of past ones.

use std::collections::BTreeMap;
use std::io::Write;

use equipoise_core::message::{Incident, Incidents};
use equipoise_core::time::seconds;
use equipoise_view::incident_words::{span, words};
use serde::Serialize;

use super::COLUMNS;

/// Active and past incidents of a station.
#[derive(Debug, Serialize)]
pub(super) struct IncidentReport {
    active: Vec<Active>,
    past: Vec<Past>,
}

#[derive(Debug, Serialize)]
struct Active {
    name: &'static str,
    /// How long it has gone on, s.
    duration_s: f64,
    /// How often it has begun since the daemon's start.
    count: u64,
    /// Where, and why, as the journal has it.
    message: String,
    remedy: &'static str,
    /// `what` ends with what to do, more exactly than `to_do`.
    #[serde(skip)]
    has_remedy: bool,
}

/// Incidents whose sentence names what to look at on this station: the address, the process, the reasons of a refusal.
const WITH_REMEDY: [Incident; 7] = [
    Incident::SuitSilent,
    Incident::GroundSilent,
    Incident::SuitStampsStale,
    Incident::GroundStampsStale,
    Incident::DeadlineMissed,
    Incident::PageFaults,
    Incident::RealTimeRefused,
];

#[derive(Debug, Serialize)]
struct Past {
    name: &'static str,
    count: u64,
    /// How long ago it last ended, s.
    ended_ago_s: f64,
}

impl IncidentReport {
    /// `sentences` are the daemon's own words on what goes on, by name; `now_ns` is CLOCK_MONOTONIC.
    pub(super) fn new(
        incidents: &Incidents,
        sentences: &BTreeMap<String, String>,
        now_ns: u64,
    ) -> IncidentReport {
        let since_s = |then_ns: u64| seconds(now_ns.saturating_sub(then_ns));
        let is_active = |kind: Incident| incidents.active().any(|active| active == kind);
        let active = incidents.active().map(|kind| Active {
            name: kind.name(),
            duration_s: since_s(incidents.last_begun_ns[kind as usize]),
            count: incidents.begun[kind as usize],
            message: sentences.get(kind.name()).cloned().unwrap_or_else(|| words(kind).meaning.to_owned()),
            remedy: words(kind).to_do,
            has_remedy: WITH_REMEDY.contains(&kind) && sentences.contains_key(kind.name()),
        });
        let was = |kind: &Incident| incidents.begun[*kind as usize] > 0 && !is_active(*kind);
        let past = Incident::ALL.iter().copied().filter(was).map(|kind| Past {
            name: kind.name(),
            count: incidents.begun[kind as usize],
            ended_ago_s: since_s(incidents.last_ended_ns[kind as usize]),
        });
        IncidentReport { active: active.collect(), past: past.collect() }
    }

    /// Past incidents on one line, unless `all` is set.
    pub(super) fn write(&self, out: &mut impl Write, all: bool) -> std::io::Result<()> {
        let as_span = |seconds: f64| span((seconds * 1e9) as u64);
        for (index, Active { name, duration_s, count, message, remedy, has_remedy }) in
            self.active.iter().enumerate()
        {
            let times = if *count > 1 { format!(", {count} times so far") } else { String::new() };
            writeln!(out, "  INCIDENT {name} for {}{times}: {message}", as_span(*duration_s))?;
            let is_printed =
                self.active[..index].iter().any(|before| !before.has_remedy && before.remedy == *remedy);
            if !has_remedy && !is_printed {
                writeln!(out, "           to do: {remedy}")?;
            }
        }
        let past = |Past { name, count, ended_ago_s }: &Past| {
            format!("{name} {count} times, last {} ago", as_span(*ended_ago_s))
        };
        let past: Vec<String> = self.past.iter().map(past).collect();
        let line = format!("  past incidents: {}", past.join("; "));
        match past.len() {
            0 => Ok(()),
            count if !all && line.len() > COLUMNS => writeln!(out, "  past incidents: {count} kinds (--all)"),
            _ => writeln!(out, "{line}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn each_remedy_is_printed_once() {
        let mut incidents = Incidents::zeroed();
        for kind in [Incident::SuitSilent, Incident::SuitAdapterDown, Incident::GroundAdapterDown] {
            incidents.active |= 1 << kind as u32;
        }
        let printed = |sentences: BTreeMap<String, String>| {
            let mut text = Vec::new();
            IncidentReport::new(&incidents, &sentences, 0).write(&mut text, false).unwrap();
            String::from_utf8(text).unwrap()
        };
        let text = printed(BTreeMap::from([("suit_silent".to_owned(), "is it on?".to_owned())]));
        assert_eq!(text.matches("to do:").count(), 1, "{text}");
        assert_eq!(text.matches(words(Incident::SuitAdapterDown).to_do).count(), 1, "{text}");
        // Without the daemon's sentence only the general advice is printed.
        assert!(printed(BTreeMap::new()).contains("to do: check in MVN"));
    }

    #[test]
    fn active_incidents_come_first_with_the_daemon_s_message() {
        let mut incidents = Incidents::zeroed();
        let (silent, died) = (Incident::SuitSilent as usize, Incident::ParticipantDied as usize);
        incidents.active = 1 << silent;
        (incidents.begun[silent], incidents.begun[died]) = (2, 5);
        (incidents.last_begun_ns[silent], incidents.last_ended_ns[silent]) = (70_000_000_000, 50_000_000_000);
        incidents.last_ended_ns[died] = 60_000_000_000;
        let sentences = BTreeMap::from([("suit_silent".to_owned(), "is it on?".to_owned())]);
        let report = IncidentReport::new(&incidents, &sentences, 80_000_000_000);
        let mut text = Vec::new();
        report.write(&mut text, false).unwrap();
        let text = String::from_utf8(text).unwrap();
        assert!(
            text.starts_with("  INCIDENT suit_silent for 10 s, 2 times so far: is it on?\n  past incidents"),
            "{text}"
        );
        assert!(text.ends_with("past incidents: participant_died 5 times, last 20 s ago\n"), "{text}");
        incidents.begun = [1; _];
        let many = IncidentReport::new(&incidents, &sentences, 80_000_000_000);
        let written = |all: bool| {
            let mut text = Vec::new();
            many.write(&mut text, all).unwrap();
            String::from_utf8(text).unwrap()
        };
        assert!(
            written(false).ends_with(&format!("past incidents: {} kinds (--all)\n", Incident::ALL.len() - 1))
        );
        assert!(written(true).contains("participant_died 1 times, last 20 s ago"));
        let json = serde_json::to_value(&report).unwrap();
        assert_eq!(
            (&json["active"][0]["count"], &json["past"][0]["name"]),
            (&2.into(), &"participant_died".into())
        );
    }
}
