//! Exposure values of whole cycles, for ergonomists and cobots.

use super::*;
use crate::exposure::dose::damage_of_lift;
use crate::overload::Level;

const KG: f64 = 6.0;

fn carrying_pose() -> Posture {
    stand(20, 0, [0, 0, -80], [0, 0, 80], 30)
}

/// An identified subject who holds a box in a static pose for some time.
fn carrying(person: &Person, milliseconds: u64) -> Bench {
    let mut bench = Bench::identified();
    let at = lifted_box(person, &carrying_pose());
    // Take the pose first: poses leap on this bench, and a leaping box would exert a force of tons.
    bench.hold(person, &carrying_pose(), None, 900);
    bench.hold(person, &carrying_pose(), Some((KG, at)), milliseconds);
    bench
}

#[test]
fn mass_reach_and_moment_are_those_of_the_box() {
    let person = Person::real();
    let bench = carrying(&person, 600);
    let state = bench.state();
    assert!(!state.validity().any_of(Validity::INVALIDATES_TORQUES), "{:?}", state.validity());
    assert!((state.lifted_mass_kg - KG).abs() < 1e-9 && state.lifted_mass_sigma_kg > 0.0);
    let pose = person.pose(&carrying_pose());
    let at = lifted_box(&person, &carrying_pose());
    let feet = Side::BOTH.map(|side| pose.origin_of(side.foot()));
    let truth_m = (at - 0.5 * (feet[0] + feet[1])).xy().norm();
    assert!((state.reach_m - truth_m).abs() < 0.05, "{} {truth_m}", state.reach_m);

    // The true moment about L5/S1: every segment above it, and the box.
    let l5s1 = Joint::named("L5S1").unwrap();
    let origin = pose.origin_of(l5s1.segment());
    let mut moment = (at - origin) * KG;
    let mut above_kg = 0.0;
    for segment in Segment::ALL.into_iter().filter(|segment| segment.is_distal_to(l5s1.segment())) {
        let kg = MASS_KG * person.body.mass_fraction[segment.index()];
        above_kg += kg;
        moment += (pose.point_on(segment, person.body.com_m[segment.index()]) - origin) * kg;
    }
    let truth_nm = GRAVITY_M_PER_S2 * moment.xy().norm();
    let error_nm = (state.l5s1_moment_nm - truth_nm).abs();
    assert!(error_nm < 3.0 * state.l5s1_moment_sigma_nm, "{} {truth_nm}", state.l5s1_moment_nm);
    assert!(state.l5s1_moment_sigma_nm < 0.25 * truth_nm, "{}", state.l5s1_moment_sigma_nm);
    let weight_n = GRAVITY_M_PER_S2 * (above_kg + KG) * 20f64.to_radians().cos();
    let truth_n = truth_nm / 0.06 + weight_n;
    assert!((state.l5s1_compression_n - truth_n).abs() < state.l5s1_compression_sigma_n);
}

#[test]
fn the_back_is_published_without_a_load_and_the_load_is_not() {
    let (person, mut bench) = (Person::real(), Bench::identified());
    bench.hold(&person, &carrying_pose(), None, 1500);
    let state = bench.state();
    assert!(state.validity().any_of(Validity::BELOW_LOAD_THRESHOLD));
    assert!(state.l5s1_moment_nm > 10.0 && state.l5s1_compression_n > 400.0);
    assert_eq!((state.lifted_mass_kg, state.reach_m, state.worst_joint), (0.0, 0.0, u32::MAX));
    assert_eq!((state.advice_direction, state.advice_gain_nm_per_cm), ([0.0; 3], 0.0));

    bench.suit_silent = true;
    bench.hold(&person, &carrying_pose(), None, 300);
    assert_eq!((bench.state().l5s1_moment_nm, bench.state().l5s1_compression_n), (0.0, 0.0));
}

