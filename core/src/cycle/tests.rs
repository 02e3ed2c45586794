//! Whole cycles on a bench: identification, published and withheld values, rejected samples, and byte-identical
//! repetition.

extern crate std;
use std::boxed::Box;
use std::vec;
use std::vec::Vec;

use bytemuck::Zeroable;
use nalgebra::Vector3;

use super::*;
use crate::GRAVITY_M_PER_S2;
use crate::body::{Joint, Segment, Side};
use crate::message::Validity;
use crate::message::state::Phase;
use crate::pose_suggestion::Posture;

pub(super) mod bench;
mod early;
mod exposure;
mod filter_updates;
mod latency;
mod masks;
mod model_terms;
mod not_measured;
mod planning;
mod pose_request;
mod reported_body;
mod resets;
mod sharing;
mod shear;
mod stages;
mod stored_state;
mod tare;
use bench::*;

fn lifted_box(person: &Person, posture: &Posture) -> Vector3<f64> {
    let pose = person.pose(posture);
    let grip = Side::BOTH.map(|side| pose.point_on(side.hand(), person.body.grip_m(side.hand())));
    0.5 * (grip[0] + grip[1])
}

fn cop_error_m(state: &State) -> f64 {
    let error = [0, 1].map(|axis| state.cop_measured_m[axis] - state.cop_estimated_m[axis]);
    (error[0] * error[0] + error[1] * error[1]).sqrt()
}

#[test]
fn identification_corrects_the_table() {
    let (person, mut bench) = (Person::real(), Bench::new(|settings| settings.start_identifying = false));
    let posture = stand(35, 0, [0, 0, -80], [0, 0, 80], 20);
    bench.hold(&person, &posture, None, 400);
    let before = cop_error_m(bench.state());
    assert_eq!(bench.phase(), Phase::Waiting);
    bench.command(CommandKind::IdentifyStart);
    bench.hold(&person, &posture, None, 20);
    assert_eq!(bench.phase(), Phase::Identifying);
    bench.identify(&person);
    bench.hold(&person, &posture, None, 400);
    assert_eq!(bench.phase(), Phase::Monitoring, "σ {}", bench.state().predicted_cop_sigma_m);
    assert!(before > 0.01, "the table should be wrong: {before}");
    assert!(cop_error_m(bench.state()) < 0.004, "{}", cop_error_m(bench.state()));
    assert!(bench.state().poses_used >= 6);
}

#[test]
fn a_box_overloads_the_joints_that_carry_it() {
    let (person, mut bench) = (Person::real(), Bench::identified());
    let posture = stand(20, 0, [0, 0, -80], [0, 0, 80], 30);
    let at = lifted_box(&person, &posture);
    bench.hold(&person, &posture, Some((4.0, at)), 600);
    let state = bench.state();
    assert!(!state.validity().any_of(Validity::INVALIDATES_TORQUES), "{:?}", state.validity());
    assert!((state.delta_f_n[2] - 4.0 * GRAVITY_M_PER_S2).abs() < 1e-6);
    let pose = person.pose(&posture);
    for (name, fraction) in [("LeftElbow", 0.5), ("RightShoulder", 0.5)] {
        let joint = Joint::named(name).unwrap();
        let arm = at - pose.origin_of(joint.segment());
        // The true torque about the lateral axis; the load's position along it is determined by the two CoPs.
        let truth = -arm.x * fraction * 4.0 * GRAVITY_M_PER_S2;
        let published = state.torque_nm[joint.index()][1];
        assert!((published - truth).abs() < 0.15 * truth.abs() + 0.2, "{name}: {published} {truth}");
    }
    assert!((state.foot_load_fraction[0] + state.foot_load_fraction[1] - 1.0).abs() < 1e-12);
    assert!((state.hand_load_fraction[0] + state.hand_load_fraction[1] - 1.0).abs() < 1e-12);
}

