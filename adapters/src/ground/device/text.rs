//! A device with lines of text whose layout is configured.

use super::GroundDevice;
use crate::ground::channels::Channels;
use crate::ground::order::{Order, Stamps};
use crate::ground::reading::{Decoded, Reading, Tick};
use crate::ground::refusal::GroundRefusal;
use crate::wire::text_line::{Fields, LineForm, Lines, Malformed, Unit};

/// A longer line is not a line of numbers.
pub const LINE_BYTES_MAX: usize = 64 * 1024;
/// This many malformed lines in a row are reported.
const REPORTED_AFTER_LINES: u32 = 20;

/// Framing of the lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Framing {
    /// Each delivery consists of whole lines, one or several.
    Datagrams,
    /// Deliveries are pieces of a stream that begins with a line.
    Stream,
    /// Pieces of a stream that was joined at an arbitrary point: the first line may be incomplete, unless the transport
    /// reports that it begins at the start ([`GroundDevice::opened_at_start`]).
    Joined,
}

/// One number of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Column {
    /// Which field, counted from 0.
    pub field: usize,
    /// The channel is `scale × number + offset`.
    pub scale: f64,
    /// Offset in the channel's unit.
    pub offset: f64,
}

/// A field that counts the lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Numbered {
    /// Which field, counted from 0.
    pub field: usize,
    /// Value at which it wraps, 2 to 2⁶⁴.
    pub modulus: u128,
}

/// Format and meaning of lines.
#[derive(Debug, Clone, PartialEq)]
pub struct TextSettings {
    /// Format of a line.
    pub form: LineForm,
    /// Framing of the lines.
    pub framing: Framing,
    /// Count of nonempty header lines before the first data line, each time the stream begins.
    pub header_lines: u32,
    /// The longest line, bytes; at most [`LINE_BYTES_MAX`].
    pub longest: usize,
    /// The channels, in the order of `channels`.
    pub columns: Vec<Column>,
    /// Meaning of the channels.
    pub channels: Channels,
    /// Index of the device's time field, and its unit.
    pub time: Option<(usize, Unit)>,
    /// The field that counts the lines.
    pub sequence: Option<Numbered>,
}

/// Validates the channels of every line, for devices whose numbers can contradict each other.
pub(super) trait Validator: Send {
    /// Validates one line's channels.
    fn validate(&mut self, _values: &[f64]) -> Result<(), GroundRefusal> {
        Ok(())
    }

    /// The current fault and its remedy, in a sentence; `None` without a fault.
    fn diagnostic(&self) -> Option<String> {
        None
    }
}

/// No validation, for devices defined by their description alone.
#[derive(Debug, Clone, Copy, Default)]
pub struct Described;

impl Validator for Described {}

/// A device with configured lines of text.
#[derive(Debug, Clone)]
pub struct Text<J = Described> {
    settings: TextSettings,
    lines: Lines,
    reader: Reader<J>,
}

/// All state but the line buffer, so that a line can be read in place.
#[derive(Debug, Clone)]
struct Reader<J> {
    order: Order,
    validator: J,
    header_left: u32,
    /// Fields of the channels, sorted, with the channel of each.
    sorted: Vec<(usize, usize)>,
    fields: Vec<usize>,
    numbers: Vec<f64>,
    values: Vec<f64>,
    /// Lines in a row that could not be placed after the preceding one.
    untimely: u32,
    /// Malformed lines in a row, and the fault of the last.
    wrong: u32,
    fault: Option<Malformed>,
}

impl Text {
    /// A device before any data.
    pub fn new(settings: TextSettings) -> Text {
        Text::with_validator(settings, Described)
    }
}

impl<J> Text<J> {
    /// The same, with a validator of the numbers.
    pub(super) fn with_validator(settings: TextSettings, validator: J) -> Text<J> {
        let modulus = settings.sequence.map_or(1 << 64, |numbered| numbered.modulus);
        let mut sorted: Vec<(usize, usize)> =
            settings.columns.iter().enumerate().map(|(channel, column)| (column.field, channel)).collect();
        sorted.sort_unstable();
        // Two channels may use the same field.
        let mut fields: Vec<usize> = sorted.iter().map(|(field, _)| *field).collect();
        fields.dedup();
        let reader = Reader {
            order: Order::new(modulus, 1 << 64),
            validator,
            header_left: settings.header_lines,
            sorted,
            fields,
            numbers: Vec::new(),
            values: vec![0.0; settings.columns.len()],
            untimely: 0,
            wrong: 0,
            fault: None,
        };
        Text { lines: settings.lines(settings.framing == Framing::Joined), settings, reader }
    }
}

impl TextSettings {
    /// The line buffer; `is_joined`: the first line may be incomplete.
    fn lines(&self, is_joined: bool) -> Lines {
        Lines::new(self.longest.min(LINE_BYTES_MAX), is_joined)
    }

