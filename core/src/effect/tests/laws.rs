use nalgebra::{Rotation2, Vector2, Vector3};

use super::body::{BODY_KG, Body, FLOOR_M, Path, Reaction, SuitError, second, sine};
use crate::body::{Segment, Side};
use crate::effect::{
    Columns, Effect, Observation, PARAMETERS_MAX, Place, Term, columns, misaligned_by_factor,
};
use crate::message::GroundSample;
use crate::sesc::Phi;

const TIMES_S: [f64; 3] = [0.2, 0.9, 1.7];

fn phi(body: &Body) -> Phi {
    Phi::of(&body.skeleton, &body.table)
}

/// Residual after subtracting the columns times `value` from measured minus predicted: of the CoP, m; of the force, N
/// (z, and its horizontal part, which the prediction by the suit must explain too).
fn left_over(o: &Observation, columns: &Columns, value: [f64; PARAMETERS_MAX]) -> (f64, f64) {
    let (cop, force) = columns.times(&value);
    let cop = (0..2).map(|axis| (o.cop_measured_m[axis] - o.cop_predicted_m[axis] - cop[axis]).abs());
    let force = (0..3).map(|axis| (o.force_measured_n[axis] - o.force_predicted_n[axis] - force[axis]).abs());
    (cop.fold(0.0, f64::max), force.fold(0.0, f64::max))
}

/// The residual without any column.
fn gap(o: &Observation) -> f64 {
    left_over(o, &Columns::zero(1), [0.0; PARAMETERS_MAX]).0
}

fn nothing_is_left(o: &Observation, columns: &Columns, value: [f64; PARAMETERS_MAX], what: &str) {
    let (cop_m, force_n) = left_over(o, columns, value);
    assert!(gap(o) > 1e-4, "{what}: no gap to explain");
    assert!(cop_m < 1e-8 && force_n < 1e-5, "{what}: {cop_m} m, {force_n} N are left");
}

/// First-order check: the residual is small relative to the gap.
fn little_is_left(o: &Observation, columns: &Columns, value: [f64; PARAMETERS_MAX], what: &str) {
    let (cop_m, _) = left_over(o, columns, value);
    let gap_m = gap(o);
    assert!(gap_m > 1e-9 && cop_m < 1e-3 * gap_m, "{what}: {cop_m} m of {gap_m} m are left");
}

#[test]
fn without_an_effect_the_prediction_is_what_is_measured() {
    let body = Body::new();
    for (time_s, shear) in TIMES_S.into_iter().flat_map(|time| [(time, false), (time, true)]) {
        let truth = body.reaction(time_s, &[], None);
        let o = body.observation(time_s, &SuitError::none(), &phi(&body), &truth, shear);
        let (cop_m, force_n) = left_over(&o, &Columns::zero(1), [0.0; PARAMETERS_MAX]);
        assert!(cop_m < 1e-9 && force_n < 1e-5, "{cop_m} {force_n}");
    }
}

/// Exact for any mass: with measured force and slope the equation is linear in the mass.
#[test]
fn a_mass_shifts_the_centre_by_exactly_its_column() {
    let body = Body::new();
    let hand =
        |side: Side| (Effect::HandLoad, Place::Hand(side), side.hand(), body.table.grip_m(side.hand()));
    let worn = |segment: Segment| {
        (Effect::WornMass, Place::Segment(segment), segment, body.table.com_m[segment.index()])
    };
    let cases = [hand(Side::Left), hand(Side::Right), worn(Segment::T8), worn(Segment::RightUpperLeg)];
    for (effect, place, segment, at) in cases {
        for (time_s, shear) in TIMES_S.into_iter().flat_map(|time| [(time, false), (time, true)]) {
            let path: Path = &|t| body.point(t, segment, at.into());
            let truth = body.reaction(time_s, &[(9.0, path)], None);
            let o = body.observation(time_s, &SuitError::none(), &phi(&body), &truth, shear);
            nothing_is_left(&o, &columns(effect, place, 0.0, &o), [9.0, 0.0, 0.0, 0.0], effect.name());
        }
    }
}

