use super::places::geometry;
use super::rod::{RodRefusal, tip};
use super::*;
use bytemuck::Zeroable;
use equipoise_simulator::random::Random;

const SETTINGS: VerifySettings =
    VerifySettings { mass_kg: 20.0, gravity_m_per_s2: 9.81, seconds: 3.0, places: 2 };

/// Simulated plate at 200 Hz with noise.
struct Bench {
    verification: Verification,
    time_ns: u64,
    random: Random,
    steps: Vec<Step>,
}

impl Bench {
    fn new(settings: VerifySettings) -> Bench {
        let (time_ns, random) = (1_000_000_000, Random::new(5, "bench"));
        Bench { verification: Verification::new(settings), time_ns, random, steps: Vec::new() }
    }

    fn lies(&mut self, seconds: f64, vertical_n: f64, at_m: [f64; 2]) -> Result<(), VerifyRefusal> {
        for _ in 0..(200.0 * seconds) as u32 {
            self.time_ns += 5_000_000;
            let mut noise = |sigma: f64| sigma * self.random.normal();
            // The plate's own zero offset, about its own origin.
            let fz = vertical_n + 3.0 + noise(1.0);
            let moment_nm =
                [at_m[1] * vertical_n + 0.4 + noise(0.3), -at_m[0] * vertical_n - 0.7 + noise(0.3), 0.0];
            let sample = GroundSample {
                sample_time_ns: self.time_ns,
                force_n: [noise(1.0), noise(1.0), fz],
                moment_nm,
                ..Zeroable::zeroed()
            };
            self.steps.extend(self.verification.take(&sample)?);
        }
        Ok(())
    }
}

#[test]
fn a_mass_is_weighed_at_each_place_and_the_empty_plate_in_between() {
    let mut bench = Bench::new(SETTINGS);
    let weight_n = 1.01 * SETTINGS.weight_n();
    bench.lies(3.0, 0.0, [0.0; 2]).unwrap();
    bench.lies(0.4, 0.7 * weight_n, [0.1, 0.0]).unwrap();
    bench.lies(6.0, weight_n, [0.12, -0.05]).unwrap();
    bench.lies(3.0, 0.9, [0.0; 2]).unwrap();
    assert!(!bench.verification.is_done());
    bench.lies(6.0, weight_n, [-0.1, 0.2]).unwrap();
    assert!(bench.verification.is_done());
    let [
        Step::Zeroed(zero_n),
        Step::Settled,
        Step::Placed(one),
        Step::Lifted(drift_n),
        Step::Settled,
        Step::Placed(two),
    ] = bench.steps[..]
    else {
        panic!("{:?}", bench.steps)
    };
    assert!((zero_n - 3.0).abs() < 0.3 && (drift_n - 0.9).abs() < 0.3, "{zero_n} {drift_n}");
    // The second time the empty plate's force has increased, which must not be attributed to the mass.
    for (placed, at_m, more_n) in [(one, [0.12, -0.05], 0.0), (two, [-0.1, 0.2], -0.9)] {
        let expected_kg = (weight_n + more_n) / 9.81;
        let off = (placed.mass_kg - expected_kg) / placed.mass_sigma_kg;
        assert!(off.abs() < 4.0 && placed.mass_sigma_kg < 0.03, "{placed:?}");
        assert!((0..2).all(|axis| (placed.cop_m[axis] - at_m[axis]).abs() < 0.003), "{placed:?}");
        assert!(placed.cop_sigma_m.iter().all(|sigma_m| *sigma_m < 0.001), "{placed:?}");
    }
}

#[test]
fn a_touch_restarts_the_measurement_and_a_pull_is_refused() {
    let mut bench = Bench::new(SETTINGS);
    bench.lies(3.0, 0.0, [0.0; 2]).unwrap();
    bench.lies(2.5, 196.0, [0.0; 2]).unwrap();
    bench.lies(0.5, 230.0, [0.0; 2]).unwrap();
    assert_eq!(bench.steps[1..], [Step::Settled, Step::Disturbed]);
    bench.lies(5.0, 196.0, [0.0; 2]).unwrap();
    assert!(matches!(bench.steps[3..], [Step::Settled, Step::Placed(_)]), "{:?}", bench.steps);

    let mut bench = Bench::new(SETTINGS);
    bench.lies(3.0, 0.0, [0.0; 2]).unwrap();
    let refused = bench.lies(1.0, -196.0, [0.0; 2]);
    assert!(
        matches!(refused, Err(VerifyRefusal::Pulls { pulls_n }) if (pulls_n - 196.0).abs() < 5.0),
        "{refused:?}"
    );
    // A person who walks about is not an empty plate.
    let mut bench = Bench::new(SETTINGS);
    for step in 0..40 {
        bench.lies(0.25, 500.0 + 100.0 * f64::from(step % 3), [0.0; 2]).unwrap();
    }
    assert!(bench.steps.is_empty(), "{:?}", bench.steps);
}

