//! A model's terms in the loop: their effect on published values and on the filter, their time spans, and that an empty
//! model has no effect.

use super::*;
use crate::body::SEGMENTS;
use crate::effect::{Effect, Model, PARAMETERS_MAX, Place, TERMS_MAX, Term};
use crate::frame::wxyz;

const FOR_EVER_S: [f64; 2] = [0.0, f64::INFINITY];

fn term(effect: Effect, place: Place, shape: f64, value: [f64; PARAMETERS_MAX]) -> Term {
    Term { effect, place, shape, value, span_s: FOR_EVER_S }
}

fn model(some: &[Term]) -> Model {
    let mut terms = [None; TERMS_MAX];
    for (place, term) in terms.iter_mut().zip(some) {
        *place = Some(*term);
    }
    Model { terms, origin_ns: None }
}

fn bench(some: &[Term], change: impl FnOnce(&mut Settings)) -> Bench {
    Bench::new(|settings| {
        settings.model = model(some);
        change(settings);
    })
}

/// A subject who matches the table, with identification disabled and an absolute suit position: neither θ nor a stance
/// offset is updated, so that only the terms differ.
fn bench_with(some: &[Term], change: impl FnOnce(&mut Settings)) -> Bench {
    let mut bench = bench(some, |settings| {
        settings.start_identifying = false;
        settings.suit_drifts = false;
        change(settings);
    });
    bench.hold(&Person::real(), &postures()[0], None, 400);
    bench.command(CommandKind::IdentifyStop);
    bench
}

/// The trunk swings with the arms; the plate reads constant values, with shear if requested.
fn swing(bench: &mut Bench, shear: bool, mut inspect: impl FnMut(&Bench)) {
    let person = Person::real();
    let [from_x_nm, from_y_nm, _] =
        bench.memory.align.alignment.newest_ground().map_or([0.0; 3], |ground| ground.moment_nm);
    for step in 0..4000_u64 {
        bench.now_ns += TICK_NS;
        bench.cycle += 1;
        let turn = core::f64::consts::TAU * 0.5 * (bench.now_ns as f64 * 1e-9);
        let (sine, cosine) = crate::math::sin_cos(turn);
        let mut pose = person.pose(&stand(10, 4, [-40, 0, -30], [40, 0, 30], 20));
        let lean = nalgebra::UnitQuaternion::from_euler_angles(0.08 * cosine, 0.15 * sine, 0.1 * sine);
        for index in 0..SEGMENTS {
            if Segment::ALL[index] <= Segment::LeftHand {
                let arm = pose.origin[index] - pose.origin[0];
                pose.origin[index] = pose.origin[0] + lean * arm;
                pose.world_from_segment[index] = lean * pose.world_from_segment[index];
            }
        }
        // A leap of the force would be rejected.
        let fraction = (step as f64 / 100.0).min(1.0);
        // No plate repeats a value to the last bit.
        let weight_n = MASS_KG * GRAVITY_M_PER_S2 + 1e-9 * (bench.cycle % 2) as f64;
        let push_n = if shear { [10.0 * sine, -6.0 * cosine, weight_n] } else { [0.0, 0.0, weight_n] };
        let ground = GroundSample {
            sample_time_ns: bench.now_ns,
            sequence: bench.cycle,
            force_n: push_n,
            moment_nm: [
                from_x_nm + fraction * (0.03 * weight_n - from_x_nm),
                from_y_nm - fraction * (0.05 * weight_n + from_y_nm),
                0.0,
            ],
            ..Zeroable::zeroed()
        };
        let mut suit: SuitSample = Zeroable::zeroed();
        suit.sample_time_ns = bench.now_ns - 500_000;
        suit.position_m = pose.origin.map(Into::into);
        suit.orientation_wxyz = pose.world_from_segment.map(|rotation| wxyz(&rotation));
        let has_suit = step.is_multiple_of(10);
        let inputs = Inputs {
            suit: if has_suit { core::slice::from_ref(&suit) } else { &[] },
            ground: core::slice::from_ref(&ground),
            body: None,
            command: None,
        };
        let tick = Tick { cycle: bench.cycle, due_ns: bench.now_ns };
        step_of(bench, tick, inputs);
        inspect(bench);
    }
}

