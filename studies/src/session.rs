//! One subject with one estimator: advances time, feeds samples, compares every new state with the truth.

use equipoise_core::cycle::{Inputs, Memory, Settings, StoredState, Tick, step};
use equipoise_core::message::command::CommandKind;
use equipoise_core::message::{EarlyState, GroundSample, State, SuitSample, Validity};
use equipoise_core::pose_suggestion::Posture;
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::noise::Suit;
use equipoise_simulator::suit_sender::SuitWorld;
use equipoise_simulator::truth::Truth;

use crate::faults::injection::{Fault, Injection};
use crate::sensors::{EPOCH_NS, Rig, ground_sample, simulated_s, suit_sample};
use crate::subject::Subject;

/// The loop's default period: 200 Hz. The daemon's 1 kHz only repeats the same values; each new state is evaluated once.
pub(crate) const TICK_NS: u64 = 5_000_000;
/// Interval between suit samples during a leap of time, ns.
const GLIMPSE_NS: u64 = 200_000_000;
/// Interval between ground samples during a leap, s: no gap, after which the lag in use would have to be proved again.
const GROUND_GLIMPSE_S: f64 = 0.05;
/// Delay between a command and its effect, so that no sample has been taken yet from the time from which it applies, s.
const REACTION_S: f64 = 0.02;

/// One new state of the estimator, with the simulated times of its data.
#[derive(Debug, Clone, Copy)]
pub struct Snapshot<'a> {
    /// Output of the estimator.
    pub state: &'a State,
    /// The worker it refers to.
    pub worker: &'a Worker,
    /// Simulated time that the state belongs to: at which its suit sample was taken, s.
    pub time_s: f64,
    /// The newest early state.
    pub early: &'a EarlyState,
    /// Simulated time that it belongs to, s.
    pub early_time_s: f64,
}

impl Snapshot<'_> {
    /// The truth at the state's own time.
    pub fn truth(&self) -> Truth {
        Truth::of(self.worker, self.time_s)
    }
}

/// A subject, the sensors, and the estimator's memory.
#[derive(Debug, Clone)]
pub struct Session {
    subject: Subject,
    settings: Settings,
    rig: Rig,
    worker: Worker,
    suit: Suit,
    memory: Box<Memory>,
    now_ns: u64,
    /// The loop's period, ns.
    tick_ns: u64,
    cycle: u64,
    suit_next: u32,
    ground_next: u32,
    seen_ns: u64,
    suit_start: SuitStart,
    /// End of each device's silence, ns: suit, ground.
    silent_until_ns: [u64; 2],
    /// Undeclared fault of a sensor.
    fault: (Fault, Injection),
    /// Outputs at every tick, if recorded.
    outputs: Option<Vec<Output>>,
    /// Time of the newest state, ns.
    new_ns: u64,
}

/// Output of the estimator at one tick, as a consumer reads it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output {
    /// Time of the tick, s.
    pub time_s: f64,
    /// Validity of the latest state.
    pub validity: Validity,
    /// Whether that state is as new as the suit's rate allows; otherwise the estimator has rejected or lost samples.
    pub is_current: bool,
}

/// Start of the suit's software.
#[derive(Debug, Clone, Copy, Default)]
struct SuitStart {
    /// Number of the sample that counts as the first.
    number: u32,
    session: u32,
}