#[test]
fn a_load_that_may_be_undetected_is_flagged_and_masks_the_back() {
    let person = Person::real();
    let mut bench = carrying(&person, 600);
    // Long enough for the offset of the vertical force, whose uncertainty also masks a load.
    bench.hold(&person, &carrying_pose(), None, 4000);
    bench.takes_ms = 10.0;
    // The bench's plate does not show the inertia of the arms, which the lag test would reject.
    bench.settings.align_streams = false;
    let (mut masked, mut published) = (0, 0);
    for step in 0..560_i16 {
        // After the box is put down, the arms swing and stop repeatedly.
        let degrees = if step % 100 < 40 { (25.0 * (f64::from(step) * 0.15).sin()) as i16 } else { 0 };
        let swing = stand(20, 0, [0, degrees, -80], [0, degrees, 80], 30);
        bench.hold(&person, &swing, None, 10);
        let state = bench.state();
        let (reasons, compressed) = (state.validity(), state.l5s1_compression_n > 0.0);
        assert_eq!(
            compressed,
            !reasons.any_of(Validity::INVALIDATES_LOW_BACK),
            "{:?}",
            reasons.names().collect::<Vec<_>>()
        );
        if reasons.any_of(Validity::LOAD_BELOW_DETECTION_LIMIT) {
            masked += 1;
            assert!(reasons.any_of(Validity::BELOW_LOAD_THRESHOLD));
        }
        published += u32::from(compressed);
    }
    assert!(masked > 20 && published > 20, "{masked} {published}");
}

#[test]
fn the_worst_joint_is_the_one_closest_to_its_limit() {
    let person = Person::real();
    let bench = carrying(&person, 600);
    let state = bench.state();
    let worst = Joint::ALL[state.worst_joint as usize];
    let limit_ratio = |joint: Joint| {
        Vector3::from(state.torque_nm[joint.index()]).norm() / state.torque_limit_nm[joint.index()]
    };
    assert!(Joint::ALL.into_iter().all(|joint| limit_ratio(joint) <= limit_ratio(worst)));
    let direction = Vector3::from(state.advice_direction);
    assert!((direction.norm() - 1.0).abs() < 1e-12 && state.advice_gain_nm_per_cm > 0.0);
}

#[test]
fn a_box_that_moves_as_advised_relieves_a_leg_by_the_gain() {
    let person = Person::real();
    let joint = Joint::named("LeftAnkle").unwrap();
    let ankle = joint.index();
    // The low limit makes the ankle the worst joint; the box moves with the hands.
    let states_carrying = |posture: Posture| {
        let mut bench = Bench::new(|settings| settings.limits.set(joint, 1.0));
        bench.identify(&person);
        let at = lifted_box(&person, &posture);
        bench.hold(&person, &posture, None, 900);
        bench.hold(&person, &posture, Some((KG, at)), 600);
        (*bench.state(), at)
    };
    let (before, from) = states_carrying(carrying_pose());
    assert_eq!(before.worst_joint as usize, ankle);
    let (after, to) = states_carrying(stand(20, 0, [0, 0, -80], [0, 0, 80], 60));
    let magnitude_nm = |state: &State| Vector3::from(state.torque_nm[ankle]).norm();
    let moved_cm = 100.0 * (to - from).dot(&Vector3::from(before.advice_direction));
    let (fallen_nm, published_nm) =
        (magnitude_nm(&before) - magnitude_nm(&after), moved_cm * before.advice_gain_nm_per_cm);
    assert!(moved_cm.abs() > 2.0, "{moved_cm}");
    // The gain applies to constant foot load fractions; a box that moves sideways changes them slightly.
    assert!((fallen_nm - published_nm).abs() < 0.4 * published_nm.abs(), "{fallen_nm} {published_nm}");
}

#[test]
fn carrying_tires_rest_restores_and_silence_does_neither() {
    let person = Person::real();
    let mut bench = carrying(&person, 3000);
    let worst = bench.state().worst_joint as usize;
    let tired = bench.state().fatigue[worst];
    assert!(tired > 0.0);
    bench.hold(&person, &carrying_pose(), None, 100);
    let rested = bench.state().fatigue[worst];
    bench.hold(&person, &carrying_pose(), None, 3000);
    assert!(bench.state().fatigue[worst] < rested);

    let before = bench.state().fatigue;
    bench.suit_silent = true;
    bench.hold(&person, &carrying_pose(), None, 3000);
    assert_eq!(bench.state().fatigue, before, "published while the sensors are silent, and unchanged");
}

