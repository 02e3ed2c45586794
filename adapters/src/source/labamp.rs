//! The way to Kistler's LabAmp: it is asked over HTTP for a stream, which then comes over TCP.
//!
//! Before the stream goes one line that the device never sent there: its answer about the channels, so that whoever reads
//! the stream needs nothing else.

use super::error::SourceError;
use super::http::HttpClient;
use super::tcp_line::TcpLine;
use super::transport::{Incoming, Transport};
use crate::clock::now_monotonic_ns;
use crate::wire::labamp::talk::{self, Refused, Request};
use std::net::SocketAddr;

const WHAT: &str = "Kistler's LabAmp";
const KEY: &str = "ground.address";

/// How the device is set up before it measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LabAmpLineSettings {
    /// The device's web address.
    pub address: SocketAddr,
    /// Sampling rate, Hz; `None` leaves it as it is.
    pub rate_hz: Option<u32>,
    /// Scans in a frame; `None` leaves that to the device, which takes as few as it can.
    pub scans_per_frame: Option<u32>,
}

/// A LabAmp's stream.
#[derive(Debug)]
pub struct LabAmpLine {
    settings: LabAmpLineSettings,
    http: HttpClient,
    stream: TcpLine,
    /// What the device knows us by, to be given back.
    client: Option<String>,
    stream_id: Option<u64>,
    /// The line before the stream, until it was handed out.
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

    /// Asks, and hands the answer on to be understood.
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

    /// Gives back what the device keeps for us. It forgets by itself what it cannot be told.
    fn give_back(&mut self) {
        self.stream.close();
        let (client, stream) = (self.client.take(), self.stream_id.take());
        let Some(client) = client else { return };
        if let Some(stream) = stream
            && self.ask(&Request::close(&client, stream), talk::done).is_err()
        {
            // Not there: a second question would only take as long again.
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
        // Within 30 s, or the device closes the port.
        self.stream.redirect(SocketAddr::new(self.settings.address.ip(), port));
        self.stream.open()?;
        self.ask(&Request::start(), talk::done)?;
        // In one line, whatever lines the device made of it.
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
