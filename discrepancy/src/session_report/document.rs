//! Assembles the report: header, numbers, sections.

use equipoise_view::words;

use crate::constants::STATEMENT_TIME_MIN_S;
use crate::report::document::{Document, Text};

use super::gather::{Facts, Source};
use super::recommendations::recommendations;
use super::sections;

/// The report of a session.
pub fn document(facts: &Facts) -> Document {
    Document {
        title: format!("Session of {} on station {}", subject(facts), facts.config.station),
        verdict: verdict(facts),
        headline: headline(facts),
        numbers: numbers(facts),
        sections: vec![
            recommendations(facts),
            sections::session(facts),
            sections::identification(facts),
            sections::exposure(facts),
            sections::body(facts),
            sections::lifts(facts),
            sections::dose(facts),
            sections::back(facts),
            sections::latency(facts),
            sections::quality(facts),
        ],
    }
}

/// The pseudonyms of all subjects.
pub(super) fn subject(facts: &Facts) -> String {
    if facts.subjects.is_empty() { "unnamed".to_owned() } else { facts.subjects.join(" and ") }
}

fn verdict(facts: &Facts) -> &'static str {
    if facts.identification.converged_s.is_some() { "identified" } else { "not identified" }
}

fn headline(facts: &Facts) -> Text {
    let valid_s = facts.exposure.valid_s;
    let headline_text = match facts.exposure.worst() {
        Some(_) if valid_s < STATEMENT_TIME_MIN_S => {
            format!("Torques were reported for {} only: too short to compare the joints.", length(valid_s))
        }
        Some(worst) => {
            format!("The {} was the joint closest to its limit for the longest time.", words::joint(worst))
        }
        None => "No overload torque was reported in this session.".to_owned(),
    };
    match facts.source {
        Source::Recorded => headline_text.into(),
        Source::Replayed => {
            Text::from(headline_text).plain(" The states were computed from the samples by a replay.")
        }
    }
}

fn numbers(facts: &Facts) -> Vec<[String; 3]> {
    let number =
        |what: &str, value: String, explanation: &str| [what.to_owned(), value, explanation.to_owned()];
    let [from_s, to_s] = facts.span_s.unwrap_or_default();
    let valid_percent = fraction_percent(facts.exposure.valid_s, facts.quality.observed_s);
    let mut numbers = vec![
        number("Duration", length(to_s - from_s), "from the first to the last state"),
        number("Lifts", facts.lifts.lifts.len().to_string(), "completed in the recording"),
        number("Torques reported", valid_percent, "of the time; otherwise withheld, with the invalid reason"),
    ];
    numbers.push(match facts.back.dose {
        Some([damage, probability]) => {
            let explanation =
                format!("probability of a high-risk job, from the low-back dose (damage {damage:.2e})");
            number("Risk", format!("{:.0} %", 100.0 * probability), &explanation)
        }
        None => number("Risk", "-".to_owned(), "no lift with a valid low-back load: see data quality"),
    });
    let last = facts.identification.poses.last();
    if let Some(sigma_m) = last.and_then(|pose| pose.cop_sigma_m) {
        numbers.push(number("CoP accuracy", format!("{:.1} mm", 1e3 * sigma_m), "1-σ of the predicted CoP"));
    }
    numbers
}

/// A duration as text: seconds below two minutes, otherwise minutes.
pub(super) fn length(seconds: f64) -> String {
    if seconds < 120.0 { format!("{seconds:.1} s") } else { format!("{:.1} min", seconds / 60.0) }
}

pub(super) fn fraction_percent(part: f64, whole: f64) -> String {
    if whole > 0.0 { format!("{:.1} %", 100.0 * part / whole) } else { "-".to_owned() }
}