/// A mass, and an equal negative one on the other side: no mass, no inertia, first moment alone.
#[test]
fn a_first_moment_shifts_the_centre_by_exactly_its_column() {
    let body = Body::new();
    let (arm, mass_kg) = (Vector3::new(0.11, -0.07, 0.05), 2.0);
    for (time_s, shear) in TIMES_S.into_iter().flat_map(|time| [(time, false), (time, true)]) {
        let centre = Vector3::from(body.table.com_m[Segment::T8.index()]);
        let here: Path = &|t| body.point(t, Segment::T8, centre + arm);
        let there: Path = &|t| body.point(t, Segment::T8, centre - arm);
        let truth = body.reaction(time_s, &[(mass_kg, here), (-mass_kg, there)], None);
        let o = body.observation(time_s, &SuitError::none(), &phi(&body), &truth, shear);
        let moment = 2.0 * mass_kg * arm;
        let value = [0.0, moment.x, moment.y, moment.z];
        nothing_is_left(
            &o,
            &columns(Effect::WornMass, Place::Segment(Segment::T8), 0.0, &o),
            value,
            "moment",
        );
    }
}

#[test]
fn what_both_hands_carry_is_half_in_each() {
    let body = Body::new();
    for (time_s, shear) in TIMES_S.into_iter().flat_map(|time| [(time, false), (time, true)]) {
        let grip = |side: Side| Vector3::from(body.table.grip_m(side.hand()));
        let left: Path = &|t| body.point(t, Side::Left.hand(), grip(Side::Left));
        let right: Path = &|t| body.point(t, Side::Right.hand(), grip(Side::Right));
        let truth = body.reaction(time_s, &[(4.0, left), (4.0, right)], None);
        let o = body.observation(time_s, &SuitError::none(), &phi(&body), &truth, shear);
        let both = columns(Effect::HandLoad, Place::BothHands, 0.0, &o);
        nothing_is_left(&o, &both, [8.0, 0.0, 0.0, 0.0], "both hands");
    }
}

#[test]
fn a_contact_shifts_the_centre_by_exactly_its_columns() {
    let body = Body::new();
    for (time_s, shear) in TIMES_S.into_iter().flat_map(|time| [(time, false), (time, true)]) {
        let grip = Vector3::from(body.table.grip_m(Side::Right.hand()));
        let force = Vector3::new(25.0, -14.0, 60.0);
        let at = body.point(time_s, Side::Right.hand(), grip);
        let truth = body.reaction(time_s, &[], Some((at, force)));
        let o = body.observation(time_s, &SuitError::none(), &phi(&body), &truth, shear);
        let contact = columns(Effect::HandContact, Place::Hand(Side::Right), 0.0, &o);
        nothing_is_left(&o, &contact, [25.0, -14.0, 60.0, 0.0], "contact");
        assert!(contact.force_n[2][2] < 0.0, "a hand that leans on a bench is supported");
    }
}

/// The true φ differs from the model's: the prediction is recomputed with each.
#[test]
fn a_changed_phi_shifts_the_prediction_by_its_columns() {
    let body = Body::new();
    for segment in [Segment::Pelvis, Segment::LeftForearm] {
        for (time_s, shear) in TIMES_S.into_iter().flat_map(|time| [(time, false), (time, true)]) {
            let truth = body.reaction(time_s, &[], None);
            let value = [3e-6, -2e-6, 5e-6, 0.0];
            let mut wrong = phi(&body);
            for (phi, change) in wrong.0[segment.index()].iter_mut().zip(value) {
                *phi -= change;
            }
            let o = body.observation(time_s, &SuitError::none(), &wrong, &truth, shear);
            let changed = columns(Effect::UnbalancedParameters, Place::Segment(segment), 0.0, &o);
            little_is_left(&o, &changed, value, "phi");
        }
    }
}

