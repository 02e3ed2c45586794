//! Detection of bytes that form no frame; common to devices on serial lines.

/// Bytes of this many frames without one valid frame indicate a wrong format or speed.
const FRAMES: u64 = 20;
/// Lower bound of that limit, bytes, for short frames.
const BYTES_MIN: u64 = 512;

/// Deliveries may be late by up to this many frames, so a smaller gap does not prove a loss.
const LATE_MAX: usize = 4;

/// Count of missing frames of a device without a counter, from the bytes that formed no frame or, if a longer stretch
/// of bytes is missing, from the elapsed time. A rate of 0 means unknown.
pub(super) fn missing(skipped_bytes: usize, frame_bytes: usize, since_ns: u64, rate_hz: f64) -> usize {
    let by_bytes = (skipped_bytes + frame_bytes / 2) / frame_bytes.max(1);
    let periods = since_ns as f64 * 1e-9 * rate_hz;
    let by_time = (periods.round() as usize).saturating_sub(1);
    if by_time > by_bytes + LATE_MAX { by_time } else { by_bytes }
}

/// Counts bytes since the last frame. One valid frame resets the count.
#[derive(Debug, Clone)]
pub struct Framing {
    device: &'static str,
    usual: &'static str,
    baud: u32,
    limit: u64,
    unframed: u64,
    is_reported: bool,
}

impl Framing {
    /// For frames of this length, of a device of this name, on a line of this speed; `usual` lists its usual speeds.
    pub fn new(device: &'static str, frame_bytes: usize, baud: u32, usual: &'static str) -> Framing {
        let limit = (FRAMES * frame_bytes as u64).max(BYTES_MIN);
        Framing { device, usual, baud, limit, unframed: 0, is_reported: false }
    }

    /// The line was opened again, at this speed.
    pub fn restart(&mut self, baud: u32) {
        (self.baud, self.unframed, self.is_reported) = (baud, 0, false);
    }

    /// A frame was decoded.
    pub fn frame(&mut self) {
        (self.unframed, self.is_reported) = (0, false);
    }

    /// These bytes belong to no frame.
    pub fn skipped(&mut self, bytes: usize) {
        self.unframed = self.unframed.saturating_add(bytes as u64);
        self.is_reported |= self.is_mismatched();
    }

    /// Whether the data do not match the expected format.
    pub fn is_mismatched(&self) -> bool {
        self.unframed >= self.limit
    }

    /// The device is addressed again: restarts the count, but keeps the fault until a frame arrives.
    pub fn restart_count(&mut self) {
        self.unframed = 0;
    }

    /// The fault as text, with the remedy.
    pub fn diagnostic(&self) -> Option<String> {
        let Framing { device, usual, baud, limit, .. } = self;
        self.is_reported.then(|| {
            format!(
                "bytes come, but none of the last {limit} make a frame of {device}: is the line's speed right? It is {baud} \
                 baud, {device} usually has {usual} ([ground.serial] baud); if it is, look for another device on this \
                 port, and at the cable"
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_frames_follow_from_skipped_bytes_or_from_a_longer_time() {
        let ms = |ms: u64| ms * 1_000_000;
        assert_eq!([0, 11, 12, 24, 50].map(|bytes| missing(bytes, 24, ms(10), 100.0)), [0, 0, 1, 1, 2]);
        // One frame was damaged and the next arrives late: up to four frames of delay may be latency.
        assert_eq!([50, 60, 70, 500].map(|late| missing(24, 24, ms(late), 100.0)), [1, 1, 6, 49]);
        assert_eq!(missing(24, 24, ms(70_000), 0.0), 1);
    }

    #[test]
    fn bytes_without_any_frame_are_reported_until_a_frame_arrives() {
        let mut framing = Framing::new("a plate", 24, 9600, "57600");
        for _ in 0..1000 {
            framing.skipped(23);
            framing.frame();
        }
        assert_eq!(framing.diagnostic(), None);
        framing.skipped(511);
        assert_eq!(framing.diagnostic(), None);
        framing.skipped(1);
        let diagnostic = framing.diagnostic().unwrap();
        assert!(diagnostic.contains("none of the last 512 make a frame of a plate"), "{diagnostic}");
        assert!(diagnostic.contains("It is 9600 baud, a plate usually has 57600"), "{diagnostic}");
        framing.restart_count();
        assert!(framing.diagnostic().is_some() && !framing.is_mismatched());
        framing.frame();
        assert_eq!(framing.diagnostic(), None);
    }
}
