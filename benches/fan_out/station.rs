//! The daemon's side: the real loop and the real egress, whose publishing is timed.

use std::sync::Arc;
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant};

use crossbeam_channel::bounded;
use equipoise_benches::worker::HEIGHT_M;
use equipoise_bus::{Bus, BusSettings};
use equipoise_config::WaitStrategy;
use equipoise_core::cycle::{Memory, Settings};
use equipoise_core::message::CycleRecord;
use equipoise_daemon::egress::Egress;
use equipoise_daemon::latency_log::feed::{CAPACITY, feed};
use equipoise_daemon::realtime::{self, RequestedScheduling};
use equipoise_daemon::rings::{LoopControl, LoopEnds, Rings};
use equipoise_daemon::tick::{Loop, Monotonic, NoObserver};
use equipoise_latency::PathHistograms;
use equipoise_latency::stage::Stage;

use crate::consumers::{self, Kind};

pub(crate) const STATION: &str = "fan-out";
const PERIOD_NS: u64 = 1_000_000;
/// Connections are made with the first states.
const WARM: usize = 50;
const CPU: usize = 1;

/// Measurements of a turn.
#[derive(Debug, Default)]
pub(crate) struct Turn {
    /// Egress, for each state: publishing, recording and waking all listeners; sorted.
    pub(crate) publish_us: Vec<f64>,
    pub(crate) to_state_p50_us: f64,
    pub(crate) to_state_p99_us: f64,
    /// States published, and states read by all consumers together.
    pub(crate) cycles: u64,
    pub(crate) taken: u64,
}

/// One turn with this number of consumers.
pub(crate) fn turn(kind: Kind, count: usize, turn_s: f64) -> Turn {
    let Rings { control, loop_ends, egress: egress_ends, .. } =
        Rings::new().expect("an event file descriptor");
    let consumers = (count > 0).then(|| consumers::start(kind, count));
    let (ready, is_ready) = bounded(1);
    let egress_control = Arc::clone(&control);
    let egress = spawn(move || {
        realtime::request("egress", RequestedScheduling { fifo_priority: 60, cpu: Some(CPU) });
        // The latency log is not drained; a full feed only counts.
        let (latency_log, _drain) = feed(CAPACITY);
        let mut egress = Egress::open(STATION, egress_ends, WaitStrategy::Sleeping, latency_log)
            .expect("the bus is there");
        let _ = ready.send(());
        let mut publish_us = Vec::with_capacity(1 << 16);
        loop {
            let ended = egress_control.has_ended();
            egress.wait();
            let begun = Instant::now();
            // Several at once mean a stall, which is divided among them.
            let published = egress.publish_outcomes().expect("the bus is whole");
            let each_us = begun.elapsed().as_secs_f64() * 1e6 / published.max(1) as f64;
            publish_us.extend(std::iter::repeat_n(each_us, published));
            if ended {
                return publish_us;
            }
        }
    });
    is_ready.recv().expect("egress begins");
    let (histograms, cycles) = run_loop(&control, loop_ends, turn_s);
    let mut publish_us = egress.join().expect("egress ended well");
    let taken = consumers.map_or(0, consumers::finish);
    publish_us.drain(..publish_us.len().min(WARM));
    publish_us.sort_by(f64::total_cmp);
    let to_state = &histograms.stage(Stage::LoopToState).times_ns;
    Turn {
        publish_us,
        to_state_p50_us: to_state.value_at_quantile(0.5) as f64 * 1e-3,
        to_state_p99_us: to_state.value_at_quantile(0.99) as f64 * 1e-3,
        cycles,
        taken,
    }
}

fn run_loop(control: &Arc<LoopControl>, loop_ends: LoopEnds, turn_s: f64) -> (PathHistograms, u64) {
    let (loop_control, settings) = (Arc::clone(control), Settings::for_height(HEIGHT_M));
    let bus = Bus::join(&BusSettings::new(STATION, "records")).expect("the bus is there");
    let mut records = bus.subscriber::<CycleRecord>(1024).expect("a place for a subscriber");
    // Egress must observe the loop's start before it may observe its end.
    let (begun, has_begun) = bounded(1);
    let looping = spawn(move || {
        let _runs = loop_control.mark_loop_running();
        let _ = begun.send(());
        realtime::prefault_stack();
        realtime::request("loop", RequestedScheduling { fifo_priority: 80, cpu: Some(CPU) });
        let mut memory = bytemuck::zeroed_box::<Memory>();
        memory.start(&settings);
        Loop::new(settings, memory, 0, loop_ends, PERIOD_NS).run(&mut Monotonic, &mut NoObserver)
    });
    has_begun.recv().expect("the loop begins");
    let (started, mut histograms) = (Instant::now(), PathHistograms::new());
    while started.elapsed().as_secs_f64() < turn_s {
        sleep(Duration::from_millis(100));
        while let Some(record) = records.receive().expect("the bus is whole") {
            histograms.record(&record);
        }
    }
    control.stop();
    let summary = looping.join().expect("the loop ended well");
    assert!(summary.adds_up, "the schedule must add up");
    (histograms, summary.cycles)
}
