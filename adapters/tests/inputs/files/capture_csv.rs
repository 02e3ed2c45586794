//! The CSV layout: columns by name, with units; unusable rows are counted; and a real person on a real plate.

use std::path::PathBuf;

use equipoise_adapters::capture::{CsvCapture, CsvError};
use equipoise_core::body::Segment;
use equipoise_core::message::GroundDevice;

/// A row of the standard layout: time, all segments at `x`, quaternions `[w, 0, 0, 0]`, a vertical force.
fn row(time: &str, x: &str, w: &str) -> Vec<String> {
    let mut row = vec![time.to_owned()];
    for _ in Segment::ALL {
        row.extend([x, "0", "1", w, "0", "0", "0"].map(str::to_owned));
    }
    row.extend(["1", "2", "700", "10", "-20", "0.5"].map(str::to_owned));
    row
}

fn head() -> Vec<String> {
    let mut head = vec!["t_s".to_owned()];
    for segment in Segment::ALL {
        for part in ["px_m", "py_m", "pz_m", "qw", "qx", "qy", "qz"] {
            head.push(format!("{}_{part}", segment.name()));
        }
    }
    head.extend(["Fx_N", "Fy_N", "Fz_N", "Mx_Nm", "My_Nm", "Mz_Nm"].map(str::to_owned));
    head
}

fn text(lines: &[Vec<String>]) -> String {
    lines.iter().map(|line| line.join(",") + "\n").collect()
}

#[test]
fn rows_become_pairs_of_samples() {
    let text = text(&[head(), row("0", "0.25", "0.98"), row("0.0333333333", "0.5", "1")]);
    let mut capture = CsvCapture::new(text.as_bytes()).unwrap();
    let samples: Vec<_> = capture.by_ref().collect();
    assert!(capture.rejected().is_empty(), "{}", capture.rejected());
    let [(suit, ground), (second, _)] = &samples[..] else { panic!("{} rows", samples.len()) };
    assert_eq!((suit.sequence, suit.sample_time_ns, suit.arrival_ns), (1, 1_000_000_000, 1_000_000_000));
    assert_eq!((second.sequence, second.sample_time_ns), (2, 1_033_333_333));
    assert_eq!((suit.blocks, suit.sample_time_sigma_ns), (0, 0));
    assert_eq!(suit.position_m[22], [0.25, 0.0, 1.0]);
    assert_eq!(suit.orientation_wxyz[0], [1.0, 0.0, 0.0, 0.0], "normalised");
    assert_eq!(ground.force_n, [1.0, 2.0, 700.0]);
    assert_eq!((ground.per_foot, ground.feet()), (0, None), "one wrench says nothing of each foot");
    assert_eq!(ground.cop_m(), Ok([20.0 / 700.0, 10.0 / 700.0]));
    assert_eq!(ground.devices, GroundDevice::Plate as u32);
}

#[test]
fn columns_go_by_name_and_unit_and_not_by_place() {
    let (mut head, mut row) = (head(), row("5000", "1", "1"));
    head[0] = "t_ms".to_owned();
    head[1] = "Pelvis_px_mm".to_owned();
    head.push("comment".to_owned());
    row.push("x".to_owned());
    head.reverse();
    row.reverse();
    let text = text(&[head, row]);
    let (suit, ground) = CsvCapture::new(text.as_bytes()).unwrap().next().unwrap();
    assert_eq!(suit.sample_time_ns, 6_000_000_000);
    assert_eq!((suit.position_m[0][0], suit.position_m[1][0]), (0.001, 1.0));
    assert_eq!(ground.force_n[2], 700.0);
}

#[test]
fn semicolons_between_columns_are_read_and_decimal_commas_are_refused() {
    let text = text(&[head(), row("0.5", "0.25", "1"), row("0.6", "0.5", "1")]);
    let semicolons = text.replace(',', ";");
    let mut capture = CsvCapture::new(semicolons.as_bytes()).unwrap();
    let samples: Vec<_> = capture.by_ref().collect();
    assert!(capture.rejected().is_empty(), "{}", capture.rejected());
    assert_eq!(samples, CsvCapture::new(text.as_bytes()).unwrap().collect::<Vec<_>>());

    let error = CsvCapture::new(semicolons.replace('.', ",").as_bytes()).unwrap_err();
    assert!(matches!(&error, CsvError::DecimalComma { field } if field == "0,5"), "{error}");
    let said = error.to_string();
    assert!(said.starts_with("line 2: 0,5 has a comma") && said.contains("with a point"), "{said}");
    // A header line without rows, and a row that is not text, are not taken for decimal commas.
    let alone = head().join(";");
    assert!(CsvCapture::new(alone.as_bytes()).unwrap().next().is_none());
}

