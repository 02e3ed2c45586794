//! Number of stations that this machine supports, and the cost of one.
//!
//! Each station is a process with the whole daemon and a simulated person on real wires (suit 60 Hz, plate 250 Hz). The
//! cost of the simulated person is excluded. `cargo bench -p equipoise-benches --bench stations`; figures in
//! `docs/realtime.md`.

mod station;

use std::process::ExitCode;
use std::thread::sleep;
use std::time::Duration;

use equipoise_benches::figures::{self, Figure};
use equipoise_benches::options::Options;
use equipoise_benches::peer::{self, Peer};
use equipoise_benches::rounds::median;

use station::{FIGURES, Figures};

const COUNTS: [usize; 6] = [1, 2, 4, 8, 16, 32];
const RATES_HZ: [u32; 3] = [1000, 250, 100];
/// Limit of the daemons' total load of all cores. Beyond it real-time loops starve everything else on the machine, this
/// bench included, so more stations are not tried. The simulated people need about as much again.
const CORE_FRACTION_MAX: f64 = 0.45;

fn main() -> ExitCode {
    if let Some((_, arguments)) = peer::role() {
        station::run(&arguments);
        return ExitCode::SUCCESS;
    }
    peer::on_an_own_bus(|| measure(&Options::read(3, 3.0)))
}

fn measure(options: &Options) {
    let cores = std::thread::available_parallelism().map_or(1.0, |cores| cores.get() as f64);
    let counts = if options.quick { &COUNTS[..2] } else { &COUNTS[..] };
    let mut all = Vec::new();
    for rate_hz in RATES_HZ.into_iter().filter(|rate_hz| options.asks_for(&format!("{rate_hz} Hz"))) {
        println!("\nstations, loop at {rate_hz} Hz: {} rounds in turns, medians", options.rounds);
        println!(
            "{:>8} {:>10} {:>10} {:>10} {:>12} {:>9} {:>8} {:>8}",
            "stations", "cpu each %", "wake p50", "wake p99", "to_state p99", "missed %", "MB each", "ratio"
        );
        let mut full = counts.len();
        let mut rounds: Vec<Vec<Figures>> = vec![Vec::new(); counts.len()];
        for _ in 0..options.rounds {
            for (index, &count) in counts.iter().enumerate().take(full) {
                let figures = turn(rate_hz, count, options.turn_s);
                let wanted = counts.get(index + 1).map_or(0.0, |next| *next as f64 * figures[0] * 1e-2);
                rounds[index].push(figures);
                if wanted > CORE_FRACTION_MAX * cores {
                    full = full.min(index + 1);
                    break;
                }
            }
        }
        let mut alone = f64::NAN;
        for (&count, rounds) in counts.iter().zip(&rounds).filter(|(_, rounds)| !rounds.is_empty()) {
            let over = |index: usize| median(rounds.iter().map(|figures| figures[index]).collect());
            let values: Figures = std::array::from_fn(over);
            let [cpu, wake_p50, wake_p99, to_state_p99, missed, memory] = values;
            if alone.is_nan() {
                alone = to_state_p99;
            }
            println!(
                "{count:>8} {cpu:>10.1} {wake_p50:>10.1} {wake_p99:>10.1} {to_state_p99:>12.1} {missed:>9.2} \
                 {memory:>8.1} {:>8.2}",
                to_state_p99 / alone
            );
            let figure = Figure::of([("rate_hz", &rate_hz.to_string()), ("stations", &count.to_string())]);
            figures_of(&mut all, figure, values);
        }
        if full < counts.len() {
            let percent = 100.0 * CORE_FRACTION_MAX;
            println!(
                "more than {} were not tried: they would want {percent} % of all cores",
                counts[full - 1]
            );
        }
    }
    figures::write("stations", options, &all);
}

fn figures_of(all: &mut Vec<Figure>, figure: Figure, values: Figures) {
    all.push(FIGURES.into_iter().zip(values).fold(figure, |figure, (name, value)| figure.with(name, value)));
}

/// This number of stations at once; means over them.
fn turn(rate_hz: u32, count: usize, turn_s: f64) -> Figures {
    let mut stations: Vec<Peer> = (0..count)
        .map(|number| Peer::start("station", &[format!("s{number}"), rate_hz.to_string()]).0)
        .collect();
    // Suit and plate connect, identification suggests its first pose.
    sleep(Duration::from_secs_f64(turn_s.min(1.0)));
    stations.iter_mut().for_each(|station| station.tell("go"));
    sleep(Duration::from_secs_f64(turn_s));
    stations.iter_mut().for_each(|station| station.tell("enough"));
    let mut sums: Figures = Default::default();
    for station in stations {
        let words: Vec<f64> = station.finish().chunks_exact(8).map(bytemuck::pod_read_unaligned).collect();
        assert_eq!(words.len(), sums.len(), "a station reported too few figures");
        sums.iter_mut().zip(words).for_each(|(sum, word)| *sum += word / count as f64);
    }
    sums
}
