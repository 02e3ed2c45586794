//! Provenance of the finding, sufficient to reproduce it.

use super::super::Report;
use super::super::document::{Section, Table, Text, code};
use super::super::words;

pub(super) fn section(report: &Report) -> Section {
    let origin = report.origin;
    let mut section = Section::new("Where this comes from");
    let mut table = Table::new(&["what", "is"]);
    let mut row = |what: &str, is: Text| table.rows.push(vec![what.into(), is]);
    for recording in &origin.recordings {
        row("recording", code(&recording.name));
        row("SHA-256", code(&recording.sha256));
    }
    row("length", words::seconds(report.picture.length_s).into());
    row("subject", origin.subject.as_str().into());
    row("station", origin.station.as_str().into());
    row("made", origin.date.as_str().into());
    row("by", origin.software.as_str().into());
    let spans = &report.picture.spans_s;
    let how = if spans.found { "found in the data" } else { "given" };
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
    section.say("Made by:");
    section.code("sh", origin.command.as_str());
    section
}
