//! UDP transport of an ATI device; delivers the device's settings page first.

use super::error::SourceError;
use super::http::HttpClient;
use super::transport::{Incoming, Transport};
use super::udp_line::UdpLine;
use crate::clock::now_monotonic_ns;
use crate::ground::device::ati_rdt::Page;
use crate::wire::netft_xml::PATH;
use std::io;
use std::net::SocketAddr;

/// Addresses of the device and of its page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NetFtLineSettings {
    /// Address for requests.
    pub address: SocketAddr,
    /// Port of the web pages.
    pub page_port: u16,
    /// Whether the page is indispensable.
    pub page_needed: bool,
}

/// Transport of an ATI device.
#[derive(Debug)]
pub struct NetFtLine {
    settings: NetFtLineSettings,
    key: &'static str,
    http: HttpClient,
    datagrams: UdpLine,
    /// The page, until it was delivered.
    page: Option<Vec<u8>>,
    handed_on: Vec<u8>,
}

impl NetFtLine {
    /// To a device; `key` is the configuration key of its address for errors.
    pub fn new(settings: NetFtLineSettings, key: &'static str) -> NetFtLine {
        NetFtLine {
            settings,
            key,
            http: HttpClient::new(),
            datagrams: UdpLine::to(settings.address, key),
            page: None,
            handed_on: Vec::new(),
        }
    }

    fn page(&self) -> Result<Vec<u8>, SourceError> {
        let NetFtLineSettings { address, page_port, page_needed } = self.settings;
        let url = format!("http://{}{PATH}", SocketAddr::new(address.ip(), page_port));
        let text = self.http.get(&url).and_then(|answer| match answer.status {
            200 => Ok(answer.text),
            status => Err(io::Error::other(format!("HTTP status {status}"))),
        });
        match text {
            Ok(text) => Ok(Page::to_bytes(Ok(&text))),
            Err(error) if page_needed => Err(SourceError::Absent {
                what: format!("the ATI device's settings page, {url},"),
                error,
                remedy: format!(
                    "is it on, is the cable in, and is {} right? With counts_per_newton and counts_per_newton_metre \
                     configured it goes without",
                    self.key
                ),
            }),
            Err(error) => Ok(Page::to_bytes(Err(&format!(
                "the ATI device's settings page, {url}, cannot be read: {error}"
            )))),
        }
    }
}

impl Transport for NetFtLine {
    fn open(&mut self) -> Result<(), SourceError> {
        self.datagrams.open()?;
        self.page = Some(self.page()?);
        Ok(())
    }

    fn receive(&mut self) -> Result<Option<Incoming<'_>>, SourceError> {
        if let Some(page) = self.page.take() {
            self.handed_on = page;
            let arrival_ns = now_monotonic_ns();
            return Ok(Some(Incoming { bytes: &self.handed_on, arrival_ns, admitted: true }));
        }
        self.datagrams.receive()
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), SourceError> {
        self.datagrams.send(bytes)
    }
}
