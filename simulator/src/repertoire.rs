//! The repertoire of poses: about fifty intentions that a healthy adult can hold for some seconds.
//!
//! Chosen to rotate every group of segments against the others: arms in all directions, one or both, elbows bent, trunk
//! and pelvis in three directions, head, legs from straight to a deep squat, and combinations of these.

use crate::intention::{Arm, Intention};

const fn arm(elevation_deg: f64, forward_deg: f64, outward_deg: f64, elbow_deg: f64) -> Arm {
    Arm { elevation_deg, forward_deg, outward_deg, elbow_deg }
}

const SIDE: Arm = arm(90.0, 0.0, 0.0, 0.0);
const FRONT: Arm = arm(90.0, 90.0, 60.0, 5.0);
const UP: Arm = arm(165.0, 20.0, 0.0, 5.0);
const DIAGONAL: Arm = arm(125.0, 45.0, 20.0, 5.0);
const LOW_FRONT: Arm = arm(45.0, 90.0, 60.0, 5.0);
const BENT: Arm = arm(10.0, 0.0, 0.0, 95.0);
const BENT_SIDE: Arm = arm(85.0, 0.0, 80.0, 95.0);
const BENT_FRONT: Arm = arm(85.0, 80.0, 90.0, 95.0);
const ACROSS: Arm = arm(75.0, 75.0, 0.0, 70.0);
const BACK: Arm = arm(35.0, -80.0, 0.0, 10.0);

const S: Intention = Intention::STAND;

const fn squat(drop: f64, tilt_deg: f64) -> Intention {
    Intention { pelvis_drop: drop, pelvis_deg: [tilt_deg, 0.0, 0.0], ..S }
}

const fn lean(pelvis_deg: f64, trunk_deg: f64) -> Intention {
    Intention { pelvis_deg: [pelvis_deg, 0.0, 0.0], trunk_flex_deg: trunk_deg, ..S }
}

const SHALLOW: Intention = squat(0.15, 20.0);
const DEEP: Intention = squat(0.32, 35.0);
const LEAN_30: Intention = lean(12.0, 20.0);
const LEAN_60: Intention = lean(30.0, 32.0);
const BEND_RIGHT: Intention = Intention { trunk_side_deg: 25.0, ..S };
const BEND_LEFT: Intention = Intention { trunk_side_deg: -25.0, ..S };
const TWIST_LEFT: Intention = Intention { pelvis_deg: [0.0, 0.0, 12.0], trunk_twist_deg: 30.0, ..S };
const TWIST_RIGHT: Intention = Intention { pelvis_deg: [0.0, 0.0, -12.0], trunk_twist_deg: -30.0, ..S };

const fn left(base: Intention, left_arm: Arm) -> Intention {
    Intention { left_arm, ..base }
}

const fn right(base: Intention, right_arm: Arm) -> Intention {
    Intention { right_arm, ..base }
}

/// Instruction for the worker, and its intention. The first is the start pose.
pub const REPERTOIRE: &[(&str, Intention)] = &[
    ("stand straight, arms down", S),
    ("T-pose, both arms out to the sides", S.arms(SIDE)),
    ("both arms forward", S.arms(FRONT)),
    ("both arms up", S.arms(UP)),
    ("left arm forward", left(S, FRONT)),
    ("right arm forward", right(S, FRONT)),
    ("left arm out to the side", left(S, SIDE)),
    ("right arm out to the side", right(S, SIDE)),
    ("left arm up", left(S, UP)),
    ("right arm up", right(S, UP)),
    ("both arms up and out, like a Y", S.arms(DIAGONAL)),
    ("both arms half raised in front", S.arms(LOW_FRONT)),
    ("elbows bent at the sides, hands in front", S.arms(BENT)),
    ("arms out, elbows bent, hands up", S.arms(BENT_SIDE)),
    ("upper arms forward, hands up", S.arms(BENT_FRONT)),
    ("both arms back", S.arms(BACK)),
    ("left arm forward, right arm to the side", right(left(S, FRONT), SIDE)),
    ("right arm forward, left arm up", left(right(S, FRONT), UP)),
    ("left arm across the chest", left(S, ACROSS)),
    ("right arm across the chest", right(S, ACROSS)),
    ("lean forward, arms down", LEAN_30),
    ("lean forward, arms forward", LEAN_30.arms(FRONT)),
    ("lean forward, right arm up", right(LEAN_30, UP)),
    ("lean forward, left arm out to the side", left(LEAN_30, SIDE)),
    ("lean far forward, arms hanging in front", LEAN_60.arms(LOW_FRONT)),
    ("lean far forward, arms out to the sides", LEAN_60.arms(SIDE)),
    ("lean far forward, arms back", LEAN_60.arms(BACK)),
    ("tilt at the hips, back straight", lean(40.0, 0.0)),
    ("round the back, elbows bent", lean(0.0, 40.0).arms(BENT)),
    ("lean back a little, arms forward", lean(-8.0, -12.0).arms(FRONT)),
    ("bend to the right", BEND_RIGHT),
    ("bend to the left", BEND_LEFT),
    ("bend to the right, left arm up", left(BEND_RIGHT, UP)),
    ("bend to the left, right arm up", right(BEND_LEFT, UP)),
    ("twist to the left, arms out to the sides", TWIST_LEFT.arms(SIDE)),
    ("twist to the right, arms forward", TWIST_RIGHT.arms(FRONT)),
    ("twist to the left, right arm forward", right(TWIST_LEFT, FRONT)),
    ("half squat, arms down", SHALLOW),
    ("half squat, arms forward", SHALLOW.arms(FRONT)),
    ("half squat, arms up", SHALLOW.arms(UP)),
    ("half squat, left arm to the side", left(SHALLOW, SIDE)),
    ("deep squat, arms forward", DEEP.arms(FRONT)),
    ("deep squat, elbows bent", DEEP.arms(BENT)),
    ("deep squat, right arm forward, left arm to the side", right(left(DEEP, SIDE), FRONT)),
    ("half squat, back upright, arms back", squat(0.12, 0.0).arms(BACK)),
    (
        "half squat, twist to the right, left arm up",
        Intention { pelvis_deg: [20.0, 0.0, -8.0], trunk_twist_deg: -25.0, left_arm: UP, ..SHALLOW },
    ),
    (
        "weight forward, head turned to the left, right arm forward",
        Intention { head_deg: [0.0, 0.0, 50.0], right_arm: FRONT, pelvis_deg: [8.0, 0.0, 0.0], ..S },
    ),
    ("look down, arms half raised", Intention { head_deg: [35.0, 0.0, 0.0], ..S.arms(LOW_FRONT) }),
    ("look up, arms up and out", Intention { head_deg: [-30.0, 0.0, 0.0], ..S.arms(DIAGONAL) }),
    (
        "hips to the side, left arm out",
        Intention {
            pelvis_drop: 0.06,
            pelvis_deg: [0.0, -10.0, 0.0],
            trunk_side_deg: 12.0,
            left_arm: SIDE,
            ..S
        },
    ),
];

