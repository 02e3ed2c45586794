//! Text exports of a plate: units are read or declared, never guessed; three layouts give the same wrench; real values.

use std::io::{self, Read};
use std::path::PathBuf;

use equipoise_adapters::capture::{BioWareCapture, BioWareError, BioWareSettings, Units};
use equipoise_adapters::ground::{GroundFrame, GroundSettings, SensorAxes};
use equipoise_core::message::{Component, GroundSample};
use proptest::prelude::*;

/// As written by BioWare.
const EXPORT: &str = "BioWare 5.3.2.9\tDefault\r\nSampling rate (Hz):\t1000\r\n\r\n\
    abs time (s)\tFx\tFy\tFz\tMx\tMy\tMz\t|Ft|\r\n\
    s\tN\tN\tN\tN·m\tN·m\tN·m\tN\r\n\
    0.000000\t12.0\t-7.0\t700.0\t21.0\t-35.0\t1.0\t700.1\r\n\
    0.001000\t13.0\t-7.0\t700.0\t21.0\t-35.0\t1.0\t700.1\r\n";

fn kistler() -> BioWareSettings {
    let frame = GroundFrame { axes: SensorAxes::ZDown, surface_height_m: 0.048, ..GroundFrame::default() };
    BioWareSettings {
        ground: GroundSettings { frame, ..GroundSettings::default() },
        ..BioWareSettings::default()
    }
}

fn read(text: &str, settings: BioWareSettings) -> Vec<GroundSample> {
    let mut capture = BioWareCapture::new(text.as_bytes(), settings).unwrap();
    let samples = capture.by_ref().collect();
    assert!(capture.rejected().is_empty(), "{}", capture.rejected());
    samples
}

fn refusal(text: &str, settings: BioWareSettings) -> BioWareError {
    BioWareCapture::new(text.as_bytes(), settings).unwrap_err()
}

#[test]
fn a_kistler_export_is_the_force_on_the_person() {
    let samples = read(EXPORT, kistler());
    let [first, second] = &samples[..] else { panic!("{} samples", samples.len()) };
    assert_eq!((first.sample_time_ns, second.sample_time_ns), (1_000_000_000, 1_001_000_000));
    assert_eq!((first.sequence, second.sequence, first.not_measured), (1, 2, 0));
    // Force on the plate with z down and y to the right, converted to force on the person with z up and y to the left:
    // x changes sign, y does not.
    assert_eq!(first.force_n, [-12.0, -7.0, 700.0]);
    let [x, y] = first.cop_m().unwrap();
    // The makers' formulae: ax = -(My - Fx az0)/Fz, ay = (Mx + Fy az0)/Fz.
    let az0 = -0.048;
    assert!((x + (-35.0 - 12.0 * az0) / 700.0).abs() < 1e-12);
    assert!((y + (21.0 - 7.0 * az0) / 700.0).abs() < 1e-12);
}

#[test]
fn force_with_centre_of_pressure_says_the_same_but_for_what_was_not_exported() {
    let (az0, [fx, fy, fz], [mx, my, mz]) = (-0.048, [12.0, -7.0, 700.0], [21.0, -35.0, 1.0]);
    let (ax, ay) = (-(my - fx * az0) / fz, (mx + fy * az0) / fz);
    let tz = mz - fy * ax + fx * ay;
    let text = format!(
        "time (s)\tFx (N)\tFy (N)\tFz (N)\tAx (m)\tAy (m)\tTz (N.m)\n0\t{fx}\t{fy}\t{fz}\t{ax}\t{ay}\t{tz}\n"
    );
    let (whole, centre) = (read(EXPORT, kistler())[0], read(&text, kistler())[0]);
    for axis in 0..3 {
        assert!((whole.moment_nm[axis] - centre.moment_nm[axis]).abs() < 1e-9, "{whole:?} {centre:?}");
    }
    assert_eq!(centre.not_measured, 0);
    let text = text.replace("Tz (N.m)", "other");
    assert_eq!(read(&text, kistler())[0].not_measured, Component::FreeMoment as u32);
    // In millimetres, with an empty plate: a noisy centre of pressure is discarded.
    let text = "time (s)\tFx (N)\tFy (N)\tFz (N)\tAx (mm)\tAy (mm)\n0\t0.1\t0\t0.5\t9000\t-9000\n";
    let empty = read(text, kistler())[0];
    assert!(empty.cop_m().is_err() && empty.moment_nm.iter().all(|nm| nm.abs() < 0.1), "{empty:?}");
}

