//! Distribution of the load between the hands and of the ground reaction between the feet.

use super::*;
use crate::body::Segment;
use crate::message::GroundDevice;
use crate::message::state::SharingSource;

/// Both forearms forward, so that the hands are well apart and away from the trunk.
fn carrying() -> Posture {
    stand(10, 0, [0, 0, -80], [0, 0, 80], 10)
}

fn identified() -> (Person, Bench) {
    (Person::real(), Bench::identified())
}

fn grips(person: &Person) -> [Vector3<f64>; 2] {
    grips_in(person, &carrying())
}

fn grips_in(person: &Person, posture: &Posture) -> [Vector3<f64>; 2] {
    let pose = person.pose(posture);
    Side::BOTH.map(|side| pose.point_on(side.hand(), person.body.grip_m(side.hand())))
}

/// 1-σ of the load's position by the values of the state, m.
fn position_sigma_m(state: &State) -> f64 {
    let weight_n = state.ground_force_n[2] - state.delta_f_n[2];
    state.cop_sigma_m.iter().copied().fold(0.0, f64::max) * weight_n / state.delta_f_n[2].abs()
}

#[test]
fn a_load_in_one_hand_in_both_or_between_them_is_shared_as_it_is() {
    let (person, mut bench) = identified();
    let [left, right] = grips(&person);
    let apart_m = (left - right).xy().norm();
    for right_fraction in [0.0, 0.25, 0.5, 1.0] {
        for load_kg in [6.0, 12.0] {
            let at = left + right_fraction * (right - left);
            bench.hold(&person, &carrying(), None, 300);
            bench.hold(&person, &carrying(), Some((load_kg, at)), 600);
            let state = bench.state();
            assert!(!state.validity().any_of(Validity::INVALIDATES_TORQUES), "{:?}", state.validity());
            let sigma = position_sigma_m(state) / apart_m;
            let case =
                std::format!("{right_fraction} of {load_kg} kg: {:?} ± {sigma}", state.hand_load_fraction);
            assert!((state.hand_load_fraction[1] - right_fraction).abs() <= 2.0 * sigma, "{case}");
            assert!(sigma < 0.4, "an informative σ: {case}");
            assert!(
                state.load_hand_distance_m <= 2.0 * position_sigma_m(state),
                "{case} {}",
                state.load_hand_distance_m
            );
        }
    }
}

#[test]
fn a_load_in_one_hand_loads_that_arm() {
    let (person, mut bench) = identified();
    // Start at rest: without measured shear, σ after a quick motion includes that of the suit's acceleration.
    bench.hold(&person, &carrying(), None, 1000);
    bench.hold(&person, &carrying(), Some((12.0, grips(&person)[1])), 600);
    let magnitude =
        |name: &str| Vector3::from(bench.state().torque_nm[Joint::named(name).unwrap().index()]).norm();
    assert!(magnitude("RightShoulder") > 4.0 * magnitude("LeftShoulder"));
    assert!(magnitude("RightShoulder") > 20.0);
}

#[test]
fn a_load_is_ahead_of_the_hands_also_if_they_cross() {
    let (person, mut bench) = identified();
    for elbow in [10, 75] {
        let posture = stand(10, 0, [0, 0, -80], [0, 0, 80], elbow);
        let [left, right] = grips_in(&person, &posture);
        assert_eq!(left.y < right.y, elbow == 75, "the hands cross with bent elbows: {left} {right}");
        let middle = 0.5 * (left + right);
        bench.hold(&person, &posture, None, 300);
        bench.hold(&person, &posture, Some((8.0, middle + Vector3::new(0.03, 0.0, 0.0))), 600);
        let state = bench.state();
        assert!(!state.validity().any_of(Validity::INVALIDATES_TORQUES), "{:?}", state.validity());
        let ankles = Side::BOTH.map(|side| person.pose(&posture).origin_of(side.foot()));
        let from_ankles = middle - 0.5 * (ankles[0] + ankles[1]);
        let forward_m = (state.reach_m * state.reach_m - from_ankles.y * from_ankles.y).sqrt();
        let ahead_m = forward_m - from_ankles.x;
        assert!((0.01..0.05).contains(&ahead_m), "{elbow}°: {ahead_m} m ahead");
    }
}

#[test]
fn a_load_farther_from_the_hands_than_all_errors_allow_makes_torques_and_fractions_unsure() {
    let (person, mut bench) = identified();
    let middle = 0.5 * (grips(&person)[0] + grips(&person)[1]);
    let mut sigma_of = |ahead_m: f64| {
        bench.hold(&person, &carrying(), None, 300);
        bench.hold(&person, &carrying(), Some((20.0, middle + Vector3::new(ahead_m, 0.0, 0.0))), 600);
        let state = bench.state();
        assert!(!state.validity().any_of(Validity::INVALIDATES_TORQUES), "{:?}", state.validity());
        [state.torque_sigma_nm[0], state.hand_load_fraction_sigma]
    };
    let (at_hands, far) = (sigma_of(0.03), sigma_of(0.24));
    // 20 kg, 0.24 m from the hands.
    assert!(at_hands[0] < 8.0 && far[0] > 35.0, "{at_hands:?} {far:?}");
    assert!(far[1] > 1.5 * at_hands[1], "{at_hands:?} {far:?}");
}

