//! Compares several methods for the same work, timed in turns.
//!
//! On a shared machine a slow second may affect one benchmark and not the next, which invalidates their ratio. Here
//! each round times every method once, in an order that rotates, and a ratio is the median of the rounds' ratios.

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::Criterion;

/// One method for the work.
pub struct Contender<'a> {
    name: &'static str,
    run: Box<dyn FnMut() + 'a>,
}

impl<'a> Contender<'a> {
    /// A named method; `run` does the work once and keeps its result from being optimised away.
    pub fn new(name: &'static str, run: impl FnMut() + 'a) -> Self {
        Contender { name, run: Box::new(run) }
    }

    fn mean_us(&mut self, repeats: u32) -> f64 {
        let begun = Instant::now();
        for _ in 0..repeats {
            black_box(&mut self.run)();
        }
        begun.elapsed().as_secs_f64() * 1e6 / f64::from(repeats)
    }
}

const ROUNDS_MIN: usize = 100;
const TIME_IN_ROUNDS: Duration = Duration::from_secs(3);
/// Duration of a method's turn, filled with repetitions: a thousand times the clock's own cost.
const TURN_US: f64 = 50.0;

/// Samples each method with criterion, then all of them in turns; prints the medians and their ratios to the first
/// one's. Returns the medians, µs; none in a test run.
pub fn compare(criterion: &mut Criterion, question: &str, contenders: &mut [Contender<'_>]) -> Vec<f64> {
    let mut group = criterion.benchmark_group(question);
    for contender in &mut *contenders {
        group.bench_function(contender.name, |bencher| bencher.iter(&mut contender.run));
    }
    group.finish();
    if !crate::is_measured() {
        return Vec::new();
    }

    let repeats: Vec<u32> =
        contenders.iter_mut().map(|one| (TURN_US / one.mean_us(10)).ceil().max(1.0) as u32).collect();
    let mut times_us = vec![Vec::new(); contenders.len()];
    let begun = Instant::now();
    for round in 0.. {
        if round >= ROUNDS_MIN && begun.elapsed() > TIME_IN_ROUNDS {
            break;
        }
        for turn in 0..contenders.len() {
            let index = (round + turn) % contenders.len();
            times_us[index].push(contenders[index].mean_us(repeats[index]));
        }
    }

    println!("\n{question}: {} rounds in turns", times_us[0].len());
    println!("{:<38} {:>10} {:>8}", "", "p50 (µs)", "ratio");
    for (contender, times) in contenders.iter().zip(&times_us) {
        let ratios = times.iter().zip(&times_us[0]).map(|(time, first)| time / first).collect();
        println!("{:<38} {:>10.3} {:>8.2}", contender.name, median(times.clone()), median(ratios));
    }
    println!();
    times_us.into_iter().map(median).collect()
}

/// The value at `probability` of a sorted list, in [0, 1]; NaN for an empty one.
pub fn quantile(sorted: &[f64], probability: f64) -> f64 {
    let last = sorted.len().saturating_sub(1);
    sorted.get((probability * last as f64).round() as usize).copied().unwrap_or(f64::NAN)
}

/// Median of the finite values of a list: a round without a value is ignored. NaN if there is none.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.retain(|value| !value.is_nan());
    values.sort_by(f64::total_cmp);
    quantile(&values, 0.5)
}
