//! The station under test: a real daemon at 1 kHz, adapters as separate processes, a simulated human, and a subscriber.

use std::process::Command;
use std::time::{Duration, Instant};

use equipoise_bus::{Bus, BusSettings, Subscriber};
use equipoise_core::message::{State, Validity};
use equipoise_simulator::faults::Faults;
use equipoise_simulator::settings::SimulationSettings;
use equipoise_simulator::simulation::{Simulation, SimulationHandle};
use rustix::process::Signal;

use crate::checker::Checker;
use crate::injected_fault::InjectedFault;
use crate::process::{Process, wait_for};
use crate::resources::Resources;
use crate::station::{NAME, Station, ready};

/// Duration of each fault.
const FAULT_DURATION: Duration = Duration::from_millis(2000);
/// Minimum duration without a fault afterwards.
const FAULT_FREE: Duration = Duration::from_millis(3500);
/// A restart or a jump becomes visible within this.
const VISIBLE_WITHIN: Duration = Duration::from_millis(300);
/// All values must be reported again within this.
const RECOVERS_WITHIN: Duration = Duration::from_secs(40);
/// After a restart of the suit the position is estimated from the worker's motion, and this worker holds poses most of
/// the time.
const POSITION_ESTIMATED_WITHIN: Duration = Duration::from_secs(90);
/// Upper limit, independent of how often the machine was suspended meanwhile.
const RECOVERS_AT_ALL_WITHIN: Duration = Duration::from_secs(120);
/// Maximum extension of the run if too little was checked.
const EXTENSION_MAX: Duration = Duration::from_secs(60);
/// The suit's ordinary rate, samples a second.
const SUIT_HZ: f64 = 60.0;

pub(crate) struct Rig {
    pub(crate) checker: Checker,
    states: Subscriber<State>,
    _bus: Bus,
    person: SimulationHandle,
    daemon: Process,
    adapters: [Process; 2],
    resources: Resources,
    failures: Vec<String>,
    descriptors: usize,
    next_action_at: Instant,
    random_state: u64,
    station: Station,
}

fn adapter_of(station: &Station, stream: &str, before: &[&str]) -> Process {
    let path = station.write("adapters.toml", &configuration(station)).display().to_string();
    let program = env!("CARGO_BIN_EXE_equipoise");
    let words = [before, &[program, "adapter", stream, "--config", &path]].concat();
    let mut command = Command::new(words[0]);
    command.args(&words[1..]).env("EQUIPOISE_BUS_ROOT", station.root());
    let name = |end: &str| station.file(&format!("{stream}-adapter.{end}"));
    let mut process = Process::start(command, name("out"), name("err"));
    wait_for("the adapter to run", || {
        let message = process.stderr();
        (message.contains("adapter runs") || !process.is_running()).then_some(())
    });
    process
}

fn configuration(station: &Station) -> String {
    station
        .configuration()
        .replace("rate_hz = 200", "rate_hz = 1000")
        .replace("poses_min = 1000", "poses_min = 8\nstop_cop_sigma_mm = 12")
}

impl Rig {
    pub(crate) fn start(seed: u64) -> Rig {
        let station = Station::new();
        let mut settings = station.sensors().realistic(seed);
        // The truth is that of the samples' stamps, and the stamps of a late plate are late.
        settings.plate.latency_s = 0.0;
        let person = Simulation::start(settings).expect("a simulated person");
        let external = configuration(&station)
            .replace("\"mvn-udp\"", "\"external\"")
            .replace("\"ati-rdt\"", "\"external\"");
        let daemon = ready(station.try_daemon(&external));
        let adapters = ["suit", "ground"].map(|stream| adapter_of(&station, stream, &[]));
        let settings =
            BusSettings { station: NAME.to_owned(), role: "soak".to_owned(), root: station.root() };
        let bus = Bus::join(&settings).expect("the bus");
        let states = bus.subscriber(1024).expect("a subscriber");
        let resources = Resources::of(daemon.id());
        Rig {
            checker: Checker::new(),
            states,
            _bus: bus,
            person,
            daemon,
            adapters,
            resources,
            failures: Vec::new(),
            descriptors: 0,
            next_action_at: Instant::now(),
            random_state: seed,
            station,
        }
    }

