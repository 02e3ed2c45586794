//! The mean of so many scans as one reading, and what is missing between frames.

use crate::ground::reading::Taken;

/// Gaps beyond this are a clock that was set, or a pause: nobody can say what is missing, s.
const GAP_MAX_S: f64 = 60.0;

/// The mean of some scans.
#[derive(Debug, PartialEq)]
pub(super) struct Mean<'a> {
    /// The middle of their time, ns.
    pub(super) time_ns: u64,
    /// One number a channel.
    pub(super) values: &'a [f64],
}

/// Makes one reading of so many scans.
#[derive(Debug, Clone)]
pub(super) struct Decimator {
    decimate: u32,
    period_ns: f64,
    sums: Vec<f64>,
    mean: Vec<f64>,
    scans: u32,
    /// Of the first scan in `sums`.
    since_ns: u64,
    /// When the next scan is due; `None` before the first frame.
    next_ns: Option<f64>,
    /// Frames that did not come before the present one, as far as anybody knows: none, and then nothing is missing.
    missing_frames: u32,
    /// The scan in work, counted from the frame's first, and that one's time.
    index: u32,
    frame_ns: u64,
    frame_scans: u32,
}

impl Decimator {
    pub(super) fn new(channels: usize, decimate: u32, rate_hz: f64) -> Decimator {
        Decimator {
            decimate,
            period_ns: 1e9 / rate_hz,
            sums: vec![0.0; channels],
            mean: vec![0.0; channels],
            scans: 0,
            since_ns: 0,
            next_ns: None,
            missing_frames: 0,
            index: 0,
            frame_ns: 0,
            frame_scans: 0,
        }
    }

    /// So many frames are missing before the next.
    pub(super) fn missing_frames(&mut self, frames: u32) {
        self.missing_frames = self.missing_frames.saturating_add(frames);
    }

    /// A frame begins: what is missing before it is told, and half a mean is none.
    pub(super) fn frame(&mut self, time_ns: u64, scans: usize, taken: &mut Taken) {
        let missing_frames = core::mem::take(&mut self.missing_frames);
        if let Some(next_ns) = self.next_ns {
            let late_ns = time_ns as f64 - next_ns;
            let late_scans = (late_ns / self.period_ns).round();
            // A device that adjusts its clock bit by bit moves less than a scan.
            if late_scans != 0.0 {
                let credible = late_ns > 0.0 && late_ns < GAP_MAX_S * 1e9;
                let missing = match (missing_frames, credible) {
                    // No frame is missing, so no scan is: the clock was set.
                    (0, _) => 0.0,
                    (_, true) => late_scans,
                    (frames, false) => f64::from(frames) * f64::from(self.frame_scans),
                };
                let readings = (f64::from(self.scans) + missing) / f64::from(self.decimate);
                self.clear();
                if missing > 0.0 {
                    taken.lost(readings.round() as u32);
                }
            }
        }
        self.frame_ns = time_ns;
        self.frame_scans = u32::try_from(scans).unwrap_or(u32::MAX);
        self.index = 0;
        self.next_ns = Some(time_ns as f64 + scans as f64 * self.period_ns);
    }

    /// The next scan of the frame; a mean whenever it is full.
    pub(super) fn scan(&mut self, numbers: &mut impl Iterator<Item = f32>) -> Option<Mean<'_>> {
        if self.scans == 0 {
            self.since_ns = self.frame_ns.saturating_add((f64::from(self.index) * self.period_ns) as u64);
        }
        self.index += 1;
        for sum in &mut self.sums {
            *sum += numbers.next().map_or(f64::NAN, f64::from);
        }
        self.scans += 1;
        if self.scans < self.decimate {
            return None;
        }
        for (mean, sum) in self.mean.iter_mut().zip(&self.sums) {
            *mean = sum / f64::from(self.decimate);
        }
        let middle_ns = f64::from(self.decimate - 1) / 2.0 * self.period_ns;
        let time_ns = self.since_ns.saturating_add(middle_ns as u64);
        self.clear();
        Some(Mean { time_ns, values: &self.mean })
    }

    fn clear(&mut self) {
        self.sums.fill(0.0);
        self.scans = 0;
    }
}
