//! Compares the core with another program: static poses with loads in the hands, computed with the Pinocchio rigid-body
//! library, which shares neither code nor method with it.
//!
//! `golden/static.json` is this project's (`golden/make.py` writes it). A second, larger file is used if present:
//! `golden/pinocchio_static.json` in the folder given by `EQUIPOISE_SHARED`.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use equipoise_core::body::{Anthropometry, Joint, SEGMENTS, Segment, Side, Skeleton};
use equipoise_core::frame::{self, Pose, StationWorld};
use equipoise_core::overload::{self, FootLoads, Loading, LoadingSigma, Swing};
use equipoise_core::sesc::{self, Phi};
use nalgebra::Vector3;
use serde::Deserialize;

const CENTRE_TOLERANCE_M: f64 = 1e-9;
const TORQUE_TOLERANCE_NM: f64 = 1e-6;

const EXACT: LoadingSigma = LoadingSigma::EXACT;

/// A file of reference values; arrays over segments are in the order of [`Segment`].
#[derive(Deserialize)]
struct Reference {
    gravity: f64,
    mass_kg: f64,
    segments: Vec<String>,
    parent: Vec<i64>,
    offset_in_parent_m: [[f64; 3]; SEGMENTS],
    segment_mass_kg: [f64; SEGMENTS],
    segment_com_m: [[f64; 3]; SEGMENTS],
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    quat: [[f64; 4]; SEGMENTS],
    origin_m: [[f64; 3]; SEGMENTS],
    com_m: [f64; 3],
    load_kg: f64,
    hand_point_m: BTreeMap<String, [f64; 3]>,
    zeta: BTreeMap<String, f64>,
    eta: BTreeMap<String, f64>,
    cop_wo_m: [f64; 2],
    cop_wt_m: [f64; 2],
    delta_tau_nm: [[f64; 3]; SEGMENTS],
}

impl Reference {
    fn read(file: &Path) -> Reference {
        let text = fs::read_to_string(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", file.display()))
    }

    /// Φ with the segment lengths of one pose, as in the pipeline. The file's own offsets are rounded to nine decimals,
    /// and along a chain of eight that alone exceeds the tolerance.
    fn phi(&self, pose: &Pose<StationWorld>) -> Phi {
        let seen = Skeleton::of(pose);
        for (seen, stated) in seen.offset_m.iter().flatten().zip(self.offset_in_parent_m.iter().flatten()) {
            assert!((seen - stated).abs() < 1e-8, "the pose has other bones than the body");
        }
        let body = Anthropometry {
            mass_fraction: self.segment_mass_kg.map(|mass_kg| mass_kg / self.mass_kg),
            com_m: self.segment_com_m,
            // Φ does not contain the grips.
            hand_length_m: 0.0,
        };
        Phi::of(&seen, &body)
    }
}

impl Case {
    fn pose(&self) -> Pose<StationWorld> {
        Pose::new(self.origin_m.map(Vector3::from), self.quat.map(frame::rotation))
    }

    fn loading(&self, reference: &Reference) -> Loading {
        let delta_f_n = self.load_kg * reference.gravity;
        let of =
            |shares: &BTreeMap<String, f64>| Side::BOTH.map(|side| *shares.get(name(side)).unwrap_or(&0.0));
        Loading {
            cop_measured_m: self.cop_wt_m,
            cop_estimated_m: self.cop_wo_m,
            vertical_n: reference.mass_kg * reference.gravity + delta_f_n,
            delta_f_n,
            grip_m: Side::BOTH
                .map(|side| Vector3::from(*self.hand_point_m.get(name(side)).unwrap_or(&[0.0; 3]))),
            eta: of(&self.eta),
            feet: FootLoads::Common { zeta: of(&self.zeta) },
            swing: Swing::NONE,
        }
    }
}

fn name(side: Side) -> &'static str {
    match side {
        Side::Left => "Left",
        Side::Right => "Right",
    }
}

/// Compares every case of a file; returns the largest differences, m and N m.
fn compare(file: &Path) -> (usize, f64, f64) {
    let reference = Reference::read(file);
    for segment in Segment::ALL {
        let parent = segment.parent().map_or(-1, |parent| parent.index() as i64);
        assert_eq!(reference.segments[segment.index()], segment.name(), "order of the segments");
        assert_eq!(reference.parent[segment.index()], parent, "parent of {}", segment.name());
    }
    let (mut worst_m, mut worst_nm) = (0.0_f64, 0.0_f64);
    for (number, case) in reference.cases.iter().enumerate() {
        let pose = case.pose();
        let off_m = (sesc::centre_of_mass(&pose, &reference.phi(&pose)) - Vector3::from(case.com_m)).norm();
        assert!(off_m <= CENTRE_TOLERANCE_M, "case {number}: the centre of mass is off by {off_m:e} m");
        worst_m = worst_m.max(off_m);

        let torques = overload::torques(&pose, &case.loading(&reference), &EXACT);
        for (joint, torque) in Joint::ALL.into_iter().zip(torques) {
            let expected = Vector3::from(case.delta_tau_nm[joint.segment().index()]);
            let off_nm = (torque.torque_nm - expected).norm();
            let joint = joint.name();
            assert!(off_nm <= TORQUE_TOLERANCE_NM, "case {number}, {joint}: off by {off_nm:e} N m");
            worst_nm = worst_nm.max(off_nm);
        }
    }
    (reference.cases.len(), worst_m, worst_nm)
}

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn our_own_cases_agree_with_pinocchio() {
    let (cases, worst_m, worst_nm) = compare(&folder().join("golden/static.json"));
    println!("{cases} cases: centre of mass within {worst_m:.1e} m, torques within {worst_nm:.1e} N m");
    assert_eq!(cases, 6);
}

#[test]
fn shared_cases_agree_with_pinocchio() {
    let shared =
        std::env::var_os("EQUIPOISE_SHARED").map_or_else(|| folder().join("../../shared"), PathBuf::from);
    let file = shared.join("golden/pinocchio_static.json");
    if !file.exists() {
        println!("skipped: there is no {} (set EQUIPOISE_SHARED)", file.display());
        return;
    }
    let (cases, worst_m, worst_nm) = compare(&file);
    println!("{cases} cases: centre of mass within {worst_m:.1e} m, torques within {worst_nm:.1e} N m");
    assert!(cases >= 24, "only {cases} cases");
}
