//! Frames at a fixed rate from instants whose times vary with clock fit and lost samples.

use super::frame::Frame;

/// Maximum distance between two instants for interpolation, periods. A cycle with two samples publishes the second one
/// only, so one instant may be missing; two missing ones are a gap.
const GAP_MAX_PERIODS: f64 = 2.5;
/// A frame this close to an instant has its values, ns: stamps are rounded.
const SAME_TIME_NS: u64 = 1000;
/// Rates are rounded to 0.01 Hz.
const RATE_STEPS_PER_HZ: f64 = 100.0;

/// Times of the frames: `start + k / rate`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Grid {
    /// Time of the first frame, CLOCK_MONOTONIC ns.
    pub(crate) start_ns: u64,
    /// Frames per second.
    pub(crate) rate_hz: f64,
    /// Number of frames.
    pub(crate) frames: usize,
}

impl Grid {
    /// A grid over increasing times, ns, with the rate of their median interval; `None` for fewer than two.
    pub(super) fn over(times_ns: &[u64]) -> Option<Grid> {
        let (first, last) = (*times_ns.first()?, *times_ns.last()?);
        let mut intervals: Vec<u64> = times_ns.windows(2).map(|pair| pair[1] - pair[0]).collect();
        if intervals.is_empty() {
            return None;
        }
        let middle = intervals.len() / 2;
        let (_, median_ns, _) = intervals.select_nth_unstable(middle);
        let rate_hz = (1e9 / *median_ns as f64 * RATE_STEPS_PER_HZ).round() / RATE_STEPS_PER_HZ;
        let frames = ((last - first) as f64 / 1e9 * rate_hz) as usize + 1;
        Some(Grid { start_ns: first, rate_hz, frames })
    }

    /// Time of a frame, CLOCK_MONOTONIC ns.
    pub(crate) fn time_ns(&self, frame: usize) -> u64 {
        self.start_ns + (frame as f64 / self.rate_hz * 1e9).round() as u64
    }

    /// Interval between frames, ns.
    pub(super) fn period_ns(&self) -> u64 {
        (1e9 / self.rate_hz) as u64
    }
}

/// Interpolates instants to the times of a grid.
#[derive(Debug)]
pub(super) struct Resampler {
    grid: Grid,
    next: usize,
    before: Option<Frame>,
}

impl Resampler {
    pub(super) fn new(grid: Grid) -> Resampler {
        Resampler { grid, next: 0, before: None }
    }

    /// Ingests the next instant and passes on every frame up to its time.
    pub(super) fn push(
        &mut self,
        instant: Frame,
        visit: &mut dyn FnMut(&Frame) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let gap_max_ns = (GAP_MAX_PERIODS * self.grid.period_ns() as f64) as u64;
        while self.next < self.grid.frames && self.grid.time_ns(self.next) <= instant.time_ns + SAME_TIME_NS {
            let time_ns = self.grid.time_ns(self.next);
            let frame = match &self.before {
                _ if time_ns.abs_diff(instant.time_ns) <= SAME_TIME_NS => Frame { time_ns, ..instant },
                Some(before) if instant.time_ns - before.time_ns <= gap_max_ns => {
                    before.between(&instant, time_ns)
                }
                _ => Frame::invalid(time_ns),
            };
            visit(&frame)?;
            self.next += 1;
        }
        self.before = Some(instant);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::message::State;

    fn instant(time_ns: u64) -> Frame {
        let mut state = State { suit_sample_time_ns: time_ns, ..State::zeroed() };
        state.com_m[0] = time_ns as f64;
        Frame::of(&state, 0.0, 0.0)
    }

    fn resampled(times_ns: &[u64]) -> (Grid, Vec<Frame>) {
        let grid = Grid::over(times_ns).unwrap();
        let (mut resampler, mut frames) = (Resampler::new(grid), Vec::new());
        for time_ns in times_ns {
            let mut visit = |frame: &Frame| {
                frames.push(*frame);
                Ok(())
            };
            resampler.push(instant(*time_ns), &mut visit).unwrap();
        }
        assert_eq!(frames.len(), grid.frames);
        (grid, frames)
    }

    #[test]
    fn a_gap_has_invalid_frames_and_one_missing_instant_is_none() {
        let is_there = |k: &u64| ![5, 11, 12].contains(k);
        let times: Vec<u64> = (0..20).filter(is_there).map(|k| 1_000_000_000 + k * 10_000_000).collect();
        let (grid, frames) = resampled(&times);
        assert_eq!((grid.rate_hz, grid.frames), (100.0, 20));
        let is_invalid = |frame: &usize| frames[*frame].com_m[0].is_nan();
        assert_eq!((0..frames.len()).filter(is_invalid).collect::<Vec<_>>(), [11, 12]);
    }

    #[test]
    fn stamps_that_drift_are_interpolated() {
        let (grid, frames) = resampled(&(0..2000).map(|k| 7 + k * 9_999_800).collect::<Vec<u64>>());
        assert_eq!(grid.rate_hz, 100.0);
        for (index, frame) in frames.iter().enumerate() {
            assert_eq!(frame.time_ns, grid.time_ns(index));
            assert!((frame.com_m[0] - frame.time_ns as f64).abs() <= SAME_TIME_NS as f64, "{index}");
        }
    }

    #[test]
    fn fewer_than_two_instants_have_no_rate() {
        assert_eq!((Grid::over(&[]), Grid::over(&[7])), (None, None));
    }
}
