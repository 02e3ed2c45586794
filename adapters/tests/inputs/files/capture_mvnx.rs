//! `.mvnx`, versions 3 and 4: generated files, damaged ones, and real ones where available.

use std::path::PathBuf;

use equipoise_adapters::capture::{MvnxCapture, MvnxError};
use equipoise_core::body::{JOINTS, SEGMENTS, Segment};
use equipoise_core::message::SuitSample;
use equipoise_core::message::suit::SuitBlocks;
use proptest::prelude::*;

use super::mvnx_file::{
    Style, TAIL, UNIX_MS, V3, V4, calibration, file, frame, head, null_pose, orientation, positions, read,
    refusal,
};

#[test]
fn both_versions_and_any_order_give_the_same_samples() {
    let mut all = Vec::new();
    for style in [V3, V4, Style { shuffled: true, ..V3 }, Style { shuffled: true, ..V4 }] {
        let text = file(style, 5);
        let mut capture = MvnxCapture::new(text.as_bytes()).unwrap();
        assert_eq!(capture.version(), Some(if style.version == 3 { "3" } else { "4" }));
        assert_eq!((capture.rate_hz(), capture.wall_clock_ns()), (240.0, Some(UNIX_MS * 1_000_000)));
        let subject = capture.subject().clone();
        assert_eq!(subject.name.as_deref(), Some("anon-1 <x>"));
        let origins_m = subject.null_pose.origins_m.unwrap();
        assert!((origins_m[Segment::Head.index()][2] - null_pose()[Segment::Head.index()][2]).abs() < 1e-6);
        let toe = Segment::LeftToe.index() as u16 + 1;
        assert_eq!(subject.null_pose.points[&(toe, 2)], ("pTip".to_owned(), [0.1, 0.02, -0.03]));
        assert_eq!(subject.null_pose.points.len(), 2 * SEGMENTS, "the prop's are not the body's");
        let samples: Vec<_> = capture.by_ref().collect();
        assert!(capture.rejected().is_empty() && capture.fault().is_none(), "{}", capture.rejected());
        all.push(samples);
    }
    for (index, sample) in all[0].iter().enumerate() {
        let time_s = index as f64 / 240.0;
        assert_eq!(sample.sample_time_ns, 1_000_000_000 + (time_s * 1e9).round() as u64);
        assert_eq!((sample.sequence, sample.device_counter), (index as u64 + 1, index as u32));
        let known = positions(time_s);
        for segment in Segment::ALL {
            let place = segment.index();
            let reported = sample.orientation_wxyz[place];
            let cosine: f64 = reported.iter().zip(orientation(segment, time_s)).map(|(a, b)| a * b).sum();
            assert!(cosine > 1.0 - 1e-9, "{segment:?}: {reported:?}");
            assert!((sample.position_m[place][1] - known[place][1]).abs() < 1e-6);
            assert_eq!(sample.velocity_m_per_s[place][..2], [1.0, place as f64]);
            assert_eq!(sample.acceleration_m_per_s2[place][..2], [2.0, place as f64]);
            assert_eq!(sample.angular_velocity_rad_per_s[place][..2], [3.0, place as f64]);
        }
        for joint in 0..JOINTS {
            assert_eq!(sample.joint_angle_deg[joint][..2], [joint as f64, 2.5]);
        }
        assert_eq!(sample.com_m, [0.1, 0.2, 0.9]);
        let blocks = [
            SuitBlocks::LinearKinematics,
            SuitBlocks::AngularKinematics,
            SuitBlocks::JointAngles,
            SuitBlocks::CentreOfMass,
        ];
        assert!(blocks.into_iter().all(|block| sample.has(block)));
    }
    for other in &all[1..] {
        assert_eq!(all[0].len(), other.len());
        for (one, other) in all[0].iter().zip(other) {
            let apart = one.orientation_wxyz.iter().flatten().zip(other.orientation_wxyz.iter().flatten());
            assert!(apart.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) < 3e-6);
            let orientation_wxyz = one.orientation_wxyz;
            assert_eq!(*one, SuitSample { orientation_wxyz, ..*other });
        }
    }
}

