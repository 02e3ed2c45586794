//! `[ground.text]`: format of text lines.

use equipoise_adapters::ground::GroundDevice;
use equipoise_adapters::ground::device::text::{
    Column, Framing, LINE_BYTES_MAX, Numbered, Text, TextSettings,
};
use equipoise_adapters::source::{SourceError, Transport};
use equipoise_adapters::wire::text_line::{Decimal, Delimiter, LineForm};
use serde::{Deserialize, Serialize};
use toml::Spanned;

use super::GroundConfig;
use super::channels::{self, Names};
use super::description_error::{DescriptionError, nearest};
use super::numbers::{FACTORS, ModulusConfig, NamedNumber, SUMMANDS, TimeUnit, is_factor, is_summand};
use super::transport::{self, BeginConfig, TransportKind};

/// `[ground.text]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TextConfig {
    /// Transport of the lines.
    #[serde(alias = "over")]
    pub transport: TransportKind,
    /// Separator of fields.
    pub delimiter: DelimiterConfig,
    /// Decimal separator.
    #[serde(default)]
    pub decimal: DecimalConfig,
    /// Lines that begin with this character are ignored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub comment: Option<char>,
    /// Prefix of every line, before its first field; lines without it are ignored.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub prefix: String,
    /// Number of non-empty lines before the first one with numbers.
    #[serde(default)]
    pub header_lines: u32,
    /// Maximum length of a line.
    #[serde(default = "line_bytes_default")]
    pub line_bytes_max: usize,
    /// All fields of a line in their order: a name, `{ name, scale, offset }`, or "-" if unused.
    pub columns: Vec<Spanned<NamedNumber>>,
    /// Column of the device's time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<TimeColumn>,
    /// Column of the line counter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sequence: Option<SequenceColumn>,
}

/// `time` of `[ground.text]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeColumn {
    /// The column.
    pub column: String,
    /// Its unit.
    pub unit: TimeUnit,
}

/// `sequence` of `[ground.text]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SequenceColumn {
    /// The column.
    pub column: String,
    /// Value at which it wraps to zero, for example 256; never by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub modulus: Option<ModulusConfig>,
}

/// Separator of fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DelimiterConfig {
    /// Any run of spaces and tabs.
    Spaces,
    /// One tab.
    Tab,
    /// One comma.
    Comma,
    /// One semicolon.
    Semicolon,
}

/// Decimal separator.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum DecimalConfig {
    /// A point.
    #[default]
    #[serde(rename = ".")]
    Point,
    /// A comma.
    #[serde(rename = ",")]
    Comma,
}

fn line_bytes_default() -> usize {
    4096
}

const NOT_READ: &str = "-";

fn section(ground: &GroundConfig) -> Result<&TextConfig, DescriptionError> {
    ground.text.as_ref().ok_or_else(|| {
        let what = "must be given: [ground.text] with transport, delimiter and columns describes the lines";
        DescriptionError::new("ground.text", what)
    })
}

impl TextConfig {
    fn form(&self) -> Result<LineForm, DescriptionError> {
        if (self.delimiter, self.decimal) == (DelimiterConfig::Comma, DecimalConfig::Comma) {
            let what = "a comma cannot stand between fields and before decimals as well";
            return Err(DescriptionError::new("ground.text.decimal", what));
        }
        let comment = self.comment.map(u8::try_from).transpose();
        let Some(comment) = comment.ok().filter(|sign| sign.is_none_or(|sign| sign.is_ascii_graphic()))
        else {
            let what = "one visible sign of ASCII, for example \"#\"";
            return Err(DescriptionError::new("ground.text.comment", what));
        };
        self.check_prefix()?;
        Ok(LineForm {
            delimiter: match self.delimiter {
                DelimiterConfig::Spaces => Delimiter::Spaces,
                DelimiterConfig::Tab => Delimiter::Tab,
                DelimiterConfig::Comma => Delimiter::Comma,
                DelimiterConfig::Semicolon => Delimiter::Semicolon,
            },
            decimal: match self.decimal {
                DecimalConfig::Point => Decimal::Point,
                DecimalConfig::Comma => Decimal::Comma,
            },
            comment,
            prefix: self.prefix.as_bytes().to_vec(),
            fields: self.columns.len(),
        })
    }

    /// Checks that a line can have the prefix: lines end with LF or CR, the prefix is compared without white space
    /// before it, and comments are ignored first.
    fn check_prefix(&self) -> Result<(), DescriptionError> {
        let what = if self.prefix.starts_with(|first: char| first.is_ascii_whitespace()) {
            "white space before it is ignored; leave it out"
        } else if self.prefix.contains(['\n', '\r']) {
            "it contains the end of a line, so that no line has it"
        } else if self.comment.is_some_and(|comment| self.prefix.starts_with(comment)) {
            "it begins with ground.text.comment, so that every line is ignored as a comment"
        } else {
            return Ok(());
        };
        Err(DescriptionError::new("ground.text.prefix", what))
    }

