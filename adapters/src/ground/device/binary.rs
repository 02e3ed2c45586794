//! A device with binary frames whose layout is configured.

use super::asking::Asking;
use super::framing::missing;
use super::{Action, GroundDevice};
use crate::ground::channels::Channels;
use crate::ground::order::{Order, Stamps, Trust};
use crate::ground::reading::{Decoded, Reading, Tick};
use crate::ground::refusal::GroundRefusal;
use crate::wire::frame::{FrameForm, FrameMatch, Frames, Length, Number, NumberPosition, StreamElement, Tag};

/// Set in a sample's counter while the device's trigger input, if any, is active.
pub const TRIGGER: u32 = 1 << 31;
/// Bytes of this many frames without one valid frame indicate a wrong format …
const REPORTED_AFTER_FRAMES: usize = 20;
/// … if they are at least this many.
const REPORTED_AFTER_BYTES: usize = 512;

/// One number of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field {
    /// Position in the frame.
    pub place: NumberPosition,
    /// The channel is `scale × number ÷ per + offset`.
    pub scale: f64,
    /// Count of the number's units in one of the channel's; 1 if `scale` covers the conversion.
    pub per: f64,
    /// Offset in the channel's unit.
    pub offset: f64,
}

/// A counter field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Count {
    /// Position in the frame.
    pub place: NumberPosition,
    /// Value at which the counter wraps to zero, 2 to 2⁶⁴.
    pub modulus: u128,
}

/// The device's time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Time {
    /// Position in the frame.
    pub place: NumberPosition,
    /// Unit of the field, ns.
    pub unit_ns: u64,
}

/// Several readings in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Scans {
    /// Count of readings.
    pub count: usize,
    /// Distance between the numbers of consecutive readings, bytes.
    pub bytes: usize,
}

/// Format and meaning of frames.
#[derive(Debug, Clone, PartialEq)]
pub struct BinarySettings {
    /// Format of a frame.
    pub form: FrameForm,
    /// Each delivery consists of whole frames; otherwise frames are searched in a stream.
    pub datagrams: bool,
    /// The channels of the first scan, in the order of `channels`.
    pub fields: Vec<Field>,
    /// The meaning of the channels.
    pub channels: Channels,
    /// Readings in a frame.
    pub scans: Scans,
    /// The counter of the frames.
    pub sequence: Option<Count>,
    /// The counter of the device's measurements, sent or not.
    pub counter: Option<Count>,
    /// The device's time.
    pub time: Option<Time>,
    /// Frame rate of a device without a counter, if configured: it reveals lost frames by the elapsed time, too.
    pub rate_hz: Option<f64>,
    /// Status bits: a sample with any of them set must not be used.
    pub status: Option<NumberPosition>,
    /// Value that indicates an active trigger input.
    pub trigger: Option<Tag>,
    /// Bytes that start the stream, repeated while the device is silent.
    pub request: Option<Vec<u8>>,
    /// Bytes sent before the connection is closed.
    pub close_command: Option<Vec<u8>>,
}

/// A device with configured binary frames.
#[derive(Debug, Clone)]
pub struct Binary {
    frames: Frames,
    reader: Reader,
    asking: Option<Asking>,
    /// Bytes since the last frame that belong to no frame.
    skipped: usize,
    /// Arrival of the last frame.
    framed_ns: Option<u64>,
    /// The same, or all bytes of datagrams without a frame; reported as a fault.
    unframed: usize,
}

#[derive(Debug, Clone)]
struct Reader {
    settings: BinarySettings,
    order: Order,
    /// Frames read, for devices without a counter.
    count: u32,
    values: Vec<f64>,
}

impl Binary {
    /// A device before any data.
    pub fn new(settings: BinarySettings) -> Binary {
        let all = |count: Option<Count>| count.map_or(1 << 64, |count| count.modulus);
        let scans = settings.scans.count.max(1) as u128;
        // A stream does not reorder, and a checksum excludes accidental values.
        let trust = if settings.form.checksum.is_some() && !settings.datagrams {
            Trust::Proven
        } else {
            Trust::Doubtful
        };
        let time_modulus = settings.time.map_or(1 << 64, |time| 1u128 << (8 * time.place.number.bytes()));
        let order = Order::new((all(settings.sequence) * scans).min(1 << 64), all(settings.counter))
            .with_time(time_modulus)
            .trusting(trust);
        Binary {
            frames: Frames::new(settings.form.clone()),
            asking: settings.request.clone().map(Asking::new),
            reader: Reader { order, count: 0, values: vec![0.0; settings.fields.len()], settings },
            skipped: 0,
            framed_ns: None,
            unframed: 0,
        }
    }

