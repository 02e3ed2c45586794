//! A Lab Streaming Layer (LSL) stream: maps named channels with units to the wrench of a plate.
//!
//! The stream begins with its description, which the transport requests, terminated by a zero byte; the samples follow.
//! Sample times are the sender's: their offset and drift are estimated from the earliest arrivals, as for every device.

use super::{Action, GroundDevice};
use crate::ground::plan::{DeviceChannel, Plan, ResolvedPlan, Wording};
use crate::ground::reading::{Decoded, Reading, Tick};
use crate::ground::refusal::GroundRefusal;
use crate::wire::lsl::{Feed, Item, StreamInfo, feed_request};

const NS_PER_S: u64 = 1_000_000_000;
/// A description has some kilobytes.
const INFO_MAX: usize = 1 << 20;
/// Silence of a stream that is reported.
const SILENCE_NS: u64 = 3 * NS_PER_S;
/// Stamps of samples that were pushed together may overlap earlier ones by this; a larger step is a clock that was set.
const OVERLAP_NS: u64 = NS_PER_S;
/// LSL clocks count from the boot of their machine; a larger value is invalid, s.
const TIME_MAX_S: f64 = 1e10;
/// Accepted nominal rates of a stream, Hz.
const RATES_HZ: core::ops::RangeInclusive<f64> = 0.01..=1e7;

const WORDING: Wording = Wording {
    device: "the stream",
    section: "ground.lsl",
    missing: "the stream's own description names its channels, or they are counted from 1",
    unit: "have its sender tell one, or set ground.lsl.force_unit and moment_unit",
};

/// Meaning of the channels.
#[derive(Debug, Clone, PartialEq)]
pub struct LslSettings {
    /// Channels by the label in the stream's description, or by number from 1.
    pub plan: Plan,
    /// Unit of forces for channels without a unit in the description.
    pub force_unit: Option<String>,
    /// The same for moments.
    pub moment_unit: Option<String>,
}

/// A stream.
#[derive(Debug, Clone)]
pub struct Lsl {
    settings: LslSettings,
    phase: Phase,
    diagnostic: Option<String>,
    /// Why the stream has ended.
    over: Option<String>,
    since_ns: u64,
    silent: bool,
}

#[derive(Debug, Clone)]
enum Phase {
    /// The received part of the description.
    Info(Vec<u8>),
    Feed(Box<Samples>),
}

#[derive(Debug, Clone)]
struct Samples {
    info: StreamInfo,
    asked: bool,
    feed: Feed,
    fitted: ResolvedPlan,
    period_ns: u64,
    newest_ns: Option<u64>,
    count: u32,
}

impl Lsl {
    /// A stream before its description.
    pub fn new(settings: LslSettings) -> Lsl {
        let phase = Phase::Info(Vec::new());
        Lsl { settings, phase, diagnostic: None, over: None, since_ns: 0, silent: false }
    }

    fn info(&mut self, xml: &[u8]) {
        let LslSettings { plan, force_unit, moment_unit } = &self.settings;
        let fitted = StreamInfo::parse(&String::from_utf8_lossy(xml))
            .map_err(|fault| format!("the stream cannot be read: {fault}"))
            .and_then(|info| {
                let rate_hz = info.rate_hz;
                if rate_hz > 0.0 && !RATES_HZ.contains(&rate_hz) {
                    return Err(format!(
                        "the stream says that it has {rate_hz} samples a second, which none has: correct the nominal rate of \
                         its sender, which is 0 where there is none"
                    ));
                }
                let units = [force_unit.as_deref(), moment_unit.as_deref()];
                let fitted = plan.fit_with(&channels_of_device(&info), WORDING, units)?;
                Ok((info, fitted))
            });
        match fitted {
            Ok((info, fitted)) => {
                let period_ns = if info.rate_hz > 0.0 { (1e9 / info.rate_hz) as u64 } else { 0 };
                self.phase = Phase::Feed(Box::new(Samples {
                    feed: Feed::new(&info.uid, info.format, info.channels.len()),
                    info,
                    asked: false,
                    fitted,
                    period_ns,
                    newest_ns: None,
                    count: 0,
                }));
            }
            Err(why) => self.end(why),
        }
    }

