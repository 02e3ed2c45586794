//! `[ground.binary]`: format of binary frames.

mod build;

use equipoise_adapters::ground::GroundDevice;
use equipoise_adapters::ground::device::binary::Binary;
use equipoise_adapters::source::{SourceError, Transport};
use serde::{Deserialize, Serialize};
use toml::Spanned;

use super::numbers::{Hex, LengthConfig, ModulusConfig, TimeUnit};
use super::transport::{self, TransportKind};
use super::{DescriptionError, GroundConfig};
use build::settings;

/// `[ground.binary]`
///
/// Offsets are in bytes from the start of the frame, negative ones from its end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BinaryConfig {
    /// Transport of the frames. A datagram contains complete frames only; otherwise frames are searched in a stream.
    #[serde(alias = "over")]
    pub transport: TransportKind,
    /// Byte order of its numbers.
    pub endian: EndianConfig,
    /// First bytes of every frame, in hexadecimal digits; none by default.
    #[serde(default, skip_serializing_if = "Hex::is_empty")]
    pub sync: Hex,
    /// Length of a frame in bytes, or the number in the frame that contains it.
    pub length: LengthConfig<NumberType>,
    /// Numbers with fixed values that identify a frame.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tags: Vec<Spanned<TagConfig>>,
    /// The number that selects the valid frames to read; others are ignored. All by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<TagConfig>,
    /// Checksum of a frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crc: Option<CrcConfig>,
    /// The numbers to read.
    pub fields: Vec<Spanned<FieldConfig>>,
    /// Several samples in one frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scans: Option<ScansConfig>,
    /// Counter of frames.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sequence: Option<CountConfig>,
    /// Counter of the device's measurements, sent or not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub counter: Option<CountConfig>,
    /// The device's time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<TimeConfig>,
    /// Frame rate of a device without a counter; with a time, gaps are detected too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<f64>,
    /// Status bits, any of which invalidates a sample.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub status: Option<NumberConfig>,
    /// The number that is nonzero while the device's trigger input is active.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trigger: Option<TagConfig>,
    /// Command that starts the device, in hexadecimal digits; repeated while it is silent.
    #[serde(default, skip_serializing_if = "Hex::is_empty")]
    pub send_on_open: Hex,
    /// Command sent before the connection is closed, in hexadecimal digits.
    #[serde(default, skip_serializing_if = "Hex::is_empty")]
    pub send_on_close: Hex,
}

/// Byte order of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EndianConfig {
    /// Least significant byte first.
    Little,
    /// Most significant byte first (network byte order).
    Big,
}

/// Type of a number.
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

/// A number in a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NumberConfig {
    /// Offset of its first byte.
    pub at: i32,
    /// Its type.
    #[serde(rename = "type")]
    pub number: NumberType,
    /// Mask of its bits; all by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<u32>,
}

/// A number that must have one of several values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TagConfig {
    /// Offset of its first byte.
    pub at: i32,
    /// Its type.
    #[serde(rename = "type")]
    pub number: NumberType,
    /// Mask of its bits; all by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<u32>,
    /// The values, without a shift of the masked bits.
    pub is: Vec<u32>,
}

/// `crc` of `[ground.binary]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CrcConfig {
    /// Its name in the RevEng catalogue; or `SUM-8`, `SUM-16`, `XOR-8`.
    pub name: String,
    /// It covers the bytes from this one …
    pub from: i32,
    /// … up to this one, excluded.
    pub to: i32,
    /// Its offset.
    pub at: i32,
    /// Its byte order; by default that of the frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub endian: Option<EndianConfig>,
}

/// An entry of `fields`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldConfig {
    /// Its name in `[ground.channels]`.
    pub name: String,
    /// Offset of its first byte.
    pub at: i32,
    /// Its type.
    #[serde(rename = "type")]
    pub number: NumberType,
    /// Mask of its bits; all by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<u32>,
    /// Its byte order; by default that of the frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub endian: Option<EndianConfig>,
    /// The channel is `scale × number ÷ per + offset`.
    #[serde(default = "super::numbers::one")]
    pub scale: f64,
    /// Number per unit of the channel, such as counts per newton.
    #[serde(default = "super::numbers::one")]
    pub per: f64,
    /// Offset in the channel's unit.
    #[serde(default)]
    pub offset: f64,
}

/// `scans` of `[ground.binary]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScansConfig {
    /// Number of samples in a frame.
    pub count: usize,
    /// Distance between the samples in bytes.
    pub bytes: usize,
}

/// A counter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CountConfig {
    /// Offset of its first byte.
    pub at: i32,
    /// Its type.
    #[serde(rename = "type")]
    pub number: NumberType,
    /// Mask of its bits; all by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<u32>,
    /// Value at which it wraps to zero; by default that of its bits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub modulus: Option<ModulusConfig>,
}

/// `time` of `[ground.binary]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeConfig {
    /// Offset of its first byte.
    pub at: i32,
    /// Its type.
    #[serde(rename = "type")]
    pub number: NumberType,
    /// Its unit.
    pub unit: TimeUnit,
}

fn section(ground: &GroundConfig) -> Result<&BinaryConfig, DescriptionError> {
    ground.binary.as_ref().ok_or_else(|| {
        let what =
            "must be given: [ground.binary] with transport, endian, length and fields describes the frames";
        DescriptionError::new("ground.binary", what)
    })
}

pub(super) fn check(ground: &GroundConfig) -> Result<(), DescriptionError> {
    let config = section(ground)?;
    transport::check(ground, config.transport)?;
    let has_commands = !config.send_on_open.is_empty() || !config.send_on_close.is_empty();
    let key = if config.send_on_open.is_empty() { "send_on_close" } else { "send_on_open" };
    match config.transport {
        TransportKind::Udp if has_commands && ground.address.is_none() => Err(DescriptionError::new(
            format!("ground.binary.{key}"),
            "a device that receives commands has an address: ground.address",
        )),
        TransportKind::File if has_commands => Err(DescriptionError::new(
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
    transport::transport(ground, section(ground)?.transport)
}