#[test]
fn time_is_index_over_rate_and_a_hole_follows_the_wall_clock() {
    let style = Style { rate_hz: 60.0, ..V4 };
    let whole = read(&file(style, 40)).0;
    // 1/60 s is not a whole number of milliseconds, but the stamps have equal intervals.
    for pair in whole.windows(2) {
        assert!((pair[1].sample_time_ns - pair[0].sample_time_ns).abs_diff(16_666_667) <= 1);
    }
    // Frames lost in the export: the index continues, the wall clock reveals the gap.
    let late = |index: u64| {
        let ms = UNIX_MS + (index as f64 / 60.0 * 1e3).round() as u64;
        frame(style, index).replace(&format!("ms=\"{ms}\""), &format!("ms=\"{}\"", ms + 500))
    };
    let frames: String = (0..10).map(|index| frame(style, index)).chain((10..20).map(late)).collect();
    let (samples, rejected, _) = read(&(head(style) + &calibration(style) + &frames + TAIL));
    assert_eq!((samples.len(), rejected.as_str()), (20, "none"));
    assert!((samples[10].sample_time_ns - samples[9].sample_time_ns).abs_diff(516_666_667) < 1_000_000);
    assert!((samples[19].sample_time_ns - samples[10].sample_time_ns).abs_diff(150_000_000) < 2);
}

#[test]
fn a_wall_clock_that_is_set_back_moves_no_frame() {
    let style = Style { rate_hz: 60.0, ..V4 };
    let stepped = |index: u64, step_ms: i64| {
        let ms = UNIX_MS + (index as f64 / 60.0 * 1e3).round() as u64;
        frame(style, index)
            .replace(&format!("ms=\"{ms}\""), &format!("ms=\"{}\"", ms.saturating_add_signed(step_ms)))
    };
    let frames: String = (0..30)
        .map(|index| {
            stepped(
                index,
                if index < 10 {
                    0
                } else if index < 20 {
                    -700
                } else {
                    -200
                },
            )
        })
        .collect();
    let text = head(style) + &calibration(style) + &frames + TAIL;
    let mut capture = MvnxCapture::new(text.as_bytes()).unwrap();
    let samples: Vec<SuitSample> = capture.by_ref().collect();
    assert_eq!(samples.len(), 30, "{}", capture.rejected());
    let step_ns = |at: usize| samples[at].sample_time_ns - samples[at - 1].sample_time_ns;
    assert!(step_ns(10).abs_diff(16_666_667) <= 1, "{}", step_ns(10));
    assert!(step_ns(20).abs_diff(516_666_667) < 2_000_000, "{}", step_ns(20));
    let steps = capture.wall_clock_steps();
    assert_eq!((steps.forward, steps.back), (1, 1));
    assert!(steps.forward_ns.abs_diff(500_000_000) < 2_000_000, "{steps:?}");
}

#[test]
fn frames_that_cannot_be_used_are_counted_with_their_line() {
    let good = frame(V4, 0);
    let no_number = frame(V4, 1).replacen("0.1 0.2 0.9", "0.1 x 0.9", 1);
    let twice = frame(V4, 0);
    let cut = frame(V4, 2).replacen("<orientation>1.", "<orientation>1. 1.", 1).replacen(
        "<orientation>0.",
        "<orientation>0 0.",
        1,
    );
    let place = positions(3.0 / 240.0)[0];
    let moved = frame(V4, 3).replacen(&format!("<position>{:.6}", place[0]), "<position>9.5", 1);
    let huge = frame(V4, 4).replacen("<velocity>1.000000", "<velocity>1e300", 1);
    let entity = frame(V4, 5).replacen("<position>", "<position>&x;", 1);
    let without = frame(V4, 6).replace("position>", "place>");
    let bent = frame(V4, 7).replacen("<orientation>", "<orientation>9", 1);
    let text = [
        &head(V4),
        &calibration(V4),
        &good,
        &no_number,
        &twice,
        &cut,
        &moved,
        &huge,
        &entity,
        &without,
        &bent,
    ]
    .map(String::as_str)
    .concat()
        + TAIL;
    let (samples, rejected, fault) = read(&text);
    assert_eq!((samples.len(), fault), (1, None));
    let line = text[..text.find("0.1 x 0.9").unwrap()].lines().count() - 8;
    for reported in [
        format!("not_a_number (first at line {line})"),
        "1 time_not_increasing".to_owned(),
        "2 wrong_count".to_owned(),
        "1 joints_apart".to_owned(),
        "1 implausible".to_owned(),
        "1 no_pose".to_owned(),
        "1 not_a_rotation".to_owned(),
    ] {
        assert!(rejected.contains(&reported), "{reported}: {rejected}");
    }
}