    fn datagram(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        let fits = match self.frames.form().length {
            Length::Fixed(length) => bytes.len().is_multiple_of(length),
            Length::InHead { .. } => true,
        };
        if bytes.is_empty() || !fits {
            self.unframed = self.unframed.saturating_add(bytes.len());
            return decoded.refuse(GroundRefusal::Length);
        }
        if self.asking.as_mut().is_some_and(Asking::is_answer) {
            decoded.restarted();
        }
        let mut rest = bytes;
        while !rest.is_empty() {
            let form = self.frames.form();
            let length = match form.match_start(rest) {
                FrameMatch::Frame(frame) => {
                    (self.skipped, self.unframed) = (0, 0);
                    self.reader.frame(frame, arrival_ns, decoded);
                    self.asking.iter_mut().for_each(|asking| asking.register_arrival(arrival_ns));
                    frame.len()
                }
                FrameMatch::Other(frame) => {
                    decoded.refuse(GroundRefusal::UnknownKind);
                    frame.len()
                }
                FrameMatch::TooFew => {
                    decoded.refuse(GroundRefusal::Length);
                    rest.len()
                }
                FrameMatch::Nothing => {
                    let damaged = form.begins_damaged(rest);
                    decoded.refuse(if damaged { GroundRefusal::Checksum } else { GroundRefusal::Garbage });
                    if damaged && self.reader.counts_nothing() {
                        decoded.lost(u32::try_from(self.reader.scans()).unwrap_or(u32::MAX));
                    }
                    self.unframed = self.unframed.saturating_add(rest.len());
                    // After a damaged length field, the position of the next frame is unknown.
                    match form.length {
                        Length::Fixed(length) => length,
                        Length::InHead { .. } => rest.len(),
                    }
                }
            };
            rest = rest.get(length..).unwrap_or_default();
        }
    }

    fn stream(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        self.frames.push(bytes);
        while let Some(element) = self.frames.advance() {
            match element {
                StreamElement::Frame(frame) => {
                    if self.asking.as_mut().is_some_and(Asking::is_answer) {
                        decoded.restarted();
                    }
                    self.unframed = 0;
                    let skipped = core::mem::take(&mut self.skipped);
                    let before_ns = self.framed_ns.replace(arrival_ns);
                    if self.reader.counts_nothing() && skipped > 0 {
                        let since_ns = before_ns.map_or(0, |before_ns| arrival_ns.saturating_sub(before_ns));
                        let rate_hz = self.reader.settings.rate_hz.unwrap_or_default();
                        let frames = missing(skipped, frame.len(), since_ns, rate_hz);
                        decoded.lost(u32::try_from(frames * self.reader.scans()).unwrap_or(u32::MAX));
                    }
                    self.reader.frame(frame, arrival_ns, decoded);
                    self.asking.iter_mut().for_each(|asking| asking.register_arrival(arrival_ns));
                }
                StreamElement::Other => {
                    (self.skipped, self.unframed) = (0, 0);
                    decoded.refuse(GroundRefusal::UnknownKind);
                }
                StreamElement::Skipped { bytes, damaged } => {
                    if self.skipped == 0 {
                        decoded.refuse(if damaged {
                            GroundRefusal::Checksum
                        } else {
                            GroundRefusal::Garbage
                        });
                    }
                    self.skipped = self.skipped.saturating_add(bytes);
                    self.unframed = self.unframed.saturating_add(bytes);
                }
            }
        }
    }
}

impl GroundDevice for Binary {
    fn opened(&mut self, _now_ns: u64) {
        self.frames.clear();
        self.asking.iter_mut().for_each(Asking::opened);
        self.reader.order.reset();
        (self.skipped, self.framed_ns) = (0, None);
        self.unframed = 0;
    }

