//! Interval between two sent samples, in the device's own counts or time.
//!
//! The suit counts its own samples; a sender at a lower rate skips some. An insole stamps its samples without counting
//! them. A gap is therefore a loss only beyond the usual interval.

/// Count of stored gaps of a count.
const REMEMBERED: usize = 16;

/// The smallest of the last gaps, as loss only lengthens gaps. If some gaps are no multiple of it, the sender's rate
/// does not divide the suit's: gaps of the smallest and of one more alternate, and the stride is their mean. The loss
/// is then exact for two samples lost in a row; for more it may be off by one.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stride {
    gaps: [u32; REMEMBERED],
    next: usize,
}

impl Stride {
    /// Processes a gap (at least 1) and returns the count of samples lost in it.
    pub(crate) fn lost_in(&mut self, gap: u32) -> u32 {
        self.gaps[self.next] = gap;
        self.next = (self.next + 1) % REMEMBERED;
        let least = self.usual().unwrap_or(gap).max(1);
        if self.known().all(|gap| gap.is_multiple_of(least)) {
            return (gap / least).saturating_sub(1);
        }
        // Gaps without loss: two steps exceed the smallest gap, which is at least 2, by more than one.
        let whole = || self.known().filter(|gap| *gap <= least + 1).map(u64::from);
        let (sum, count) = (whole().sum::<u64>().max(1), whole().count() as u64);
        // Rounded to the nearest, and half down while only gaps of the smallest size were observed.
        let steps = (2 * u64::from(gap) * count + sum - 1) / (2 * sum);
        u32::try_from(steps).unwrap_or(u32::MAX).saturating_sub(1)
    }

    /// The usual gap; `None` before the first.
    pub(crate) fn usual(&self) -> Option<u32> {
        self.known().min()
    }

    fn known(&self) -> impl Iterator<Item = u32> {
        // Unused entries are zero.
        self.gaps.iter().copied().filter(|gap| *gap > 0)
    }
}

/// Count of stored gaps of time: they must include some in a row without loss.
const TIMES_REMEMBERED: usize = 64;
/// Length of such a run.
const RUN: usize = 4;

/// The same for gaps of time, whose stamps are rounded and jitter.
///
/// At 75 Hz with stamps in hundredths of a second, steps of 10 and 20 ms alternate without loss. The step is therefore
/// the smallest mean over four in a row; before four gaps no loss is reported. A gap must reach seven eighths of
/// another step to contain it.
#[derive(Debug, Clone)]
pub(crate) struct TimeStride {
    gaps: [u32; TIMES_REMEMBERED],
    taken: usize,
    /// Largest ratio of the longest to the shortest gap of a regular run, per cent.
    uneven: u32,
}

impl TimeStride {
    /// For stamps that may be rounded by as much as a step.
    pub(crate) fn of_rounded() -> TimeStride {
        TimeStride { gaps: [0; TIMES_REMEMBERED], taken: 0, uneven: 200 }
    }

    /// For stamps with fine resolution and regular intervals.
    pub(crate) fn of_exact() -> TimeStride {
        TimeStride { uneven: 110, ..TimeStride::of_rounded() }
    }

