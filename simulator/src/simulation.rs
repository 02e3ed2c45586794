//! The whole simulated station, live: a worker, a suit that streams, a plate that answers.
//!
//! Simulated time runs one to one with CLOCK_MONOTONIC from the start. Each sensor is a thread that sleeps to absolute
//! times and never skips a sample: late samples are sent at once.

mod plates;

pub use plates::OnPlates;

use std::io;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, PoisonError, RwLock};

use equipoise_core::pose_suggestion::library::LIBRARY;
use nalgebra::Vector2;

use crate::clock::{DeviceClock, monotonic_ns, sleep_until_ns, span_ns};
use crate::devices::load::OnFeet;
use crate::devices::running::Load;
use crate::faults::Faults;
use crate::intention::Intention;
use crate::motion::Worker;
use crate::noise::Suit;
use crate::person::Person;
use crate::plate_server::PlateServer;
use crate::random::Random;
use crate::reach::{HeldPart, ReachHabits};
use crate::settings::{SimulationSettings, SuitSettings};
use crate::suit_sender::{SuitSender, SuitWorld, frame_at};
use crate::threads::Threads;
use crate::truth::Truth;
use crate::walk::StandingPosition;

/// Delay between a command and its effect, so that no sensor has already sampled the time from which it applies, s.
const REACTION_S: f64 = 0.02;
/// A sample sent later than due by this counts as delayed by the host, ns.
const HELD_UP_NS: u64 = 10_000_000;
/// Pressure point of each foot, from its ankle, m.
const PRESS_M: [Vector2<f64>; 2] = [Vector2::new(0.05, 0.0), Vector2::new(0.05, 0.0)];
/// Default duration of a transition to a pose, s.
const POSE_S: f64 = 1.8;

/// State shared between the threads and the handle.
#[derive(Debug)]
struct Shared {
    settings: SimulationSettings,
    worker: RwLock<Worker>,
    on_plates: RwLock<OnPlates>,
    start_ns: u64,
    suit_silent: AtomicBool,
    plate_silent: [AtomicBool; 2],
    plate_status: AtomicU32,
    faults: RwLock<StationFaults>,
    /// Sample times of the newest sent samples of suit and plate, CLOCK_MONOTONIC.
    sent_ns: [AtomicU64; 2],
    /// Their send times, CLOCK_MONOTONIC.
    sent_at_ns: [AtomicU64; 2],
    /// When each was last delayed by the host, CLOCK_MONOTONIC.
    held_up_ns: [AtomicU64; 2],
}

/// Present faults of devices and network; may change at any time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StationFaults {
    /// Sample rate of the suit, Hz.
    pub suit_rate_hz: f64,
    /// Faults of the suit's network.
    pub suit_faults: Faults,
    /// Probability that a sample with a NaN position precedes a sample of the suit.
    pub suit_nan: f64,
    /// Faults of the plate's network.
    pub plate_faults: Faults,
    /// Power cycles of each device: suit, plate.
    pub restarts: [u32; 2],
    /// The suit's world in the station's: changes with each new calibration.
    pub suit_world: SuitWorld,
    /// Total jump of the suit's counter.
    pub suit_leapt: i32,
}

