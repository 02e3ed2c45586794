//! A recording's cycle records as a trace that Perfetto and chrome://tracing open: the Trace Event Format, JSON.
//!
//! Work of a thread is a slice on its track; waiting (of a datagram for the adapter, a sample for its cycle, a state
//! for egress) is an asynchronous slice, since waiting intervals may overlap. Every slice is a stage of
//! `equipoise_latency::Stage` with the stage's name. Times are CLOCK_MONOTONIC, as in other traces of the same machine.

mod event;

use std::io::{self, Write};
use std::ops::RangeInclusive;

use equipoise_adapters::recording::{Entry, ReadError, Recording};
use equipoise_core::message::CycleRecord;

use self::event::{Event, Track, events_of};

/// Content of a trace.
#[derive(Debug, Default)]
pub struct TraceSummary {
    /// Number of cycles.
    pub cycles: u64,
    /// First and last cycle.
    pub span: Option<(u64, u64)>,
    /// Number of missed deadlines.
    pub deadlines_missed: u64,
    /// Cycles of the recording without gaps, in file order: numbers restart with the daemon.
    pub available: Vec<RangeInclusive<u64>>,
    /// Damage that ended the recording; the trace contains everything before it.
    pub damage: Option<ReadError>,
}

/// Writes the cycles of a recording, or those of a range, as a trace.
///
/// # Errors
/// The trace cannot be written.
pub fn write_trace(
    recording: &Recording,
    cycles: Option<&RangeInclusive<u64>>,
    out: &mut impl Write,
) -> io::Result<TraceSummary> {
    let mut trace = Trace { out, has_events: false };
    trace.head(recording)?;
    let mut summary = TraceSummary::default();
    let mut before: Option<Box<CycleRecord>> = None;
    for entry in recording.entries() {
        let record = match entry.map(|timed| timed.entry) {
            Ok(Entry::Cycle(record)) => record,
            Ok(_) => continue,
            Err(damage) => {
                summary.damage = Some(damage);
                break;
            }
        };
        summary.extend_available(record.cycle);
        if cycles.is_none_or(|cycles| cycles.contains(&record.cycle)) {
            for event in events_of(&record, before.as_deref()) {
                trace.event(&event)?;
            }
            summary.ingest(&record);
        }
        before = Some(record);
    }
    trace.end()?;
    Ok(summary)
}

impl TraceSummary {
    fn extend_available(&mut self, cycle: u64) {
        match self.available.last_mut() {
            Some(last) if last.end().checked_add(1) == Some(cycle) => *last = *last.start()..=cycle,
            _ => self.available.push(cycle..=cycle),
        }
    }

    fn ingest(&mut self, record: &CycleRecord) {
        self.cycles += 1;
        self.deadlines_missed += u64::from(record.deadline_missed != 0);
        let (first, _) = self.span.unwrap_or((record.cycle, record.cycle));
        self.span = Some((first, record.cycle));
    }
}

/// A trace written event by event, since a shift has millions.
struct Trace<'a, W: Write> {
    out: &'a mut W,
    has_events: bool,
}

impl<W: Write> Trace<'_, W> {
    fn head(&mut self, recording: &Recording) -> io::Result<()> {
        let header = recording.header();
        write!(
            self.out,
            "{{\"displayTimeUnit\":\"ns\",\"otherData\":{{\"software\":{},\"clock\":\"CLOCK_MONOTONIC\",\
             \"started_unix_ns\":\"{}\",\"started_monotonic_ns\":\"{}\"}},\n\"traceEvents\":[",
            serde_json::Value::from(format!("equipoise {}", header.software_version)),
            header.started_unix_ns,
            header.started_monotonic_ns,
        )?;
        for line in Track::names() {
            self.line(&line)?;
        }
        Ok(())
    }

    fn event(&mut self, event: &Event) -> io::Result<()> {
        self.line(&event.to_string())
    }

    fn line(&mut self, line: &str) -> io::Result<()> {
        let comma = if std::mem::replace(&mut self.has_events, true) { "," } else { "" };
        write!(self.out, "{comma}\n{line}")
    }

    fn end(&mut self) -> io::Result<()> {
        writeln!(self.out, "\n]}}")?;
        self.out.flush()
    }
}

#[cfg(test)]
mod tests;
