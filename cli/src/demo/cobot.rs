//! The handovers of the demonstration: a simulated cobot, commanded by RTDE, presents a part at a fixed place and then at
//! the place that the daemon plans. Controller and plan use published states only.

mod arm;
mod held;
mod robot_link;
pub(super) mod summary;

use std::time::{Duration, Instant};

use anyhow::Context;
use bytemuck::Zeroable;
use equipoise_bus::{Bus, BusError, HandoverClient};
use equipoise_core::message::handover::{CurrentFrame, HandoverRefusal};
use equipoise_core::message::{HandoverPlan, HandoverRequest, State};
use equipoise_core::overload::TorqueLimits;
use equipoise_simulator::cobot::controller::Target;
use equipoise_simulator::cobot::trial::{
    AFTERWARDS_S, ARRIVED_M, ARRIVES_WITHIN_S, FIXED_M, HOLD_S, PART_KG, TURNED_RAD, WIDTH_M,
};
use equipoise_simulator::intention::Intention;
use equipoise_simulator::reach::{HeldPart, ReachHabits};
use equipoise_simulator::simulation::SimulationHandle;
use equipoise_view::page::SimulatedCobot;
use nalgebra::Vector3;

pub(super) use arm::Arm;
use arm::Goal;
use held::{HoldResult, HoldSums};

/// Attempts at each handover. The first may fail on a busy machine, or because the worker does not reach the place: the
/// next assisted one is nearer to the fixed place by this fraction of the distance.
const ATTEMPTS: u32 = 3;
const NEARER: f64 = 0.25;
/// Duration of standing up before the first handover, s.
const STAND_S: f64 = 1.8;
/// The worker reaches for the part when it has been at its place for this time.
const SETTLED: Duration = Duration::from_millis(300);
/// Until the next attempt after one out of reach, s.
const OUT_OF_REACH_S: f64 = 1.0;
/// Timeout of the daemon's answer, interval of requests while it has no plan, and the longest time without one.
const ANSWER_WITHIN: Duration = Duration::from_secs(2);
const ASK_EVERY: Duration = Duration::from_millis(500);
const PLAN_WITHIN: Duration = Duration::from_secs(10);

/// Stage of a handover.
#[derive(Debug)]
enum Stage {
    /// The daemon has been asked for a plan since the first instant; the next request is due at the second.
    Plan(Instant, Instant),
    /// The arm moves the part to the place since the first instant; it has been there since the second.
    Present(Instant, Option<Instant>),
    /// The worker holds the part with the whole weight within `span_s`, and stands straight at `end_s`, simulated time;
    /// no span if the place is out of reach.
    Hold { span_s: Option<[f64; 2]>, end_s: f64, sums: Box<HoldSums> },
    /// No handover is left.
    Over,
}

/// A handover that was measured.
#[derive(Debug, Clone, Copy)]
struct Handover {
    /// Station's world, m.
    place_m: Vector3<f64>,
    /// Slope of the handles, rad; `None`: the worker turns them.
    slope_rad: Option<f64>,
    held: HoldResult,
}

/// The handovers to one simulated human.
#[derive(Debug)]
pub(super) struct Handovers {
    arm: Arm,
    plans: HandoverClient,
    habits: ReachHabits,
    /// τ_max in the configuration of the daemon.
    limits: TorqueLimits,
    stage: Stage,
    /// Place of the part in the present handover, station's world, m.
    place_m: Vector3<f64>,
    /// Slope of its handles, rad; `None`: the worker turns them.
    slope_rad: Option<f64>,
    /// Heading of its handles, rad.
    heading_rad: f64,
    failed: u32,
    fixed: Option<Handover>,
    plan: Option<HandoverPlan>,
    assisted: Option<Handover>,
}

impl Handovers {
    /// With the bus of the station, and the seed and the torque limits of the human.
    pub(super) fn new(arm: Arm, bus: &Bus, seed: u64, limits: TorqueLimits) -> anyhow::Result<Handovers> {
        Ok(Handovers {
            arm,
            plans: bus.handover_client()?,
            habits: ReachHabits::of(seed),
            limits,
            stage: Stage::Over,
            place_m: FIXED_M,
            slope_rad: None,
            heading_rad: 0.0,
            failed: 0,
            fixed: None,
            plan: None,
            assisted: None,
        })
    }

    /// The arm, for the next human.
    pub(super) fn into_arm(self) -> Arm {
        self.arm
    }

    /// Begins: the human stands straight while the arm moves to the fixed place.
    pub(super) fn begin(&mut self, person: &SimulationHandle) {
        person.intend(&Intention::STAND, STAND_S);
        self.stage = Stage::present();
    }

    /// Moves the arm away from the worker. Returns whether it is at its retreat position.
    pub(super) fn retreat(&mut self, state: &State) -> anyhow::Result<bool> {
        let part_m = self.arm.drive(state, Goal::Retreat)?;
        Ok(part_m.is_some_and(|part_m| is_at(part_m, self.arm.settings().retreat_m)))
    }

