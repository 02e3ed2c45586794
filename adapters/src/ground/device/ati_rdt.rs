//! ATI Net F/T and Axia over RDT: converts records to readings and requests the stream.

mod scale;

use super::asking::Asking;
use super::{Action, GroundDevice};
use crate::ground::frame::Wrench;
use crate::ground::reading::{Decoded, Load, Reading, Tick};
use crate::ground::refusal::GroundRefusal;
use crate::wire::ati_rdt::{Command, Record, Records, Request};
pub use scale::Page;
use scale::Scale;

/// An unusable settings page is read again after this, as an operator may have changed the device's settings.
const CHECKED_AGAIN_NS: u64 = 5_000_000_000;
/// Reordering of records changes the count by some steps, never by this many.
const FALL_MIN: i32 = 20_000;

/// Configuration of the device and its start command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RdtSettings {
    /// Counts per newton; `None` uses the device's settings page.
    pub counts_per_newton: Option<f64>,
    /// Counts per newton metre; `None` uses the device's settings page.
    pub counts_per_newton_metre: Option<f64>,
    /// Start command: [`Command::StartRealTime`] for Net F/T, [`Command::StartSingleBlock`] for Axia.
    pub start: Command,
}

impl Default for RdtSettings {
    fn default() -> Self {
        let counts = Some(1e6);
        RdtSettings {
            counts_per_newton: counts,
            counts_per_newton_metre: counts,
            start: Command::StartRealTime,
        }
    }
}

/// A device with the RDT protocol.
#[derive(Debug, Clone)]
pub struct AtiRdt {
    settings: RdtSettings,
    /// Counts per unit, or why they are unavailable.
    scale: Result<Scale, String>,
    /// No data since the connection was opened.
    fresh: bool,
    /// The settings page was read; it is read again after a restart, as the settings may differ.
    has_page: bool,
    checked_ns: u64,
    note: Option<String>,
    last_count: Option<u32>,
    /// The sequence restarts with each request.
    asking: Asking,
    restarted: bool,
}

impl AtiRdt {
    /// A device before the first request.
    pub fn new(settings: RdtSettings) -> AtiRdt {
        AtiRdt {
            settings,
            scale: Scale::configured(&settings),
            fresh: true,
            has_page: false,
            checked_ns: 0,
            note: None,
            last_count: None,
            asking: Asking::new(Request { command: settings.start, sample_count: 0 }.to_bytes().to_vec()),
            restarted: false,
        }
    }

    fn page(&mut self, page: Result<&str, &str>, now_ns: u64) {
        self.checked_ns = now_ns;
        self.has_page = page.is_ok();
        (self.scale, self.note) = match Scale::from_page(&self.settings, page) {
            Ok((scale, note)) => (Ok(scale), Some(note)),
            Err(why) => (Err(why), None),
        };
    }

    fn reading(&mut self, record: &Record, scale: Scale) -> Reading {
        // The device's own count decreases only after a power cycle.
        let before = self.last_count.replace(record.ft_sequence);
        let steps = before.map_or(0, |before| record.ft_sequence.wrapping_sub(before).cast_signed());
        self.restarted |= self.has_page && steps < -FALL_MIN;
        Reading {
            sequence: Some(record.rdt_sequence),
            tick: Tick::Counter(record.ft_sequence),
            device_counter: record.ft_sequence,
            status: record.status,
            load: Load::Wrench(Wrench {
                force_n: record.force_counts.map(|counts| f64::from(counts) / scale.counts_per_newton),
                moment_nm: record
                    .torque_counts
                    .map(|counts| f64::from(counts) / scale.counts_per_newton_metre),
            }),
        }
    }

    /// While the scale is unavailable: stops the stream, and after an interval requests the settings page again.
    fn wants_page(&mut self, now_ns: u64, why: String) -> Action {
        if self.asking.is_answer() || self.asking.take_streaming() {
            return Action::Send(Request { command: Command::Stop, sample_count: 0 }.to_bytes().to_vec());
        }
        if now_ns.saturating_sub(self.checked_ns) < CHECKED_AGAIN_NS {
            return Action::Nothing;
        }
        self.checked_ns = now_ns;
        Action::Reopen(why)
    }
}

impl GroundDevice for AtiRdt {
    fn opened(&mut self, now_ns: u64) {
        (self.fresh, self.has_page, self.checked_ns) = (true, false, now_ns);
        self.scale = Scale::configured(&self.settings);
        self.last_count = None;
        self.asking.opened();
        self.restarted = false;
    }

    fn take(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        if core::mem::take(&mut self.fresh)
            && let Some(page) = Page::from_bytes(bytes)
        {
            self.page(page.as_deref().map_err(String::as_str), arrival_ns);
            return;
        }
        let Ok(records) = Records::parse(bytes) else {
            decoded.refuse(GroundRefusal::Length);
            return;
        };
        self.asking.register_arrival(arrival_ns);
        let Ok(scale) = self.scale else {
            decoded.refuse(GroundRefusal::UnknownKind);
            return;
        };
        if self.asking.is_answer() {
            decoded.restarted();
        }
        for record in records {
            let reading = self.reading(&record, scale);
            decoded.reading(reading);
        }
    }

    fn next_action(&mut self, now_ns: u64) -> Action {
        if let Err(why) = &self.scale {
            let why = why.clone();
            return self.wants_page(now_ns, why);
        }
        if core::mem::take(&mut self.restarted) {
            return Action::Reopen("the ATI device was restarted: its settings are read again".to_owned());
        }
        self.asking.next_action(now_ns)
    }

    fn close_command(&mut self) -> Option<Vec<u8>> {
        Some(Request { command: Command::Stop, sample_count: 0 }.to_bytes().to_vec())
    }

    fn diagnostic(&self) -> Option<String> {
        self.scale.as_ref().err().cloned()
    }

    fn note(&self) -> Option<String> {
        self.note.clone()
    }
}

#[cfg(test)]
mod tests;