#[test]
fn a_lift_counts_when_it_is_put_down_and_a_reset_keeps_the_dose() {
    let person = Person::real();
    let mut bench = carrying(&person, 10);
    // A box: its centre is beyond the grips.
    let at = lifted_box(&person, &carrying_pose()) + Vector3::new(0.025, 0.0, 0.0);
    bench.hold(&person, &carrying_pose(), Some((KG, at)), 2000);
    assert_eq!(bench.state().lifts, 0);
    // Weight times the horizontal distance from the hip joints, as measured with a tape.
    let pose = person.pose(&carrying_pose());
    let hips = [Segment::LeftUpperLeg, Segment::RightUpperLeg].map(|leg| pose.origin_of(leg));
    let moment_nm = KG * GRAVITY_M_PER_S2 * (at - 0.5 * (hips[0] + hips[1])).xy().norm();
    bench.hold(&person, &carrying_pose(), None, 1000);
    let state = bench.state();
    assert_eq!(state.lifts, 1);
    assert!((state.dose_damage / damage_of_lift(moment_nm) - 1.0).abs() < 0.05, "{}", state.dose_damage);
    assert!(state.dose_probability > 0.0 && state.dose_probability < 0.5);

    bench.command(CommandKind::IdentifyReset);
    bench.hold(&person, &carrying_pose(), None, 100);
    assert_eq!(bench.state().lifts, 1, "the same worker");
    let mut another = bytemuck::zeroed_box::<SubjectState>();
    another.identification = bench.memory.identification;
    bench.memory.replace_subject(&another);
    (bench.suit_silent, bench.ground_silent) = (true, true);
    bench.command(CommandKind::SubjectLoad);
    assert_eq!((bench.state().lifts, bench.state().dose_damage), (0, 0.0), "at once, also without sensors");
    (bench.suit_silent, bench.ground_silent) = (false, false);
    bench.hold(&person, &carrying_pose(), None, 100);
    assert_eq!((bench.state().lifts, bench.state().dose_damage), (0, 0.0), "another worker");
    assert_eq!(bench.state().fatigue, [0.0; 22]);
}

#[test]
fn a_force_that_is_doubled_for_20_ms_changes_no_dose_and_for_200_ms_it_does() {
    let person = Person::real();
    let at = lifted_box(&person, &carrying_pose());
    let dose_with = |load: (f64, Vector3<f64>), milliseconds| {
        let mut bench = carrying(&person, 1000);
        bench.takes_ms = milliseconds as f64 / 6.0;
        bench.hold(&person, &carrying_pose(), Some(load), milliseconds);
        bench.hold(&person, &carrying_pose(), Some((KG, at)), 20);
        bench.takes_ms = 100.0;
        bench.hold(&person, &carrying_pose(), Some((KG, at)), 1000);
        bench.hold(&person, &carrying_pose(), None, 1000);
        assert_eq!(bench.state().lifts, 1);
        bench.state().dose_damage
    };
    let plain = dose_with((KG, at), 20);
    assert!((dose_with((2.0 * KG, at), 20) / plain - 1.0).abs() < 1e-3);
    let long = dose_with((2.0 * KG, at), 200);
    assert!(long > 1.5 * plain, "{long} {plain}");
}

