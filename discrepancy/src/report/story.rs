//! The sections of a report, step by step.

mod change;
mod discrepancy;
mod held_out;
mod rejected;
mod remainder;

use super::Report;
use super::document::{Document, Section, Table, Text, code, strong};
use super::words::{self, number, ratio};
use crate::finding::{Estimate, Finding, Named, Verdict, percent};

/// The whole report.
pub(super) fn document(report: &Report) -> Document {
    let recordings: Vec<&str> = report.origin.recordings.iter().map(|each| each.name.as_str()).collect();
    Document {
        title: format!("Model and measurement: {}", recordings.join(", ")),
        verdict: match report.finding.verdict {
            Verdict::Named => "named",
            Verdict::None => "none",
            Verdict::Ambiguous => "ambiguous",
            Verdict::Unexplained => "unexplained",
        },
        headline: headline(report),
        numbers: numbers(report.finding),
        sections: vec![
            discrepancy::size(report),
            discrepancy::spans(report),
            rejected::section(report),
            change::section(report),
            held_out::section(report),
            remainder::section(report),
            origin(report),
        ],
    }
}

fn headline(report: &Report) -> Text {
    let finding = report.finding;
    let effects = enumeration(&finding.effects.iter().map(in_a_phrase).collect::<Vec<_>>());
    match finding.verdict {
        Verdict::None => "These data show no effect that the model lacks.".into(),
        Verdict::Named => Text::from("The model lacks ").strong(effects).plain("."),
        Verdict::Ambiguous => {
            let likely = finding.effects.iter().map(|named| {
                let name = words::candidate(&words::full_name(named));
                let rivals = named.family.iter().map(|name| words::candidate(name));
                let all = std::iter::once(name).chain(rivals).collect::<Vec<_>>();
                format!("{} ({})", enumeration_with(&all, "or"), percent(named.probability))
            });
            Text::from("These data do not establish which effect the model lacks. Most likely: ")
                .strong(likely.collect::<Vec<_>>().join("; and "))
                .plain(".")
        }
        Verdict::Unexplained if finding.effects.is_empty() => unexplained(finding),
        Verdict::Unexplained if mostly_unexplained(finding) => unexplained(finding)
            .plain(" Also named is ")
            .strong(effects)
            .plain(": this may be an artefact of the same cause."),
        Verdict::Unexplained => Text::from("The model lacks ")
            .strong(effects)
            .plain(", and a further effect that is not in the catalogue."),
    }
}

/// The part that no effect explains, and its most similar effect.
fn unexplained(finding: &Finding) -> Text {
    let text = Text::from("The residual contains an effect that is not in the catalogue.");
    let most = finding.unexplained.iter().max_by(|a, b| a.log_odds.total_cmp(&b.log_odds));
    match most {
        Some(most) => text.plain(" Closest generic description: ").strong(&most.what).plain("."),
        None => text,
    }
}

/// Whether the unexplained part outweighs all named effects.
fn mostly_unexplained(finding: &Finding) -> bool {
    let named: f64 = finding.effects.iter().map(|named| named.log_odds).sum();
    finding.unexplained.iter().any(|generic| generic.log_odds > named)
}

/// A named effect with its most significant parameter.
fn in_a_phrase(named: &Named) -> String {
    let words = words::candidate(&words::full_name(named));
    match most_significant(named) {
        Some((_, estimate)) => format!("{words} ({})", everyday(estimate)),
        None => words,
    }
}

/// The parameter farthest from zero in σ.
fn most_significant(named: &Named) -> Option<(&str, &Estimate)> {
    let sigmas = |estimate: &Estimate| estimate.value.abs() / estimate.sigma.max(f64::MIN_POSITIVE);
    let parameters = named.parameters.iter().map(|(name, estimate)| (name.as_str(), estimate));
    parameters.max_by(|a, b| sigmas(a.1).total_cmp(&sigmas(b.1)))
}

fn everyday(estimate: &Estimate) -> String {
    words::in_everyday_units(estimate).unwrap_or_else(|| words::estimate(estimate))
}

fn numbers(finding: &Finding) -> Vec<[String; 3]> {
    let gap = &finding.gap;
    let times = |value: f64| format!("{} noise", ratio(value, gap.noise_floor_mm));
    let mm = |value: f64| format!("{} mm", number(value));
    let mut numbers = vec![["gap before the change".to_owned(), mm(gap.before_mm), times(gap.before_mm)]];
    if changed(finding) {
        numbers.push(["gap after, on held-out data".to_owned(), mm(gap.after_mm), times(gap.after_mm)]);
    }
    let meaning = "expected from sway, suit, soft tissue and plate".to_owned();
    numbers.push(["noise alone".to_owned(), mm(gap.noise_floor_mm), meaning]);
    numbers
}

/// Whether "after" differs from "before".
fn changed(finding: &Finding) -> bool {
    !finding.effects.is_empty()
}

/// "a, b and c".
fn enumeration(parts: &[String]) -> String {
    enumeration_with(parts, "and")
}

fn enumeration_with(parts: &[String], word: &str) -> String {
    match parts {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} {word} {last}", first.join(", ")),
    }
}

/// A value in mm or N.
fn with_unit(value: f64, unit: &str) -> Text {
    strong(format!("{} {unit}", number(value)))
}

/// Provenance of the finding, sufficient to reproduce it.
fn origin(report: &Report) -> Section {
    let origin = report.origin;
    let mut section = Section::new("Provenance");
    let mut table = Table::new(&["item", "value"]);
    let mut row = |what: &str, is: Text| table.rows.push(vec![what.into(), is]);
    for recording in &origin.recordings {
        row("recording", code(&recording.name));
        row("SHA-256", code(&recording.sha256));
    }
    row("length", words::seconds(report.picture.length_s).into());
    row("subject", origin.subject.as_str().into());
    row("station", origin.station.as_str().into());
    row("created", origin.date.as_str().into());
    row("software", origin.software.as_str().into());
    let spans = &report.picture.spans_s;
    let how = if spans.found { "determined from the data" } else { "given" };
    let span =
        |option: &str, span_s| code(format!("{option} {}", words::span(span_s))).plain(format!(" s, {how}"));
    row("identification", span("--identify", spans.identify));
    match spans.reference {
        Some(reference) => row("reference", span("--reference", reference)),
        None => row("reference", "none".into()),
    }
    row("work in question", span("--work", spans.work));
    row("blocks", format!("means over {:.2} s", report.picture.block_s).into());
    section.table(table);
    section.paragraph("Command:");
    section.code("sh", origin.command.as_str());
    section
}
