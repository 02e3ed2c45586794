//! A stream's description: a small XML document.

use super::feed::Format;
use quick_xml::Reader;
use quick_xml::events::{BytesRef, Event};

/// Maximum count of channels; no plate has more.
const CHANNELS_MAX: usize = 256;
/// Maximum nesting depth; a stream's description has five levels.
const DEPTH_MAX: usize = 32;

/// A stream's description.
#[derive(Debug, Clone, PartialEq)]
pub struct StreamInfo {
    /// The user's name of the stream.
    pub name: String,
    /// Content type: `EEG`, `Force`, …
    pub kind: String,
    /// Identifier of the device; constant across restarts, if the device's program sets it.
    pub source_id: String,
    /// Identifier of this outlet.
    pub uid: String,
    /// liblsl's session.
    pub session_id: String,
    /// Host name of the sender.
    pub hostname: String,
    /// Number format.
    pub format: Format,
    /// Nominal rate, Hz; 0 for irregular samples.
    pub rate_hz: f64,
    /// The port of the samples.
    pub data_port: u16,
    /// The channels; without names and units if the description has none.
    pub channels: Vec<Channel>,
}

/// One channel.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Channel {
    /// Its name.
    pub label: String,
    /// Its unit.
    pub unit: String,
}

/// Why a description cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum InfoFault {
    /// Not XML.
    #[error("its description is no XML: {reason}")]
    Xml {
        /// The parser's error.
        reason: String,
    },
    /// A missing or invalid field.
    #[error("its description has no usable {field}")]
    Field {
        /// The field.
        field: &'static str,
    },
}

impl StreamInfo {
    /// Parses a short or full description.
    ///
    /// # Errors
    /// [`InfoFault`].
    pub fn parse(xml: &str) -> Result<StreamInfo, InfoFault> {
        let mut raw = RawInfo::default();
        read(xml, &mut |path, text| raw.take(path, text))?;
        raw.finish()
    }
}

/// The fields as in the document.
#[derive(Debug, Default)]
struct RawInfo {
    name: String,
    kind: String,
    source_id: String,
    uid: String,
    session_id: String,
    hostname: String,
    format: String,
    rate: String,
    count: String,
    port: String,
    channels: Vec<Channel>,
    open: Channel,
}

impl RawInfo {
    /// Processes an element's end, with the path of element names and its text.
    fn take(&mut self, path: &[String], text: &str) {
        let path: Vec<&str> = path.iter().map(String::as_str).collect();
        let field = match path[..] {
            ["info", "name"] => &mut self.name,
            ["info", "type"] => &mut self.kind,
            ["info", "source_id"] => &mut self.source_id,
            ["info", "uid"] => &mut self.uid,
            ["info", "session_id"] => &mut self.session_id,
            ["info", "hostname"] => &mut self.hostname,
            ["info", "channel_format"] => &mut self.format,
            ["info", "nominal_srate"] => &mut self.rate,
            ["info", "channel_count"] => &mut self.count,
            ["info", "v4data_port"] => &mut self.port,
            ["info", "desc", "channels", "channel"] => {
                // The child elements have ended before it.
                self.channels.push(core::mem::take(&mut self.open));
                return;
            }
            ["info", "desc", "channels", "channel", "label"] => &mut self.open.label,
            ["info", "desc", "channels", "channel", "unit"] => &mut self.open.unit,
            _ => return,
        };
        text.trim().clone_into(field);
    }

    fn finish(mut self) -> Result<StreamInfo, InfoFault> {
        let missing = |field| InfoFault::Field { field };
        let count: usize = self.count.parse().map_err(|_| missing("channel_count"))?;
        if !(1..=CHANNELS_MAX).contains(&count) {
            return Err(missing("channel_count"));
        }
        self.channels.resize(count, Channel::default());
        let one_line = |text: String, field| {
            let sound = !text.chars().any(char::is_control);
            if sound { Ok(text) } else { Err(missing(field)) }
        };
        let rate_hz: f64 = self.rate.parse().map_err(|_| missing("nominal_srate"))?;
        Ok(StreamInfo {
            name: self.name,
            kind: self.kind,
            // These fields are sent back to the sender, one on each line.
            source_id: one_line(self.source_id, "source_id")?,
            uid: one_line(self.uid, "uid")?,
            session_id: one_line(self.session_id, "session_id")?,
            hostname: one_line(self.hostname, "hostname")?,
            format: Format::named(&self.format).ok_or(missing("channel_format"))?,
            rate_hz: if rate_hz.is_finite() && rate_hz >= 0.0 {
                rate_hz
            } else {
                return Err(missing("nominal_srate"));
            },
            data_port: self.port.parse().map_err(|_| missing("v4data_port"))?,
            channels: self.channels,
        })
    }
}

/// Calls `ended` with each element's path and own text when it ends.
fn read(xml: &str, ended: &mut dyn FnMut(&[String], &str)) -> Result<(), InfoFault> {
    let fault = |reason: &dyn core::fmt::Display| InfoFault::Xml { reason: reason.to_string() };
    let mut reader = Reader::from_str(xml);
    reader.config_mut().expand_empty_elements = true;
    let (mut path, mut texts) = (Vec::new(), Vec::new());
    loop {
        match reader.read_event().map_err(|error| fault(&error))? {
            Event::Start(tag) => {
                if path.len() == DEPTH_MAX {
                    return Err(fault(&"too many elements within each other"));
                }
                path.push(tag.local_name().into_inner().to_owned());
                texts.push(String::new());
            }
            Event::Text(text) => add(&mut texts, &text.into_inner()),
            Event::CData(text) => add(&mut texts, &text.into_inner()),
            Event::GeneralRef(reference) => add(&mut texts, &referred(&reference)),
            Event::End(_) => {
                let text = texts.pop().unwrap_or_default();
                ended(&path, &text);
                path.pop();
            }
            Event::Eof if path.is_empty() => return Ok(()),
            Event::Eof => return Err(fault(&"it ends within an element")),
            Event::Empty(_) | Event::Comment(_) | Event::Decl(_) | Event::PI(_) | Event::DocType(_) => {}
        }
    }
}

fn add(texts: &mut [String], text: &str) {
    if let Some(open) = texts.last_mut() {
        open.push_str(text);
    }
}

/// Resolves the five entities of XML, and numeric character references.
fn referred(reference: &BytesRef<'_>) -> String {
    if let Ok(Some(character)) = reference.resolve_char_ref() {
        return character.to_string();
    }
    let name: &str = reference;
    quick_xml::escape::resolve_predefined_entity(name).unwrap_or_default().to_owned()
}