impl Session {
    /// The subject stands straight at time 0, in the suit and on the plate of their station; nothing is identified yet.
    pub fn new(subject: &Subject, settings: Settings) -> Session {
        Session::with(subject, settings, subject.rig(), subject.habits())
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
            tick_ns: TICK_NS,
            cycle: 0,
            suit_next: 0,
            ground_next: 0,
            seen_ns: 0,
            suit_start: SuitStart::default(),
            silent_until_ns: [0; 2],
            fault: (Fault::None, Injection::default()),
            outputs: None,
            new_ns: 0,
        }
    }

    /// The subject.
    pub fn subject(&self) -> &Subject {
        &self.subject
    }

    /// Settings of the estimator.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Latest output of the estimator.
    pub fn state(&self) -> &State {
        &self.memory.state
    }

    /// The worker it refers to.
    pub fn worker(&self) -> &Worker {
        &self.worker
    }

    /// The estimator's memory, to compare two runs.
    pub fn memory(&self) -> &Memory {
        &self.memory
    }

    /// Simulated time, s.
    pub fn now_s(&self) -> f64 {
        simulated_s(self.now_ns)
    }

    /// Runs the loop at the daemon's 1 kHz from now on, for studies of ages.
    pub fn run_at_1_khz(&mut self) {
        self.tick_ns = 1_000_000;
    }

    /// Gives the worker a command, with the time from which it applies, s.
    pub fn order(&mut self, order: impl FnOnce(&mut Worker, f64)) {
        // A stream with stamps that are too early is ahead of the other.
        let ahead_s = (-self.rig.ground_late_at_s(self.now_s())).max(0.0);
        let at_s = self.now_s() + REACTION_S + ahead_s;
        order(&mut self.worker, at_s);
    }

    /// The worker begins to take a posture, and reaches it after `over_s`.
    pub fn take_pose(&mut self, posture: &Posture, over_s: f64) {
        self.order(|worker, at_s| worker.take_pose(posture, at_s, over_s));
    }

    /// Sends a command to the estimator and runs one cycle.
    pub fn command(&mut self, command: CommandKind) {
        self.tick(Some(command));
    }

    /// Restarts the suit's software, with this downtime, s: its counter restarts at zero, and its world changes.
    pub fn restart_suit(&mut self, silent_s: f64, world: SuitWorld) {
        self.silent_until_ns[0] = self.now_ns + (silent_s * 1e9) as u64;
        let number = self.rig.suit_number_at(self.silent_until_ns[0]);
        self.suit_start = SuitStart { number, session: self.suit_start.session + 1 };
        self.rig.suit_world = world;
    }

    /// Restarts the ground's device, with this downtime, s.
    pub fn restart_ground(&mut self, silent_s: f64) {
        self.silent_until_ns[1] = self.now_ns + (silent_s * 1e9) as u64;
    }

    /// Schedules a sensor fault after this time, s. Returns its start and end, s.
    pub fn fail(&mut self, fault: Fault, after_s: f64) -> [f64; 2] {
        let begins_s = self.now_s() + after_s;
        self.fault.0 = fault;
        self.fault.1.replace(begins_s, fault);
        [begins_s, begins_s + fault.lasts_s()]
    }

    /// Records the output at every tick from now on.
    pub fn record_outputs(&mut self) {
        self.outputs = Some(Vec::new());
    }

    /// Ends the recording and returns it.
    pub fn take_outputs(&mut self) -> Vec<Output> {
        self.outputs.take().unwrap_or_default()
    }

    /// Kills the daemon and restarts it after this time, s, with its saved state; its adapters count sessions from
    /// zero. Returns whether the saved state could be used.
    pub fn restart_daemon(&mut self, down_s: f64) -> bool {
        let mut kept = bytemuck::zeroed_box::<StoredState>();
        kept.copy_from(&self.memory, &self.settings);
        self.memory.start(&self.settings);
        let comes_back = self.memory.identification.restore(&kept.subject, &self.settings)
            && self.memory.resume_tare(&kept.tare)
            && self.memory.resume_registration(&kept.registration, &self.settings);
        self.memory.resume_force_offset(&kept.force_offset);
        self.now_ns += (down_s * 1e9) as u64 / TICK_NS * TICK_NS;
        self.suit_next = self.rig.suit_number_at(self.now_ns) + 1;
        self.ground_next = (self.now_s() * f64::from(self.rig.plate_hz)) as u32 + 1;
        self.suit_start.session = 0;
        comes_back
    }

    /// Advances time; `see` receives every new state once.
    pub fn run(&mut self, for_s: f64, mut see: impl FnMut(&Snapshot)) {
        self.run_until(for_s, |snapshot| {
            see(snapshot);
            false
        });
    }

    /// The same until `done` returns true or `for_s` is over. Returns whether it did.
    pub fn run_until(&mut self, for_s: f64, mut done: impl FnMut(&Snapshot) -> bool) -> bool {
        let end_ns = self.now_ns + (for_s * 1e9) as u64;
        while self.now_ns < end_ns {
            self.tick(None);
            if self.take_new().is_some_and(|snapshot| done(&snapshot)) {
                return true;
            }
        }
        false
    }

    /// Advances time with only the samples required to keep the foot anchor and the lag of the ground: cheap, and a gap
    /// for everything that uses motion.
    pub fn leap(&mut self, by_s: f64) {
        let end_ns = self.now_ns + (by_s * 1e9) as u64 / TICK_NS * TICK_NS;
        while self.now_ns < end_ns {
            let is_last = self.now_ns + GLIMPSE_NS >= end_ns;
            self.now_ns = end_ns.min(self.now_ns + GLIMPSE_NS);
            self.cycle += 1;
            let number = self.rig.suit_number_at(self.now_ns);
            let glimpse = suit_sample(&self.worker, &self.suit, &self.rig, self.subject.seed, number);
            let suit = if is_last { &[][..] } else { std::slice::from_ref(&glimpse) };
            let every = (GROUND_GLIMPSE_S * f64::from(self.rig.plate_hz)) as usize;
            let ground = self.ground_due(every.max(1));
            let tick = Tick { cycle: self.cycle, due_ns: self.now_ns };
            step(
                &self.settings,
                &mut self.memory,
                tick,
                Inputs { suit, ground: &ground, body: None, command: None },
            );
        }
        self.suit_next = self.suit_next.max(self.rig.suit_number_at(self.now_ns) + 1);
    }

    /// Every n-th of the ground samples that have arrived since the last call, the newest included.
    fn ground_due(&mut self, every: usize) -> Vec<GroundSample> {
        let rig = &self.rig;
        let begins = self.ground_next;
        while rig.ground_stamp_ns(self.ground_next) <= self.now_ns {
            self.ground_next += 1;
        }
        let due = (begins..self.ground_next).rev().step_by(every);
        due.map(|number| ground_sample(&self.worker, rig, self.subject.seed, number)).rev().collect()
    }

    fn tick(&mut self, command: Option<CommandKind>) {
        self.now_ns += self.tick_ns;
        self.cycle += 1;
        let (now_ns, rig) = (self.now_ns, &self.rig);
        let mut suit: Vec<SuitSample> = Vec::new();
        while rig.suit_stamp_ns(self.suit_next) <= now_ns {
            let sample = suit_sample(&self.worker, &self.suit, rig, self.subject.seed, self.suit_next);
            let SuitStart { number, session } = self.suit_start;
            let device_counter = self.suit_next.saturating_sub(number);
            suit.push(SuitSample { device_counter, session, ..sample });
            self.suit_next += 1;
        }
        let mut ground = self.ground_due(1);
        let [suit_is_silent, ground_is_silent] = self.silent_until_ns.map(|until_ns| now_ns < until_ns);
        if suit_is_silent {
            suit.clear();
        }
        if ground_is_silent {
            ground.clear();
        }
        let (fault, injection) = &mut self.fault;
        injection.put(*fault, now_ns, &mut suit, &mut ground);
        let tick = Tick { cycle: self.cycle, due_ns: now_ns };
        let before_ns = self.memory.state.suit_sample_time_ns;
        step(
            &self.settings,
            &mut self.memory,
            tick,
            Inputs { suit: &suit, ground: &ground, body: None, command },
        );
        self.record_output(before_ns);
    }

    /// `before_ns`: the previous state's suit sample time.
    fn record_output(&mut self, before_ns: u64) {
        let state = &self.memory.state;
        if state.suit_sample_time_ns != before_ns {
            self.new_ns = self.now_ns;
        }
        if let Some(outputs) = &mut self.outputs {
            // A state's age at a tick is at most a period of the suit and one of the loop.
            let age_max_ns = 1_000_000_000 / u64::from(self.rig.suit_hz) + self.tick_ns;
            outputs.push(Output {
                time_s: simulated_s(self.now_ns),
                validity: state.validity(),
                is_current: self.now_ns - self.new_ns <= age_max_ns,
            });
        }
    }

    /// The state if its suit sample differs from the previous one.
    fn take_new(&mut self) -> Option<Snapshot<'_>> {
        let published_ns = self.memory.state.suit_sample_time_ns;
        if published_ns == self.seen_ns {
            return None;
        }
        self.seen_ns = published_ns;
        let time_of = |stamp_ns: u64| {
            simulated_s(self.fault.1.taken_ns(stamp_ns).saturating_sub(self.rig.suit_late_ns))
        };
        let early = self.memory.early();
        Some(Snapshot {
            state: &self.memory.state,
            worker: &self.worker,
            time_s: time_of(published_ns),
            early,
            early_time_s: time_of(early.sample_time_ns),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use equipoise_core::body::{SEGMENTS, Segment};
    use equipoise_simulator::repertoire::LIFTING;
    use nalgebra::{Vector2, Vector3};

    /// A statue with error-free sensors, moving into a pose.
    fn perfect() -> Session {
        let subject = Subject::random(9);
        let mut session = Session::with(&subject, subject.settings(), Rig::PERFECT, Habits::NONE);
        session.run(1.0, |_| {});
        session.order(|worker, at_s| worker.intend(&LIFTING[3], at_s, 1.6));
        // A real suit never repeats a sample exactly, but a statue does: start once it moves.
        session.run(0.2, |_| {});
        session
    }

    #[test]
    fn a_state_is_compared_with_the_truth_of_its_own_time() {
        let (mut seen, mut sample_later_m) = (0, 0.0_f64);
        perfect().run(1.0, |snapshot| {
            let hand = Segment::LeftHand.index();
            let truth = snapshot.truth();
            for segment in 0..SEGMENTS {
                let published = Vector3::from(snapshot.state.segment_origin_m[segment]);
                assert!(
                    (published - truth.body.origin_m[segment]).norm() < 1e-6,
                    "{segment} at {} s",
                    snapshot.time_s
                );
            }
            let measured = Vector2::from(snapshot.state.cop_measured_m);
            assert!((measured - truth.cop_m).norm() < 2e-4, "{measured} {}", truth.cop_m);
            let later = snapshot.worker.sample(snapshot.time_s + 1.0 / 60.0).origin_m[hand];
            sample_later_m = sample_later_m.max((later - truth.body.origin_m[hand]).norm());
            seen += 1;
        });
        assert_eq!(seen, 60);
        assert!(sample_later_m > 0.01, "a sample later would not be noticed: {sample_later_m} m");
    }

    #[test]
    fn the_same_seed_gives_the_same_bytes_and_another_others() {
        let run = |seed: u64| {
            let subject = Subject::random(seed);
            let mut session = Session::new(&subject, subject.settings());
            session.identify_by_windows(3);
            session
        };
        let (one, same, other) = (run(3), run(3), run(4));
        assert_eq!(bytemuck::bytes_of(one.memory()), bytemuck::bytes_of(same.memory()));
        assert_ne!(bytemuck::bytes_of(one.memory()), bytemuck::bytes_of(other.memory()));
        assert_eq!(one.state().poses_used, 3);
    }

    #[test]
    fn a_leap_is_a_gap_and_then_everything_goes_on() {
        let mut session = perfect();
        session.run(1.0, |_| {});
        let before_s = session.now_s();
        session.order(|worker, at_s| worker.intend(&LIFTING[2], at_s, 5.0));
        session.leap(3.0);
        assert!((session.now_s() - before_s - 3.0).abs() < 1e-9);
        // Samples pending at the leap are published after it.
        let (mut seen, mut last_s) = (0, before_s - 0.1);
        session.run(0.5, |snapshot| {
            assert!(snapshot.time_s > last_s);
            last_s = snapshot.time_s;
            seen += 1;
        });
        assert!(seen >= 25, "{seen}");
    }
}
