//! Bota SensONE and Rokubi with a serial line: frames with a check sum, and a short dialogue of letters for
//! configuration.
//!
//! After the makers' public examples (`readSerialFrame.m`, `bota_serial_example.py`). Little-endian.

use super::crc;

/// Length of a frame.
pub const FRAME_LEN: usize = 37;
/// Factory setting of the baud rate.
pub const BAUD: u32 = 460_800;
/// Baud rates by their number in the command `c`.
const BAUDS: [u32; 5] = [9_600, 57_600, 115_200, 230_400, 460_800];
/// Sample period at a filter length of one, s.
const SINC_S: f64 = 0.000_019_531_25;

/// One sample.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Frame {
    /// Bits: 0 too slow, 1 beyond the range, 2 invalid, 3 raw.
    pub status: u16,
    /// Fx Fy Fz (N), Mx My Mz (N m).
    pub wrench: [f32; 6],
    /// Of the device's clock, µs.
    pub timestamp_us: u32,
    /// °C.
    pub temperature_c: f32,
}

impl Frame {
    /// The 37 bytes.
    pub fn to_bytes(&self) -> [u8; FRAME_LEN] {
        let mut bytes = vec![0xaa];
        bytes.extend_from_slice(&self.status.to_le_bytes());
        bytes.extend(self.wrench.iter().flat_map(|number| number.to_le_bytes()));
        bytes.extend_from_slice(&self.timestamp_us.to_le_bytes());
        bytes.extend_from_slice(&self.temperature_c.to_le_bytes());
        bytes.extend_from_slice(&crc::x25(&bytes[1..]).to_le_bytes());
        core::array::from_fn(|index| bytes[index])
    }
}

/// State of the device, as set by the host.
#[derive(Debug, Clone, PartialEq)]
pub struct Dialogue {
    /// Frames are sent; not during configuration.
    pub running: bool,
    /// Length of the filter, which determines the rate.
    pub sinc: u32,
    /// Baud rate of the line; a new one applies when it runs again.
    pub baud: u32,
    next_baud: u32,
    line: String,
}

impl Dialogue {
    /// A device after power-on: it runs.
    pub fn new(sinc: u32) -> Dialogue {
        Dialogue { running: true, sinc, baud: BAUD, next_baud: BAUD, line: String::new() }
    }

    /// Message at power-on.
    pub const GREETING: &'static [u8] = b"App Init\r\n";

    /// Samples a second.
    pub fn rate_hz(&self) -> f64 {
        1.0 / (SINC_S * f64::from(self.sinc))
    }

    /// Processes a byte of the host; returns the answer.
    pub fn receive(&mut self, byte: u8) -> Option<String> {
        match byte {
            b'C' if self.line.is_empty() => {
                self.running = false;
                Some(acknowledged('C'))
            }
            _ if self.running => None,
            b'R' if self.line.is_empty() => {
                self.running = true;
                self.baud = self.next_baud;
                Some(acknowledged('R'))
            }
            // Commands end with their last field, a digit; additional line ends are harmless.
            b'\r' | b'\n' => None,
            _ => {
                self.line.push(char::from(byte));
                if !byte.is_ascii_digit() || self.line.matches(',').count() < 4 {
                    return None;
                }
                let line = std::mem::take(&mut self.line);
                self.execute(&line)
            }
        }
    }

    /// `c,temperature compensation,calibration,format,baud` or `f,sinc,chop,fast,fir`.
    fn execute(&mut self, line: &str) -> Option<String> {
        let words: Vec<&str> = line.split(',').collect();
        match words[..] {
            ["c", _, _, _, baud] => self.next_baud = *BAUDS.get(baud.parse::<usize>().ok()?)?,
            ["f", sinc, _, _, _] => self.sinc = sinc.parse().ok().filter(|sinc| *sinc > 0)?,
            _ => return None,
        }
        line.chars().next().map(acknowledged)
    }
}

fn acknowledged(command: char) -> String {
    format!("r,0,{command},0\r\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_set_up_and_runs_again() {
        let mut device = Dialogue::new(512);
        assert_eq!(device.rate_hz(), 100.0);
        let mut say = |text: &str| text.bytes().filter_map(|byte| device.receive(byte)).collect::<String>();
        assert_eq!(say("f,256,0,0,1\r\n"), "", "it runs, and receives nothing but C");
        assert_eq!(say("C"), "r,0,C,0\r\n");
        assert_eq!(say("c,0,1,0,2"), "r,0,c,0\r\n");
        assert_eq!(say("f,256,0,0,1\r\n"), "r,0,f,0\r\n");
        assert_eq!(say("R"), "r,0,R,0\r\n");
        assert_eq!((device.running, device.rate_hz(), device.baud), (true, 200.0, 115_200));
    }
}
