//! Sensors, incidents and latency.

use equipoise_core::message::{State, Validity};
use equipoise_core::time::seconds;
use equipoise_latency::{Report, Stage};
use ratatui::style::{Color, Style};
use ratatui::text::Line;

use super::{Sensor, Watch, cut, heading};
use crate::incident_words::{span, words};

/// Stages displayed: both paths, and the loop's own.
const STAGES: [(Stage, &str); 5] = [
    (Stage::SuitToState, "suit to state"),
    (Stage::GroundToState, "ground to state"),
    (Stage::LoopWake, "late awake"),
    (Stage::LoopCompute, "compute"),
    (Stage::LoopToState, "due to state"),
];

/// Active incidents, newest first, as many as fit; then the number of the others.
pub(super) fn incidents(watch: &Watch<'_>, height: u16) -> Vec<Line<'static>> {
    // While the daemon is silent, its incidents are out of date.
    let Some(incidents) = watch.incidents.filter(|_| watch.state.is_some()) else { return Vec::new() };
    let mut active: Vec<_> = incidents.active().collect();
    active.sort_by_key(|kind| core::cmp::Reverse(incidents.last_begun_ns[*kind as usize]));
    let rows = if height < 20 { 1 } else { 3 };
    let alarm = Style::new().fg(Color::Red);
    let mut lines = Vec::new();
    for kind in active.iter().take(rows) {
        let for_ns = watch.now_ns.saturating_sub(incidents.last_begun_ns[*kind as usize]);
        let more = match active.len() - rows.min(active.len()) {
            more if more > 0 && lines.is_empty() => format!(" (and {more} more)"),
            _ => String::new(),
        };
        let meaning = words(*kind).meaning;
        lines.push(Line::styled(format!(" ! {} for {}{more}: {meaning}", kind.name(), span(for_ns)), alarm));
        if height >= 30 {
            lines.push(Line::raw(format!("   to do: {}", words(*kind).to_do)));
        }
    }
    lines
}

/// A line for each sensor: age, rate, losses, refusals.
pub(super) fn sensors(watch: &Watch<'_>, state: &State, width: u16) -> Vec<Line<'static>> {
    let ages = [
        ("suit", state.suit_age_ns, Validity::SUIT_STALE),
        ("ground", state.ground_age_ns, Validity::GROUND_STALE),
    ];
    let rows = ages.map(|(name, age_ns, silent)| {
        let counters =
            watch.sensors.iter().find(|sensor| sensor.name == name).map_or_else(String::new, counts);
        match state.unless(silent, age_ns) {
            Some(age_ns) => {
                let age_ms = 1e3 * seconds(age_ns);
                Line::raw(cut(&format!(" {name:<7} {age_ms:>3.0} ms old{counters}"), width))
            }
            None => {
                Line::styled(cut(&format!(" {name:<7} silent{counters}"), width), Style::new().fg(Color::Red))
            }
        }
    });
    let behind = (state.group_delay_ns > 0).then(|| {
        let behind_ms = 1e3 * seconds(state.group_delay_ns);
        Line::raw(cut(&format!(" values are {behind_ms:.0} ms behind the suit"), width))
    });
    [heading("Sensors")].into_iter().chain(rows).chain(behind).collect()
}

fn counts(sensor: &Sensor) -> String {
    let mut text = format!(", {:.0} Hz, {} lost", sensor.rate_hz, sensor.lost);
    for (name, count) in &sensor.refused {
        text.push_str(&format!(", {count} {name}"));
    }
    text
}

/// Percentiles of the latency since the screen was opened, and counts of missed deadlines and slots.
pub(super) fn latency(watch: &Watch<'_>) -> Vec<Line<'static>> {
    let Some(report) = watch.latency.filter(|report| report.cycles > 0) else {
        return vec![heading("Latency"), Line::raw(" -")];
    };
    let head = Line::raw(format!(" {:<15} {:>8} {:>8} {:>8}", "ms", "p50", "p99", "max"));
    let rows = STAGES.iter().filter_map(|(stage, name)| {
        let row = report.stage(*stage);
        let ms = |ns: u64| ns as f64 * 1e-6;
        (row.count > 0).then(|| {
            Line::raw(format!(
                " {name:<15} {:>8.3} {:>8.3} {:>8.3}",
                ms(row.p50_ns),
                ms(row.p99_ns),
                ms(row.max_ns)
            ))
        })
    });
    [heading("Latency"), head].into_iter().chain(rows).chain([missed(report)]).collect()
}

fn missed(report: &Report) -> Line<'static> {
    Line::raw(format!(
        " {} cycles, {} deadlines missed, {} slots skipped",
        report.cycles, report.deadlines_missed, report.slots_skipped
    ))
}
