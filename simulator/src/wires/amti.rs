//! AMTI plates with a serial line (AccuSway, AccuGait): single bytes for negotiation, then frames of twelve tagged
//! words.
//!
//! After the public receiver `App-AMTIForcePlate` of the Lab Streaming Layer project. Assumed here without a source: a
//! stop resets the device to its initial rate, and so does a power cycle.

/// Baud rate after power-on.
pub const FIRST_BAUD: u32 = 57_600;
/// Baud rate at 100 and 200 Hz.
pub const FAST_BAUD: u32 = 115_200;
/// Length of a plate's frame.
pub const FRAME_LEN: usize = 24;

const STOP: u8 = 0x52;
const AUTO_ZERO: u8 = 0x53;
const START: u8 = 0x51;
/// Rates: the byte that requests it (and is echoed), samples a second, baud rate from then on.
const RATES: [(u8, f64, u32); 3] =
    [(0x72, 50.0, FIRST_BAUD), (0x66, 100.0, FAST_BAUD), (0x76, 200.0, FAST_BAUD)];

/// State of the device, as set by the host.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dialogue {
    /// One or two plates at the box.
    pub plates: u8,
    /// Whether frames are sent.
    pub streaming: bool,
    /// Samples a second.
    pub rate_hz: f64,
    /// Baud rate of the line.
    pub baud: u32,
    /// Number of zeroings.
    pub zeroed: u32,
}

impl Dialogue {
    /// A box after power-on.
    pub fn new(plates: u8) -> Dialogue {
        Dialogue { plates, streaming: false, rate_hz: 50.0, baud: FIRST_BAUD, zeroed: 0 }
    }

    /// Processes one byte of the host; returns the answer and its baud rate: an echo goes out at the old one.
    pub fn receive(&mut self, byte: u8) -> Option<u8> {
        let second = u8::from(self.plates == 2);
        match byte {
            STOP => {
                self.streaming = false;
                self.baud = FIRST_BAUD;
                None
            }
            // Start and zeroing are ignored while the device is streaming.
            _ if self.streaming => None,
            AUTO_ZERO => {
                self.zeroed += 1;
                Some(if second == 1 { 0x64 } else { 0x54 })
            }
            START => {
                self.streaming = true;
                Some(0x55 + second)
            }
            _ => {
                let (_, rate_hz, baud) = *RATES.iter().find(|(asked, ..)| *asked == byte)?;
                (self.rate_hz, self.baud) = (rate_hz, baud);
                Some(byte)
            }
        }
    }
}

/// One plate's frame: twelve little-endian words of 12 bits (2048 is zero) under a tag that counts 0 to 11; the first
/// tag is 15 while the trigger input is active. Beyond the range a converter saturates.
pub fn frame(counts: [i16; 12], trigger: bool) -> [u8; FRAME_LEN] {
    let mut bytes = [0; FRAME_LEN];
    for ((place, count), number) in bytes.chunks_exact_mut(2).zip(counts).zip(0_u16..) {
        let tag = if number == 0 && trigger { 15 } else { number };
        let value = (count.clamp(-2048, 2047) + 2048) as u16;
        place.copy_from_slice(&(tag << 12 | value).to_le_bytes());
    }
    bytes
}

/// Four corners, each with three gauges: the scale of a count, and the positions of the corners.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gauges {
    /// Newtons of a count across and along the vertical.
    pub newtons_per_count: [f64; 2],
    /// Half the distance of the corners along X and Y, m.
    pub half_m: [f64; 2],
}

/// Signs of the corners' coordinates.
const CORNERS: [[f64; 2]; 4] = [[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]];

impl Gauges {
    /// An ordinary plate: with the sensitivity of the published matrix.
    pub const ORDINARY: Gauges = Gauges { newtons_per_count: [0.039, 0.39], half_m: [0.18, 0.18] };

    /// The calibration matrix, rows Fx Fy Fz Mx My Mz in N and N m, columns the twelve channels.
    pub fn matrix(&self) -> [[f64; 12]; 6] {
        let ([across, along], [half_x, half_y]) = (self.newtons_per_count, self.half_m);
        let mut matrix = [[0.0; 12]; 6];
        for (corner, [sx, sy]) in CORNERS.into_iter().enumerate() {
            let (x, y, z) = (3 * corner, 3 * corner + 1, 3 * corner + 2);
            matrix[0][x] = across;
            matrix[1][y] = across;
            matrix[2][z] = along;
            matrix[3][z] = along * sy * half_y;
            matrix[4][z] = -along * sx * half_x;
            matrix[5][x] = -across * sy * half_y;
            matrix[5][y] = across * sx * half_x;
        }
        matrix
    }

    /// The counts for a wrench (N, N m) by the matrix, rounded to whole counts.
    pub fn counts(&self, [fx, fy, fz, mx, my, mz]: [f64; 6]) -> [i16; 12] {
        let ([across, along], [half_x, half_y]) = (self.newtons_per_count, self.half_m);
        let turning = mz / (4.0 * (half_x * half_x + half_y * half_y));
        let mut counts = [0; 12];
        for (corner, [sx, sy]) in CORNERS.into_iter().enumerate() {
            let x_n = fx / 4.0 - turning * sy * half_y;
            let y_n = fy / 4.0 + turning * sx * half_x;
            let z_n = (fz + sy * mx / half_y - sx * my / half_x) / 4.0;
            let gauge = [x_n / across, y_n / across, z_n / along].map(|count| count.round() as i16);
            counts[3 * corner..3 * corner + 3].copy_from_slice(&gauge);
        }
        counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dialogue_goes_as_the_public_receiver_has_it() {
        let mut plate = Dialogue::new(1);
        assert_eq!(plate.receive(0x52), None);
        assert_eq!(plate.receive(0x66), Some(0x66));
        assert_eq!((plate.baud, plate.rate_hz), (115_200, 100.0));
        assert_eq!(plate.receive(0x53), Some(0x54));
        assert_eq!(plate.receive(0x51), Some(0x55));
        assert!(plate.streaming && plate.receive(0x76).is_none());
        plate.receive(0x52);
        assert!(!plate.streaming && plate.baud == FIRST_BAUD);
        let mut two = Dialogue::new(2);
        assert_eq!([0x53, 0x51].map(|byte| two.receive(byte)), [Some(0x64), Some(0x56)]);
    }

    #[test]
    fn counts_and_matrix_undo_each_other() {
        let gauges = Gauges::ORDINARY;
        let wrench = [-31.0, 12.0, 702.0, 41.0, -28.0, 6.0];
        let counts = gauges.counts(wrench);
        let reported: Vec<f64> = gauges
            .matrix()
            .iter()
            .map(|row| row.iter().zip(counts).map(|(part, count)| part * f64::from(count)).sum())
            .collect();
        for (reported, meant) in reported.iter().zip(wrench) {
            // Half a count at each of four gauges.
            assert!((reported - meant).abs() <= 4.0 * 0.5 * 0.39, "{reported} {meant}");
        }
        assert!(counts.iter().all(|count| count.abs() < 2048));
    }
}