#[test]
fn a_file_that_means_nothing_is_refused_with_line_and_advice() {
    let text = file(V4, 2);
    assert!(matches!(refusal(""), MvnxError::NotMvnx { .. }));
    assert!(refusal("<html></html>").to_string().contains("it begins with html"));
    let no_rate = text.replace("frameRate=\"240\"", "frameRate=\"0\"");
    assert!(
        refusal(&no_rate).to_string().starts_with("line 5: the subject's frameRate is 0"),
        "{}",
        refusal(&no_rate)
    );
    let no_subject = text.replace("subject", "subjecx");
    assert!(refusal(&no_subject).to_string().contains("frameRate is missing"), "{}", refusal(&no_subject));
    let no_knee = text.replace("\"RightLowerLeg\"", "\"Lamp\"");
    assert!(refusal(&no_knee).to_string().contains("missing: RightLowerLeg;"));
    let twice = text.replace("\"RightLowerLeg\"", "\"LeftLowerLeg\"");
    assert!(matches!(refusal(&twice), MvnxError::DuplicateSegment { .. }));
    let no_null = text.replace("\"identity\"", "\"something\"");
    assert!(refusal(&no_null).to_string().contains("no frame of type \"identity\""));
    let no_frames = file(V4, 0);
    assert!(refusal(&no_frames).to_string().contains("no frames"));
    let crossed = text.replace("</joints>", "</segments>");
    let MvnxError::Malformed { line, .. } = refusal(&crossed) else { panic!("{}", refusal(&crossed)) };
    assert_eq!(line as usize, crossed[..crossed.rfind("</segments>").unwrap()].lines().count() + 1);
    // Version 3's arms in a file that declares the internal axes.
    let wrong_axes = head(V4) + &calibration(V4) + &frame(V3, 0) + TAIL;
    let (samples, rejected, _) = read(&wrong_axes);
    assert_eq!((samples.len(), rejected.starts_with("1 joints_apart")), (0, true), "{rejected}");
    let missing = MvnxCapture::open("/nowhere/a.mvnx").unwrap_err().to_string();
    assert!(missing.starts_with("cannot read /nowhere/a.mvnx: "), "{missing}");
}

#[test]
fn entities_depth_and_length_that_exhaust_memory_are_refused() {
    let lol = "<!DOCTYPE mvnx [<!ENTITY a \"0 0 0 0 0 0 0 0\"><!ENTITY b \"&a;&a;&a;&a;&a;&a;&a;&a;\">]>";
    let text =
        file(V4, 2).replacen("<mvnx", &format!("{lol}<mvnx"), 1).replace("<velocity>", "<velocity>&b;");
    let (samples, rejected, _) = read(&text);
    assert_eq!((samples.len(), rejected.starts_with("2 wrong_count")), (0, true), "{rejected}");
    let deep = head(V4) + &"<a>".repeat(1000);
    assert!(refusal(&deep).to_string().contains("within each other"));
    let long = head(V4) + &"7".repeat(300_000);
    assert!(refusal(&long).to_string().contains("more than 262144 bytes"), "{}", refusal(&long));
    let reported = refusal(&(head(V4) + "</" + &"x".repeat(5000) + ">")).to_string();
    assert!(reported.len() < 400, "{reported}");
    let many = head(V4).replace("</segments>", &("<segment label=\"x\"/>".repeat(60) + "</segments>"));
    assert!(refusal(&many).to_string().contains("more than 64 segments"));
    let points = head(V4).replacen("</points>", &("<point label=\"x\"/>".repeat(80) + "</points>"), 1);
    assert!(refusal(&points).to_string().contains("more than 64 points"));
}

