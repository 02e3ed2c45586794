//! Sections on latency and data quality.

use equipoise_adapters::ground::GroundRefusal;
use equipoise_adapters::suit::SuitRefusal;
use equipoise_core::message::state::Phase;
use equipoise_view::words;

use crate::report::document::{Section, Table, Text, code};

use super::super::document::fraction_percent;
use super::{Facts, length};

/// Percentiles of every stage.
pub(in crate::session_report) fn latency(facts: &Facts) -> Section {
    let mut section = Section::new("Latency");
    let Some(report) = &facts.path else {
        section.paragraph("The recording has no cycle records, so latencies are unavailable.");
        return section;
    };
    section.paragraph(format!(
        "{} cycles; {} deadlines missed, {} periods skipped, {} records lost.",
        report.cycles, report.deadlines_missed, report.slots_skipped, report.cycles_lost
    ));
    let mut table = Table::new(&["stage, µs", ">p50", ">p90", ">p99", ">p99.9", ">max", ">count"]);
    for stage in report.stages.iter().filter(|stage| stage.count > 0) {
        let micros = |ns: u64| Text::from(format!("{:.1}", ns as f64 / 1e3));
        table.rows.push(vec![
            code(stage.stage.as_ref()),
            micros(stage.p50_ns),
            micros(stage.p90_ns),
            micros(stage.p99_ns),
            micros(stage.p99_9_ns),
            micros(stage.max_ns),
            stage.count.to_string().into(),
        ]);
    }
    section.table(table);
    section.note("Stages are those of docs/realtime.md. Skipped periods count with their whole delay.");
    section
}

/// Data quality.
pub(in crate::session_report) fn quality(facts: &Facts) -> Section {
    let mut section = Section::new("Data quality");
    let quality = &facts.quality;
    section.paragraph(format!(
        "All values were valid for {} of the time.",
        fraction_percent(quality.all_valid_s, quality.observed_s)
    ));
    section.head("Invalid reasons");
    let mut table = Table::new(&["reason", ">time", ">share", "meaning"]);
    for (name, raised_s) in quality.reasons() {
        table.rows.push(vec![
            code(name),
            length(raised_s).into(),
            fraction_percent(raised_s, quality.observed_s).into(),
            words::reason(name).text.into(),
        ]);
    }
    section.table(table);
    section.head("Phases");
    let mut table = Table::new(&["phase", ">time", ">share"]);
    for (number, phase_s) in quality.phase_s.iter().enumerate().filter(|(_, phase_s)| **phase_s > 0.0) {
        let name = Phase::from_number(number as u32).map_or("unknown", Phase::name);
        table.rows.push(vec![
            code(name),
            length(*phase_s).into(),
            fraction_percent(*phase_s, quality.observed_s).into(),
        ]);
    }
    section.table(table);
    adapters(facts, &mut section);
    gaps(facts, &mut section);
    section
}

fn adapters(facts: &Facts, section: &mut Section) {
    section.head("Sensors");
    if facts.quality.adapters.is_empty() {
        section
            .paragraph("The recording has no counts of the adapters: losses and refusals are unavailable.");
        return;
    }
    let mut table = Table::new(&["stream", ">received", ">published", ">lost", "refused"]);
    for (stream, health) in &facts.quality.adapters {
        let (name, reasons) =
            if *stream == 1 { ("suit", SuitRefusal::NAMES) } else { ("ground", GroundRefusal::NAMES) };
        let refused: Vec<String> = reasons
            .iter()
            .zip(health.refused)
            .filter(|(_, count)| *count > 0)
            .map(|(reason, count)| format!("{count} {reason}"))
            .collect();
        table.rows.push(vec![
            name.into(),
            health.received.to_string().into(),
            health.published.to_string().into(),
            health.lost.to_string().into(),
            if refused.is_empty() { "none".into() } else { refused.join(", ").into() },
        ]);
    }
    section.table(table);
    section.note("Counts since each adapter's start, as last reported.");
}

fn gaps(facts: &Facts, section: &mut Section) {
    let quality = &facts.quality;
    section.head("Gaps");
    let mut items: Vec<Text> = vec![
        format!("{} states are missing between the first and the last.", quality.states_missing).into(),
        format!("Steps of the feet: {}.", quality.stances).into(),
    ];
    if quality.restarts > 0 {
        items.push(format!("Restarts of the daemon: {}.", quality.restarts).into());
    }
    if !quality.unavailable.is_empty() {
        items.push(format!("Unavailable quantities: {}.", quality.unavailable.join(", ")).into());
    }
    items.extend(facts.rejected.iter().map(|reason| Text::from(format!("Not used: {reason}"))));
    section.list(items);
}
