//! The scenes of the demonstration, and the measurements taken in each.

use equipoise_core::message::state::Phase;
use equipoise_core::message::{State, Validity};
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_simulator::intention::Intention;
use equipoise_simulator::simulation::SimulationHandle;
use equipoise_view::page::SimulatedCobot;

use super::cobot::Handovers;
use super::lift::{self, BOXES_KG, LIFT_S, LiftSums};

/// After this long without the pose being used, the person tries another one, s.
const TIMEOUT_S: f64 = 6.0;
/// Duration of each check pose, s; reaching it takes 1.8 s.
const CHECK_POSE_S: f64 = 3.2;
/// Number of check poses.
const CHECK_POSES: usize = 4;
/// With empty hands after the last lift, in which it is counted and displayed, s.
const AFTER_LIFTS_S: f64 = 3.5;
/// Duration of standing up after them, s.
const STAND_S: f64 = 1.8;

/// How fast the person acts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace {
    /// From a suggestion to the motion, s.
    pub(super) reaction_s: f64,
    /// Duration of lifts over the shortest.
    pub(super) lifts: f64,
}

impl Pace {
    /// For programs: as fast as the results permit.
    pub(super) const FAST: Pace = Pace { reaction_s: 0.0, lifts: 1.0 };
    /// For viewers, who read the page.
    pub(super) const READABLE: Pace = Pace { reaction_s: 1.5, lifts: 1.6 };
}

/// Stage of the demonstration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scene {
    /// The sensors start.
    Begin,
    /// The person takes suggested poses.
    Identify,
    /// The person stands in poses that were not used for identification.
    Check,
    /// The person lifts the box with this index.
    Lift(usize),
    /// A cobot hands a part over.
    Handover,
    /// The person stands with empty hands.
    End,
    /// Done.
    Over,
}

impl Scene {
    pub(super) fn name(self) -> String {
        match self {
            Scene::Begin => "waiting for the sensors".to_owned(),
            Scene::Identify => "identifying".to_owned(),
            Scene::Check => "checking the model".to_owned(),
            Scene::Lift(index) => format!("lifting {} kg", BOXES_KG[index]),
            Scene::Handover => "handovers by the cobot".to_owned(),
            Scene::End => "empty hands".to_owned(),
            Scene::Over => "done".to_owned(),
        }
    }
}

/// Sums of a pair of centres of pressure, m.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CopSums {
    pub(super) samples: f64,
    pub(super) error_m2: [f64; 2],
}

impl CopSums {
    fn add(&mut self, state: &State) {
        self.samples += 1.0;
        for axis in 0..2 {
            self.error_m2[axis] += (state.cop_measured_m[axis] - state.cop_estimated_m[axis]).powi(2);
        }
    }
}

/// Smallest and largest measured centre of pressure per axis, m; `None` before the first.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CopRange(Option<[[f64; 2]; 2]>);

impl CopRange {
    fn add(&mut self, cop_m: [f64; 2]) {
        let [low, high] = self.0.unwrap_or([cop_m; 2]);
        self.0 = Some([
            [0, 1].map(|axis: usize| low[axis].min(cop_m[axis])),
            [0, 1].map(|axis: usize| high[axis].max(cop_m[axis])),
        ]);
    }

    /// From the smallest to the largest value, forward and sideways, m.
    pub(super) fn extent_m(&self) -> [f64; 2] {
        self.0.map_or([0.0; 2], |[low, high]| [0, 1].map(|axis: usize| high[axis] - low[axis]))
    }
}

/// The script with its progress and measurements.
#[derive(Debug)]
pub(super) struct Script {
    pace: Pace,
    scene: Scene,
    scene_since_s: f64,
    suggested: u32,
    suggested_since_s: f64,
    has_reacted: bool,
    check_pose: usize,
    lift_acts: usize,
    /// Whether the present lift is done without its box.
    is_empty_handed: bool,
    last_sample_ns: u64,
    /// Of the newest state.
    validity: Validity,
    requested: u64,
    pub(super) poses_used: u32,
    pub(super) identified_after_s: f64,
    pub(super) predicted_sigma_m: f64,
    pub(super) unloaded: CopSums,
    /// Range over the whole session.
    pub(super) cop_range: CopRange,
    /// Of each box that was lifted or is being lifted.
    pub(super) lifts: Vec<LiftSums>,
    /// Handovers by a cobot instead of the boxes.
    pub(super) handovers: Option<Handovers>,
}

