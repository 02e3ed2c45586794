//! Requirement of the pose library: every human can take each of its poses in balance.

use equipoise_core::body::{Segment, Side};
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_simulator::balance::Standing;
use equipoise_simulator::kinematics::{centre_m, coms_m, origins_m};
use equipoise_simulator::limits;
use equipoise_simulator::person::Person;
use equipoise_simulator::pose::Pose;
use equipoise_simulator::stance::Stance;
use nalgebra::Vector3;

/// Whole degrees in the hip, knee and ankle add up.
const FLAT_DEG: f64 = 3.0;
const MARGIN_M: f64 = 0.04;

#[test]
fn names_are_many_and_all_different() {
    assert!(LIBRARY.len() >= 45, "{}", LIBRARY.len());
    assert_eq!(LIBRARY[0].name, "stand straight, arms down");
    for (index, posture) in LIBRARY.iter().enumerate() {
        assert!(LIBRARY[..index].iter().all(|other| other.name != posture.name), "{}", posture.name);
    }
}

#[test]
fn as_written_the_feet_are_flat_and_the_body_is_in_balance_over_them() {
    let person = Person::nominal(1.75, 72.0);
    let stance = Stance::shoulder_wide(&person);
    for posture in LIBRARY {
        let rotation = posture.world_from_segment();
        let origin = origins_m(&person, Vector3::zeros(), &rotation);
        let ankles = Side::BOTH.map(|side| origin[side.foot().index()]);
        for (side, ankle) in Side::BOTH.into_iter().zip(ankles) {
            let up = rotation[side.foot().index()] * Vector3::z();
            assert!(up.z.acos().to_degrees() < FLAT_DEG, "{}: {side:?} foot is not flat", posture.name);
            assert!((ankle.z - 0.5 * (ankles[0].z + ankles[1].z)).abs() < 0.015, "{}", posture.name);
        }
        let com = centre_m(&person.segment_mass_kg, &coms_m(&person.com_m, &origin, &rotation));
        let from_ankles = com - (ankles[0] + ankles[1]) * 0.5;
        let margin = stance.margin_m(stance.between_the_feet_m(0.0) + from_ankles.xy());
        assert!(margin > MARGIN_M, "{}: {margin} m", posture.name);
    }
}

#[test]
fn people_unlike_the_average_can_take_every_pose_too() {
    for (seed, height_m) in [(1, 1.56), (2, 1.70), (3, 1.93)] {
        let person = Person::new(seed, height_m, 25.0 * height_m * height_m);
        let stance = Stance::shoulder_wide(&person);
        let standing = Standing { person: &person, com_m: &person.com_m, stance: &stance, load_kg: 0.0 };
        let target = stance.between_the_feet_m(0.025 * height_m);
        for posture in LIBRARY {
            let body = standing.balance(&Pose::of_posture(posture, &person), target);
            assert_eq!(limits::check(&body), Ok(()), "{}", posture.name);
            let com = centre_m(&person.segment_mass_kg, &body.com_m);
            assert!(stance.margin_m(com.xy()) > MARGIN_M, "{}", posture.name);
            assert!(body.origin_m[Segment::Pelvis.index()].z > 0.4, "{}", posture.name);
        }
    }
}
