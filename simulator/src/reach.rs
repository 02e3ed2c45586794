//! Reaching for a part with both hands: the posture that a person takes, by that person's own habits.
//!
//! Rules, not an optimum: the hands are brought to the part with arms as far extended as the person likes; what is
//! missing in height is made up by knees and trunk in the person's own proportion, what is missing in distance by the
//! trunk. The feet stay, and the pelvis balances the whole body with the part ([`crate::balance`]). The hands follow the
//! slope of the handles as far as the wrists move.

use equipoise_core::body::{Segment, Side};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use crate::GRAVITY_M_PER_S2;
use crate::balance::{Balanced, Standing, grips_m};
use crate::feet::FeetDivision;
use crate::intention::Intention;
use crate::kinematics::down_the_tree;
use crate::motion::{BodyState, Habits};
use crate::person::Person;
use crate::pose::Pose;
use crate::random::Random;

/// How a person reaches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReachHabits {
    /// Fraction of a missing height that the knees make up, in [0, 1]; the trunk makes up the rest.
    pub by_knees: f64,
    /// Extension of the arms beyond which the trunk helps, as a fraction of their length.
    pub extension: f64,
    /// Fraction of the trunk's inclination that is bend of the spine; the rest is tilt of the pelvis.
    pub by_spine: f64,
    /// Rotation of the elbows outwards about the line from shoulder to hand, degrees.
    pub elbow_out_deg: f64,
    /// Distance of the centre of mass ahead of the ankles, m.
    pub balance_ahead_m: f64,
    /// Slope of the hands minus that of the handles, degrees.
    pub slope_more_deg: f64,
}

impl ReachHabits {
    /// The habits of a person: from stooping to squatting, from bent to extended arms.
    pub fn of(seed: u64) -> ReachHabits {
        let mut random = Random::new(seed, "reach");
        ReachHabits {
            by_knees: random.between(0.1, 0.9),
            extension: random.between(0.6, 0.9),
            by_spine: random.between(0.35, 0.75),
            elbow_out_deg: random.between(5.0, 35.0),
            balance_ahead_m: random.between(0.03, 0.06),
            slope_more_deg: random.between(-10.0, 10.0),
        }
    }
}

/// Largest inclination of the trunk that the search tries, and its step, degrees.
const INCLINATION_MAX_DEG: u32 = 90;
const INCLINATION_STEP_DEG: usize = 2;
/// Hands below the shoulders by this fraction of the arm's length are comfortable.
const COMFORTABLE_BELOW: f64 = 0.75;
/// The most that arms are extended if the trunk does not suffice, as a fraction of their length.
const EXTENSION_MAX: f64 = 0.98;
/// Fraction of the angle to a part at the side of the person by which the trunk twists, and its largest twist, degrees.
const TWIST_FRACTION: f64 = 0.5;
const TWIST_MAX_DEG: f64 = 35.0;
/// Pelvis and arms move each other, so both are computed again until the hands are this close, m.
const TOLERANCE_M: f64 = 1e-4;
const ITERATIONS_MAX: usize = 60;
/// Corrections of an arm's aim: each leaves a small fraction of the miss.
const AIMS: usize = 8;

/// Range of the wrist in the plane of the palm, toward the thumb and toward the little finger, degrees (American Academy
/// of Orthopaedic Surgeons, Joint Motion, 1965).
const WRIST_DEG: [f64; 2] = [-20.0, 30.0];

/// A part to hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeldPart {
    /// Middle between the grips, m.
    pub middle_m: Vector3<f64>,
    /// Distance between the grips, m.
    pub width_m: f64,
    /// Unit vector from the right to the left grip, horizontal: to the left of the person.
    pub aside: Vector3<f64>,
    /// Slope of the handles: how far hands that follow them point below the horizontal, rad. `None`: handles that turn
    /// with the hands, which are then in line with the forearms.
    pub slope_rad: Option<f64>,
}

/// Slope of the hands on a level box, whose centre was measured ahead of the knuckles ([`crate::realism`]): 45°.
pub const LEVEL_RAD: f64 = std::f64::consts::FRAC_PI_4;