impl Script {
    pub(super) fn new(pace: Pace, handovers: Option<Handovers>) -> Script {
        Script {
            pace,
            scene: Scene::Begin,
            scene_since_s: 0.0,
            suggested: u32::MAX,
            suggested_since_s: 0.0,
            has_reacted: false,
            check_pose: 0,
            lift_acts: 0,
            is_empty_handed: false,
            last_sample_ns: 0,
            validity: Validity::default(),
            requested: 0,
            poses_used: 0,
            identified_after_s: 0.0,
            predicted_sigma_m: 0.0,
            unloaded: CopSums::default(),
            cop_range: CopRange::default(),
            lifts: Vec::new(),
            handovers,
        }
    }

    pub(super) fn scene(&self) -> Scene {
        self.scene
    }

    pub(super) fn poses_used(&self) -> u32 {
        self.poses_used
    }

    /// Why the newest state's torques are masked, as the end of a sentence; empty if they are not.
    pub(super) fn masked_by(&self) -> String {
        let names: Vec<&str> = self.validity.names().collect();
        if names.is_empty() { String::new() } else { format!(", masked by {}", names.join(", ")) }
    }

    /// The true mass of the box that is lifted now, kg.
    pub(super) fn box_kg(&self) -> Option<f64> {
        match self.scene {
            Scene::Lift(index) if !self.is_empty_handed => Some(BOXES_KG[index]),
            _ => None,
        }
    }

    /// The cobot as the page draws it; not while it would cover the worker's poses.
    pub(super) fn cobot(&self) -> Option<SimulatedCobot> {
        let covers = matches!(self.scene, Scene::Begin | Scene::Identify | Scene::Check);
        self.handovers.as_ref().filter(|_| !covers)?.drawn()
    }

    /// Reacts to one state at `now_s`; the first pose is taken once `started`.
    pub(super) fn update(
        &mut self,
        state: &State,
        person: &SimulationHandle,
        now_s: f64,
        started: bool,
    ) -> anyhow::Result<()> {
        let fresh = state.suit_sample_time_ns != self.last_sample_ns;
        self.last_sample_ns = state.suit_sample_time_ns;
        self.poses_used = state.poses_used;
        self.validity = state.validity();
        if fresh && !state.validity().any_of(Validity::INVALIDATES_COP_MEASURED) {
            self.cop_range.add(state.cop_measured_m);
        }
        let is_clear = match &mut self.handovers {
            Some(handovers) if self.scene != Scene::Handover => handovers.retreat(state)?,
            _ => true,
        };
        match self.scene {
            Scene::Begin => {
                if started && state.phase == Phase::Identifying as u32 {
                    self.enter(Scene::Identify, now_s);
                }
            }
            Scene::Identify => self.identify(state, person, now_s),
            Scene::Check => self.check(state, person, now_s, fresh),
            Scene::Lift(index) => self.lift(index, state, person, now_s, fresh),
            Scene::Handover => {
                let Some(handovers) = &mut self.handovers else { return Ok(()) };
                if handovers.update(state, person, fresh)? {
                    self.enter(Scene::End, now_s);
                }
            }
            Scene::End => {
                if is_clear && now_s - self.scene_since_s > AFTER_LIFTS_S {
                    self.enter(Scene::Over, now_s);
                }
            }
            Scene::Over => {}
        }
        Ok(())
    }

    fn enter(&mut self, scene: Scene, now_s: f64) {
        self.scene = scene;
        self.scene_since_s = now_s;
    }

    fn identify(&mut self, state: &State, person: &SimulationHandle, now_s: f64) {
        if state.phase == Phase::Monitoring as u32 {
            self.identified_after_s = now_s - self.scene_since_s;
            self.predicted_sigma_m = state.predicted_cop_sigma_m;
            self.enter(Scene::Check, now_s);
            self.assume_check_pose(person);
            return;
        }
        if state.suggested_pose != self.suggested {
            (self.suggested, self.suggested_since_s, self.has_reacted) = (state.suggested_pose, now_s, false);
        }
        let since_s = now_s - self.suggested_since_s;
        if !self.has_reacted && since_s >= self.pace.reaction_s {
            self.has_reacted = true;
            self.assume_pose(person, state.suggested_pose as usize);
        } else if since_s > self.pace.reaction_s + TIMEOUT_S {
            // If the suggested pose has no effect, the person tries another one.
            self.suggested_since_s = now_s;
            self.assume_pose(person, (state.suggested_pose as usize + 7) % LIBRARY.len());
        }
    }