fn step_of(bench: &mut Bench, tick: Tick, inputs: Inputs<'_>) {
    step(&bench.settings, &mut bench.memory, tick, inputs);
}

/// Every state of a run: its snapshot's time, estimated CoP and external force.
fn states(bench: &mut Bench, shear: bool) -> Vec<(u64, [f64; 2], f64)> {
    // The external force before the subtraction of the force offset, which depends on earlier forces.
    let (mut all, mut offset_n): (Vec<(u64, [f64; 2], f64)>, f64) = (Vec::new(), 0.0);
    swing(bench, shear, |bench| {
        let estimate = &bench.memory.publication.estimate;
        if all.last().is_none_or(|(time, ..)| *time != estimate.suit_sample_time_ns) {
            all.push((
                estimate.suit_sample_time_ns,
                estimate.cop_estimated_m,
                estimate.delta_f_n[2] + offset_n,
            ));
        }
        offset_n = bench.memory.ground.force_offset.mean_n();
    });
    all
}

/// Reference computed outside the loop for the same motion: the loop's state with a model is the state without it plus
/// columns times values. Uses offset and gain of the plate, whose columns follow from the state.
#[test]
fn the_state_with_a_model_is_the_state_without_it_and_the_columns() {
    for shear in [false, true] {
        let plain = states(&mut bench_with(&[], |_| {}), shear);
        let plate = [
            term(Effect::PlateOffset, Place::Whole, 0.0, [0.011, -0.007, 0.0, 0.0]),
            term(Effect::PlateGain, Place::Whole, 0.0, [0.03, -0.02, 0.0, 0.0]),
            term(Effect::PlateCrosstalk, Place::Whole, 0.0, [0.015, 0.0, 0.0, 0.0]),
        ];
        let with = states(&mut bench_with(&plate, |_| {}), shear);
        assert_eq!(plain.len(), with.len());
        let mut moved = 0.0_f64;
        for ((_, [x, y], force), (_, with_model, force_with)) in plain.iter().zip(&with) {
            let expected = [x + 0.011 + 0.03 * x + 0.015 * y, y - 0.007 - 0.02 * y + 0.015 * x];
            for axis in 0..2 {
                assert!((with_model[axis] - expected[axis]).abs() < 1e-12, "{with_model:?} {expected:?}");
            }
            assert_eq!(force, force_with);
            moved = moved.max((with_model[0] - x).abs());
        }
        assert!(moved > 0.01);
    }
}

/// A mass on the back by the loop, against its weight in the same motion: the acceleration of its position is computed
/// here by explicit differentiation.
#[test]
fn a_worn_mass_weighs_what_its_motion_makes_it_weigh() {
    let worn = [term(Effect::WornMass, Place::Segment(Segment::T8), 0.0, [3.0, 0.0, 0.0, 0.0])];
    for shear in [false, true] {
        let mut plain = bench_with(&[], |_| {});
        let mut places: Vec<(u64, f64)> = Vec::new();
        let (mut forces, mut offset_n) = (Vec::new(), 0.0);
        swing(&mut plain, shear, |bench| {
            if let Some(newest) = bench.memory.history.newest() {
                let table = bench.memory.identification.anthropometry().com_m[Segment::T8.index()];
                if places.last().is_none_or(|(time, _)| *time != newest.time_ns) {
                    places.push((newest.time_ns, newest.pose().point_on(Segment::T8, table).z));
                }
            }
            let estimate = &bench.memory.publication.estimate;
            if forces.last().is_none_or(|(time, _): &(u64, f64)| *time != estimate.suit_sample_time_ns) {
                forces.push((estimate.suit_sample_time_ns, estimate.delta_f_n[2] + offset_n));
            }
            offset_n = bench.memory.ground.force_offset.mean_n();
        });
        let with = states(&mut bench_with(&worn, |_| {}), shear);
        let mut compared = 0;
        let mut heaviest = 0.0_f64;
        for (time_ns, force) in &forces {
            let Some(index) = places.iter().position(|(time, _)| time == time_ns) else { continue };
            if index < 12 || index + 12 >= places.len() {
                continue;
            }
            // Seven samples on each side, as in the loop's window.
            let window: Vec<f64> = (0..15).map(|k| places[index + k - 7].1).collect();
            let up = curvature(&window) / (0.01 * 0.01);
            let (_, _, with_model) = with.iter().find(|(time, ..)| time == time_ns).unwrap();
            let weighs = force - with_model;
            assert!((weighs - 3.0 * (GRAVITY_M_PER_S2 + up)).abs() < 1e-6, "{weighs} {up}");
            heaviest = heaviest.max(up.abs());
            compared += 1;
        }
        assert!(compared > 80 && heaviest > 0.05, "{compared} {heaviest}");
    }
}

