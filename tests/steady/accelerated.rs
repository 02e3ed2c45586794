//! The loop on a clock that runs faster than real time: the same cycles, rings, samples and commands, without waiting.

use std::sync::Arc;

use equipoise_core::cycle::{Memory, Settings, StopRule};
use equipoise_core::message::state::Phase;
use equipoise_core::message::{CommandKind, GroundSample, SuitSample, Validity};
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_daemon::rings::{
    CommandEnds, EgressEnds, IngressEnds, LoopControl, Rings, SavingEnds, SettingsSender,
};
use equipoise_daemon::tick::{Clock, Loop, Observer};
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::noise::Suit;
use equipoise_simulator::person::Person;
use equipoise_studies::sensors::{EPOCH_NS, Rig, ground_sample, suit_sample};
use nix::sys::resource::{UsageWho, getrusage};

use crate::{Watch, number};

const PERIOD_NS: u64 = 1_000_000;
/// All of the loop's work occurs within these seconds: identification, a lift, further work.
const SESSION_S: u32 = 40;
const SEED: u64 = 7;

/// Samples of one session, replayed repeatedly with later stamps.
struct Session {
    suit: Vec<SuitSample>,
    ground: Vec<GroundSample>,
}

impl Session {
    fn make() -> Session {
        let mut worker = Worker::with_habits(Person::new(SEED, 1.77, 72.0), SEED, Habits::ORDINARY);
        // Six poses, then a box is lifted, moved and put down.
        for pose in 0..6_u32 {
            worker.take_pose(&LIBRARY[pose as usize * 7], f64::from(pose) * 3.5, 1.8);
        }
        worker.lift_and_show(8.0, 22.0);
        let (rig, suit) = (Rig::ORDINARY, Suit::new(Rig::ORDINARY.suit_noise, SEED));
        Session {
            suit: (0..SESSION_S * rig.suit_hz).map(|n| suit_sample(&worker, &suit, &rig, SEED, n)).collect(),
            ground: (0..SESSION_S * rig.plate_hz).map(|n| ground_sample(&worker, &rig, SEED, n)).collect(),
        }
    }
}

/// Observed activity of the loop: an idle loop would pass the test trivially.
#[derive(Debug, Default, Clone, Copy)]
struct Activity {
    outcomes: u64,
    poses: u64,
    torques: u64,
    monitoring: u64,
    checkpoints: u64,
    workers: u64,
    copies: u64,
    reloads: u64,
}

/// Clock and neighbours of the loop: ingress, egress and commands, between two cycles.
struct Accelerated<'a> {
    now_ns: u64,
    ingress: IngressEnds,
    egress: EgressEnds,
    saving: SavingEnds,
    commands: CommandEnds,
    settings_sender: SettingsSender,
    session: &'a Session,
    /// Stamp of the session's first sample in this round, and number of its samples sent.
    round_ns: u64,
    sent: [usize; 2],
    rounds: u64,
    sleeps: u64,
    worker: Option<Box<equipoise_core::cycle::SubjectState>>,
    settings: Option<Box<Settings>>,
    activity: Activity,
    random_state: u64,
}

impl Accelerated<'_> {
    fn random_below(&mut self, below: u64) -> u64 {
        self.random_state =
            self.random_state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.random_state >> 33) % below
    }

    fn send_samples(&mut self) {
        let later_ns = self.round_ns - EPOCH_NS;
        while let Some(sample) = self.session.ground.get(self.sent[1])
            && sample.sample_time_ns + later_ns <= self.now_ns
        {
            let time_ns = sample.sample_time_ns + later_ns;
            let dated = GroundSample { sample_time_ns: time_ns, arrival_ns: time_ns, ..*sample };
            self.ingress.push_ground(dated, self.now_ns);
            self.sent[1] += 1;
        }
        while let Some(sample) = self.session.suit.get(self.sent[0])
            && sample.sample_time_ns + later_ns <= self.now_ns
        {
            let time_ns = sample.sample_time_ns + later_ns;
            let dated = SuitSample { sample_time_ns: time_ns, arrival_ns: time_ns, ..*sample };
            self.ingress.push_suit(dated, self.now_ns);
            self.sent[0] += 1;
        }
        if self.sent == [self.session.suit.len(), self.session.ground.len()] {
            (self.sent, self.round_ns) = ([0; 2], self.now_ns + PERIOD_NS);
            self.rounds += 1;
            let _ = self.commands.command.push(CommandKind::IdentifyReset);
        }
    }

    fn take_outcomes(&mut self) {
        while let Ok(outcome) = self.egress.outcome.pop() {
            let state = &outcome.state;
            self.activity.outcomes += 1;
            self.activity.poses = self.activity.poses.max(u64::from(state.poses_used));
            self.activity.torques += u64::from(!state.validity().any_of(Validity::INVALIDATES_TORQUES));
            self.activity.monitoring += u64::from(state.phase == Phase::Monitoring as u32);
        }
        while let Ok(checkpoint) = self.egress.checkpoints.pop() {
            self.activity.checkpoints += 1;
            let _ = self.egress.free_checkpoints.push(checkpoint);
        }
        while let Ok((_, copy)) = self.saving.copies.pop() {
            self.activity.copies += 1;
            let _ = self.saving.free_copies.push(copy);
        }
    }

    fn send_commands(&mut self) {
        if self.sleeps.is_multiple_of(3001) {
            let _ = self.commands.command.push(CommandKind::Checkpoint);
        }
        // Change the subject, in the middle of a lift of every other round.
        if self.sleeps.is_multiple_of(74_003)
            && let Some(worker) = self.worker.take()
        {
            let _ = self.commands.worker.push((1, worker));
            let _ = self.commands.command.push(CommandKind::SubjectLoad);
        }
        if let Ok(back) = self.commands.returned_workers.pop() {
            self.worker = Some(back);
            self.activity.workers += 1;
        }
        // Apply the same settings again, as after a reload.
        if self.sleeps.is_multiple_of(50_021)
            && let Some(settings) = self.settings.take()
        {
            let _ = self.settings_sender.settings.push((1, settings));
        }
        if let Ok(back) = self.settings_sender.returned.pop() {
            self.settings = Some(back);
            self.activity.reloads += 1;
        }
    }
}

