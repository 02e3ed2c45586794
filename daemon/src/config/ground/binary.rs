//! `[ground.binary]`: the form of binary frames.

mod build;

use equipoise_adapters::ground::GroundDevice;
use equipoise_adapters::ground::device::binary::Binary;
use equipoise_adapters::source::{SourceError, Transport};
use serde::{Deserialize, Serialize};
use toml::Spanned;

use super::numbers::{Hex, LengthConfig, ModulusConfig, TimeUnit};
use super::transport::{self, Over};
use super::{DescriptionError, GroundConfig};
use build::settings;

/// `[ground.binary]`
///
/// Places are counted in bytes from the frame's first one, which is 0; below zero from its end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BinaryConfig {
    /// What the frames come over. A datagram is whole frames and nothing else; elsewhere they are found in a stream.
    pub over: Over,
    /// In which order the bytes of its numbers stand.
    pub endian: EndianConfig,
    /// What every frame begins with, in hexadecimal digits; nothing by default.
    #[serde(default, skip_serializing_if = "Hex::is_empty")]
    pub sync: Hex,
    /// Bytes of a frame, or the number in the frame that contains them.
    pub length: LengthConfig<NumberType>,
    /// Numbers that must have certain values, or there is no frame.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tags: Vec<Spanned<TagConfig>>,
    /// The number that says which sound frames are read; others are passed over. All by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<TagConfig>,
    /// Its checksum.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crc: Option<CrcConfig>,
    /// The numbers that are read.
    pub fields: Vec<Spanned<FieldConfig>>,
    /// Several readings in one frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scans: Option<ScansConfig>,
    /// What counts the frames.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sequence: Option<CountConfig>,
    /// What counts the device's measurements, sent or not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub counter: Option<CountConfig>,
    /// The device's time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<TimeConfig>,
    /// How many frames a second a device sends that counts nothing: what is missing shows in the time, too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<f64>,
    /// Bits that forbid to use a sample if one is set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub status: Option<NumberConfig>,
    /// The number that says that the device's trigger input is active.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trigger: Option<TagConfig>,
    /// Command that starts the device, repeated while it is silent, in hexadecimal digits.
    #[serde(default, skip_serializing_if = "Hex::is_empty")]
    pub send_on_open: Hex,
    /// Command that is sent before the connection is closed, in hexadecimal digits.
    #[serde(default, skip_serializing_if = "Hex::is_empty")]
    pub send_on_close: Hex,
}

/// In which order the bytes of a number stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EndianConfig {
    /// The lowest first.
    Little,
    /// The highest first, as networks have it.
    Big,
}

/// A kind of number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[expect(missing_docs, reason = "the names of the types say all that there is to say")]
pub enum NumberType {
    U8,
    I8,
    U16,
    I16,
    U24,
    I24,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

/// A number somewhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NumberConfig {
    /// Its first byte.
    pub at: i32,
    /// What it is.
    #[serde(rename = "type")]
    pub number: NumberType,
    /// Which of its bits are meant; all by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<u32>,
}

/// A number that must have one of some values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TagConfig {
    /// Its first byte.
    pub at: i32,
    /// What it is.
    #[serde(rename = "type")]
    pub number: NumberType,
    /// Which of its bits are meant; all by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<u32>,
    /// The values, where the bits stand.
    pub is: Vec<u32>,
}

/// `crc` of `[ground.binary]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CrcConfig {
    /// Its name in the RevEng catalogue; or `SUM-8`, `SUM-16`, `XOR-8`.
    pub name: String,
    /// It is of the bytes from this one …
    pub from: i32,
    /// … to before this one.
    pub to: i32,
    /// Where it stands.
    pub at: i32,
    /// In which order its bytes stand; as the frame's by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub endian: Option<EndianConfig>,
}

/// An entry of `fields`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldConfig {
    /// What `[ground.channels]` calls it.
    pub name: String,
    /// Its first byte.
    pub at: i32,
    /// What it is.
    #[serde(rename = "type")]
    pub number: NumberType,
    /// Which of its bits are meant; all by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<u32>,
    /// In which order its bytes stand; as the frame's by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub endian: Option<EndianConfig>,
    /// The channel is `scale × number ÷ per + offset`.
    #[serde(default = "super::numbers::one")]
    pub scale: f64,
    /// How many of the number one of the channel's unit is: counts per newton.
    #[serde(default = "super::numbers::one")]
    pub per: f64,
    /// In the channel's unit.
    #[serde(default)]
    pub offset: f64,
}

/// `scans` of `[ground.binary]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScansConfig {
    /// How many readings a frame holds.
    pub count: usize,
    /// The numbers of each stand so many bytes after those of the one before.
    pub bytes: usize,
}

/// A number that counts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CountConfig {
    /// Its first byte.
    pub at: i32,
    /// What it is.
    #[serde(rename = "type")]
    pub number: NumberType,
    /// Which of its bits are meant; all by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<u32>,
    /// Where it starts again at zero; where its bits do by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub modulus: Option<ModulusConfig>,
}

/// `time` of `[ground.binary]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeConfig {
    /// Its first byte.
    pub at: i32,
    /// What it is.
    #[serde(rename = "type")]
    pub number: NumberType,
    /// Its unit.
    pub unit: TimeUnit,
}

fn section(ground: &GroundConfig) -> Result<&BinaryConfig, DescriptionError> {
    ground.binary.as_ref().ok_or_else(|| {
        let what =
            "must be given: [ground.binary] with over, endian, length and fields says what frames look like";
        DescriptionError::new("ground.binary", what)
    })
}

pub(super) fn check(ground: &GroundConfig) -> Result<(), DescriptionError> {
    let config = section(ground)?;
    transport::check(ground, config.over)?;
    let has_commands = !config.send_on_open.is_empty() || !config.send_on_close.is_empty();
    let key = if config.send_on_open.is_empty() { "send_on_close" } else { "send_on_open" };
    match config.over {
        Over::Udp if has_commands && ground.address.is_none() => Err(DescriptionError::new(
            format!("ground.binary.{key}"),
            "a device that receives commands has an address: ground.address",
        )),
        Over::File if has_commands => Err(DescriptionError::new(
            format!("ground.binary.{key}"),
            "a file takes no commands; leave it out",
        )),
        _ => settings(ground).map(drop),
    }
}

pub(super) fn device(ground: &GroundConfig) -> Result<Box<dyn GroundDevice>, SourceError> {
    Ok(Box::new(Binary::new(settings(ground)?)))
}

pub(super) fn transport(ground: &GroundConfig) -> Result<Box<dyn Transport>, SourceError> {
    transport::transport(ground, section(ground)?.over)
}