#[test]
fn the_eight_channels_of_a_real_plate_give_the_rows_that_were_computed_elsewhere() {
    let shared = std::env::var_os("EQUIPOISE_SHARED")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")), PathBuf::from);
    let path = shared.join("data/wire/kistler_expected.json");
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("skipped: {} cannot be read; set EQUIPOISE_SHARED", path.display());
        return;
    };
    let expected: serde_json::Value = serde_json::from_str(&text).unwrap();
    let numbers = |value: &serde_json::Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    };
    let sensitivity = numbers(&expected["S"]);
    let offsets_m = [expected["a"].as_f64().unwrap(), expected["b"].as_f64().unwrap()];
    assert_eq!((offsets_m, expected["az0"].as_f64()), ([0.12, 0.2], Some(-0.048)));
    let mut compared = 0;
    for row in expected["rows"].as_object().unwrap().values() {
        let volts = numbers(&row["volts"]);
        let channels = volts.iter().zip(&sensitivity).map(|(volts, per)| (1000.0 * volts / per).to_string());
        let channels = channels.collect::<Vec<_>>().join("\t");
        let text = format!(
            "time (s)\tfx12 (N)\tfx34 (N)\tfy14 (N)\tfy23 (N)\tfz1 (N)\tfz2 (N)\tfz3 (N)\tfz4 (N)\n0\t{channels}\n"
        );
        let sample = read(&text, BioWareSettings { sensor_offsets_m: Some(offsets_m), ..kistler() })[0];
        let reported = |name: &str| row[name].as_f64().unwrap();
        let [x, y] = sample.cop_m().unwrap();
        // The person's x is the plate's; y has the opposite sign.
        assert!((x - reported("ax")).abs() < 1e-6 && (y + reported("ay")).abs() < 1e-6, "{row} {sample:?}");
        let force_n = [-reported("Fx"), reported("Fy"), reported("Fz")];
        assert!(sample.force_n.iter().zip(force_n).all(|(a, b)| (a - b).abs() < 1e-9), "{row} {sample:?}");
        assert!((sample.moment_nm[2] - reported("Mz")).abs() < 1e-9);
        compared += 1;
    }
    assert!(compared >= 3, "{compared}");
}

