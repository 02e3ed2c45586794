extern crate std;
use std::vec::Vec;

use super::*;
use bytemuck::Zeroable;

const RATE_HZ: f64 = 60.0;

/// Numbers from a seed.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// A quantity that moves: three sines and smooth steps.
struct Motion {
    /// Amplitude, angular frequency (rad/s), phase.
    sines: [[f64; 3]; 3],
    /// Height and middle (s) of each step.
    steps: Vec<[f64; 2]>,
}

impl Motion {
    fn of(random: &mut Random, seconds: f64) -> Motion {
        let sines = [0.3, 0.8, 1.7].map(|hertz| {
            let frequency = hertz * (0.8 + 0.4 * random.uniform());
            [0.4 + 0.3 * random.uniform(), core::f64::consts::TAU * frequency, 6.0 * random.uniform()]
        });
        let mut steps = Vec::new();
        let mut at_s = 0.0;
        while at_s < seconds {
            at_s += 1.0 + 4.0 * random.uniform();
            steps.push([random.normal(), at_s]);
        }
        Motion { sines, steps }
    }

    /// Value and rate of change.
    fn at(&self, time_s: f64) -> [f64; 2] {
        const RISE_PER_S: f64 = 12.0;
        let mut sum = [0.0; 2];
        for [amplitude, omega, phase] in self.sines {
            let angle = omega * time_s + phase;
            sum[0] += amplitude * angle.sin();
            sum[1] += amplitude * omega * angle.cos();
        }
        for [height, middle_s] in &self.steps {
            let level = 1.0 / (1.0 + (-RISE_PER_S * (time_s - middle_s)).exp());
            sum[0] += height * level;
            sum[1] += height * RISE_PER_S * level * (1.0 - level);
        }
        sum
    }
}

struct Run {
    skew_s: f64,
    seconds: f64,
    /// RMS of the noise, and how long it stays alike, s.
    noise: f64,
    alike_s: f64,
    offset: f64,
    rate_hz: f64,
}

impl Default for Run {
    fn default() -> Run {
        Run { skew_s: 0.0, seconds: 60.0, noise: 0.15, alike_s: 0.15, offset: 0.0, rate_hz: RATE_HZ }
    }
}

impl Run {
    fn feed(&self, estimator: &mut SkewEstimator, seed: u64) {
        let mut random = Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15));
        let motion = Motion::of(&mut random, self.seconds);
        let dt_s = 1.0 / self.rate_hz;
        let rho = (-dt_s / self.alike_s).exp();
        let mut noise = self.noise * random.normal();
        for index in 0..(self.seconds * self.rate_hz) as u64 {
            let time_s = index as f64 * dt_s;
            noise = rho * noise + self.noise * (1.0 - rho * rho).sqrt() * random.normal();
            let [predicted, slope_per_s] = motion.at(time_s - self.skew_s);
            let measured = motion.at(time_s)[0] + self.offset + noise;
            // The caller believes in a noise that is far too small.
            estimator.update(measured, predicted, slope_per_s, 0.01, dt_s);
            if let Some((skew_s, sigma_s)) = estimator.estimate() {
                assert!(skew_s.is_finite() && sigma_s > 0.0 && sigma_s < TOLD_SIGMA_S);
            }
        }
        assert!(estimator.is_sound());
    }

    fn of(&self, seed: u64) -> SkewEstimator {
        let mut estimator = SkewEstimator::zeroed();
        self.feed(&mut estimator, seed);
        estimator
    }
}

#[test]
fn the_skew_is_found_within_its_sigma_whatever_its_sign() {
    let (mut runs, mut within, mut square) = (0.0, 0.0, 0.0);
    for skew_ms in [-40.0, -20.0, -5.0, 0.0, 5.0, 20.0, 40.0] {
        let mut mean_s = 0.0;
        for seed in 1..=12 {
            let run = Run { skew_s: 1e-3 * skew_ms, ..Run::default() };
            let (skew_s, sigma_s) = run.of(seed).estimate().expect("a minute of motion");
            let error = (skew_s - run.skew_s) / sigma_s;
            runs += 1.0;
            within += f64::from(u8::from(error.abs() <= 2.0));
            square += error * error;
            mean_s += (skew_s - run.skew_s) / 12.0;
        }
        std::println!("{skew_ms} ms: {:.2} ms off in the mean", 1e3 * mean_s);
        assert!(mean_s.abs() < 1.5e-3, "{skew_ms} ms: {mean_s} s off in the mean");
    }
    assert!(within / runs >= 0.9, "{within} of {runs}");
    // Nor is σ so large that it says nothing.
    let spread = f64::sqrt(square / runs);
    std::println!("{within} of {runs} within 2 σ; errors are {spread:.2} σ");
    assert!((0.25..1.3).contains(&spread), "errors are {spread} σ");
}

#[test]
fn a_fast_suit_shows_the_same() {
    for skew_s in [-0.04, 0.03] {
        let run = Run { skew_s, rate_hz: 240.0, ..Run::default() };
        let (found_s, sigma_s) = run.of(3).estimate().expect("a minute of motion");
        assert!((found_s - skew_s).abs() <= 2.5 * sigma_s, "{found_s} ± {sigma_s}");
    }
}

#[test]
fn sigma_shrinks_with_motion_and_grows_again_without() {
    let mut estimator = SkewEstimator::zeroed();
    let sigma_s = |estimator: &SkewEstimator| estimator.posterior()[1].sqrt();
    let mut before_s = sigma_s(&estimator);
    assert!((before_s - PRIOR_SIGMA_S).abs() < 1e-12);
    for seed in [1, 2, 3] {
        Run { skew_s: 0.012, seconds: 40.0, ..Run::default() }.feed(&mut estimator, seed);
        assert!(sigma_s(&estimator) < before_s);
        before_s = sigma_s(&estimator);
    }
    for _ in 0..(400.0 * RATE_HZ) as u64 {
        estimator.update(0.0, 0.0, 0.0, 0.01, 1.0 / RATE_HZ);
    }
    assert!(sigma_s(&estimator) > before_s, "what was long ago is not believed for ever");
}

