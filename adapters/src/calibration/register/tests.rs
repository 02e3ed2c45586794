use super::holds::{Holds, Observation, Progress};
use super::*;
use equipoise_simulator::random::Random;
use proptest::prelude::*;

/// Positions and headings of a person who follows the instructions, m and rad.
const PLACES: [([f64; 2], f64); 7] = [
    ([0.15, 0.2], 0.0),
    ([0.15, -0.2], 0.0),
    ([-0.15, -0.2], 0.0),
    ([-0.15, 0.2], 0.0),
    ([0.0, 0.0], 0.0),
    ([0.0, 0.02], 1.5),
    ([0.02, 0.0], -1.5),
];

/// Holds of a person on a plate with this rotation and translation relative to the configured frame.
fn holds(yaw_rad: f64, shift_m: [f64; 2], bias_m: [f64; 2], error_m: f64, random: &mut Random) -> Vec<Hold> {
    let hold = |(place_m, heading_rad): &([f64; 2], f64)| {
        let mut off = || error_m * random.normal();
        let there = Vector2::from(*place_m);
        let measured = turn(-yaw_rad) * (there - Vector2::from(shift_m));
        let expected = there - turn(*heading_rad) * Vector2::from(bias_m) + Vector2::new(off(), off());
        Hold { measured_m: measured.into(), expected_m: expected.into(), heading_rad: *heading_rad }
    };
    PLACES.iter().map(hold).collect()
}

proptest! {
    #[test]
    fn the_frame_is_exact_without_errors(
        yaw_rad in -3.1..3.1, shift_m in proptest::array::uniform2(-2.0..2.0),
    ) {
        let mut random = Random::new(1, "none");
        let found = register(&holds(yaw_rad, shift_m, [0.0; 2], 0.0, &mut random)).unwrap();
        prop_assert!((found.yaw_rad - yaw_rad).abs() < 1e-9);
        prop_assert!((0..2).all(|axis| (found.shift_m[axis] - shift_m[axis]).abs() < 1e-9));
    }
}

#[test]
fn the_estimate_is_within_its_published_sigma() {
    let mut random = Random::new(7, "register");
    let mut squares = [0.0; 3];
    let mut within = [0.0; 3];
    const TRIALS: usize = 600;
    for trial in 0..TRIALS {
        let mut around = |scale: f64| scale * random.normal();
        let (yaw_rad, shift_m) = (around(1.0).clamp(-3.0, 3.0), [around(0.5), around(0.5)]);
        let bias_m = [around(BIAS_SIGMA_M), around(BIAS_SIGMA_M)];
        let holds = holds(yaw_rad, shift_m, bias_m, [0.006, 0.01, 0.015][trial % 3], &mut random);
        let found = register(&holds).unwrap();
        // The middle of the plate, where the person stands.
        let middle = turn(-yaw_rad) * -Vector2::from(shift_m);
        let ([x, y], [sigma_x, sigma_y]) = found.point_m(middle.into());
        let off = [wrapped(found.yaw_rad - yaw_rad) / found.yaw_sigma_rad(), x / sigma_x, y / sigma_y];
        for (which, off) in off.into_iter().enumerate() {
            squares[which] += off * off / TRIALS as f64;
            within[which] += if off.abs() < 2.0 { 100.0 / TRIALS as f64 } else { 0.0 };
        }
    }
    println!("mean square {squares:.2?}, within 2 σ {within:.1?} %");
    assert!(squares.iter().all(|square| (0.6..1.5).contains(square)), "{squares:?}");
    assert!(within.iter().all(|percent| *percent > 92.0), "{within:?}");
}

#[test]
fn yaw_is_independent_of_the_body_bias_and_the_shift_requires_a_turn() {
    let mut random = Random::new(3, "bias");
    let turned = holds(0.3, [0.1, -0.2], [0.04, 0.0], 0.0, &mut random);
    let straight = &turned[..5];
    let found = register(straight).unwrap();
    assert!((found.yaw_rad - 0.3).abs() < 1e-9);
    assert!(found.bias_sigma_m()[0] > 0.9 * BIAS_SIGMA_M, "{:?}", found.bias_sigma_m());
    assert!((found.shift_m[0] - 0.1).abs() > 0.03, "the body's bias is taken for a shift: {found:?}");
    let found = register(&turned).unwrap();
    assert!(found.bias_sigma_m()[0] < 0.5 * BIAS_SIGMA_M, "{:?}", found.bias_sigma_m());
    assert!((found.shift_m[0] - 0.1).abs() < 0.01 && (found.bias_m[0] - 0.04).abs() < 0.01, "{found:?}");
}

