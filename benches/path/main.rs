//! Latency from a sample's arrival until another process has read the state, compared with Unix and UDP sockets.
//!
//! The same threads under the same policies carry the same bytes: `SuitSample` in, `State` out, by the bus or by
//! datagrams. The loop is the real one; a sample's wait for the next cycle is excluded in all cases. `cargo bench -p
//! equipoise-benches --bench path`; figures in `docs/realtime.md`.

mod carrier;
mod consumer;
mod turn;

use std::process::ExitCode;
use std::time::Duration;

use equipoise_benches::figures::{self, Figure};
use equipoise_benches::options::Options;
use equipoise_benches::peer;
use equipoise_benches::rounds::{median, quantile};
use equipoise_config::WaitStrategy;
use equipoise_daemon::realtime;

use carrier::Carrier;
use turn::{Cores, Plan, Times};

/// An assignment of threads to cores, and a wait method.
struct Arrangement {
    name: &'static str,
    waiting: WaitStrategy,
    /// The cores of the ingress leg and of the egress leg in one turn, or each in its own turn.
    turns: &'static [(bool, bool, Cores)],
}

const NOWHERE: Cores = Cores { adapter: None, ingress: None, looping: None, egress: None, consumer: None };
/// As with `[loop] cpu = 1` and no other thread on that core.
const CPU_1: Cores =
    Cores { adapter: Some(0), ingress: Some(0), looping: Some(1), egress: Some(1), consumer: Some(0) };
/// The same with egress on the other core.
const APART: Cores =
    Cores { adapter: Some(0), ingress: Some(0), looping: Some(1), egress: Some(0), consumer: Some(0) };
/// Two cores have room for one polling thread in addition to the threads that it waits for, hence one leg per turn.
const POLLED_INGRESS: Cores =
    Cores { adapter: Some(0), ingress: Some(1), looping: Some(0), egress: None, consumer: None };
const POLLED_EGRESS: Cores =
    Cores { adapter: None, ingress: None, looping: Some(0), egress: Some(1), consumer: Some(0) };

/// The consumer alone on its core; egress polls in the loop's idle time on the other.
const POLLED_EGRESS_ALONE: Cores =
    Cores { adapter: None, ingress: None, looping: Some(1), egress: Some(1), consumer: Some(0) };

const ARRANGEMENTS: [Arrangement; 5] = [
    Arrangement {
        name: "sleeping, not pinned",
        waiting: WaitStrategy::Sleeping,
        turns: &[(true, true, NOWHERE)],
    },
    Arrangement { name: "sleeping, cpu = 1", waiting: WaitStrategy::Sleeping, turns: &[(true, true, CPU_1)] },
    Arrangement {
        name: "sleeping, egress apart",
        waiting: WaitStrategy::Sleeping,
        turns: &[(true, true, APART)],
    },
    Arrangement {
        name: "polling",
        waiting: WaitStrategy::Polling,
        turns: &[(true, false, POLLED_INGRESS), (false, true, POLLED_EGRESS)],
    },
    Arrangement {
        name: "polling, consumer alone",
        waiting: WaitStrategy::Polling,
        turns: &[(true, false, POLLED_INGRESS), (false, true, POLLED_EGRESS_ALONE)],
    },
];

/// Pollers have real-time priorities here, so that other load on the machine affects no figure. The kernel limits real
/// time to 0.95 s of each second, so a turn is shorter.
const POLLED_S: f64 = 0.4;

fn main() -> ExitCode {
    if let Some((_, arguments)) = peer::role() {
        consumer::run(&arguments);
        return ExitCode::SUCCESS;
    }
    peer::on_an_own_bus(|| measure(&Options::read(8, 1.0)))
}

