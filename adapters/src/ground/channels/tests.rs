use super::*;
use crate::ground::frame::{GroundFrame, Measures, SensorAxes};
use proptest::prelude::*;

/// S, volts and computed rows of a real plate (Kistler 9281EA; data of BMClab, CC-BY-4.0, see `adapters/tests/data`).
const SENSITIVITY: [f64; 8] = [38.117, 37.723, 38.062, 38.008, 3.898, 3.889, 3.885, 3.891];
const VOLTS: [f64; 8] = [-0.045707, -0.07582, 0.099988, -0.207852, 0.745766, 0.018508, 0.698777, 0.236609];

fn kistler() -> EightChannels {
    EightChannels {
        channels: core::array::from_fn(|channel| channel),
        a_m: 0.12,
        b_m: 0.2,
        newtons_per_unit: SENSITIVITY.map(|s| 1000.0 / s),
        zero: [0.0; 8],
    }
}

fn wrench(load: Load) -> Wrench {
    match load {
        Load::Wrench(wrench) | Load::Part { wrench, .. } => wrench,
        Load::Insoles(_) => panic!("insoles"),
    }
}

#[test]
fn eight_volts_of_a_real_plate_are_the_wrench_that_its_maker_computes() {
    let read = wrench(Channels::eight(8, &kistler()).unwrap().load(&VOLTS));
    let want = [
        -3.209038126402469,
        -2.841661143970299,
        436.75391139983,
        -8.919090994564176,
        -8.100602881870378,
        0.8093157012105849,
    ];
    for (got, want) in read.force_n.iter().chain(&read.moment_nm).zip(want) {
        assert!((got - want).abs() < 1e-9, "{got} {want}");
    }
    let frame = GroundFrame { axes: SensorAxes::ZDown, surface_height_m: 0.048, ..GroundFrame::default() };
    let person = frame.person_from_sensor(read, Measures::Action);
    let z = frame.surface_z_m();
    let cop = [
        (z * person.force_n[0] - person.moment_nm[1]) / person.force_n[2],
        (person.moment_nm[0] + z * person.force_n[1]) / person.force_n[2],
    ];
    assert!(
        (cop[0] - 0.01889997203569614).abs() < 1e-9 && (cop[1] + -0.020109015696057303).abs() < 1e-9,
        "{cop:?}"
    );
}

#[test]
fn what_a_plate_reads_without_load_is_taken_off() {
    let with_zero = Channels::eight(8, &EightChannels { zero: VOLTS, ..kistler() }).unwrap();
    assert_eq!(wrench(with_zero.load(&VOLTS)), Wrench::default());
}

#[test]
fn a_plain_channel_keeps_its_bits_and_what_is_not_there_is_not_measured() {
    let all = Direct { force: [Some(0), Some(1), Some(2)], moment: [Some(3), Some(4), Some(5)] };
    let values = [0.1, -0.3, 700.7, 1e-9, -0.0, 33.3];
    let load = Channels::direct(6, all, ForceUnit::Newton, MomentUnit::NewtonMetre).unwrap().load(&values);
    assert_eq!(load, Load::Wrench(Wrench { force_n: [0.1, -0.3, 700.7], moment_nm: [1e-9, 0.0, 33.3] }));
    let vertical = Direct { force: [None, None, Some(0)], ..Direct::default() };
    let channels = Channels::direct(1, vertical, ForceUnit::Kilonewton, MomentUnit::NewtonMetre).unwrap();
    assert_eq!(channels.not_measured(), 7);
    assert!(
        matches!(channels.load(&[0.7]), Load::Part { wrench, not_measured: 7 } if wrench.force_n == [0.0, 0.0, 700.0])
    );
    let half = Direct { force: [Some(0), None, Some(1)], ..Direct::default() };
    let said = Channels::direct(2, half, ForceUnit::Newton, MomentUnit::NewtonMetre).unwrap_err();
    assert!(said.to_string().contains("fx and fy"), "{said}");
    let beyond = Direct { force: [None, None, Some(6)], ..Direct::default() };
    assert_eq!(
        Channels::direct(6, beyond, ForceUnit::Newton, MomentUnit::NewtonMetre),
        Err(ChannelFault::Beyond { channel: 6, count: 6 })
    );
}

#[test]
fn units_are_what_they_are_called() {
    // A torque that lifts one pound at the end of a foot, expressed in inches and in feet.
    let (inch, foot) =
        (MomentUnit::PoundForceInch.newton_metres(), MomentUnit::PoundForceFoot.newton_metres());
    assert!(
        (12.0 * inch - foot).abs() < 1e-12 && (foot - ForceUnit::PoundForce.newtons() * 0.3048).abs() < 1e-12
    );
    assert!((inch - 0.112_984_8).abs() < 1e-7, "protocols give 0.1129848 N m");
    assert!(
        (ForceUnit::KilogramForce.newtons() / ForceUnit::PoundForce.newtons() - 2.204_622_6).abs() < 1e-6
    );
}