/// Arms in front with a box that is low, close, stretched out, and raised.
pub const BOX_LOW: Arm = arm(50.0, 85.0, 63.0, 25.0);
const BOX_CLOSE: Arm = arm(20.0, 80.0, 76.0, 85.0);
const BOX_STRETCHED: Arm = arm(75.0, 85.0, 42.0, 15.0);
const BOX_RAISED: Arm = arm(125.0, 85.0, 65.0, 20.0);

/// Arms with a box from close (0) to stretched out (1): the more the elbow is bent, the more the arm is rotated outwards.
pub fn box_in_front(stretched: f64) -> Arm {
    let between = |close: f64, far: f64| close + stretched * (far - close);
    arm(
        between(BOX_CLOSE.elevation_deg, BOX_STRETCHED.elevation_deg),
        between(BOX_CLOSE.forward_deg, BOX_STRETCHED.forward_deg),
        between(BOX_CLOSE.outward_deg, BOX_STRETCHED.outward_deg),
        between(BOX_CLOSE.elbow_deg, BOX_STRETCHED.elbow_deg),
    )
}

/// A box lifted from a table: reach for it, hold it close, stretch it out, raise it, set it back.
pub const LIFTING: [Intention; 5] = {
    let reach = Intention { pelvis_drop: 0.04, ..lean(15.0, 15.0).at_box(BOX_LOW) };
    [reach, S.at_box(BOX_CLOSE), S.at_box(BOX_STRETCHED), S.at_box(BOX_RAISED), reach]
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::balance::{Standing, grips_m};
    use crate::limits;
    use crate::person::Person;
    use crate::stance::Stance;

    #[test]
    fn people_of_all_statures_can_take_every_pose() {
        for (height_m, mass_kg) in [(1.55, 50.0), (1.77, 72.0), (1.95, 105.0)] {
            let person = Person::nominal(height_m, mass_kg);
            let stance = Stance::shoulder_wide(&person);
            let standing = Standing { person: &person, com_m: &person.com_m, stance: &stance, load_kg: 0.0 };
            let target = stance.between_the_feet_m(0.025 * height_m);
            for (name, intention) in REPERTOIRE {
                let body = standing.balance(&intention.pose(), target);
                assert_eq!(limits::check(&body), Ok(()), "{name}, {height_m} m");
            }
        }
    }

    #[test]
    fn hands_hold_a_box_as_wide_as_boxes_are() {
        for (height_m, mass_kg) in [(1.60, 50.0), (1.77, 72.0), (1.95, 105.0)] {
            let person = Person::nominal(height_m, mass_kg);
            let stance = Stance::shoulder_wide(&person);
            let standing = Standing { person: &person, com_m: &person.com_m, stance: &stance, load_kg: 0.0 };
            for intention in LIFTING {
                let body = standing.balance(&intention.pose(), stance.between_the_feet_m(0.025 * height_m));
                let [left, right] = grips_m(&person, &body.origin_m, &body.world_from_segment);
                let apart_m = (left - right).norm();
                assert!((0.30..0.45).contains(&apart_m), "{apart_m} m apart, {height_m} m, {intention:?}");
            }
        }
    }
}