#[test]
fn places_tell_scales_turn_and_origin() {
    let true_m = [[0.2, 0.15], [0.2, -0.15], [-0.2, -0.15], [-0.2, 0.15], [0.0, 0.0]];
    let seen = |[x, y]: [f64; 2]| {
        let (sine, cosine) = 0.02_f64.sin_cos();
        [0.006 + 1.03 * (cosine * x - sine * y), -0.004 + 0.98 * (sine * x + cosine * y)]
    };
    let seen_m = true_m.map(seen);
    let found = geometry(&seen_m, &true_m).unwrap();
    for (known, expected) in [
        (found.scale_x, 0.03),
        (found.scale_y, -0.02),
        (found.turned_rad, 0.02),
        (found.origin_m[0], 0.006),
        (found.origin_m[1], -0.004),
    ] {
        assert!((known.value - expected).abs() < 0.001, "{known:?} {expected}");
        assert!(known.sigma > 0.0005 && known.sigma < 0.01, "{known:?}");
    }
    assert!(found.left_m < 1e-3);
    assert_eq!(geometry(&seen_m[..2], &true_m[..2]), None);
    let line = [[0.2, 0.1], [0.0, 0.0], [-0.2, -0.1], [0.1, 0.05]];
    assert_eq!(geometry(&line, &line), None);
}

#[test]
fn a_tilted_rod_gives_the_height_of_its_tip() {
    let mut random = Random::new(9, "rod");
    let tip_m = [0.11, -0.07, 0.043];
    let mut blocks = |lean_n: f64, count: u32| -> Vec<Block> {
        let block = |index: u32| {
            let (sine, cosine) = (0.2 * f64::from(index)).sin_cos();
            let [fx, fy, fz] = [lean_n * cosine, lean_n * sine, 300.0 + 20.0 * random.normal()];
            let [x, y, z] = tip_m;
            let noise = [0.1 * random.normal(), 0.1 * random.normal()];
            Block {
                force_n: [fx, fy, fz],
                moment_nm: [y * fz - z * fy + noise[0], z * fx - x * fz + noise[1], x * fy - y * fx],
            }
        };
        (0..count).map(block).collect()
    };
    let found = tip(&blocks(60.0, 150)).unwrap();
    for (axis, tip_m) in tip_m.iter().enumerate() {
        let off = (found.at_m[axis] - tip_m) / found.sigma_m[axis];
        assert!(off.abs() < 4.0, "{found:?}");
    }
    assert!(found.sigma_m[2] < 0.001 && (found.shear_n - 60.0).abs() < 1e-6);
    assert!(matches!(tip(&blocks(1.0, 150)), Err(RodRefusal::NotLeant { .. })));
    assert_eq!(tip(&blocks(60.0, 10)), Err(RodRefusal::NotPressed { blocks: 10 }));
}

#[test]
fn a_plate_whose_scale_is_wrong_by_far_is_measured_all_the_same() {
    // Pounds used as newtons, and with the wrong sign.
    let pounds_n = 0.2248 * SETTINGS.weight_n();
    let mut bench = Bench::new(VerifySettings { places: 1, ..SETTINGS });
    bench.lies(3.0, 0.0, [0.0; 2]).unwrap();
    bench.lies(6.0, pounds_n, [0.0; 2]).unwrap();
    let Some(Step::Placed(placed)) = bench.steps.last() else { panic!("{:?}", bench.steps) };
    assert!((placed.mass_kg / SETTINGS.mass_kg - 0.2248).abs() < 0.01, "{placed:?}");
    let mut bench = Bench::new(SETTINGS);
    bench.lies(3.0, 0.0, [0.0; 2]).unwrap();
    assert!(matches!(bench.lies(1.0, -pounds_n, [0.0; 2]), Err(VerifyRefusal::Pulls { .. })));
}

#[test]
fn a_mass_is_not_known_better_than_the_zero_that_is_taken_off() {
    let sigma_kg = |seconds: f64| {
        let mut bench = Bench::new(VerifySettings { places: 1, seconds, ..SETTINGS });
        bench.lies(3.0, 0.0, [0.0; 2]).unwrap();
        bench.lies(seconds + 3.0, SETTINGS.weight_n(), [0.0; 2]).unwrap();
        let Some(Step::Placed(placed)) = bench.steps.last() else { panic!("{:?}", bench.steps) };
        placed.mass_sigma_kg
    };
    // The zero is the mean of 20 blocks of 20 samples with σ = 1 N.
    let zero_kg = 1.0 / 400.0_f64.sqrt() / 9.81;
    assert!(sigma_kg(60.0) > 0.6 * zero_kg, "{} of {zero_kg} kg", sigma_kg(60.0));
}
