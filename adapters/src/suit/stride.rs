//! How many counts lie between two samples that are sent.
//!
//! The suit counts its own samples; a sender at a lower rate skips some. So a gap is loss only beyond the usual one.

/// How many gaps are remembered.
const REMEMBERED: usize = 16;

/// The least of the last gaps: loss only makes gaps longer.
#[derive(Debug, Clone, Default)]
pub(super) struct Stride {
    gaps: [u32; REMEMBERED],
    next: usize,
}

impl Stride {
    /// Takes in a gap (at least 1) and says how many samples were lost in it.
    pub(super) fn lost_in(&mut self, gap: u32) -> u32 {
        self.gaps[self.next] = gap;
        self.next = (self.next + 1) % REMEMBERED;
        // Unused places are zero. Rounding down: at 240 Hz sent at 100 Hz, gaps of 2 and 3 alternate without loss.
        let stride = self.gaps.iter().copied().filter(|gap| *gap > 0).min().unwrap_or(gap);
        (gap / stride.max(1)).saturating_sub(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        for _ in 0..20 {
            stride.lost_in(1);
        }
        for _ in 0..REMEMBERED {
            stride.lost_in(4);
        }
        assert_eq!(stride.lost_in(4), 0);
    }
}
