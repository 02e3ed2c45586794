extern crate std;

use super::*;

const PERIOD_NS: f64 = 1e9 / 240.0;
const START_NS: u64 = 77_000_000_000_000;

/// Exponential delays from a fixed seed.
struct Jitter {
    state: u64,
    mean_ns: f64,
}

impl Jitter {
    fn next_ns(&mut self) -> f64 {
        self.state =
            self.state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let uniform = ((self.state >> 11) as f64 + 0.5) / (1u64 << 53) as f64;
        -self.mean_ns * uniform.ln()
    }
}

/// Feeds `seconds` of a stream that is `drift` too slow; returns (error, σ) of every estimate, ns.
fn run(seconds: u64, drift: f64, mean_jitter_ns: f64) -> std::vec::Vec<(f64, f64)> {
    let mut fit = ClockFit::new();
    let mut jitter = Jitter { state: 42, mean_ns: mean_jitter_ns };
    let (mut last_arrival, mut last_estimate) = (0, 0);
    let mut results = std::vec::Vec::new();
    for index in 0..seconds * 240 {
        let taken_ns = START_NS + (index as f64 * PERIOD_NS * (1.0 + drift)) as u64;
        let arrival_ns = (taken_ns + jitter.next_ns() as u64).max(last_arrival);
        last_arrival = arrival_ns;
        fit.observe(1000 + index, arrival_ns);
        if let Some(estimate) = fit.estimate(1000 + index) {
            assert!(estimate.host_ns <= arrival_ns, "a sample is not taken after it arrived");
            assert!(estimate.host_ns >= last_estimate, "time does not run backwards");
            last_estimate = estimate.host_ns;
            let error = estimate.host_ns as f64 - taken_ns as f64;
            results.push((error, estimate.sigma_ns as f64));
        }
    }
    results
}

#[test]
fn jitter_is_rejected_and_drift_is_tracked() {
    for drift in [0.0, 50e-6, -50e-6] {
        let settled = run(90, drift, 1e6).split_off(30 * 240);
        let worst = settled.iter().fold(0.0f64, |worst, (error, _)| worst.max(error.abs()));
        assert!(worst < 60e3, "drift {drift}: {worst} ns, although the mean delay is 1 ms");
    }
}

#[test]
fn sigma_covers_the_errors() {
    for mean_jitter_ns in [50e3, 1e6, 5e6] {
        let results = run(60, 20e-6, mean_jitter_ns);
        let within = results.iter().filter(|(error, sigma)| error.abs() <= 3.0 * sigma).count();
        assert!(within as f64 > 0.95 * results.len() as f64, "{within} of {} within 3 σ", results.len());
        let (_, last_sigma) = results[results.len() - 1];
        assert!(last_sigma < 0.1 * mean_jitter_ns + 2e3, "{last_sigma} of {mean_jitter_ns}");
    }
}

#[test]
fn an_early_arrival_reveals_the_delay_of_the_others() {
    // All samples are delayed by 5 ms, until one is not: estimates adapt gradually, with the deviation in their σ.
    let mut fit = ClockFit::new();
    for index in 0..40 {
        let taken_ns = START_NS + index * 4_000_000;
        fit.observe(index, taken_ns + if index < 30 { 5_000_000 } else { 0 });
        let Some(estimate) = fit.estimate(index) else { continue };
        let error_ns = estimate.host_ns.abs_diff(taken_ns);
        assert!(index < 30 || error_ns <= estimate.sigma_ns, "{index}: {error_ns} ns and {estimate:?}");
    }
}

#[test]
fn a_few_samples_are_enough_and_fewer_are_not() {
    let mut fit = ClockFit::new();
    assert_eq!(fit.estimate(0), None);
    for index in 0..MIN_SAMPLES {
        assert_eq!(fit.estimate(index), None);
        fit.observe(index, START_NS + index * 4_000_000);
    }
    let estimate = fit.estimate(MIN_SAMPLES - 1).unwrap();
    assert!(estimate.host_ns.abs_diff(START_NS + (MIN_SAMPLES - 1) * 4_000_000) < 10, "{estimate:?}");
    assert!((fit.period_ns().unwrap() - 4e6).abs() < 1.0);
}

