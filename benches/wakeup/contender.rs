//! Contenders measured next to cyclictest, from a plain sleep up to the whole daemon.

use std::sync::Arc;
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant};

use crossbeam_channel::bounded;
use equipoise_benches::worker::HEIGHT_M;
use equipoise_bus::{Bus, BusSettings};
use equipoise_config::Config;
use equipoise_core::cycle::{Memory, Settings};
use equipoise_core::message::CycleRecord;
use equipoise_daemon::pipeline::Pipeline;
use equipoise_daemon::realtime::{self, RequestedScheduling, ThreadReport, now_ns, sleep_until};
use equipoise_daemon::rings::Rings;
use equipoise_daemon::tick::{Loop, Monotonic, NoObserver};

use crate::cyclictest::{Cyclictest, Policy};

const PERIOD_NS: u64 = 1_000_000;
/// Cycles of the warm-up.
const WARM: u64 = 200;

/// In order of decreasing similarity to cyclictest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Contender {
    /// A second cyclictest: the difference between two of the same kind.
    Cyclictest,
    /// A thread of this project that only sleeps.
    Sleeper,
    /// The loop with its step and its rings, and no other thread.
    Loop,
    /// The daemon: loop, ingress, egress, bus, housekeeping.
    Daemon,
}

/// Lateness of each cycle of a turn, µs.
#[derive(Debug, Default)]
pub(crate) struct Lateness {
    /// Cycles that were slept for until their own time.
    pub(crate) slept_us: Vec<f64>,
    /// Cycles due before the previous one had ended. The loop begins them at once; cyclictest leaves them out.
    pub(crate) caught_up: usize,
    /// The reason if the turn is invalid.
    pub(crate) missing: Option<String>,
}

impl Contender {
    pub(crate) const ALL: [Contender; 4] =
        [Contender::Cyclictest, Contender::Sleeper, Contender::Loop, Contender::Daemon];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Contender::Cyclictest => "cyclictest again",
            Contender::Sleeper => "sleeping thread",
            Contender::Loop => "loop alone",
            Contender::Daemon => "whole daemon",
        }
    }

    /// Runs it for a turn.
    pub(crate) fn run(self, policy: Policy, cpu: usize, length: Duration) -> Lateness {
        let asked = RequestedScheduling { fifo_priority: policy.priority(), cpu: Some(cpu) };
        match self {
            Contender::Cyclictest => {
                let slept_us = Cyclictest::start(policy, cpu, length).finish();
                Lateness { slept_us, ..Lateness::default() }
            }
            Contender::Sleeper => {
                spawn(move || sleep_only(asked, length)).join().expect("the sleeper ended well")
            }
            Contender::Loop => loop_alone(asked, length),
            Contender::Daemon => daemon(policy, cpu, length),
        }
    }
}

/// As in cyclictest.
fn sleep_only(asked: RequestedScheduling, length: Duration) -> Lateness {
    let missing = realtime::request("sleeper", asked).missing();
    let mut slept_us = Vec::with_capacity(length.as_millis() as usize + 1);
    let mut due_ns = now_ns() + PERIOD_NS;
    let end_ns = due_ns + length.as_nanos() as u64;
    while due_ns < end_ns {
        sleep_until(due_ns);
        let woken_ns = now_ns();
        slept_us.push(whole_us(woken_ns - due_ns));
        due_ns += PERIOD_NS * (1 + (woken_ns - due_ns) / PERIOD_NS);
    }
    slept_us.drain(..slept_us.len().min(WARM as usize));
    Lateness { slept_us, missing, ..Lateness::default() }
}

fn loop_alone(asked: RequestedScheduling, length: Duration) -> Lateness {
    let Rings { control, loop_ends, mut egress, .. } = Rings::new().expect("an event file descriptor");
    let settings = Settings::for_height(HEIGHT_M);
    let (ready, is_ready) = bounded(1);
    let thread = spawn(move || {
        let control = Arc::clone(&loop_ends.control);
        let _runs = control.mark_loop_running();
        realtime::prefault_stack();
        let mut memory = bytemuck::zeroed_box::<Memory>();
        memory.start(&settings);
        let _ = ready.send(realtime::request("loop", asked).missing());
        Loop::new(settings, memory, 0, loop_ends, PERIOD_NS).run(&mut Monotonic, &mut NoObserver)
    });
    let missing = is_ready.recv().expect("the loop begins");
    let records = follow(length, || egress.outcome.pop().ok().map(|outcome| outcome.record));
    control.stop();
    assert!(thread.join().expect("the loop ended well").adds_up, "the schedule must add up");
    Lateness { missing, ..lateness(&records) }
}

fn daemon(policy: Policy, cpu: usize, length: Duration) -> Lateness {
    let text = format!(
        "station = \"wakeup\"\n[loop]\npriority = {}\ncpu = {cpu}\n[suit]\nsource = \"external\"\n[ground]\nsource = \
         \"external\"\n[subject]\nid = \"bench\"\nheight_m = {HEIGHT_M}\nsave_profile = false\n",
        policy.priority()
    );
    let config = Config::parse(&text, "the bench's configuration").expect("a good configuration");
    let pipeline = Pipeline::start(&config).expect("the daemon starts");
    let missing = pipeline.threads().iter().find_map(ThreadReport::missing);
    let bus = Bus::join(&BusSettings::new("wakeup", "records")).expect("the bus is there");
    let mut records = bus.subscriber::<CycleRecord>(1024).expect("a place for a subscriber");
    let all = follow(length, || records.receive().expect("the bus is whole"));
    drop(records);
    drop(bus);
    let summary = pipeline.stop().expect("the daemon ends well");
    assert!(summary.cycles.adds_up, "the schedule must add up");
    Lateness { missing, ..lateness(&all) }
}

/// Takes records at intervals, so that it wakes no thread.
fn follow(length: Duration, mut take: impl FnMut() -> Option<CycleRecord>) -> Vec<CycleRecord> {
    let (begun, mut all) = (Instant::now(), Vec::new());
    while begun.elapsed() < length {
        sleep(Duration::from_millis(100));
        all.extend(std::iter::from_fn(&mut take));
    }
    all
}

fn lateness(records: &[CycleRecord]) -> Lateness {
    let mut lateness = Lateness::default();
    for pair in records.windows(2).filter(|pair| pair[1].cycle > WARM) {
        if pair[1].due_ns <= pair[0].compute_end_ns {
            lateness.caught_up += 1;
        } else {
            lateness.slept_us.push(whole_us(pair[1].woken_ns - pair[1].due_ns));
        }
    }
    lateness
}

/// cyclictest reports whole microseconds, rounded down.
fn whole_us(time_ns: u64) -> f64 {
    (time_ns / 1000) as f64
}
