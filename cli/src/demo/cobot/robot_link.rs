//! The demonstration's RTDE client: reads the position of the part, and writes the registers of docs/cobot.md.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use anyhow::{Context, bail};
use equipoise_simulator::cobot::arm::{JOINTS, Joints};
use equipoise_simulator::cobot::program::Inputs;
use equipoise_simulator::cobot::rtde::package;
use nalgebra::Vector3;

/// Time limit of the connection and of each answer.
const TIMEOUT: Duration = Duration::from_secs(2);
/// Requested rate of the outputs, Hz.
const OUTPUT_HZ: f64 = 125.0;
const OUTPUTS: &str =
    "actual_q,output_double_register_36,output_double_register_37,output_double_register_38";
const INPUTS: &str = "input_int_register_36,input_int_register_37,input_double_register_36,input_double_register_37,\
                      input_double_register_38,input_double_register_39,input_double_register_40";
/// Length of a header, and of the data of [`OUTPUTS`] behind the recipe's number, bytes.
const HEADER_BYTES: usize = 3;
const OUTPUT_BYTES: usize = (JOINTS + 3) * 8;

/// What the robot reports.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reading {
    /// Joint angles, rad.
    pub(super) q_rad: Joints,
    /// Position of the part, station's world, m.
    pub(super) part_m: Vector3<f64>,
}

/// A started exchange.
#[derive(Debug)]
pub(super) struct RobotLink {
    stream: TcpStream,
    recipe: u8,
    received: Vec<u8>,
    newest: Option<Reading>,
}

impl RobotLink {
    /// Connects, negotiates the registers and starts the exchange.
    pub(super) fn connect(robot: SocketAddr) -> anyhow::Result<RobotLink> {
        let stream = TcpStream::connect_timeout(&robot, TIMEOUT)
            .with_context(|| format!("the simulated cobot at {robot}"))?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(TIMEOUT))?;
        let mut link = RobotLink { stream, recipe: 0, received: Vec::new(), newest: None };
        let outputs = [&OUTPUT_HZ.to_be_bytes()[..], OUTPUTS.as_bytes()].concat();
        for (kind, payload) in
            [(b'V', &2_u16.to_be_bytes()[..]), (b'O', &outputs), (b'I', INPUTS.as_bytes()), (b'S', &[])]
        {
            let answer = link.ask(kind, payload)?;
            match (kind, answer.first()) {
                (_, None | Some(0)) => bail!("the simulated cobot refuses RTDE's {:?}", char::from(kind)),
                (b'I', Some(recipe)) => link.recipe = *recipe,
                _ => {}
            }
        }
        link.stream.set_nonblocking(true)?;
        Ok(link)
    }

    /// Sends a request and waits for its answer.
    fn ask(&mut self, kind: u8, payload: &[u8]) -> anyhow::Result<Vec<u8>> {
        self.stream.write_all(&package(kind, payload))?;
        let mut bytes = [0; 512];
        loop {
            while let Some((found, payload)) = self.take() {
                if found == kind {
                    return Ok(payload);
                }
            }
            let count = self.stream.read(&mut bytes).context("no answer of the simulated cobot")?;
            if count == 0 {
                bail!("the simulated cobot closed the connection");
            }
            self.received.extend(&bytes[..count]);
        }
    }

    /// Removes the first complete package: its type and payload.
    fn take(&mut self) -> Option<(u8, Vec<u8>)> {
        let size = usize::from(u16::from_be_bytes([*self.received.first()?, *self.received.get(1)?]));
        let size = size.max(HEADER_BYTES);
        if self.received.len() < size {
            return None;
        }
        let package: Vec<u8> = self.received.drain(..size).collect();
        Some((package[2], package[HEADER_BYTES..].to_vec()))
    }

    /// The newest reading so far.
    pub(super) fn newest(&self) -> Option<Reading> {
        self.newest
    }

    /// Reads what the robot has sent. Returns the newest reading; `None` before the first.
    pub(super) fn poll(&mut self) -> anyhow::Result<Option<Reading>> {
        let mut bytes = [0; 4096];
        loop {
            match self.stream.read(&mut bytes) {
                Ok(0) => bail!("the simulated cobot closed the connection"),
                Ok(count) => self.received.extend(&bytes[..count]),
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) => return Err(error).context("the simulated cobot"),
            }
        }
        while let Some((kind, payload)) = self.take() {
            if kind == b'U' && payload.len() == 1 + OUTPUT_BYTES {
                let numbers = payload[1..].chunks_exact(8);
                let mut values =
                    numbers.map(|eight| f64::from_be_bytes(eight.try_into().unwrap_or_default()));
                self.newest = Some(Reading {
                    q_rad: Joints::from_iterator(values.by_ref().take(JOINTS)),
                    part_m: Vector3::from_iterator(values),
                });
            }
        }
        Ok(self.newest)
    }

    /// Writes the registers.
    pub(super) fn send(&mut self, inputs: &Inputs) -> anyhow::Result<()> {
        let mut payload = vec![self.recipe];
        payload.extend(inputs.command.to_be_bytes());
        payload.extend(inputs.sequence.to_be_bytes());
        let turned_rad = [inputs.slope_rad, inputs.heading_rad];
        payload.extend(inputs.target_m.iter().chain(&turned_rad).flat_map(|value| value.to_be_bytes()));
        // Packages of 52 bytes, at most 125 a second: the socket's buffer is never full while the server reads.
        self.stream.write_all(&package(b'U', &payload)).context("the simulated cobot")
    }
}

#[cfg(test)]
mod tests {
    use std::net::{Ipv4Addr, SocketAddr};
    use std::time::Instant;

    use equipoise_simulator::cobot::arm::forward;
    use equipoise_simulator::cobot::program::CobotSettings;
    use equipoise_simulator::cobot::server::Cobot;
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn the_arm_moves_by_the_registers_and_reports_where_it_is() {
        let settings = CobotSettings::default();
        let cobot = Cobot::start(settings, SocketAddr::from((Ipv4Addr::LOCALHOST, 0))).unwrap();
        let mut link = RobotLink::connect(cobot.address()).unwrap();
        let target_m = settings.retreat_m + Vector3::new(-0.05, 0.0, 0.0);
        let mut inputs = Inputs { command: 1, target_m: target_m.into(), ..Inputs::default() };
        let begun = Instant::now();
        loop {
            inputs.sequence += 1;
            link.send(&inputs).unwrap();
            let reading = link.poll().unwrap();
            if let Some(Reading { q_rad, .. }) =
                reading.filter(|reading| (reading.part_m - target_m).norm() < 0.001)
            {
                let tcp_m = settings.world_from_base * Point3::from(forward(&q_rad).translation.vector);
                assert!((tcp_m.coords - target_m).norm() < 0.002, "{tcp_m}");
                break;
            }
            assert!(begun.elapsed() < Duration::from_secs(60), "{reading:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
        cobot.stop().unwrap();
    }
}
