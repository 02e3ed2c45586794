//! Averages scans to readings, and counts scans missing between frames.

use crate::ground::reading::Decoded;

/// A longer gap is a clock step or a pause, so that the loss cannot be counted from it, s.
const GAP_MAX_S: f64 = 60.0;

/// The mean of some scans.
#[derive(Debug, PartialEq)]
pub(super) struct Mean<'a> {
    /// Mean time of the scans, ns.
    pub(super) time_ns: u64,
    /// One number a channel.
    pub(super) values: &'a [f64],
}

/// Averages a fixed count of scans to one reading.
#[derive(Debug, Clone)]
pub(super) struct Decimator {
    decimate: u32,
    period_ns: f64,
    sums: Vec<f64>,
    mean: Vec<f64>,
    scans: u32,
    /// Time of the first scan in `sums`.
    since_ns: u64,
    /// Due time of the next scan; `None` before the first frame.
    next_ns: Option<f64>,
    /// Frames missing before the present one by their numbers; if there are none, no scan is missing.
    missing_frames: u32,
    /// Index of the current scan in its frame, and the frame's time.
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

    /// Registers frames missing before the next one.
    pub(super) fn missing_frames(&mut self, frames: u32) {
        self.missing_frames = self.missing_frames.saturating_add(frames);
    }

    /// A frame begins: reports the loss before it and discards a partial mean.
    pub(super) fn frame(&mut self, time_ns: u64, scans: usize, decoded: &mut Decoded) {
        let missing_frames = core::mem::take(&mut self.missing_frames);
        if let Some(next_ns) = self.next_ns {
            let late_ns = time_ns as f64 - next_ns;
            let late_scans = (late_ns / self.period_ns).round();
            // Gradual adjustment of the device's clock moves it by less than a scan.
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
                    decoded.lost(readings.round() as u32);
                }
            }
        }
        self.frame_ns = time_ns;
        self.frame_scans = u32::try_from(scans).unwrap_or(u32::MAX);
        self.index = 0;
        self.next_ns = Some(time_ns as f64 + scans as f64 * self.period_ns);
    }

    /// Adds the next scan of the frame; returns the mean when it is complete.
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
