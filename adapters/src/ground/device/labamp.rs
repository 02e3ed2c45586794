//! Kistler's LabAmp: converts scans of charge amplifiers to the wrench of a plate.
//!
//! The transport prepends a line to the stream: the device's description of its channels. Frames follow it.

mod mean;

use self::mean::{Decimator, Mean};
use super::{Action, GroundDevice};
use crate::ground::plan::{DeviceChannel, Plan, ResolvedPlan, Wording};
use crate::ground::reading::{Decoded, Reading, Tick};
use crate::ground::refusal::GroundRefusal;
use crate::wire::labamp::talk::{Metadata, Signal};
use crate::wire::labamp::{Content, Data, Deframer, Event, Frame, Malformed};

/// The description of the channels has some kilobytes.
const LINE_MAX: usize = 1 << 20;
/// Default rate of readings, Hz: scans are averaged to about this rate.
const USUAL_RATE_HZ: f64 = 1000.0;
/// Accepted sampling rates of a LabAmp, Hz.
const RATES_HZ: core::ops::RangeInclusive<f64> = 0.01..=1e7;
/// Silence after which the stream has ended; frames normally arrive every few tenths of a second.
const SILENCE_NS: u64 = 3_000_000_000;

const WORDING: Wording = Wording {
    device: "Kistler's LabAmp",
    section: "ground.labamp",
    missing: "switch it on for DAQ on the device's page",
    unit: "set its sensor's unit and sensitivity on the device's page",
};

fn channels_of_device(signals: &[Signal]) -> Vec<DeviceChannel> {
    let one = |Signal { source, name, unit }: &Signal| DeviceChannel {
        name: source.clone(),
        label: name.clone(),
        unit: unit.clone(),
    };
    signals.iter().map(one).collect()
}

/// Meaning of the channels, and count of scans in one reading.
#[derive(Debug, Clone, PartialEq)]
pub struct LabAmpSettings {
    /// Meaning of the channels.
    pub plan: Plan,
    /// One reading is the mean of this many scans; `None`: about 1000 readings a second.
    pub decimate: Option<u32>,
}

/// A LabAmp.
#[derive(Debug, Clone)]
pub struct LabAmp {
    settings: LabAmpSettings,
    phase: Phase,
    diagnostic: Option<String>,
    /// Why the stream has ended.
    over: Option<String>,
    last_ns: u64,
}

#[derive(Debug, Clone)]
enum Phase {
    /// The received part of the line that describes the channels.
    Channels(Vec<u8>),
    Frames(Box<Frames>),
}

#[derive(Debug, Clone)]
struct Frames {
    deframer: Deframer,
    fitted: ResolvedPlan,
    rate_hz: f64,
    decimator: Decimator,
    sequence: Option<u32>,
}

impl LabAmp {
    /// A LabAmp before any data.
    pub fn new(settings: LabAmpSettings) -> LabAmp {
        LabAmp { settings, phase: Phase::Channels(Vec::new()), diagnostic: None, over: None, last_ns: 0 }
    }

    fn line(&mut self, line: &[u8]) {
        let fitted = Metadata::parse(&String::from_utf8_lossy(line))
            .map_err(|error| {
                format!("Kistler's LabAmp sends its channels in an unknown form: {error}")
            })
            .and_then(|metadata| {
                let rate_hz = metadata.rate_hz;
                if !RATES_HZ.contains(&rate_hz) {
                    return Err(format!(
                        "Kistler's LabAmp says that it measures {rate_hz} times a second, which none does: set its sampling \
                         rate on the device's page"
                    ));
                }
                let fitted = self.settings.plan.fit(&channels_of_device(&metadata.signals), WORDING)?;
                Ok((fitted, rate_hz))
            });
        match fitted {
            Ok((fitted, rate_hz)) => {
                let usual = (rate_hz / USUAL_RATE_HZ).round().max(1.0) as u32;
                let decimate = self.settings.decimate.unwrap_or(usual).max(1);
                self.phase = Phase::Frames(Box::new(Frames {
                    deframer: Deframer::default(),
                    decimator: Decimator::new(fitted.count(), decimate, rate_hz),
                    fitted,
                    rate_hz,
                    sequence: None,
                }));
                self.diagnostic = None;
            }
            Err(why) => {
                self.diagnostic = Some(why.clone());
                self.over = Some(why);
            }
        }
    }

    fn event(&mut self, event: Event, decoded: &mut Decoded) {
        let over = match event {
            Event::Overrun => {
                decoded.refuse(GroundRefusal::Overrun);
                // The lost data have no number: the time of the next frame reveals their count.
                if let Phase::Frames(frames) = &mut self.phase {
                    frames.decimator.missing_frames(1);
                }
                return;
            }
            Event::TimeSkew => {
                // The times of the frames reveal the size of the clock step.
                decoded.refuse(GroundRefusal::DeviceStatus);
                return;
            }
            Event::Other(_) => {
                decoded.refuse(GroundRefusal::UnknownKind);
                return;
            }
            Event::Closed => {
                "the stream of Kistler's LabAmp was closed by another client: it is opened again"
            }
            Event::Reconfigured => "Kistler's LabAmp was reconfigured: its stream is opened again",
            Event::Stopped => {
                "the measurement of Kistler's LabAmp was stopped by another client: it is started again"
            }
        };
        self.over = Some(over.to_owned());
    }
}