/// Second derivative per sample² of the least-squares parabola through samples around the middle one.
fn curvature(values: &[f64]) -> f64 {
    let half = (values.len() / 2) as f64;
    let at = |index: usize| index as f64 - half;
    let n = values.len() as f64;
    let mean_square = (0..values.len()).map(|index| at(index) * at(index)).sum::<f64>() / n;
    let shape = |index: usize| at(index) * at(index) - mean_square;
    let norm: f64 = (0..values.len()).map(|index| shape(index) * shape(index)).sum();
    2.0 * values.iter().enumerate().map(|(index, value)| shape(index) * value).sum::<f64>() / norm
}

#[test]
fn a_term_holds_in_its_span_of_the_stations_time_alone() {
    let mut offset = term(Effect::PlateOffset, Place::Whole, 0.0, [0.01, 0.0, 0.0, 0.0]);
    offset.span_s = [0.6, 1.1];
    let plain = states(&mut bench_with(&[], |_| {}), false);
    // The station's first snapshot: the suit's sample at the first multiple of its period after the start.
    let first_ns = NS_PER_S + SUIT_PERIOD_NS - 500_000;
    // In a recording the suit may begin long after the origin.
    for (origin_ns, zero_ns) in [(None, first_ns), (Some(first_ns + 200_000_000), first_ns + 200_000_000)] {
        let with_origin = |settings: &mut Settings| settings.model.origin_ns = origin_ns;
        let with = states(&mut bench_with(&[offset], with_origin), false);
        let (mut inside, mut outside) = (0, 0);
        for ((time_ns, [plain_x_m, _], _), (_, [with_x_m, _], _)) in plain.iter().zip(&with) {
            let holds = (0.6..1.1).contains(&((*time_ns as f64 - zero_ns as f64) * 1e-9));
            let expected_m = if holds { 0.01 } else { 0.0 };
            assert!((with_x_m - plain_x_m - expected_m).abs() < 1e-12, "{time_ns}");
            (inside, outside) = (inside + u64::from(holds), outside + u64::from(!holds));
        }
        assert!(inside > 30 && outside > 30, "{inside} {outside}");
    }
}