impl HeldPart {
    /// Inclination of the line from the grips to the part's centre below the horizontal, rad: the part turns with its
    /// handles.
    pub fn load_down_rad(&self) -> f64 {
        self.slope_rad.map_or(0.0, |slope_rad| slope_rad - LEVEL_RAD)
    }
}

/// A horizontal unit vector, inclined below the horizontal by this angle, rad.
pub(crate) fn inclined(ahead: Vector3<f64>, down_rad: f64) -> Vector3<f64> {
    ahead * down_rad.cos() - Vector3::z() * down_rad.sin()
}

/// The posture in which a person holds a part, and its pose; `None` if the part is out of reach.
pub fn reach(standing: &Standing<'_>, habits: &ReachHabits, place: &HeldPart) -> Option<(Pose, Balanced)> {
    let arm_m: f64 = arm_m(standing.person).iter().sum();
    let reaching = Reaching { standing, habits, place };
    let upright = reaching.with_trunk(0.0, 0.0, 1)?;
    let below_m = shoulders_m(&upright.1).z - place.middle_m.z - COMFORTABLE_BELOW * arm_m;
    let drop = habits.by_knees * below_m.max(0.0) / upright.1.pelvis_m.z;
    // The least inclination with which the arms need not be extended farther than the person likes, or at all.
    let first_within = |extension: f64| {
        (0..=INCLINATION_MAX_DEG).step_by(INCLINATION_STEP_DEG).map(f64::from).find(|inclination_deg| {
            let body = reaching.with_trunk(*inclination_deg, drop, 6).map(|(_, body)| body);
            body.is_some_and(|body| (place.middle_m - shoulders_m(&body)).norm() < extension * arm_m)
        })
    };
    let inclination_deg = first_within(habits.extension).or_else(|| first_within(EXTENSION_MAX))?;
    let (pose, body) = reaching.with_trunk(inclination_deg, drop, ITERATIONS_MAX)?;
    (reaching.miss_m(&body) < TOLERANCE_M && body.out_of_reach_m < TOLERANCE_M).then_some((pose, body))
}

/// The middle between the shoulders, m.
fn shoulders_m(body: &Balanced) -> Vector3<f64> {
    let [left, right] = [Segment::LeftUpperArm, Segment::RightUpperArm].map(|s| body.origin_m[s.index()]);
    0.5 * (left + right)
}

struct Reaching<'a> {
    standing: &'a Standing<'a>,
    habits: &'a ReachHabits,
    place: &'a HeldPart,
}

impl Reaching<'_> {
    /// Where the left and right grip are wanted, m.
    fn wanted_m(&self) -> [Vector3<f64>; 2] {
        let half = self.place.aside * (0.5 * self.place.width_m);
        [self.place.middle_m + half, self.place.middle_m - half]
    }

    /// Distance of the farther hand from there, m.
    fn miss_m(&self, body: &Balanced) -> f64 {
        let grips = grips_m(self.standing.person, &body.origin_m, &body.world_from_segment);
        let wanted = self.wanted_m();
        (grips[0] - wanted[0]).norm().max((grips[1] - wanted[1]).norm())
    }

    /// The posture with this inclination of the trunk and lowering of the pelvis, with the arms towards the part.
    fn with_trunk(&self, inclination_deg: f64, drop: f64, iterations: usize) -> Option<(Pose, Balanced)> {
        let HeldPart { middle_m, aside, .. } = *self.place;
        let above = self.standing.stance.between_the_feet_m(self.habits.balance_ahead_m);
        let ahead = Vector3::new(aside.y, -aside.x, 0.0);
        let from_feet = middle_m - above.push(0.0);
        let aim_deg = from_feet.dot(&aside).atan2(from_feet.dot(&ahead).max(0.2)).to_degrees();
        let twist_deg = (TWIST_FRACTION * aim_deg).clamp(-TWIST_MAX_DEG, TWIST_MAX_DEG);
        let spine_deg = inclination_deg * self.habits.by_spine;
        let intention = Intention {
            pelvis_drop: drop,
            pelvis_deg: [inclination_deg - spine_deg, 0.0, 0.0],
            trunk_flex_deg: spine_deg,
            trunk_twist_deg: twist_deg,
            ..Intention::STAND
        };
        let mut pose = intention.pose();
        let mut body = self.standing.balance(&pose, above);
        for _ in 0..iterations {
            bend_arms(
                &mut pose,
                self.standing.person,
                self.habits,
                &body,
                self.wanted_m(),
                self.place.slope_rad,
            );
            body = self.standing.balance(&pose, above);
            if self.miss_m(&body) < TOLERANCE_M {
                break;
            }
        }
        body.pelvis_m.iter().all(|metres| metres.is_finite()).then_some((pose, body))
    }
}