#[test]
fn an_unloaded_worker_has_no_overload() {
    let bench = Bench::identified();
    let state = bench.state();
    assert!(state.validity().any_of(Validity::BELOW_LOAD_THRESHOLD));
    assert_eq!(state.torque_nm, [[0.0; 3]; 22]);
}

#[test]
fn a_held_pose_is_used_once() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.hold(&person, &postures()[3], None, 3000);
    assert_eq!(bench.state().poses_used, 1);
    assert_eq!(bench.state().static_pose, 1);
}

#[test]
fn a_pose_with_a_load_does_not_update_the_filter() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.hold(&person, &postures()[3], Some((8.0, Vector3::new(0.3, 0.0, 1.0))), 1000);
    assert_eq!(bench.state().poses_used, 0);
}

#[test]
fn a_silent_sensor_degrades_and_its_return_restores() {
    let (person, mut bench) = (Person::real(), Bench::identified());
    let posture = stand(20, 0, [0, 0, -80], [0, 0, 80], 30);
    let poses = bench.state().poses_used;

    bench.suit_silent = true;
    bench.hold(&person, &posture, None, 200);
    assert_eq!(bench.phase(), Phase::Degraded);
    assert!(bench.state().validity().any_of(Validity::SUIT_STALE));
    assert!(!bench.state().validity().any_of(Validity::INVALIDATES_COP_MEASURED), "the plate still measures");
    assert_ne!(bench.state().cop_measured_m, [0.0; 2]);
    assert_eq!(bench.state().cop_estimated_m, [0.0; 2]);

    bench.suit_silent = false;
    bench.hold(&person, &posture, None, 500);
    assert_eq!(bench.phase(), Phase::Monitoring);

    bench.ground_silent = true;
    bench.hold(&person, &posture, None, 300);
    assert_eq!(bench.phase(), Phase::Degraded);
    assert!(bench.state().validity().any_of(Validity::GROUND_STALE));
    assert_eq!(bench.state().cop_measured_m, [0.0; 2]);
    assert!(!bench.state().validity().any_of(Validity::INVALIDATES_COP_ESTIMATED), "the suit still measures");

    bench.ground_silent = false;
    bench.hold(&person, &posture, None, 500);
    assert_eq!(bench.phase(), Phase::Monitoring);
    assert_eq!(bench.state().poses_used, poses);
}

#[test]
fn a_subject_that_was_reset_is_waiting_and_not_degraded() {
    let (person, mut bench) = (Person::real(), Bench::new(|settings| settings.mass_kg = None));
    bench.hold(&person, &postures()[0], None, 1500);
    bench.identify(&person);
    assert_eq!(bench.phase(), Phase::Monitoring);
    bench.command(CommandKind::IdentifyReset);
    assert!(bench.state().validity().any_of(Validity::MASS_UNKNOWN));
    assert_eq!(bench.phase(), Phase::Waiting);
    bench.suit_silent = true;
    bench.hold(&person, &postures()[0], None, 300);
    assert_eq!(bench.phase(), Phase::Degraded);
}

#[test]
fn the_first_snapshots_of_an_available_body_are_no_leap() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    let mut published = 0;
    for _ in 0..1500 {
        bench.hold(&person, &postures()[0], None, 1);
        let state = bench.state();
        let invalid = Validity::INVALIDATES_DELTA_F.and(Validity::INVALIDATES_COM);
        if !state.validity().any_of(invalid) {
            published += 1;
            assert!(state.delta_f_n[2].abs() < 10.0, "{} N without a load", state.delta_f_n[2]);
            assert!(state.com_m[2] > 0.5, "a centre of mass at {:?}", state.com_m);
            let [cop_x_m, cop_y_m] = state.cop_estimated_m;
            assert!(cop_x_m != 0.0 || cop_y_m != 0.0, "no estimate was made");
        }
    }
    assert!(published > 500, "{published}");
}