#[test]
fn implausible_samples_under_a_load_add_no_row_no_lift_no_dose_and_no_fatigue() {
    let person = Person::real();
    let at = lifted_box(&person, &carrying_pose());
    let load = Some((KG, at));
    // Number of cycles with an implausible ground; states after the glitch, and after the box is put down.
    let states_with = |gain_error: f64| {
        let mut bench = carrying(&person, 1500);
        bench.disturbance.gain_error = gain_error;
        bench.hold(&person, &carrying_pose(), load, 20);
        bench.disturbance.gain_error = 0.0;
        let is_implausible = |bench: &mut Bench| {
            bench.hold(&person, &carrying_pose(), load, 1);
            bench.state().validity().any_of(Validity::GROUND_IMPLAUSIBLE)
        };
        let implausible = (0..1500).filter(|_| is_implausible(&mut bench)).count();
        let carried = *bench.state();
        bench.hold(&person, &carrying_pose(), None, 1500);
        (implausible, carried, *bench.state())
    };
    let (none, plain, plain_end) = states_with(0.0);
    let (some, glitched, glitched_end) = states_with(1.0);
    assert!(none == 0 && (200..700).contains(&some), "{none} {some}");
    let learnt = |state: &State| {
        let State { poses_used, motion_samples_used, mass_kg, variance_max_m2, .. } = *state;
        (poses_used, motion_samples_used, [mass_kg, variance_max_m2, state.predicted_cop_sigma_m])
    };
    assert_eq!(learnt(&glitched), learnt(&plain));
    assert_eq!((glitched.lifts, plain.lifts), (0, 0));
    assert_eq!((glitched_end.lifts, plain_end.lifts), (1, 1));
    assert!((glitched_end.dose_damage / plain_end.dose_damage - 1.0).abs() < 1e-3, "the peak");
    let worst = plain.worst_joint as usize;
    let (of_glitched, of_plain) = (glitched.fatigue[worst], plain.fatigue[worst]);
    assert!(of_glitched > 0.0 && of_glitched <= of_plain, "{of_glitched} {of_plain}");
}

#[test]
fn levels_follow_table_1_where_sigma_is_small() {
    let person = Person::real();
    // Long enough to determine the load's position in the hands.
    let bench = carrying(&person, 4000);
    let state = bench.state();
    let mut with_sigma = Vec::new();
    for joint in Joint::ALL {
        let index = joint.index();
        let magnitude_nm = Vector3::from(state.torque_nm[index]).norm();
        let sigma_nm = state.torque_sigma_nm[index];
        let of = |nm: f64| Level::of(nm, state.torque_limit_nm[index]);
        let level = Level::from_number(state.joint_level[index]).unwrap();
        if of(magnitude_nm - sigma_nm) == of(magnitude_nm + sigma_nm) {
            assert_eq!(level, of(magnitude_nm), "{}", joint.name());
            with_sigma.push(level);
        }
        assert_ne!(level, Level::None);
    }
    assert!(
        with_sigma.contains(&Level::Green) && with_sigma.iter().any(|level| *level > Level::Green),
        "{with_sigma:?}"
    );
}

#[test]
fn the_limit_of_a_joint_is_that_of_the_direction_of_its_torque() {
    let person = Person::real();
    let mut bench = carrying(&person, 600);
    let limits = bench.settings.limits;
    let state = *bench.state();
    assert_eq!(state.torque_limit_nm, limits.along_nm(&person.pose(&carrying_pose()), &state.torque_nm));
    // A load in front bends straight knees backwards: their flexors hold it, which are weaker than the extensors.
    let knee = Joint::named("LeftKnee").unwrap().index();
    assert!(state.torque_nm[knee][1] > 0.0);
    assert!(state.torque_limit_nm[knee] < 0.6 * limits.without_torque_nm()[knee]);
    bench.hold(&person, &carrying_pose(), None, 600);
    assert_eq!(bench.state().torque_limit_nm, *limits.without_torque_nm());
}

#[test]
fn an_unsound_exposure_is_refused() {
    let bench = carrying(&Person::real(), 100);
    let mut memory = Box::new(*bench.memory);
    assert!(memory.is_sound());
    memory.exposure.fatigue.by_joint[3] = 1.5;
    assert!(!memory.is_sound());
    memory.exposure.fatigue.by_joint[3] = 0.5;
    memory.exposure.dose.damage = f64::NAN;
    assert!(!memory.is_sound());
}
