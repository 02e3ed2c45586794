//! Bytes that come and make no frame: what several devices on serial lines have to say about that.

/// So many frames' worth of bytes without one frame are no accident.
const FRAMES: u64 = 20;
/// Short frames prove little: at least so many bytes.
const BYTES_MIN: u64 = 512;

/// Deliveries may come late by so many frames: less tells nothing of loss.
const LATE_MAX: usize = 4;

/// How many frames are missing where so many bytes made none, of a device that counts nothing: the room they left tells, or,
/// if more than a stretch of bytes is gone, the time they took. A rate of 0 is one that is not known.
pub(super) fn missing(passed_bytes: usize, frame_bytes: usize, since_ns: u64, rate_hz: f64) -> usize {
    let by_room = (passed_bytes + frame_bytes / 2) / frame_bytes.max(1);
    let periods = since_ns as f64 * 1e-9 * rate_hz;
    let by_time = (periods.round() as usize).saturating_sub(1);
    if by_time > by_room + LATE_MAX { by_time } else { by_room }
}

/// Counts bytes since the last frame. One sound frame ends the suspicion.
#[derive(Debug, Clone)]
pub struct Framing {
    device: &'static str,
    usual: &'static str,
    baud: u32,
    limit: u64,
    unframed: u64,
    named: bool,
}

impl Framing {
    /// For frames of so many bytes of a device, called by its name, on a line of this speed; `usual` names its usual
    /// speeds.
    pub fn new(device: &'static str, frame_bytes: usize, baud: u32, usual: &'static str) -> Framing {
        let limit = (FRAMES * frame_bytes as u64).max(BYTES_MIN);
        Framing { device, usual, baud, limit, unframed: 0, named: false }
    }

    /// The line was opened anew, at this speed.
    pub fn restart(&mut self, baud: u32) {
        (self.baud, self.unframed, self.named) = (baud, 0, false);
    }

    /// A frame was read.
    pub fn frame(&mut self) {
        (self.unframed, self.named) = (0, false);
    }

    /// So many bytes made none.
    pub fn passed(&mut self, bytes: usize) {
        self.unframed = self.unframed.saturating_add(bytes as u64);
        self.named |= self.is_hopeless();
    }

    /// Whether nothing that comes is what should come.
    pub fn is_hopeless(&self) -> bool {
        self.unframed >= self.limit
    }

    /// The device is spoken to once more; until a frame comes, the trouble is the same.
    pub fn hope_again(&mut self) {
        self.unframed = 0;
    }

    /// The same in words, with what to do.
    pub fn trouble(&self) -> Option<String> {
        let Framing { device, usual, baud, limit, .. } = self;
        self.named.then(|| {
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
    fn what_is_missing_shows_in_the_room_and_beyond_some_frames_in_the_time() {
        let ms = |ms: u64| ms * 1_000_000;
        assert_eq!([0, 11, 12, 24, 50].map(|bytes| missing(bytes, 24, ms(10), 100.0)), [0, 0, 1, 1, 2]);
        // One was damaged, and the next comes late: up to four frames more that may be the way's delay.
        assert_eq!([50, 60, 70, 500].map(|late| missing(24, 24, ms(late), 100.0)), [1, 1, 6, 49]);
        assert_eq!(missing(24, 24, ms(70_000), 0.0), 1);
    }

    #[test]
    fn noise_between_frames_is_none_and_noise_alone_is_named_until_a_frame_comes() {
        let mut framing = Framing::new("a plate", 24, 9600, "57600");
        for _ in 0..1000 {
            framing.passed(23);
            framing.frame();
        }
        assert_eq!(framing.trouble(), None);
        framing.passed(511);
        assert_eq!(framing.trouble(), None);
        framing.passed(1);
        let said = framing.trouble().unwrap();
        assert!(said.contains("none of the last 512 make a frame of a plate"), "{said}");
        assert!(said.contains("It is 9600 baud, a plate usually has 57600"), "{said}");
        framing.hope_again();
        assert!(framing.trouble().is_some() && !framing.is_hopeless());
        framing.frame();
        assert_eq!(framing.trouble(), None);
    }
}