#[test]
fn values_of_the_plate_before_a_silence_are_not_published_after_it() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    let posture = stand(20, 0, [0, 0, -80], [0, 0, 80], 30);
    bench.hold(&person, &posture, None, 1000);
    let at = lifted_box(&person, &posture);
    bench.ground_silent = true;
    bench.hold(&person, &posture, Some((10.0, at)), 1000);
    bench.ground_silent = false;
    let (expected_n, mut published) = ((MASS_KG + 10.0) * GRAVITY_M_PER_S2, 0);
    for _ in 0..500 {
        bench.hold(&person, &posture, Some((10.0, at)), 1);
        if !bench.state().validity().any_of(Validity::INVALIDATES_GROUND_FORCE) {
            published += 1;
            let published_n = bench.state().ground_force_n[2];
            assert!((published_n - expected_n).abs() < 1.0, "{published_n} N of {expected_n} N");
        }
    }
    assert!(published > 200, "{published}");
}

#[test]
fn staleness_is_reported_within_two_periods_and_the_tolerance() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.hold(&person, &postures()[0], None, 500);
    bench.suit_silent = true;
    let allowed_ms = (2 * SUIT_PERIOD_NS + STALE_TOLERANCE_NS) / TICK_NS;
    bench.hold(&person, &postures()[0], None, allowed_ms + SUIT_PERIOD_NS / TICK_NS + 2);
    assert!(bench.state().validity().any_of(Validity::SUIT_STALE));
}

#[test]
fn the_mass_is_measured_where_it_is_not_configured() {
    let (person, mut bench) = (Person::real(), Bench::new(|settings| settings.mass_kg = None));
    bench.hold(&person, &postures()[1], None, 1000);
    assert!(bench.state().validity().any_of(Validity::MASS_UNKNOWN), "too short to estimate its error");
    bench.hold(&person, &postures()[1], None, 500);
    assert!((bench.state().mass_kg - MASS_KG).abs() < 1e-9);
}

#[test]
fn the_papers_rule_is_met_by_the_table_and_not_without_a_prior() {
    // 0.002 m² is a standard deviation of 45 mm: the table alone is more accurate.
    let paper = StopRule::Paper { variance_m2: 0.002 };
    let person = Person::real();
    let mut with_table = Bench::new(|settings| settings.stop = paper);
    with_table.identify(&person);
    assert_eq!(u64::from(with_table.state().poses_used), with_table.settings.poses_min);

    // These poses never move the legs apart, so their parameters stay undetermined.
    let mut without_prior = Bench::new(|settings| {
        settings.stop = paper;
        settings.prior = PriorKind::None;
    });
    without_prior.identify(&person);
    assert_eq!(without_prior.phase(), Phase::Identifying);
    assert!(without_prior.state().variance_max_m2 > 0.002);
    without_prior.command(CommandKind::IdentifyStop);
    assert!(without_prior.state().validity().any_of(Validity::MODEL_CHANGED));
    without_prior.hold(&person, &postures()[0], None, 20);
    assert_eq!(without_prior.phase(), Phase::Monitoring);
}

#[test]
fn the_same_inputs_give_the_same_bytes_from_a_checkpoint_too() {
    let (person, mut one, mut other) = (Person::real(), Bench::new(|_| {}), Bench::new(|_| {}));
    one.identify(&person);
    other.identify(&person);
    assert_eq!(bytemuck::bytes_of(one.state()), bytemuck::bytes_of(other.state()));

    let mut checkpoint = bytemuck::zeroed_box::<Checkpoint>();
    checkpoint.take(one.cycle, &one.memory);
    other.memory.start(&other.settings);
    *other.memory = *checkpoint.memory().unwrap();
    let posture = stand(10, 3, [0, 0, -40], [0, 0, 80], 10);
    one.hold(&person, &posture, None, 700);
    other.hold(&person, &posture, None, 700);
    assert_eq!(bytemuck::bytes_of(&*one.memory), bytemuck::bytes_of(&*other.memory));
}