#[test]
fn a_file_cut_anywhere_gives_the_frames_before_the_cut() {
    let text = file(V3, 4);
    let whole = read(&text).0;
    let mut reported = 0;
    for length in (0..text.len()).step_by(17) {
        let Ok(mut capture) = MvnxCapture::new(&text.as_bytes()[..length]) else { continue };
        let samples: Vec<_> = capture.by_ref().collect();
        assert!(whole.starts_with(&samples), "cut at {length}");
        assert!(samples.len() == 4 || capture.fault().is_some(), "cut at {length}");
        reported += 1;
    }
    assert!(reported > 100, "{reported}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn damage_never_reaches_a_sample(
        hits in proptest::collection::vec((0_usize..200_000, any::<u8>()), 1..6), cut in 0_usize..200_000,
    ) {
        let mut bytes = file(V4, 2).into_bytes();
        for (at, value) in hits {
            let at = at % bytes.len();
            bytes[at] = value;
        }
        bytes.truncate(cut.max(bytes.len() / 2));
        if let Ok(capture) = MvnxCapture::new(&bytes[..]) {
            let mut last_ns = 0;
            for sample in capture {
                prop_assert!(sample.sample_time_ns > last_ns);
                last_ns = sample.sample_time_ns;
                for quaternion in sample.orientation_wxyz {
                    prop_assert!((quaternion.iter().map(|part| part * part).sum::<f64>() - 1.0).abs() < 1e-9);
                }
                let numbers = sample.position_m.iter().chain(&sample.velocity_m_per_s).chain(&sample.joint_angle_deg);
                prop_assert!(numbers.flatten().all(|number| number.is_finite()));
            }
        }
    }
}

fn real(name: &str) -> Option<MvnxCapture<std::io::BufReader<std::fs::File>>> {
    let shared = std::env::var_os("EQUIPOISE_SHARED")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")), PathBuf::from);
    let path = shared.join("data/mvnx").join(name);
    if !path.exists() {
        println!("skipped: {} is not there; set EQUIPOISE_SHARED", path.display());
        return None;
    }
    Some(MvnxCapture::open(path).unwrap())
}

/// Meri-020 of robotology-playground/xsens-mvn (LGPL, not shipped): version 3, 240 Hz, every channel.
#[test]
fn a_real_file_of_version_3() {
    let Some(mut capture) = real("Meri-020.mvnx") else { return };
    assert_eq!((capture.version(), capture.rate_hz()), (Some("3"), 240.0));
    assert_eq!(capture.wall_clock_ns(), Some(1_478_188_786_272_000_000));
    assert!(capture.subject().null_pose.points.len() > 90);
    let samples: Vec<_> = capture.by_ref().collect();
    assert_eq!((samples.len(), capture.rejected().to_string().as_str()), (4, "none"));
    assert_eq!(samples[3].sample_time_ns - samples[0].sample_time_ns, 12_500_000);
    assert_eq!(samples[0].com_m, [0.216386, 0.092067, 0.967297]);
    // The velocities match the derivatives of the positions.
    for pair in samples.windows(2) {
        for place in 0..SEGMENTS {
            for axis in 0..3 {
                let moved = (pair[1].position_m[place][axis] - pair[0].position_m[place][axis]) * 240.0;
                let reported =
                    (pair[0].velocity_m_per_s[place][axis] + pair[1].velocity_m_per_s[place][axis]) / 2.0;
                assert!((moved - reported).abs() < 0.05, "{place} {axis}: {moved} {reported}");
            }
        }
    }
}

/// test_mocap of andres-fr/blender-mvnx-io (not shipped): version 4, 60 Hz, upper body only.
#[test]
fn a_real_file_of_version_4() {
    let Some(mut capture) = real("test_mocap.mvnx") else { return };
    assert_eq!((capture.version(), capture.rate_hz()), (Some("4"), 60.0));
    assert_eq!(capture.configuration(), Some("UpperBody"));
    let samples: Vec<_> = capture.by_ref().collect();
    assert_eq!((samples.len(), capture.rejected().to_string().as_str()), (112, "none"));
    assert!(samples.iter().all(|sample| sample.has(SuitBlocks::JointAngles)));
}
