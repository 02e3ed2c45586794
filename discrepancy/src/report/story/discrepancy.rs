//! Steps 1 and 2: the discrepancy, its size, and the spans in which it exceeds noise.

use super::super::Report;
use super::super::document::{Section, Table, Text, strong};
use super::super::figures::{self, When, letter};
use super::super::figures_by_row;
use super::super::words::{self, number, ratio};
use super::with_unit;
use crate::finding::Suspicion;
use crate::picture::Signal;

/// Step 1: size of the discrepancy.
pub(super) fn size(report: &Report) -> Section {
    let gap = &report.finding.gap;
    let mut section = Section::new("1. Residual: difference of measurement and model");
    section.paragraph(
        Text::from("In the work in question the gap, the root mean square difference of measured and predicted centre of pressure beyond that expected from the clean part of the recording, is ")
            .then(with_unit(gap.before_mm, "mm"))
            .plain(". Noise alone (sway, drift of the suit, soft tissue, plate): ")
            .then(with_unit(gap.noise_floor_mm, "mm"))
            .plain(format!(" ({} noise).", ratio(gap.before_mm, gap.noise_floor_mm))),
    );
    if let Some(fz) = gap.per_axis.get("fz") {
        section.paragraph(
            Text::from("The gap of the vertical force is ")
                .then(with_unit(fz.before, fz.unit))
                .plain("; noise alone: ")
                .then(with_unit(fz.noise_floor, fz.unit))
                .plain(format!(" ({} noise).", ratio(fz.before, fz.noise_floor))),
        );
    }
    section.note(
        "Line: measured minus predicted, minus the difference expected from the clean part (errors of the worker's \
         parameters, stance offset). Grey band: 2 σ of noise alone. Green strip at the bottom: static poses. Orange: \
         intervals of step 2.",
    );
    let picture = report.picture;
    let mut all: Vec<_> = (picture.time.iter())
        .map(|plot| figures::over_time("shape", picture, plot, &report.finding.spans, When::Before))
        .collect();
    all.extend(figures_by_row::gap("shape", gap, false));
    section.figures(all);

    let mut table = Table::new(&["axis", ">gap", ">noise alone", ">times noise"]);
    for (name, axis) in figures_by_row::axes(gap) {
        table.rows.push(vec![
            figures_by_row::axis(name).into(),
            format!("{} {}", number(axis.before), axis.unit).into(),
            format!("{} {}", number(axis.noise_floor), axis.unit).into(),
            ratio(axis.before, axis.noise_floor).trim_end_matches(" times").to_owned().into(),
        ]);
    }
    section.table(table);
    section
}

/// Step 2: spans beyond noise.
pub(super) fn spans(report: &Report) -> Section {
    let spans = &report.finding.spans;
    let mut section = Section::new("2. Intervals in which the residual exceeds noise");
    match &spans[..] {
        [] => section.paragraph("None: the residual stays within noise throughout the work."),
        [one] => section.paragraph(Text::from("One interval exceeds noise: ").then(in_words(one)).plain(".")),
        many => {
            section.paragraph(format!("{} intervals exceed noise; the figures above mark them.", many.len()));
        }
    }
    if let Some(worst) =
        spans.iter().max_by(|a, b| a.times_noise.total_cmp(&b.times_noise)).filter(|_| spans.len() > 1)
    {
        section.paragraph(Text::from("The largest: ").then(in_words(worst)).plain("."));
    }
    section.table(table(spans));
    let plots = &report.picture.pose;
    if !plots.is_empty() {
        section.paragraph(
            "Residual as a function of the pose. A flat cloud around zero: independent of the pose. A slope or a bend: \
             the effect depends on this joint.",
        );
        let figures = plots
            .iter()
            .enumerate()
            .map(|(n, plot)| figures::over_pose("suspicion", n + 1, plot, When::Before));
        section.figures(figures.collect());
    }
    section
}

fn in_words(span: &Suspicion) -> Text {
    let signal = signal_in_words(span);
    let mut text = Text::from("from ")
        .strong(words::seconds(span.from_s))
        .plain(" to ")
        .strong(words::seconds(span.to_s))
        .plain(format!(", largest in the {signal}, {}", while_in_words(&span.while_)));
    if let Some(segment) = &span.segment {
        text = text.plain(", correlated with the orientation of ").strong(words::place_in_words(segment));
    }
    text.plain(", ").then(strong(format!("{} times noise", number(span.times_noise))))
}

fn signal_in_words(span: &Suspicion) -> String {
    let known = Signal::ALL.into_iter().find(|signal| signal.name() == span.signal);
    known.map_or_else(|| span.signal.clone(), |signal| figures::signal(signal).to_owned())
}

fn while_in_words(name: &str) -> &str {
    match name {
        "still" => "in static poses",
        "moving" => "in motion",
        "both" => "in static poses and in motion",
        other => other,
    }
}

fn table(spans: &[Suspicion]) -> Table {
    let mut table =
        Table::new(&["", ">from", ">to", "signal", "condition", "correlated segment", ">times noise"]);
    for (n, span) in spans.iter().enumerate() {
        let segment = span.segment.as_deref().map_or("–".to_owned(), words::place_in_words);
        table.rows.push(vec![
            strong(letter(n)),
            words::seconds(span.from_s).into(),
            words::seconds(span.to_s).into(),
            signal_in_words(span).into(),
            while_in_words(&span.while_).into(),
            segment.into(),
            number(span.times_noise).into(),
        ]);
    }
    table
}
