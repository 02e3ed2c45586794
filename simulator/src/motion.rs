//! A simulated human that follows poses over time, breathes, sways, and lifts a box. A pure function of time for a
//! given sequence of commands.

use equipoise_core::body::{SEGMENTS, Segment};
use equipoise_core::pose_suggestion::Posture;
use nalgebra::{Rotation2, UnitQuaternion, Vector2, Vector3};
use std::borrow::Cow;
use std::f64::consts::TAU;

use crate::GRAVITY_M_PER_S2;
use crate::balance::{Standing, Start, grips_m};
use crate::dynamics::{Wrench, ground_reaction};
use crate::feet::{Feet, FeetDivision, FeetHabits};
use crate::grasp::hold_box;
use crate::intention::Intention;
use crate::kinematics::Rotations;
use crate::march::March;
use crate::person::Person;
use crate::pose::Pose;
use crate::random::{BandLimitedNoise, Random};
use crate::reach::{HeldPart, ReachHabits, inclined, reach};
use crate::schedule::Schedule;
use crate::stance::Stance;
use crate::stomp::Stomps;
use crate::walk::{StandingPosition, Walk};

/// Half the span of the central differences of dynamics, s.
pub(crate) const DIFFERENCE_S: f64 = 0.002;
/// From "the box is on the table" to "the hands carry it all", s.
const GRASP_S: f64 = 0.3;
/// Time in which the body adapts its balance to a new load, longer than the load's onset, s.
const LEAN_S: f64 = 1.2;
/// Duration of reaching for a part, and of standing up after it, s.
const REACH_S: f64 = 1.8;
/// A foot whose ankle is higher than in standing by this is in the air, m.
const LIFTED_M: f64 = 0.002;

/// Involuntary and habitual deviations from the commanded motion. All zero is a statue.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Habits {
    /// The chest's centre of mass moves back and forth by this with each breath, m.
    pub breathing_m: f64,
    /// Breaths per second.
    pub breathing_hz: f64,
    /// Standard deviation of the sway of the centre of mass, forward and to the side, m.
    pub sway_m: [f64; 2],
    /// Standard deviation of the slow tilt of the pelvis, rad.
    pub sway_rad: f64,
    /// Standard deviation of each joint's deviation from the requested pose, rad.
    pub pose_error_rad: f64,
    /// Standard deviation of the chosen balance point, per pose, m.
    pub balance_error_m: f64,
    /// Distance between the grips of the hands on a box, m; 0.30 to 0.45 was measured.
    pub hands_apart_m: f64,
    /// Fraction of a box carried by the right hand, in [0, 1].
    pub right_hand_fraction: f64,
    /// How the feet divide the ground reaction.
    pub feet: FeetHabits,
    /// Grip point of each hand, relative to the person's average, hand's axes (left; the right mirrors Y), m.
    pub grip_off_m: [[f64; 3]; 2],
    /// Horizontal distance of a box's centre beyond the line between the grips, away from the body, m.
    pub load_ahead_m: f64,
    /// Squeezing force of each hand on a box between both, as a fraction of its weight.
    pub squeeze_ratio: f64,
}

impl Habits {
    /// A healthy adult.
    pub const ORDINARY: Habits = Habits {
        breathing_m: 0.003,
        breathing_hz: 0.25,
        sway_m: [0.003, 0.002],
        sway_rad: 0.003,
        pose_error_rad: 0.05,
        balance_error_m: 0.008,
        hands_apart_m: 0.375,
        right_hand_fraction: 0.5,
        feet: FeetHabits::EVEN,
        grip_off_m: [[0.0; 3]; 2],
        load_ahead_m: 0.0,
        squeeze_ratio: 0.0,
    };
    /// A statue that takes poses exactly.
    pub const NONE: Habits = Habits {
        breathing_m: 0.0,
        breathing_hz: 0.25,
        sway_m: [0.0; 2],
        sway_rad: 0.0,
        pose_error_rad: 0.0,
        balance_error_m: 0.0,
        ..Habits::ORDINARY
    };
}

