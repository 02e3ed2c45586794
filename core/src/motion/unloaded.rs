//! Detects whether the subject carries no load, and whether a detected load is still present.

use bytemuck::{Pod, Zeroable};

use crate::math;

/// The external force must average to zero over the last 2 s: a period of natural work, so that errors of the
/// compensation, which are proportional to the acceleration, cancel. Blocks of the window …
const BLOCKS: usize = 8;
/// … and the length of one, s.
const BLOCK_S: f64 = 0.25;
/// A mean below this many σ counts as zero.
const SIGMAS: f64 = 2.0;
/// A force that swings with the motion averages out like an acceleration: to a difference of velocities over the length
/// of the window. For `a sin ωt` that is at most `2/(ω T)` of its amplitude, 1/4 at 0.5 Hz and 2 s.
const SWING_LEFT: f64 = 0.25;
/// Detection limit of a load, in σ.
pub const SIGMAS_OF_A_LOAD: f64 = 2.5;
/// Correlation time of errors of a motion, s: samples within it count as one.
pub const CORRELATION_S: f64 = 0.5;

/// Mean external force below which no load is carried, N.
pub(crate) fn zero_limit_n(sigma_n: f64, threshold_n: f64) -> f64 {
    (SIGMAS * sigma_n).min(0.5 * threshold_n)
}

/// 1-σ of the external force, N.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForceSigma {
    /// σ of plate and body weight.
    pub at_rest_n: f64,
    /// σ of the compensated inertia in this motion.
    pub by_motion_n: f64,
}

/// Mean external force over a window of 2 s. A force that swings with the motion averages out; a load does not.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Unloaded {
    /// Impulses of the last complete blocks, N s, the oldest at `next` once all are filled.
    block_n_s: [f64; BLOCKS],
    next: u64,
    /// Filled blocks, in [0, 8].
    filled: u64,
    /// Impulse of the current block, N s, and its length so far, s.
    impulse_n_s: f64,
    length_s: f64,
    /// 1 while no load is carried.
    quiet: u64,
}

impl Unloaded {
    /// Ingests the external vertical force, N, `step_s` after the previous one; returns whether no load is carried.
    ///
    /// `threshold_n`: force above which a load counts; a mean of half of it exceeds the errors of the compensation.
    pub fn update(&mut self, delta_f_n: f64, step_s: f64, threshold_n: f64, sigma: ForceSigma) -> bool {
        let sudden_n = threshold_n + 3.0 * math::hypot([sigma.at_rest_n, sigma.by_motion_n]);
        if !delta_f_n.is_finite() || delta_f_n.abs() > sudden_n {
            self.clear();
            return false;
        }
        let step_s = step_s.clamp(0.0, BLOCK_S);
        self.impulse_n_s += delta_f_n * step_s;
        self.length_s += step_s;
        if self.length_s >= BLOCK_S * (1.0 - 1e-9) {
            // Scaled to the length of a block, because samples do not end at its boundary.
            self.block_n_s[self.next as usize % BLOCKS] = self.impulse_n_s * BLOCK_S / self.length_s;
            self.next = (self.next + 1) % BLOCKS as u64;
            self.filled = (self.filled + 1).min(BLOCKS as u64);
            (self.impulse_n_s, self.length_s) = (0.0, 0.0);
            let mean_n = self.block_n_s.iter().sum::<f64>() / (BLOCKS as f64 * BLOCK_S);
            let sigma_n = math::hypot([sigma.at_rest_n, SWING_LEFT * sigma.by_motion_n]);
            let is_zero = mean_n.abs() < zero_limit_n(sigma_n, threshold_n);
            self.quiet = u64::from(self.filled == BLOCKS as u64 && is_zero);
        }
        self.is_quiet()
    }

    /// Whether no load was carried over the window, at the last snapshot ingested.
    pub fn is_quiet(&self) -> bool {
        self.quiet == 1
    }