    /// Reacts to a state. Returns whether all handovers are over.
    pub(super) fn update(
        &mut self,
        state: &State,
        person: &SimulationHandle,
        fresh: bool,
    ) -> anyhow::Result<bool> {
        let goal = match self.stage {
            Stage::Present(..) => Goal::Present(self.target()),
            _ => Goal::Hold,
        };
        let part_m = self.arm.drive(state, goal)?;
        self.stage = match std::mem::replace(&mut self.stage, Stage::Over) {
            Stage::Plan(since, due) if Instant::now() >= due => self.request_plan(since)?,
            Stage::Present(since, arrived) => {
                let there_m = part_m.filter(|part_m| is_at(*part_m, self.place_m) && self.is_turned());
                let arrived = there_m.map(|_| arrived.unwrap_or_else(Instant::now));
                match there_m {
                    Some(part_m) if arrived.is_some_and(|arrived| arrived.elapsed() >= SETTLED) => {
                        self.take(person, part_m)
                    }
                    None if since.elapsed().as_secs_f64() > ARRIVES_WITHIN_S => self.end(None),
                    _ => Stage::Present(since, arrived),
                }
            }
            Stage::Hold { span_s, end_s, mut sums } => {
                let time_s = (state.suit_sample_time_ns as f64 - person.start_ns() as f64) * 1e-9;
                if fresh && span_s.is_some_and(|[start_s, end_s]| (start_s..end_s).contains(&time_s)) {
                    sums.add(state, &self.limits, || person.truth_at(time_s));
                }
                if person.now_s() > end_s {
                    self.end(sums.mean())
                } else {
                    Stage::Hold { span_s, end_s, sums }
                }
            }
            waiting => waiting,
        };
        Ok(matches!(self.stage, Stage::Over))
    }

    /// The arm and the results so far as the page draws them; `None` before the first data of the arm.
    pub(super) fn drawn(&self) -> Option<SimulatedCobot> {
        let ratio =
            |handover: Option<Handover>| handover.map(|it| [it.held.ratio.value, it.held.ratio.sigma]);
        Some(SimulatedCobot {
            arm_m: self.arm.chain_m()?,
            part_kg: PART_KG,
            part_width_m: WIDTH_M,
            before: ratio(self.fixed),
            after: ratio(self.assisted),
        })
    }

    /// Where the part is to be.
    fn target(&self) -> Target {
        let slope_rad = self.slope_rad.unwrap_or_default();
        Target { at_m: self.place_m, slope_rad, heading_rad: self.heading_rad }
    }

    /// Whether the handles have their slope and heading.
    fn is_turned(&self) -> bool {
        let Target { slope_rad, heading_rad, .. } = self.target();
        let turned = self.arm.slope_rad().zip(self.arm.heading_rad());
        turned.is_some_and(|(slope, heading)| {
            (slope - slope_rad).abs() < TURNED_RAD && (heading - heading_rad).abs() < TURNED_RAD
        })
    }

    /// Asks the daemon for a plan, as `equipoise plan handover --live` does.
    fn request_plan(&mut self, since: Instant) -> anyhow::Result<Stage> {
        let request = HandoverRequest {
            mass_kg: PART_KG,
            width_m: WIDTH_M,
            current_m: FIXED_M.into(),
            current_frame: CurrentFrame::Station as u32,
            ..HandoverRequest::zeroed()
        };
        match self.plans.ask(&request, ANSWER_WITHIN) {
            Ok(plan) if plan.refused == HandoverRefusal::None as u32 => {
                self.place_m = self.permitted_m(plan.position_m.into());
                (self.slope_rad, self.heading_rad) = (Some(plan.slope_rad), plan.feet_heading_rad);
                self.plan = Some(plan);
                return Ok(Stage::present());
            }
            Ok(_) | Err(BusError::NoAnswer { .. }) => {}
            Err(error) => return Err(error).context("the plan of the handover"),
        }
        let is_late = since.elapsed() > PLAN_WITHIN;
        Ok(if is_late { self.end(None) } else { Stage::Plan(since, Instant::now() + ASK_EVERY) })
    }

    /// The first place that the arm may take on the line from the planned place to the fixed one, after failed attempts
    /// nearer to the latter.
    fn permitted_m(&self, planned_m: Vector3<f64>) -> Vector3<f64> {
        let line = (0..100).map(|step| f64::from(step) / 100.0 + NEARER * f64::from(self.failed));
        let mut places = line.map(|part| planned_m.lerp(&FIXED_M, part.min(1.0)));
        places.find(|at_m| self.arm.settings().permits(at_m)).unwrap_or(FIXED_M)
    }

    /// The human takes the part where the arm holds it.
    fn take(&self, person: &SimulationHandle, part_m: Vector3<f64>) -> Stage {
        let slope_rad = self.slope_rad.and_then(|_| self.arm.slope_rad());
        let (sin, cos) = self.arm.heading_rad().unwrap_or_default().sin_cos();
        let aside = Vector3::new(-sin, cos, 0.0);
        let part = HeldPart { middle_m: part_m, width_m: WIDTH_M, aside, slope_rad };
        let span_s = person.hold_part(&self.habits, &part, PART_KG, HOLD_S);
        let end_s = span_s.map_or(person.now_s() + OUT_OF_REACH_S, |[_, end_s]| end_s + AFTERWARDS_S);
        Stage::Hold { span_s, end_s, sums: Box::default() }
    }

    /// Ends a handover: the next one, or the next attempt at the same.
    fn end(&mut self, held: Option<HoldResult>) -> Stage {
        let handover = held.map(|held| Handover { place_m: self.place_m, slope_rad: self.slope_rad, held });
        let is_fixed = self.fixed.is_none();
        *(if is_fixed { &mut self.fixed } else { &mut self.assisted }) = handover;
        self.failed = if handover.is_some() { 0 } else { self.failed + 1 };
        match (is_fixed, handover) {
            (_, None) if self.failed == ATTEMPTS => Stage::Over,
            (true, None) => Stage::present(),
            (false, Some(_)) => Stage::Over,
            _ => Stage::Plan(Instant::now(), Instant::now()),
        }
    }
}

impl Stage {
    fn present() -> Stage {
        Stage::Present(Instant::now(), None)
    }
}

fn is_at(part_m: Vector3<f64>, place_m: Vector3<f64>) -> bool {
    (part_m - place_m).norm() < ARRIVED_M
}