#[test]
fn a_counter_that_paused_or_jumped_gets_a_new_line() {
    // Ten seconds of silence in which the device did not count; then a jump of 1000 counts at once.
    for (silence_ns, jump) in [(10_000_000_000, 0), (0, 1000)] {
        let mut fit = ClockFit::new();
        for index in 0..2400u64 {
            let (pause, jumped) = if index < 1200 { (0, 0) } else { (silence_ns, jump) };
            let arrival_ns = START_NS + index * 4_000_000 + pause;
            fit.observe(index + jumped, arrival_ns);
            let Some(estimate) = fit.estimate(index + jumped) else { continue };
            let error = arrival_ns.abs_diff(estimate.host_ns);
            assert!(error < 1000 || error <= estimate.sigma_ns + 1000, "{index}: {error} {estimate:?}");
        }
        assert!(fit.estimate(2400 + jump).unwrap().sigma_ns < 2000);
    }
}

/// Feeds 40 s of 250 Hz whose samples wait; asserts that the error of an estimate is within 3 σ or 1 ms of zero, or of
/// the first error of its epoch; with `exempts_epochs` only in epoch 0. Returns the last epoch, and the number of
/// estimates with σ below 1 ms while no sample waits.
fn wait(exempts_epochs: bool, waits_ns: impl Fn(u64) -> u64) -> (u32, usize) {
    let (mut fit, mut last_arrival_ns, mut certain) = (ClockFit::new(), 0, 0);
    let mut constant = (0, 0);
    for index in 0..10_000_u64 {
        let taken_ns = START_NS + index * 4_000_000;
        let arrival_ns = last_arrival_ns.max(taken_ns + waits_ns(index));
        last_arrival_ns = arrival_ns;
        fit.observe(index, arrival_ns);
        let Some(estimate) = fit.estimate(index) else { continue };
        let error_ns = estimate.host_ns.abs_diff(taken_ns);
        if constant.0 != fit.epoch() && estimate.sigma_ns < 1_000_000 {
            constant = (fit.epoch(), error_ns);
        }
        let off_ns = error_ns.abs_diff(constant.1);
        let is_covered = off_ns < 1_000_000 || off_ns / 3 <= estimate.sigma_ns;
        let is_exempt = exempts_epochs && fit.epoch() > 0;
        assert!(
            is_covered || is_exempt,
            "{index}: {off_ns} ns off in epoch {} and {estimate:?}",
            fit.epoch()
        );
        certain += usize::from(waits_ns(index) == 0 && estimate.sigma_ns < 1_000_000 && error_ns < 1_000_000);
    }
    (fit.epoch(), certain)
}

#[test]
fn samples_that_wait_for_seconds_keep_the_line() {
    // A sender is behind by up to 0.5 s and sends what waited at once, again and again.
    let behind_ns = |index: u64| 100_000_000 + index % 100 * 4_000_000;
    for waiting in [5000..5750, 5000..7500] {
        let (epoch, certain) =
            wait(false, |index| if waiting.contains(&index) { behind_ns(index) } else { 0 });
        let others = 10_000 - waiting.count();
        assert!(epoch == 0 && certain > others - 300, "epoch {epoch}, {certain} of {others} are certain");
    }
}

#[test]
fn a_sender_that_falls_behind_and_catches_up_changes_the_epoch_or_keeps_the_line() {
    // It falls behind at a constant rate, or in steps of 50 ms, by 2 s.
    for steps in [1, 75] {
        let (epoch, certain) = wait(true, |index| match index {
            0..3000 => 0,
            3000..6000 => (index - 3000) / steps * steps * 666_667,
            6000..8000 => (8000 - index) * 1_000_000,
            _ => 0,
        });
        assert!(certain > 4000, "{steps}: epoch {epoch}, {certain} are certain");
    }
}

