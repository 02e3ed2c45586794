//! A real plate's calibration sheet, if it is next to the workspace: it may be read, but not redistributed.

use equipoise_adapters::ground::device::amti::{Amti, AmtiSettings, METRE_PER_INCH, NEWTON_PER_LBF, Rate};
use equipoise_adapters::ground::{Action, GroundFrame, GroundProtocol, GroundSettings, SensorAxes};
use equipoise_adapters::wire::amti::{CHANNELS, Frame};
use std::path::PathBuf;

fn matrix() -> Option<[[f64; CHANNELS]; 6]> {
    let shared = std::env::var_os("EQUIPOISE_SHARED")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")), PathBuf::from);
    let path = shared.join("data/wire/amti_forceplate_config.cfg");
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("skipped: {} is not there", path.display());
        return None;
    };
    let (_, rest) = text.split_once('[').unwrap();
    let (numbers, _) = rest.split_once(']').unwrap();
    let numbers: Vec<f64> = numbers.split(',').map(|number| number.trim().parse().unwrap()).collect();
    let rows: Vec<[f64; CHANNELS]> = numbers.chunks(CHANNELS).map(|row| row.try_into().unwrap()).collect();
    Some(rows.try_into().unwrap())
}

/// Position and size of a load with these counts on each vertical gauge, in the world.
fn pressed(matrix: [[f64; CHANNELS]; 6], vertical: [i16; 4]) -> (f64, [f64; 2]) {
    let settings = AmtiSettings {
        rate: Rate::Hz50,
        matrix,
        force_unit_n: NEWTON_PER_LBF,
        moment_unit_nm: NEWTON_PER_LBF * METRE_PER_INCH,
    };
    let frame = GroundFrame { axes: SensorAxes::ZDown, ..GroundFrame::default() };
    let mut protocol = GroundProtocol::new(
        Box::new(Amti::new(settings)),
        GroundSettings { frame, ..GroundSettings::default() },
    );
    let mut samples = Vec::new();
    let mut now_ns = 1_000_000_000;
    protocol.opened(now_ns);
    loop {
        now_ns += 20_000_000;
        if let Action::Send(said) = protocol.next_action(now_ns) {
            let starts = said == [0x51];
            protocol.receive(if starts { &[0x55] } else { &said }, now_ns, &mut samples);
            if starts {
                break;
            }
        }
    }
    // The third gauge of each corner.
    let mut counts = [0; CHANNELS];
    for (corner, counted) in vertical.into_iter().enumerate() {
        counts[3 * corner + 2] = counted;
    }
    protocol.receive(&Frame { counts, trigger: false }.to_bytes(), now_ns, &mut samples);
    let sample = samples[0];
    let [x, y, z] = sample.force_n;
    let cop = [-sample.moment_nm[1] / z, sample.moment_nm[0] / z];
    assert!(
        x.abs() < 0.05 * z.abs() && y.abs() < 0.05 * z.abs(),
        "a vertical load has no shear: {:?}",
        sample.force_n
    );
    (z, cop)
}

/// The sheet has no units. Interpreted in pounds and inches, it gives a plausible plate: an adult is well within its
/// range, and the corners match a plate of twenty inches.
#[test]
fn a_real_sheet_in_pounds_and_inches_makes_a_plate() {
    let Some(matrix) = matrix() else { return };
    let (force_n, cop_m) = pressed(matrix, [-500; 4]);
    assert!((700.0..850.0).contains(&force_n), "{force_n}");
    assert!(cop_m[0].abs() < 0.005 && cop_m[1].abs() < 0.005, "{cop_m:?}");
    let mut quadrants = Vec::new();
    for corner in 0..4 {
        let mut vertical = [0; 4];
        vertical[corner] = -1000;
        let (force_n, cop_m) = pressed(matrix, vertical);
        assert!((350.0..420.0).contains(&force_n), "{force_n}");
        assert!(cop_m.iter().all(|metres| (0.17..0.20).contains(&metres.abs())), "{cop_m:?}");
        quadrants.push(cop_m.map(f64::is_sign_positive));
    }
    quadrants.sort_unstable();
    quadrants.dedup();
    assert_eq!(quadrants.len(), 4, "each gauge has a corner of its own");
}
