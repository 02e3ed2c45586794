//! Model error of the CoP: bone lengths that change with the posture, soft tissue, shoes.
//!
//! Innovations larger than expected from P and R are an error that no number of poses averages out. Their excess
//! variance is added to R and to every σ of the estimated CoP (the random effect of DerSimonian and Laird 1986), so
//! that inconsistency increases the published σ and blocks nothing.

use bytemuck::{Pod, Zeroable};

/// Averaging length of the excess, in motion samples.
const ROWS_AVERAGED: f64 = 300.0;
/// Limit of a single squared innovation, in variances: contacts and stumbles are no model error.
const SQUARE_MAX: f64 = 10.8;

/// Upper bound of the excess, m²: a CoP error of 10 m is larger than any plate.
const EXCESS_MAX_M2: f64 = 100.0;

/// Excess variance of the CoP per axis, forward and sideways.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Misfit {
    excess_m2: [f64; 2],
}

impl Misfit {
    /// Variance, m².
    pub(super) fn variance_m2(&self) -> [f64; 2] {
        self.excess_m2
    }

    /// Continues from a stored variance, m².
    pub(super) fn restore(&mut self, variance_m2: [f64; 2]) {
        self.excess_m2 = variance_m2;
    }

    /// Ingests innovations with their expected variances, m², model error included; `rows`: their weight in motion
    /// samples.
    pub(super) fn update(&mut self, innovation_m: [f64; 2], variance_m2: [f64; 2], rows: f64) {
        for axis in 0..2 {
            let square_m2 = (innovation_m[axis] * innovation_m[axis]).min(SQUARE_MAX * variance_m2[axis]);
            let excess_m2 = &mut self.excess_m2[axis];
            *excess_m2 = (*excess_m2 + (square_m2 - variance_m2[axis]) * rows / ROWS_AVERAGED).max(0.0);
        }
    }

    pub(super) fn is_sound(&self) -> bool {
        self.excess_m2.iter().all(|excess| (0.0..=EXCESS_MAX_M2).contains(excess))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn excess_variance_is_estimated_and_expected_innovations_leave_none() {
        let mut misfit = Misfit::zeroed();
        for index in 0..5000 {
            let sign = if index % 2 == 0 { 1.0 } else { -1.0 };
            let variance_m2 = misfit.variance_m2().map(|excess| excess + 4e-6);
            misfit.update([sign * 0.005, sign * 0.002], variance_m2, 1.0);
        }
        let [forward, sideways] = misfit.variance_m2();
        assert!((forward - 21e-6).abs() < 1e-7 && sideways < 1e-9, "{forward} {sideways}");
        let one = misfit.variance_m2()[1];
        misfit.update([0.0, 1.0], [25e-6, 4e-6], 1.0);
        assert!(misfit.variance_m2()[1] < one + 1e-6 && misfit.is_sound());
    }
}