    fn end(&mut self, why: String) {
        self.diagnostic = Some(why.clone());
        self.over = Some(why);
    }
}

/// Channels have their number from 1 as name, and the label of the description.
fn channels_of_device(info: &StreamInfo) -> Vec<DeviceChannel> {
    let one = |(index, channel): (usize, &crate::wire::lsl::Channel)| DeviceChannel {
        name: (index + 1).to_string(),
        label: channel.label.clone(),
        unit: channel.unit.clone(),
    };
    info.channels.iter().enumerate().map(one).collect()
}

/// A sample's time; `None` if the stamp is invalid.
fn time_ns(stamp_s: Option<f64>, newest_ns: Option<u64>, period_ns: u64) -> Option<u64> {
    let Some(stamp_s) = stamp_s else {
        // As in liblsl: one period after the preceding sample, starting at zero. Never the same time twice.
        return Some(newest_ns.unwrap_or(0).saturating_add(period_ns.max(1)));
    };
    let sound = stamp_s > 0.0 && stamp_s < TIME_MAX_S;
    let time_ns = sound.then_some((stamp_s * 1e9) as u64)?;
    Some(match newest_ns {
        // Samples arrive in order, although a clock that is read once a push may give overlapping stamps.
        Some(newest_ns) if time_ns <= newest_ns && newest_ns - time_ns < OVERLAP_NS => {
            newest_ns.saturating_add(1)
        }
        _ => time_ns,
    })
}

impl GroundDevice for Lsl {
    fn opened(&mut self, now_ns: u64) {
        self.phase = Phase::Info(Vec::new());
        self.over = None;
        self.since_ns = now_ns;
    }

    fn take(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        let mut bytes = bytes;
        if let Phase::Info(xml) = &mut self.phase {
            let end = bytes.iter().position(|byte| *byte == 0);
            let (own, rest) = bytes.split_at(end.unwrap_or(bytes.len()));
            xml.extend_from_slice(own);
            if end.is_none() {
                if xml.len() > INFO_MAX {
                    xml.clear();
                    decoded.refuse(GroundRefusal::TooLong);
                }
                return;
            }
            let xml = core::mem::take(xml);
            self.info(&xml);
            bytes = rest.get(1..).unwrap_or_default();
        }
        let Phase::Feed(samples) = &mut self.phase else {
            if !bytes.is_empty() {
                decoded.refuse(GroundRefusal::UnknownKind);
            }
            return;
        };
        samples.feed.push(bytes);
        let mut broken = None;
        while let Some(item) = samples.feed.next_item() {
            match item {
                Ok(Item::Agreed) => self.diagnostic = None,
                Ok(Item::Sample { time_s, values }) => {
                    (self.since_ns, self.silent) = (arrival_ns, false);
                    let Some(time_ns) = time_ns(time_s, samples.newest_ns, samples.period_ns) else {
                        decoded.refuse(GroundRefusal::Number);
                        continue;
                    };
                    samples.newest_ns = Some(time_ns);
                    samples.count = samples.count.wrapping_add(1);
                    decoded.reading(Reading {
                        sequence: None,
                        tick: Tick::Time(time_ns),
                        device_counter: samples.count,
                        status: 0,
                        load: samples.fitted.load(values),
                    });
                }
                Err(error) => {
                    decoded.refuse(GroundRefusal::Garbage);
                    broken = Some(format!("the stream is opened again: {error}"));
                }
            }
        }
        if let Some(why) = broken {
            self.end(why);
        }
    }

    fn next_action(&mut self, now_ns: u64) -> Action {
        if let Some(why) = self.over.take() {
            return Action::Reopen(why);
        }
        self.silent = now_ns.saturating_sub(self.since_ns) > SILENCE_NS;
        match &mut self.phase {
            Phase::Feed(samples) if !samples.asked => {
                samples.asked = true;
                Action::Send(feed_request(&samples.info))
            }
            Phase::Feed(_) | Phase::Info(_) => Action::Nothing,
        }
    }

    fn diagnostic(&self) -> Option<String> {
        let silent =
            || self.silent.then(|| "the stream is there and sends nothing: is its device on?".to_owned());
        self.diagnostic.clone().or_else(silent)
    }
}

#[cfg(test)]
mod tests;