#[test]
fn a_lag_that_is_found_after_the_identification_keeps_the_mass() {
    let (person, mut bench) = (Person::real(), Bench::new(|settings| settings.mass_kg = None));
    bench.hold(&person, &postures()[0], None, 1500);
    bench.identify(&person);
    let mass_kg = bench.memory.identification.mass_kg;
    assert!(mass_kg > 0.0, "weighed");
    let settings = bench.settings;
    reset_unaligned(&settings, &mut bench.memory, true);
    let subject = &bench.memory.identification;
    assert_eq!((subject.mass_kg, subject.identified), (mass_kg, 1));
    bench.memory.identification.identified = 0;
    reset_unaligned(&settings, &mut bench.memory, true);
    assert_eq!(bench.memory.identification.mass_kg, 0.0, "during the identification it is weighed again");
}

#[test]
fn a_checkpoint_without_bone_lengths_can_be_resumed() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    for milliseconds in [0, 50, 100] {
        bench.hold(&person, &postures()[0], None, milliseconds);
        let mut checkpoint = bytemuck::zeroed_box::<Checkpoint>();
        checkpoint.take(bench.cycle, &bench.memory);
        assert!(!bench.memory.identification.has_body() && checkpoint.memory().is_some());
    }
}

#[test]
fn a_damaged_checkpoint_is_refused() {
    let bench = Bench::identified();
    let mut checkpoint = bytemuck::zeroed_box::<Checkpoint>();
    let mut is_sound = |damage: &dyn Fn(&mut Memory)| {
        let mut memory = Box::new(*bench.memory);
        damage(&mut memory);
        checkpoint.take(1, &memory);
        checkpoint.memory().is_some()
    };
    assert!(is_sound(&|_| {}));
    assert!(!is_sound(&|memory| memory.version += 1));
    assert!(!is_sound(&|memory| memory.identification.mass_kg = f64::NAN));
    assert!(!is_sound(&|memory| memory.identification.reduction.count = 70));
    assert!(!is_sound(&|memory| memory.align.tare.force_n[2] = f64::INFINITY));
    let flat = |memory: &mut Memory| {
        let subject = &mut memory.identification;
        let count = subject.filter.count();
        subject.filter.restore(&vec![0.0; count], &vec![0.0; count * count]);
    };
    assert!(!is_sound(&flat), "a filter that is sure of everything");
    let crooked = |memory: &mut Memory| {
        let subject = &mut memory.identification;
        let count = subject.filter.count();
        let mut covariance: Vec<f64> =
            (0..count * count).map(|at| f64::from(u8::from(at % (count + 1) == 0))).collect();
        covariance[1] = 0.5;
        subject.filter.restore(&vec![0.0; count], &covariance);
    };
    assert!(!is_sound(&crooked), "a covariance that is not symmetric");

    // After damage to any word, the checkpoint is rejected or runs without a panic.
    let mut checkpoint = bytemuck::zeroed_box::<Checkpoint>();
    checkpoint.take(1, &bench.memory);
    for word in (0..checkpoint.words.len()).step_by(97) {
        for value in [u64::MAX, 1 << 52, f64::MAX.to_bits()] {
            let mut damaged = checkpoint.clone();
            damaged.words[word] = value;
            if let Some(memory) = damaged.memory() {
                let mut memory = Box::new(*memory);
                let tick = Tick { cycle: 2, due_ns: bench.now_ns + TICK_NS };
                step(&bench.settings, &mut memory, tick, Inputs::default());
            }
        }
    }
}

#[test]
fn nothing_is_valid_before_the_first_samples() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.hold(&person, &postures()[0], None, 50);
    assert!(bench.state().validity().any_of(Validity::INVALIDATES_COP_ESTIMATED));
    bench.hold(&person, &postures()[0], None, 400);
    assert!(!bench.state().validity().any_of(Validity::INVALIDATES_COP_ESTIMATED));
}

