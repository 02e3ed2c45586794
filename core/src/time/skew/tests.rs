extern crate std;
use std::boxed::Box;
use std::vec::Vec;

use super::*;

const S_NS: f64 = 1e9;
const GRAVITY_M_PER_S2: f64 = 9.81;

/// Pseudo-random numbers from a seed.
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

/// Squats of varying depth and pace: the height of the CoM is a sum of smooth steps, so that its second derivative is
/// given without the estimator's filters.
struct Squats(Vec<[f64; 3]>);

impl Squats {
    /// Steps of (height m, middle s, rate 1/s).
    fn of(seed: u64, seconds: f64) -> Squats {
        let mut random = Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15));
        let (mut steps, mut at_s) = (Vec::new(), 3.0);
        while at_s < seconds {
            let depth_m = 0.15 + 0.2 * random.uniform();
            let rate_per_s = 4.0 + 4.0 * random.uniform();
            steps.push([-depth_m, at_s, rate_per_s]);
            at_s += 1.3 + 1.2 * random.uniform();
            steps.push([depth_m, at_s, rate_per_s]);
            at_s += 1.3 + 2.0 * random.uniform();
        }
        Squats(steps)
    }

    /// Height, m, and its second derivative, m/s².
    fn at(&self, time_s: f64) -> [f64; 2] {
        let mut sum = [1.0, 0.0];
        for [height_m, middle_s, rate_per_s] in &self.0 {
            let u = rate_per_s * (time_s - middle_s);
            if u.abs() < 30.0 {
                let level = 1.0 / (1.0 + (-u).exp());
                sum[0] += height_m * level;
                sum[1] += height_m * rate_per_s * rate_per_s * level * (1.0 - level) * (1.0 - 2.0 * level);
            } else if u > 0.0 {
                sum[0] += height_m;
            }
        }
        sum
    }
}

/// A session; the suit's stamps are later than the ground's by `late_s + drift · t`.
#[derive(Clone, Copy)]
struct Run {
    late_s: f64,
    drift: f64,
    /// Time of a change of the delay, and its size, s.
    step: Option<[f64; 2]>,
    seconds: f64,
    suit_hz: f64,
    ground_hz: f64,
    mass_kg: f64,
    /// Mass of a box that is lifted and put down every few seconds, kg.
    box_kg: f64,
    /// White noise of height, m, and force, N, per sample.
    noise: [f64; 2],
}

const RUN: Run = Run {
    late_s: 0.0,
    drift: 0.0,
    step: None,
    seconds: 60.0,
    suit_hz: 100.0,
    ground_hz: 1000.0,
    mass_kg: 72.0,
    box_kg: 0.0,
    noise: [0.0005, 3.0],
};

const START_S: f64 = 10.0;

impl Run {
    fn late_at_s(&self, time_s: f64) -> f64 {
        let step_s = self.step.filter(|[at_s, _]| time_s >= *at_s).map_or(0.0, |[_, by_s]| by_s);
        self.late_s + self.drift * time_s + step_s
    }

    /// Feeds an estimator in the order of the stamps; calls `each` after each suit sample, with the true time.
    fn feed(&self, seed: u64, mut each: impl FnMut(f64, u64, &SkewEstimator)) -> Box<SkewEstimator> {
        let (squats, mut random) = (Squats::of(seed, self.seconds), Random(seed));
        let mut estimator: Box<SkewEstimator> = bytemuck::zeroed_box();
        let mut samples: Vec<(u64, f64, bool)> = Vec::new();
        for number in 0..(self.seconds * self.suit_hz) as u64 {
            let time_s = number as f64 / self.suit_hz;
            samples.push((((START_S + time_s + self.late_at_s(time_s)) * S_NS) as u64, time_s, true));
        }
        for number in 0..(self.seconds * self.ground_hz) as u64 {
            let time_s = number as f64 / self.ground_hz;
            samples.push((((START_S + time_s) * S_NS) as u64, time_s, false));
        }
        samples.sort_by_key(|(stamp_ns, ..)| *stamp_ns);
        for (stamp_ns, time_s, is_suit) in samples {
            let [height_m, up_m_per_s2] = squats.at(time_s);
            if is_suit {
                estimator.push_height(stamp_ns, height_m + self.noise[0] * random.normal());
                each(time_s, stamp_ns, &estimator);
            } else {
                let box_kg = if (time_s / 5.0) as u64 % 2 == 1 { self.box_kg } else { 0.0 };
                let force_n = (self.mass_kg + box_kg) * (GRAVITY_M_PER_S2 + up_m_per_s2);
                estimator.push_force(stamp_ns, force_n + self.noise[1] * random.normal());
            }
        }
        assert!(estimator.is_sound());
        estimator
    }

