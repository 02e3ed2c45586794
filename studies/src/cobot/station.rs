//! A worker, the estimator, and a cobot that hands a part over, in one simulated time.
//!
//! The cobot's controller decides by published states alone. The worker waits until the arm is at rest.

use equipoise_core::handover;
use equipoise_core::message::Validity;
use equipoise_simulator::cobot::controller::{Controller, Target};
use equipoise_simulator::cobot::monitor::LimitMonitor;
use equipoise_simulator::cobot::motion::OutsideWorkspace;
use equipoise_simulator::cobot::program::{CobotSettings, Program};
use equipoise_simulator::cobot::trial::{
    AFTERWARDS_S, ARRIVED_M, ARRIVES_WITHIN_S, HOLD_S, PART_KG, TURNED_RAD, WIDTH_M,
};
use equipoise_simulator::reach::{HeldPart, ReachHabits};
use nalgebra::Vector3;

use super::held::{HoldResult, HoldSums};
use super::planner::{Planner, Presentation};
use crate::session::{Session, Snapshot};
use crate::subject::Subject;

/// Maximum number of poses of the identification.
const POSES_MAX: u32 = 20;
/// Interval between decisions of the controller, s, and the arm's control periods in it.
const DECISION_S: f64 = 0.02;
const STEPS: u32 = 10;
/// Flags that stop the arm: a worker without a load is a valid state.
pub const STOPS: Validity = Validity(Validity::INVALIDATES_TORQUES.0 & !Validity::BELOW_LOAD_THRESHOLD.0);
/// The arm is at rest below this speed.
const AT_REST_RAD_PER_S: f64 = 0.01;
/// Without a load in the hands for this time the controller regards the place as not reached, s.
pub const PATIENCE_S: f64 = 3.0;

/// The closed loop.
#[derive(Debug)]
pub struct Station {
    session: Session,
    habits: ReachHabits,
    cobot: CobotSettings,
    program: Program,
    monitor: LimitMonitor,
    controller: Controller,
}

impl Station {
    /// An identified worker in front of the default cobot.
    pub fn new(subject: &Subject) -> Result<Station, OutsideWorkspace> {
        let mut session = Session::new(subject, subject.settings());
        session.identify(POSES_MAX);
        session.stand(2.0);
        let cobot = CobotSettings::default();
        let program = Program::new(cobot)?;
        Ok(Station {
            session,
            habits: ReachHabits::of(subject.seed),
            cobot,
            monitor: LimitMonitor::new(program.motion(), cobot.limits),
            program,
            controller: Controller::default(),
        })
    }

    /// A planner for this worker, from the identified body and the published position of the feet. Fatigue is left out
    /// everywhere in this study.
    pub fn planner(&self) -> Planner {
        let session = &self.session;
        let body = session.memory().identification.handover_body(session.settings(), Default::default());
        let feet = handover::FootPlacement::of_segments(&session.state().segment_origin_m);
        Planner::new(body, feet, |at_m| self.cobot.permits(at_m))
    }

    /// Steps of the arm outside its limits.
    pub fn exceeded(&self) -> u64 {
        self.monitor.exceeded()
    }

    /// Position of the part: the arm's tool centre point, station's world, m.
    fn part_m(&self) -> Vector3<f64> {
        self.program.tcp_in_world_m()
    }

    /// Advances worker and estimator by the interval between two decisions, and then the arm, toward a target or at
    /// rest.
    fn advance(&mut self, target: Option<Target>, see: impl FnMut(&Snapshot)) {
        self.session.run(DECISION_S, see);
        let is_valid = !self.session.state().validity().any_of(STOPS);
        let inputs = self.controller.decide(is_valid, target, self.part_m(), DECISION_S);
        for _ in 0..STEPS {
            self.program.step(&inputs);
            self.monitor.observe(self.program.motion());
        }
    }

    /// Moves the part to a place; the arm holds while the published state is invalid. Returns whether it arrived.
    pub fn present(&mut self, part: Presentation) -> bool {
        // The worker faces X.
        let slope_rad = part.slope_rad.unwrap_or_default();
        let target = Target { at_m: part.at_m, slope_rad, heading_rad: 0.0 };
        for _ in 0..(ARRIVES_WITHIN_S / DECISION_S) as u32 {
            self.advance(Some(target), |_| {});
            let is_at_rest = self.program.motion().qd_rad_per_s().amax() < AT_REST_RAD_PER_S;
            let is_turned = (self.program.slope_rad() - target.slope_rad).abs() < TURNED_RAD;
            if (self.part_m() - target.at_m).norm() < ARRIVED_M && is_turned && is_at_rest {
                return true;
            }
        }
        false
    }

    /// The worker takes the presented part, with fixed or turning handles, holds it and gives it
    /// back. `None` if no valid torque was published
    /// meanwhile, as when the worker does not reach it.
    pub fn hold(&mut self, turns_with_hands: bool) -> Option<HoldResult> {
        let slope_rad = (!turns_with_hands).then(|| self.program.slope_rad());
        let part = HeldPart { middle_m: self.part_m(), width_m: WIDTH_M, aside: Vector3::y(), slope_rad };
        let (habits, limits) = (self.habits, self.session.settings().limits);
        let mut span_s = None;
        self.session.order(|worker, at_s| span_s = worker.hold_part(&habits, &part, PART_KG, at_s, HOLD_S));
        let seconds = span_s.map_or(PATIENCE_S, |[_, end_s]| end_s + AFTERWARDS_S - self.session.now_s());
        let mut sums = HoldSums::default();
        for _ in 0..(seconds / DECISION_S) as u32 {
            self.advance(None, |snapshot| {
                if span_s.is_some_and(|[start_s, end_s]| (start_s..end_s).contains(&snapshot.time_s)) {
                    let body = snapshot.worker.sample(snapshot.time_s);
                    sums.add(snapshot.state, &limits, snapshot.worker.person(), &body);
                }
            });
        }
        sums.mean()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACE: Presentation = Presentation { at_m: Vector3::new(0.45, 0.0, 1.05), slope_rad: Some(0.5) };

    #[test]
    fn the_arm_moves_only_while_the_published_state_is_valid() {
        let mut station = Station::new(&Subject::random(5)).unwrap();
        let begun_m = station.part_m();
        for _ in 0..(1.5 / DECISION_S) as u32 {
            station.advance(None, |_| {});
        }
        station.session.restart_ground(ARRIVES_WITHIN_S + 1.0);
        assert!(!station.present(PLACE));
        // The state is valid until the silence is noticed.
        assert!((station.part_m() - begun_m).norm() < 0.02, "{}", station.part_m());
        assert!(station.present(PLACE));
        assert_eq!(station.exceeded(), 0);
    }
}