/// The suit reports a rotated segment: joints are at the positions of rigid bones, and the feet are held.
#[test]
fn a_segment_that_is_read_turned_shifts_the_prediction_by_its_columns() {
    let body = Body::new();
    let segments =
        [Segment::T8, Segment::Pelvis, Segment::RightUpperArm, Segment::LeftUpperLeg, Segment::RightLowerLeg];
    for segment in segments {
        for (time_s, shear) in TIMES_S.into_iter().flat_map(|time| [(time, false), (time, true)]) {
            let truth = body.reaction(time_s, &[], None);
            let place = Place::Segment(segment);
            let mut turned = SuitError::none();
            turned.in_world[segment.index()] = Vector3::new(0.0, 0.0, 1e-5);
            let o = body.observation(time_s, &turned, &phi(&body), &truth, shear);
            let heading = columns(Effect::SegmentHeading, place, 0.0, &o);
            little_is_left(&o, &heading, [1e-5, 0.0, 0.0, 0.0], segment.name());

            let mut crooked = SuitError::none();
            crooked.in_segment[segment.index()] = Vector3::new(1e-5, -2e-5, 1.5e-5);
            let o = body.observation(time_s, &crooked, &phi(&body), &truth, shear);
            let misaligned = columns(Effect::SegmentMisalignment, place, 0.0, &o);
            little_is_left(&o, &misaligned, [1e-5, -2e-5, 1.5e-5, 0.0], segment.name());
        }
    }
}

/// A sensor on soft tissue that moves with the joint: the acceleration of the factor contributes, too.
#[test]
fn a_misalignment_that_changes_with_time_shifts_the_prediction_by_its_columns() {
    let body = Body::new();
    for segment in [Segment::T8, Segment::RightUpperArm, Segment::LeftUpperLeg, Segment::RightLowerLeg] {
        for (time_s, shear) in TIMES_S.into_iter().flat_map(|time| [(time, false), (time, true)]) {
            let truth = body.reaction(time_s, &[], None);
            let mut loose = SuitError { factor: |t| 0.3 + sine(3.0 * t), ..SuitError::none() };
            loose.in_segment[segment.index()] = Vector3::new(1e-5, -2e-5, 1.5e-5);
            let o = body.observation(time_s, &loose, &phi(&body), &truth, shear);
            let column = |t: f64, axis: usize| -> Vector3<f64> {
                let turned = body.rotation(t)[segment.index()].to_rotation_matrix();
                turned.matrix().column(axis) * (loose.factor)(t)
            };
            let rows = |of: &dyn Fn(usize) -> Vector3<f64>| {
                let columns = [0, 1, 2].map(of);
                [0, 1, 2].map(|row| columns.map(|column| column[row]))
            };
            let turned = rows(&|axis| column(time_s, axis));
            let acceleration = rows(&|axis| second(|t| column(t, axis), time_s));
            let loosened = misaligned_by_factor(segment, &turned, &acceleration, &o);
            let value = [1e-5, -2e-5, 1.5e-5, 0.0];
            little_is_left(&o, &loosened, value, segment.name());
            let (_, left_n) = left_over(&o, &loosened, value);
            let (_, gap_n) = left_over(&o, &Columns::zero(1), value);
            assert!(left_n < 1e-3 * gap_n, "{}: {left_n} N of {gap_n} N are left", segment.name());
        }
    }
}

/// A whole radian: the term with that value leaves no residual, small-angle columns leave a large one.
#[test]
fn a_large_turn_of_a_segment_is_undone_as_it_is() {
    let body = Body::new();
    for (segment, time_s) in [Segment::T8, Segment::RightUpperArm, Segment::LeftForearm]
        .into_iter()
        .flat_map(|segment| TIMES_S.map(|time_s| (segment, time_s)))
    {
        let truth = body.reaction(time_s, &[], None);
        let mut turned = SuitError::none();
        turned.in_world[segment.index()] = Vector3::new(0.0, 0.0, -1.0);
        let mut crooked = SuitError::none();
        crooked.in_segment[segment.index()] = Vector3::new(0.5, -0.4, 0.6);
        let errors = [
            (Effect::SegmentHeading, turned, [-1.0, 0.0, 0.0, 0.0]),
            (Effect::SegmentMisalignment, crooked, [0.5, -0.4, 0.6, 0.0]),
        ];
        for (effect, error, value) in errors {
            let place = Place::Segment(segment);
            let o = body.observation(time_s, &error, &phi(&body), &truth, true);
            let term = Term { effect, place, shape: 0.0, value, span_s: [0.0, f64::INFINITY] };
            let (left_m, _) = left_over(&o, &term.columns(&o), value);
            let (as_if_small_m, _) = left_over(&o, &columns(effect, place, 0.0, &o), value);
            let gap_m = gap(&o);
            assert!(left_m < 1e-3 * gap_m, "{} {}: {left_m} of {gap_m}", effect.name(), segment.name());
            assert!(as_if_small_m > 0.1 * gap_m, "{as_if_small_m} of {gap_m}");
        }
    }
}