/// Length of the upper arm, and from the elbow to the grip, m.
fn arm_m(person: &Person) -> [f64; 2] {
    let hand = Segment::LeftHand.index();
    let to_grip = person.offset_m[hand] + person.grip_m[0];
    [person.offset_m[hand - 1].norm(), to_grip.norm()]
}

/// Bends both arms so that the grips are at `target`, given where the shoulders are.
fn bend_arms(
    pose: &mut Pose,
    person: &Person,
    habits: &ReachHabits,
    body: &Balanced,
    target: [Vector3<f64>; 2],
    slope_rad: Option<f64>,
) {
    let world_from = down_the_tree(&pose.parent_from_segment);
    for (k, side) in Side::BOTH.into_iter().enumerate() {
        let hand = side.hand().index();
        let (shoulder, upper_arm, forearm) = (hand - 3, hand - 2, hand - 1);
        let sign = if side == Side::Left { 1.0 } else { -1.0 };
        let upper_m = person.offset_m[forearm].norm();
        let to_target = target[k] - body.origin_m[upper_arm];
        // The palm's normal is the Z axis of the hand; the thumb is above.
        let wrist = |down_rad: f64| UnitQuaternion::from_scaled_axis(Vector3::z() * (sign * down_rad));
        let to_grip = |down_rad: f64| person.offset_m[hand] + wrist(down_rad) * person.grip_m[k];
        let down_rad_at = |world_from_lower: UnitQuaternion<f64>| {
            let Some(slope_rad) = slope_rad else { return 0.0 };
            let forearm_rad = -(world_from_lower * Vector3::new(0.0, sign, 0.0)).z.clamp(-1.0, 1.0).asin();
            let [up_rad, down_rad] = WRIST_DEG.map(f64::to_radians);
            (slope_rad + habits.slope_more_deg.to_radians() - forearm_rad).clamp(up_rad, down_rad)
        };
        let rotations = |reach: Vector3<f64>, lower_m: f64| {
            let length_m = reach.norm().clamp((upper_m - lower_m).abs() + 1e-3, upper_m + lower_m - 1e-4);
            let along = reach.normalize();
            // The elbow hangs below the line from shoulder to hand, rotated outwards about it.
            let down = -Vector3::z();
            let hanging = (down - along * down.dot(&along)).try_normalize(1e-6).unwrap_or(-Vector3::x());
            let out = UnitQuaternion::from_axis_angle(
                &nalgebra::Unit::new_normalize(along),
                sign * habits.elbow_out_deg.to_radians(),
            );
            let elbow_side = out * hanging;
            let cosine =
                (upper_m * upper_m + length_m * length_m - lower_m * lower_m) / (2.0 * upper_m * length_m);
            let angle = cosine.clamp(-1.0, 1.0).acos();
            let upper = along * angle.cos() + elbow_side * angle.sin();
            let lower = (along * length_m - upper * upper_m).normalize();
            // T-pose: the arm points along ±Y; its Z axis is that of the elbow, about which the forearm bends forward.
            let axis = (upper.cross(&lower) * -sign).try_normalize(1e-9).unwrap_or(elbow_side.cross(&upper));
            let world_from_arm = |direction: Vector3<f64>| {
                let y = direction * sign;
                let axes = Matrix3::from_columns(&[y.cross(&axis), y, axis]);
                UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
            };
            (world_from_arm(upper), world_from_arm(lower))
        };
        // A grip off the forearm's axis misses the target by its offset: the arm aims as far to the other side.
        let mut aim = to_target;
        let mut down_rad = sign * pose.parent_from_segment[hand].scaled_axis().z;
        let (mut world_from_upper, mut world_from_lower) = rotations(aim, to_grip(down_rad).norm());
        for _ in 0..AIMS {
            // Half steps, because the forearm's direction and the wrist's angle depend on each other.
            down_rad = 0.5 * (down_rad + down_rad_at(world_from_lower));
            let reached = world_from_upper * person.offset_m[forearm] + world_from_lower * to_grip(down_rad);
            aim += to_target - reached;
            (world_from_upper, world_from_lower) = rotations(aim, to_grip(down_rad).norm());
        }
        pose.parent_from_segment[upper_arm] = world_from[shoulder].inverse() * world_from_upper;
        pose.parent_from_segment[forearm] = world_from_upper.inverse() * world_from_lower;
        pose.parent_from_segment[hand] = wrist(down_rad);
    }
}

