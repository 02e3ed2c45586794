//! One turn: adapter → ingress → the real loop → egress → consumer, over one carrier, for about a second.
//!
//! Both ends of the loop are measured separately, so that a sample's wait for the next cycle is excluded: the ingress leg
//! ends when the sample is in the loop's ring, the egress leg begins when the loop has computed.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::{Duration, Instant};

use crossbeam_channel::bounded;
use equipoise_benches::worker::{HEIGHT_M, Worker};
use equipoise_bus::{Bus, BusSettings, Channel, Event, Publisher};
use equipoise_config::WaitStrategy;
use equipoise_core::cycle::{Memory, Settings};
use equipoise_core::message::{CycleRecord, State, SuitSample};
use equipoise_daemon::egress::Egress;
use equipoise_daemon::ingress::Ingress;
use equipoise_daemon::latency_log::feed::{CAPACITY, feed};
use equipoise_daemon::realtime::{self, RequestedScheduling, now_ns, sleep_until};
use equipoise_daemon::rings::{EgressEnds, IngressEnds, LoopControl, LoopEnds, Rings};
use equipoise_daemon::tick::{Loop, Monotonic, Observer};
use equipoise_latency::PathHistograms;

use crate::carrier::{Carrier, Socket, WAKE_AT_LEAST};
use crate::consumer::{Consumer, SETTLE};

const STATION: &str = "path";
/// 1 kHz; the adapter has a sample in the middle of each period.
const PERIOD_NS: u64 = 1_000_000;
/// Cycles after which caches, connections and page tables are warm.
const WARM: u64 = 100;
/// Maximum number of records of one thread in a turn: a minute.
const NOTES: usize = 1 << 16;
/// The daemon's own priorities.
const LOOP: u32 = 80;
const INGRESS: u32 = 70;
const EGRESS: u32 = 60;

/// Settings of a turn.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plan {
    pub(crate) carrier: Carrier,
    pub(crate) waiting: WaitStrategy,
    /// Whether there are adapter and ingress.
    pub(crate) ingress_leg: bool,
    /// Whether there are egress and consumer.
    pub(crate) egress_leg: bool,
    pub(crate) cores: Cores,
    pub(crate) length: Duration,
}

/// Cores of the threads.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Cores {
    pub(crate) adapter: Option<usize>,
    pub(crate) ingress: Option<usize>,
    pub(crate) looping: Option<usize>,
    pub(crate) egress: Option<usize>,
    pub(crate) consumer: Option<usize>,
}

/// Measurements of a turn.
#[derive(Debug, Default)]
pub(crate) struct Times {
    /// From the sample's arrival until it is in the ring, µs.
    pub(crate) ingress_us: Vec<f64>,
    /// From the state computed until the consumer has read all of it, µs.
    pub(crate) egress_us: Vec<f64>,
    /// From the state computed until it is handed over, in the loop's own thread, µs.
    pub(crate) step_us: Vec<f64>,
    /// Messages sent and arrived, both legs.
    pub(crate) sent: usize,
    pub(crate) arrived: usize,
}

impl Plan {
    /// Runs it; `folder` is for sockets.
    pub(crate) fn run(&self, folder: &Path) -> Times {
        let Rings { control, loop_ends, ingress: ingress_ends, egress: egress_ends, .. } =
            Rings::new().expect("an event file descriptor");
        let begun = Arc::new(AtomicU64::new(0));
        let consumer = self.egress_leg.then(|| {
            let place = folder.join("out").display().to_string();
            Consumer::start(STATION, self.carrier, self.waiting, self.cores.consumer, &place)
        });
        let egress = consumer.as_ref().map(|(_, address)| self.start_egress(egress_ends, address));
        let ingress_leg = self.ingress_leg.then(|| self.start_ingress(ingress_ends, &begun, folder));
        let records = self.egress_leg.then(RecordReader::open);
        sleep(SETTLE);
        let looping = self.start_loop(loop_ends, &begun);
        let records = match (records, self.carrier) {
            (Some(reader), Carrier::Bus) => reader.follow(self.length),
            _ => {
                sleep(self.length);
                Vec::new()
            }
        };
        control.stop();
        let pushed = looping.join().expect("the loop ended well");
        let socket_records = egress.map(|thread| thread.join().expect("egress ended well"));
        let mut times = Times::default();
        if let Some((adapter, ingress)) = ingress_leg {
            let sent = adapter.join().expect("the adapter ended well");
            times.note_ingress(&sent, &ingress.join().expect("ingress ended well"));
        }
        if let Some((consumer, _)) = consumer {
            sleep(SETTLE);
            let records = socket_records.flatten().unwrap_or(records);
            times.note_egress(&records, &pushed, consumer.finish());
        }
        times
    }