    /// Index of the column with a name.
    fn place(&self, name: &str, key: &str) -> Result<usize, DescriptionError> {
        self.columns.iter().position(|column| column.get_ref().name == name).ok_or_else(|| {
            let candidates = self
                .columns
                .iter()
                .map(|column| column.get_ref().name.as_str())
                .filter(|name| *name != NOT_READ);
            DescriptionError::new(key, format!("no column is called `{name}`{}", nearest(name, candidates)))
        })
    }

    /// Checks that names are unique.
    fn check_names(&self) -> Result<(), DescriptionError> {
        let key = "ground.text.columns";
        if self.columns.is_empty() || self.columns.len() > 1000 {
            return Err(DescriptionError::new(key, "1 to 1000 columns: one entry for each field of a line"));
        }
        for (index, column) in self.columns.iter().enumerate() {
            let NamedNumber { name, scale, offset } = column.get_ref();
            if name.is_empty() {
                return Err(DescriptionError::at(
                    column,
                    key,
                    "a column without a name; an unused one is called \"-\"",
                ));
            }
            if !(is_factor(*scale) && is_summand(*offset)) {
                return Err(DescriptionError::at(
                    column,
                    key,
                    format!(
                        "`{name}`: scale is {scale:?} and offset {offset:?}; scale is {FACTORS}, offset {SUMMANDS}"
                    ),
                ));
            }
            let before = &self.columns[..index];
            if name != NOT_READ && before.iter().any(|other| other.get_ref().name == *name) {
                return Err(DescriptionError::at(
                    column,
                    key,
                    format!("`{name}` is the name of two columns"),
                ));
            }
        }
        Ok(())
    }
}

fn settings(ground: &GroundConfig) -> Result<TextSettings, DescriptionError> {
    let config = section(ground)?;
    let form = config.form()?;
    config.check_names()?;
    if !(16..=LINE_BYTES_MAX).contains(&config.line_bytes_max) {
        let what = format!("{} is not from 16 to {LINE_BYTES_MAX}", config.line_bytes_max);
        return Err(DescriptionError::new("ground.text.line_bytes_max", what));
    }
    let mut time = None;
    if let Some(clock) = &config.time {
        time = Some((config.place(&clock.column, "ground.text.time")?, clock.unit.in_text()));
    }
    let mut sequence = None;
    if let Some(count) = &config.sequence {
        let modulus = count.modulus.unwrap_or_default().checked("ground.text.sequence")?;
        sequence = Some(Numbered { field: config.place(&count.column, "ground.text.sequence")?, modulus });
    }
    for field in time.iter().map(|(field, _)| *field).chain(sequence.iter().map(|numbered| numbered.field)) {
        let column = &config.columns[field];
        let NamedNumber { scale, offset, .. } = column.get_ref();
        if (*scale, *offset) != (1.0, 0.0) {
            let what = "a time or a count is taken as it stands: leave its scale and offset out";
            return Err(DescriptionError::at(column, "ground.text.columns", what));
        }
    }
    let is_number = |field: &usize| {
        config.columns[*field].get_ref().name != NOT_READ
            && Some(*field) != time.map(|(field, _)| field)
            && Some(*field) != sequence.map(|numbered| numbered.field)
    };
    let fields: Vec<usize> = (0..config.columns.len()).filter(is_number).collect();
    let names: Vec<String> =
        fields.iter().map(|field| config.columns[*field].get_ref().name.clone()).collect();
    let mut lookup = Names::new(&names);
    let channels = channels::channels(ground, &mut lookup)?;
    if let Some(unused) = lookup.unused().next() {
        let column = &config.columns[config.place(unused, "ground.text.columns")?];
        let what = format!("[ground.channels] does not use `{unused}`; an unused column is called \"-\"");
        return Err(DescriptionError::at(column, "ground.text.columns", what));
    }
    let column = |field: usize| {
        let NamedNumber { scale, offset, .. } = config.columns[field].get_ref();
        Column { field, scale: *scale, offset: *offset }
    };
    Ok(TextSettings {
        form,
        framing: framing(ground, config.transport),
        header_lines: config.header_lines,
        longest: config.line_bytes_max,
        columns: fields.into_iter().map(column).collect(),
        channels,
        time,
        sequence,
    })
}

/// Framing of the stream. A serial device sends without a listener, and a file's end may be incomplete, so reading may
/// start in the middle of a line.
fn framing(ground: &GroundConfig, over: TransportKind) -> Framing {
    match over {
        TransportKind::Udp => Framing::Datagrams,
        TransportKind::Tcp => Framing::Stream,
        TransportKind::Serial => Framing::Joined,
        TransportKind::File => match ground.file.as_ref().map(|file| file.begin) {
            Some(BeginConfig::Start) => Framing::Stream,
            _ => Framing::Joined,
        },
    }
}

pub(super) fn check(ground: &GroundConfig) -> Result<(), DescriptionError> {
    transport::check(ground, section(ground)?.transport)?;
    settings(ground).map(drop)
}

pub(super) fn device(ground: &GroundConfig) -> Result<Box<dyn GroundDevice>, SourceError> {
    Ok(Box::new(Text::new(settings(ground)?)))
}

pub(super) fn transport(ground: &GroundConfig) -> Result<Box<dyn Transport>, SourceError> {
    transport::transport(ground, section(ground)?.transport)
}
