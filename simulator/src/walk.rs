//! Stepping to another place: one foot after the other along an arc, with the weight on the standing foot.
//!
//! The centre of pressure is planned first: on the standing foot while the other is in the air, and moving from foot to
//! foot in between. A centre of mass `y` at height `z` has the centre of pressure `p = y − T² ÿ` with `T = √(z/g)`; of
//! all motions with that `p`, the bounded one is `y(t) = ∫ p(t + u) e^(−|u|/T) du / 2T`: the body leans before the step
//! begins, and comes to rest after it.

use equipoise_core::body::Side;
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use crate::GRAVITY_M_PER_S2;
use crate::person::Person;
use crate::schedule::{Schedule, minimum_jerk};
use crate::stance::Stance;

/// Duration of the weight's shift onto a foot, s.
const SHIFT_S: f64 = 0.55;
/// A foot is in the air for this long, s.
const SWING_S: f64 = 0.60;
/// Lift height, m.
const LIFT_M: f64 = 0.08;
/// A larger distance or rotation takes another pair of steps: m, rad.
const PACE: (f64, f64) = (0.20, 0.80);
/// The knees are slightly bent meanwhile, as in marching: fraction of the pelvis' height.
const SINK: f64 = 0.08;
/// Height of a standing person's centre of mass over stature.
const CENTRE_HEIGHT: f64 = 0.54;
/// Pressure point of a foot, in front of its ankle, over stature.
const PRESS: f64 = 0.025;
/// Half width of the integral over the planned centre of pressure, and the spacing of its sum, s.
const FORESIGHT: (f64, f64) = (2.4, 0.03);

/// Position of a standing person: the point between the feet and the direction of the toes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StandingPosition {
    /// Between the ankles, m.
    pub middle_m: Vector2<f64>,
    /// Rotation to the left, rad; 0 faces along X.
    pub heading_rad: f64,
}

impl StandingPosition {
    /// Start position.
    pub const HOME: StandingPosition =
        StandingPosition { middle_m: Vector2::new(0.0, 0.0), heading_rad: 0.0 };

    fn turn(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_scaled_axis(Vector3::z() * self.heading_rad)
    }

    /// Ankle and rotation of a foot here, for the stance at home.
    fn foot(&self, home: &Stance, k: usize) -> Foot {
        let from_middle_m = home.ankle_m[k] - home.between_the_feet_m(0.0).push(0.0);
        Foot {
            ankle_m: self.turn() * from_middle_m + self.middle_m.push(0.0),
            world_from_foot: self.turn() * home.world_from_foot[k],
        }
    }
}

/// One foot on the floor.
#[derive(Debug, Clone, Copy)]
struct Foot {
    ankle_m: Vector3<f64>,
    world_from_foot: UnitQuaternion<f64>,
}

/// One step of both feet.
#[derive(Debug, Clone, Copy)]
struct Pair {
    start_s: f64,
    from: StandingPosition,
    to: StandingPosition,
    /// The foot that moves first, an index into [`Side::BOTH`].
    first: usize,
}

impl Pair {
    const LENGTH_S: f64 = 3.0 * SHIFT_S + 2.0 * SWING_S;

    /// When a foot leaves the floor, s.
    fn swing_start_s(&self, k: usize) -> f64 {
        self.start_s + SHIFT_S + if k == self.first { 0.0 } else { SWING_S + SHIFT_S }
    }
}

/// All steps of one person.
#[derive(Debug, Clone)]
pub struct Walk {
    home: Stance,
    pairs: Vec<Pair>,
    press_m: Schedule<Vector2<f64>>,
    forward_m: f64,
    fall_s: f64,
}

impl Walk {
    /// A walk without steps so far.
    pub fn new(person: &Person, home: &Stance) -> Walk {
        let forward_m = PRESS * person.height_m;
        Walk {
            home: home.clone(),
            pairs: Vec::new(),
            press_m: Schedule::starting_with(home.between_the_feet_m(forward_m)),
            forward_m,
            fall_s: (CENTRE_HEIGHT * person.height_m / GRAVITY_M_PER_S2).sqrt(),
        }
    }

    /// Whether there are no steps.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Walks to a place, in as many pairs of steps as required; returns its end, s. It begins after any earlier
    /// walking.
    pub fn go(&mut self, start_s: f64, to: StandingPosition) -> f64 {
        let from = self.pairs.last().map_or(StandingPosition::HOME, |pair| pair.to);
        let turn_rad = to.heading_rad - from.heading_rad;
        let way_m = to.middle_m - from.middle_m;
        let paces = (way_m.norm() / PACE.0).max(turn_rad.abs() / PACE.1).ceil().max(1.0);
        let mut start_s =
            self.pairs.last().map_or(start_s, |pair| start_s.max(pair.start_s + Pair::LENGTH_S));
        let mut here = from;
        for pace in 1..=paces as u32 {
            let fraction = f64::from(pace) / paces;
            let next = StandingPosition {
                middle_m: from.middle_m + way_m * fraction,
                heading_rad: from.heading_rad + turn_rad * fraction,
            };
            self.step(start_s, here, next);
            here = next;
            start_s += Pair::LENGTH_S;
        }
        start_s
    }

