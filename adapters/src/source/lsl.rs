//! Transport of a Lab Streaming Layer (LSL) stream: found by discovery, or at a configured address; the description is
//! read first, then the samples.
//!
//! The stream's description precedes the feed, terminated by a zero byte, which XML does not contain.

mod find;

use super::error::SourceError;
use super::tcp_line::TcpLine;
use super::transport::{Incoming, Transport};
use crate::clock::now_monotonic_ns;
use crate::wire::lsl::{FULL_INFO_REQUEST, StreamInfo};
use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::time::{Duration, Instant};

const WHAT: &str = "the stream";
/// Timeout of an outlet's description.
const DESCRIBE_TIMEOUT: Duration = Duration::from_secs(2);
const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);
/// A description has some kilobytes.
const DESCRIPTION_MAX: usize = 1 << 20;

/// Selection of the stream, and where to search for it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LslLineSettings {
    /// The outlet's address, if configured; discovery is skipped then.
    pub address: Option<SocketAddr>,
    /// Its name.
    pub name: Option<String>,
    /// Its type.
    pub kind: Option<String>,
    /// The device's name.
    pub source_id: Option<String>,
    /// Search the whole network, not only this computer.
    pub whole_network: bool,
}

impl LslLineSettings {
    /// The requested properties, with LSL's names.
    fn properties(&self) -> Vec<(&'static str, &str)> {
        let all = [("name", &self.name), ("type", &self.kind), ("source_id", &self.source_id)];
        all.into_iter().filter_map(|(property, value)| Some((property, value.as_deref()?))).collect()
    }

    fn matches(&self, info: &StreamInfo) -> bool {
        let same = |wanted: &Option<String>, is: &str| wanted.as_deref().is_none_or(|wanted| wanted == is);
        same(&self.name, &info.name) && same(&self.kind, &info.kind) && same(&self.source_id, &info.source_id)
    }

    /// As text: `with name "Plate"`.
    fn in_words(&self) -> String {
        let each = self.properties().into_iter().map(|(property, value)| format!("{property} {value:?}"));
        let each: Vec<String> = each.collect();
        if each.is_empty() { "of any name".to_owned() } else { format!("with {}", each.join(" and ")) }
    }
}

/// One stream.
#[derive(Debug)]
pub struct LslLine {
    settings: LslLineSettings,
    /// Addresses of discovery requests.
    discovery: Vec<SocketAddr>,
    stream: TcpLine,
    /// The description, until it was delivered.
    description: Option<Vec<u8>>,
    handed_out: Vec<u8>,
}

impl LslLine {
    /// A stream that is not open yet.
    pub fn new(settings: LslLineSettings) -> LslLine {
        let discovery = find::targets(settings.whole_network);
        LslLine::asking(settings, discovery)
    }

    /// As [`Self::new`], with these discovery addresses, for outlets on other ports than usual.
    pub fn asking(settings: LslLineSettings, discovery: Vec<SocketAddr>) -> LslLine {
        let nowhere = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let stream = TcpLine::to(settings.address.unwrap_or(nowhere), WHAT, "ground.address");
        LslLine { settings, discovery, stream, description: None, handed_out: Vec::new() }
    }

    fn describe(&self, address: SocketAddr) -> Result<(String, StreamInfo), SourceError> {
        let what = || format!("{WHAT} at {address}");
        let xml = ask(address).map_err(|error| SourceError::Absent {
            what: what(),
            remedy: "is its program running, and does nothing stand between (a firewall)?".to_owned(),
            error,
        })?;
        let unready =
            |why: String, remedy: &str| SourceError::Unready { what: what(), why, remedy: remedy.to_owned() };
        let info = StreamInfo::parse(&xml)
            .map_err(|fault| unready(fault.to_string(), "is ground.address that of an outlet of numbers?"))?;
        if !self.settings.matches(&info) {
            let why = format!("it is {:?} of type {:?}, source {:?}", info.name, info.kind, info.source_id);
            return Err(unready(why, "correct ground.address or [ground.lsl]"));
        }
        Ok((xml, info))
    }
}

/// Requests an outlet's description.
fn ask(address: SocketAddr) -> io::Result<String> {
    let mut stream = TcpStream::connect_timeout(&address, CONNECT_TIMEOUT)?;
    let until = Instant::now() + DESCRIBE_TIMEOUT;
    stream.set_write_timeout(Some(DESCRIBE_TIMEOUT))?;
    stream.write_all(FULL_INFO_REQUEST)?;
    let (mut bytes, mut piece) = (Vec::new(), [0; 4096]);
    loop {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(io::Error::new(io::ErrorKind::TimedOut, "it does not describe itself"));
        }
        stream.set_read_timeout(Some(left))?;
        match stream.read(&mut piece)? {
            0 => break,
            count => bytes.extend_from_slice(piece.get(..count).unwrap_or_default()),
        }
        if bytes.len() > DESCRIPTION_MAX || bytes.contains(&0) {
            return Err(io::Error::other("what it says of itself is no description"));
        }
    }
    String::from_utf8(bytes).map_err(|_| io::Error::other("its description is no UTF-8"))
}

impl Transport for LslLine {
    fn open(&mut self) -> Result<(), SourceError> {
        self.stream.close();
        let address = match self.settings.address {
            Some(address) => address,
            None => find::stream(&self.settings, &self.discovery)?,
        };
        let (mut xml, _) = self.describe(address)?;
        self.stream.redirect(address);
        self.stream.open()?;
        xml.push('\0');
        self.description = Some(xml.into_bytes());
        Ok(())
    }

    fn receive(&mut self) -> Result<Option<Incoming<'_>>, SourceError> {
        if let Some(description) = self.description.take() {
            self.handed_out = description;
            let arrival_ns = now_monotonic_ns();
            return Ok(Some(Incoming { bytes: &self.handed_out, arrival_ns, admitted: true }));
        }
        self.stream.receive()
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), SourceError> {
        self.stream.send(bytes)
    }
}