/// State of the body at one time. World: X forward, Y left, Z up, the floor at 0; m.
#[derive(Debug, Clone)]
pub struct BodyState {
    /// The time, s.
    pub time_s: f64,
    /// Segment origins (proximal joint centres), m.
    pub origin_m: [Vector3<f64>; SEGMENTS],
    /// `world_from_segment`.
    pub world_from_segment: Rotations,
    /// Centres of mass of the segments, m.
    pub com_m: [Vector3<f64>; SEGMENTS],
    /// Grip points of the left and right hand, m.
    pub grip_m: [Vector3<f64>; 2],
    /// Load on the hands, kg; increases from zero while a box is grasped.
    pub load_kg: f64,
    /// Fraction of it on the right hand, in [0, 1].
    pub right_hand_fraction: f64,
    /// From the line between the grips to the box's centre, m.
    pub load_ahead_m: Vector3<f64>,
    /// Squeezing force of the box on the left hand, N; its opposite acts on the right hand.
    pub squeeze_n: Vector3<f64>,
    /// How the feet divide the ground reaction ([`Habits::feet`]).
    pub feet: FeetDivision,
    /// Which feet are on the floor: left, right.
    pub foot_stands: [bool; 2],
}

impl BodyState {
    /// Fraction of the box on each hand, left and right.
    pub fn hand_load_fraction(&self) -> [f64; 2] {
        [1.0 - self.right_hand_fraction, self.right_hand_fraction]
    }

    /// The box's centre, m: ahead of the line between the grips, nearer to the hand that carries more.
    pub fn load_m(&self) -> Vector3<f64> {
        let [left, right] = self.hand_load_fraction();
        self.grip_m[0] * left + self.grip_m[1] * right + self.load_ahead_m
    }

    /// Point of action of the box's weight on each hand, left and right, m: a rigid box, whose centre is ahead of the
    /// grips, passes to each hand its fraction of the resulting couple.
    pub fn load_on_hand_m(&self) -> [Vector3<f64>; 2] {
        self.grip_m.map(|grip_m| grip_m + self.load_ahead_m)
    }
}

/// Target of the motion: a pose, and the point above which to balance it.
#[derive(Debug, Clone, Copy)]
struct Aim {
    pose: Pose,
    /// 1 with the hands at the sides of a box, otherwise 0. Only between two poses at a box does the motion keep the
    /// hands at its sides.
    at_box: f64,
    balance_m: Vector2<f64>,
    /// Inclination of the line from the grips to a load's centre below the horizontal, rad.
    load_down_rad: f64,
}

/// The simulated worker.
#[derive(Debug, Clone)]
pub struct Worker {
    person: Person,
    stance: Stance,
    habits: Habits,
    aims: Schedule<Aim>,
    load_kg: Schedule<f64>,
    expected_load_kg: Schedule<f64>,
    marches: Vec<March>,
    stomps: Vec<Stomps>,
    walk: Walk,
    deviation: Random,
    sway: [BandLimitedNoise; 4],
    feet: Feet,
}

impl Worker {
    /// An ordinary person, standing straight with the feet left and right of the origin.
    pub fn new(person: Person, seed: u64) -> Worker {
        Worker::with_habits(person, seed, Habits::ORDINARY)
    }

    /// The same with other habits.
    pub fn with_habits(mut person: Person, seed: u64, habits: Habits) -> Worker {
        for ((grip_m, [x, y, z]), side) in person.grip_m.iter_mut().zip(habits.grip_off_m).zip([1.0, -1.0]) {
            *grip_m += Vector3::new(x, side * y, z);
        }
        let stance = Stance::shoulder_wide(&person);
        let mut random = Random::new(seed, "sway");
        let [forward, aside] = habits.sway_m;
        let sway = [forward, aside, habits.sway_rad, habits.sway_rad]
            .map(|sigma| BandLimitedNoise::new(&mut random, sigma, 0.03, 1.0));
        let (pose, balance_m) = (Intention::STAND.pose(), usual_balance_m(&person, &stance));
        let aim = Aim { pose, at_box: 0.0, balance_m, load_down_rad: 0.0 };
        let walk = Walk::new(&person, &stance);
        Worker {
            person,
            stance,
            habits,
            aims: Schedule::starting_with(aim),
            load_kg: Schedule::starting_with(0.0),
            expected_load_kg: Schedule::starting_with(0.0),
            marches: Vec::new(),
            stomps: Vec::new(),
            walk,
            deviation: Random::new(seed, "deviation from the pose"),
            sway,
            feet: Feet::new(&habits.feet, seed),
        }
    }