/// How a person who holds a part touches it and the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contacts {
    /// See [`Habits::right_hand_fraction`].
    pub right_hand_fraction: f64,
    /// See [`Habits::load_ahead_m`].
    pub load_ahead_m: f64,
    /// See [`Habits::squeeze_ratio`].
    pub squeeze_ratio: f64,
    /// The feet at this time.
    pub feet: FeetDivision,
}

impl Contacts {
    /// Contacts of a person with these habits, whose feet divide the ground reaction in this way.
    pub fn of(habits: &Habits, feet: FeetDivision) -> Contacts {
        let &Habits { right_hand_fraction, load_ahead_m, squeeze_ratio, .. } = habits;
        Contacts { right_hand_fraction, load_ahead_m, squeeze_ratio, feet }
    }
}

/// The state of a body that holds a part at rest in a posture. The grips are those of the person ([`Person::grip_m`]).
pub fn at_rest(standing: &Standing<'_>, body: &Balanced, part: &HeldPart, contacts: &Contacts) -> BodyState {
    let grip_m = grips_m(standing.person, &body.origin_m, &body.world_from_segment);
    let apart = (grip_m[0] - grip_m[1]).try_normalize(1e-6).unwrap_or_else(Vector3::zeros);
    let ahead = part.aside.cross(&Vector3::z());
    BodyState {
        time_s: 0.0,
        origin_m: body.origin_m,
        world_from_segment: body.world_from_segment,
        com_m: body.com_m,
        grip_m,
        load_kg: standing.load_kg,
        right_hand_fraction: contacts.right_hand_fraction,
        load_ahead_m: inclined(ahead, part.load_down_rad()) * contacts.load_ahead_m,
        squeeze_n: apart * (contacts.squeeze_ratio * standing.load_kg * GRAVITY_M_PER_S2),
        feet: contacts.feet,
        foot_stands: [true; 2],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits;
    use crate::realism::Realism;
    use crate::stance::Stance;

    #[test]
    fn hands_are_at_the_part_and_the_posture_is_human() {
        let mut reached = 0;
        for seed in 0..20 {
            let person = Person::new(seed, 1.6 + 0.015 * seed as f64, 55.0 + 2.0 * seed as f64);
            let stance = Stance::shoulder_wide(&person);
            let standing = Standing { person: &person, com_m: &person.com_m, stance: &stance, load_kg: 6.0 };
            let habits = ReachHabits::of(seed);
            for (x, y, z) in
                [(0.35, 0.0, 1.1), (0.5, 0.1, 0.9), (0.35, -0.15, 1.4), (0.4, 0.0, 0.6), (0.3, 0.0, 0.75)]
            {
                let middle_m = Vector3::new(x, y, z);
                let Some((_, body)) = reach(
                    &standing,
                    &habits,
                    &HeldPart { middle_m, width_m: 0.35, aside: Vector3::y(), slope_rad: None },
                ) else {
                    continue;
                };
                reached += 1;
                let [left, right] = grips_m(&person, &body.origin_m, &body.world_from_segment);
                assert!((0.5 * (left + right) - middle_m).norm() < 1e-3, "{seed} {x} {y} {z}");
                assert!(((left - right) - Vector3::y() * 0.35).norm() < 1e-3, "{seed} {x} {y} {z}");
                assert_eq!(limits::check(&body), Ok(()), "seed {seed}, {x} {y} {z}");
                let [body_kg, load_kg] = [person.mass_kg, standing.load_kg];
                let com_m = crate::kinematics::centre_m(&person.segment_mass_kg, &body.com_m);
                let centre_m = (com_m * body_kg + middle_m * load_kg) / (body_kg + load_kg);
                assert!(stance.margin_m(centre_m.xy()) > 0.0, "{seed} {x} {y} {z}");
            }
        }
        assert!(reached > 90, "{reached} of 100");
    }

    #[test]
    fn hands_follow_sloped_handles_as_far_as_the_wrists_move() {
        let person = Person::nominal(1.77, 72.0);
        let stance = Stance::shoulder_wide(&person);
        let standing = Standing { person: &person, com_m: &person.com_m, stance: &stance, load_kg: 6.0 };
        let habits = ReachHabits { slope_more_deg: 0.0, ..ReachHabits::of(3) };
        let slopes_deg = |slope_rad: Option<f64>| {
            let place = HeldPart {
                middle_m: Vector3::new(0.4, 0.0, 1.0),
                width_m: 0.35,
                aside: Vector3::y(),
                slope_rad,
            };
            let (_, body) = reach(&standing, &habits, &place).unwrap();
            let grips = grips_m(&person, &body.origin_m, &body.world_from_segment);
            assert!((0.5 * (grips[0] + grips[1]) - place.middle_m).norm() < 1e-3, "{slope_rad:?}");
            [Segment::LeftForearm, Segment::LeftHand].map(|segment| {
                let along = body.world_from_segment[segment.index()] * Vector3::y();
                (-along.z).asin().to_degrees()
            })
        };
        let [forearm_deg, hand_deg] = slopes_deg(None);
        assert!((forearm_deg - hand_deg).abs() < 1e-9);
        let [_, hand_deg] = slopes_deg(Some(20_f64.to_radians()));
        assert!((hand_deg - 20.0).abs() < 3.0, "{hand_deg}");
        let [forearm_deg, hand_deg] = slopes_deg(Some(80_f64.to_radians()));
        assert!((hand_deg - forearm_deg - WRIST_DEG[1]).abs() < 5.0, "{forearm_deg} {hand_deg}");
    }

    #[test]
    fn a_part_at_rest_has_the_contacts_of_its_holder() {
        let person = Person::nominal(1.77, 72.0);
        let stance = Stance::shoulder_wide(&person);
        let standing = Standing { person: &person, com_m: &person.com_m, stance: &stance, load_kg: 6.0 };
        let middle_m = Vector3::new(0.4, 0.0, 1.0);
        let part = HeldPart { middle_m, width_m: 0.35, aside: Vector3::y(), slope_rad: Some(LEVEL_RAD) };
        let (_, body) = reach(&standing, &ReachHabits::of(3), &part).unwrap();
        let habits = Realism::SEVERE.habits(3);
        let feet = FeetDivision { ahead_m: 0.02, ..FeetDivision::EVEN };
        let state = at_rest(&standing, &body, &part, &Contacts::of(&habits, feet));
        assert_eq!((state.right_hand_fraction, state.feet), (habits.right_hand_fraction, feet));
        assert!(habits.load_ahead_m > 0.04 && (state.right_hand_fraction - 0.5).abs() > 0.01, "{habits:?}");
        assert!((state.load_ahead_m - Vector3::x() * habits.load_ahead_m).norm() < 1e-12);
        assert!((state.squeeze_n.norm() - habits.squeeze_ratio * 6.0 * GRAVITY_M_PER_S2).abs() < 1e-9);
    }

    #[test]
    fn places_out_of_reach_are_refused() {
        let person = Person::nominal(1.77, 72.0);
        let stance = Stance::shoulder_wide(&person);
        let standing = Standing { person: &person, com_m: &person.com_m, stance: &stance, load_kg: 6.0 };
        for middle_m in [Vector3::new(1.8, 0.0, 1.0), Vector3::new(0.3, 0.0, 2.9)] {
            let place = HeldPart { middle_m, width_m: 0.35, aside: Vector3::y(), slope_rad: None };
            assert!(reach(&standing, &ReachHabits::of(3), &place).is_none());
        }
    }
}