    /// Skew at the end, and its error, s.
    fn skew(&self, seed: u64) -> Option<(Skew, f64)> {
        let estimator = self.feed(seed, |_, _, _| {});
        let skew = estimator.at(estimator.suit.newest_ns)?;
        Some((skew, skew.skew_s - self.late_at_s(self.seconds)))
    }
}

#[test]
fn lags_of_up_to_half_a_second_are_found_within_their_sigma() {
    for late_s in [-0.47, -0.25, -0.138, -0.013, 0.0, 0.007, 0.1, 0.3, 0.47] {
        let (skew, error_s) = Run { late_s, ..RUN }.skew(3).expect("a minute of squats");
        assert!(skew.sigma_s < 0.005 && error_s.abs() < 3.0 * skew.sigma_s, "{late_s}: {error_s} {skew:?}");
        assert!(error_s.abs() < 0.003, "{late_s}: {error_s}");
    }
}

#[test]
fn sample_rates_do_not_shift_the_lag() {
    for (suit_hz, ground_hz) in [(30.0, 1000.0), (59.94, 100.0), (120.0, 200.0), (240.0, 2000.0)] {
        let run = Run { late_s: -0.06, suit_hz, ground_hz, noise: [0.0, 0.0], ..RUN };
        let (_, error_s) = run.skew(5).expect("a minute of squats");
        assert!(error_s.abs() < 0.001, "{suit_hz} and {ground_hz} Hz: {error_s}");
    }
}

#[test]
fn mass_and_a_box_that_is_lifted_and_put_down_do_not_matter() {
    let estimate = |mass_kg, box_kg| Run { late_s: 0.138, mass_kg, box_kg, ..RUN }.skew(2).unwrap();
    let (plain, _) = estimate(72.0, 0.0);
    let (heavy, _) = estimate(105.0, 0.0);
    assert!((plain.skew_s - heavy.skew_s).abs() < 1e-3);
    let (lifting, error_s) = estimate(72.0, 11.0);
    assert!(error_s.abs() < 0.010 && error_s.abs() < 3.0 * lifting.sigma_s, "{error_s} {lifting:?}");
}

#[test]
fn drift_is_detected_and_tracked() {
    for (drift, late_s) in [(-400e-6, -0.138), (1000e-6, 0.0), (0.0, 0.2)] {
        let short = Run { drift, late_s, ..RUN }.skew(1).unwrap();
        assert!((short.0.drift - drift).abs() < 200e-6 && short.1.abs() < 0.010, "{short:?}");
        let long = Run { drift, late_s, seconds: 300.0, ..RUN }.skew(1).unwrap();
        assert!((long.0.drift - drift).abs() < 50e-6 && long.1.abs() < 0.005, "{long:?}");
        assert!(long.0.drift_sigma < short.0.drift_sigma);
    }
}

