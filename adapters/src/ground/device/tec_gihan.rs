//! Tec Gihan force plates: the dialogue that starts the controller's measurement, and conversion of blocks of counts to
//! readings.
//!
//! Axes z down, force on the plate, moments about the sensors' centre, as in the maker's formulae.

mod dialogue;

use self::dialogue::{Dialogue, DialogueResult, Next};
use super::{Action, GroundDevice};
use crate::ground::frame::Wrench;
use crate::ground::reading::{Decoded, Load, Reading, Tick};
use crate::ground::refusal::GroundRefusal;
use crate::wire::tec_gihan::{FullScales, Line, Range, Rate, block_size, plate_samples};

/// A block is late if it takes this much longer than its duration; the transfer of the largest takes 0.25 s.
const LATE_NS: u64 = 500_000_000;
/// Tolerance between the surface heights of the plate and of the configuration, m.
const SURFACE_SLACK_M: f64 = 0.0005;

/// Settings of the controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TecGihanSettings {
    /// The plate's number, from 1.
    pub plate: u32,
    /// Sampling rate.
    pub rate: Rate,
    /// Full scale.
    pub range: Range,
    /// Configured height of the walking surface over the sensors, m; the plate reports it as well.
    pub surface_height_m: f64,
}

/// A controller and its plates.
#[derive(Debug, Clone)]
pub struct TecGihan {
    settings: TecGihanSettings,
    phase: Phase,
    /// Refusals and losses detected while no bytes arrived; counted with the next bytes.
    deferred: Deferred,
    surface: Option<String>,
    diagnostic: Option<String>,
}

#[derive(Debug, Clone)]
enum Phase {
    Talking(Dialogue),
    Measuring(Blocks),
}

/// Reception of blocks.
#[derive(Debug, Clone)]
struct Blocks {
    scales: FullScales,
    size: usize,
    block: Vec<u8>,
    /// Request time of the awaited block.
    since_ns: u64,
    /// The next request is due.
    due: bool,
    /// More bytes arrived than requested: block boundaries are lost.
    excess: bool,
    fresh: bool,
}

#[derive(Debug, Clone, Copy, Default)]
struct Deferred {
    incomplete: bool,
    lost: u32,
}

impl TecGihan {
    /// A controller before the dialogue.
    pub fn new(settings: TecGihanSettings) -> TecGihan {
        TecGihan {
            settings,
            phase: Phase::Talking(Dialogue::new(settings)),
            deferred: Deferred::default(),
            surface: None,
            diagnostic: None,
        }
    }

    /// Restarts the dialogue: stop, flush, query, start.
    fn restart_block(&mut self) {
        self.phase = Phase::Talking(Dialogue::new(self.settings));
    }

    fn start_measuring(&mut self, result: &DialogueResult, now_ns: u64) {
        let size = block_size(result.plates, self.settings.rate);
        self.surface = result.surface_height_m.and_then(|metres| self.other_surface(metres));
        self.phase = Phase::Measuring(Blocks {
            scales: result.scales,
            size,
            block: Vec::with_capacity(size),
            since_ns: now_ns,
            due: false,
            excess: false,
            fresh: true,
        });
    }

    fn other_surface(&self, plate_m: f64) -> Option<String> {
        let configured_m = self.settings.surface_height_m;
        // A mat on top may raise the surface, but never lower it.
        (configured_m < plate_m - SURFACE_SLACK_M).then(|| {
            format!(
                "the plate says that its surface is {plate_m:.4} m above its sensors, the configuration says \
                 {configured_m:.4} m: set ground.frame.surface_height_m to {plate_m:.4}, or more by a mat"
            )
        })
    }

    fn take_block(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        let TecGihanSettings { plate, rate, range, .. } = self.settings;
        let Phase::Measuring(blocks) = &mut self.phase else { return };
        let room = blocks.size - blocks.block.len();
        let (own, excess) = bytes.split_at(room.min(bytes.len()));
        blocks.block.extend_from_slice(own);
        // The controller sends only on request. Excess bytes are noise, or a block requested earlier.
        blocks.excess |= !excess.is_empty();
        if blocks.excess || blocks.block.len() < blocks.size {
            return;
        }
        if core::mem::take(&mut blocks.fresh) {
            decoded.restarted();
        }
        decoded.block_latency(rate.block_ns());
        for counts in plate_samples(&blocks.block, plate - 1, rate) {
            let [fx, fy, fz, mx, my, mz] = blocks.scales.scaled(range, counts);
            decoded.reading(Reading {
                sequence: None,
                tick: Tick::Uncounted,
                device_counter: 0,
                status: 0,
                load: Load::Wrench(Wrench { force_n: [fx, fy, fz], moment_nm: [mx, my, mz] }),
            });
        }
        blocks.block.clear();
        (blocks.due, blocks.since_ns) = (true, arrival_ns);
        self.diagnostic = None;
    }

    /// A missing or malformed block ends the measurement: blocks have no marker for resynchronisation.
    fn broken(&mut self, now_ns: u64) -> Option<(&'static str, bool)> {
        let Phase::Measuring(blocks) = &self.phase else { return None };
        if blocks.excess {
            return Some(("more bytes than a block has", true));
        }
        let patience_ns = 3 * self.settings.rate.block_ns() + LATE_NS;
        if now_ns.saturating_sub(blocks.since_ns) <= patience_ns {
            return None;
        }
        Some(if blocks.block.is_empty() { ("no block", false) } else { ("only a part of a block", true) })
    }
}

impl GroundDevice for TecGihan {
    fn opened(&mut self, _now_ns: u64) {
        self.restart_block();
    }

    fn take(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        if core::mem::take(&mut self.deferred.incomplete) {
            decoded.refuse(GroundRefusal::Incomplete);
        }
        match core::mem::take(&mut self.deferred.lost) {
            0 => {}
            lost => decoded.lost(lost),
        }
        match &mut self.phase {
            Phase::Talking(dialogue) => dialogue.take(bytes, decoded),
            Phase::Measuring(_) => self.take_block(bytes, arrival_ns, decoded),
        }
    }

    fn next_action(&mut self, now_ns: u64) -> Action {
        if let Some((what, partly)) = self.broken(now_ns) {
            self.diagnostic = Some(format!(
                "the controller sent {what}: it is stopped and started again; check the cable, and that the line has \
                 RTS/CTS"
            ));
            self.deferred = Deferred { incomplete: partly, lost: self.settings.rate.block_samples };
            self.restart_block();
        }
        match &mut self.phase {
            Phase::Measuring(blocks) if blocks.due => {
                (blocks.due, blocks.since_ns) = (false, now_ns);
                Action::Send(Line::NextBlock.to_bytes())
            }
            Phase::Measuring(_) => Action::Nothing,
            Phase::Talking(dialogue) => match dialogue.next(now_ns) {
                Next::Wait => Action::Nothing,
                Next::Say(line) => Action::Send(line.to_bytes()),
                Next::Start(result) => {
                    self.start_measuring(&result, now_ns);
                    Action::Send(Line::Start.to_bytes())
                }
                Next::GiveUp(why) => {
                    self.diagnostic = Some(why.clone());
                    Action::Reopen(why)
                }
            },
        }
    }

    fn close_command(&mut self) -> Option<Vec<u8>> {
        Some(Line::Stop.to_bytes())
    }

    fn diagnostic(&self) -> Option<String> {
        self.diagnostic.clone().or_else(|| self.surface.clone())
    }
}

#[cfg(test)]
mod tests;
