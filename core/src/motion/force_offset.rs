//! Slowly varying difference between the vertical force of the unloaded body and the weight in use: drift of the
//! plate's zero, an error of the mass, clothing.
//!
//! A scalar Kalman filter: the offset is a random walk, and its measurement is the external force while no load is
//! carried.

use bytemuck::{Pod, Zeroable};

use super::unloaded::{CORRELATION_S, ForceSigma};
use crate::math;

/// Drift of the charge amplifiers of piezoelectric plates by their data sheets, N/s; a uniform rate within this bound …
const DRIFT_N_PER_S: f64 = 0.01;
/// … changes the offset in this time, the typical interval between two unloaded intervals of work, s, as much as the
/// random walk.
const DRIFT_S: f64 = 60.0;
/// Rate of the random walk's variance, N²/s.
const WALK_N2_PER_S: f64 = DRIFT_N_PER_S * DRIFT_N_PER_S * DRIFT_S / 3.0;
/// Weight of the prior of the noise, in samples.
const SAMPLES_PRIOR: f64 = 60.0;
/// Averaging length of the noise, in samples.
const SAMPLES_KEPT: f64 = 6000.0;

/// Estimate of the offset, and of the noise of the vertical force at rest.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct ForceOffset {
    mean_n: f64,
    variance_n2: f64,
    /// Mean square of the external force about the offset at rest, N², and the number of samples in it.
    noise_n2: f64,
    samples: f64,
    /// The mass whose weight is in use, kg.
    mass_kg: f64,
}

impl ForceOffset {
    /// Ingests the mass in use, kg. Another one than before starts without an offset, with this 1-σ of its weight, N;
    /// the noise of the plate is kept.
    pub fn apply_mass(&mut self, mass_kg: f64, sigma_n: f64) {
        if mass_kg != self.mass_kg {
            self.mass_kg = mass_kg;
            (self.mean_n, self.variance_n2) = (0.0, sigma_n * sigma_n);
        }
    }

    /// Continues with a stored offset and its 1-σ, N, that were estimated with this mass, kg.
    pub fn resume(&mut self, mass_kg: f64, mean_n: f64, sigma_n: f64) {
        (self.mass_kg, self.mean_n, self.variance_n2) = (mass_kg, mean_n, sigma_n * sigma_n);
    }

    /// Discards the offset: the plate's zero has changed.
    pub fn reset(&mut self) {
        (self.mass_kg, self.mean_n) = (0.0, 0.0);
    }

    /// Ingests that the offset may have changed by this 1-σ, N.
    pub fn widen(&mut self, sigma_n: f64) {
        self.variance_n2 += sigma_n * sigma_n;
    }

    /// Ingests that `step_s` have passed.
    pub fn predict(&mut self, step_s: f64) {
        self.variance_n2 += WALK_N2_PER_S * step_s.max(0.0);
    }

    /// Ingests the external vertical force of an unloaded snapshot, N, from which the offset is already subtracted.
    pub fn update(&mut self, delta_f_n: f64, step_s: f64, sigma: ForceSigma) {
        if !(step_s > 0.0 && step_s < CORRELATION_S && delta_f_n.is_finite()) {
            return;
        }
        if sigma.by_motion_n < sigma.at_rest_n {
            self.samples = (self.samples + 1.0).min(SAMPLES_KEPT);
            // Of the mean square, the offset's own error is not noise. At most 3 σ, so that an outlier does not last.
            let limit_n2 = 9.0 * sigma.at_rest_n * sigma.at_rest_n;
            let noise_n2 = (delta_f_n * delta_f_n).min(limit_n2) - self.variance_n2;
            self.noise_n2 += (noise_n2.max(0.0) - self.noise_n2) / self.samples;
        }
        let one_n2 = sigma.at_rest_n * sigma.at_rest_n + sigma.by_motion_n * sigma.by_motion_n;
        // Samples within the correlation time count as one.
        let gain = self.variance_n2 / (self.variance_n2 + one_n2 * CORRELATION_S / step_s);
        self.mean_n += gain * delta_f_n;
        self.variance_n2 *= 1.0 - gain;
    }