#[test]
fn what_a_term_explains_does_not_bias_theta() {
    let person = Person::real();
    let shifted = |with: &[Term], off_m: f64| {
        let mut bench = bench(with, |_| {});
        for posture in postures() {
            bench.hold_on_a_shifted_plate(&person, &posture, off_m, 700);
        }
        bench
    };
    let clean = shifted(&[], 0.0);
    let explained = shifted(&[term(Effect::PlateOffset, Place::Whole, 0.0, [0.02, 0.0, 0.0, 0.0])], 0.02);
    let swallowed = shifted(&[], 0.02);
    let distance = |bench: &Bench| {
        let theta = bench.memory.identification.filter.theta_m();
        let right = clean.memory.identification.filter.theta_m();
        theta.iter().zip(right).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    assert!(clean.state().poses_used >= 6);
    assert_eq!(clean.state().poses_used, explained.state().poses_used);
    assert!(distance(&explained) < 1e-9, "{}", distance(&explained));
    assert!(distance(&swallowed) > 1e-3, "without the term the body takes it: {}", distance(&swallowed));
}

#[test]
fn a_worn_mass_term_is_no_body_mass() {
    let worn = [term(Effect::WornMass, Place::Segment(Segment::Pelvis), 0.0, [2.0, 0.0, 0.0, 0.0])];
    let mut bench = bench(&worn, |settings| settings.mass_kg = None);
    bench.hold(&Person::real(), &postures()[0], None, 1500);
    assert!((bench.state().mass_kg - (MASS_KG - 2.0)).abs() < 1e-9, "{}", bench.state().mass_kg);
}

/// A suit that is late by 30 ms, with its stamps corrected: snapshots equal those of a suit without lag, and nothing is
/// stale.
#[test]
fn a_late_suit_is_dated_back_at_intake() {
    let plain = states(&mut bench_with(&[], |_| {}), false);
    for tau_s in [0.12, -0.03] {
        let lag = term(Effect::SuitLag, Place::Whole, tau_s, [tau_s, 0.0, 0.0, 0.0]);
        let mut bench = bench_with(&[lag], |_| {});
        let with = states(&mut bench, false);
        let valid = bench.state().validity();
        assert!(!valid.any_of(Validity::SUIT_STALE.and(Validity::GROUND_STALE)), "{tau_s}: {valid:?}");
        let shift_ns = (tau_s * 1e9) as i64;
        let [(plain_ns, ..), (with_ns, ..)] = [plain[100], with[100]];
        assert_eq!((plain_ns as i64 - with_ns as i64 - shift_ns).rem_euclid(SUIT_PERIOD_NS as i64), 0);
    }
}

/// Terms of another model may explain what stance offset and force offset have absorbed: both are uncertain again.
#[test]
fn another_model_makes_what_the_offsets_absorbed_uncertain() {
    let person = Person::real();
    let posture = stand(20, 0, [0, 0, -80], [0, 0, 80], 30);
    let mut bench = bench(&[], |_| {});
    bench.identify(&person);
    bench.command(CommandKind::IdentifyStop);
    let sigmas_after = |bench: &mut Bench, milliseconds| {
        bench.hold(&person, &posture, None, milliseconds);
        let state = bench.state();
        assert!(!state.validity().any_of(Validity::INVALIDATES_DELTA_F), "{:?}", state.validity());
        [state.cop_sigma_m[0], state.delta_f_sigma_n]
    };
    let before = sigmas_after(&mut bench, 20_000);
    bench.command(CommandKind::Reload);
    let same = sigmas_after(&mut bench, 500);
    assert!((0..2).all(|i| same[i] < 1.2 * before[i]), "the same model: {before:?} {same:?}");
    let offset = term(Effect::PlateOffset, Place::Whole, 0.0, [1e-4, 0.0, 0.0, 0.0]);
    bench.settings.model = model(&[offset]);
    bench.command(CommandKind::Reload);
    let [cop_sigma_m, force_sigma_n] = sigmas_after(&mut bench, 300);
    assert!(cop_sigma_m > 2.0 * before[0] && force_sigma_n > 4.0, "{before:?} {cop_sigma_m} {force_sigma_n}");
    let later = sigmas_after(&mut bench, 10_000);
    assert!((0..2).all(|i| later[i] < 2.0 * before[i]), "tracked again: {before:?} {later:?}");
}

/// Half of a measured lag is subtracted by a model from the reload on: force and motion stay paired.
#[test]
fn a_model_with_a_lag_does_not_change_the_measured_one_in_total() {
    let lag = model(&[term(Effect::SuitLag, Place::Whole, 0.02, [0.02, 0.0, 0.0, 0.0])]);
    let mut bench = bench_with(&[], |_| {});
    bench.memory.align.skew.resume(0.04, 0.0);
    let reload = |bench: &mut Bench, model: Model| {
        bench.settings.model = model;
        bench.command(CommandKind::Reload);
        bench.hold(&Person::real(), &postures()[0], None, 300);
        bench.memory.align.skew.lag_s()
    };
    assert!((reload(&mut bench, lag) - 0.02).abs() < 1e-9);
    assert!(bench.memory.align.skew.lag_sigma_s() > 0.0, "it was not measured again");
    let mut stored = bytemuck::zeroed_box::<StoredState>();
    stored.copy_from(&bench.memory, &bench.settings);
    for (model, lag_s) in [(lag, 0.02), (Model::default(), 0.04)] {
        let mut again = Bench::new(|settings| settings.model = model);
        assert!(again.memory.resume_registration(&stored.registration, &again.settings));
        assert!((again.memory.align.skew.lag_s() - lag_s).abs() < 1e-9);
    }
    assert!((reload(&mut bench, Model::default()) - 0.04).abs() < 1e-9);

    // Without a measurement the lag of the model applies.
    bench.memory.align.skew.resume(0.0, 0.0);
    assert_eq!(reload(&mut bench, lag), 0.0);
    stored.copy_from(&bench.memory, &bench.settings);
    assert_eq!(stored.registration.suit_lag_s, 0.0);
}

/// A plate with a low pass: the estimate follows the prediction, delayed by the filter's time constant.
#[test]
fn a_low_pass_term_delays_and_attenuates_the_prediction() {
    let cutoff_hz = 0.5;
    let low = [term(Effect::PlateLowpass, Place::Whole, cutoff_hz, [cutoff_hz, 0.0, 0.0, 0.0])];
    let plain = states(&mut bench_with(&[], |_| {}), false);
    let with = states(&mut bench_with(&low, |_| {}), false);
    let swing = |all: &[(u64, [f64; 2], f64)]| {
        let last = all[all.len() - 200..].iter().map(|(_, [x, _], _)| *x);
        last.clone().fold(f64::MIN, f64::max) - last.fold(f64::MAX, f64::min)
    };
    // The swing is at the cutoff: a first-order filter outputs 1/√2 of it.
    let ratio = swing(&with) / swing(&plain);
    assert!((0.66..0.75).contains(&ratio), "{ratio}");
}

#[test]
fn a_load_term_causes_no_overload() {
    let person = Person::real();
    let posture = stand(20, 0, [0, 0, -80], [0, 0, 80], 30);
    let lifted = lifted_box(&person, &posture);
    let with_model = |with: &[Term]| {
        let mut bench = bench(with, |settings| settings.model = Model::default());
        bench.identify(&person);
        bench.settings.model = model(with);
        bench.hold(&person, &posture, Some((4.0, lifted)), 600);
        *bench.state()
    };
    let without = with_model(&[]);
    assert!(!without.validity().any_of(Validity::BELOW_LOAD_THRESHOLD));
    let with = with_model(&[term(Effect::HandLoad, Place::BothHands, 0.0, [4.0, 0.0, 0.0, 0.0])]);
    assert!(with.validity().any_of(Validity::BELOW_LOAD_THRESHOLD));
    assert!(with.delta_f_n[2].abs() < 1e-9, "{}", with.delta_f_n[2]);
    // The box lies at the middle of the grips of the true body; the table's grips are the term's.
    assert!(
        cop_error_m(&with) < 0.2 * cop_error_m(&without),
        "{} {}",
        cop_error_m(&with),
        cop_error_m(&without)
    );
}

/// The last output of the plate's low pass is half a metre away after a new registration.
#[test]
fn a_new_registration_restarts_the_low_pass() {
    let person = Person::real();
    let posture = stand(20, 0, [0, 0, -80], [0, 0, 80], 30);
    let mut bench = bench(&[], |_| {});
    bench.identify(&person);
    bench.settings.model = model(&[term(Effect::PlateLowpass, Place::Whole, 0.5, [0.5, 0.0, 0.0, 0.0])]);
    bench.hold(&person, &posture, None, 3000);
    let heading_sigma_rad = bench.settings.suit_orientation_sigma_rad();
    // As after a long silence of the suit, with the filter at the place of the drifted body.
    bench.memory.placement.registration.mark_lost(heading_sigma_rad);
    bench.memory.placement.displace([0.5, 0.0]);
    bench.memory.clear_windows();
    bench.memory.prediction.terms.restart();
    let (mut was_lost, mut compared) = (false, 0);
    for _ in 0..10_000 {
        bench.hold(&person, &posture, None, 1);
        was_lost |= bench.memory.placement.registration.is_lost();
        if !bench.state().validity().any_of(Validity::INVALIDATES_RESIDUAL) {
            compared += 1;
            assert!(cop_error_m(bench.state()) < 0.05, "{}", cop_error_m(bench.state()));
        }
        if compared == 1000 {
            break;
        }
    }
    assert!(was_lost && compared == 1000, "{was_lost} {compared}");
}