#[test]
fn a_delay_that_changes_is_detected_and_estimated_again() {
    for by_s in [0.3, -0.15] {
        let run = Run { late_s: 0.02, step: Some([60.0, by_s]), seconds: 100.0, ..RUN };
        let (mut contradicted_s, mut found_s) = (None, None);
        run.feed(4, |time_s, stamp_ns, estimator| {
            let error_s = estimator.at(stamp_ns).map(|skew| (skew.skew_s - run.late_at_s(time_s)).abs());
            if (20.0..60.0).contains(&time_s) {
                assert!(error_s.is_some_and(|error_s| error_s < 0.01), "{time_s} s: {error_s:?}");
            } else if time_s >= 60.0 {
                contradicted_s = contradicted_s.or(error_s.is_none().then_some(time_s));
                found_s = found_s.or(error_s.filter(|error_s| *error_s < 0.01).map(|_| time_s));
            }
        });
        let (contradicted_s, found_s) = (contradicted_s.unwrap(), found_s.unwrap());
        assert!(contradicted_s < 60.0 + 2.0 * WINDOW_S, "{by_s}: {contradicted_s}");
        assert!(found_s < 60.0 + 4.0 * WINDOW_S, "{by_s}: {found_s}");
    }
}

#[test]
fn without_motion_or_with_periodic_motion_no_lag_is_found() {
    let feed = |height_m: &dyn Fn(f64) -> f64, force_n: &dyn Fn(f64) -> f64| {
        let (mut estimator, mut random) = (bytemuck::zeroed_box::<SkewEstimator>(), Random(9));
        for millisecond in 0..60_000_u64 {
            let (stamp_ns, time_s) = (1_000_000 * (1000 + millisecond), millisecond as f64 * 1e-3);
            estimator.push_force(stamp_ns, force_n(time_s) + 3.0 * random.normal());
            if millisecond % 10 == 0 {
                estimator.push_height(stamp_ns, height_m(time_s) + 0.0005 * random.normal());
            }
            assert!(estimator.at(stamp_ns).is_none() && estimator.tentative_s().is_none());
        }
    };
    feed(&|_| 1.0, &|_| 706.0);
    // Steps at 2.5 Hz: half a second is longer than a period.
    let omega = 2.5 * core::f64::consts::TAU;
    feed(&|time_s| 0.02 * (omega * time_s).sin(), &|time_s| {
        -72.0 * 0.02 * omega * omega * (omega * time_s).sin()
    });
}

#[test]
fn a_gap_restarts_the_window_and_keeps_the_estimate() {
    let mut estimator = Run { late_s: 0.1, ..RUN }.feed(6, |_, _, _| {});
    let before = estimator.at(estimator.suit.newest_ns).unwrap();
    let later_ns = estimator.suit.newest_ns + 3_000_000_000;
    for number in 0..300 {
        estimator.push_height(later_ns + number * 10_000_000, 1.0);
        estimator.push_force(later_ns + number * 10_000_000, 700.0);
    }
    let after = estimator.at(later_ns).unwrap();
    assert!((after.skew_s - before.skew_s).abs() < before.sigma_s && after.sigma_s > before.sigma_s);
    assert_eq!(estimator.complete, 0);
    assert!(estimator.is_sound());
}

#[test]
fn errors_lie_within_sigma_as_often_as_they_should() {
    let errors: Vec<f64> = (1..=40)
        .map(|seed| {
            let run = Run { late_s: -0.1, drift: 300e-6, box_kg: 11.0, noise: [0.002, 10.0], ..RUN };
            let (skew, error_s) = run.skew(seed).unwrap();
            error_s / skew.sigma_s
        })
        .collect();
    let within = |sigmas: f64| errors.iter().filter(|error| error.abs() < sigmas).count();
    std::println!("of 40: {} within 1 sigma, {} within 2", within(1.0), within(2.0));
    assert!(within(1.0) >= 24 && within(2.0) >= 37, "{errors:?}");
}

#[test]
fn a_damaged_estimator_is_not_sound() {
    let sound = Run { seconds: 30.0, ..RUN }.feed(1, |_, _, _| {});
    assert!(sound.is_sound() && SkewEstimator::zeroed().is_sound());
    let damages: [fn(&mut SkewEstimator); 5] = [
        |estimator| estimator.blocks[1].product[3] = f64::NAN,
        |estimator| estimator.cells = BLOCK,
        |estimator| estimator.next = u64::MAX,
        |estimator| estimator.track.covariance[0] = -1.0,
        |estimator| estimator.suit.cell += 5,
    ];
    for damage in damages {
        let mut estimator = sound.clone();
        damage(&mut estimator);
        assert!(!estimator.is_sound());
    }
}
