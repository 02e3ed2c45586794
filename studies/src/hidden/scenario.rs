//! Activity of the worker: standing, poses, free work, steps to other places on the plate, and requested experiments.

use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_simulator::balance::Standing;
use equipoise_simulator::intention::{Arm, Intention};
use equipoise_simulator::limits;
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::random::Random;
use equipoise_simulator::walk::StandingPosition;
use nalgebra::{Rotation2, Vector2};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::truth::{Outcome, Spans, Standing as Stands};
use crate::subject::Subject;

/// Durations of the parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lengths {
    /// Minimum and maximum number of poses during identification.
    pub poses: [usize; 2],
    /// Work declared clean, s.
    pub reference_s: f64,
    /// Work in question, s.
    pub work_s: f64,
}

impl Lengths {
    /// About five minutes.
    pub const ORDINARY: Lengths = Lengths { poses: [15, 18], reference_s: 120.0, work_s: 90.0 };
    /// About a minute and a half.
    pub const FAST: Lengths = Lengths { poses: [7, 8], reference_s: 30.0, work_s: 30.0 };
}

/// Initial standing, s: segment lengths and weight are measured.
const FIRST_S: f64 = 4.0;
/// A pose is held for this long, s.
const HELD_S: f64 = 2.5;
/// From pose to pose, s.
const MOVE_S: f64 = 1.2;
/// A requested pose is held for this long, s.
const ASKED_S: f64 = 4.0;
/// Requested quick squats, and the time down or up of one, s.
const SQUATS: (u32, f64) = (5, 0.8);
/// Standing up straight before a step, s.
const RISE_S: f64 = 1.2;
/// A turn by this angle separates errors of the plate's axes from those of the body's, degrees.
const TURNED_DEG: f64 = 25.0;

/// An experiment that a program asks for, as in the field `ask` of its finding.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Experiment {
    /// Poses of the library, by name.
    #[serde(default)]
    pub poses: Vec<String>,
    /// Turn of the body before, degrees to the left.
    pub turn_deg: f64,
    /// Step before, forward and to the left, m.
    pub step_m: [f64; 2],
    /// Duration of static standing, s.
    pub still_s: f64,
    /// Fast motion.
    pub fast: bool,
}

/// An experiment that the program asked for and got.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Performed {
    /// What the simulated person did.
    #[serde(flatten)]
    pub experiment: Experiment,
    /// Stated probability that it decides.
    pub decides: f64,
    /// The finding before it.
    pub before: Outcome,
}

impl Performed {
    /// The field `ask` of a finding, once performed; `None` if it is null.
    pub fn asked(ask: &Value) -> Option<Performed> {
        let experiment = serde_json::from_value(ask.clone()).ok()?;
        Some(Performed { experiment, decides: ask["decides"].as_f64()?, before: Outcome::Undecided })
    }
}

/// A session's script, played.
#[derive(Debug, Clone)]
pub struct Script {
    /// The worker, with all commands given.
    pub worker: Worker,
    /// Phases of the recording.
    pub spans: Spans,
    /// Its length, s.
    pub length_s: f64,
    /// The same without experiments: the noise before them does not depend on them.
    pub unasked_s: f64,
    /// Standing places of the worker.
    pub places: Vec<Stands>,
    /// Whether the worker turned in the work.
    pub turned: bool,
}

/// Runs the subject through a session.
pub fn play(subject: &Subject, habits: Habits, lengths: &Lengths) -> Script {
    let mut random = Random::new(subject.seed, "script");
    let mut played = Player {
        worker: Worker::with_habits(subject.person(), subject.seed, habits),
        places: vec![Stands { from_s: 0.0, middle_m: [0.0; 2], heading_deg: 0.0 }],
        now_s: FIRST_S,
    };
    played.take_poses(lengths.poses, &mut random);
    let identified_s = played.now_s;
    let nearby = if random.happens(0.5) { vec![(0.5, place(&mut random, 10.0))] } else { Vec::new() };
    played.work(lengths.reference_s, &nearby, &mut random);
    let known_s = played.now_s;
    let steps = elsewhere(lengths.work_s, &mut random);
    played.work(lengths.work_s, &steps, &mut random);
    let Player { worker, places, now_s } = played;
    let turned = places.iter().any(|place| place.heading_deg.abs() >= TURNED_DEG && place.from_s < now_s);
    let spans =
        Spans { identify: [0.0, identified_s], reference: [identified_s, known_s], work: [known_s, now_s] };
    Script { worker, spans, length_s: now_s, unasked_s: now_s, places, turned }
}