impl Clock for Accelerated<'_> {
    fn now_ns(&mut self) -> u64 {
        self.now_ns += 250;
        self.now_ns
    }

    fn sleep_until(&mut self, due_ns: u64) {
        self.sleeps += 1;
        // Wake-up slightly late, and occasionally so late that slots are skipped.
        let late_ns = if self.random_below(5000) == 0 {
            self.random_below(4_000_000)
        } else {
            self.random_below(60_000)
        };
        self.now_ns = self.now_ns.max(due_ns) + late_ns;
        self.send_samples();
        self.take_outcomes();
        self.send_commands();
    }
}

/// Ends the loop after this number of cycles; reads the page faults at the first armed cycle and at the last.
struct Until {
    watch: Watch,
    cycles: u64,
    control: Arc<LoopControl>,
    faults: [[i64; 2]; 2],
}

/// Reads the counters without touching memory that would then count.
fn own_faults() -> [i64; 2] {
    let usage = getrusage(UsageWho::RUSAGE_THREAD).expect("what this thread used");
    [usage.minor_page_faults(), usage.major_page_faults()]
}

impl Observer for Until {
    fn cycle_begins(&mut self, cycle: u64) {
        self.watch.cycle_begins(cycle);
        // After the first armed cycle: the counters' own first use maps a page.
        if cycle == self.watch.warm_cycles + 1 {
            self.faults[0] = own_faults();
        }
        if cycle == self.cycles {
            self.faults[1] = own_faults();
            self.control.stop();
        }
    }
}

#[test]
fn millions_of_cycles_touch_neither_the_heap_nor_a_new_page() {
    // Two rounds of the session: every path was taken, every page is present.
    let warm_cycles = 2000 * u64::from(SESSION_S);
    let cycles = warm_cycles + number("STEADY_CYCLES", 400_000);
    let settings = Settings {
        library: LIBRARY,
        stop: StopRule::PredictedCop { sigma_m: 0.02 },
        poses_min: 2,
        ..Settings::for_height(1.77)
    };
    let mut memory = bytemuck::zeroed_box::<Memory>();
    memory.start(&settings);
    let worker = Some(Box::new(equipoise_core::cycle::SubjectState {
        identification: memory.identification,
        exposure: memory.exposure,
    }));
    let Rings { control, loop_ends, ingress, egress, saving, commands, settings: settings_sender } =
        Rings::new().expect("an event file descriptor");
    let session = Session::make();
    let mut clock = Accelerated {
        now_ns: EPOCH_NS,
        ingress,
        egress,
        saving,
        commands,
        settings_sender,
        session: &session,
        round_ns: EPOCH_NS,
        sent: [0; 2],
        rounds: 0,
        sleeps: 0,
        worker,
        settings: Some(Box::new(settings)),
        activity: Activity::default(),
        random_state: SEED,
    };
    let mut until = Until { watch: Watch::after(warm_cycles), cycles, control, faults: [[0; 2]; 2] };
    let summary = Loop::new(settings, memory, 0, loop_ends, PERIOD_NS).run(&mut clock, &mut until);
    crate::counting_alloc::arm(false);

    let faults = [0, 1].map(|kind| until.faults[1][kind] - until.faults[0][kind]);
    let (allocations, frees) = until.watch.touched();
    println!(
        "{} armed cycles, {} rounds: {allocations} allocations, {frees} frees, {faults:?} minor and major faults; {:?}; \
         {summary:?}",
        until.watch.armed_cycles(),
        clock.rounds,
        clock.activity,
    );
    let Activity { outcomes, poses, torques, monitoring, checkpoints, workers, copies, reloads } =
        clock.activity;
    assert!(poses >= 2 && torques > 100 && monitoring > 1000 && checkpoints > 10, "{:?}", clock.activity);
    assert!(workers > 0 && copies > 100 && reloads > 0, "{:?}", clock.activity);
    assert_eq!(until.watch.armed_cycles(), cycles - warm_cycles);
    assert_eq!((allocations, frees), (0, 0), "the loop touched the heap");
    assert_eq!(faults, [0, 0], "minor and major page faults after the warm-up");
    assert!(summary.adds_up && summary.slots_skipped > 0, "{summary:?}");
    assert_eq!(outcomes + 1, summary.cycles, "one is still in the ring");
}