    fn assume_pose(&mut self, person: &SimulationHandle, pose: usize) {
        if person.take_pose(pose).is_ok() {
            self.requested |= 1 << pose.min(63);
        }
    }

    /// Poses that were never suggested check the model.
    fn assume_check_pose(&mut self, person: &SimulationHandle) {
        let unused = (0..LIBRARY.len()).filter(|pose| self.requested & (1 << pose) == 0);
        if let Some(pose) = unused.step_by(5).nth(self.check_pose).or(Some(self.check_pose)) {
            // Always valid: the index comes from the library.
            let _ = person.take_pose(pose);
        }
    }

    fn check(&mut self, state: &State, person: &SimulationHandle, now_s: f64, fresh: bool) {
        let invalid = state
            .validity()
            .any_of(Validity::INVALIDATES_COP_MEASURED.and(Validity::INVALIDATES_COP_ESTIMATED));
        if fresh && state.static_pose == 1 && !invalid {
            self.unloaded.add(state);
        }
        if now_s - self.scene_since_s > CHECK_POSE_S * (self.check_pose + 1) as f64 {
            self.check_pose += 1;
            if self.check_pose == CHECK_POSES && self.unloaded.samples == 0.0 {
                // On a busy machine the sensors may be late for all poses: they are repeated.
                self.check_pose = 0;
                self.enter(Scene::Check, now_s);
            }
            if self.check_pose < CHECK_POSES {
                self.assume_check_pose(person);
            } else if let Some(handovers) = &mut self.handovers {
                handovers.begin(person);
                self.enter(Scene::Handover, now_s);
            } else {
                self.begin_lift(0, now_s);
            }
        }
    }

    fn begin_lift(&mut self, index: usize, now_s: f64) {
        self.lift_acts = 0;
        self.lifts.truncate(index);
        self.lifts.push(LiftSums::new());
        self.enter(Scene::Lift(index), now_s);
    }

    fn lift(&mut self, index: usize, state: &State, person: &SimulationHandle, now_s: f64, fresh: bool) {
        let since_s = now_s - self.scene_since_s;
        let box_kg = BOXES_KG[index];
        let lifted_kg = Some(box_kg).filter(|_| !self.is_empty_handed);
        self.lift_acts = lift::act(person, lifted_kg, since_s, self.pace.lifts, self.lift_acts);
        if fresh
            && !self.is_empty_handed
            && !state.validity().any_of(Validity::INVALIDATES_TORQUES)
            && let Some(sums) = self.lifts.last_mut()
        {
            let time_s = (state.suit_sample_time_ns as f64 - person.start_ns() as f64) * 1e-9;
            sums.add(state, &person.truth_at(time_s), box_kg);
        }
        if since_s > LIFT_S * self.pace.lifts {
            // On a busy machine the sensors may be late for a whole lift. It is repeated after the same motion with empty
            // hands, by which the daemon measures the latency between the streams again.
            let is_complete = self.lifts.last().is_some_and(LiftSums::is_complete);
            self.is_empty_handed = !is_complete && !self.is_empty_handed;
            let next = index + usize::from(is_complete);
            if next < BOXES_KG.len() {
                self.begin_lift(next, now_s);
            } else {
                person.intend(&Intention::STAND, STAND_S);
                self.enter(Scene::End, now_s);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_of_the_cop_covers_all_values_and_is_zero_for_one() {
        let mut range = CopRange::default();
        assert_eq!(range.extent_m(), [0.0; 2]);
        range.add([0.5, 0.25]);
        assert_eq!(range.extent_m(), [0.0; 2]);
        range.add([0.75, -0.25]);
        range.add([0.625, 0.0]);
        assert_eq!(range.extent_m(), [0.25, 0.5]);
    }
}