    /// Clears the window.
    pub fn clear(&mut self) {
        *self = Zeroable::zeroed();
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub fn is_sound(&self) -> bool {
        self.block_n_s.iter().chain([&self.impulse_n_s]).all(|impulse| impulse.is_finite())
            && self.next < BLOCKS as u64
            && self.filled <= BLOCKS as u64
            && (0.0..=2.0 * BLOCK_S).contains(&self.length_s)
            && self.quiet <= 1
    }
}

/// A detected load stays detected until the data contradict it (Page 1954, cumulative sum of log-likelihood ratios):
/// the hypotheses are the force of the load, by its mean since detection but at least the threshold, and zero. The
/// evidence is limited to that of a single force at the detection limit, so that as much evidence is needed against a
/// load as for it.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Load {
    /// Log-likelihood ratio of the load against zero; 0 while none is detected.
    evidence: f64,
    /// Mean force since detection, N, over the time `length_s`, s: of samples that are closer to it than to zero.
    mean_n: f64,
    length_s: f64,
    /// Time of the previous sample, ns.
    last_ns: u64,
}

/// Evidence of a force [`SIGMAS_OF_A_LOAD`] from zero for a load of that size.
const EVIDENCE_MAX: f64 = 0.5 * SIGMAS_OF_A_LOAD * SIGMAS_OF_A_LOAD;
/// Averaging time of the mean load, s, and minimum time after which a load is kept. Errors of a motion vary faster.
const MEAN_OVER_S: f64 = 1.0;
/// Longer steps are limited to this, s, because the force in a gap is unavailable.
const STEP_MAX_S: f64 = 0.1;

