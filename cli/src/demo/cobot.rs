//! The handovers of the demonstration: a simulated cobot, commanded by RTDE, presents a part at a fixed place and then
//! where the plan says. The controller uses the published states and the identified body from the daemon's checkpoint.

mod arm;
mod robot_link;
pub(super) mod summary;

use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{anyhow, bail};
use bytemuck::Zeroable;
use equipoise_bus::{Bus, CommandClient, Subscriber, parse_text};
use equipoise_core::body::JOINTS;
use equipoise_core::cycle::{Checkpoint, Settings};
use equipoise_core::handover::{Body, Stance};
use equipoise_core::message::command::CommandKind;
use equipoise_core::message::{Command, State};
use equipoise_simulator::intention::Intention;
use equipoise_simulator::person::Person;
use equipoise_simulator::reach::{HeldPart, ReachHabits};
use equipoise_simulator::simulation::SimulationHandle;
use equipoise_studies::cobot::course::{Course, Purpose};
use equipoise_studies::cobot::held::{Held, HeldSums};
use equipoise_studies::cobot::planner::Planner;
use equipoise_studies::cobot::station::{AFTERWARDS_S, ARRIVED_M, HOLD_S, PATIENCE_S};
use equipoise_studies::handover::{PART_KG, WIDTH_M};
use equipoise_view::page::SimulatedCobot;
use nalgebra::Vector3;

pub(super) use arm::Arm;

/// Duration of standing up before the first handover, s.
const STAND_S: f64 = 1.8;
/// Timeout of the daemon's reply, and interval of requests for its memory.
const REPLY_WITHIN: Duration = Duration::from_secs(2);
const ASK_EVERY: Duration = Duration::from_secs(1);
/// The worker reaches for the part when it has been at its place for this time.
const SETTLED: Duration = Duration::from_millis(300);
/// The arm gives up after this time.
const ARRIVES_WITHIN: Duration = Duration::from_secs(30);

/// What is going on.
#[derive(Debug)]
enum Stage {
    /// The daemon is asked for the identified body, again from this time on.
    Body(Instant),
    /// A thread predicts the overload at all places.
    Plan(JoinHandle<Planner>),
    /// The arm moves the part; it has been at the place since `arrived`.
    Present { begun: Instant, arrived: Option<Instant> },
    /// The worker holds the part with the whole weight within `span_s`; the next handover begins at `end_s`. Simulated time.
    Hold { span_s: Option<[f64; 2]>, end_s: f64, sums: HeldSums },
    /// No handover is left.
    Over,
}

/// One handover that was measured.
#[derive(Debug, Clone, Copy)]
pub(super) struct Handover {
    pub(super) purpose: Purpose,
    /// Station's world, m.
    pub(super) at_m: Vector3<f64>,
    pub(super) held: Held,
}

/// The handovers of one simulated human.
#[derive(Debug)]
pub(super) struct Handovers {
    arm: Arm,
    commands: CommandClient,
    checkpoints: Subscriber<Checkpoint>,
    settings: Settings,
    habits: ReachHabits,
    person: Person,
    course: Option<Course>,
    stage: Stage,
    /// Those measured so far.
    pub(super) done: Vec<Handover>,
}

impl Handovers {
    /// With the bus of the station, the daemon's settings and the seed of the human.
    pub(super) fn new(
        arm: Arm,
        bus: &Bus,
        settings: Settings,
        person: &SimulationHandle,
        seed: u64,
    ) -> anyhow::Result<Handovers> {
        Ok(Handovers {
            arm,
            commands: bus.command_client()?,
            checkpoints: bus.subscriber(1)?,
            settings,
            habits: ReachHabits::of(seed),
            person: person.person(),
            course: None,
            stage: Stage::Body(Instant::now()),
            done: Vec::new(),
        })
    }

    /// The arm, for the next human.
    pub(super) fn into_arm(self) -> Arm {
        self.arm
    }

    /// Begins: the human stands straight.
    pub(super) fn begin(&self, person: &SimulationHandle) {
        person.intend(&Intention::STAND, STAND_S);
    }

