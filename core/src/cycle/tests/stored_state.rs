//! Stored data, restored into an empty memory as after a kill.

use super::*;
use crate::cycle::stored_state::SHIFT_VALID_NS;
use crate::message::GroundDevice;
use crate::motion::ForceSigma;
use crate::pose_suggestion::{Performed, coordinates};
use crate::sesc::PARAMETERS;

fn stored_state(memory: &Memory) -> Box<StoredState> {
    let mut stored = bytemuck::zeroed_box::<StoredState>();
    stored.copy_from(memory, &Settings::for_height(HEIGHT_M));
    stored
}

/// The same bench with an empty memory into which the data were restored, `gap_ns` later.
fn restored_bench(bench: &Bench, stored: &StoredState, gap_ns: u64) -> Bench {
    let mut again = Bench::new(|settings| *settings = bench.settings);
    (again.now_ns, again.suit_drift_m) = (bench.now_ns + gap_ns, bench.suit_drift_m);
    assert!(again.memory.identification.restore(&stored.subject, &bench.settings));
    again.memory.exposure.resume(&stored.shift, bench.now_ns);
    assert!(again.memory.resume_tare(&stored.tare));
    again.memory.resume_force_offset(&stored.force_offset);
    assert!(again.memory.resume_registration(&stored.registration, &bench.settings));
    again
}

#[test]
fn parameters_and_performed_poses_are_restored() {
    let (person, mut bench) = (Person::real(), Bench::new(|settings| settings.poses_min = 1000));
    bench.settings.pose_choice = PoseChoice::Paper;
    for posture in &postures()[..5] {
        bench.hold(&person, posture, None, 600);
    }
    let stored = stored_state(&bench.memory);
    assert!(stored.subject.poses_used >= 4, "{}", stored.subject.poses_used);
    assert_eq!(stored.subject.performed.poses().count() as u64, stored.subject.poses_used);
    assert_eq!(
        stored.subject.performed.poses().next().unwrap(),
        &coordinates(&person.pose(&postures()[0])),
        "oldest first"
    );
    let mut again = restored_bench(&bench, &stored, NS_PER_S);
    assert_eq!(*stored_state(&again.memory).subject.performed.poses().last().unwrap(), {
        *stored.subject.performed.poses().last().unwrap()
    });
    let count = stored.subject.filter.count();
    let subject = &again.memory.identification;
    assert_eq!(subject.filter.theta_m()[..count], stored.subject.filter.theta_m()[..count]);
    for row in 0..count {
        assert_eq!(subject.filter.covariance_row_m2(row), stored.subject.filter.covariance_row_m2(row));
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
    assert_eq!(u64::from(again.state().poses_used), stored.subject.poses_used + 1);
    assert!(again.memory.is_sound());
}

#[test]
fn a_resumed_shift_counts_a_lift_in_progress_when_it_ends() {
    let mut memory = bytemuck::zeroed_box::<Memory>();
    memory.start(&Bench::new(|_| {}).settings);
    let limits = [100.0; 22];
    let carried = crate::exposure::Carried { mass_kg: [12.0, 0.5], distance_m: 0.5 };
    let load = crate::exposure::Load::Known { torque_nm: [40.0; 22], carried };
    for sample in 1..200 {
        memory.exposure.advance(sample * 10_000_000, &load, &limits);
    }
    let under_way = stored_state(&memory).shift;
    assert_eq!((under_way.lifts, under_way.damage), (0, 0.0));
    assert!(under_way.fatigue[0] > 0.0);
    memory.exposure.resume(&under_way, 2 * NS_PER_S);
    assert_eq!(memory.exposure.shift(), under_way);
    // The load is detected again.
    for sample in 300..400 {
        memory.exposure.advance(sample * 10_000_000, &load, &limits);
    }
    // It is put down.
    for sample in 400..460 {
        memory.exposure.advance(sample * 10_000_000, &crate::exposure::Load::None, &limits);
    }
    let shift = stored_state(&memory).shift;
    assert_eq!((shift.lifts, shift.latest[0].number), (1, 1));
    memory.exposure.resume(&shift, 5 * NS_PER_S);
    assert_eq!(memory.exposure.shift(), shift);
    memory.exposure.advance(NS_PER_S << 10, &load, &limits);
    assert_eq!(memory.exposure.shift(), shift, "the gap changes nothing");
}

#[test]
fn a_stored_registration_is_valid_for_the_same_suit_and_a_short_gap_only() {
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
    let (stored, offset_m) = (stored_state(&bench.memory), bench.memory.identification.stance_offset_m()[0]);
    assert!((stored.registration.station_from_suit_m[0] + bench.suit_drift_m - offset_m).abs() < 1e-9);
    let published_m = |gap_ns: u64, change: &dyn Fn(&mut StoredState)| {
        let mut stored = stored.clone();
        change(&mut stored);
        let mut again = restored_bench(&bench, &stored, gap_ns);
        again.hold(&person, &posture, None, 300);
        anchored_m(&again) - true_m
    };
    assert!(
        (published_m(3 * NS_PER_S, &|_| {}) - offset_m).abs() < 1e-9,
        "drift and stance offset are restored"
    );
    let new_drift_m = bench.suit_drift_m;
    assert!((published_m(SHIFT_VALID_NS + NS_PER_S, &|_| {}) - new_drift_m).abs() < 1e-9, "too long ago");
    let restarted = |stored: &mut StoredState| stored.registration.suit_counter += 100_000;
    assert!(
        (published_m(3 * NS_PER_S, &restarted) - new_drift_m).abs() < 1e-9,
        "the suit counts from the beginning"
    );
    let jumped = |stored: &mut StoredState| stored.registration.suit_counter -= 100;
    assert!((published_m(NS_PER_S / 2, &jumped) - new_drift_m).abs() < 1e-9, "another stream");
}

#[test]
fn the_stance_offset_is_part_of_the_stored_position() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.hold(&person, &postures()[0], None, 500);
    bench.set_stance_offset([0.02, -0.01]);
    let before_m = bench.memory.station_from_suit_m();
    // The σ is raised to at least that of a first start.
    for (variance_m2, expected_m2) in [(0.0, 9e-4), (0.01, 0.01)] {
        bench.memory.identification.widen_stance_offset_to([variance_m2; 2]);
        let again = restored_bench(&bench, &stored_state(&bench.memory), NS_PER_S);
        let (after_m, subject) = (again.memory.station_from_suit_m(), &again.memory.identification);
        assert_eq!(subject.stance_offset_m(), [0.0; 2]);
        for axis in 0..2 {
            assert!((after_m[axis] - before_m[axis]).abs() < 1e-9, "{after_m:?} {before_m:?}");
            assert!((subject.stance_variance_m2()[axis] - expected_m2).abs() < 1e-6, "{variance_m2}");
        }
    }
}

