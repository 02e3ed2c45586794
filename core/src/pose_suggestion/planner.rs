//! Selects the next pose of the library: evaluates one candidate per cycle, so that no cycle is long.
//!
//! A suggestion is not repeated before all other poses were suggested. A pose that the subject could not hold is not
//! suggested again, and neither, while there are others, one in which this subject would lose balance.

use bytemuck::{Pod, Zeroable};

use super::LIBRARY_MAX;
use super::gain::Weight;
use crate::sesc::PARAMETERS;
use crate::sesc::reduction::Rows;

/// Value for "none found yet".
const NONE: u64 = u64::MAX;

/// State between candidates. Indices into the library are in [0, [`LIBRARY_MAX`]).
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Planner {
    /// W, the mean of `h hᵀ` over the library, as far as it is computed.
    weight: Weight,
    /// Sum of h over the rows of each axis, over the number of all rows.
    mean_row: [[f64; PARAMETERS]; 2],
    /// Number of poses of the library included in W.
    added: u64,
    /// The next candidate.
    next: u64,
    /// Best candidate so far: in balance, and any. `NONE` or an index.
    best: [u64; 2],
    /// Their gains.
    best_gain: [f64; 2],
    /// One bit per pose that was already suggested.
    suggested: u64,
    /// One bit per pose that this subject could not hold.
    unholdable: u64,
}

impl Planner {
    /// Restarts for another body.
    pub fn start(&mut self) {
        *self = Zeroable::zeroed();
        self.begin_sweep();
    }

    /// Restarts the search at the first candidate.
    pub fn begin_sweep(&mut self) {
        self.next = 0;
        self.best = [NONE; 2];
        self.best_gain = [0.0; 2];
    }

    /// The next pose of a library of `size` whose rows W lacks; `None` once it is complete.
    pub fn next_pose(&self, size: usize) -> Option<usize> {
        (self.added < size.min(LIBRARY_MAX) as u64).then_some(self.added as usize)
    }

    /// Adds the rows of one more pose of a library of `size` to W.
    pub fn add_pose(&mut self, rows: &Rows, size: usize) {
        let weight = 1.0 / (2.0 * size.clamp(1, LIBRARY_MAX) as f64);
        for (h, mean) in rows.h.iter().zip(&mut self.mean_row) {
            for (mean, value) in mean.iter_mut().zip(h) {
                *mean += weight * value;
            }
            for (row, own) in self.weight.iter_mut().zip(h) {
                // Rows are mostly zero beyond the parameters in use.
                if *own != 0.0 {
                    for (entry, other) in row.iter_mut().zip(h) {
                        *entry += weight * own * other;
                    }
                }
            }
        }
        self.added += 1;
    }

    /// W; complete once [`Planner::next_pose`] returns `None`.
    pub fn weight(&self) -> &Weight {
        &self.weight
    }

    /// The other input of [`crate::kalman::Filter::mean_variance_m2`] besides W.
    pub fn mean_row(&self) -> &[[f64; PARAMETERS]; 2] {
        &self.mean_row
    }

    /// The next candidate of a library of `size`, without excluded ones; `None` once all were evaluated.
    pub fn candidate(&mut self, size: usize) -> Option<usize> {
        let size = size.min(LIBRARY_MAX);
        let all = if size == LIBRARY_MAX { u64::MAX } else { (1 << size) - 1 };
        // Repeating a pose, even a failed one, is better than suggesting none.
        if (self.suggested | self.unholdable) & all == all {
            self.suggested = 0;
        }
        if self.unholdable & all == all {
            self.unholdable = 0;
        }
        let out = self.suggested | self.unholdable;
        let next = (self.next as usize..size).find(|index| out & (1 << index) == 0);
        self.next = next.map_or(size, |index| index + 1) as u64;
        next
    }

    /// Ingests the gain of a candidate.
    pub fn ingest_gain(&mut self, index: usize, gain: f64, balanced: bool) {
        for (slot, counts) in [balanced, true].into_iter().enumerate() {
            let first = self.best[slot] == NONE;
            if counts && gain.is_finite() && (first || gain > self.best_gain[slot]) {
                self.best[slot] = index as u64;
                self.best_gain[slot] = gain;
            }
        }
    }

    /// Selects after the last candidate: the best in balance, else the best. It counts as suggested from then on.
    pub fn select(&mut self) -> Option<usize> {
        let index = self.best.into_iter().find(|index| *index != NONE)? as usize;
        self.suggested |= 1 << index;
        Some(index)
    }

