//! Duration of a whole cycle within its millisecond, compared with the estimator's work alone in dense form.
//!
//! 1 kHz loop, suit at 60 Hz, ground at 1 kHz, all 69 parameters, the library of 50 poses: the worker holds pose after
//! pose for identification, then holds loads. The dense version computes a suit sample's `B Φ`, `B P Bᵀ` and Eq. 15,
//! and a pose's mean rows, Joseph update and predicted σ over the library; it has no stream alignment, no foot anchor,
//! no static-pose detection. `cargo bench -p equipoise-benches --bench cycle`; figures in `docs/realtime.md`.

mod session;

use std::time::Duration;

use equipoise_benches::rounds::quantile;
use session::{Kind, Session, Turn};

const SESSIONS: usize = 3;
/// The loop's period, µs.
const PERIOD_US: f64 = 1000.0;

fn main() {
    let mut criterion = equipoise_benches::criterion();
    criterion.bench_function("cycle/mean step of core::cycle", |bencher| {
        bencher.iter_custom(|steps| {
            let mut session = Session::new(false);
            (0..steps).map(|_| Duration::from_secs_f64(session.turn().ours_us * 1e-6)).sum()
        });
    });
    criterion.final_summary();
    if !equipoise_benches::is_measured() {
        return;
    }

    let mut turns = Vec::new();
    for _ in 0..SESSIONS {
        let mut session = Session::new(true);
        turns.extend(std::iter::from_fn(|| (!session.is_over()).then(|| session.turn())));
        session.check();
    }
    print(&turns);
}

fn print(turns: &[Turn]) {
    println!("\nwhole cycle: {} steps, each version timed in each step", turns.len());
    println!(
        "{:<48} {:>7} {:>8} {:>8} {:>8} {:>9} {:>11} {:>6}",
        "µs", "steps", "p50", "p99", "p99.9", "max", "p99.9 / 1 ms", "ratio"
    );
    let kinds: [(&str, &[Kind]); 4] = [
        ("every step", &[Kind::Ground, Kind::Suit, Kind::Load, Kind::Pose]),
        ("with a suit sample, no load", &[Kind::Suit]),
        ("with a suit sample, loaded", &[Kind::Load]),
        ("with a pose learnt", &[Kind::Pose]),
    ];
    for (name, kinds) in kinds {
        let chosen: Vec<&Turn> = turns.iter().filter(|turn| kinds.contains(&turn.kind)).collect();
        let ours = sorted(chosen.iter().map(|turn| turn.ours_us));
        let dense = sorted(chosen.iter().map(|turn| turn.dense_us));
        line(&format!("{name}: core::cycle::step"), &ours, 1.0);
        line(&format!("{name}: dense"), &dense, quantile(&dense, 0.5) / quantile(&ours, 0.5));
    }
    println!(
        "ratio: of the p50; in most steps there is no suit sample, and the dense version has nothing to do\n"
    );
}

fn line(name: &str, times_us: &[f64], ratio: f64) {
    let [p50, p99, p999, max] = [0.5, 0.99, 0.999, 1.0].map(|probability| quantile(times_us, probability));
    let budget_percent = 100.0 * p999 / PERIOD_US;
    println!(
        "{name:<48} {:>7} {p50:>8.2} {p99:>8.2} {p999:>8.2} {max:>9.2} {budget_percent:>9.2} % {ratio:>6.2}",
        times_us.len()
    );
}

fn sorted(times_us: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut times: Vec<f64> = times_us.collect();
    times.sort_by(f64::total_cmp);
    times
}
