//! Stored data, restored into an empty memory as after a kill.

use super::*;
use crate::cycle::kept::SHIFT_HOLDS_NS;
use crate::pose_suggestion::coordinates;

fn kept(memory: &Memory) -> Box<Kept> {
    let mut kept = bytemuck::zeroed_box::<Kept>();
    kept.take(memory);
    kept
}

/// The same bench with an empty memory into which the data were restored, `gap_ns` later.
fn started_again(bench: &Bench, kept: &Kept, gap_ns: u64) -> Bench {
    let mut again = Bench::new(|settings| *settings = bench.settings);
    (again.now_ns, again.suit_drift_m) = (bench.now_ns + gap_ns, bench.suit_drift_m);
    assert!(again.memory.identification.restore(&kept.worker, &bench.settings));
    again.memory.exposure.resume(&kept.shift);
    assert!(again.memory.resume_tare(&kept.tare));
    assert!(again.memory.resume_registration(&kept.registration, &bench.settings));
    again
}

#[test]
fn what_was_learnt_and_which_poses_it_was_learnt_from_come_back() {
    let (person, mut bench) = (Person::real(), Bench::new(|settings| settings.poses_min = 1000));
    bench.settings.pose_choice = PoseChoice::Paper;
    for posture in &postures()[..5] {
        bench.hold(&person, posture, None, 600);
    }
    let kept = kept(&bench.memory);
    assert!(kept.worker.poses_used >= 4, "{}", kept.worker.poses_used);
    assert_eq!(kept.worker.performed.poses().count() as u64, kept.worker.poses_used);
    assert_eq!(
        kept.worker.performed.poses().next().unwrap(),
        &coordinates(&person.pose(&postures()[0])),
        "oldest first"
    );
    let mut again = started_again(&bench, &kept, NS_PER_S);
    assert_eq!(*self::kept(&again.memory).worker.performed.poses().last().unwrap(), {
        *kept.worker.performed.poses().last().unwrap()
    });
    let count = kept.worker.filter.count();
    let worker = &again.memory.identification;
    assert_eq!(worker.filter.theta_m()[..count], kept.worker.filter.theta_m()[..count]);
    for row in 0..count {
        assert_eq!(worker.filter.covariance_row_m2(row), kept.worker.filter.covariance_row_m2(row));
    }
    // Suggested poses stay marked: the next suggestion of both is the same, and the last pose held is not used again.
    let last = &postures()[4];
    again.hold(&person, last, None, 1500);
    bench.hold(&person, last, None, 1500);
    assert_eq!(again.state().poses_used, bench.state().poses_used);
    assert_eq!(again.memory.identification.suggested, bench.memory.identification.suggested);
    assert_ne!(again.memory.identification.suggested, NO_POSE);
    // Identification continues.
    again.hold(&person, &postures()[7], None, 600);
    assert_eq!(u64::from(again.state().poses_used), kept.worker.poses_used + 1);
    assert!(again.memory.is_sound());
}

#[test]
fn a_shift_goes_on_and_its_lift_under_way_counts_when_it_has_ended() {
    let mut memory = bytemuck::zeroed_box::<Memory>();
    memory.start(&Bench::new(|_| {}).settings);
    let limits = [100.0; 22];
    let carried = crate::exposure::Carried { mass_kg: [12.0, 0.5], distance_m: 0.5 };
    let load = crate::exposure::Load::Known { torque_nm: [40.0; 22], carried };
    for sample in 1..200 {
        memory.exposure.advance(sample * 10_000_000, &load, &limits);
    }
    let under_way = kept(&memory).shift;
    assert_eq!((under_way.lifts, under_way.damage), (0, 0.0));
    assert!(under_way.fatigue[0] > 0.0);
    memory.exposure.resume(&under_way);
    assert_eq!(memory.exposure.shift(), under_way);
    // The load is detected again.
    for sample in 300..400 {
        memory.exposure.advance(sample * 10_000_000, &load, &limits);
    }
    memory.exposure.advance(NS_PER_S << 10, &load, &limits);
    let shift = kept(&memory).shift;
    assert_eq!((shift.lifts, shift.latest[0].number), (1, 1));
    memory.exposure.resume(&shift);
    assert_eq!(memory.exposure.shift(), shift);
    memory.exposure.advance(NS_PER_S << 11, &load, &limits);
    assert_eq!(memory.exposure.shift(), shift, "over the gap nothing is known");
}