#[test]
fn a_suit_that_has_turned_for_a_while_shifts_the_prediction_by_its_column() {
    let body = Body::new();
    for (time_s, shear) in TIMES_S.into_iter().flat_map(|time| [(time, false), (time, true)]) {
        let truth = body.reaction(time_s, &[], None);
        let turned = SuitError { whole_rad: 1e-5, ..SuitError::none() };
        let mut o = body.observation(time_s, &turned, &phi(&body), &truth, shear);
        o.time_s = 40.0;
        let drift = columns(Effect::SuitHeadingDrift, Place::Whole, 0.0, &o);
        little_is_left(&o, &drift, [1e-5 / 40.0, 0.0, 0.0, 0.0], "heading");
        // In the suit's axes, a true force to the front comes from the right.
        let residual = [0, 1].map(|axis| o.force_measured_n[axis] - o.force_predicted_n[axis]);
        let explained = drift.times(&[1e-5 / 40.0, 0.0, 0.0, 0.0]).1;
        for axis in 0..2 {
            assert!((residual[axis] - explained[axis]).abs() < 1e-5, "{residual:?} {explained:?}");
        }
    }
}

fn measured(truth: &Reaction) -> GroundSample {
    let [x, y] = truth.cop_m();
    let f = truth.force_n;
    // Wrench of that force at that point on the floor, about the world's origin.
    let moment_nm = [y * f.z - FLOOR_M * f.y, FLOOR_M * f.x - x * f.z, x * f.y - y * f.x];
    GroundSample { force_n: f.into(), moment_nm, surface_z_m: FLOOR_M, ..bytemuck::Zeroable::zeroed() }
}

/// The plate's reading has the error of the effect; the prediction uses the erroneous shear if it is measured.
#[test]
fn a_false_plate_reads_the_prediction_and_its_column() {
    let body = Body::new();
    for (time_s, shear) in TIMES_S.into_iter().flat_map(|time| [(time, false), (time, true)]) {
        let truth = body.reaction(time_s, &[], None);
        let read = |force_n: Vector3<f64>, cop_m: [f64; 2], effect: Effect, value: [f64; 4]| {
            let false_truth = Reaction { force_n, ..truth };
            let mut o = body.observation(time_s, &SuitError::none(), &phi(&body), &false_truth, shear);
            o.cop_measured_m = cop_m;
            little_is_left(&o, &columns(effect, Place::Whole, 0.0, &o), value, effect.name());
            o
        };
        let (force, [x, y]) = (truth.force_n, truth.cop_m());
        read(force, [x + 0.01, y - 0.02], Effect::PlateOffset, [0.01, -0.02, 0.0, 0.0]);
        read(force, [1.01 * x, 0.97 * y], Effect::PlateGain, [0.01, -0.03, 0.0, 0.0]);
        read(force, [x + 0.01 * y, y + 0.01 * x], Effect::PlateCrosstalk, [0.01, 0.0, 0.0, 0.0]);

        let turned = Rotation2::new(-1e-6);
        let cop = turned * Vector2::new(x, y);
        let push = turned * force.xy();
        let force_read = Vector3::new(push.x, push.y, force.z);
        let o = read(force_read, [cop.x, cop.y], Effect::PlateYaw, [1e-6, 0.0, 0.0, 0.0]);
        let column = columns(Effect::PlateYaw, Place::Whole, 0.0, &o);
        for axis in 0..2 {
            let residual = o.force_measured_n[axis] - o.force_predicted_n[axis];
            assert!((residual - 1e-6 * column.force_n[0][axis]).abs() < 1e-6);
        }

        // The device's moments are correct, but refer to a height that is 20 mm too low.
        let low = GroundSample { surface_z_m: FLOOR_M - 0.02, ..measured(&truth) };
        read(force, low.cop_m().unwrap(), Effect::PlateHeight, [0.02, 0.0, 0.0, 0.0]);

        let heavy = Vector3::new(force.x, force.y, 1.02 * force.z);
        let o = body.observation(
            time_s,
            &SuitError::none(),
            &phi(&body),
            &Reaction { force_n: heavy, ..truth },
            shear,
        );
        let gain = columns(Effect::ForceGain, Place::Whole, 0.0, &o);
        assert!((o.force_predicted_n[2] + 0.02 * gain.force_n[0][2] - heavy.z).abs() < 1e-6);
    }
}