    /// The body.
    pub fn person(&self) -> &Person {
        &self.person
    }

    /// Placement of the feet before any walking ([`Worker::go`]).
    pub fn stance(&self) -> &Stance {
        &self.stance
    }

    /// Placement of the feet at a time, and the polygon of those on the floor.
    pub fn stance_at(&self, time_s: f64) -> Stance {
        self.walk.stance(&self.person, time_s)
    }

    /// Heading at a time: rotation to the left, rad.
    pub fn heading_rad(&self, time_s: f64) -> f64 {
        self.walk.heading_rad(time_s)
    }

    /// Walks to another place, one foot after the other. Returns its end, s.
    ///
    /// The upper body continues its motion, in the new direction; it should be upright meanwhile, without a box and not
    /// marching.
    pub fn go(&mut self, at_s: f64, to: StandingPosition) -> f64 {
        self.walk.go(at_s, to)
    }

    /// Takes a posture of the library from `at_s` on and reaches it after `over_s`, with the habits' deviations.
    pub fn take_pose(&mut self, posture: &Posture, at_s: f64, over_s: f64) {
        self.follow(Pose::of_posture(posture, &self.person), 0.0, at_s, over_s);
    }

    /// The same for an intention.
    pub fn intend(&mut self, intention: &Intention, at_s: f64, over_s: f64) {
        self.follow(intention.pose(), f64::from(intention.at_box), at_s, over_s);
    }

    /// Grasps a box of that mass at `at_s`; [`BodyState::load_m`] is its centre.
    pub fn lift(&mut self, mass_kg: f64, at_s: f64) {
        self.load_kg.push(mass_kg, at_s, GRASP_S);
        self.expected_load_kg.push(mass_kg, at_s, LEAN_S);
    }

    /// Releases the box at `at_s`.
    pub fn put_down(&mut self, at_s: f64) {
        self.lift(0.0, at_s);
    }

    /// Picks up a box in front, holds it close, stretches it out, raises it, puts it down: about 16 s from `at_s`.
    pub fn lift_and_show(&mut self, mass_kg: f64, at_s: f64) {
        for (intention, after_s) in crate::repertoire::LIFTING.iter().zip([0.0, 3.0, 6.0, 9.0, 12.0]) {
            self.intend(intention, at_s + after_s, 1.8);
        }
        self.lift(mass_kg, at_s + 2.2);
        self.put_down(at_s + 14.5);
    }

    /// Reaches for a part that is held there, takes its weight, gives it back after `for_s` and stands straight. Unlike in
    /// other motions the hands are exactly where the part is. Returns when the body is at rest with the whole weight,
    /// and when that ends, s; `None`, and the person does nothing, if the part is out of reach.
    pub fn hold_part(
        &mut self,
        habits: &ReachHabits,
        part: &HeldPart,
        mass_kg: f64,
        at_s: f64,
        for_s: f64,
    ) -> Option<[f64; 2]> {
        let (at_box, balance_m) = (0.0, self.stance.between_the_feet_m(habits.balance_ahead_m));
        let load_down_rad = part.load_down_rad();
        let [empty, loaded] = [0.0, mass_kg].map(|load_kg| {
            let (person, stance) = (&self.person, &self.stance);
            let standing = Standing { person, com_m: &person.com_m, stance, load_kg };
            reach(&standing, habits, part).map(|(pose, _)| Aim { pose, at_box, balance_m, load_down_rad })
        });
        let (empty, loaded) = (empty?, loaded?);
        // With the weight the body leans back, and the arms stretch by as much: the hands stay at the part.
        let (taken_s, given_s) = (at_s + REACH_S, at_s + REACH_S + LEAN_S + for_s);
        self.aims.push(empty, at_s, REACH_S);
        self.aims.push(loaded, taken_s, LEAN_S);
        self.lift(mass_kg, taken_s);
        self.aims.push(empty, given_s, LEAN_S);
        self.put_down(given_s);
        self.intend(&Intention::STAND, given_s + LEAN_S, REACH_S);
        Some([taken_s + LEAN_S, given_s])
    }