#[test]
fn a_backlog_that_arrives_at_twice_the_rate_keeps_the_line() {
    // Nothing arrives for 3 s.
    let (epoch, certain) = wait(false, |index| match index {
        4000..5500 => (5500 - index) * 2_000_000,
        _ => 0,
    });
    assert!(epoch == 0 && certain > 8200, "epoch {epoch}, {certain} are certain");
}

#[test]
fn a_longer_delay_with_jitter_begins_an_epoch() {
    let (mut fit, mut jitter) = (ClockFit::new(), Jitter { state: 7, mean_ns: 5e6 });
    let (mut began, mut last_arrival_ns) = (None, 0);
    for index in 0..4000_u64 {
        let delay_ns = if index < 2500 { 0 } else { 200_000_000 };
        let arrival_ns = START_NS + index * 4_000_000 + delay_ns + jitter.next_ns() as u64;
        last_arrival_ns = arrival_ns.max(last_arrival_ns);
        fit.observe(index, last_arrival_ns);
        if fit.epoch() > 0 {
            began = began.or(Some(index));
        }
    }
    assert!(began.is_some_and(|index| (2500..2900).contains(&index)) && fit.epoch() == 1, "{began:?}");
}

#[test]
fn block_deliveries_with_jitter_begin_no_epoch_and_leave_most_times_certain() {
    // 100 samples each, at 1 kHz.
    let (mut fit, mut jitter) = (ClockFit::new(), Jitter { state: 3, mean_ns: 10e6 });
    let (mut unknown, mut last_arrival_ns) = (0, 0);
    for block in 1..=600_u64 {
        let arrival_ns = START_NS + block * 100_000_000 + jitter.next_ns() as u64;
        last_arrival_ns = arrival_ns.max(last_arrival_ns);
        fit.observe(100 * block, last_arrival_ns);
        for counter in 100 * block - 99..=100 * block {
            let sigma_ns = fit.estimate(counter).map(|estimate| estimate.sigma_ns);
            unknown += usize::from(block > 50 && sigma_ns.is_none_or(|sigma_ns| sigma_ns > 20_000_000));
        }
    }
    assert!(fit.epoch() == 0 && unknown < 550, "epoch {}, {unknown} of 55000 unknown", fit.epoch());
}

#[test]
fn equal_and_falling_counters_are_ignored() {
    let mut fit = ClockFit::new();
    for index in 0..20 {
        fit.observe(index, START_NS + index * 1_000_000);
        fit.observe(index, 0);
        fit.observe(0, u64::MAX);
    }
    assert!(fit.estimate(19).unwrap().host_ns.abs_diff(START_NS + 19_000_000) < 10);
}

#[test]
fn a_change_of_the_period_is_tracked_within_seconds() {
    // Alternately slower and faster, as a suit that is set to another rate and back.
    let (mut fit, mut now_ns, mut counter) = (ClockFit::new(), START_NS, 0_u64);
    let mut wrong_since_ns = None;
    let mut rates = std::vec![(60.0, 20.0), (40.0, 4.0), (60.0, 20.0), (100.0, 4.0), (60.0, 20.0)];
    rates.extend([(240.0, 30.0), (60.0, 90.0)]);
    for (rate_hz, seconds) in rates {
        for _ in 0..(rate_hz * seconds) as u64 {
            now_ns += (1e9 / rate_hz) as u64;
            counter += 1;
            fit.observe(counter, now_ns);
            let Some(estimate) = fit.estimate(counter) else { continue };
            let error_ns = now_ns - estimate.host_ns;
            // Not covered by σ: the first samples of a slower rate look like delay.
            assert!(
                error_ns < 60_000_000 || error_ns <= estimate.sigma_ns + 1000,
                "{rate_hz} Hz: {estimate:?}"
            );
            if estimate.sigma_ns < 1_000_000 {
                wrong_since_ns = None;
            } else {
                let since_ns = *wrong_since_ns.get_or_insert(now_ns);
                assert!(
                    now_ns - since_ns < 5_000_000_000,
                    "{rate_hz} Hz: σ above 1 ms for 5 s: {estimate:?}"
                );
            }
        }
    }
}