/// Two or three other places in most sessions, and their times within the work.
fn elsewhere(work_s: f64, random: &mut Random) -> Vec<(f64, StandingPosition)> {
    if random.happens(0.15) {
        return Vec::new();
    }
    let count = if work_s > 60.0 && random.happens(0.5) { 3 } else { 2 };
    let first_to_the_left = random.happens(0.5);
    (0..count)
        .map(|index| {
            // Leaves time at the last of them.
            let when = (f64::from(index) + random.between(0.35, 0.65)) / (f64::from(count) + 0.4);
            let place = place(random, 5.0);
            let far = if random.happens(0.2) { 90.0 } else { random.between(28.0, 42.0) };
            let left = (index % 2 == 0) == first_to_the_left;
            let heading_deg = if left { far } else { -far };
            (
                when,
                StandingPosition { heading_rad: place.heading_rad + f64::to_radians(heading_deg), ..place },
            )
        })
        .collect()
}

fn place(random: &mut Random, heading_deg: f64) -> StandingPosition {
    StandingPosition {
        middle_m: Vector2::new(random.between(-0.06, 0.06), random.between(-0.06, 0.06)),
        heading_rad: random.between(-heading_deg, heading_deg).to_radians(),
    }
}

struct Player {
    worker: Worker,
    places: Vec<Stands>,
    now_s: f64,
}

impl Script {
    /// The same session, continued by an experiment at its end; its work lasts as long.
    pub fn continued(self, experiment: &Experiment) -> Script {
        let Script { worker, mut spans, length_s, unasked_s, places, turned } = self;
        let mut played = Player { worker, places, now_s: length_s };
        played.experiment(experiment);
        let Player { worker, places, now_s } = played;
        spans.work[1] = now_s;
        Script { worker, spans, length_s: now_s, unasked_s, places, turned }
    }
}

impl Player {
    /// Does what a program asks for.
    fn experiment(&mut self, ask: &Experiment) {
        self.worker.intend(&Intention::STAND, self.now_s, RISE_S);
        self.now_s += RISE_S;
        if let Some(last) = self.places.last().copied()
            && (ask.turn_deg != 0.0 || ask.step_m != [0.0; 2])
        {
            let heading_rad = last.heading_deg.to_radians();
            // Forward and left of the person, not of the plate.
            let step_m = Rotation2::new(heading_rad) * Vector2::from(ask.step_m);
            self.go(StandingPosition {
                middle_m: Vector2::from(last.middle_m) + step_m,
                heading_rad: heading_rad + ask.turn_deg.to_radians(),
            });
        }
        if ask.fast {
            let (count, over_s) = SQUATS;
            let down = Intention { pelvis_drop: 0.2, pelvis_deg: [15.0, 0.0, 0.0], ..Intention::STAND };
            for _ in 0..count {
                for intention in [&down, &Intention::STAND] {
                    self.worker.intend(intention, self.now_s, over_s);
                    self.now_s += over_s;
                }
            }
        }
        let asked = ask.poses.iter().filter_map(|pose| LIBRARY.iter().find(|posture| posture.name == pose));
        for posture in asked {
            self.worker.take_pose(posture, self.now_s, MOVE_S);
            self.now_s += MOVE_S + ASKED_S;
        }
        self.now_s += if ask.still_s > 0.0 { ask.still_s } else { ASKED_S };
    }

    fn take_poses(&mut self, [fewest, most]: [usize; 2], random: &mut Random) {
        let count = fewest + random.between(0.0, (most - fewest + 1) as f64) as usize;
        let mut order: Vec<usize> = (1..LIBRARY.len()).collect();
        for index in 0..count.min(order.len()) {
            let other = index + random.between(0.0, (order.len() - index) as f64) as usize;
            order.swap(index, other);
            self.worker.take_pose(&LIBRARY[order[index]], self.now_s, MOVE_S);
            self.now_s += MOVE_S + HELD_S;
        }
    }

    /// Free work; `steps` are places to walk to, each with its fraction of the time.
    fn work(&mut self, for_s: f64, steps: &[(f64, StandingPosition)], random: &mut Random) {
        let (start_s, end_s) = (self.now_s, self.now_s + for_s);
        let mut steps = steps.iter().peekable();
        while self.now_s < end_s {
            if let Some((_, place)) = steps.next_if(|(fraction, _)| self.now_s >= start_s + fraction * for_s)
            {
                self.go(*place);
                continue;
            }
            let intention = self.feasible(random);
            let over_s = random.between(0.9, 1.8);
            self.worker.intend(&intention, self.now_s, over_s);
            let held_s =
                if random.happens(0.5) { random.between(0.2, 1.0) } else { random.between(2.0, 4.0) };
            self.now_s += over_s + held_s;
        }
        self.now_s = end_s;
    }

