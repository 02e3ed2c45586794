//! Cost of each additional consumer for egress and for the path to the published state.
//!
//! The real loop at 1 kHz and the real egress; 0 to 16 consumers in another process, each a thread with its own place
//! on the bus. A listener sleeps until it is woken for each state; a poller polls once a millisecond and is never
//! woken. `cargo bench -p equipoise-benches --bench fan_out`; figures in `docs/realtime.md`.

mod consumers;
mod station;

use std::process::ExitCode;

use equipoise_benches::figures::{self, Figure};
use equipoise_benches::options::Options;
use equipoise_benches::peer;
use equipoise_benches::rounds::{median, quantile};
use equipoise_daemon::realtime;

use consumers::Kind;
use station::{Turn, turn};

const COUNTS: [usize; 6] = [0, 1, 2, 4, 8, 16];

fn main() -> ExitCode {
    if let Some((_, arguments)) = peer::role() {
        consumers::run(&arguments);
        return ExitCode::SUCCESS;
    }
    peer::on_an_own_bus(|| measure(&Options::read(6, 1.0)))
}

fn measure(options: &Options) {
    if let Err(why) = realtime::lock_memory() {
        println!("memory is not locked: {why}");
    }
    let mut all = Vec::new();
    for kind in Kind::ALL.into_iter().filter(|kind| options.asks_for(kind.name())) {
        let mut rounds: Vec<[Turn; COUNTS.len()]> = Vec::new();
        for round in 0..options.rounds {
            let mut turns: [Turn; COUNTS.len()] = Default::default();
            for place in 0..COUNTS.len() {
                let index = (round + place) % COUNTS.len();
                turns[index] = turn(kind, COUNTS[index], options.turn_s);
            }
            rounds.push(turns);
        }
        all.extend(report(kind, &rounds));
    }
    figures::write("fan_out", options, &all);
}

fn report(kind: Kind, rounds: &[[Turn; COUNTS.len()]]) -> Vec<Figure> {
    println!("\nconsumers, {}: {} rounds in turns; µs", kind.name(), rounds.len());
    println!(
        "{:>9} {:>12} {:>8} {:>12} {:>13} {:>13} {:>9} {:>9}",
        "consumers", "publish p50", "ratio", "publish p99", "to_state p50", "to_state p99", "sent", "taken"
    );
    let mut figures = Vec::new();
    let mut points = Vec::new();
    for (index, count) in COUNTS.into_iter().enumerate() {
        let over = |of: &dyn Fn(&[Turn; COUNTS.len()]) -> f64| median(rounds.iter().map(of).collect());
        let publish = over(&|turns| quantile(&turns[index].publish_us, 0.5));
        let values = [
            ("publish_p50_us", publish),
            (
                "ratio",
                over(&|turns| quantile(&turns[index].publish_us, 0.5) / quantile(&turns[0].publish_us, 0.5)),
            ),
            ("publish_p99_us", over(&|turns| quantile(&turns[index].publish_us, 0.99))),
            ("to_state_p50_us", over(&|turns| turns[index].to_state_p50_us)),
            ("to_state_p99_us", over(&|turns| turns[index].to_state_p99_us)),
        ];
        let sent: u64 = rounds.iter().map(|turns| turns[index].cycles).sum();
        let taken: u64 = rounds.iter().map(|turns| turns[index].taken).sum();
        assert!(taken <= sent * count as u64, "more states were taken than sent");
        assert_eq!(taken > 0, count > 0, "{count} consumers took {taken} states");
        println!(
            "{count:>9} {:>12.2} {:>8.2} {:>12.2} {:>13.2} {:>13.2} {sent:>9} {taken:>9}",
            values[0].1, values[1].1, values[2].1, values[3].1, values[4].1
        );
        points.push([count as f64, publish]);
        let figure = Figure::of([("kind", kind.name()), ("consumers", &count.to_string())]);
        figures.push(values.into_iter().fold(figure, |figure, (name, value)| figure.with(name, value)));
    }
    println!("one consumer more: {:.2} µs (slope of publish p50)", slope(&points));
    figures
        .push(Figure::of([("kind", kind.name()), ("consumers", "slope")]).with("slope_us", slope(&points)));
    figures
}

/// Slope of the least-squares line.
fn slope(points: &[[f64; 2]]) -> f64 {
    let mean = |axis: usize| points.iter().map(|point| point[axis]).sum::<f64>() / points.len() as f64;
    let (x, y) = (mean(0), mean(1));
    let covariance: f64 = points.iter().map(|point| (point[0] - x) * (point[1] - y)).sum();
    covariance / points.iter().map(|point| (point[0] - x).powi(2)).sum::<f64>()
}