impl LabAmp {
    fn frame(&mut self, frame: Result<Frame<'_>, Malformed>, decoded: &mut Decoded) {
        let Phase::Frames(frames) = &mut self.phase else { return };
        let frame = match frame {
            Ok(frame) => frame,
            Err(error @ Malformed::Front { front }) => {
                // A later protocol version, in either byte order, or no frame at all.
                let later = matches!(front, [2..=9, 0, ..] | [0, 2..=9, ..]);
                decoded.refuse(if later { GroundRefusal::Version } else { GroundRefusal::Garbage });
                self.over = Some(format!("{error}: its stream is opened again"));
                return;
            }
            Err(Malformed::Length { .. }) => {
                decoded.refuse(GroundRefusal::Length);
                return;
            }
        };
        let before = frames.sequence.replace(frame.sequence);
        // A step back is no loss.
        let steps = before.map_or(1, |before| frame.sequence.wrapping_sub(before)).cast_signed();
        frames.decimator.missing_frames(u32::try_from(steps.saturating_sub(1)).unwrap_or(0));
        match frame.content {
            Content::Data(data) => frames.data(&frame, &data, decoded),
            Content::Event(event) => self.event(event, decoded),
            Content::Other => decoded.refuse(GroundRefusal::UnknownKind),
        }
    }
}

impl Frames {
    fn data(&mut self, frame: &Frame<'_>, data: &Data<'_>, decoded: &mut Decoded) {
        let channels = self.fitted.count();
        if data.count() == 0 || !data.count().is_multiple_of(channels) {
            decoded.refuse(GroundRefusal::Length);
            return;
        }
        let scans = data.count() / channels;
        decoded.block_latency((scans as f64 / self.rate_hz * 1e9) as u64);
        self.decimator.frame(data.time_ns, scans, decoded);
        let mut numbers = data.numbers();
        for _ in 0..scans {
            if let Some(Mean { time_ns, values }) = self.decimator.scan(&mut numbers) {
                let load = self.fitted.load(values);
                decoded.reading(Reading {
                    sequence: None,
                    tick: Tick::Time(time_ns),
                    device_counter: frame.sequence,
                    status: 0,
                    load,
                });
            }
        }
    }
}

impl GroundDevice for LabAmp {
    fn opened(&mut self, now_ns: u64) {
        self.phase = Phase::Channels(Vec::new());
        self.over = None;
        self.last_ns = now_ns;
    }

    fn take(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        self.last_ns = arrival_ns;
        let mut bytes = bytes;
        if let Phase::Channels(line) = &mut self.phase {
            // After an unusable description the stream is abandoned; its remaining bytes must not be parsed as a
            // description.
            if self.over.is_some() {
                if !bytes.is_empty() {
                    decoded.refuse(GroundRefusal::UnknownKind);
                }
                return;
            }
            let end = bytes.iter().position(|byte| *byte == b'\n');
            let (own, rest) = bytes.split_at(end.unwrap_or(bytes.len()));
            line.extend_from_slice(own);
            if end.is_none() {
                if line.len() > LINE_MAX {
                    line.clear();
                    decoded.refuse(GroundRefusal::TooLong);
                }
                return;
            }
            let line = core::mem::take(line);
            self.line(&line);
            bytes = rest.get(1..).unwrap_or_default();
        }
        let Phase::Frames(frames) = &mut self.phase else {
            if !bytes.is_empty() {
                decoded.refuse(GroundRefusal::UnknownKind);
            }
            return;
        };
        let mut deframer = core::mem::take(&mut frames.deframer);
        deframer.push(bytes);
        while let Some(frame) = deframer.next_frame() {
            self.frame(frame, decoded);
        }
        if let Phase::Frames(frames) = &mut self.phase {
            frames.deframer = deframer;
        }
    }

    fn next_action(&mut self, now_ns: u64) -> Action {
        if let Some(why) = self.over.take() {
            return Action::Reopen(why);
        }
        if matches!(self.phase, Phase::Frames(_)) && now_ns.saturating_sub(self.last_ns) > SILENCE_NS {
            self.last_ns = now_ns;
            return Action::Reopen("Kistler's LabAmp fell silent: its stream is opened again".to_owned());
        }
        Action::Nothing
    }

    fn diagnostic(&self) -> Option<String> {
        self.diagnostic.clone()
    }
}

#[cfg(test)]
mod tests;