    /// Processes a gap (at least 1, in any unit) and returns the count of samples lost in it.
    pub(crate) fn lost_in(&mut self, gap: u32) -> u32 {
        self.gaps[self.taken % TIMES_REMEMBERED] = gap;
        self.taken += 1;
        let known = self.taken.min(TIMES_REMEMBERED);
        // Newest first; no run extends over the end of the ring buffer.
        let at = |age: usize| u64::from(self.gaps[(self.taken - 1 - age) % TIMES_REMEMBERED]);
        let is_even = |age: &usize| {
            let run = *age..*age + RUN;
            let (least, most) = (run.clone().map(at).min(), run.map(at).max());
            most.unwrap_or_default() * 100 <= least.unwrap_or_default() * u64::from(self.uneven)
        };
        let runs = (0..(known + 1).saturating_sub(RUN)).filter(is_even);
        let Some(least) = runs.map(|age| (age..age + RUN).map(at).sum::<u64>()).min() else { return 0 };
        let eighths_of_a_step = 8 * RUN as u64 * u64::from(gap) / least.max(1);
        u32::try_from(((eighths_of_a_step + 1) / 8).saturating_sub(1)).unwrap_or(u32::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_gap_is_loss_only_beyond_the_stride() {
        let mut stride = Stride::default();
        let lost: Vec<u32> = [4, 4, 8, 4, 12, 4].into_iter().map(|gap| stride.lost_in(gap)).collect();
        assert_eq!(lost, [0, 0, 1, 0, 2, 0]);
        let mut stride = Stride::default();
        assert_eq!([2, 3, 2, 2, 3, 5].map(|gap| stride.lost_in(gap)), [0, 0, 0, 0, 0, 1]);
    }

    #[test]
    fn a_new_stream_rate_is_learnt() {
        let mut stride = Stride::default();
        let mut lost_in = |gap: u32, times: usize| (0..times).map(|_| stride.lost_in(gap)).sum::<u32>();
        assert_eq!(lost_in(1, 20), 0);
        // A longer gap is a loss as long as another gap is stored.
        assert_eq!(lost_in(4, REMEMBERED - 1), 3 * (REMEMBERED as u32 - 1));
        assert_eq!(lost_in(4, 20), 0);
        assert_eq!(lost_in(1, 20), 0);
    }

    proptest! {
        /// Includes rates that do not divide the suit's: 240 Hz sent at 100, 90, 70 …; up to two lost in a row.
        #[test]
        fn loss_is_counted_exactly_at_any_rate(
            hz in 20u32..=120, drops in proptest::collection::vec(0u32..12, 60..200),
        ) {
            let count = |sample: u32| sample * 240 / hz;
            let mut stride = Stride::default();
            let (mut sample, mut dropped, mut counted) = (0, 0, 0);
            for (place, drop) in drops.iter().enumerate() {
                // Enough gaps to determine the stride, and enough without loss to keep it.
                let skipped = if place > REMEMBERED && place % 4 == 0 { drop.saturating_sub(9) } else { 0 };
                counted += stride.lost_in(count(sample + 1 + skipped) - count(sample));
                sample += 1 + skipped;
                dropped += skipped;
            }
            prop_assert_eq!(counted, dropped);
        }
    }

    #[test]
    fn stamps_in_hundredths_at_75_hz_lose_nothing_and_a_missing_one_is_seen() {
        let stamp_ms = |index: u32| (f64::from(index) / 75.0 * 100.0).round() as u32 * 10;
        let mut stride = TimeStride::of_rounded();
        let lost: u32 = (1..200).map(|index| stride.lost_in(stamp_ms(index) - stamp_ms(index - 1))).sum();
        assert_eq!(lost, 0);
        // Three in a row, so that rounding cannot mask them.
        assert_eq!(stride.lost_in(stamp_ms(203) - stamp_ms(199)), 3);
    }

    proptest! {
        #[test]
        fn loss_among_jittering_stamps_is_counted_exactly(
            step in 400u32..40_000, seeds in proptest::collection::vec((0u32..100, 0u32..12), 30..100),
        ) {
            // Every stamp is off by up to 5 % of a step; each seed sets the error, and whether stamps are omitted.
            let mut stride = TimeStride::of_rounded();
            let (mut index, mut before, mut dropped, mut counted) = (0u32, 0u32, 0, 0);
            for (place, (jitter, drop)) in seeds.iter().enumerate() {
                // Some runs are complete, including the first: the stride cannot be determined without one.
                let skipped = if place % 16 > 4 && *drop < 3 { drop + 1 } else { 0 };
                index += 1 + skipped;
                dropped += skipped;
                let stamp = index * step + step * jitter / 2000;
                counted += stride.lost_in(stamp - before);
                before = stamp;
            }
            prop_assert_eq!(counted, dropped);
        }
    }
}