#[test]
fn a_missing_column_is_named_with_the_one_most_like_it() {
    let mut head = head();
    let at = head.iter().position(|name| name == "LeftFoot_qx").unwrap();
    head[at] = "LeftFot_qx".to_owned();
    let text = text(&[head, row("0", "1", "1")]);
    let error = CsvCapture::new(text.as_bytes()).unwrap_err();
    let CsvError::MissingColumn { missing, nearest } = &error else { panic!("{error}") };
    assert_eq!((missing.as_str(), nearest.as_str()), ("LeftFoot_qx", "LeftFot_qx"));
    assert!(CsvCapture::new(&b""[..]).is_err());
    assert!(CsvCapture::new(&[0xff, 0xfe, b'\n', 0xff][..]).is_err());
}

#[test]
fn rows_that_cannot_be_used_are_counted_with_their_first_line() {
    let mut short = row("0.6", "1", "1");
    short.pop();
    let text = text(&[
        head(),
        row("0", "1", "1"),
        row("0.1", "NaN", "1"),
        row("0.2", "1", "0.9"),
        row("0.2", "1", "1.1"),
        row("0.3", "1", "1"),
        row("0.3", "1", "1"),
        row("1e300", "1", "1"),
        row("-7", "1", "1"),
        row("inf", "1", "1"),
        short,
        row("0.4", "1", "1"),
    ]);
    let mut capture = CsvCapture::new(text.as_bytes()).unwrap();
    let sequences: Vec<_> = capture.by_ref().map(|(suit, _)| suit.sequence).collect();
    assert_eq!(sequences, [1, 2, 3]);
    let rejected = capture.rejected();
    assert_eq!(rejected.total(), 8, "{rejected}");
    assert_eq!(
        rejected.to_string(),
        "3 not_a_number (first at line 3), 2 not_a_rotation (first at line 4), 1 time_not_increasing (first at \
         line 7), 2 time_out_of_range (first at line 8)"
    );
}

#[test]
fn a_row_that_is_not_text_is_one_row() {
    let mut bytes = text(&[head(), row("0", "1", "1")]).into_bytes();
    bytes.extend(b"\xff\xfe,1\n");
    bytes.extend(row("1", "1", "1").join(",").bytes());
    let mut capture = CsvCapture::new(&bytes[..]).unwrap();
    assert_eq!(capture.by_ref().count(), 2);
    assert_eq!(capture.rejected().of("unreadable_row"), 1);
}

#[test]
fn figaroh_a_real_person_weighs_what_the_plate_says() {
    let shared = std::env::var_os("EQUIPOISE_SHARED")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")), PathBuf::from);
    let path = shared.join("data/human_motion/figaroh_30hz.csv");
    if !path.exists() {
        println!("skipped: {} is not there; set EQUIPOISE_SHARED to the reference data", path.display());
        return;
    }
    let mut capture = CsvCapture::open(&path).unwrap();
    let samples: Vec<_> = capture.by_ref().collect();
    assert!(capture.rejected().is_empty(), "{}", capture.rejected());
    assert_eq!(samples.len(), 2692);
    let mean_n = samples.iter().map(|(_, ground)| ground.force_n[2]).sum::<f64>() / samples.len() as f64;
    let mass_kg = mean_n / 9.81;
    assert!((mass_kg / 94.4 - 1.0).abs() < 0.01, "{mass_kg} kg");
    for (suit, _) in &samples {
        for q in suit.orientation_wxyz {
            assert!((q.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn a_line_without_an_end_is_not_read_for_ever() {
    let refused = CsvCapture::new(std::io::repeat(b'a')).unwrap_err();
    assert!(refused.to_string().contains("65536 bytes"), "{refused}");
}
