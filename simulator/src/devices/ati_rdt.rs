//! An ATI sensor under a plate: RDT over UDP, its page over HTTP.

use std::io;
use std::net::SocketAddr;

use super::http::HttpPort;
use super::load::{LoadSample, Mounting};
use super::port::Port as _;
use super::{Device, FaultCounts, HostRequests};
use crate::faults::Faults;
use crate::plate_server::{PlateServer, Request};
use crate::wires::ati_rdt::{Family, Page};

/// Newtons per pound-force.
const NEWTONS: f64 = 4.448_221_615_260_5;
/// Metres per inch.
const METRES: f64 = 0.0254;

/// The device.
pub struct AtiRdt {
    mounting: Mounting,
    family: Family,
    rate_hz: f64,
    server: PlateServer,
    page: HttpPort,
    pounds: bool,
}

impl AtiRdt {
    /// A device at an address (port 0: any free one), its page at another.
    ///
    /// # Errors
    /// Those of the sockets.
    pub fn bind(
        address: SocketAddr,
        page: SocketAddr,
        mounting: Mounting,
        family: Family,
        rate_hz: f64,
        seed: u64,
    ) -> io::Result<AtiRdt> {
        let server = PlateServer::bind(address, Faults::default(), seed)?.of_family(family);
        Ok(AtiRdt { mounting, family, rate_hz, server, page: HttpPort::bind(page)?, pounds: false })
    }

    /// Sets the units to pounds and inches; the page reports the scale of the counts in them.
    #[must_use]
    pub fn in_pounds(self) -> AtiRdt {
        AtiRdt { pounds: true, ..self }
    }

    fn page_text(&self) -> String {
        let [newton, newton_metre] = self.mounting.plate.counts_per_unit;
        let (counts_per_unit, units) = match self.pounds {
            false => ([newton, newton_metre], ["N", "N-m"]),
            true => ([newton * NEWTONS, newton_metre * NEWTONS * METRES], ["lbf", "lbf-in"]),
        };
        Page {
            counts_per_unit,
            units: units.map(str::to_owned),
            rdt_enabled: true,
            rate_hz: self.rate_hz as u32,
            block: 10,
        }
        .to_xml()
    }
}

impl Device for AtiRdt {
    fn poll(&mut self, _device_now_s: f64) -> io::Result<HostRequests> {
        if let Some(request) = self.page.request()? {
            let text = self.page_text();
            match request.path.as_str() {
                "/netftapi2.xml" => self.page.answer("200 OK", "text/xml", &text)?,
                _ => self.page.answer("404 Not Found", "text/plain", "")?,
            }
        }
        let request = self.server.poll();
        Ok(HostRequests { zero: request == Some(Request::SetBias) })
    }

    fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    fn measure(&mut self, sample: &LoadSample) -> io::Result<()> {
        let Some(wrench) = sample.plates.first() else { return Ok(()) };
        self.server.send(self.mounting.plate.record(wrench, sample.number, 0))
    }

    fn fault_counts(&self) -> FaultCounts {
        self.server.fault_counts()
    }

    fn set_faults(&mut self, faults: Faults) {
        self.server.set_faults(faults);
    }

    fn unplug(&mut self) {
        self.server.unplug();
        self.page.port().unplug();
    }

    fn plug(&mut self) -> io::Result<()> {
        self.server.plug()?;
        self.page.port().plug()
    }

    fn config(&self) -> String {
        let address = format!("address = \"{}\"\n", self.server.address());
        let model = match self.family {
            Family::NetFt => "net-ft",
            Family::Axia => "axia",
        };
        format!(
            "{}[ground.ati]\nmodel = \"{model}\"\npage_port = {}\n",
            self.mounting.config("ati-rdt", [address, String::new()]),
            self.page.address().port(),
        )
    }
}