#[test]
fn a_static_model_lacks_exactly_the_inertia() {
    let body = Body::new();
    for time_s in TIMES_S {
        let truth = body.reaction(time_s, &[], None);
        let mut o = body.observation(time_s, &SuitError::none(), &phi(&body), &truth, false);
        o.cop_predicted_m = [o.com_m[0], o.com_m[1]];
        o.slope = [0.0; 2];
        o.force_predicted_n = [0.0, 0.0, BODY_KG * 9.81];
        nothing_is_left(
            &o,
            &columns(Effect::Inertia, Place::Whole, 0.0, &o),
            [1.0, 0.0, 0.0, 0.0],
            "inertia",
        );
    }
}

#[test]
fn drifts_and_sways_count_from_where_their_span_begins() {
    let body = Body::new();
    let truth = body.reaction(0.2, &[], None);
    let mut o = body.observation(0.2, &SuitError::none(), &phi(&body), &truth, false);
    let term =
        |effect, shape, value| Term { effect, place: Place::Whole, shape, value, span_s: [100.0, 200.0] };
    let change = |term: &Term, o: &Observation| term.columns(o).times(&term.value).0;
    let even = term(Effect::PlateDrift, 0.0, [1e-4, -2e-4, 0.0, 0.0]);
    let ending = term(Effect::PlateDrift, 20.0, [0.01, 0.0, 0.0, 0.0]);
    let sway = term(Effect::PeriodicSway, 0.25, [0.002, 0.0, 0.0, 0.001]);
    for (time_s, even_m, ending_m, sway_m) in [
        (99.0, [0.0; 2], 0.0, [0.0; 2]),
        (100.0, [0.0; 2], 0.0, [0.0, 0.001]),
        (101.0, [1e-4, -2e-4], 0.01 * (1.0 - 0.951_229_424_5), [0.002, 0.0]),
        (120.0, [2e-3, -4e-3], 0.01 * (1.0 - 0.367_879_441_2), [0.0, 0.001]),
        (200.0, [0.0; 2], 0.0, [0.0; 2]),
    ] {
        o.time_s = time_s;
        for axis in 0..2 {
            assert!((change(&even, &o)[axis] - even_m[axis]).abs() < 1e-12, "{time_s}");
            assert!((change(&sway, &o)[axis] - sway_m[axis]).abs() < 1e-12, "{time_s}");
        }
        assert!((change(&ending, &o)[0] - ending_m).abs() < 1e-9, "{time_s}");
    }
}

#[test]
fn without_a_person_or_a_place_an_effect_is_zero() {
    let body = Body::new();
    let truth = body.reaction(0.2, &[], None);
    let mut o = body.observation(0.2, &SuitError::none(), &phi(&body), &truth, false);
    assert_eq!(columns(Effect::PlateOffset, Place::Hand(Side::Left), 0.0, &o), Columns::zero(2));
    assert_eq!(columns(Effect::WornMass, Place::Whole, 0.0, &o), Columns::zero(4));
    for vertical_n in [0.0, -700.0, f64::NAN] {
        o.force_measured_n[2] = vertical_n;
        for effect in Effect::ALL {
            for place in effect.places() {
                let none = Columns::zero(effect.parameters().len());
                assert_eq!(columns(effect, *place, 0.0, &o), none, "{}", effect.name());
            }
        }
    }
}