    /// Marches on the spot: that many steps, the feet alternately some 9 cm off the floor. Returns its end, s.
    ///
    /// The upper body continues its motion. No load should be carried (the truth shares a load between both feet,
    /// regardless of their positions), and no other march should be in progress.
    pub fn march_on_the_spot(&mut self, at_s: f64, steps: u32) -> f64 {
        let march = March::new(&self.person, &self.stance, at_s, steps);
        self.marches.push(march);
        march.end_s()
    }

    /// Stamps the right foot down, that many times at an irregular beat, with the weight on the left. Returns its end,
    /// s. As with [`Worker::march_on_the_spot`], no other activity should be in progress.
    pub fn stomp(&mut self, at_s: f64, count: u32) -> f64 {
        let stomps = Stomps::new(&self.stance, at_s, count);
        self.stomps.push(stomps);
        stomps.end_s()
    }

    fn follow(&mut self, mut pose: Pose, at_box: f64, at_s: f64, over_s: f64) {
        pose.add_errors(self.habits.pose_error_rad, &mut self.deviation);
        if at_box >= 1.0 {
            pose = hold_box(&self.person, &pose, self.habits.hands_apart_m);
        }
        let sigma_m = self.habits.balance_error_m;
        let error =
            Vector2::from_fn(|_, _| (sigma_m * self.deviation.normal()).clamp(-2.0 * sigma_m, 2.0 * sigma_m));
        let balance_m = usual_balance_m(&self.person, &self.stance) + error;
        self.aims.push(Aim { pose, at_box, balance_m, load_down_rad: 0.0 }, at_s, over_s);
    }

    /// State of the body at a time.
    pub fn sample(&self, time_s: f64) -> BodyState {
        self.sample_near(time_s, &mut Start::default())
    }

    fn sample_near(&self, time_s: f64, start: &mut Start) -> BodyState {
        let mix = |from: &f64, to: &f64, s: f64| from + s * (to - from);
        let mut aim = self.aims.at(time_s, |from, to, s| Aim {
            pose: from.pose.towards(&to.pose, s),
            at_box: mix(&from.at_box, &to.at_box, s),
            balance_m: from.balance_m.lerp(&to.balance_m, s),
            load_down_rad: mix(&from.load_down_rad, &to.load_down_rad, s),
        });
        if aim.at_box >= 1.0 {
            aim.pose = hold_box(&self.person, &aim.pose, self.habits.hands_apart_m);
        }
        let [forward, aside, roll, pitch] = [0, 1, 2, 3].map(|i: usize| self.sway[i].at(time_s));
        let tilt = UnitQuaternion::from_scaled_axis(Vector3::new(roll, pitch, 0.0));
        aim.pose.parent_from_segment[0] = tilt * aim.pose.parent_from_segment[0];
        let com_m = self.breathing_coms_m(time_s);
        let mut stance = Cow::Borrowed(&self.stance);
        let marches = self.marches.iter().filter(|march| march.lasts(time_s));
        let stomps = self.stomps.iter().filter(|stomps| stomps.lasts(time_s));
        let marches = marches.map(|m| (m.lift_m(time_s), m.aside_m(time_s), m.sink(time_s)));
        let stomps = stomps.map(|s| (s.lift_m(time_s), s.aside_m(time_s), s.sink(time_s)));
        for (lift_m, aside_m, sink) in marches.chain(stomps) {
            for (ankle_m, lift_m) in stance.to_mut().ankle_m.iter_mut().zip(lift_m) {
                ankle_m.z += lift_m;
            }
            aim.balance_m.y += aside_m;
            aim.pose.pelvis_height -= sink;
        }
        if !self.walk.is_empty() {
            self.turn_towards(&mut aim, time_s);
            self.walk.place_feet(time_s, stance.to_mut());
        }
        let sway_m = self.in_heading(Vector2::new(forward, aside), time_s);
        let standing = Standing {
            person: &self.person,
            com_m: &com_m,
            stance: &stance,
            load_kg: self.expected_load_kg.at(time_s, mix),
        };
        let body = standing.balance_near(&aim.pose, aim.balance_m + sway_m, start);
        let grip_m = grips_m(&self.person, &body.origin_m, &body.world_from_segment);
        let load_kg = self.load_kg.at(time_s, mix);
        let apart = (grip_m[0] - grip_m[1]).try_normalize(1e-6).unwrap_or_else(Vector3::zeros);
        // "Ahead" is relative to the chest, because the line between the hands rotates quickly when one hand passes
        // above the other, which would cause large inertial forces of the box.
        let leftwards = body.world_from_segment[Segment::T8.index()] * Vector3::y();
        let ahead = leftwards.cross(&Vector3::z()).try_normalize(1e-6).unwrap_or_else(Vector3::zeros);
        let squeeze_n = self.habits.squeeze_ratio * load_kg * GRAVITY_M_PER_S2;
        BodyState {
            time_s,
            origin_m: body.origin_m,
            world_from_segment: body.world_from_segment,
            com_m: body.com_m,
            grip_m,
            load_kg,
            right_hand_fraction: self.habits.right_hand_fraction,
            load_ahead_m: inclined(ahead, aim.load_down_rad) * self.habits.load_ahead_m,
            squeeze_n: apart * squeeze_n,
            feet: self.feet.at(time_s),
            foot_stands: stance.ankle_m.map(|ankle_m| ankle_m.z < self.person.ankle_height_m + LIFTED_M),
        }
    }