    fn go(&mut self, place: StandingPosition) {
        let relaxed = Intention { pelvis_drop: 0.02, ..Intention::STAND };
        self.worker.intend(&relaxed, self.now_s, RISE_S);
        let from_s = self.worker.go(self.now_s + RISE_S, place);
        self.places.push(Stands {
            from_s,
            middle_m: place.middle_m.into(),
            heading_deg: place.heading_rad.to_degrees(),
        });
        self.now_s = from_s + 0.5;
    }

    /// A random intention that is feasible for this body.
    fn feasible(&self, random: &mut Random) -> Intention {
        let person = self.worker.person();
        let standing = Standing { person, com_m: &person.com_m, stance: self.worker.stance(), load_kg: 0.0 };
        let target = self.worker.stance().between_the_feet_m(0.025 * person.height_m);
        for _ in 0..30 {
            let intention = something(random);
            if limits::check(&standing.balance(&intention.pose(), target)).is_ok() {
                return intention;
            }
        }
        Intention::STAND
    }
}

/// A bend, a reach, a squat, a rotation of the trunk, or just standing, with random arms.
fn something(random: &mut Random) -> Intention {
    let kind = random.unit();
    let mut between = |low: f64, high: f64| random.between(low, high);
    let mut intention = Intention::STAND;
    if kind < 0.30 {
        intention.pelvis_deg = [between(-3.0, 6.0), 0.0, between(-6.0, 6.0)];
        intention.trunk_flex_deg = between(-8.0, 10.0);
        intention.trunk_twist_deg = between(-15.0, 15.0);
    } else if kind < 0.65 {
        intention.pelvis_drop = between(0.0, 0.08);
        intention.pelvis_deg = [between(8.0, 34.0), 0.0, 0.0];
        intention.trunk_flex_deg = between(8.0, 40.0);
        intention.trunk_twist_deg = between(-20.0, 20.0);
    } else if kind < 0.80 {
        intention.pelvis_drop = between(0.08, 0.30);
        intention.pelvis_deg = [between(8.0, 30.0), 0.0, between(-6.0, 6.0)];
        intention.trunk_flex_deg = between(0.0, 22.0);
    } else {
        intention.pelvis_deg = [0.0, between(-6.0, 6.0), between(-14.0, 14.0)];
        intention.trunk_side_deg = between(-24.0, 24.0);
        intention.trunk_twist_deg = between(-30.0, 30.0);
        intention.trunk_flex_deg = between(0.0, 12.0);
    }
    intention.head_deg = [between(-15.0, 30.0), 0.0, between(-35.0, 35.0)];
    let mode = between(0.0, 4.0) as u32;
    let mut arm = || match mode {
        0 => bent(between(5.0, 30.0), between(-30.0, 60.0), between(0.0, 30.0), between(5.0, 40.0)),
        1 => bent(between(20.0, 90.0), between(60.0, 95.0), between(10.0, 60.0), between(5.0, 100.0)),
        2 => bent(between(60.0, 150.0), between(10.0, 90.0), between(0.0, 60.0), between(5.0, 80.0)),
        _ => bent(between(10.0, 130.0), between(-20.0, 95.0), between(0.0, 60.0), between(5.0, 110.0)),
    };
    intention.left_arm = arm();
    intention.right_arm = arm();
    intention
}

fn bent(elevation_deg: f64, forward_deg: f64, outward_deg: f64, elbow_deg: f64) -> Arm {
    Arm { elevation_deg, forward_deg, outward_deg, elbow_deg }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_script_keeps_the_person_in_balance() {
        for seed in 1..25 {
            let subject = Subject::random(seed);
            let script = play(&subject, Habits::ORDINARY, &Lengths::FAST);
            for step in 0..(script.length_s * 20.0) as u32 {
                let time_s = 0.05 * f64::from(step);
                let cop_m = script.worker.ground_reaction(time_s).cop_m();
                let margin_m = script.worker.stance_at(time_s).margin_m(cop_m);
                assert!(margin_m > 0.0, "seed {seed} at {time_s:.2} s: {margin_m:.3} m outside");
            }
            assert!(script.spans.work[1] - script.spans.work[0] >= Lengths::FAST.work_s - 1e-9);
        }
    }

    #[test]
    fn most_scripts_turn_and_a_seed_is_a_script() {
        let turned =
            (1..30).filter(|seed| play(&Subject::random(*seed), Habits::ORDINARY, &Lengths::FAST).turned);
        assert!((18..29).contains(&turned.count()));
        let again = || play(&Subject::random(5), Habits::ORDINARY, &Lengths::FAST);
        let (one, same) = (again(), again());
        assert_eq!(one.places, same.places);
        assert_eq!(one.worker.sample(33.3).origin_m, same.worker.sample(33.3).origin_m);
    }
}
