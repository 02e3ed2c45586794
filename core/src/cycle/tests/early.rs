//! The early state: its age, agreement with the state, masks, and that it changes no other stage.

use super::*;
use crate::message::EarlyState;

/// An identified subject, with enough comparisons, then a load.
fn carrying(bench: &mut Bench, person: &Person) -> Posture {
    let posture = stand(20, 0, [0, 0, -80], [0, 0, 80], 30);
    bench.hold(person, &posture, None, 2500);
    bench.hold(person, &posture, Some((6.0, lifted_box(person, &posture))), 1500);
    posture
}

fn early(bench: &Bench) -> EarlyState {
    *bench.memory.early()
}

#[test]
fn a_held_load_has_the_torques_of_the_state_about_the_newest_sample() {
    let (person, mut bench) = (Person::real(), Bench::identified());
    let posture = carrying(&mut bench, &person);
    let (early, state) = (early(&bench), *bench.state());
    assert_eq!((early.valid, state.valid, early.calibrated), (0, 0, 1), "{:?}", early.validity());
    let behind_ns = early.sample_time_ns - state.suit_sample_time_ns;
    assert_eq!(behind_ns, state.group_delay_ns, "the newest sample");
    assert!(early.time_ns - early.sample_time_ns <= 10_000_000 && behind_ns >= 70_000_000);
    for (joint, (early_nm, state_nm)) in early.torque_nm.iter().zip(&state.torque_nm).enumerate() {
        let off = (Vector3::from(*early_nm) - Vector3::from(*state_nm)).norm();
        assert!(off < 0.1, "joint {joint}: {off} N m");
        assert!(early.torque_sigma_nm[joint] >= state.torque_sigma_nm[joint]);
    }
    assert!((early.delta_f_n[2] - state.delta_f_n[2]).abs() < 0.1);
    let pose = person.pose(&posture);
    for side in Side::BOTH {
        let grip = pose.point_on(side.hand(), person.body.grip_m(side.hand()));
        let at = Vector3::from(early.hand_m[side as usize]);
        assert!(
            (at - grip).norm() < 0.02
                && Vector3::from(early.hand_velocity_m_per_s[side as usize]).norm() < 1e-6
        );
    }
}

#[test]
fn a_released_load_is_masked_before_the_state_reports_it() {
    let (person, mut bench) = (Person::real(), Bench::identified());
    let posture = carrying(&mut bench, &person);
    bench.takes_ms = 10.0;
    let mut masked = None;
    for millisecond in 1..200 {
        bench.hold(&person, &posture, None, 1);
        let is_early = early(&bench).validity().any_of(Validity::INVALIDATES_TORQUES);
        if masked.is_none() && is_early {
            masked = Some(millisecond);
            assert!(!bench.state().validity().any_of(Validity::INVALIDATES_TORQUES), "the state lags");
            assert_eq!(early(&bench).torque_nm, [[0.0; 3]; 22]);
        }
    }
    assert!(masked.is_some_and(|after| after < 60), "{masked:?}");
}

#[test]
fn no_value_is_valid_before_a_comparison_or_with_a_silent_sensor() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    let posture = stand(20, 0, [0, 0, -80], [0, 0, 80], 30);
    bench.hold(&person, &posture, None, 300);
    assert!(early(&bench).validity().any_of(Validity::MOVING) && early(&bench).calibrated == 0);
    assert_eq!(early(&bench).cop_estimated_m, [0.0; 2]);
    bench.identify(&person);
    carrying(&mut bench, &person);
    bench.suit_silent = true;
    bench.hold(&person, &posture, None, 200);
    let silent = early(&bench);
    assert!(silent.validity().any_of(Validity::SUIT_STALE));
    assert_eq!((silent.torque_nm, silent.com_m, silent.hand_m), ([[0.0; 3]; 22], [0.0; 3], [[0.0; 3]; 2]));
}

#[test]
fn a_memory_without_early_estimates_gives_the_same_states() {
    let (person, mut bench, mut without) = (Person::real(), Bench::identified(), Bench::identified());
    let posture = stand(20, 0, [0, 0, -80], [0, 0, 80], 30);
    for _ in 0..50 {
        without.memory.early = Zeroable::zeroed();
        for bench in [&mut bench, &mut without] {
            bench.hold(&person, &posture, Some((6.0, lifted_box(&person, &posture))), 20);
        }
        assert_eq!(bytemuck::bytes_of(bench.state()), bytemuck::bytes_of(without.state()));
    }
    assert_ne!(bytemuck::bytes_of(&bench.memory.early), bytemuck::bytes_of(&without.memory.early));
}
