//! Invariants of the simulated human, for every body and every motion.

use equipoise_core::body::{Joint, Segment};
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_simulator::GRAVITY_M_PER_S2;
use equipoise_simulator::kinematics::centre_m;
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::noise::{Suit, SuitNoise};
use equipoise_simulator::person::Person;
use equipoise_simulator::reach::{HeldPart, ReachHabits};
use equipoise_simulator::truth::Truth;
use nalgebra::Vector3;

fn statue() -> Worker {
    Worker::with_habits(Person::new(1, 1.77, 72.0), 1, Habits::NONE)
}

fn alive(seed: u64) -> Worker {
    Worker::new(Person::new(seed, 1.77, 72.0), seed)
}

#[test]
fn a_statue_presses_where_its_centre_of_mass_is() {
    let mut worker = statue();
    for (index, posture) in LIBRARY.iter().enumerate() {
        let start = 5.0 * index as f64;
        worker.take_pose(posture, start, 2.0);
        let truth = Truth::of(&worker, start + 3.0);
        assert!((truth.cop_m - truth.cop_without_load_m).norm() < 1e-5, "{}", posture.name);
        let weight = Vector3::z() * 72.0 * GRAVITY_M_PER_S2;
        assert!((truth.ground.force_n - weight).norm() < 1e-3, "{}", posture.name);
        assert!(truth.ground.moment_nm.z.abs() < 1e-3);
    }
}

#[test]
fn a_living_person_who_holds_still_presses_inside_the_feet_and_near_the_projection() {
    let mut worker = alive(2);
    for (index, posture) in LIBRARY.iter().enumerate() {
        let start = 5.0 * index as f64;
        worker.take_pose(posture, start, 2.0);
        let truth = Truth::of(&worker, start + 3.5);
        assert!(worker.stance().margin_m(truth.cop_m) > 0.02, "{}", posture.name);
        assert!((truth.cop_m - truth.cop_without_load_m).norm() < 0.012, "{}", posture.name);
    }
}

#[test]
fn no_motion_throws_the_person_over() {
    let end = 4.0 * LIBRARY.len() as f64;
    for seed in 3..7 {
        let mut worker = alive(seed);
        for (index, posture) in LIBRARY.iter().enumerate() {
            worker.take_pose(posture, 4.0 * index as f64, 1.8);
        }
        worker.lift_and_show(4.0, end);
        for step in 0..((end + 18.0) * 20.0) as u32 {
            let truth = Truth::of(&worker, f64::from(step) * 0.05);
            let margin = worker.stance().margin_m(truth.cop_m);
            assert!(margin > 0.0, "seed {seed}, {:.2} s: {:.3} m outside", truth.time_s, -margin);
            let vertical = truth.ground.force_n.z / (72.0 * GRAVITY_M_PER_S2);
            assert!((0.6..1.5).contains(&vertical), "seed {seed}, {:.2} s: {vertical}", truth.time_s);
        }
    }
}

/// The rate of the whole body's momentum, computed differently: velocities first, over another span.
#[test]
fn the_ground_gives_the_rate_of_momentum() {
    let mut worker = alive(4);
    worker.take_pose(&LIBRARY[41], 0.0, 2.0);
    let person = worker.person().clone();
    let momentum = |t: f64| {
        let h = 0.0005;
        let centre = |t: f64| centre_m(&person.segment_mass_kg, &worker.sample(t).com_m);
        (centre(t + h) - centre(t - h)) / (2.0 * h) * person.mass_kg
    };
    for step in 1..20 {
        let t = 0.1 * f64::from(step);
        let h = 0.0015;
        let rate = (momentum(t + h) - momentum(t - h)) / (2.0 * h);
        let force = worker.ground_reaction(t).force_n - Vector3::z() * person.mass_kg * GRAVITY_M_PER_S2;
        assert!((force - rate).norm() < 0.02 * rate.norm() + 0.05, "{t}: {force:?} {rate:?}");
    }
}

#[test]
fn a_box_adds_its_weight_and_moves_the_pressure_towards_it() {
    let mut worker = statue();
    worker.take_pose(&LIBRARY[2], 0.0, 1.0);
    let before = Truth::of(&worker, 4.0);
    worker.lift(4.0, 5.0);
    let after = Truth::of(&worker, 5.31);
    let still = Truth::of(&worker, 9.0);
    let added = still.ground.force_n.z - before.ground.force_n.z;
    assert!((added - 4.0 * GRAVITY_M_PER_S2).abs() < 1e-3, "{added}");
    assert!(after.cop_with_load_m.x > after.cop_without_load_m.x + 0.015);
    assert!((still.cop_m - still.cop_with_load_m).norm() < 1e-5);
    // The body has leant back until body and box together are in balance again.
    assert!((still.cop_m - before.cop_m).norm() < 1e-5);
    worker.put_down(10.0);
    assert!((Truth::of(&worker, 15.0).ground.force_n.z - before.ground.force_n.z).abs() < 1e-3);
}