    fn start_loop(&self, ends: LoopEnds, begun: &Arc<AtomicU64>) -> JoinHandle<Vec<(u64, u64)>> {
        let (control, cpu) = (Arc::clone(&ends.control), self.cores.looping);
        let mut stamps = Stamps { pushed: vec![(1, 1); NOTES], used: 0, begun: Arc::clone(begun) };
        let settings = Settings::for_height(HEIGHT_M);
        spawn(move || {
            let _runs = control.mark_loop_running();
            realtime::prefault_stack();
            realtime::request("loop", RequestedScheduling { fifo_priority: LOOP, cpu });
            let mut memory = bytemuck::zeroed_box::<Memory>();
            memory.start(&settings);
            let summary = Loop::new(settings, memory, 0, ends, PERIOD_NS).run(&mut Monotonic, &mut stamps);
            assert!(summary.adds_up, "the schedule must add up");
            stamps.pushed.truncate(stamps.used);
            stamps.pushed
        })
    }

    /// With sockets it returns the cycle records, since there is no bus to read them from.
    fn start_egress(&self, mut ends: EgressEnds, address: &str) -> JoinHandle<Option<Vec<CycleRecord>>> {
        let (plan, address) = (*self, address.to_owned());
        let (ready, is_ready) = bounded(1);
        let thread = spawn(move || {
            realtime::request(
                "egress",
                RequestedScheduling { fifo_priority: EGRESS, cpu: plan.cores.egress },
            );
            if plan.carrier == Carrier::Bus {
                // The latency log is not drained; a full feed only counts.
                let (latency_log, _drain) = feed(CAPACITY);
                let egress = Egress::open(STATION, ends, plan.waiting, latency_log);
                let _ = ready.send(());
                egress.and_then(Egress::run).expect("the bus is whole");
                return None;
            }
            let socket = Socket::sender(plan.carrier, &address);
            let (mut records, mut latency) = (Vec::with_capacity(NOTES), PathHistograms::new());
            let _ = ready.send(());
            // As in egress, with one socket in place of the bus.
            loop {
                let ended = ends.control.has_ended();
                ends.await_outcome(plan.waiting, WAKE_AT_LEAST);
                while let Ok(mut outcome) = ends.outcome.pop() {
                    outcome.state.published_ns = now_ns();
                    socket.send(bytemuck::bytes_of(&outcome.state));
                    outcome.record.published_ns = now_ns();
                    latency.record(&outcome.record);
                    records.push(outcome.record);
                }
                if ended {
                    return Some(records);
                }
            }
        });
        is_ready.recv().expect("egress begins");
        thread
    }

    fn start_ingress(
        &self,
        ends: IngressEnds,
        begun: &Arc<AtomicU64>,
        folder: &Path,
    ) -> (RecorderThread, RecorderThread) {
        let (plan, place, control) = (*self, folder.join("in"), Arc::clone(&ends.control));
        let its_control = Arc::clone(&control);
        let (ready, is_ready) = bounded(1);
        let ingress = spawn(move || {
            realtime::request(
                "ingress",
                RequestedScheduling { fifo_priority: INGRESS, cpu: plan.cores.ingress },
            );
            match plan.carrier {
                Carrier::Bus => {
                    let ingress = Ingress::open(STATION, ends, plan.waiting).expect("the bus is there");
                    let _ = ready.send(String::new());
                    take_from_the_bus(ingress, &its_control)
                }
                carrier => {
                    let (socket, address) = Socket::receiver(carrier, &place, plan.waiting);
                    let _ = ready.send(address);
                    take_from_a_socket(&socket, ends)
                }
            }
        });
        let address = is_ready.recv().expect("ingress begins");
        let begun = Arc::clone(begun);
        (spawn(move || plan.adapt(&address, &control, &begun)), ingress)
    }

    /// The adapter: a sample in the middle of each of the loop's periods.
    fn adapt(&self, address: &str, control: &LoopControl, begun: &AtomicU64) -> Vec<(u64, u64)> {
        // Polling threads would keep an ordinary thread from its core for ever.
        let fifo_priority = if self.waiting == WaitStrategy::Polling { LOOP } else { 0 };
        realtime::request("adapter", RequestedScheduling { fifo_priority, cpu: self.cores.adapter });
        let worker = Worker::new();
        let mut sample = worker.suit(&worker.pose(0), 0);
        let sender = SampleSender::open(self.carrier, address);
        let mut sent = Vec::with_capacity(NOTES);
        while begun.load(Ordering::Acquire) == 0 && !control.is_stopping() {
            sleep(Duration::from_millis(1));
        }
        let mut due_ns = begun.load(Ordering::Acquire) + PERIOD_NS / 2;
        while !control.is_stopping() {
            due_ns += PERIOD_NS * (1 + now_ns().saturating_sub(due_ns) / PERIOD_NS);
            sleep_until(due_ns);
            sample.arrival_ns = now_ns();
            sample.sequence = sent.len() as u64 + 1;
            sample.sample_time_ns = sample.arrival_ns;
            sample.published_ns = now_ns();
            sender.send(&sample);
            sent.push((sample.sequence, sample.arrival_ns));
        }
        sent
    }
}

/// A thread that records a number and a time of each message.
type RecorderThread = JoinHandle<Vec<(u64, u64)>>;

struct OnTheBus {
    samples: Publisher<SuitSample>,
    wake: equipoise_bus::Notifier,
    // Field order: ports are dropped before the node they belong to.
    _bus: Bus,
}