#[test]
fn units_are_never_guessed() {
    let without_units = "abs time\tFx\tFy\tFz\tMx\tMy\tMz\n0\t1\t2\t700\t1\t2\t3\n";
    let BioWareError::NoUnit { line: 1, column, .. } = refusal(without_units, kistler()) else { panic!() };
    assert_eq!(column, "abs time");
    let units = Units::parse("s, kN, N.mm").unwrap();
    let without_units = without_units.replace("700", "0.7");
    let sample = read(&without_units, BioWareSettings { units, ..kistler() })[0];
    assert_eq!(sample.force_n, [-1e3, 2e3, 700.0], "declared");
    // Units in the file take precedence over declared ones.
    let pounds = without_units.replace("Fz", "Fz (lbf)");
    let sample = read(&pounds, BioWareSettings { units: Units::parse("s,N,N.m").unwrap(), ..kistler() })[0];
    assert!((sample.force_n[2] - 0.7 * 4.448_221_615).abs() < 1e-5, "{sample:?}");
    let odd = EXPORT.replace("s\tN\tN\tN\t", "s\tN\tN\tstone\t");
    let BioWareError::UnknownUnit { line: 4, unit, .. } = refusal(&odd, kistler()) else { panic!() };
    assert_eq!(unit, "stone");
    let moment_as_force = EXPORT.replace("s\tN\tN\tN\t", "s\tN\tN\tN.m\t");
    assert!(matches!(refusal(&moment_as_force, kistler()), BioWareError::UnknownUnit { .. }));
    for wrong in ["furlong", "N,kN", "s,s"] {
        assert!(Units::parse(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn other_separators_and_decimal_commas_are_read() {
    let expected = read(EXPORT, kistler());
    let commas = EXPORT.replace('.', ",").replace("N·m", "Nm");
    assert_eq!(read(&commas, kistler()), expected);
    assert_eq!(read(&commas.replace('\t', ";"), kistler()), expected);
    assert_eq!(read(&EXPORT.replace('\t', ","), kistler()), expected);
    let latin: Vec<u8> = EXPORT.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
    assert_eq!(BioWareCapture::new(&latin[..], kistler()).unwrap().collect::<Vec<_>>(), expected);
}

#[test]
fn of_two_plates_one_must_be_named() {
    let text = "abs time (s)\tFx (N)\tFy (N)\tFz (N)\tAx (m)\tAy (m)\tFx (N)\tFy (N)\tFz (N)\tAx (m)\tAy (m)\n\
                0\t1\t2\t300\t0.1\t0.1\t3\t4\t400\t0.2\t0.2\n";
    assert_eq!(refusal(text, kistler()), BioWareError::WhichPlate { line: 1, plates: 2 });
    for (plate, vertical_n) in [(1, 300.0), (2, 400.0)] {
        let sample = read(text, BioWareSettings { plate: Some(plate), ..kistler() })[0];
        assert_eq!(sample.force_n[2], vertical_n);
    }
    let none = refusal(text, BioWareSettings { plate: Some(3), ..kistler() });
    assert_eq!(none, BioWareError::NoSuchPlate { line: 1, plate: 3, plates: 2 });
}

#[test]
fn what_is_no_export_is_refused_and_what_is_no_row_is_counted() {
    assert_eq!(refusal("", kistler()), BioWareError::NoHead);
    assert_eq!(refusal(&"nothing\n".repeat(1000), kistler()), BioWareError::NoHead);
    let reported = refusal("time (s)\tFz (N)\n0\t1\n", kistler()).to_string();
    assert!(reported.contains("there are time, fz"), "{reported}");
    let channels = "time (s)\tfx12 (N)\tfx34 (N)\tfy14 (N)\tfy23 (N)\tfz1 (N)\tfz2 (N)\tfz3 (N)\tfz4 (N)\n";
    assert_eq!(refusal(channels, kistler()), BioWareError::NoOffsets { line: 1 });

    let text = EXPORT.to_owned()
        + "0.001\t1\t2\t3\t4\t5\t6\t7\n0.002\tnan\t2\t3\t4\t5\t6\t7\n0.003\t1\t2\n\n0.004\t1e9\t2\t3\t4\t5\t6\t7\n0.005\t1\t2\t3\t4\t5\t6\t7\n";
    let mut capture = BioWareCapture::new(text.as_bytes(), kistler()).unwrap();
    assert_eq!(capture.by_ref().count(), 3);
    let reported = "1 implausible (first at line 12), 1 not_a_number (first at line 9), 1 time_not_increasing (first at \
                line 8), 1 unreadable_row (first at line 10)";
    assert_eq!(capture.rejected().to_string(), reported);
    let endless = EXPORT.to_owned() + &"7".repeat(1 << 20);
    assert_eq!(BioWareCapture::new(endless.as_bytes(), kistler()).unwrap().count(), 2);
}

/// A reader that fails after the text.
#[derive(Debug)]
struct Failing<'a>(&'a [u8]);

impl Read for Failing<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.0.read(buffer)? {
            0 => Err(io::Error::other("bad sector")),
            read => Ok(read),
        }
    }
}

#[test]
fn a_file_that_cannot_be_read_to_its_end_has_a_fault() {
    let mut capture = BioWareCapture::new(Failing(EXPORT.as_bytes()), kistler()).unwrap();
    assert_eq!((capture.by_ref().count(), capture.fault()), (2, Some((8, "bad sector"))));
    assert_eq!(capture.next(), None);
    let long = format!("{EXPORT}{}", "0.002\t".repeat(20_000));
    let mut capture = BioWareCapture::new(long.as_bytes(), kistler()).unwrap();
    capture.by_ref().for_each(drop);
    let (_, cause) = capture.fault().unwrap();
    assert!(cause.contains("more than"), "{cause}");
    let head = BioWareCapture::new(Failing(b"BioWare 5\r\n"), kistler()).unwrap_err();
    assert_eq!(head, BioWareError::Read { line: 2, reason: "bad sector".to_owned() });
    let mut whole = BioWareCapture::new(EXPORT.as_bytes(), kistler()).unwrap();
    assert_eq!((whole.by_ref().count(), whole.fault()), (2, None));
}

#[test]
fn a_first_row_in_quotation_marks_is_not_a_unit_line() {
    let text = "\"time (s)\",\"Fx (N)\",\"Fy (N)\",\"Fz (N)\",\"Mx (N.m)\",\"My (N.m)\",\"Mz (N.m)\"\n\
        \"0.0\",\"1\",\"2\",\"700\",\"1\",\"2\",\"3\"\n\"0.1\",\"1\",\"2\",\"710\",\"1\",\"2\",\"3\"\n";
    let vertical_n: Vec<f64> = read(text, kistler()).iter().map(|sample| sample.force_n[2]).collect();
    assert_eq!(vertical_n, [700.0, 710.0]);
}

#[test]
fn times_since_1970_are_a_wall_clock() {
    let capture = BioWareCapture::new(EXPORT.as_bytes(), kistler()).unwrap();
    assert_eq!((capture.wall_clock_ns(), capture.first_s()), (None, Some(0.0)));
    let text = EXPORT.replace("\n0.00", "\n1700000000.00");
    let mut capture = BioWareCapture::new(text.as_bytes(), kistler()).unwrap();
    assert_eq!(capture.wall_clock_ns(), Some(1_700_000_000_000_000_000));
    assert_eq!(
        capture.nth(1).unwrap().sample_time_ns.abs_diff(1_001_000_000) / 1000,
        0,
        "f64 has microseconds there"
    );
}

proptest! {
    #[test]
    fn damage_never_reaches_a_sample(
        hits in proptest::collection::vec((0_usize..500, any::<u8>()), 0..8), more in ".{0,80}",
    ) {
        let mut bytes = EXPORT.as_bytes().to_vec();
        for (at, value) in hits {
            let at = at % bytes.len();
            bytes[at] = value;
        }
        bytes.extend(more.as_bytes());
        if let Ok(capture) = BioWareCapture::new(&bytes[..], kistler()) {
            let mut last_ns = 0;
            for sample in capture {
                prop_assert!(sample.sample_time_ns > last_ns);
                last_ns = sample.sample_time_ns;
                prop_assert!(sample.force_n.iter().chain(&sample.moment_nm).all(|number| number.is_finite()));
            }
        }
    }
}