    /// Moves both feet once; the foot on the side of the rotation, or of the direction, moves first.
    fn step(&mut self, start_s: f64, from: StandingPosition, to: StandingPosition) {
        let left = from.turn() * Vector3::y();
        let leftwards =
            (to.heading_rad - from.heading_rad) * 0.2 + left.xy().dot(&(to.middle_m - from.middle_m));
        let first = usize::from(leftwards < 0.0);
        let second = 1 - first;
        self.pairs.push(Pair { start_s, from, to, first });
        let on = |foot: Foot| (foot.ankle_m + foot.world_from_foot * (Vector3::x() * self.forward_m)).xy();
        let at_rest = to.middle_m + (to.turn() * (Vector3::x() * self.forward_m)).xy();
        let targets = [on(from.foot(&self.home, second)), on(to.foot(&self.home, first)), at_rest];
        for (index, target) in targets.into_iter().enumerate() {
            self.press_m.push(target, start_s + index as f64 * (SHIFT_S + SWING_S), SHIFT_S);
        }
    }

    /// The person's heading at a time, rad: it changes while the feet move.
    pub fn heading_rad(&self, time_s: f64) -> f64 {
        self.pairs.iter().fold(0.0, |heading, pair| {
            let fraction = (time_s - pair.start_s - SHIFT_S) / (Pair::LENGTH_S - 2.0 * SHIFT_S);
            heading + (pair.to.heading_rad - pair.from.heading_rad) * minimum_jerk(fraction)
        })
    }

    /// Lowering of the pelvis at a time, as a fraction of its height.
    pub fn sink(&self, time_s: f64) -> f64 {
        SINK * self.activation(time_s)
    }

    /// Activation of a walk at a time: 0 at its ends, 1 while the feet are raised.
    pub fn activation(&self, time_s: f64) -> f64 {
        let Some((first, last)) = self.bout(time_s) else { return 0.0 };
        let ramp_s = 2.0 * SHIFT_S;
        let (start_s, end_s) = (first.start_s - SHIFT_S, last.start_s + Pair::LENGTH_S + SHIFT_S);
        minimum_jerk((time_s - start_s) / ramp_s) * minimum_jerk((end_s - time_s) / ramp_s)
    }

    /// The uninterrupted walk that contains a time.
    fn bout(&self, time_s: f64) -> Option<(&Pair, &Pair)> {
        let near =
            |pair: &Pair| (pair.start_s - SHIFT_S..pair.start_s + Pair::LENGTH_S + SHIFT_S).contains(&time_s);
        let mut first = self.pairs.iter().position(near)?;
        let mut last = first;
        let follows = |pair: &Pair, next: &Pair| next.start_s - pair.start_s - Pair::LENGTH_S < 2.0 * SHIFT_S;
        while first > 0 && follows(&self.pairs[first - 1], &self.pairs[first]) {
            first -= 1;
        }
        while last + 1 < self.pairs.len() && follows(&self.pairs[last], &self.pairs[last + 1]) {
            last += 1;
        }
        Some((&self.pairs[first], &self.pairs[last]))
    }

    /// Balance point of the centre of mass at a time, m.
    pub fn balance_m(&self, time_s: f64) -> Vector2<f64> {
        let (reach_s, step_s) = FORESIGHT;
        let press = |time_s: f64| self.press_m.at(time_s, Vector2::lerp);
        let walking =
            |pair: &Pair| (pair.start_s - reach_s..pair.start_s + Pair::LENGTH_S + reach_s).contains(&time_s);
        if !self.pairs.iter().any(walking) {
            return press(time_s);
        }
        let count = (reach_s / step_s) as i32;
        let (mut sum, mut total) = (Vector2::zeros(), 0.0);
        for index in -count..=count {
            let ahead_s = f64::from(index) * step_s;
            let weight = (-ahead_s.abs() / self.fall_s).exp();
            sum += press(time_s + ahead_s) * weight;
            total += weight;
        }
        sum / total
    }

    /// Moves the feet of a stance to their places at a time; its polygon stays that of home.
    pub fn place_feet(&self, time_s: f64, stance: &mut Stance) {
        for k in 0..Side::BOTH.len() {
            let (foot, lift_m) = self.foot(time_s, k);
            stance.ankle_m[k] = foot.ankle_m + Vector3::z() * lift_m;
            stance.world_from_foot[k] = foot.world_from_foot;
        }
    }

