//! Whether what is measured agrees with what was believed: the sum of normalised innovations squared against χ².
//!
//! Over the first poses a prior that does not fit this worker shows in innovations larger than predicted. Then P is
//! inflated to what they say, and the poses count for more than the prior. Innovations that stay too large later are the
//! model's misfit (`misfit`), which widens σ.

use bytemuck::{Pod, Zeroable};

/// χ² bounds that 99 of 100 stay below, for 2, 4, … 12 degrees of freedom: one to six poses.
const CHI2_99: [f64; POSES_TESTED] = [9.210, 13.277, 16.812, 20.090, 23.209, 26.217];
/// The prior answers for this many poses.
const POSES_TESTED: usize = 6;
/// Poses whose NIS is kept, to show how an identification went.
const RECENT: usize = 5;
/// P is never inflated by more than this in all.
const INFLATION_MAX: f64 = 100.0;
/// More poses than a working life brings.
const COUNT_MAX: u64 = 1 << 32;

/// One pose's innovation, both axes: what was seen, and what was expected of each source; m².
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Seen {
    /// Normalised innovation squared, two degrees of freedom.
    pub nis: f64,
    /// Sum of squared innovations.
    pub square_m2: f64,
    /// Sum of the variances that θ alone lets expect.
    pub theta_m2: f64,
    /// Sum of all other variances: stance, suit, body, plate.
    pub rest_m2: f64,
}

/// Innovations so far.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Consistency {
    /// Poses that were held against the prior, in [0, 6].
    pub tested: u64,
    /// Of these, poses since the last inflation; the sums that follow are theirs.
    pub since: u64,
    /// Normalised innovations squared.
    pub nis: f64,
    /// Squared innovations, m².
    pub square_m2: f64,
    /// Variances that θ alone lets expect, m².
    pub theta_m2: f64,
    /// All other variances, m².
    pub rest_m2: f64,
    /// How much P was inflated in all.
    pub inflation: f64,
    /// NIS of the last poses, newest at `(recent_count − 1) % 5`.
    pub recent: [f64; RECENT],
    /// How many poses were learnt in all.
    pub recent_count: u64,
}

impl Consistency {
    /// Before the first pose.
    pub fn start() -> Consistency {
        Consistency { inflation: 1.0, ..Zeroable::zeroed() }
    }

    /// What was learnt stands; no prior is tested any more.
    pub fn trust(&mut self) {
        self.tested = POSES_TESTED as u64;
    }

    /// How much P was inflated in all, in [1, 100].
    pub(super) fn inflation(&self) -> f64 {
        self.inflation
    }

    /// Holds one more pose against the prior, before it is learnt. The factor by which to inflate P first, if the
    /// poses so far are beyond the bound: that which makes θ's share of the innovations as large as was seen.
    pub(super) fn test(&mut self, seen: Seen) -> Option<f64> {
        if self.tested >= POSES_TESTED as u64 {
            return None;
        }
        self.tested += 1;
        self.since += 1;
        self.nis += seen.nis;
        self.square_m2 += seen.square_m2;
        self.theta_m2 += seen.theta_m2;
        self.rest_m2 += seen.rest_m2;
        let bound = *CHI2_99.get(self.since as usize - 1)?;
        let room = INFLATION_MAX / self.inflation;
        if self.nis <= bound || room <= 1.0 {
            return None;
        }
        let shown = (self.square_m2 - self.rest_m2) / self.theta_m2;
        let factor = if shown.is_finite() { shown.clamp(1.0, room) } else { 1.0 };
        let tested = self.tested;
        let inflation = self.inflation * factor;
        *self = Consistency {
            tested,
            inflation,
            recent: self.recent,
            recent_count: self.recent_count,
            ..Self::start()
        };
        Some(factor)
    }

    /// Remembers the NIS of a pose that was learnt.
    pub(super) fn push(&mut self, nis: f64) {
        self.recent[self.recent_count as usize % RECENT] = nis;
        self.recent_count += 1;
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        let sums = [self.nis, self.square_m2, self.theta_m2, self.rest_m2, self.inflation];
        self.tested <= POSES_TESTED as u64
            && self.since <= self.tested
            && self.recent_count < COUNT_MAX
            && sums.iter().chain(&self.recent).all(|value| value.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(nis: f64, square_m2: f64) -> Seen {
        Seen { nis, square_m2, theta_m2: 2.0, rest_m2: 1.0 }
    }

    #[test]
    fn a_prior_that_fits_is_left_alone() {
        let mut consistency = Consistency::start();
        for _ in 0..20 {
            assert_eq!(consistency.test(seen(2.0, 3.0)), None);
            consistency.push(2.0);
        }
        assert_eq!(consistency.inflation(), 1.0);
        assert!(consistency.is_sound());
    }

    #[test]
    fn a_prior_that_does_not_fit_is_inflated_to_what_was_seen_and_never_beyond_the_bound() {
        let mut consistency = Consistency::start();
        assert_eq!(consistency.test(seen(9.0, 13.0)), None);
        // Both poses together: 26 m² seen, 2 m² of other sources, 4 m² of θ.
        assert_eq!(consistency.test(seen(9.0, 13.0)), Some(6.0));
        assert_eq!(consistency.test(seen(1e6, 1e6)), Some(100.0 / 6.0));
        assert_eq!(consistency.test(seen(1e6, 1e6)), None);
        assert_eq!(consistency.inflation(), 100.0);
        let mut trusted = Consistency::start();
        trusted.trust();
        assert_eq!(trusted.test(seen(1e6, 1e6)), None);
    }

    #[test]
    fn a_surprise_that_other_sources_explain_inflates_nothing() {
        let mut consistency = Consistency::start();
        assert_eq!(
            consistency.test(Seen { nis: 10.0, square_m2: 0.5, theta_m2: 2.0, rest_m2: 1.0 }),
            Some(1.0)
        );
        assert_eq!(consistency.inflation(), 1.0);
    }
}
