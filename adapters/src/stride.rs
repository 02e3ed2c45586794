//! How far apart two samples are that are sent, in the device's own counts or time.
//!
//! The suit counts its own samples; a sender at a lower rate skips some. An insole stamps its samples and does not count
//! them. So a gap is loss only beyond the usual one.

/// How many gaps of a count are remembered.
const REMEMBERED: usize = 16;

/// The least of the last gaps: loss only makes gaps longer. Unless some are no multiple of it: then the sender's rate is no
/// whole part of the suit's, gaps of the least and of one more alternate, and the stride is their mean. Then what is told is
/// exact for two lost in a row; of more it may be one off.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stride {
    gaps: [u32; REMEMBERED],
    next: usize,
}

impl Stride {
    /// Takes in a gap (at least 1) and says how many samples were lost in it.
    pub(crate) fn lost_in(&mut self, gap: u32) -> u32 {
        self.gaps[self.next] = gap;
        self.next = (self.next + 1) % REMEMBERED;
        let least = self.usual().unwrap_or(gap).max(1);
        if self.known().all(|gap| gap.is_multiple_of(least)) {
            return (gap / least).saturating_sub(1);
        }
        // Those without loss: two steps are more than one more than the least, which is 2 at least.
        let whole = || self.known().filter(|gap| *gap <= least + 1).map(u64::from);
        let (sum, count) = (whole().sum::<u64>().max(1), whole().count() as u64);
        // To the nearest; what is in the middle is fewer, as long as only gaps of the least are known.
        let steps = (2 * u64::from(gap) * count + sum - 1) / (2 * sum);
        u32::try_from(steps).unwrap_or(u32::MAX).saturating_sub(1)
    }

    /// The usual gap; `None` before the first.
    pub(crate) fn usual(&self) -> Option<u32> {
        self.known().min()
    }

    fn known(&self) -> impl Iterator<Item = u32> {
        // Unused places are zero.
        self.gaps.iter().copied().filter(|gap| *gap > 0)
    }
}

/// How many gaps of time are remembered: among them there must be some in a row without loss.
const TIMES_REMEMBERED: usize = 64;
/// So many.
const RUN: usize = 4;

/// The same for gaps of time, whose stamps are rounded and jitter.
///
/// At 75 Hz told in hundredths of a second, steps of 10 and 20 ms alternate without loss. So the step is the least of four
/// in a row, divided; before there were four nothing is told lost. And a gap must reach seven eighths of another step to
/// hold it.
#[derive(Debug, Clone)]
pub(crate) struct TimeStride {
    gaps: [u32; TIMES_REMEMBERED],
    taken: usize,
    /// Gaps in a row of which the longest is more than this share of the shortest are no usual ones, per cent.
    uneven: u32,
}

impl TimeStride {
    /// Of stamps that may be rounded to as much as a step.
    pub(crate) fn of_rounded() -> TimeStride {
        TimeStride { gaps: [0; TIMES_REMEMBERED], taken: 0, uneven: 200 }
    }

    /// Of stamps that are fine and even.
    pub(crate) fn of_exact() -> TimeStride {
        TimeStride { uneven: 110, ..TimeStride::of_rounded() }
    }

    /// Takes in a gap (at least 1, in any unit) and says how many samples were lost in it.
    pub(crate) fn lost_in(&mut self, gap: u32) -> u32 {
        self.gaps[self.taken % TIMES_REMEMBERED] = gap;
        self.taken += 1;
        let known = self.taken.min(TIMES_REMEMBERED);
        // Newest first; no run reaches over the seam of the ring.
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
        // What is longer is loss as long as any other gap is remembered.
        assert_eq!(lost_in(4, REMEMBERED - 1), 3 * (REMEMBERED as u32 - 1));
        assert_eq!(lost_in(4, 20), 0);
        assert_eq!(lost_in(1, 20), 0);
    }

    proptest! {
        /// A rate that is no whole part of the suit's, too: 240 Hz sent at 100, 90, 70 …; up to two in a row.
        #[test]
        fn loss_is_counted_exactly_at_any_rate(
            hz in 20u32..=120, drops in proptest::collection::vec(0u32..12, 60..200),
        ) {
            let count = |sample: u32| sample * 240 / hz;
            let mut stride = Stride::default();
            let (mut sample, mut dropped, mut told) = (0, 0, 0);
            for (place, drop) in drops.iter().enumerate() {
                // Enough to know the stride by, and enough without loss to keep it.
                let skipped = if place > REMEMBERED && place % 4 == 0 { drop.saturating_sub(9) } else { 0 };
                told += stride.lost_in(count(sample + 1 + skipped) - count(sample));
                sample += 1 + skipped;
                dropped += skipped;
            }
            prop_assert_eq!(told, dropped);
        }
    }

    #[test]
    fn stamps_in_hundredths_at_75_hz_lose_nothing_and_a_missing_one_is_seen() {
        let stamp_ms = |index: u32| (f64::from(index) / 75.0 * 100.0).round() as u32 * 10;
        let mut stride = TimeStride::of_rounded();
        let lost: u32 = (1..200).map(|index| stride.lost_in(stamp_ms(index) - stamp_ms(index - 1))).sum();
        assert_eq!(lost, 0);
        // Three in a row, so that rounding cannot hide them.
        assert_eq!(stride.lost_in(stamp_ms(203) - stamp_ms(199)), 3);
    }

    proptest! {
        #[test]
        fn loss_among_jittering_stamps_is_counted_exactly(
            step in 400u32..40_000, seeds in proptest::collection::vec((0u32..100, 0u32..12), 30..100),
        ) {
            // Every stamp is off by up to 5 % of a step; each seed says how far, and whether stamps are left out.
            let mut stride = TimeStride::of_rounded();
            let (mut index, mut before, mut dropped, mut told) = (0u32, 0u32, 0, 0);
            for (place, (jitter, drop)) in seeds.iter().enumerate() {
                // Some in a row are whole, the first above all: a stride that was never seen cannot be known.
                let skipped = if place % 16 > 4 && *drop < 3 { drop + 1 } else { 0 };
                index += 1 + skipped;
                dropped += skipped;
                let stamp = index * step + step * jitter / 2000;
                told += stride.lost_in(stamp - before);
                before = stamp;
            }
            prop_assert_eq!(told, dropped);
        }
    }
}