#[test]
fn a_load_on_the_back_is_not_in_the_hands() {
    let (person, mut bench) = identified();
    let back = person.pose(&carrying()).origin_of(Segment::T8) + Vector3::new(-0.15, 0.0, 0.1);
    bench.hold(&person, &carrying(), Some((12.0, back)), 600);
    let state = bench.state();
    assert!(state.validity().any_of(Validity::LOAD_NOT_AT_HANDS), "{:?}", state.validity());
    assert_eq!(
        (state.torque_nm, state.hand_load_fraction),
        ([[0.0; 3]; 22], [0.0; 2]),
        "no torque is published for it"
    );
    assert!(state.load_hand_distance_m > 0.35, "but its distance: {} m", state.load_hand_distance_m);
    let at = 0.5 * (grips(&person)[0] + grips(&person)[1]);
    bench.hold(&person, &carrying(), Some((12.0, at)), 600);
    assert!(!bench.state().validity().any_of(Validity::LOAD_NOT_AT_HANDS), "and the hands are hands again");
}

#[test]
fn measured_feet_are_published_and_geometry_returns_without_them() {
    let (person, mut bench) = identified();
    let at = 0.5 * (grips(&person)[0] + grips(&person)[1]);
    // Twice, so that all subsequent ones have the same history.
    for _ in 0..2 {
        bench.hold(&person, &carrying(), Some((8.0, at)), 600);
        bench.hold(&person, &carrying(), None, 300);
    }
    bench.hold(&person, &carrying(), Some((8.0, at)), 600);
    let by_geometry = *bench.state();
    assert_eq!(by_geometry.sharing_source, SharingSource::Geometry as u32);

    // The left foot presses with its heel and the inner edge, the right with its ball and the outer edge.
    let pose = person.pose(&carrying());
    let under = |side: Side, x: f64, y: f64| {
        let ankle = pose.origin_of(side.foot());
        [ankle.x + x, ankle.y + y]
    };
    let feet_m = [under(Side::Left, -0.02, -0.02), under(Side::Right, 0.1, -0.02)];
    bench.feet_m = Some(feet_m);
    bench.hold(&person, &carrying(), None, 300);
    bench.hold(&person, &carrying(), Some((8.0, at)), 600);
    let measured = *bench.state();
    let feet = bench.memory.align.alignment.newest_ground().unwrap().feet().unwrap();
    assert_eq!(measured.sharing_source, SharingSource::Measured as u32);
    assert!(
        (measured.foot_load_fraction[0] - feet.fractions()[0]).abs() < 1e-9,
        "{:?} {feet:?}",
        measured.foot_load_fraction
    );
    assert!(
        (measured.foot_load_fraction[0] - by_geometry.foot_load_fraction[0]).abs() > 0.03,
        "{:?}",
        by_geometry.foot_load_fraction
    );
    for joint in Joint::ALL {
        let index = joint.index();
        let change = Vector3::from(measured.torque_nm[index]) - Vector3::from(by_geometry.torque_nm[index]);
        let is_leg = ["Hip", "Knee", "Ankle"].iter().any(|name| joint.name().ends_with(name));
        assert_eq!(change.norm() > 0.1, is_leg, "{}: {change}", joint.name());
    }
    let knee = Joint::named("LeftKnee").unwrap().index();
    assert!(measured.torque_sigma_nm[knee] < by_geometry.torque_sigma_nm[knee], "no assumption, less doubt");

    bench.feet_m = None;
    bench.hold(&person, &carrying(), None, 300);
    bench.hold(&person, &carrying(), Some((8.0, at)), 600);
    assert_eq!(bench.state().sharing_source, SharingSource::Geometry as u32);
    for (again, before) in bench.state().torque_nm.iter().zip(&by_geometry.torque_nm) {
        // Noise estimates updated in between may change the hand load fractions slightly.
        assert!((Vector3::from(*again) - Vector3::from(*before)).norm() < 0.1, "{again:?} {before:?}");
    }
}

#[test]
fn the_fractions_measured_by_insoles_next_to_a_plate_have_the_error_of_the_insoles() {
    let (person, mut bench) = identified();
    let pose = person.pose(&carrying());
    bench.feet_m = Some(Side::BOTH.map(|side| pose.origin_of(side.foot()).xy().into()));
    let at = 0.5 * (grips(&person)[0] + grips(&person)[1]);
    let insole_sigma = bench.settings.insole_force_sigma_n / ((MASS_KG + 8.0) * GRAVITY_M_PER_S2);
    let mut sigma_with = |second: GroundDevice| {
        bench.disturbance.devices = GroundDevice::Plate as u32 | second as u32;
        bench.hold(&person, &carrying(), None, 300);
        bench.hold(&person, &carrying(), Some((8.0, at)), 600);
        assert_eq!(bench.state().sharing_source, SharingSource::Measured as u32);
        bench.state().foot_load_fraction_sigma
    };
    let (insoles, plates) = (sigma_with(GroundDevice::Insoles), sigma_with(GroundDevice::SecondPlate));
    assert!((insoles - insole_sigma).abs() < 0.01 * insole_sigma, "{insoles} {insole_sigma}");
    assert!(plates > 0.0 && plates < 0.5 * insole_sigma, "{plates}");
}

#[test]
fn the_offset_of_the_stance_moves_the_whole_body() {
    let (_, bench) = identified();
    let offset_m = bench.memory.identification.stance_offset_m();
    assert!(offset_m[0].hypot(offset_m[1]) > 1e-5, "there is an offset to apply: {offset_m:?}");
    let state = bench.state();
    let newest = bench.memory.history.since(state.suit_sample_time_ns - 1).next().unwrap();
    for axis in 0..2 {
        let moved_m = state.segment_origin_m[0][axis] - newest.origin_m[0][axis];
        assert!((moved_m - offset_m[axis]).abs() < 1e-9, "{moved_m} {offset_m:?}");
    }
}