/// The adapter's end.
enum SampleSender {
    Bus(Box<OnTheBus>),
    Socket(Socket),
}

impl SampleSender {
    fn open(carrier: Carrier, address: &str) -> SampleSender {
        if carrier != Carrier::Bus {
            return SampleSender::Socket(Socket::sender(carrier, address));
        }
        let bus = Bus::join(&BusSettings::new(STATION, "adapter")).expect("the bus is there");
        let (samples, wake) = (bus.publisher(), bus.notifier(Channel::Inputs));
        let (samples, wake) =
            (samples.expect("a place for a publisher"), wake.expect("a place for a notifier"));
        SampleSender::Bus(Box::new(OnTheBus { samples, wake, _bus: bus }))
    }

    fn send(&self, sample: &SuitSample) {
        match self {
            SampleSender::Bus(bus) => {
                bus.samples.send(sample).expect("the bus is whole");
                bus.wake.notify(Event::NewSuit).expect("the bus is whole");
            }
            SampleSender::Socket(socket) => socket.send(bytemuck::bytes_of(sample)),
        }
    }
}

fn take_from_the_bus(mut ingress: Ingress, control: &LoopControl) -> Vec<(u64, u64)> {
    let (mut taken, mut count) = (Vec::with_capacity(NOTES), 0);
    while !control.is_stopping() {
        ingress.wait().expect("the bus is whole");
        let several = ingress.forward().expect("the bus is whole") as u64;
        let now_ns = now_ns();
        // The bus loses only messages a quarter of a second late: the count is the sequence.
        taken.extend((1..=several).map(|one| (count + one, now_ns)));
        count += several;
    }
    taken
}

fn take_from_a_socket(socket: &Socket, mut ends: IngressEnds) -> Vec<(u64, u64)> {
    let mut taken = Vec::with_capacity(NOTES);
    let mut sample: SuitSample = bytemuck::Zeroable::zeroed();
    while !ends.control.is_stopping() {
        if socket.receive(bytemuck::bytes_of_mut(&mut sample)) {
            ends.push_suit(sample, now_ns());
            taken.push((sample.sequence, now_ns()));
        }
    }
    taken
}

/// Records inside the loop when each outcome was handed over.
struct Stamps {
    pushed: Vec<(u64, u64)>,
    used: usize,
    begun: Arc<AtomicU64>,
}

impl Observer for Stamps {
    fn cycle_begins(&mut self, cycle: u64) {
        if cycle == 1 {
            self.begun.store(now_ns(), Ordering::Release);
        }
    }

    fn cycle_ends(&mut self, cycle: u64) {
        if let Some(place) = self.pushed.get_mut(self.used) {
            *place = (cycle, now_ns());
            self.used += 1;
        }
    }
}

/// Takes the cycle records off the bus.
struct RecordReader {
    records: equipoise_bus::Subscriber<CycleRecord>,
    _bus: Bus,
}

impl RecordReader {
    fn open() -> RecordReader {
        let bus = Bus::join(&BusSettings::new(STATION, "records")).expect("the bus is there");
        RecordReader { records: bus.subscriber(1024).expect("a place for a subscriber"), _bus: bus }
    }

    fn follow(mut self, length: Duration) -> Vec<CycleRecord> {
        let (begun, mut all) = (Instant::now(), Vec::with_capacity(NOTES));
        loop {
            sleep(Duration::from_millis(100).min(length));
            // Polling threads may have kept this thread from its core for the whole turn: read pending records first.
            while let Some(record) = self.records.receive().expect("the bus is whole") {
                all.push(record);
            }
            if begun.elapsed() >= length {
                return all;
            }
        }
    }
}

impl Times {
    fn note_ingress(&mut self, sent: &[(u64, u64)], taken: &[(u64, u64)]) {
        let sent_ns: HashMap<u64, u64> = sent.iter().copied().collect();
        self.ingress_us = between(&sent_ns, taken.iter().copied());
        self.sent += sent.len();
        self.arrived += taken.len();
    }

    fn note_egress(
        &mut self,
        records: &[CycleRecord],
        pushed: &[(u64, u64)],
        (read, bytes): (Vec<(u64, u64)>, u64),
    ) {
        let computed_ns: HashMap<u64, u64> =
            records.iter().map(|record| (record.cycle, record.compute_end_ns)).collect();
        self.step_us = between(&computed_ns, pushed.iter().copied());
        self.egress_us = between(&computed_ns, read.iter().copied());
        assert_eq!(
            bytes,
            (read.len() * size_of::<State>()) as u64,
            "the consumer read each byte of each state"
        );
        self.sent += pushed.len();
        self.arrived += read.len();
    }
}

/// Durations in µs for all numbers in both, without the warm-up.
fn between(from_ns: &HashMap<u64, u64>, to_ns: impl Iterator<Item = (u64, u64)>) -> Vec<f64> {
    to_ns
        .filter(|(number, _)| *number > WARM)
        .filter_map(|(number, to)| from_ns.get(&number).map(|from| to.saturating_sub(*from) as f64 * 1e-3))
        .collect()
}
