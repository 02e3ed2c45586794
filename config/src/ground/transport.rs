//! Transport of a described device: `transport` of `[ground.text]` and `[ground.binary]`.

use std::path::PathBuf;

use equipoise_adapters::source::file_line::{Begin, FileLine};
use equipoise_adapters::source::udp::Senders;
use equipoise_adapters::source::{Flow, SourceError, TcpLine, Transport, UdpLine};
use serde::{Deserialize, Serialize};

use super::description_error::DescriptionError;
use super::serial::{self, SerialDefaults};
use super::{GroundConfig, GroundSourceKind};

/// Transport of the bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TransportKind {
    /// Datagrams: to `listen`, or from `address` on request.
    Udp,
    /// A TCP connection to `address`.
    Tcp,
    /// The port of `[ground.serial]`.
    Serial,
    /// The file or named pipe of `[ground.file]`, written by another program.
    File,
}

/// `[ground.file]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileConfig {
    /// The file or named pipe; a relative path refers to the daemon's working directory.
    pub path: PathBuf,
    /// Start of reading.
    #[serde(default)]
    pub begin: BeginConfig,
}

/// Start of reading.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BeginConfig {
    /// At the end of the file.
    #[default]
    End,
    /// At the first line.
    Start,
}

/// Default speed of a serial port: that of most small boards.
const DEFAULTS: SerialDefaults = SerialDefaults { baud: 115_200, flow: Flow::Free };

pub(super) fn check(ground: &GroundConfig, over: TransportKind) -> Result<(), DescriptionError> {
    let must = |key: &str, example: &str| {
        DescriptionError::new(key, format!("must be given for this `transport`, for example {example}"))
    };
    match over {
        TransportKind::Udp => match (ground.address, ground.listen) {
            (None, None) => Err(must(
                "ground.listen",
                "listen = \"0.0.0.0:8888\" (or `address`, for a device that receives send_on_open)",
            )),
            (Some(_), Some(_)) => Err(DescriptionError::new(
                "ground.listen",
                "a device sends to `listen` of itself or is asked at `address`; give one of the two",
            )),
            (Some(_), None) if ground.binary.as_ref().is_none_or(|binary| binary.send_on_open.is_empty()) => {
                Err(DescriptionError::new(
                    "ground.address",
                    "a device over UDP learns where to send only from a command: give `listen` in its place, or \
                 send_on_open of [ground.binary]",
                ))
            }
            _ => Ok(()),
        },
        TransportKind::Tcp if ground.address.is_none() => {
            Err(must("ground.address", "address = \"192.168.1.20:4000\""))
        }
        TransportKind::Tcp => Ok(()),
        TransportKind::Serial => Ok(serial::check(ground)?),
        TransportKind::File if ground.file.is_none() => {
            Err(must("ground.file", "[ground.file] with path = \"export.txt\""))
        }
        TransportKind::File => Ok(()),
    }
}

pub(super) fn transport(
    ground: &GroundConfig,
    over: TransportKind,
) -> Result<Box<dyn Transport>, SourceError> {
    check(ground, over)?;
    let device = match ground.source {
        GroundSourceKind::Text => "the device of ground.text",
        _ => "the device of ground.binary",
    };
    Ok(match (over, ground.address, ground.listen, &ground.file) {
        (TransportKind::Udp, Some(address), _, _) => Box::new(UdpLine::to(address, "ground.address")),
        (TransportKind::Udp, None, Some(_), _) => listening(ground)?,
        (TransportKind::Tcp, Some(address), _, _) => Box::new(TcpLine::to(address, device, "ground.address")),
        (TransportKind::Serial, ..) => serial::line(ground, DEFAULTS)?,
        (TransportKind::File, _, _, Some(file)) => {
            let begin = match file.begin {
                BeginConfig::End => Begin::End,
                BeginConfig::Start => Begin::Start,
            };
            Box::new(FileLine::new(file.path.clone(), begin, "ground.file.path"))
        }
        // `check` refuses these cases.
        _ => return Err(SourceError::Unusable("ground: neither address, listen nor file".to_owned())),
    })
}

/// Check for devices that send datagrams without a request.
pub(super) fn listening(ground: &GroundConfig) -> Result<Box<dyn Transport>, SourceError> {
    let Some(listen) = ground.listen else {
        return Err(SourceError::Unusable("ground.listen: must be given".to_owned()));
    };
    let senders = if ground.allow_remote { Senders::Anyone } else { Senders::Loopback };
    Ok(Box::new(UdpLine::listening(listen, senders, "ground.listen")))
}
