//! Transport of Kistler's LabAmp: requests a stream over HTTP, and receives it over TCP.
//!
//! A line that is not part of the device's stream precedes it: the device's description of its channels, so that the
//! decoder needs no other source.

use super::error::SourceError;
use super::http::HttpClient;
use super::tcp_line::TcpLine;
use super::transport::{Incoming, Transport};
use crate::clock::now_monotonic_ns;
use crate::wire::labamp::talk::{self, Refused, Request};
use std::net::SocketAddr;

const WHAT: &str = "Kistler's LabAmp";
const KEY: &str = "ground.address";

/// Settings applied to the device before the measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LabAmpLineSettings {
    /// The device's web address.
    pub address: SocketAddr,
    /// Sampling rate, Hz; `None` leaves it unchanged.
    pub rate_hz: Option<u32>,
    /// Scans in a frame; `None` leaves the choice to the device, which uses the minimum.
    pub scans_per_frame: Option<u32>,
}

/// A LabAmp's stream.
#[derive(Debug)]
pub struct LabAmpLine {
    settings: LabAmpLineSettings,
    http: HttpClient,
    stream: TcpLine,
    /// Client identifier that the device assigned, to be released.
    client: Option<String>,
    stream_id: Option<u64>,
    /// The line before the stream, until it was delivered.
    line: Option<Vec<u8>>,
    handed_out: Vec<u8>,
}

impl LabAmpLine {
    /// A stream that is not open yet.
    pub fn new(settings: LabAmpLineSettings) -> LabAmpLine {
        LabAmpLine {
            settings,
            http: HttpClient::new(),
            stream: TcpLine::to(settings.address, WHAT, KEY),
            client: None,
            stream_id: None,
            line: None,
            handed_out: Vec::new(),
        }
    }

    /// Sends a request and parses the answer.
    fn ask<T>(
        &self,
        request: &Request,
        read: impl FnOnce(&str) -> Result<T, Refused>,
    ) -> Result<T, SourceError> {
        let url = format!("http://{}{}", self.settings.address, request.path);
        let what = || format!("{WHAT} at {}", self.settings.address);
        let answer = self.http.post_json(&url, &request.body).map_err(|error| SourceError::Absent {
            what: what(),
            remedy: format!("is it on, is the cable in, and is {KEY} right?"),
            error,
        })?;
        read(&answer.text).map_err(|refused| SourceError::Unready {
            what: what(),
            why: format!("{} (HTTP {}): {refused}", request.path, answer.status),
            remedy: "look at its own web page; it is asked again and again".to_owned(),
        })
    }

    /// Releases the device's resources. If the device is unreachable, they expire there.
    fn give_back(&mut self) {
        self.stream.close();
        let (client, stream) = (self.client.take(), self.stream_id.take());
        let Some(client) = client else { return };
        if let Some(stream) = stream
            && self.ask(&Request::close(&client, stream), talk::done).is_err()
        {
            // The device is absent: a second request would only add another timeout.
            return;
        }
        let _forgotten_after_an_hour = self.ask(&Request::unregister(&client), talk::done);
    }

    fn talk(&mut self) -> Result<(), SourceError> {
        self.ask(&Request::disable(), talk::done)?;
        if let Some(rate_hz) = self.settings.rate_hz {
            self.ask(&Request::set_rate(rate_hz), talk::done)?;
        }
        self.ask(&Request::configure(), talk::done)?;
        let channels = self.ask(&Request::metadata(), talk::done)?;
        let client = self.ask(&Request::register(), talk::client)?;
        self.client = Some(client.clone());
        let open = Request::open(&client, self.settings.scans_per_frame);
        let (port, stream_id) = self.ask(&open, talk::stream)?;
        self.stream_id = Some(stream_id);
        // The device closes the port if no connection arrives within 30 s.
        self.stream.redirect(SocketAddr::new(self.settings.address.ip(), port));
        self.stream.open()?;
        self.ask(&Request::start(), talk::done)?;
        // Serialised to one line, regardless of the device's line breaks.
        self.line = Some((channels.to_string() + "\n").into_bytes());
        Ok(())
    }
}

impl Transport for LabAmpLine {
    fn open(&mut self) -> Result<(), SourceError> {
        self.give_back();
        self.line = None;
        self.talk()
    }

    fn receive(&mut self) -> Result<Option<Incoming<'_>>, SourceError> {
        if let Some(line) = self.line.take() {
            self.handed_out = line;
            let arrival_ns = now_monotonic_ns();
            return Ok(Some(Incoming { bytes: &self.handed_out, arrival_ns, admitted: true }));
        }
        self.stream.receive()
    }

    fn send(&mut self, _bytes: &[u8]) -> Result<(), SourceError> {
        Err(SourceError::Unusable(format!("{KEY}: {WHAT} is not spoken to on its stream")))
    }
}

impl Drop for LabAmpLine {
    fn drop(&mut self) {
        self.give_back();
    }
}