    /// The offset, N.
    pub fn mean_n(&self) -> f64 {
        self.mean_n
    }

    /// 1-σ of the offset, N.
    pub fn mean_sigma_n(&self) -> f64 {
        math::sqrt(self.variance_n2)
    }

    /// The mass with which it was estimated, kg; 0 before any.
    pub fn mass_kg(&self) -> f64 {
        self.mass_kg
    }

    /// 1-σ of the external force at rest, N: of the offset, and of the noise with this prior.
    pub fn sigma_n(&self, prior_noise_n: f64) -> f64 {
        let noise_n2 = (self.samples * self.noise_n2 + SAMPLES_PRIOR * prior_noise_n * prior_noise_n)
            / (self.samples + SAMPLES_PRIOR);
        math::sqrt(self.variance_n2 + noise_n2)
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub fn is_sound(&self) -> bool {
        self.mean_n.is_finite()
            && self.mass_kg.is_finite()
            && [self.variance_n2, self.noise_n2].iter().all(|square| square.is_finite() && *square >= 0.0)
            && (0.0..=SAMPLES_KEPT).contains(&self.samples)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;

    /// Errors over σ of the offset of a plate that drifts at this rate, at the end of each unloaded minute between
    /// loaded ones, and the last σ.
    fn work(rate_n_per_s: f64) -> (Vec<f64>, f64) {
        let mut offset = ForceOffset::zeroed();
        offset.apply_mass(80.0, 2.0);
        let (step_s, mut errors) = (1.0 / 60.0, Vec::new());
        for step in 0..60 * 1200 {
            let time_s = f64::from(step) * step_s;
            let noise_n = if step % 2 == 0 { 1.0 } else { -1.0 };
            let sigma = ForceSigma { at_rest_n: offset.sigma_n(2.0), by_motion_n: 0.0 };
            offset.predict(step_s);
            if step / 3600 % 2 == 0 {
                let force_n = 1.5 + rate_n_per_s * time_s + noise_n;
                offset.update(force_n - offset.mean_n(), step_s, sigma);
            } else if step % 3600 == 3599 {
                let truth_n = 1.5 + rate_n_per_s * time_s;
                errors.push((offset.mean_n() - truth_n) / offset.sigma_n(2.0));
            }
        }
        (errors, offset.sigma_n(2.0))
    }

    #[test]
    fn the_offset_of_a_plate_that_drifts_is_tracked_within_its_sigma() {
        for rate_n_per_s in [0.0, 0.01, -0.01] {
            let (errors, sigma_n) = work(rate_n_per_s);
            assert!(errors.iter().all(|error| error.abs() < 2.0), "{rate_n_per_s}: {errors:?}");
            assert!((0.9..1.4).contains(&sigma_n), "noise of 1 N: {sigma_n} N");
        }
    }

    #[test]
    fn uncertainty_grows_without_measurements_and_a_reset_keeps_the_noise() {
        let mut offset = ForceOffset::zeroed();
        offset.apply_mass(80.0, 0.0);
        offset.predict(DRIFT_S);
        let grown_n = offset.sigma_n(0.0);
        assert!((grown_n - DRIFT_N_PER_S * DRIFT_S / 3.0_f64.sqrt()).abs() < 1e-12, "{grown_n}");
        for _ in 0..6000 {
            offset.update(1.0, 1.0 / 60.0, ForceSigma { at_rest_n: 2.0, by_motion_n: 0.0 });
        }
        let before_n = offset.sigma_n(2.0);
        offset.update(f64::NAN, 1.0 / 60.0, ForceSigma { at_rest_n: 2.0, by_motion_n: 0.0 });
        assert_eq!(offset.sigma_n(2.0), before_n);
        offset.reset();
        offset.apply_mass(80.0, 3.0);
        assert_eq!(offset.mean_n(), 0.0);
        assert!(offset.sigma_n(2.0) > 3.0 && offset.is_sound());
    }
}