#[test]
fn a_zero_that_drifted_before_a_restart_is_no_load_after_it() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    // The machine has run for days, in which the zero did not drift unobserved.
    bench.now_ns = 1_000_000 * NS_PER_S;
    bench.disturbance.zero_n = 18.0;
    bench.hold(&person, &postures()[0], None, 500);
    let offset = &mut bench.memory.ground.force_offset;
    for _ in 0..2000 {
        offset.update(18.0 - offset.mean_n(), 0.01, ForceSigma { at_rest_n: 2.0, by_motion_n: 0.0 });
    }
    let restarted = |change: &dyn Fn(&mut StoredState)| {
        let mut stored = stored_state(&bench.memory);
        change(&mut stored);
        let mut again = restored_bench(&bench, &stored, NS_PER_S);
        again.disturbance.zero_n = 18.0;
        again.hold(&person, &postures()[0], None, 1000);
        assert!(!again.state().validity().any_of(Validity::INVALIDATES_DELTA_F));
        let is_loaded = !again.state().validity().any_of(Validity::BELOW_LOAD_THRESHOLD);
        (is_loaded, again.state().delta_f_n[2], again.memory.ground.force_offset.mean_sigma_n())
    };
    let (is_loaded, delta_f_n, sigma_n) = restarted(&|_| {});
    assert!(!is_loaded && delta_f_n.abs() < 1.0, "{delta_f_n}");
    assert!((4.9..5.0).contains(&sigma_n), "that of a mass of another source: {sigma_n}");
    assert_eq!(restarted(&|stored| stored.force_offset.sigma_n = 20.0).2.round(), 20.0);
    // Another mass; not finite; larger than any drift; a negative σ.
    assert!(restarted(&|stored| stored.force_offset.mass_kg += 1.0).1 > 17.0);
    assert!(restarted(&|stored| stored.force_offset.mean_n = f64::NAN).1 > 17.0);
    assert!(restarted(&|stored| stored.force_offset.mean_n = 1e3).1 > 17.0);
    assert!(restarted(&|stored| stored.force_offset.sigma_n = -1.0).1 > 17.0);
}

#[test]
fn a_mass_weighed_on_insoles_is_as_uncertain_on_a_plate_as_the_insoles() {
    let (person, mut bench) = (Person::real(), Bench::new(|settings| settings.mass_kg = None));
    let posture = postures()[0];
    bench.disturbance.devices = GroundDevice::Insoles as u32;
    bench.hold(&person, &posture, None, 3000);
    let mut stored = stored_state(&bench.memory);
    assert!((stored.subject.mass_kg - MASS_KG).abs() < 0.1, "{}", stored.subject.mass_kg);
    let insoles_n = bench.settings.insole_force_sigma_n;
    assert!((stored.subject.mass_sigma_kg - insoles_n / GRAVITY_M_PER_S2).abs() < 1e-9);
    // Insoles with a gain error of 2 %.
    stored.subject.mass_kg *= 1.02;
    let on_a_plate = |stored: &StoredState, milliseconds| {
        let mut again = restored_bench(&bench, stored, NS_PER_S);
        again.disturbance.devices = GroundDevice::Plate as u32;
        again.hold(&person, &posture, None, milliseconds);
        again
    };
    let weighed_again = on_a_plate(&stored, 5000).memory.identification.mass_kg;
    assert!((weighed_again - MASS_KG).abs() < 0.2, "{weighed_again}");
    stored.subject.identified = 1;
    let again = on_a_plate(&stored, 300);
    let (off_n, sigma_n) = (again.state().delta_f_n[2], again.state().delta_f_sigma_n);
    assert!(off_n < -10.0 && off_n.abs() < 2.0 * sigma_n, "{off_n} {sigma_n}");
    let kept = stored_state(&again.memory).subject.mass_sigma_kg;
    assert!((kept - stored.subject.mass_sigma_kg).abs() < 1e-9, "over another start: {kept}");
}

