//! Wake-up latency of the loop, compared with cyclictest on the other core at the same time.
//!
//! Each turn runs one contender on one core and cyclictest on the other, each round in both assignments. The contenders
//! range from a second cyclictest over a thread that only sleeps to the whole daemon, which separates the contributions
//! of the machine, the sleep method, the loop's work and the threads around it. `cargo bench -p equipoise-benches
//! --bench wakeup`; figures in `docs/realtime.md`. Needs cyclictest (Debian: rt-tests) and stress-ng.

mod contender;
mod cyclictest;

use std::process::ExitCode;
use std::time::Duration;

use equipoise_benches::figures::{self, Figure};
use equipoise_benches::options::Options;
use equipoise_benches::peer;
use equipoise_benches::rounds::{median, quantile};
use equipoise_daemon::realtime;

use contender::{Contender, Lateness};
use cyclictest::{Cyclictest, Policy, Stress, is_there};

const QUANTILES: [(&str, f64); 4] = [("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999), ("max", 1.0)];

/// One contender's round: its own lateness and cyclictest's in the same seconds, sorted, µs.
struct Round {
    ours_us: Vec<f64>,
    theirs_us: Vec<f64>,
    caught_up: usize,
}

fn main() -> ExitCode {
    peer::on_an_own_bus(|| measure(&Options::read(5, 2.0)))
}

fn measure(options: &Options) {
    if !is_there("cyclictest", "rt-tests") {
        println!("nothing to compare with, nothing is measured");
        return;
    }
    let loads: &[bool] = if is_there("stress-ng", "stress-ng") { &[false, true] } else { &[false] };
    if let Err(why) = realtime::lock_memory() {
        println!("memory is not locked: {why}");
    }
    let mut all = Vec::new();
    for &loaded in loads {
        for policy in [Policy::Fifo, Policy::Other] {
            let name = format!("{}, {}", policy.name(), if loaded { "stress-ng --cpu 2" } else { "idle" });
            if options.asks_for(&name) {
                all.extend(compare(options, &name, policy, loaded));
            }
        }
    }
    figures::write("wakeup", options, &all);
}

fn compare(options: &Options, name: &str, policy: Policy, loaded: bool) -> Vec<Figure> {
    let _stress = loaded.then(|| Stress::start(2));
    let mut rounds: [Vec<Round>; 4] = Default::default();
    for round in 0..options.rounds {
        for turn in 0..Contender::ALL.len() {
            let index = (round + turn) % Contender::ALL.len();
            rounds[index].push(both_ways(Contender::ALL[index], policy, options));
        }
    }
    println!("\nlateness, {name}: {} rounds in turns; µs, and times cyclictest's", options.rounds);
    print!("{:<17}", "");
    QUANTILES.iter().for_each(|(name, _)| print!(" {name:>9} {:>6}", "ratio"));
    println!(" {:>9} {:>9}", "cycles", "caught up");
    let mut figures = Vec::new();
    for (contender, rounds) in Contender::ALL.into_iter().zip(&rounds) {
        let mut figure = Figure::of([("condition", name), ("contender", contender.name())]);
        print!("{:<17}", contender.name());
        for (name, probability) in QUANTILES {
            let over = |of: &dyn Fn(&Round) -> f64| median(rounds.iter().map(of).collect());
            let ours = over(&|round| quantile(&round.ours_us, probability));
            let theirs = over(&|round| quantile(&round.theirs_us, probability));
            let ratio = over(&|round| {
                quantile(&round.ours_us, probability) / quantile(&round.theirs_us, probability)
            });
            print!(" {ours:>9.0} {ratio:>6.2}");
            figure = figure
                .with(&format!("{name}_us"), ours)
                .with(&format!("cyclictest_{name}_us"), theirs)
                .with(&format!("{name}_ratio"), ratio);
        }
        let cycles: usize = rounds.iter().map(|round| round.ours_us.len()).sum();
        let theirs: usize = rounds.iter().map(|round| round.theirs_us.len()).sum();
        assert!(cycles > 0 && theirs > 0, "{}: no thread was woken", contender.name());
        println!(" {cycles:>9} {:>9}", rounds.iter().map(|round| round.caught_up).sum::<usize>());
        figures.push(figure);
    }
    figures
}

fn both_ways(contender: Contender, policy: Policy, options: &Options) -> Round {
    let mut round = Round { ours_us: Vec::new(), theirs_us: Vec::new(), caught_up: 0 };
    for (ours, theirs) in [(0, 1), (1, 0)] {
        let length = Duration::from_secs_f64(options.turn_s);
        let their_thread = Cyclictest::start(policy, theirs, length);
        // Wait until its scheduler is set.
        std::thread::sleep(Duration::from_millis(100));
        if their_thread.has_policy() != Some(policy) {
            println!("cyclictest does not run under {}", policy.name());
        }
        let Lateness { slept_us, caught_up, missing } = contender.run(policy, ours, length);
        if let Some(missing) = missing {
            println!("{missing}");
        }
        round.ours_us.extend(slept_us);
        round.theirs_us.extend(their_thread.finish());
        round.caught_up += caught_up;
    }
    round.ours_us.sort_by(f64::total_cmp);
    round.theirs_us.sort_by(f64::total_cmp);
    round
}