#[test]
fn torques_return_with_their_values_when_a_flag_clears() {
    let (person, mut bench) = (Person::real(), Bench::identified());
    let posture = stand(20, 0, [0, 0, -80], [0, 0, 80], 30);
    let at = lifted_box(&person, &posture);
    bench.hold(&person, &posture, Some((6.0, at)), 400);
    bench.command(CommandKind::IdentifyStop);
    for _ in 0..1500 {
        bench.hold(&person, &posture, Some((6.0, at)), 1);
        if !bench.state().validity().any_of(Validity::INVALIDATES_TORQUES) {
            assert_ne!(bench.state().torque_nm[0], [0.0; 3], "a valid torque that is nothing");
        }
    }
    assert!(!bench.state().validity().any_of(Validity::INVALIDATES_TORQUES));
}

#[test]
fn a_suit_that_returns_alone_is_stale_until_processed() {
    let (person, mut bench) = (Person::real(), Bench::identified());
    (bench.suit_silent, bench.ground_silent) = (true, true);
    bench.hold(&person, &postures()[0], None, 300);
    bench.suit_silent = false;
    for _ in 0..200 {
        bench.hold(&person, &postures()[0], None, 1);
        if !bench.state().validity().any_of(Validity::INVALIDATES_COM) {
            assert_ne!(bench.state().com_m, [0.0; 3]);
        }
    }
}

#[test]
fn a_subject_with_a_box_on_one_foot_is_not_weighed() {
    let (person, mut bench) = (Person::real(), Bench::new(|settings| settings.mass_kg = None));
    bench.hold(&person, &postures()[0], Some((400.0, Vector3::new(0.05, 0.0, 1.0))), 1500);
    assert!(bench.state().validity().any_of(Validity::MASS_UNKNOWN), "no worker weighs 472 kg");
    bench.command(CommandKind::IdentifyReset);
    bench.hold(&person, &postures()[1], Some((20.0, Vector3::new(0.05, 0.0, 1.0))), 4000);
    assert!(bench.state().mass_kg > 90.0, "a box in the hands cannot be distinguished from a heavy worker");
    bench.hold(&person, &postures()[2], None, 300);
    bench.command(CommandKind::IdentifyReset);
    bench.hold(&person, &postures()[2], None, 1500);
    assert!((bench.state().mass_kg - MASS_KG).abs() < 1e-9, "but it can be weighed again");
}

#[test]
fn bad_samples_change_nothing() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.hold(&person, &postures()[0], None, 500);
    let before = Box::new(*bench.memory);
    let mut to_come = bench.memory.align.alignment.newest_ground().copied().unwrap();
    to_come.sample_time_ns = bench.now_ns + 3_600 * NS_PER_S;
    let mut far_away = *bench.memory.align.alignment.newest_suit().unwrap();
    far_away.sample_time_ns = bench.now_ns + 1;
    far_away.position_m[3][0] = 1e30;
    let mut suit: SuitSample = Zeroable::zeroed();
    suit.sample_time_ns = bench.now_ns + 1;
    let mut ground: GroundSample = Zeroable::zeroed();
    ground.sample_time_ns = bench.now_ns + 1;
    ground.force_n[0] = f64::NAN;
    let inputs = Inputs { suit: &[suit, far_away], ground: &[ground, to_come], body: None, command: None };
    step(&bench.settings, &mut bench.memory, Tick { cycle: bench.cycle + 1, due_ns: bench.now_ns }, inputs);
    let after = &bench.memory.align.alignment;
    assert_eq!(after.refused(), before.align.alignment.refused() + 4);
    assert_eq!(after.newest_suit(), before.align.alignment.newest_suit());
    assert_eq!(after.newest_ground(), before.align.alignment.newest_ground());
    assert_eq!(bytemuck::bytes_of(&before.identification), bytemuck::bytes_of(&bench.memory.identification));
}