    /// One bit per pose of the library that was suggested already, and one per pose that this subject could not hold.
    pub fn history(&self) -> [u64; 2] {
        [self.suggested, self.unholdable]
    }

    /// Restores a stored history.
    pub fn restore(&mut self, [suggested, unholdable]: [u64; 2]) {
        (self.suggested, self.unholdable) = (suggested, unholdable);
    }

    /// Marks a pose of the library that the subject cannot hold.
    pub fn mark_unholdable(&mut self, index: u64) {
        if index < LIBRARY_MAX as u64 {
            self.unholdable |= 1 << index;
        }
    }

    /// Whether indices and numbers are in range; a stored planner is checked before use.
    pub fn is_sound(&self) -> bool {
        let bound = LIBRARY_MAX as u64;
        self.added <= bound
            && self.next <= bound
            && self.best.iter().all(|index| *index == NONE || *index < bound)
            && self.best_gain.iter().all(|gain| gain.is_finite())
            && self.weight.iter().chain(&self.mean_row).flatten().all(|value| value.is_finite())
    }
}

/// W has a row for every parameter.
const _: () = assert!(size_of::<Weight>() == 8 * PARAMETERS * PARAMETERS);

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs one search with these gains; all but the listed poses are in balance.
    fn suggest(planner: &mut Planner, gains: &[f64], unbalanced: &[usize]) -> Option<usize> {
        planner.begin_sweep();
        while let Some(index) = planner.candidate(gains.len()) {
            planner.ingest_gain(index, gains[index], !unbalanced.contains(&index));
        }
        planner.select()
    }

    fn planner() -> Planner {
        let mut planner: Planner = Zeroable::zeroed();
        planner.start();
        planner
    }

    #[test]
    fn the_best_is_suggested_and_repeated_only_after_all_others() {
        let mut planner = planner();
        let suggested: [Option<usize>; 4] =
            core::array::from_fn(|_| suggest(&mut planner, &[1.0, 3.0, 2.0], &[]));
        assert_eq!(suggested, [Some(1), Some(2), Some(0), Some(1)]);
        assert!(planner.is_sound());
    }

    #[test]
    fn a_pose_out_of_balance_is_suggested_last() {
        let mut planner = planner();
        assert_eq!(suggest(&mut planner, &[1.0, 3.0], &[1]), Some(0));
        assert_eq!(suggest(&mut planner, &[1.0, 3.0], &[1]), Some(1));
    }

    #[test]
    fn a_pose_that_was_not_held_is_suggested_again_only_without_another() {
        let mut planner = planner();
        planner.mark_unholdable(1);
        planner.mark_unholdable(u64::MAX);
        let suggested: [Option<usize>; 3] =
            core::array::from_fn(|_| suggest(&mut planner, &[1.0, 3.0, 2.0], &[]));
        assert_eq!(suggested, [Some(2), Some(0), Some(2)]);
        planner.mark_unholdable(0);
        planner.mark_unholdable(2);
        assert_eq!(suggest(&mut planner, &[1.0, 3.0, 2.0], &[]), Some(1));
    }

    #[test]
    fn no_library_no_suggestion_and_the_largest_library_fits() {
        assert_eq!(suggest(&mut planner(), &[], &[]), None);
        let gains: [f64; LIBRARY_MAX] = core::array::from_fn(|index| index as f64);
        assert_eq!(suggest(&mut planner(), &gains, &[]), Some(LIBRARY_MAX - 1));
    }

    #[test]
    fn the_weight_gives_the_mean_square_over_the_library() {
        let mut planner = planner();
        let theta = [0.3, -0.2];
        let mut mean_square = 0.0;
        for pose in 0..3 {
            let mut rows = Rows { h: [[0.0; PARAMETERS]; 2], offset_m: [0.0; 2] };
            rows.h[0][..2].copy_from_slice(&[1.0, 0.5 * f64::from(pose)]);
            rows.h[1][..2].copy_from_slice(&[-0.3, 0.7]);
            assert_eq!(planner.next_pose(3), Some(pose as usize));
            planner.add_pose(&rows, 3);
            for h in &rows.h {
                let projected = h[0] * theta[0] + h[1] * theta[1];
                mean_square += projected * projected / 6.0;
            }
        }
        assert_eq!(planner.next_pose(3), None);
        let w = planner.weight();
        let by_weight: f64 = (0..2)
            .map(|row| (0..2).map(|column| theta[row] * w[row][column] * theta[column]).sum::<f64>())
            .sum();
        assert!((by_weight - mean_square).abs() < 1e-15);
    }
}