fn measure(options: &Options) {
    if let Err(why) = realtime::lock_memory() {
        println!("memory is not locked: {why}");
    }
    let folder = tempfile::tempdir().expect("a folder for sockets");
    let mut all = Vec::new();
    for arrangement in ARRANGEMENTS.iter().filter(|one| options.asks_for(one.name)) {
        let mut rounds: Vec<[Times; 3]> = Vec::new();
        for round in 0..options.rounds {
            let mut times: [Times; 3] = Default::default();
            for turn in 0..3 {
                let index = (round + turn) % 3;
                let carrier = Carrier::ALL[index];
                for &(ingress_leg, egress_leg, cores) in arrangement.turns {
                    let length = Duration::from_secs_f64(match arrangement.waiting {
                        WaitStrategy::Sleeping => options.turn_s,
                        WaitStrategy::Polling => options.turn_s.min(POLLED_S),
                    });
                    let plan = Plan {
                        carrier,
                        waiting: arrangement.waiting,
                        ingress_leg,
                        egress_leg,
                        cores,
                        length,
                    };
                    times[index].add(plan.run(folder.path()));
                }
            }
            rounds.push(times);
        }
        all.extend(report(arrangement.name, &rounds));
    }
    figures::write("path", options, &all);
}

impl Times {
    fn add(&mut self, other: Times) {
        self.ingress_us.extend(other.ingress_us);
        self.egress_us.extend(other.egress_us);
        self.step_us.extend(other.step_us);
        self.sent += other.sent;
        self.arrived += other.arrived;
    }
}

/// Medians of the rounds' percentiles; ratios are medians of the rounds' ratios.
fn report(name: &str, rounds: &[[Times; 3]]) -> Vec<Figure> {
    println!("\narrival → consumer, {name}: {} rounds in turns", rounds.len());
    println!(
        "{:<6} {:>9} {:>9} {:>9} {:>9} {:>8} {:>8} {:>9} {:>9} {:>9}",
        "", "in p50", "out p50", "sum p50", "sum p99", "÷ unix", "÷ udp", "step p50", "step p99", "carried"
    );
    let mut figures = Vec::new();
    for (index, carrier) in Carrier::ALL.into_iter().enumerate() {
        let over = |of: &dyn Fn(&[Times; 3]) -> f64| median(rounds.iter().map(of).collect());
        let at =
            |probability: f64, of: fn(&Times) -> &Vec<f64>| over(&|round| at(probability, of(&round[index])));
        let sum =
            |probability: f64, index: usize| move |round: &[Times; 3]| sum_at(probability, &round[index]);
        let ratio = |other: usize| over(&|round| sum(0.5, index)(round) / sum(0.5, other)(round));
        let (sent, arrived) = rounds.iter().fold((0, 0), |(sent, arrived), round| {
            (sent + round[index].sent, arrived + round[index].arrived)
        });
        assert!(arrived > 0 && arrived <= sent, "{name}: {arrived} of {sent} messages arrived");
        let values = [
            ("in_p50_us", at(0.5, |times| &times.ingress_us)),
            ("out_p50_us", at(0.5, |times| &times.egress_us)),
            ("sum_p50_us", over(&sum(0.5, index))),
            ("sum_p99_us", over(&sum(0.99, index))),
            ("ratio_unix", ratio(1)),
            ("ratio_udp", ratio(2)),
            ("step_p50_us", at(0.5, |times| &times.step_us)),
            ("step_p99_us", at(0.99, |times| &times.step_us)),
        ];
        print!("{:<6}", carrier.name());
        for (name, value) in values {
            let width = if name.starts_with("ratio") { 8 } else { 9 };
            print!(" {value:>width$.2}");
        }
        println!(" {:>9.4}", arrived as f64 / sent as f64);
        let figure = Figure::of([("arrangement", name), ("carrier", carrier.name())]);
        figures.push(values.into_iter().fold(figure, |figure, (name, value)| figure.with(name, value)));
    }
    figures
}

fn sum_at(probability: f64, times: &Times) -> f64 {
    at(probability, &times.ingress_us) + at(probability, &times.egress_us)
}

fn at(probability: f64, values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    quantile(&sorted, probability)
}