#[test]
fn load_cells_in_one_line_carry_nothing() {
    let cell = |channel, x, y| Cell { channel, at_m: [x, y] };
    let line = [cell(0, 0.0, 0.0), cell(1, 0.1, 0.1), cell(2, 0.2, 0.2)];
    assert_eq!(Channels::cells(3, &line, ForceUnit::Newton), Err(ChannelFault::Cells));
    assert_eq!(Channels::cells(0, &[], ForceUnit::Newton), Err(ChannelFault::Cells));
    let twice = [cell(0, 0.0, 0.0), cell(1, 0.0, 0.0), cell(2, 0.2, 0.0), cell(3, 0.0, 0.2)];
    assert!(Channels::cells(4, &twice, ForceUnit::Newton).is_ok());
}

#[test]
fn a_sole_without_force_has_no_centre_and_one_that_counts_to_the_heel_is_turned() {
    let insole = |first: usize, sign: f64| Insole {
        vertical: first,
        cop: [first + 1, first + 2],
        newtons_per_unit: 1.0,
        metres_per_unit: [0.25 * sign, 0.09],
    };
    let insoles = Channels::insoles(6, [insole(0, 1.0), insole(3, -1.0)]).unwrap();
    let Load::Insoles([left, right]) = insoles.load(&[0.0, 0.3, 0.3, 400.0, 0.2, -0.1]) else {
        panic!("insoles")
    };
    assert_eq!((left.vertical_n, left.cop_m), (0.0, [0.0, 0.0]));
    assert!((right.cop_m[0] + 0.05).abs() < 1e-12 && (right.cop_m[1] + 0.009).abs() < 1e-12);
    assert!(!insoles.load(&[1.0]).is_finite(), "channels that did not come are no zeros");
}

proptest! {
    #[test]
    fn a_force_at_a_point_is_found_there_by_cells_and_by_a_centre(
        fz in 50.0..2000.0f64, x in -0.2..0.2f64, y in -0.3..0.3f64, shear in proptest::array::uniform2(-100.0..100.0f64),
    ) {
        // Bilinear weights distribute a point force over four corners in equilibrium.
        let (a, b) = (0.2, 0.3);
        let corners = [[a, b], [-a, b], [-a, -b], [a, -b]];
        let cells: Vec<Cell> = corners.iter().enumerate().map(|(channel, at_m)| Cell { channel, at_m: *at_m }).collect();
        let fractions: Vec<f64> =
            corners.iter().map(|[cx, cy]| fz * (1.0 + x * cx.signum() / a) * (1.0 + y * cy.signum() / b) / 4.0).collect();
        let frame = GroundFrame::default();
        let load = Channels::cells(4, &cells, ForceUnit::Newton).unwrap().load(&fractions);
        let person = frame.person_from_sensor(wrench(load), Measures::Reaction);
        prop_assert!((person.force_n[2] - fz).abs() < 1e-9);
        prop_assert!((-person.moment_nm[1] / fz - x).abs() < 1e-9 && (person.moment_nm[0] / fz - y).abs() < 1e-9);

        // The centre on a surface above the sensor, of a force with shear, in millimetres.
        let centre = Centre {
            shear: Some([0, 1]), vertical: 2, cop: [3, 4], free_moment: None, surface_z_m: 0.05,
            newtons_per_unit: 1.0, newton_metres_per_unit: 1.0, metres_per_unit: 1e-3,
        };
        let load = Channels::centre(5, centre).unwrap().load(&[shear[0], shear[1], fz, x * 1e3, y * 1e3]);
        let Load::Part { wrench: of_channels, not_measured } = load else { panic!("the free moment is missing") };
        prop_assert_eq!(not_measured, Component::FreeMoment as u32);
        let cop = [(0.05 * of_channels.force_n[0] - of_channels.moment_nm[1]) / fz, (of_channels.moment_nm[0] + 0.05 * of_channels.force_n[1]) / fz];
        prop_assert!((cop[0] - x).abs() < 1e-9 && (cop[1] - y).abs() < 1e-9);
    }

    #[test]
    fn a_matrix_with_its_zero_is_the_matrix_of_what_is_left(
        weights in proptest::array::uniform32(-3.0..3.0f64), values in proptest::array::uniform4(-100.0..100.0f64),
        zero in proptest::array::uniform4(-10.0..10.0f64),
    ) {
        let rows: [Vec<f64>; 6] = core::array::from_fn(|row| weights[row * 4..row * 4 + 4].to_vec());
        let of = |zero: &[f64], values: &[f64]| {
            let channels = Channels::matrix(&rows, zero, ForceUnit::PoundForce, MomentUnit::PoundForceInch).unwrap();
            wrench(channels.load(values))
        };
        let less: Vec<f64> = values.iter().zip(zero).map(|(value, zero)| value - zero).collect();
        prop_assert_eq!(of(&zero, &values), of(&[], &less));
        let row = |row: usize| weights[row * 4..row * 4 + 4].iter().zip(&less).map(|(w, x)| w * x).sum::<f64>();
        let of_channels = of(&[], &less);
        prop_assert!((of_channels.force_n[2] - row(2) * 4.448_221_615_260_5).abs() < 1e-9);
        prop_assert!((of_channels.moment_nm[1] - row(4) * 0.112_984_829_027_616_7).abs() < 1e-9);
    }
}