#[test]
fn nothing_moves_nothing_is_known() {
    let mut random = Random(7);
    for noise in [0.0, 0.2] {
        let mut estimator = SkewEstimator::zeroed();
        for _ in 0..(300.0 * RATE_HZ) as u64 {
            estimator.update(9.0 + noise * random.normal(), 8.0, 0.0, 0.01, 1.0 / RATE_HZ);
            assert_eq!(estimator.estimate(), None);
        }
        assert!(estimator.is_sound());
    }
}

#[test]
fn an_offset_between_both_sides_changes_nothing() {
    let estimate = |offset| Run { skew_s: 0.02, offset, ..Run::default() }.of(5).estimate().unwrap();
    let (plain, shifted) = (estimate(0.0), estimate(40.0));
    assert!(
        (plain.0 - shifted.0).abs() < 1e-6 && (plain.1 - shifted.1).abs() < 1e-6,
        "{plain:?} {shifted:?}"
    );
}

#[test]
fn more_noise_and_slower_noise_make_it_less_sure() {
    let sigma_s = |noise, alike_s| {
        let run = Run { noise, alike_s, ..Run::default() };
        (1..=6).map(|seed| run.of(seed).posterior()[1].sqrt()).sum::<f64>() / 6.0
    };
    let plain = sigma_s(0.1, 0.05);
    assert!(sigma_s(0.2, 0.05) > 1.5 * plain);
    assert!(sigma_s(0.1, 0.4) > 1.5 * plain, "samples that are alike are not as many");
}

#[test]
fn a_skew_that_changes_is_followed() {
    let mut estimator = SkewEstimator::zeroed();
    Run { skew_s: -0.010, seconds: 120.0, ..Run::default() }.feed(&mut estimator, 1);
    Run { skew_s: 0.015, seconds: 900.0, ..Run::default() }.feed(&mut estimator, 2);
    let (skew_s, sigma_s) = estimator.estimate().unwrap();
    assert!((skew_s - 0.015).abs() < 2.0 * sigma_s + 0.001, "{skew_s} ± {sigma_s}");
}

#[test]
fn bad_samples_gaps_and_extremes_never_make_a_nan() {
    let mut estimator = Run { skew_s: 0.01, ..Run::default() }.of(4);
    let before = bytemuck::bytes_of(&estimator).to_vec();
    for bad in [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e300] {
        for place in 0..5 {
            let mut values = [0.1, 0.1, 0.1, 0.1, 0.01];
            values[place] = bad;
            let [measured, predicted, slope_per_s, sigma, dt_s] = values;
            estimator.update(measured, predicted, slope_per_s, sigma, dt_s);
        }
    }
    for (sigma, dt_s) in [(0.0, 0.01), (-1.0, 0.01), (0.1, 0.0), (0.1, -1.0)] {
        estimator.update(0.1, 0.1, 0.1, sigma, dt_s);
    }
    assert_eq!(bytemuck::bytes_of(&estimator), before, "what is refused changes nothing");

    let mut random = Random(11);
    for _ in 0..20_000 {
        let mut value = || 10f64.powf(24.0 * random.uniform() - 16.0) * random.normal();
        let values = [value(), value(), value()];
        let (sigma, dt_s) = (value().abs(), 0.02 * value().abs().min(10.0));
        estimator.update(values[0], values[1], values[2], sigma, dt_s);
        assert!(estimator.posterior().iter().all(|value| value.is_finite()));
        assert!(estimator.is_sound());
    }
}

#[test]
fn a_gap_costs_little() {
    let mut estimator = SkewEstimator::zeroed();
    for seed in 1..=6 {
        Run { skew_s: 0.02, seconds: 12.0, ..Run::default() }.feed(&mut estimator, seed);
        estimator.update(5.0, -3.0, 1.0, 0.01, 3.0);
    }
    let (skew_s, sigma_s) = estimator.estimate().expect("more than a minute of motion");
    assert!((skew_s - 0.02).abs() < 2.5 * sigma_s, "{skew_s} ± {sigma_s}");
}

#[test]
fn several_quantities_are_surer_than_one_and_contradiction_is_less_sure() {
    let of = |skew_s, seed| Run { skew_s, ..Run::default() }.of(seed);
    let agreeing = [of(0.02, 1), of(0.02, 2), SkewEstimator::zeroed()];
    let (skew_s, sigma_s) = joint(&agreeing).unwrap();
    assert!((skew_s - 0.02).abs() < 2.5 * sigma_s, "{skew_s} ± {sigma_s}");
    assert!(agreeing[..2].iter().all(|one| sigma_s < one.estimate().unwrap().1));
    assert_eq!(joint(&[]), None);
    assert_eq!(joint(&[SkewEstimator::zeroed()]), None);
    let contradicting = joint(&[of(-0.03, 1), of(0.03, 2)]);
    assert!(contradicting.is_none_or(|(_, contradicting_s)| contradicting_s > 2.0 * sigma_s));
}

#[test]
fn a_damaged_estimator_is_not_sound() {
    let mut estimator = Run::default().of(1);
    assert!(estimator.is_sound() && SkewEstimator::zeroed().is_sound());
    estimator.xx = f64::NAN;
    assert!(!estimator.is_sound());
}
