//! A real Kistler plate's eight voltages, through a file with configured lines of text: forces and centre of pressure
//! as in an independent computation with the maker's formulae.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use equipoise_adapters::ground::channels::EightChannels;
use equipoise_adapters::ground::device::text::{Column, Framing, Text, TextSettings};
use equipoise_adapters::ground::{Channels, GroundFrame, GroundSettings, SensorAxes};
use equipoise_adapters::source::GroundSource;
use equipoise_adapters::source::file_line::{Begin, FileLine};
use equipoise_adapters::wire::text_line::{Decimal, Delimiter, LineForm, Unit};
use equipoise_core::message::GroundSample;

/// From the plate's calibration sheet: mV/N in the order of the channels; distances in m.
const SENSITIVITY_MV_PER_N: [f64; 8] = [38.117, 37.723, 38.062, 38.008, 3.898, 3.889, 3.885, 3.891];
const A_M: f64 = 0.12;
const B_M: f64 = 0.2;
const AZ0_M: f64 = -0.048;

/// Computed independently: Fx Fy Fz in the plate's axes (z down), and the centre of pressure; for rows 0 and 1.
const KNOWN: [([f64; 3], [f64; 2]); 2] = [
    ([-3.209038126402469, -2.841661143970299, 436.75391139983], [0.01889997203569614, -0.020109015696057303]),
    (
        [-2.7839192145862253, -2.7148110028989128, 435.76120942156365],
        [0.018440564640869656, -0.019636888008443574],
    ),
];

fn plate() -> Text {
    let eight = EightChannels {
        channels: core::array::from_fn(|channel| channel),
        a_m: A_M,
        b_m: B_M,
        newtons_per_unit: SENSITIVITY_MV_PER_N.map(|mv_per_n| 1000.0 / mv_per_n),
        zero: [0.0; 8],
    };
    Text::new(TextSettings {
        form: LineForm {
            delimiter: Delimiter::Tab,
            decimal: Decimal::Point,
            comment: None,
            prefix: Vec::new(),
            fields: 9,
        },
        framing: Framing::Stream,
        header_lines: 1,
        longest: 1000,
        columns: (1..9).map(|field| Column { field, scale: 1.0, offset: 0.0 }).collect(),
        channels: Channels::eight(8, &eight).unwrap(),
        time: Some((0, Unit::NanosecondInSeconds)),
        sequence: None,
    })
}

/// All samples of a file with this many rows.
fn read(path: &Path, rows: usize) -> (Vec<GroundSample>, GroundSource) {
    let settings = GroundSettings {
        frame: GroundFrame { axes: SensorAxes::ZDown, surface_height_m: -AZ0_M, ..GroundFrame::default() },
        ..GroundSettings::default()
    };
    let file = FileLine::new(path.to_owned(), Begin::Start, "ground.file.path");
    let mut source = GroundSource::open(Box::new(file), Box::new(plate()), settings).unwrap();
    let mut samples = Vec::new();
    let until = Instant::now() + Duration::from_secs(20);
    while samples.len() < rows && Instant::now() < until {
        source.receive(&mut samples).unwrap();
    }
    (samples, source)
}

fn agrees(sample: &GroundSample, force_n: [f64; 3], cop_m: [f64; 2]) {
    // From z down and the force on the plate to z up and the force on the person.
    let want = [-force_n[0], force_n[1], force_n[2]];
    for (got, want) in sample.force_n.iter().zip(want) {
        assert!((got - want).abs() < 1e-6, "{:?} {want:?}", sample.force_n);
    }
    let cop = sample.cop_m().unwrap();
    assert!((cop[0] - cop_m[0]).abs() < 1e-9 && (cop[1] + cop_m[1]).abs() < 1e-9, "{cop:?} {cop_m:?}");
}

#[test]
fn volts_of_a_real_plate_are_the_forces_that_its_makers_formulae_have() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/kistler_8ch_volts.txt");
    let (samples, source) = read(&path, 40);
    assert_eq!(
        (samples.len(), source.counts().lost, source.counts().refused.iter().sum::<u64>()),
        (40, 0, 0)
    );
    for (sample, (force_n, cop_m)) in samples.iter().zip(KNOWN) {
        agrees(sample, force_n, cop_m);
    }
    assert!(samples.iter().all(|sample| sample.not_measured == 0 && sample.device_status == 0));
}

#[test]
fn every_row_of_the_longer_recording_is_read() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/wire");
    let (path, known) = (folder.join("kistler_8ch_volts.txt"), folder.join("kistler_expected.json"));
    let (Ok(text), Ok(known)) = (std::fs::read_to_string(&path), std::fs::read_to_string(&known)) else {
        println!("skipped: {} is not there", path.display());
        return;
    };
    let rows: Vec<&str> = text.lines().skip(1).collect();
    let (samples, source) = read(&path, rows.len());
    assert_eq!((samples.len(), source.counts().lost), (rows.len(), 0));
    let known: serde_json::Value = serde_json::from_str(&known).unwrap();
    let mut compared = 0;
    for (index, row) in known["rows"].as_object().unwrap() {
        let Some(sample) = samples.get(index.parse::<usize>().unwrap()) else { continue };
        let number = |name: &str| row[name].as_f64().unwrap();
        agrees(sample, [number("Fx"), number("Fy"), number("Fz")], [number("ax"), number("ay")]);
        compared += 1;
    }
    assert!(compared >= 2, "{compared}");
    // A person standing still: approximately the mean of the whole recording.
    let mean_n = samples.iter().map(|sample| sample.force_n[2]).sum::<f64>() / samples.len() as f64;
    let recording_n = known["mean"]["Fz"].as_f64().unwrap();
    assert!((mean_n - recording_n).abs() < 2.0, "{mean_n} {recording_n}");
}