impl Shared {
    /// Runs `look` on the worker; a panicked thread cannot have left it partly changed.
    fn with_worker<T>(&self, look: impl FnOnce(&Worker) -> T) -> T {
        look(&self.worker.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Calls `step` for every sample at its time until the stop flag is set.
    fn pace(
        &self,
        stop: &AtomicBool,
        sensor: usize,
        (rate_hz, latency_s): (f64, f64),
        mut step: impl FnMut(&mut DeviceClock) -> io::Result<f64>,
    ) -> io::Result<()> {
        let mut clock = DeviceClock::new(rate_hz);
        loop {
            sleep_until_ns(self.start_ns + span_ns(clock.time_s() + latency_s));
            if stop.load(Ordering::Relaxed) {
                return Ok(());
            }
            // Checked before sending, so that no late sample goes out unmarked, and after it, since sending takes time.
            let due_s = clock.time_s() + latency_s;
            self.note_held_up(sensor, due_s);
            let rate_hz = step(&mut clock)?;
            self.note_held_up(sensor, due_s);
            clock.advance(rate_hz);
        }
    }

    fn faults(&self) -> StationFaults {
        *self.faults.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn note_held_up(&self, sensor: usize, due_s: f64) {
        let now_ns = monotonic_ns();
        if now_ns > self.start_ns + span_ns(due_s) + HELD_UP_NS {
            self.held_up_ns[sensor].store(now_ns, Ordering::Relaxed);
        }
    }

    fn note_sent(&self, sensor: usize, time_s: f64) {
        self.sent_ns[sensor].store(self.start_ns + span_ns(time_s), Ordering::Relaxed);
        self.sent_at_ns[sensor].store(monotonic_ns(), Ordering::Relaxed);
    }

    fn run_suit(&self, mut sender: SuitSender, stop: &AtomicBool) -> io::Result<()> {
        let settings = &self.settings.suit;
        let suit = Suit::new(settings.noise, self.settings.seed);
        let mut random = Random::new(self.settings.seed, "suit trouble");
        let mut before = self.faults();
        self.pace(stop, 0, (settings.rate_hz, settings.latency_s), |clock| {
            let faults = self.faults();
            if faults.restarts[0] != before.restarts[0] {
                clock.restart();
            }
            clock.leap(faults.suit_leapt.wrapping_sub(before.suit_leapt));
            before = faults;
            if self.suit_silent.load(Ordering::Relaxed) {
                return Ok(faults.suit_rate_hz);
            }
            sender.set_faults(faults.suit_faults);
            if clock.counter() % faults.suit_rate_hz.round().max(1.0) as u32 == 0 {
                self.with_worker(|worker| sender.introduce(worker.person(), settings.avatar))?;
            }
            let time_s = clock.time_s();
            let device_ms = (f64::from(clock.counter()) / clock.rate_hz() * 1000.0) as u32;
            let device = (clock.counter(), device_ms);
            let mut seen = self.with_worker(|worker| {
                frame_at(worker, &suit, faults.suit_world, settings.streams, settings.avatar, time_s, device)
            });
            if random.happens(faults.suit_nan) {
                let sound = seen.position_m[0];
                seen.position_m[0][2] = f64::NAN;
                sender.send(&seen)?;
                seen.position_m[0] = sound;
            }
            sender.send(&seen)?;
            self.note_sent(0, time_s);
            Ok(faults.suit_rate_hz)
        })
    }
}

/// A simulated station.
#[derive(Debug)]
pub struct Simulation;

impl Simulation {
    /// Starts the worker and both sensors.
    ///
    /// # Errors
    /// Those of the sockets, for example that the plate's address is taken.
    pub fn start(settings: SimulationSettings) -> io::Result<SimulationHandle> {
        let SuitSettings { target, faults, tcp, .. } = settings.suit;
        let sender = match tcp {
            true => SuitSender::over_tcp(target, faults, settings.seed),
            false => SuitSender::new(target, faults, settings.seed)?,
        };
        let server =
            PlateServer::bind(settings.plate.address, settings.plate.faults, settings.seed.wrapping_add(1))?;
        let plate_address = server.address();
        let seed = settings.seed.wrapping_add(2);
        let second_server = settings.second_plate.as_ref();
        let second_server = second_server
            .map(|second| PlateServer::bind(second.address, settings.plate.faults, seed))
            .transpose()?;
        let person = Person::new(settings.seed, settings.height_m, settings.mass_kg);
        let faults = StationFaults {
            suit_rate_hz: settings.suit.rate_hz,
            suit_faults: settings.suit.faults,
            suit_nan: 0.0,
            plate_faults: settings.plate.faults,
            restarts: [0; 2],
            suit_world: settings.suit.world,
            suit_leapt: 0,
        };
        let shared = Arc::new(Shared {
            worker: RwLock::new(Worker::with_habits(person, settings.seed, settings.habits)),
            on_plates: RwLock::new(OnPlates::Worker),
            settings,
            start_ns: monotonic_ns(),
            suit_silent: AtomicBool::new(false),
            plate_silent: [AtomicBool::new(false), AtomicBool::new(false)],
            plate_status: AtomicU32::new(0),
            faults: RwLock::new(faults),
            sent_ns: [AtomicU64::new(0), AtomicU64::new(0)],
            sent_at_ns: [AtomicU64::new(0), AtomicU64::new(0)],
            held_up_ns: [AtomicU64::new(0), AtomicU64::new(0)],
        });
        let mut threads = Threads::new();
        let suit = Arc::clone(&shared);
        threads.spawn("sim-suit", move |stop| suit.run_suit(sender, stop))?;
        if let Some(server) = second_server {
            let second = Arc::clone(&shared);
            threads.spawn("sim-plate-2", move |stop| second.run_plate(server, 1, stop))?;
        }
        let first = Arc::clone(&shared);
        threads.spawn("sim-plate", move |stop| first.run_plate(server, 0, stop))?;
        Ok(SimulationHandle { shared, plate_address, threads })
    }
}

/// Pose index beyond the library.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the library has no pose {0}; the last is {last}", last = LIBRARY.len() - 1)]
pub struct NoSuchPose(pub usize);

/// Controls and queries a running simulation. Dropping it stops the simulation.
#[derive(Debug)]
pub struct SimulationHandle {
    shared: Arc<Shared>,
    plate_address: SocketAddr,
    threads: Threads<()>,
}

impl SimulationHandle {
    fn command(&self, order: impl FnOnce(&mut Worker, f64)) {
        let mut worker = self.shared.worker.write().unwrap_or_else(PoisonError::into_inner);
        // Read with the lock held: the sensors went on while it was awaited.
        let at_s = self.now_s() + REACTION_S;
        order(&mut worker, at_s);
    }

    /// Address of the plate.
    pub fn plate_address(&self) -> SocketAddr {
        self.plate_address
    }

    /// Settings of the simulation.
    pub fn settings(&self) -> &SimulationSettings {
        &self.shared.settings
    }

    /// CLOCK_MONOTONIC at simulated time 0, ns.
    pub fn start_ns(&self) -> u64 {
        self.shared.start_ns
    }

    /// Simulated time now, s.
    pub fn now_s(&self) -> f64 {
        (monotonic_ns() - self.shared.start_ns) as f64 * 1e-9
    }

    /// The worker takes a pose of `equipoise_core`'s library.
    ///
    /// # Errors
    /// [`NoSuchPose`] for an index beyond it.
    pub fn take_pose(&self, index: usize) -> Result<(), NoSuchPose> {
        let posture = LIBRARY.get(index).ok_or(NoSuchPose(index))?;
        self.command(|worker, at_s| worker.take_pose(posture, at_s, POSE_S));
        Ok(())
    }

    /// The worker takes the intended posture within `over_s`.
    pub fn intend(&self, intention: &Intention, over_s: f64) {
        self.command(|worker, at_s| worker.intend(intention, at_s, over_s));
    }

    /// Puts a box of that mass into the worker's hands.
    pub fn lift(&self, mass_kg: f64) {
        self.command(|worker, at_s| worker.lift(mass_kg, at_s));
    }

    /// The worker releases the box.
    pub fn put_down(&self) {
        self.command(Worker::put_down);
    }

    /// The worker picks up a box, moves it and puts it down: [`Worker::lift_and_show`].
    pub fn lift_and_show(&self, mass_kg: f64) {
        self.command(|worker, at_s| worker.lift_and_show(mass_kg, at_s));
    }

    /// The worker takes a part that is held there, and gives it back: [`Worker::hold_part`].
    pub fn hold_part(
        &self,
        habits: &ReachHabits,
        part: &HeldPart,
        mass_kg: f64,
        for_s: f64,
    ) -> Option<[f64; 2]> {
        let mut span_s = None;
        self.command(|worker, at_s| span_s = worker.hold_part(habits, part, mass_kg, at_s, for_s));
        span_s
    }

    /// The worker walks to another place: [`Worker::go`]; the first step begins in `in_s` seconds. Less than 2.5 would
    /// cause a jump, since the body leans before a step. Returns its end, s.
    pub fn go(&self, in_s: f64, to: StandingPosition) -> f64 {
        let mut end_s = 0.0;
        self.command(|worker, at_s| end_s = worker.go(at_s + in_s, to));
        end_s
    }

    /// The worker stamps a foot down `count` times: [`Worker::stomp`]. Returns its end, s.
    pub fn stomp(&self, count: u32) -> f64 {
        let mut end_s = 0.0;
        self.command(|worker, at_s| end_s = worker.stomp(at_s, count));
        end_s
    }

    /// Sets the load of the plates: the worker, nothing, or another object; at once.
    pub fn put_on_plates(&self, what: OnPlates) {
        *self.shared.on_plates.write().unwrap_or_else(PoisonError::into_inner) = what;
    }

    /// Stops or resumes the suit's stream, as during a change of its battery.
    pub fn silence_suit(&self, silent: bool) {
        self.shared.suit_silent.store(silent, Ordering::Relaxed);
    }

    /// Stops or resumes the plate's stream, as with its cable unplugged.
    pub fn silence_plate(&self, silent: bool) {
        self.shared.plate_silent[0].store(silent, Ordering::Relaxed);
    }

    /// The same of the second plate, if there is one.
    pub fn silence_second_plate(&self, silent: bool) {
        self.shared.plate_silent[1].store(silent, Ordering::Relaxed);
    }

    /// Sets the status word of all following records; 0 means no fault.
    pub fn set_plate_status(&self, status: u32) {
        self.shared.plate_status.store(status, Ordering::Relaxed);
    }

    /// Changes the faults of devices and network, from the next sample on.
    pub fn change_faults(&self, change: impl FnOnce(&mut StationFaults)) {
        change(&mut self.shared.faults.write().unwrap_or_else(PoisonError::into_inner));
    }

    /// Sample times of the newest sent samples of suit and plate, CLOCK_MONOTONIC ns; 0 for none.
    pub fn sent_ns(&self) -> [u64; 2] {
        [0, 1].map(|sensor| self.shared.sent_ns[sensor].load(Ordering::Relaxed))
    }

    /// Send times of those samples, CLOCK_MONOTONIC ns; 0 for none.
    pub fn sent_at_ns(&self) -> [u64; 2] {
        [0, 1].map(|sensor| self.shared.sent_at_ns[sensor].load(Ordering::Relaxed))
    }

    /// When the host last delayed suit and plate by more than 10 ms, so that they do not represent real sensors,
    /// CLOCK_MONOTONIC ns; 0 for never.
    pub fn held_up_ns(&self) -> [u64; 2] {
        [0, 1].map(|sensor| self.shared.held_up_ns[sensor].load(Ordering::Relaxed))
    }

    /// Truth at a simulated time. For future times it assumes no further commands.
    pub fn truth_at(&self, time_s: f64) -> Truth {
        self.shared.with_worker(|worker| Truth::of(worker, time_s))
    }

    /// Truth now.
    pub fn truth(&self) -> Truth {
        self.truth_at(self.now_s())
    }

    /// Load of the feet at a simulated time, for further devices under the same worker.
    pub fn load(&self) -> Load {
        let shared = Arc::clone(&self.shared);
        Arc::new(move |time_s| shared.with_worker(|worker| OnFeet::of(worker, time_s, PRESS_M)))
    }

    /// Stops both sensors.
    ///
    /// # Errors
    /// The error that ended a sensor early.
    pub fn stop(mut self) -> io::Result<()> {
        self.threads.stop().map(drop)
    }
}