    /// Ground reaction on the person at a time, by the equations of motion.
    pub fn ground_reaction(&self, time_s: f64) -> Wrench {
        ground_reaction(&self.person, &self.around(time_s), DIFFERENCE_S)
    }

    /// The states one difference before, at, and one difference after a time.
    pub(crate) fn around(&self, time_s: f64) -> [BodyState; 3] {
        let mut start = Start::default();
        [time_s - DIFFERENCE_S, time_s, time_s + DIFFERENCE_S].map(|t| self.sample_near(t, &mut start))
    }

    /// Velocity and acceleration of the segment origins, m/s and m/s².
    pub fn origin_motion(&self, time_s: f64) -> [[Vector3<f64>; 2]; SEGMENTS] {
        let [before, now, after] = self.around(time_s).map(|body| body.origin_m);
        std::array::from_fn(|i| {
            let velocity = (after[i] - before[i]) / (2.0 * DIFFERENCE_S);
            [velocity, (after[i] - now[i] * 2.0 + before[i]) / (DIFFERENCE_S * DIFFERENCE_S)]
        })
    }

    /// Transforms the target to the place and heading reached by walking.
    fn turn_towards(&self, aim: &mut Aim, time_s: f64) {
        let heading = UnitQuaternion::from_scaled_axis(Vector3::z() * self.walk.heading_rad(time_s));
        // On one foot the range of possible balance points is small.
        let room = 1.0 - 0.8 * self.walk.activation(time_s);
        let chosen_m = (aim.balance_m - usual_balance_m(&self.person, &self.stance)) * room;
        aim.balance_m = self.walk.balance_m(time_s) + self.in_heading(chosen_m, time_s);
        aim.pose.parent_from_segment[0] = heading * aim.pose.parent_from_segment[0];
        aim.pose.pelvis_height -= self.walk.sink(time_s);
    }

    /// Forward and left in the world.
    fn in_heading(&self, forward_left_m: Vector2<f64>, time_s: f64) -> Vector2<f64> {
        if self.walk.is_empty() {
            return forward_left_m;
        }
        Rotation2::new(self.walk.heading_rad(time_s)) * forward_left_m
    }

    fn breathing_coms_m(&self, time_s: f64) -> [Vector3<f64>; SEGMENTS] {
        let mut com_m = self.person.com_m;
        let breath = self.habits.breathing_m * (TAU * self.habits.breathing_hz * time_s).sin();
        for (segment, fraction) in [(Segment::T8, 1.0), (Segment::T12, 0.8), (Segment::L3, 0.5)] {
            com_m[segment.index()].x += fraction * breath;
        }
        com_m
    }
}

/// Usual balance point: in front of the ankles, near the middle of the foot.
fn usual_balance_m(person: &Person, stance: &Stance) -> Vector2<f64> {
    stance.between_the_feet_m(0.025 * person.height_m)
}
