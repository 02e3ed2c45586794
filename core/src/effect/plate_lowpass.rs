//! `plate_lowpass`: first-order low pass of the plate, which delays and smooths its readings.
//!
//! It is not a column of an instant, because it has a state: the loop filters its prediction.

use bytemuck::{Pod, Zeroable};

use super::Parameter;
use crate::math;

pub(super) const PARAMETERS: [Parameter; 1] = [Parameter { name: "cutoff_hz", unit: "Hz", prior_sigma: 2.0 }];

/// First-order filter for signals sampled at irregular times: the signal is linear between two samples, and the
/// response to it is exact.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct LowPass {
    /// The newest sample, and the filter's output there.
    newest: f64,
    output: f64,
    /// 1 once there was a sample.
    started: u64,
}

impl LowPass {
    /// Ingests a sample, `step_s` after the previous one; returns the output of a filter with this cutoff. Initialised
    /// as if the first sample had been constant before.
    pub fn step(&mut self, cutoff_hz: f64, step_s: f64, value: f64) -> f64 {
        let per_s = core::f64::consts::TAU * cutoff_hz;
        let turned = per_s * step_s;
        // The comparison is false for NaN.
        let usable = turned > 0.0 && self.started == 1;
        self.output = match usable {
            true => {
                // In steady state the response to a line lags by one time constant.
                let late = (value - self.newest) / turned;
                value - late + (self.output - self.newest + late) * math::exp(-turned)
            }
            false if self.started == 1 => self.output,
            false => value,
        };
        self.newest = value;
        self.started = 1;
        self.output
    }

    /// Resets the filter: the next sample is the first.
    pub fn reset(&mut self) {
        *self = Zeroable::zeroed();
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub fn is_sound(&self) -> bool {
        self.newest.is_finite() && self.output.is_finite() && self.started <= 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CUTOFF_HZ: f64 = 2.0;

    /// At the cutoff, a first-order filter outputs 1/√2 of an oscillation, delayed by an eighth of a period.
    #[test]
    fn at_the_cutoff_the_gain_is_root_half_and_the_delay_an_eighth() {
        let mut filter: LowPass = Zeroable::zeroed();
        let (step_s, mut worst) = (0.002, 0.0_f64);
        for index in 0..5000 {
            let turn = core::f64::consts::TAU * CUTOFF_HZ * step_s * f64::from(index);
            let output = filter.step(CUTOFF_HZ, step_s, math::sin_cos(turn).0);
            let expected = math::sin_cos(turn - core::f64::consts::FRAC_PI_4).0 / math::sqrt(2.0);
            if index > 1000 {
                worst = worst.max((output - expected).abs());
            }
        }
        assert!(worst < 2e-4, "{worst}");
    }

    #[test]
    fn uneven_steps_along_a_line_end_where_even_ones_do() {
        let show = |steps: &[f64]| {
            let mut filter: LowPass = Zeroable::zeroed();
            let (mut time_s, mut output) = (0.0, filter.step(CUTOFF_HZ, 0.0, 0.0));
            for step_s in steps {
                time_s += step_s;
                output = filter.step(CUTOFF_HZ, *step_s, 3.0 * time_s);
            }
            output
        };
        let (even, uneven) = (show(&[0.01; 30]), show(&[0.05, 0.01, 0.2, 0.04]));
        assert!((even - uneven).abs() < 1e-12, "{even} {uneven}");
        // Nearly in steady state: late by one time constant.
        let late_s = 0.3 - show(&[0.3]) / 3.0;
        assert!((late_s - 0.0796).abs() < 0.003, "{late_s}");
    }

    #[test]
    fn a_constant_passes_unchanged() {
        let mut filter: LowPass = Zeroable::zeroed();
        assert!(
            [0.0, 0.01, -1.0, 0.5, f64::NAN].iter().all(|step| filter.step(CUTOFF_HZ, *step, 0.3) == 0.3)
        );
        assert!(filter.is_sound());
        filter.reset();
        assert_eq!(filter.step(CUTOFF_HZ, 0.01, -1.0), -1.0);
    }
}
