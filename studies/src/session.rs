//! One subject before one estimator: time goes on, samples go in, every new state is seen beside the truth.

use equipoise_core::cycle::{Inputs, Memory, Settings, Tick, step};
use equipoise_core::message::command::CommandKind;
use equipoise_core::message::{GroundSample, State, SuitSample};
use equipoise_core::pose_suggestion::Posture;
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::noise::Suit;
use equipoise_simulator::truth::Truth;

use crate::sensors::{EPOCH_NS, Rig, ground_sample, sample_time_ns, simulated_s, suit_sample};
use crate::subject::Subject;

/// The loop's period: 200 Hz. The daemon's 1 kHz tells the same values more often; each is looked at once.
const TICK_NS: u64 = 5_000_000;
/// The worker obeys this long after an order, so that no sample has yet seen the time from which it holds, s.
const REACTION_S: f64 = 0.02;

/// One new state at its own time.
#[derive(Debug, Clone, Copy)]
pub struct Moment<'a> {
    /// What the estimator tells.
    pub state: &'a State,
    /// Who it tells it of.
    pub worker: &'a Worker,
    /// Simulated time that the state belongs to (`suit_sample_time_ns`, not the tick's), s.
    pub time_s: f64,
}

impl Moment<'_> {
    /// What is really so at the state's own time.
    pub fn truth(&self) -> Truth {
        Truth::of(self.worker, self.time_s)
    }
}

/// A subject, the sensors, and the estimator's memory.
#[derive(Debug)]
pub struct Session {
    subject: Subject,
    settings: Settings,
    rig: Rig,
    worker: Worker,
    suit: Suit,
    memory: Box<Memory>,
    now_ns: u64,
    cycle: u64,
    suit_next: u32,
    ground_next: u32,
    seen_ns: u64,
    asked: Vec<Posture>,
}

impl Session {
    /// The subject stands straight at time 0, in an ordinary suit on a good plate; nothing is learnt yet.
    pub fn new(subject: &Subject, settings: Settings) -> Session {
        Session::with(subject, settings, Rig::ORDINARY, Habits::ORDINARY)
    }

    /// The same with other sensors or habits.
    pub fn with(subject: &Subject, settings: Settings, rig: Rig, habits: Habits) -> Session {
        let mut memory = bytemuck::zeroed_box::<Memory>();
        memory.start(&settings);
        Session {
            subject: *subject,
            settings,
            rig,
            worker: Worker::with_habits(subject.person(), subject.seed, habits),
            suit: Suit::new(rig.suit_noise, subject.seed),
            memory,
            now_ns: EPOCH_NS,
            cycle: 0,
            suit_next: 0,
            ground_next: 0,
            seen_ns: 0,
            asked: Vec::new(),
        }
    }

    /// Who takes part.
    pub fn subject(&self) -> &Subject {
        &self.subject
    }

    /// What the estimator was told.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// What the estimator told last.
    pub fn state(&self) -> &State {
        &self.memory.state
    }

    /// The estimator's memory, to compare two runs.
    pub fn memory(&self) -> &Memory {
        &self.memory
    }

    /// Simulated time, s.
    pub fn now_s(&self) -> f64 {
        simulated_s(self.now_ns)
    }

    /// Gives the worker an order that holds from the time that is handed in, s.
    pub fn order(&mut self, order: impl FnOnce(&mut Worker, f64)) {
        let at_s = self.now_s() + REACTION_S;
        order(&mut self.worker, at_s);
    }

    /// The worker starts to take a posture, and has it after `over_s`.
    pub fn take_pose(&mut self, posture: &Posture, over_s: f64) {
        self.asked.push(*posture);
        self.order(|worker, at_s| worker.take_pose(posture, at_s, over_s));
    }

    /// Whether the worker was ever told to take that posture.
    pub fn was_asked(&self, posture: &Posture) -> bool {
        self.asked.contains(posture)
    }

    /// A command to the estimator; a cycle passes.
    pub fn command(&mut self, command: CommandKind) {
        self.tick(Some(command));
    }

    /// Lets time pass; `see` is shown every new state once.
    pub fn run(&mut self, for_s: f64, mut see: impl FnMut(&Moment)) {
        self.run_until(for_s, |moment| {
            see(moment);
            false
        });
    }

    /// The same until `done` says so or `for_s` is over. Returns whether it did.
    pub fn run_until(&mut self, for_s: f64, mut done: impl FnMut(&Moment) -> bool) -> bool {
        let end_ns = self.now_ns + (for_s * 1e9) as u64;
        while self.now_ns < end_ns {
            self.tick(None);
            if self.take_new().is_some_and(|moment| done(&moment)) {
                return true;
            }
        }
        false
    }

    /// Lets time pass in which nobody measures: cheap, and a gap in both streams.
    pub fn leap(&mut self, by_s: f64) {
        self.now_ns += (by_s * 1e9) as u64 / TICK_NS * TICK_NS;
        let first_after = |rate_hz: u32| {
            let passed_ns = u128::from(self.now_ns - EPOCH_NS);
            (passed_ns * u128::from(rate_hz) / 1_000_000_000 + 1) as u32
        };
        self.suit_next = self.suit_next.max(first_after(self.rig.suit_hz));
        self.ground_next = self.ground_next.max(first_after(self.rig.plate_hz));
    }

    fn tick(&mut self, command: Option<CommandKind>) {
        self.now_ns += TICK_NS;
        self.cycle += 1;
        let (now_ns, rig) = (self.now_ns, &self.rig);
        let mut suit: Vec<SuitSample> = Vec::new();
        while sample_time_ns(self.suit_next, rig.suit_hz) <= now_ns {
            suit.push(suit_sample(&self.worker, &self.suit, rig, self.suit_next));
            self.suit_next += 1;
        }
        let mut ground: Vec<GroundSample> = Vec::new();
        while sample_time_ns(self.ground_next, rig.plate_hz) <= now_ns {
            ground.push(ground_sample(&self.worker, rig, self.subject.seed, self.ground_next));
            self.ground_next += 1;
        }
        let tick = Tick { cycle: self.cycle, due_ns: now_ns };
        step(&self.settings, &mut self.memory, tick, Inputs { suit: &suit, ground: &ground, command });
    }

    /// The state if it belongs to another suit sample than the one seen last.
    fn take_new(&mut self) -> Option<Moment<'_>> {
        let told_ns = self.memory.state.suit_sample_time_ns;
        if told_ns == self.seen_ns {
            return None;
        }
        self.seen_ns = told_ns;
        Some(Moment { state: &self.memory.state, worker: &self.worker, time_s: simulated_s(told_ns) })
    }
}
