//! Assembles the report: header, numbers, sections.

use equipoise_view::words;

use crate::constants::STATEMENT_TIME_MIN_S;
use crate::report::document::{Document, Piece, Section, Text};

use super::comparison::{Column, columns, comparison, is_comparable};
use super::gather::{Facts, Source};
use super::recommendations::recommendations;
use super::sections;

/// The report of a session, or of several with their comparison.
pub fn document(sessions: &[Facts]) -> Document {
    match sessions {
        [facts] => of_session(facts),
        _ => of_sessions(sessions),
    }
}

fn of_session(facts: &Facts) -> Document {
    let mut sections = sections_of(facts);
    let columns = columns(std::slice::from_ref(facts));
    if columns.len() > 1 {
        // After recommendations and session.
        sections.insert(2, comparison(&columns));
    }
    Document {
        title: format!("Session of {} on station {}", subject(facts), facts.config.station),
        verdict: verdict(facts),
        headline: headline(facts),
        numbers: numbers(facts),
        sections,
    }
}

fn of_sessions(sessions: &[Facts]) -> Document {
    let columns = columns(sessions);
    let is_comparable = is_comparable(&columns);
    let mut sections = vec![comparison(&columns)];
    for (index, facts) in sessions.iter().enumerate() {
        sections.extend(sections_of(facts).into_iter().map(|section| numbered(index + 1, section)));
    }
    let number = |what: &str, count: usize, explanation: &str| {
        [what.to_owned(), count.to_string(), explanation.to_owned()]
    };
    let lifts: usize = sessions.iter().map(|facts| facts.lifts.lifts.len()).sum();
    Document {
        title: format!("Comparison of {} sessions", sessions.len()),
        verdict: if is_comparable { "comparable" } else { "not comparable" },
        headline: highest(&columns, is_comparable),
        numbers: vec![
            number("Sessions", sessions.len(), "recordings"),
            number("Columns", columns.len(), "workers and shifts of each session"),
            number("Lifts", lifts, "completed in the recordings"),
        ],
        sections,
    }
}

/// The column with the highest peak.
fn highest(columns: &[Column<'_>], is_comparable: bool) -> Text {
    if !is_comparable {
        return "Not all columns have the same model and settings: see the row \"comparable\".".into();
    }
    let peaks = columns.iter().filter_map(|column| Some((column, column.highest_peak()?)));
    match peaks.max_by(|(_, (_, a)), (_, (_, b))| a.limit_ratio.total_cmp(&b.limit_ratio)) {
        Some((column, (joint, peak))) => Text::from("The highest joint load was that of ")
            .strong(column.label.as_str())
            .plain(format!(": {}, {} of its limit.", words::joint(joint), peak.percent())),
        None => "No overload torque was reported in these sessions.".into(),
    }
}

/// The sections of one session.
fn sections_of(facts: &Facts) -> Vec<Section> {
    vec![
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
    ]
}

/// A section of one of several sessions; names of drawings remain unique in the page.
fn numbered(number: usize, mut section: Section) -> Section {
    section.title = format!("Session {number}: {}", section.title);
    let name = |name: &str| format!("session-{number}-{name}");
    for piece in &mut section.pieces {
        match piece {
            Piece::Figures(figures) => {
                for figure in figures {
                    figure.drawing.name = name(&figure.drawing.name);
                }
            }
            Piece::Scrubber(scrubber) => scrubber.name = name(&scrubber.name),
            _ => {}
        }
    }
    section
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