#[test]
fn insufficient_positions_are_refused() {
    let mut random = Random::new(3, "few");
    let all = holds(0.3, [0.1, -0.2], [0.0; 2], 0.005, &mut random);
    assert_eq!(register(&all[..2]), Err(RegisterRefusal::TooFew { found: 2 }));
    let refused = register(&all[4..]);
    assert!(
        matches!(refused, Err(RegisterRefusal::NotSpread { spread_m }) if spread_m < 0.03),
        "{refused:?}"
    );
    let mut off = all.clone();
    off[2].expected_m[0] += 0.4;
    assert!(matches!(register(&off), Err(RegisterRefusal::Contradictory { worst: 2, .. })));
    // A mirrored y axis is not a rotation.
    let mirrored: Vec<Hold> = all
        .iter()
        .map(|hold| Hold { measured_m: [hold.measured_m[0], -hold.measured_m[1]], ..*hold })
        .collect();
    assert!(matches!(register(&mirrored), Err(RegisterRefusal::Contradictory { .. })));
    off[2].expected_m[0] = f64::NAN;
    assert!(register(&off).is_err());
}

#[test]
fn a_configured_frame_is_corrected() {
    let mut random = Random::new(3, "frame");
    let found = register(&holds(0.5, [0.4, -0.1], [0.0; 2], 0.0, &mut random)).unwrap();
    let before = GroundFrame { origin_m: [0.2, 0.1, -0.05], yaw_rad: 3.0, ..GroundFrame::default() };
    let after = found.of_frame(&before);
    assert!((after.yaw_rad - (3.5 - core::f64::consts::TAU)).abs() < 1e-9);
    let ([x, y], _) = found.point_m([0.2, 0.1]);
    assert_eq!(after.origin_m, [x, y, -0.05]);
    let sensor_reads = crate::ground::Wrench { force_n: [10.0, 5.0, -700.0], moment_nm: [30.0, 40.0, 1.0] };
    let wrong = before.person_from_sensor(sensor_reads, Default::default());
    let right = after.person_from_sensor(sensor_reads, Default::default());
    let cop = |wrench: crate::ground::Wrench| {
        [-wrench.moment_nm[1], wrench.moment_nm[0]].map(|nm| nm / wrench.force_n[2])
    };
    let (moved, _) = found.point_m(cop(wrong));
    assert!((0..2).all(|axis| (moved[axis] - cop(right)[axis]).abs() < 1e-9));
}

#[test]
fn a_hold_is_two_seconds_of_a_static_pose_at_a_new_position() {
    let mut holds = Holds::default();
    let mut completed = 0;
    let mut time_ns = 0;
    let mut stand = |place_m: [f64; 2], heading_rad: f64, stance: u32, seconds: f64, still: bool| {
        let mut last = Progress::Moving;
        for _ in 0..(seconds * 60.0) as u32 {
            time_ns += 16_666_667;
            let values = Hold { measured_m: place_m, expected_m: place_m, heading_rad };
            last = holds.ingest(Observation { time_ns, stance, still, values });
            completed += usize::from(matches!(last, Progress::Completed(_)));
        }
        (completed, last)
    };
    assert_eq!(stand([0.0, 0.2], 0.0, 0, 1.5, true).0, 0);
    assert_eq!(stand([0.0, 0.2], 0.0, 0, 0.1, false), (0, Progress::Moving));
    assert_eq!(stand([0.0, 0.2], 0.0, 0, 2.1, true).0, 1);
    assert_eq!(
        stand([0.0, 0.2], 0.0, 0, 5.0, true),
        (1, Progress::AlreadyUsed),
        "the same place does not count twice"
    );
    assert_eq!(stand([0.0, 0.0], 0.0, 1, 1.9, true).0, 1);
    assert_eq!(stand([0.0, 0.0], 0.0, 2, 1.9, true).0, 1, "a step begins again");
    assert_eq!(stand([0.0, 0.0], 0.0, 2, 0.3, true).0, 2);
    assert_eq!(stand([0.0, 0.0], 0.8, 3, 2.3, true).0, 3, "turned on the spot");
}