#[test]
fn without_a_load_no_joint_is_overloaded_and_with_one_each_hand_carries_half() {
    let mut worker = statue();
    worker.take_pose(&LIBRARY[2], 0.0, 1.0);
    let empty = Truth::of(&worker, 3.0);
    assert!(empty.overload_nm.iter().all(|torque| torque.norm() < 1e-9));
    worker.lift(4.0, 4.0);
    let truth = Truth::of(&worker, 8.0);
    let elbow = Joint::named("RightElbow").unwrap();
    let arm = truth.body.grip_m[1] - truth.body.origin_m[Segment::RightForearm.index()];
    let expected = arm.cross(&(Vector3::z() * 2.0 * GRAVITY_M_PER_S2));
    assert!((truth.overload_nm[elbow.index()] - expected).norm() < 1e-9);
    // A box in front bends the back forward: the back muscles must extend it, a torque about −Y.
    let back = truth.overload_nm[Joint::named("L5S1").unwrap().index()];
    assert!(back.y < -10.0, "{back:?}");
}

#[test]
fn a_seed_is_a_recording_and_another_seed_another_person() {
    let sample = |seed: u64| {
        let mut worker = alive(seed);
        worker.take_pose(&LIBRARY[7], 0.5, 1.5);
        let suit = Suit::new(SuitNoise::ORDINARY, seed);
        let body = worker.sample(1.234);
        (suit.see(worker.person(), &body), worker.ground_reaction(1.234))
    };
    assert_eq!(sample(5), sample(5));
    assert_ne!(sample(5).1, sample(6).1);
}

#[test]
fn a_perfect_suit_sees_the_truth_and_an_ordinary_one_is_a_degree_off() {
    let worker = alive(9);
    let body = worker.sample(20.0);
    let (origin, rotation) = Suit::new(SuitNoise::NONE, 1).see(worker.person(), &body);
    for i in 0..origin.len() {
        assert!((origin[i] - body.origin_m[i]).norm() < 1e-9);
        assert!(rotation[i].angle_to(&body.world_from_segment[i]) < 1e-6);
    }
    let (_, rotation) = Suit::new(SuitNoise::ORDINARY, 1).see(worker.person(), &body);
    let mean =
        (0..rotation.len()).map(|i| rotation[i].angle_to(&body.world_from_segment[i])).sum::<f64>() / 23.0;
    assert!((0.4..2.0).contains(&mean.to_degrees()), "{}", mean.to_degrees());
}

#[test]
fn a_held_part_stays_in_the_hands_and_the_motion_is_smooth_and_balanced() {
    let place = |middle_m: [f64; 3]| HeldPart {
        middle_m: middle_m.into(),
        width_m: 0.35,
        aside: Vector3::y(),
        slope_rad: None,
    };
    for seed in 0..4 {
        let person = Person::new(seed, 1.6 + 0.08 * seed as f64, 60.0 + 8.0 * seed as f64);
        let weight_n = person.mass_kg * GRAVITY_M_PER_S2;
        let mut worker = Worker::with_habits(person, seed, Habits::NONE);
        let habits = ReachHabits::of(seed);
        assert_eq!(worker.hold_part(&habits, &place([1.8, 0.0, 1.0]), 6.0, 0.0, 2.0), None);
        let mut at_s = 1.0;
        for middle_m in [[0.45, 0.0, 1.05], [0.35, 0.15, 1.35]] {
            let part = place(middle_m);
            let [taken_s, given_s] = worker.hold_part(&habits, &part, 6.0, at_s, 2.0).unwrap();
            let mut before = worker.sample(at_s);
            for step in 1..=((given_s + 3.5 - at_s) * 100.0) as u32 {
                let truth = Truth::of(&worker, at_s + f64::from(step) * 0.01);
                let (body, time_s) = (&truth.body, truth.time_s);
                for (now, before) in body.origin_m.iter().zip(before.origin_m) {
                    let m_per_s = (now - before).norm() / 0.01;
                    assert!(m_per_s < 2.5, "seed {seed}, {time_s:.2} s: {m_per_s} m/s");
                }
                assert!(worker.stance().margin_m(truth.cop_m) > 0.0, "seed {seed}, {time_s:.2} s");
                let vertical = truth.ground.force_n.z / weight_n;
                assert!((0.7..1.3).contains(&vertical), "seed {seed}, {time_s:.2} s: {vertical}");
                let off_m = (0.5 * (body.grip_m[0] + body.grip_m[1]) - part.middle_m).norm();
                let is_held = (taken_s..given_s).contains(&time_s);
                assert!(
                    !is_held || (body.load_kg == 6.0 && off_m < 1e-3),
                    "seed {seed}, {time_s:.2} s: {off_m}"
                );
                assert!(body.load_kg == 0.0 || off_m < 0.02, "seed {seed}, {time_s:.2} s: {off_m}");
                before = truth.body;
            }
            at_s = given_s + 4.0;
        }
    }
}