impl Load {
    /// Ingests the external vertical force, N, with its 1-σ; returns whether a load is present. Above `threshold_n` and
    /// [`SIGMAS_OF_A_LOAD`] σ a load is always detected.
    pub fn update(&mut self, delta_f_n: f64, sigma_n: f64, threshold_n: f64, time_ns: u64) -> bool {
        let step_s = (time_ns.saturating_sub(self.last_ns) as f64 * 1e-9).min(STEP_MAX_S);
        let detected = delta_f_n.abs() >= threshold_n.max(SIGMAS_OF_A_LOAD * sigma_n);
        if self.evidence <= 0.0 {
            *self = Zeroable::zeroed();
        }
        self.last_ns = time_ns;
        if !detected && self.evidence <= 0.0 {
            return false;
        }
        if self.evidence <= 0.0 {
            self.mean_n = delta_f_n;
        }
        let load_n = self.mean_n.signum() * self.mean_n.abs().max(threshold_n);
        let nearness = load_n * (delta_f_n - 0.5 * load_n);
        if nearness > 0.0 {
            self.length_s = (self.length_s + step_s).min(MEAN_OVER_S);
            self.mean_n += (delta_f_n - self.mean_n) * step_s / self.length_s.max(1e-9);
        }
        let ratio = nearness / (sigma_n * sigma_n).max(1e-12);
        self.evidence = (self.evidence + ratio * step_s / CORRELATION_S).clamp(0.0, EVIDENCE_MAX);
        detected || (self.evidence > 0.0 && self.length_s >= MEAN_OVER_S)
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub fn is_sound(&self) -> bool {
        (0.0..=EVIDENCE_MAX).contains(&self.evidence)
            && self.mean_n.is_finite()
            && (0.0..=MEAN_OVER_S).contains(&self.length_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    extern crate std;
    use std::vec::Vec;

    const REST: ForceSigma = ForceSigma { at_rest_n: 2.0, by_motion_n: 5.0 };

    fn run_detector(seconds: f64, unloaded: &mut Unloaded, force_n: impl Fn(f64) -> f64) -> bool {
        let mut last = false;
        for step in 0..(seconds * 100.0).round() as u32 {
            last = unloaded.update(force_n(f64::from(step) * 0.01), 0.01, 15.0, REST);
        }
        last
    }

    #[test]
    fn a_force_that_oscillates_about_zero_is_no_load_and_a_constant_one_is() {
        let mut unloaded = Unloaded::zeroed();
        assert!(!run_detector(1.9, &mut unloaded, |_| 0.0), "two seconds are not over");
        assert!(run_detector(5.0, &mut unloaded, |time_s| 12.0 * (6.0 * time_s).sin()));
        assert!(!run_detector(6.0, &mut unloaded, |_| 9.81), "a kilogram in the hand");
        assert!(run_detector(2.3, &mut unloaded, |_| 0.5));
    }

    #[test]
    fn a_sudden_force_ends_it_at_once() {
        let mut unloaded = Unloaded::zeroed();
        assert!(run_detector(4.0, &mut unloaded, |_| 0.0));
        assert!(!unloaded.update(60.0, 0.01, 15.0, REST));
        assert!(!run_detector(1.5, &mut unloaded, |_| 0.0));
        assert!(!unloaded.update(f64::NAN, 0.01, 15.0, REST) && unloaded.is_sound());
    }

    #[test]
    fn two_seconds_after_a_load_was_put_down_nothing_is_carried() {
        let mut unloaded = Unloaded::zeroed();
        assert!(!run_detector(20.0, &mut unloaded, |_| 110.0));
        assert!(!run_detector(1.9, &mut unloaded, |_| 1.0));
        assert!(run_detector(0.1, &mut unloaded, |_| 1.0));
    }

    #[test]
    fn a_kilogram_is_a_load_in_quick_motion_too_and_the_swing_of_a_squat_is_none() {
        let quick = ForceSigma { at_rest_n: 2.0, by_motion_n: 20.0 };
        let last = |force_n: &dyn Fn(f64) -> f64| {
            let mut unloaded = Unloaded::zeroed();
            (0..1000)
                .map(|step| unloaded.update(force_n(f64::from(step) * 0.01), 0.01, 15.0, quick))
                .fold(false, |_, now| now)
        };
        // A squat of 3 s whose inertia is compensated to within 30 N.
        let swing = |time_s: f64| 30.0 * (core::f64::consts::TAU * time_s / 3.0).sin();
        assert!(!last(&|time_s| 9.81 + 0.1 * swing(time_s)));
        assert!(last(&|time_s| 0.3 * swing(time_s)));
    }

    fn run_load(
        load: &mut Load,
        from_ns: &mut u64,
        seconds: f64,
        sigma_n: f64,
        force_n: impl Fn(f64) -> f64,
    ) -> Vec<bool> {
        (0..(seconds * 100.0).round() as u32)
            .map(|step| {
                *from_ns += 10_000_000;
                load.update(force_n(f64::from(step) * 0.01), sigma_n, 15.0, *from_ns)
            })
            .collect()
    }

    #[test]
    fn a_load_does_not_vanish_because_sigma_rises_and_is_gone_when_it_is_put_down() {
        let (mut load, mut now_ns) = (Load::zeroed(), 1_000_000_000);
        assert!(run_load(&mut load, &mut now_ns, 1.0, 10.0, |_| 110.0).iter().all(|loaded| *loaded));
        // The detection limit is 150 N now.
        let swinging = |time_s: f64| 110.0 + 60.0 * (4.0 * time_s).sin();
        assert!(run_load(&mut load, &mut now_ns, 5.0, 60.0, swinging).iter().all(|loaded| *loaded));
        assert!(run_load(&mut load, &mut now_ns, 0.05, 2.0, |_| 0.0).iter().skip(1).all(|loaded| !*loaded));
        let (mut load, mut now_ns) = (Load::zeroed(), 1_000_000_000);
        run_load(&mut load, &mut now_ns, 1.0, 20.0, |_| 110.0);
        let gone = run_load(&mut load, &mut now_ns, 1.0, 20.0, |_| 0.0);
        assert!(!gone[50] && load.is_sound(), "half a second in motion");
    }

    #[test]
    fn a_single_outlier_is_no_load_for_long() {
        let (mut load, mut now_ns) = (Load::zeroed(), 1_000_000_000);
        run_load(&mut load, &mut now_ns, 0.1, 10.0, |_| 0.0);
        let spike =
            run_load(&mut load, &mut now_ns, 1.0, 10.0, |time_s| if time_s < 0.015 { 30.0 } else { 0.0 });
        assert!(spike[0] && spike[4..].iter().all(|loaded| !*loaded), "{spike:?}");
        let fading = |time_s: f64| 30.0 * (1.0 - 2.0 * time_s).max(0.0);
        let faded = run_load(&mut load, &mut now_ns, 3.0, 10.0, fading);
        assert!(faded[0] && faded[200..].iter().all(|loaded| !*loaded), "{faded:?}");
    }
}