    /// The worker takes the suggested poses until the model is identified.
    pub(crate) fn identify(&mut self) {
        let started = Instant::now();
        let (mut asked, mut since) = (u32::MAX, Instant::now());
        while self.checker.state.converged == 0 {
            assert!(started.elapsed() < Duration::from_secs(120), "never identified: {:?}", self.reasons());
            self.check_states();
            let suggested = self.checker.state.suggested_pose;
            if suggested != u32::MAX && (suggested != asked || since.elapsed() > Duration::from_secs(8)) {
                (asked, since) = (suggested, Instant::now());
                self.person.take_pose(suggested as usize).expect("a pose of the library");
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        self.wait_until_all_is_published(RECOVERS_WITHIN);
        self.checker.begin_to_count();
        self.descriptors = self.resources.descriptors();
    }

    /// Checks all received states.
    fn check_states(&mut self) {
        while let Some(state) = self.states.receive().expect("the bus") {
            self.checker.check(state, &self.person);
        }
        assert!(self.daemon.is_running(), "the daemon ended: {}", self.daemon.stderr());
        self.resources.sample();
    }

    /// Advances time while the worker works and all states are checked.
    fn run_for(&mut self, time: Duration) {
        let until = Instant::now() + time;
        while Instant::now() < until {
            self.work();
            self.check_states();
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    fn work(&mut self) {
        if Instant::now() < self.next_action_at {
            return;
        }
        let random = self.next_random();
        if random.is_multiple_of(5) {
            self.person.lift_and_show(4.0 + (random % 7) as f64);
            self.next_action_at = Instant::now() + Duration::from_secs(17);
        } else {
            self.person.take_pose(random as usize / 5 % 50).expect("a pose of the library");
            self.next_action_at = Instant::now() + Duration::from_millis(2500);
        }
    }

    fn next_random(&mut self) -> u64 {
        self.random_state =
            self.random_state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.random_state >> 33
    }

    pub(crate) fn inject(&mut self, fault: InjectedFault) {
        match fault {
            InjectedFault::Loss => self.with_faults(Faults { loss: 0.2, ..Faults::default() }),
            InjectedFault::Reorder => self.with_faults(Faults { reorder: 0.2, ..Faults::default() }),
            InjectedFault::Duplicates => self.with_faults(Faults { duplicate: 0.3, ..Faults::default() }),
            InjectedFault::Truncation => self.with_faults(Faults { truncate: 0.2, ..Faults::default() }),
            InjectedFault::Garbage => self.with_faults(Faults { garbage: 0.3, ..Faults::default() }),
            InjectedFault::NotANumber => {
                self.person.change_faults(|faults| faults.suit_nan = 0.3);
                self.run_for(FAULT_DURATION);
                self.person.change_faults(|faults| faults.suit_nan = 0.0);
            }
            InjectedFault::ForeignAvatar => self.foreign_avatar(),
            InjectedFault::RateUp => self.with_rate(100.0),
            InjectedFault::RateDown => self.with_rate(40.0),
            InjectedFault::SuitUnplugged => self.unplugged(true, false),
            InjectedFault::PlateUnplugged => self.unplugged(false, true),
            InjectedFault::BothUnplugged => self.unplugged(true, true),
            InjectedFault::SuitRestarts => self.person.change_faults(|faults| {
                faults.restarts[0] += 1;
                // As after a new calibration.
                faults.suit_world.origin_m[0] += 0.3;
                faults.suit_world.origin_m[1] -= 0.2;
            }),
            InjectedFault::PlateRestarts => self.person.change_faults(|faults| faults.restarts[1] += 1),
            InjectedFault::CounterLeapsAhead => self.person.change_faults(|faults| faults.suit_leapt += 5000),
            InjectedFault::CounterLeapsBack => self.person.change_faults(|faults| faults.suit_leapt -= 300),
            InjectedFault::PlateFault => {
                self.person.set_plate_status(0x8000_0000);
                self.run_for(FAULT_DURATION);
                self.person.set_plate_status(0);
            }
            InjectedFault::ConsumerStorm => self.consumer_storm(),
            InjectedFault::SuitAdapterKilled => self.adapter_killed(0, &[]),
            InjectedFault::GroundAdapterKilled => self.adapter_killed(1, &[]),
            InjectedFault::DaemonStopped => {
                self.daemon.send(Signal::STOP);
                self.run_for(Duration::from_secs(1));
                self.daemon.send(Signal::CONT);
            }
            InjectedFault::OtherClock(shift_s) => self.other_clock(shift_s),
        }
    }

    fn with_faults(&mut self, faults: Faults) {
        let set = |person: &SimulationHandle, faults| {
            person.change_faults(|present| (present.suit_faults, present.plate_faults) = (faults, faults));
        };
        set(&self.person, faults);
        self.run_for(FAULT_DURATION);
        set(&self.person, Faults::default());
    }

    fn with_rate(&mut self, rate_hz: f64) {
        self.person.change_faults(|faults| faults.suit_rate_hz = rate_hz);
        self.run_for(2 * FAULT_DURATION);
        self.person.change_faults(|faults| faults.suit_rate_hz = SUIT_HZ);
    }

    fn unplugged(&mut self, suit: bool, plate: bool) {
        self.person.silence_suit(suit);
        self.person.silence_plate(plate);
        self.run_for(FAULT_DURATION);
        for (unplugged, stale) in [(suit, Validity::SUIT_STALE), (plate, Validity::GROUND_STALE)] {
            if unplugged {
                self.must_be_reported(stale);
            }
        }
        self.person.silence_suit(false);
        self.person.silence_plate(false);
    }

    /// Checks that a reason is raised at all; the checker validates its timing.
    fn must_be_reported(&mut self, reason: Validity) {
        let started = Instant::now();
        while !self.checker.state.validity().any_of(reason) {
            assert!(
                started.elapsed() < RECOVERS_WITHIN,
                "during {}: {:?}",
                self.checker.during,
                self.reasons()
            );
            self.run_for(Duration::from_millis(20));
        }
    }

    /// A foreign suit streams to the same port.
    fn foreign_avatar(&mut self) {
        let mut settings =
            SimulationSettings { seed: self.next_random(), height_m: 1.6, ..self.station.sensors() };
        settings.suit.avatar = 3;
        settings.plate.address.set_port(0);
        let other_person = Simulation::start(settings).expect("another simulated person");
        other_person.take_pose(20).expect("a pose of the library");
        self.run_for(FAULT_DURATION);
        other_person.stop().expect("an orderly end");
    }

    fn consumer_storm(&mut self) {
        for _ in 0..4 {
            let mut consumers: Vec<_> = (0..4).map(|_| self.station.spawn(&["watch"])).collect();
            self.run_for(Duration::from_millis(200));
            consumers.iter_mut().for_each(Process::kill);
        }
    }

    fn adapter_killed(&mut self, which: usize, before: &[&str]) {
        self.adapters[which].kill();
        self.run_for(Duration::from_millis(700));
        let stale = [Validity::SUIT_STALE, Validity::GROUND_STALE][which];
        self.must_be_reported(stale);
        let stream = ["suit", "ground"][which];
        self.adapters[which] = adapter_of(&self.station, stream, before);
    }

    /// The suit's adapter restarts in another time namespace: its stamps are those of another clock. While it runs, no
    /// state may use them; a diagnostic is output, unless the stamps are consistent with a slow connection.
    fn other_clock(&mut self, ahead_s: i32) {
        let ahead = format!("--monotonic={ahead_s}");
        let time_namespace = ["unshare", "--time", &ahead, "--fork", "--kill-child"];
        let named = |rig: &Rig| rig.daemon.stderr().matches("their adapter runs on another clock").count();
        let before = named(self);
        self.adapter_killed(0, &time_namespace);
        if self.adapters[0].is_running() {
            self.checker.required_reason = Some(Validity::SUIT_STALE);
            self.run_for(2 * FAULT_DURATION);
            let started = Instant::now();
            while !(-5..0).contains(&ahead_s) && named(self) == before {
                assert!(
                    started.elapsed() < RECOVERS_WITHIN,
                    "no incident says that a clock is {ahead_s} s ahead"
                );
                self.run_for(Duration::from_millis(100));
            }
            self.checker.required_reason = None;
        } else {
            println!("skipped: this user makes no time namespace: {}", self.adapters[0].stderr().trim());
        }
        self.adapter_killed(0, &[]);
    }

    /// Checks that all values are reported again within a bound, and remain so for a while. Returns the duration.
    pub(crate) fn recover(&mut self, fault: InjectedFault) -> Duration {
        let started = Instant::now();
        self.checker.during = fault.name();
        // Immediate faults must have become visible; otherwise the state would still appear healthy.
        self.run_for(VISIBLE_WITHIN);
        let within =
            if fault == InjectedFault::SuitRestarts { POSITION_ESTIMATED_WITHIN } else { RECOVERS_WITHIN };
        self.wait_until_all_is_published(within);
        let took = started.elapsed();
        self.run_for(FAULT_FREE);
        took
    }

    fn wait_until_all_is_published(&mut self, within: Duration) {
        let begun = Instant::now();
        let (mut started, mut held_up_ns) = (begun, [0; 2]);
        let before = self.checker.state.cycle;
        while self.checker.state.cycle == before
            || self.checker.state.validity().any_of(Validity::INVALIDATES_RESIDUAL)
        {
            if self.person.held_up_ns() != held_up_ns {
                // The time limit excludes periods in which the machine is suspended.
                (started, held_up_ns) = (Instant::now(), self.person.held_up_ns());
            }
            if started.elapsed() > within || begun.elapsed() > RECOVERS_AT_ALL_WITHIN {
                let message = format!("not recovered from {}: {:?}", self.checker.during, self.reasons());
                println!("{message}");
                self.failures.push(message);
                return;
            }
            self.run_for(Duration::from_millis(20));
        }
    }

    fn reasons(&self) -> Vec<&'static str> {
        self.checker.state.validity().names().collect()
    }

    /// Shuts everything down and returns the verdict.
    pub(crate) fn end(mut self, events: u64) {
        self.checker.during = "the end";
        let begun = Instant::now();
        while self.checker.insufficient().is_some() && begun.elapsed() < EXTENSION_MAX {
            self.run_for(FAULT_FREE);
        }
        let descriptors = || self.resources.descriptors();
        wait_for("descriptors to be given back", || (descriptors() <= self.descriptors + 2).then_some(()));
        let memory = self.resources.check_growth();
        self.failures.extend(memory.as_ref().err().map(|message| format!("memory: {message}")));
        println!(
            "{} states checked, {:?} of them with delayed suit and ground samples, {} missed, {events} faults; {}; {} of {} descriptors\n{}",
            self.checker.states,
            self.checker.excluded,
            self.checker.missed,
            memory.unwrap_or_else(|message| message),
            descriptors(),
            self.descriptors,
            self.checker.worst()
        );
        // Shutdown in the reverse order: the station's files last.
        let Rig { station, checker, states, _bus: bus, person, mut daemon, mut adapters, failures, .. } =
            self;
        drop((states, bus));
        for process in adapters.iter_mut().chain([&mut daemon]) {
            assert_eq!(process.stop(Signal::TERM), Some(0), "{}", process.stderr());
            assert!(!process.stderr().contains("panicked"), "{}", process.stderr());
        }
        assert!(daemon.stderr().contains("schedule_adds_up=true"), "{}", daemon.stderr());
        person.stop().expect("an orderly end of the simulation");
        let mut left = station.files_of_the_bus();
        left.retain(|path| {
            path.starts_with("/dev/shm") && path.extension().is_none_or(|end| end != "global_mgmt")
        });
        assert!(left.is_empty(), "shared memory is left: {left:?}");
        let wrong = [failures, checker.report()].concat();
        assert!(
            wrong.is_empty(),
            "wrong values were published as valid, or none again:\n{}",
            wrong.join("\n")
        );
        if let Some(reason) = checker.insufficient() {
            let excluded = checker.excluded;
            let why = format!(
                "too busy for a verdict: {reason}; {excluded:?} states had a sensor that was held up"
            );
            // Only the stage of the gate requires a verdict: it has another try.
            assert!(std::env::var_os("SOAK_SECONDS").is_none(), "{why}");
            println!("skipped: {why}");
        }
    }
}
