//! One station: a process with the daemon and a simulated person.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant};

use equipoise_benches::peer;
use equipoise_bus::{Bus, BusSettings};
use equipoise_config::Config;
use equipoise_core::message::CycleRecord;
use equipoise_daemon::pipeline::Pipeline;
use equipoise_latency::PathHistograms;
use equipoise_latency::stage::Stage;
use equipoise_simulator::settings::SimulationSettings;
use equipoise_simulator::simulation::Simulation;

/// Figures that a station reports, in this order.
pub(crate) const FIGURES: [&str; 6] =
    ["cpu_percent", "wake_p50_us", "wake_p99_us", "to_state_p99_us", "missed_percent", "memory_mb"];
pub(crate) type Figures = [f64; FIGURES.len()];

const PLATE_HZ: f64 = 250.0;
/// The daemon's threads by name; all others are the simulated person's or this bench's.
const THREADS: [&str; 9] =
    ["loop", "ingress", "egress", "suit", "ground", "commands", "saving", "watchdog", "housekeeping"];

/// Runs until it receives `enough`; reports the figures since `go`.
pub(crate) fn run(arguments: &[String]) {
    let [name, rate_hz] = arguments else { panic!("a station has a name and a rate") };
    let suit = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).and_then(|socket| socket.local_addr());
    let suit = suit.expect("a free port");
    let mut simulated = SimulationSettings::default();
    simulated.suit.target = suit;
    simulated.plate.address = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    simulated.plate.rate_hz = PLATE_HZ;
    let person = Simulation::start(simulated).expect("the simulated person starts");
    let config = config(name, rate_hz, suit, person.plate_address());
    let pipeline = Pipeline::start(&config).expect("the daemon starts");
    let bus = Bus::join(&BusSettings::new(name, "records")).expect("the bus is there");
    let mut records = bus.subscriber::<CycleRecord>(1024).expect("a place for a subscriber");
    let (goes, is_enough) = listen();
    peer::ready("");

    let mut histograms = PathHistograms::new();
    let mut since = None;
    while !is_enough.load(Ordering::Relaxed) {
        sleep(Duration::from_millis(50));
        let counts = goes.load(Ordering::Relaxed);
        if counts && since.is_none() {
            since = Some((Instant::now(), cpu_s()));
        }
        while let Some(record) = records.receive().expect("the bus is whole") {
            if counts {
                histograms.record(&record);
            }
        }
    }
    let (begun, before_s) = since.expect("go comes before enough");
    let cpu_percent = 100.0 * (cpu_s() - before_s) / begun.elapsed().as_secs_f64();
    let memory_mb = memory_mb();
    drop(records);
    drop(bus);
    let summary = pipeline.stop().expect("the daemon ends well");
    assert!(summary.cycles.adds_up, "the schedule must add up");
    person.stop().expect("the simulated person ends well");
    let at = |stage: Stage, probability: f64| {
        histograms.stage(stage).times_ns.value_at_quantile(probability) as f64 * 1e-3
    };
    let counts = histograms.counts();
    let late = (counts.deadlines_missed + counts.slots_skipped) as f64;
    let due = (counts.cycles + counts.slots_skipped).max(1) as f64;
    let figures: Figures = [
        cpu_percent,
        at(Stage::LoopWake, 0.5),
        at(Stage::LoopWake, 0.99),
        at(Stage::LoopToState, 0.99),
        100.0 * late / due,
        memory_mb,
    ];
    let mut out = std::io::stdout().lock();
    std::io::Write::write_all(&mut out, bytemuck::cast_slice(&figures)).expect("the parent process reads");
}

/// Flags for the start of counting and for its end.
fn listen() -> (Arc<AtomicBool>, Arc<AtomicBool>) {
    let flags = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
    let flags_of_threads = flags.clone();
    spawn(move || {
        for flag in flags_of_threads {
            // The end of the input counts as both: the parent process has died.
            let _ = std::io::stdin().read_line(&mut String::new());
            flag.store(true, Ordering::Relaxed);
        }
    });
    let [goes, enough] = flags;
    (goes, enough)
}

fn config(name: &str, rate_hz: &str, suit: SocketAddr, plate: SocketAddr) -> Config {
    let text = format!(
        "station = \"{name}\"\n[loop]\nrate_hz = {rate_hz}\nlock_memory = false\n[suit]\nsource = \"mvn-udp\"\nlisten = \
         \"{suit}\"\n[ground]\nsource = \"ati-rdt\"\naddress = \"{plate}\"\ncounts_per_newton = 1e6\n\
         counts_per_newton_metre = 1e6\n[subject]\nid = \"bench\"\nheight_m = 1.77\nsave_profile = false\n"
    );
    Config::parse(&text, "the bench's configuration").expect("a good configuration")
}

/// CPU time of the daemon's threads, s.
fn cpu_s() -> f64 {
    let tasks = std::fs::read_dir("/proc/self/task").expect("proc is mounted");
    let read = |path: std::path::PathBuf| std::fs::read_to_string(path).unwrap_or_default();
    tasks
        .flatten()
        .filter(|task| THREADS.contains(&read(task.path().join("comm")).trim()))
        .filter_map(|task| read(task.path().join("schedstat")).split_whitespace().next()?.parse::<f64>().ok())
        .sum::<f64>()
        * 1e-9
}

/// Proportional set size of this process, MB.
fn memory_mb() -> f64 {
    let text = std::fs::read_to_string("/proc/self/smaps_rollup").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("Pss:")).unwrap_or("0");
    line.split_whitespace().next().and_then(|kb| kb.parse::<f64>().ok()).unwrap_or(0.0) * 1e-3
}