#[test]
fn a_shift_of_the_suit_s_world_holds_only_for_the_suit_that_went_on_and_not_for_long() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    let posture = postures()[0];
    bench.hold(&person, &posture, None, 500);
    // Position of the pelvis by the anchor, without the filter's stance offset.
    let anchored_m = |bench: &Bench| {
        bench.state().segment_origin_m[0][0] - bench.memory.identification.stance_offset_m()[0]
    };
    let true_m = anchored_m(&bench);
    for _ in 0..100 {
        bench.suit_drift_m += 0.002;
        bench.hold(&person, &posture, None, 10);
    }
    let kept = kept(&bench.memory);
    assert!((kept.registration.station_from_suit_m[0] + bench.suit_drift_m).abs() < 1e-9);
    let published_m = |gap_ns: u64, change: &dyn Fn(&mut Kept)| {
        let mut kept = kept.clone();
        change(&mut kept);
        let mut again = started_again(&bench, &kept, gap_ns);
        again.hold(&person, &posture, None, 300);
        anchored_m(&again) - true_m
    };
    assert!(published_m(3 * NS_PER_S, &|_| {}).abs() < 1e-9, "drift is known still");
    let new_drift_m = bench.suit_drift_m;
    assert!((published_m(SHIFT_HOLDS_NS + NS_PER_S, &|_| {}) - new_drift_m).abs() < 1e-9, "too long ago");
    let restarted = |kept: &mut Kept| kept.registration.suit_counter += 100_000;
    assert!(
        (published_m(3 * NS_PER_S, &restarted) - new_drift_m).abs() < 1e-9,
        "the suit counts from the beginning"
    );
    let jumped = |kept: &mut Kept| kept.registration.suit_counter -= 100;
    assert!((published_m(NS_PER_S / 2, &jumped) - new_drift_m).abs() < 1e-9, "another stream");
}

#[test]
fn what_is_not_sound_is_not_put_back() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.hold(&person, &postures()[0], None, 900);
    let kept = kept(&bench.memory);
    let mut fits = |damage: &dyn Fn(&mut Kept)| {
        let mut kept = kept.clone();
        damage(&mut kept);
        let worker = bench.memory.identification.restore(&kept.worker, &bench.settings);
        worker
            && bench.memory.resume_tare(&kept.tare)
            && bench.memory.resume_registration(&kept.registration, &bench.settings)
    };
    assert!(fits(&|_| {}));
    assert!(!fits(&|kept| kept.worker.has_body = 0));
    assert!(!fits(&|kept| kept.worker.skeleton_m[3][1] = 4.0));
    assert!(!fits(&|kept| kept.worker.mass_kg = f64::NAN));
    assert!(!fits(&|kept| kept.worker.filter.wander(2, f64::INFINITY)));
    assert!(!fits(&|kept| kept.worker.filter.wander(2, -1.0)));
    assert!(!fits(&|kept| kept.worker.poses_used = u64::MAX));
    assert!(!fits(&|kept| kept.worker.consistency.tested = 7));
    assert!(!fits(&|kept| kept.worker.consistency.recent_count = u64::MAX));
    assert!(!fits(&|kept| kept.worker.last_pose_wxyz[0][0] = f64::NAN));
    assert!(!fits(&|kept| kept.tare.moment_nm[1] = f64::NAN));
    assert!(!fits(&|kept| kept.registration.station_from_suit_m[0] = f64::NAN));
    assert!(!fits(&|kept| kept.registration.suit_time_ns = 0));
}
