//! Consistency of measurements and prior: the sum of normalised innovations squared, tested against χ².
//!
//! If the prior does not fit this subject, the innovations of the first poses are larger than predicted. Then P is
//! inflated accordingly, which gives the poses more weight than the prior. Innovations that remain too large later are
//! attributed to the model's misfit (`misfit`), which increases σ.

use bytemuck::{Pod, Zeroable};

/// 99 % quantiles of χ² for 2, 4, … 12 degrees of freedom: one to six poses.
const CHI2_99: [f64; POSES_TESTED] = [9.210, 13.277, 16.812, 20.090, 23.209, 26.217];
/// Number of poses tested against the prior.
const POSES_TESTED: usize = 6;
/// Number of recent NIS values stored, to display the course of the identification.
const RECENT: usize = 5;
/// Upper bound of the total inflation of P.
const INFLATION_MAX: f64 = 100.0;
/// Upper bound of each sum and NIS: innovations of 10 m on both axes, over a 1-σ of 1 mm.
const SUM_MAX: f64 = POSES_TESTED as f64 * 2e8;
/// Upper bound of the number of poses, beyond a working life.
const COUNT_MAX: u64 = 1 << 32;

/// Innovation of one pose, both axes: observed, and expected from each source; m².
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PoseInnovation {
    /// Normalised innovation squared, two degrees of freedom.
    pub nis: f64,
    /// Sum of squared innovations.
    pub square_m2: f64,
    /// Sum of the variances expected from θ alone.
    pub theta_m2: f64,
    /// Sum of all other variances: stance, suit, body, plate.
    pub rest_m2: f64,
}

/// Statistics of the innovations so far.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Consistency {
    /// Number of poses tested against the prior, in [0, 6].
    pub tested: u64,
    /// Number of these poses since the last inflation, over which the following sums run.
    pub since: u64,
    /// Normalised innovations squared.
    pub nis: f64,
    /// Squared innovations, m².
    pub square_m2: f64,
    /// Variances expected from θ alone, m².
    pub theta_m2: f64,
    /// All other variances, m².
    pub rest_m2: f64,
    /// Total inflation of P.
    pub inflation: f64,
    /// NIS of the last poses, newest at `(recent_count − 1) % 5`.
    pub recent: [f64; RECENT],
    /// Total number of poses used.
    pub recent_count: u64,
}

impl Consistency {
    /// Before the first pose.
    pub fn start() -> Consistency {
        Consistency { inflation: 1.0, ..Zeroable::zeroed() }
    }

    /// Ends the test of the prior and keeps the present estimate.
    #[cfg(test)]
    pub(super) fn accept(&mut self) {
        self.tested = POSES_TESTED as u64;
    }

    /// Total inflation of P, in [1, 100].
    pub(super) fn inflation(&self) -> f64 {
        self.inflation
    }

    /// Tests one more pose against the prior, before the update. Returns the factor by which to inflate P first, if the
    /// poses so far exceed the bound: with it, θ's part of the expected innovations matches the observed ones.
    pub(super) fn test(&mut self, innovation: PoseInnovation) -> Option<f64> {
        if self.tested >= POSES_TESTED as u64 {
            return None;
        }
        self.tested += 1;
        self.since += 1;
        self.nis += innovation.nis;
        self.square_m2 += innovation.square_m2;
        self.theta_m2 += innovation.theta_m2;
        self.rest_m2 += innovation.rest_m2;
        let bound = *CHI2_99.get(self.since as usize - 1)?;
        let room = INFLATION_MAX / self.inflation;
        if self.nis <= bound || room <= 1.0 {
            return None;
        }
        let explained = (self.square_m2 - self.rest_m2) / self.theta_m2;
        let factor = if explained.is_finite() { explained.clamp(1.0, room) } else { 1.0 };
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

    /// Stores the NIS of a pose that was used.
    pub(super) fn push(&mut self, nis: f64) {
        self.recent[self.recent_count as usize % RECENT] = nis;
        self.recent_count += 1;
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        let sums = [self.nis, self.square_m2, self.theta_m2, self.rest_m2];
        self.tested <= POSES_TESTED as u64
            && self.since <= self.tested
            && self.recent_count < COUNT_MAX
            && sums.iter().chain(&self.recent).all(|value| value.abs() <= SUM_MAX)
            // With the rounding of a product of factors.
            && (1.0..=INFLATION_MAX * (1.0 + 1e-9)).contains(&self.inflation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn innovation(nis: f64, square_m2: f64) -> PoseInnovation {
        PoseInnovation { nis, square_m2, theta_m2: 2.0, rest_m2: 1.0 }
    }

    #[test]
    fn a_consistent_prior_is_not_inflated() {
        let mut consistency = Consistency::start();
        for _ in 0..20 {
            assert_eq!(consistency.test(innovation(2.0, 3.0)), None);
            consistency.push(2.0);
        }
        assert_eq!(consistency.inflation(), 1.0);
        assert!(consistency.is_sound());
    }

    #[test]
    fn an_inconsistent_prior_is_inflated_to_the_observed_innovations_within_the_bound() {
        let mut consistency = Consistency::start();
        assert_eq!(consistency.test(innovation(9.0, 13.0)), None);
        // Both poses together: 26 m² observed, 2 m² from other sources, 4 m² from θ.
        assert_eq!(consistency.test(innovation(9.0, 13.0)), Some(6.0));
        assert_eq!(consistency.test(innovation(1e6, 1e6)), Some(100.0 / 6.0));
        assert_eq!(consistency.test(innovation(1e6, 1e6)), None);
        assert_eq!(consistency.inflation(), 100.0);
        let mut accepted = Consistency::start();
        accepted.accept();
        assert_eq!(accepted.test(innovation(1e6, 1e6)), None);
    }

    #[test]
    fn innovations_that_other_sources_explain_inflate_nothing() {
        let mut consistency = Consistency::start();
        assert_eq!(
            consistency.test(PoseInnovation { nis: 10.0, square_m2: 0.5, theta_m2: 2.0, rest_m2: 1.0 }),
            Some(1.0)
        );
        assert_eq!(consistency.inflation(), 1.0);
    }
}