#[test]
fn unsound_data_are_not_restored() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.hold(&person, &postures()[0], None, 900);
    let stored = stored_state(&bench.memory);
    let mut fits = |damage: &dyn Fn(&mut StoredState)| {
        let mut stored = stored.clone();
        damage(&mut stored);
        let subject = bench.memory.identification.restore(&stored.subject, &bench.settings);
        subject
            && bench.memory.resume_tare(&stored.tare)
            && bench.memory.resume_registration(&stored.registration, &bench.settings)
    };
    assert!(fits(&|_| {}));
    assert!(!fits(&|stored| stored.subject.has_body = 0));
    assert!(!fits(&|stored| stored.subject.skeleton_m[3][1] = 4.0));
    assert!(!fits(&|stored| stored.subject.mass_kg = f64::NAN));
    assert!(!fits(&|stored| stored.subject.filter.add_process_noise(2, f64::INFINITY)));
    assert!(!fits(&|stored| stored.subject.filter.add_process_noise(2, -1.0)));
    assert!(fits(&|stored| stored.subject.filter.add_process_noise(2, 100.0)), "without a prior, inflated");
    assert!(!fits(&|stored| stored.subject.filter.add_process_noise(2, 300.0)));
    let displaced = |stored: &mut StoredState, metres: f64| {
        let filter = &mut stored.subject.filter;
        let count = filter.count();
        let mut theta_m = filter.theta_m()[..count].to_vec();
        theta_m[2] += metres;
        let rows = (0..count).map(|row| filter.covariance_row_m2(row).to_vec());
        let covariance_m2 = rows.collect::<Vec<_>>().concat();
        assert!(filter.restore(&theta_m, &covariance_m2), "finite and consistent");
    };
    assert!(fits(&|stored| displaced(stored, 0.5)));
    assert!(!fits(&|stored| displaced(stored, 4.0)), "no parameter is longer than the body");
    assert!(!fits(&|stored| stored.subject.misfit_m2[1] = 101.0));
    assert!(!fits(&|stored| stored.subject.consistency.nis = 1e10));
    assert!(!fits(&|stored| stored.subject.consistency.recent[4] = f64::NAN));
    assert!(!fits(&|stored| stored.subject.consistency.inflation = 101.0));
    assert!(!fits(&|stored| stored.subject.consistency.inflation = 0.5));
    assert!(!fits(&|stored| stored.subject.performed = Performed::of(1, [[4.0; PARAMETERS]].into_iter())));
    assert!(!fits(&|stored| stored.subject.poses_used = u64::MAX));
    assert!(!fits(&|stored| stored.subject.consistency.tested = 7));
    assert!(!fits(&|stored| stored.subject.consistency.recent_count = u64::MAX));
    assert!(!fits(&|stored| stored.subject.last_pose_wxyz[0][0] = f64::NAN));
    assert!(!fits(&|stored| stored.tare.moment_nm[1] = f64::NAN));
    assert!(!fits(&|stored| stored.tare.foot_vertical_n[0] = -2e6));
    assert!(!fits(&|stored| stored.registration.station_from_suit_rad = 3.2));
    assert!(!fits(&|stored| stored.registration.station_from_suit_m[0] = f64::NAN));
    assert!(!fits(&|stored| stored.registration.station_from_suit_sigma_m[1] = f64::NAN));
    assert!(!fits(&|stored| stored.registration.suit_time_ns = 0));
}

#[test]
fn a_reload_before_the_first_measurement_sets_the_prior_of_its_settings() {
    let (person, mut bench) = (Person::real(), Bench::new(|settings| settings.start_identifying = false));
    bench.hold(&person, &postures()[0], None, 400);
    assert!(bench.memory.identification.has_body());
    let male = bench.memory.identification.anthropometry().mass_fraction;
    bench.settings.sex = match bench.settings.sex {
        crate::body::Sex::Male => crate::body::Sex::Female,
        _ => crate::body::Sex::Male,
    };
    bench.command(CommandKind::Reload);
    assert_ne!(bench.memory.identification.anthropometry().mass_fraction, male);
}