    /// Reacts to a state. Returns whether all handovers are over.
    pub(super) fn update(
        &mut self,
        state: &State,
        person: &SimulationHandle,
        fresh: bool,
    ) -> anyhow::Result<bool> {
        let next = self.course.as_ref().and_then(Course::next);
        let target_m = next.map(|(_, at_m)| at_m).filter(|_| matches!(self.stage, Stage::Present { .. }));
        let part_m = self.arm.drive(state, target_m)?;
        self.stage = match std::mem::replace(&mut self.stage, Stage::Over) {
            Stage::Body(due) if Instant::now() < due => Stage::Body(due),
            Stage::Body(_) => self.ask_for_body(state)?,
            Stage::Plan(thread) if !thread.is_finished() => Stage::Plan(thread),
            Stage::Plan(thread) => {
                let planner = thread.join().map_err(|_| anyhow!("the planner of the handovers failed"))?;
                self.course = Some(Course::new(planner));
                Stage::present()
            }
            Stage::Present { begun, arrived } => {
                let Some((_, at_m)) = next else { return Ok(true) };
                let is_there = part_m.is_some_and(|part_m| (part_m - at_m).norm() < ARRIVED_M);
                let arrived = arrived.filter(|_| is_there).or_else(|| is_there.then(Instant::now));
                if arrived.is_some_and(|arrived| arrived.elapsed() >= SETTLED) {
                    self.take(person, part_m.unwrap_or(at_m))
                } else if begun.elapsed() > ARRIVES_WITHIN {
                    self.end(at_m, None)
                } else {
                    Stage::Present { begun, arrived }
                }
            }
            Stage::Hold { span_s, end_s, mut sums } => {
                if fresh {
                    sums.add(state);
                    let time_s = (state.suit_sample_time_ns as f64 - person.start_ns() as f64) * 1e-9;
                    if span_s.is_some_and(|[start_s, end_s]| (start_s..end_s).contains(&time_s)) {
                        sums.add_truth(&self.settings.limits, &self.person, &person.truth_at(time_s).body);
                    }
                }
                match next {
                    Some((purpose, at_m)) if person.now_s() > end_s => {
                        let held = sums.mean();
                        self.done.extend(held.map(|held| Handover { purpose, at_m, held }));
                        self.end(at_m, held)
                    }
                    _ => Stage::Hold { span_s, end_s, sums },
                }
            }
            Stage::Over => Stage::Over,
        };
        Ok(matches!(self.stage, Stage::Over))
    }

    /// The arm and the results so far as the page draws them; `None` before the first data of the arm.
    pub(super) fn drawn(&self) -> Option<SimulatedCobot> {
        let of = |purpose: Purpose| {
            let handover = self.done.iter().find(|handover| handover.purpose == purpose)?;
            Some([handover.held.measured, handover.held.sigma])
        };
        Some(SimulatedCobot {
            arm_m: self.arm.chain_m()?,
            part_kg: PART_KG,
            part_width_m: WIDTH_M,
            before: of(Purpose::Baseline),
            after: of(Purpose::Assisted),
        })
    }

    /// Asks the daemon for its memory, and starts to plan with the body in it.
    fn ask_for_body(&mut self, state: &State) -> anyhow::Result<Stage> {
        let body = self.checkpoints.receive_with(|checkpoint| body_of(checkpoint, &self.settings))?;
        if let Some(body) = body.flatten() {
            let (stance, cobot) = (Stance::of_segments(&state.segment_origin_m), *self.arm.settings());
            let plan = move || Planner::new(body, stance, |at_m| cobot.permits(at_m));
            return Ok(Stage::Plan(std::thread::Builder::new().name("handover-plan".into()).spawn(plan)?));
        }
        let command = Command { kind: CommandKind::Checkpoint as u32, ..Command::zeroed() };
        let reply = self.commands.ask(&command, REPLY_WITHIN)?;
        if reply.refused != 0 {
            bail!("the daemon gives no identified body: {}", parse_text(&reply.text));
        }
        Ok(Stage::Body(Instant::now() + ASK_EVERY))
    }

    /// The human takes the part where the arm holds it.
    fn take(&self, person: &SimulationHandle, part_m: Vector3<f64>) -> Stage {
        let part = HeldPart { middle_m: part_m, width_m: WIDTH_M, aside: Vector3::y() };
        let span_s = person.hold_part(&self.habits, &part, PART_KG, HOLD_S);
        let end_s = span_s.map_or(person.now_s() + PATIENCE_S, |[_, end_s]| end_s + AFTERWARDS_S);
        Stage::Hold { span_s, end_s, sums: HeldSums::default() }
    }

    /// Ends a handover; the next one follows.
    fn end(&mut self, at_m: Vector3<f64>, held: Option<Held>) -> Stage {
        let Some(course) = &mut self.course else { return Stage::Over };
        course.end(at_m, held.map(|held| held.measured));
        if course.next().is_some() { Stage::present() } else { Stage::Over }
    }
}

impl Stage {
    fn present() -> Stage {
        Stage::Present { begun: Instant::now(), arrived: None }
    }
}

/// The identified body in a copy of the daemon's memory, without fatigue.
fn body_of(checkpoint: &Checkpoint, settings: &Settings) -> Option<Body> {
    Some(checkpoint.memory()?.identification.handover_body(settings, [0.0; JOINTS]))
}