    fn counts_nothing(&self) -> bool {
        self.time.is_none() && self.sequence.is_none()
    }

    /// Refuses an unreadable line; with a counter, the next line reveals the loss.
    fn damaged(&self, refusal: GroundRefusal, decoded: &mut Decoded) {
        decoded.refuse(refusal);
        if self.counts_nothing() {
            decoded.lost(1);
        }
    }
}

impl<J: Validator> GroundDevice for Text<J> {
    fn opened(&mut self, now_ns: u64) {
        self.opened_at_start(now_ns);
        self.lines = self.settings.lines(self.settings.framing == Framing::Joined);
    }

    fn opened_at_start(&mut self, _now_ns: u64) {
        self.lines = self.settings.lines(false);
        self.reader.header_left = self.settings.header_lines;
        self.reader.order.reset();
    }

    fn take(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        let Text { settings, lines, reader } = self;
        if settings.counts_nothing() {
            reader.order.register_arrival(arrival_ns, decoded);
        }
        let mut each = |line: Result<&[u8], _>| match line {
            Ok(line) => reader.line(settings, line, arrival_ns, decoded),
            Err(_) => settings.damaged(GroundRefusal::TooLong, decoded),
        };
        lines.take(bytes, &mut each);
        if settings.framing == Framing::Datagrams {
            lines.end(&mut each);
        }
    }

    fn diagnostic(&self) -> Option<String> {
        if self.reader.untimely >= REPORTED_AFTER_LINES {
            return Some(format!(
                "lines come, but the times in the last {} of them stand still, or do not run as time does: is the unit of the \
                 device's time (s, ms, us, ns) the one that it sends?",
                self.reader.untimely
            ));
        }
        let Some(fault) = self.reader.fault.filter(|_| self.reader.wrong >= REPORTED_AFTER_LINES) else {
            return self.reader.validator.diagnostic();
        };
        let noise = match self.settings.framing {
            Framing::Joined => {
                "; a serial line at another speed than the device's, ground.serial.baud, brings noise alone"
            }
            Framing::Stream | Framing::Datagrams => "",
        };
        Some(format!(
            "the lines that come are not as described: {fault}; look at what the device sends, and set columns, delimiter \
             and decimal sign accordingly{noise}"
        ))
    }
}

impl<J: Validator> Reader<J> {
    fn line(&mut self, settings: &TextSettings, line: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        if self.header_left > 0 {
            self.header_left -= 1;
            return;
        }
        let read = settings.form.parse(line).and_then(|fields| match fields {
            Some(fields) => self.read(settings, &fields).map(Some),
            None => Ok(None),
        });
        match read {
            Ok(None) => {}
            Ok(Some(stamps)) => {
                (self.wrong, self.fault) = (0, None);
                // A line refused as contradictory was not lost: it has its place in the sequence.
                let Some((sequence, tick)) = self.order.place(stamps, arrival_ns, decoded) else {
                    self.untimely = self.untimely.saturating_add(1);
                    return;
                };
                self.untimely = 0;
                if let Err(refusal) = self.validator.validate(&self.values) {
                    return decoded.refuse(refusal);
                }
                let device_counter = match (sequence, tick) {
                    (Some(count), _) | (None, Tick::Counter(count)) => count,
                    _ => 0,
                };
                let load = settings.channels.load(&self.values);
                decoded.reading(Reading { sequence, tick, device_counter, status: 0, load });
            }
            Err(fault) => {
                self.wrong = self.wrong.saturating_add(1);
                self.fault = Some(fault);
                let refusal = match fault {
                    Malformed::Fields { .. } => GroundRefusal::Fields,
                    Malformed::Number { .. } => GroundRefusal::Number,
                };
                settings.damaged(refusal, decoded);
            }
        }
    }

    /// Reads the channels into `values`; returns the line's time and sequence number.
    fn read(&mut self, settings: &TextSettings, fields: &Fields<'_>) -> Result<Stamps, Malformed> {
        let stamps = Stamps {
            sequence: settings
                .sequence
                .map(|numbered| fields.whole(numbered.field, Unit::One))
                .transpose()?,
            counter: None,
            time_ns: settings.time.map(|(field, unit)| fields.whole(field, unit)).transpose()?,
        };
        fields.numbers(&self.fields, &mut self.numbers)?;
        let mut numbers = self.fields.iter().zip(&self.numbers).peekable();
        for (field, channel) in &self.sorted {
            while numbers.next_if(|(at, _)| *at < field).is_some() {}
            let number = numbers.peek().map_or(f64::NAN, |(_, number)| **number);
            let column = settings.columns[*channel];
            self.values[*channel] = number * column.scale + column.offset;
        }
        Ok(stamps)
    }
}

#[cfg(test)]
mod tests;
