//! Profiles that are read, restored or refused.

use std::fs;

use bytemuck::Zeroable;

use equipoise_core::body::Skeleton;
use equipoise_core::frame::{Pose, rotation};
use equipoise_core::handover::experience::Handover;

use super::*;

const BUILD: Build = Build { height_m: 1.77, sex: SexConfig::Unstated };

/// The text of a valid profile with changed content and the checksum of that content.
fn changed(change: impl FnOnce(&mut toml::Table)) -> String {
    let settings = Settings { mass_kg: Some(70.0), ..Settings::for_height(1.7) };
    let mut table: toml::Table = example::text("a", 3, &settings).parse().unwrap();
    change(&mut table);
    sealed(toml::to_string(&table).unwrap())
}

#[test]
fn a_broken_profile_is_refused_and_unchanged() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.toml");
    assert_eq!(Profile::read(&path).unwrap(), None);
    fs::write(&path, "format = 7\nsubject = ").unwrap();
    assert!(Profile::read(&path).unwrap_err().to_string().contains("left as it is"));
    assert_eq!(fs::read_to_string(&path).unwrap(), "format = 7\nsubject = ");
}

#[test]
fn a_profile_of_another_format_is_refused_and_unchanged() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.toml");
    let later = changed(|table| table["format"] = 8.into());
    let earlier = changed(|table| table["format"] = 6.into());
    let without_checksum = "format = 3\nsubject = \"a\"\nmass_kg = 70.0\n".to_owned();
    for text in [later, earlier, without_checksum] {
        fs::write(&path, &text).unwrap();
        let refusal = Profile::read(&path).unwrap_err().to_string();
        assert!(refusal.contains("this version reads format 7 only"), "{refusal}");
        assert_eq!(fs::read_to_string(&path).unwrap(), text);
    }
    let incomplete = changed(|table| drop(table.remove("consistency")));
    fs::write(&path, incomplete).unwrap();
    let refusal = Profile::read(&path).unwrap_err().to_string();
    assert!(refusal.contains("missing field `consistency`"), "{refusal}");
}

#[test]
fn a_profile_of_another_subject_or_of_no_valid_body_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let (path, other) = (directory.path().join("a.toml"), directory.path().join("b.toml"));
    fs::write(&path, changed(|_| ())).unwrap();
    assert!(Profile::read(&path).unwrap().is_some());
    fs::copy(&path, &other).unwrap();
    assert!(Profile::read(&other).unwrap_err().to_string().contains("of the subject a"));
    let handover = |table: &mut toml::Table| {
        let part = HandoverPart::of(&Handover { place_m: [0.4, 0.0, 1.0], excess: 70.0, sigma: 0.1 });
        table.insert("handover".to_owned(), vec![toml::Value::try_from(part).unwrap()].into());
    };
    type Change<'a> = &'a dyn Fn(&mut toml::Table);
    let cases: [(Change<'_>, &str); 14] = [
        (&|table| table["mass_kg"] = 700.0.into(), "mass_kg is 700"),
        (&|table| table["mass_kg"] = f64::NAN.into(), "mass_kg is NaN"),
        (&|table| drop(table.insert("mass_sigma_kg".to_owned(), 300.0.into())), "mass_sigma_kg is 300"),
        (&|table| drop(table.insert("mass_sigma_kg".to_owned(), (-1.0).into())), "mass_sigma_kg is -1"),
        (&|table| table["height_m"] = 17.0.into(), "height_m is 17"),
        (&|table| table["parameters"] = 16.into(), "one is missing"),
        (&|table| table["theta_m"][3] = f64::INFINITY.into(), "θ or P is out of range"),
        (&|table| table["theta_m"][3] = (-5.0).into(), "beyond the reach of a body with a stature of 1.7 m"),
        (&|table| table["covariance_m2"][0] = 300.0.into(), "beyond the reach"),
        (&|table| table["covariance_m2"][0] = (-1.0).into(), "θ or P is out of range"),
        (&|table| table["shift"]["lifts"] = 4.into(), "count of 4 lifts of 3"),
        (&|table| table["last_pose_wxyz"][0][0] = 9.0.into(), "unit length"),
        (&|table| table["last_pose_wxyz"][0][0] = f64::NAN.into(), "unit length"),
        (&handover, "a handover"),
    ];
    for (change, expected) in cases {
        fs::write(&path, changed(change)).unwrap();
        let refusal = Profile::read(&path).unwrap_err().to_string();
        assert!(refusal.contains(expected), "{refusal}");
    }
}

#[test]
fn a_profile_restores_the_stored_subject() {
    let settings = Settings { library: LIBRARY, ..Settings::for_height(1.77) };
    let mut worker = bytemuck::zeroed_box::<Identification>();
    worker.start(&settings);
    let origin = Skeleton::nominal(1.77).t_pose_m().map(Into::into);
    let pose = Pose::new(origin, [rotation([1.0, 0.0, 0.0, 0.0]); SEGMENTS]);
    while !worker.has_body() {
        worker.update_skeleton(&pose, &settings);
    }
    worker.mass_kg = 71.5;
    let mut stored = bytemuck::zeroed_box::<StoredSubject>();
    worker.store(&mut stored);
    stored.performed = Performed::of(70, (0..64).map(|pose| [f64::from(pose) * 0.01; 3 * SEGMENTS]));
    (stored.suggested_before, stored.unholdable, stored.suggested, stored.identifying) = (0b101, 0b10, 2, 0);
    stored.poses_used = 70;
    stored.consistency.recent = [0.1, 0.2, 1.0 / 3.0, 4.0, 5.0];
    (stored.misfit_m2, stored.mass_sigma_kg) = ([1e-4, 4e-5], 1.25);
    let shift = Shift { fatigue: [0.5; 22], damage: 1e-4, lifts: 3, ended: 3, ..Shift::zeroed() };
    let mut experience = Experience::default();
    for excess in [0.25, -0.1] {
        experience.add(Handover { place_m: [0.4, -0.1, 1.1], excess, sigma: 1.0 / 3.0 });
    }
    let written = Profile::of("a", BUILD, &stored, &shift, &experience, 1_000_000).unwrap();
    let read: Profile = toml::from_str(&written.to_toml().unwrap()).unwrap();
    assert_eq!(read, written);
    let message = "the shift goes on: 3 lifts so far".to_owned();
    assert_eq!(read.shift(1_000_060), Ok((shift, 60, message)));
    assert!(read.shift(999_000).unwrap().2.contains("set the clock"));
    assert_eq!(read.experience(), Experience::default(), "not identified");
    assert_eq!(Profile { identified: true, ..read.clone() }.experience(), experience);
    let mut again = bytemuck::zeroed_box::<StoredSubject>();
    read.worker(&settings).unwrap().store(&mut again);
    // The stance part of P is reset.
    let mut expected = bytemuck::zeroed_box::<Identification>();
    assert!(expected.restore(&stored, &settings));
    expected.store(&mut stored);
    assert!(bytemuck::bytes_of(&*again) == bytemuck::bytes_of(&*stored));
    assert_eq!((again.suggested_before, again.unholdable, again.suggested), (0b101, 0b10, 2));
    assert_eq!((again.identifying, again.performed.count()), (0, 70));
    assert_eq!(again.misfit_m2, [1e-4, 4e-5]);
    assert!((again.mass_sigma_kg - 1.25).abs() < 1e-9);
}