    fn take(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        if self.reader.counts_nothing() {
            self.reader.order.register_arrival(arrival_ns, decoded);
        }
        if self.reader.settings.datagrams {
            self.datagram(bytes, arrival_ns, decoded);
        } else {
            self.stream(bytes, arrival_ns, decoded);
        }
    }

    fn next_action(&mut self, now_ns: u64) -> Action {
        self.asking.as_mut().map_or(Action::Nothing, |asking| asking.next_action(now_ns))
    }

    fn close_command(&mut self) -> Option<Vec<u8>> {
        self.reader.settings.close_command.clone()
    }

    fn diagnostic(&self) -> Option<String> {
        let limit = (REPORTED_AFTER_FRAMES * self.frames.form().least()).max(REPORTED_AFTER_BYTES);
        (self.unframed >= limit).then(|| {
            let unframed = self.unframed;
            format!(
                "bytes come, but none of the last {unframed} make a frame of the form in [ground.binary]: look at sync, length and \
                 crc there, and on a serial line at the speed ([ground.serial] baud)"
            )
        })
    }
}

impl Reader {
    fn counts_nothing(&self) -> bool {
        let BinarySettings { sequence, counter, time, .. } = &self.settings;
        sequence.is_none() && counter.is_none() && time.is_none()
    }

    /// Readings in a frame.
    fn scans(&self) -> usize {
        self.settings.scans.count.max(1)
    }

    fn frame(&mut self, frame: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        for scan in 0..self.scans() {
            // The format was validated to contain all fields; a missing one would be refused as not a number.
            if self.scan(frame, scan, arrival_ns, decoded).is_none() {
                decoded.refuse(GroundRefusal::Number);
            }
        }
    }

    fn scan(&mut self, frame: &[u8], scan: usize, arrival_ns: u64, decoded: &mut Decoded) -> Option<()> {
        let settings = &self.settings;
        let scans = settings.scans.count.max(1) as u64;
        for (field, value) in settings.fields.iter().zip(&mut self.values) {
            let number = field.place.moved(scan * settings.scans.bytes)?.value(frame)?;
            *value = number * field.scale / field.per + field.offset;
        }
        let counted = |count: Option<Count>| match count {
            Some(count) => count.place.count(frame).map(Some),
            None => Some(None),
        };
        let sequence =
            counted(settings.sequence)?.map(|frames| frames.wrapping_mul(scans).wrapping_add(scan as u64));
        let time = match settings.time {
            Some(time) => Some(time_ns(time, frame, &mut self.order)?),
            None => None,
        };
        let short_time = settings.time.filter(|time| time.place.number == Number::U32);
        let counter = match short_time {
            // A short time field wraps like a counter and is treated as one.
            Some(time) => time.place.count(frame),
            None => counted(settings.counter)?,
        };
        let status = settings.status.map_or(Some(0), |place| place.masked(frame))?;
        let trigger = settings.trigger.as_ref().is_some_and(|tag| tag.fits(frame));
        let stamps = Stamps { sequence, counter, time_ns: time };
        let Some((sequence, tick)) = self.order.place(stamps, arrival_ns, decoded) else { return Some(()) };
        self.count = self.count.wrapping_add(1);
        let own = match (tick, sequence) {
            (Tick::Counter(count), _) | (_, Some(count)) => count,
            _ => self.count,
        };
        let device_counter = match (&settings.trigger, trigger) {
            (None, _) => own,
            (Some(_), false) => own & !TRIGGER,
            (Some(_), true) => own | TRIGGER,
        };
        let load = settings.channels.load(&self.values);
        // A status of more than 32 bits is invalid if any bit is set.
        let status = u32::try_from(status).unwrap_or(u32::MAX);
        decoded.reading(Reading { sequence, tick, device_counter, status, load });
        Some(())
    }
}

/// The device's time in a frame, ns; `None` if the field is not a valid time.
fn time_ns(time: Time, frame: &[u8], order: &mut Order) -> Option<u64> {
    if !matches!(time.place.number, Number::F32 | Number::F64) {
        return Some(order.time_ns(time.place.count(frame)?, time.unit_ns));
    }
    let ns = time.place.value(frame)? * time.unit_ns as f64;
    // The bound is a power of two and thus exact.
    (ns >= 0.0 && ns < 2f64.powi(64)).then_some(ns as u64)
}

#[cfg(test)]
mod tests;