    /// The feet at a time with their support polygon; a foot in the air is excluded.
    pub fn stance(&self, person: &Person, time_s: f64) -> Stance {
        let feet = [0, 1].map(|k| self.foot(time_s, k));
        let mut stance = self.home.clone();
        self.place_feet(time_s, &mut stance);
        let carries = feet.map(|(_, lift_m)| lift_m == 0.0);
        stance.support_m = Stance::support_of(person, &stance.ankle_m, &stance.world_from_foot, carries);
        stance
    }

    /// A foot at a time, and its lift height.
    fn foot(&self, time_s: f64, k: usize) -> (Foot, f64) {
        let Some(pair) = self.pairs.iter().rfind(|pair| pair.swing_start_s(k) <= time_s) else {
            let place = self.pairs.first().map_or(StandingPosition::HOME, |pair| pair.from);
            return (place.foot(&self.home, k), 0.0);
        };
        let fraction = (time_s - pair.swing_start_s(k)) / SWING_S;
        let (from, to) = (pair.from.foot(&self.home, k), pair.to.foot(&self.home, k));
        if fraction >= 1.0 {
            return (to, 0.0);
        }
        let s = minimum_jerk(fraction);
        // Up and down, at rest at both ends.
        let lift_m = LIFT_M * minimum_jerk(1.0 - (2.0 * fraction - 1.0).abs());
        let turn = (to.world_from_foot * from.world_from_foot.inverse()).scaled_axis();
        let foot = Foot {
            ankle_m: from.ankle_m + (to.ankle_m - from.ankle_m) * s,
            world_from_foot: UnitQuaternion::from_scaled_axis(turn * s) * from.world_from_foot,
        };
        (foot, lift_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::{Habits, Worker};

    const AROUND: [(f64, StandingPosition); 4] = [
        (1.0, StandingPosition { middle_m: Vector2::new(0.05, -0.04), heading_rad: 0.6 }),
        (9.0, StandingPosition { middle_m: Vector2::new(-0.05, 0.05), heading_rad: -0.7 }),
        (18.0, StandingPosition { middle_m: Vector2::new(-0.02, 0.02), heading_rad: 0.87 }),
        (26.0, StandingPosition { middle_m: Vector2::new(0.18, 0.02), heading_rad: 0.87 }),
    ];

    #[test]
    fn the_weight_stays_on_what_stands_and_a_standing_foot_does_not_move() {
        for (height_m, mass_kg) in [(1.58, 52.0), (1.77, 72.0), (1.93, 100.0)] {
            let mut worker = Worker::with_habits(Person::new(3, height_m, mass_kg), 3, Habits::ORDINARY);
            for (at_s, place) in AROUND {
                worker.go(at_s, place);
            }
            let (mut in_the_air, mut least_m) = (0, f64::INFINITY);
            for step in 0..1600 {
                let time_s = 0.02 * f64::from(step);
                let (before, stance) = (worker.stance_at(time_s - 0.02), worker.stance_at(time_s));
                let margin_m = stance.margin_m(worker.ground_reaction(time_s).cop_m());
                least_m = least_m.min(margin_m);
                assert!(margin_m > 0.0, "{height_m} m at {time_s} s: {margin_m} m outside");
                let body = worker.sample(time_s);
                for (k, side) in Side::BOTH.into_iter().enumerate() {
                    let ankle_m = body.origin_m[side.foot().index()];
                    assert!((ankle_m - stance.ankle_m[k]).norm() < 1e-3, "{time_s} s: foot {k} out of reach");
                    let moved_m = (stance.ankle_m[k] - before.ankle_m[k]).norm();
                    let on_floor = [&before, &stance]
                        .iter()
                        .all(|stance| stance.ankle_m[k].z <= worker.person().ankle_height_m);
                    in_the_air += usize::from(!on_floor);
                    assert!(!on_floor || moved_m < 1e-12, "{time_s} s: foot {k} slid by {moved_m} m");
                }
            }
            assert!(in_the_air > 200, "{in_the_air}");
            let there = worker.stance_at(40.0);
            assert!((there.between_the_feet_m(0.0) - AROUND[3].1.middle_m).norm() < 1e-12);
        }
    }

    #[test]
    fn nothing_jumps() {
        let mut worker = Worker::with_habits(Person::new(4, 1.77, 72.0), 4, Habits::NONE);
        worker.go(1.0, AROUND[0].1);
        let h = 1e-3;
        for step in 0..600 {
            let time_s = 0.01 * f64::from(step);
            let head = |t: f64| worker.sample(t).origin_m[6];
            let acceleration = (head(time_s + h) - head(time_s) * 2.0 + head(time_s - h)) / (h * h);
            assert!(acceleration.norm() < 12.0, "{time_s} s: {acceleration:?}");
        }
    }
}
