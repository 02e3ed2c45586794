//! A Kistler LabAmp with a plate of eight channels: configured over HTTP, streaming over a TCP port that it opens on
//! request.

use std::io;
use std::net::SocketAddr;
use std::time::{SystemTime, UNIX_EPOCH};

use super::http::HttpPort;
use super::line::Line;
use super::load::{LoadSample, Mounting};
use super::port::Port as _;
use super::tcp::TcpPort;
use super::{Connected, HostRequests, Protocol};
use crate::wires::labamp::{self, Action, EightChannels, Signal};

/// Unit of its eight channels, force.
const UNIT: &str = "N";

/// The amplifier.
pub struct LabAmp {
    http: HttpPort,
    stream_port: u16,
    mounting: Mounting,
    channels: EightChannels,
    rate_hz: f64,
    scans_of_a_frame: usize,
    measuring: bool,
    opened: u32,
    sequence: u32,
    scans: Vec<Vec<f32>>,
    /// Device time of the first pending scan, s.
    first_s: f64,
    /// Unix time at device time zero, s.
    unix_s: f64,
}

impl LabAmp {
    /// An amplifier at an address; its stream's port is any free one.
    ///
    /// # Errors
    /// Those of the sockets.
    pub fn bind(
        address: SocketAddr,
        mounting: Mounting,
        rate_hz: f64,
        seed: u64,
    ) -> io::Result<Connected<LabAmp>> {
        let stream = TcpPort::bind(SocketAddr::new(address.ip(), 0))?;
        let stream_port = stream.address().port();
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).map_err(io::Error::other)?;
        let amplifier = LabAmp {
            http: HttpPort::bind(address)?,
            stream_port,
            mounting,
            channels: EightChannels { half_m: [0.12, 0.2] },
            rate_hz,
            scans_of_a_frame: labamp::fewest_scans(rate_hz) as usize,
            measuring: false,
            opened: 0,
            sequence: 0,
            scans: Vec::new(),
            first_s: 0.0,
            unix_s: since_1970.as_secs_f64(),
        };
        Ok(Connected::new(amplifier, Line::new(Box::new(stream), seed)))
    }

    fn signals() -> Vec<Signal> {
        EightChannels::NAMES.map(|name| Signal { name: name.into(), unit: UNIT.into() }).into()
    }

    fn execute(&mut self, stream: &mut Line, action: Action) -> io::Result<Option<String>> {
        match action {
            Action::Open(scans) => {
                self.scans_of_a_frame = scans.unwrap_or(labamp::fewest_scans(self.rate_hz)) as usize;
                self.opened += 1;
                self.sequence = 0;
                self.scans.clear();
                return Ok(Some(labamp::opened(self.stream_port, self.opened)));
            }
            Action::Rate(rate_hz) => {
                self.rate_hz = f64::from(rate_hz.max(1));
                self.scans_of_a_frame = labamp::fewest_scans(self.rate_hz) as usize;
            }
            Action::Start => self.measuring = true,
            Action::Stop => self.end(stream, labamp::Event::Stopped)?,
            Action::Close => self.end(stream, labamp::Event::Closed)?,
            Action::Nothing => {}
        }
        Ok(None)
    }

    /// Number of scans with the same values: a body hardly changes within a millisecond, and 200 000 evaluations a
    /// second would take too long.
    fn repeated(&self) -> f64 {
        (self.rate_hz / 2500.0).ceil()
    }

    fn end(&mut self, stream: &mut Line, event: labamp::Event) -> io::Result<()> {
        self.measuring = false;
        let bytes = labamp::event(self.sequence, 2, event);
        self.sequence += 1;
        stream.answer(&bytes)
    }

    fn send_frame(&mut self, stream: &mut Line) -> io::Result<()> {
        let unix_s = self.unix_s + self.first_s;
        let unix = (unix_s as u64, (unix_s.fract() * 1e9) as u32);
        let bytes = labamp::data(self.sequence, unix, &self.scans);
        self.sequence += 1;
        let samples = self.scans.len() as u32;
        self.first_s += f64::from(samples) / self.rate_hz;
        self.scans.clear();
        stream.send(&bytes, samples)
    }
}

impl Protocol for LabAmp {
    fn receive(
        &mut self,
        stream: &mut Line,
        received: &mut Vec<u8>,
        _device_now_s: f64,
    ) -> io::Result<HostRequests> {
        if let Some(request) = self.http.request()? {
            match labamp::answer(&request.path, &request.body, &LabAmp::signals(), self.rate_hz) {
                Some((answer, action)) => {
                    let answer = self.execute(stream, action)?.unwrap_or(answer);
                    self.http.answer("200 OK", "application/json", &answer)?;
                }
                None => self.http.answer("404 Not Found", "text/plain", "Error occured")?,
            }
        }
        // The stream has no requests.
        received.clear();
        Ok(HostRequests::default())
    }

    fn rate_hz(&self) -> f64 {
        self.rate_hz / self.repeated()
    }

    fn measure(&mut self, stream: &mut Line, sample: &LoadSample) -> io::Result<()> {
        let Some(wrench) = sample.plates.first().filter(|_| self.measuring && stream.is_open()) else {
            self.scans.clear();
            return Ok(());
        };
        if self.scans.is_empty() {
            self.first_s = sample.device_s;
        }
        let forces = self.channels.forces_n(wrench.components());
        let scan: Vec<f32> = forces.iter().map(|newtons| *newtons as f32).collect();
        for _ in 0..self.repeated() as u32 {
            self.scans.push(scan.clone());
            if self.scans.len() >= self.scans_of_a_frame {
                self.send_frame(stream)?;
            }
        }
        Ok(())
    }

    fn power(&mut self, _stream: &mut Line, on: bool) -> io::Result<()> {
        self.measuring = false;
        self.scans.clear();
        if on {
            return self.http.port().plug();
        }
        self.http.port().unplug();
        Ok(())
    }

    fn config(&self, _stream: &Line) -> String {
        let [a, b] = self.channels.half_m;
        let names: String =
            EightChannels::NAMES.iter().map(|name| format!("{name} = \"{name}\"\n")).collect();
        format!(
            "{}[ground.labamp]\nrate_hz = {}\n\n[ground.labamp.eight]\n{names}a_m = {a:?}\nb_m = {b:?}\n",
            self.mounting.config("kistler-labamp", self.http.config()),
            self.rate_hz,
        )
    }
}
