//! Step 2: discrepancies beyond noise.

use super::super::Report;
use super::super::document::{Section, Table, Text, strong};
use super::super::figures::{self, When, letter};
use super::super::words::{self, number};
use crate::finding::Suspicion;
use crate::picture::Signal;

pub(super) fn section(report: &Report) -> Section {
    let spans = &report.finding.spans;
    let mut section = Section::new("2. The suspicion: where it is beyond noise");
    match &spans[..] {
        [] => section.say("Nowhere: in no stretch of the work does the residual leave what noise explains."),
        [one] => section.say(Text::from("One stretch is beyond noise: ").then(in_words(one)).plain(".")),
        many => {
            section.say(format!("{} stretches are beyond noise; the pictures above mark them.", many.len()));
        }
    }
    if let Some(worst) =
        spans.iter().max_by(|a, b| a.times_noise.total_cmp(&b.times_noise)).filter(|_| spans.len() > 1)
    {
        section.say(Text::from("The clearest: ").then(in_words(worst)).plain("."));
    }
    section.table(table(spans));
    let plots = &report.picture.pose;
    if !plots.is_empty() {
        section.say(
            "How the residual goes with the pose. A flat cloud around zero knows nothing of the pose; a slope or a \
             bend is a trace of the cause.",
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
        .plain(format!(", most in the {signal}, {}", while_in_words(&span.while_)));
    if let Some(segment) = &span.segment {
        text = text.plain(", going with the pose of ").strong(words::place_in_words(segment));
    }
    text.plain(", ").then(strong(format!("{} times noise", number(span.times_noise))))
}

fn signal_in_words(span: &Suspicion) -> String {
    let known = Signal::ALL.into_iter().find(|signal| signal.name() == span.signal);
    known.map_or_else(|| span.signal.clone(), |signal| figures::signal(signal).to_owned())
}

fn while_in_words(name: &str) -> &str {
    match name {
        "still" => "in held poses",
        "moving" => "while moving",
        "both" => "still and moving alike",
        other => other,
    }
}

fn table(spans: &[Suspicion]) -> Table {
    let mut table = Table::new(&["", ">from", ">to", "signal", "while", "goes with", ">times noise"]);
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
