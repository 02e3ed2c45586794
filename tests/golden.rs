//! Compares the core with other programs, which share neither code nor method with it: static poses with loads in the
//! hands, computed by the rigid-body library Pinocchio, and fast motions, by Pinocchio and MuJoCo.
//!
//! `golden/static.json` and `golden/motion.json` are this project's (`golden/make.py` and `make_motion.py` write them). A
//! further file is used if present: `golden/pinocchio_static.json` in the folder given by `EQUIPOISE_SHARED`.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use bytemuck::Zeroable;
use equipoise_core::body::{Anthropometry, Joint, SEGMENTS, Segment, Side, Skeleton};
use equipoise_core::frame::{self, Pose, StationWorld, SuitWorld};
use equipoise_core::motion::{Accelerations, History, MassDistribution, Snapshot};
use equipoise_core::overload::{self, FootDeviation, FootLoads, Loading, LoadingSigma, Swing};
use equipoise_core::sesc::{self, Phi};
use nalgebra::Vector3;
use serde::Deserialize;

const CENTRE_TOLERANCE_M: f64 = 1e-9;
const TORQUE_TOLERANCE_NM: f64 = 1e-6;
/// Four times the truncation of the parabola over five states 0.1 ms apart, N and N m: it is 1.3e-3 N there, and 5.1e-3 N
/// at 0.2 ms.
const MOTION_TOLERANCE_N: f64 = 5e-3;

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
        let of = |fractions: &BTreeMap<String, f64>| {
            Side::BOTH.map(|side| *fractions.get(name(side)).unwrap_or(&0.0))
        };
        Loading {
            cop_measured_m: self.cop_wt_m,
            cop_estimated_m: self.cop_wo_m,
            vertical_n: reference.mass_kg * reference.gravity + delta_f_n,
            delta_f_n,
            grip_m: Side::BOTH
                .map(|side| Vector3::from(*self.hand_point_m.get(name(side)).unwrap_or(&[0.0; 3]))),
            eta: of(&self.eta),
            feet: FootLoads::Common { zeta: of(&self.zeta) },
            deviation: FootDeviation::NONE,
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

/// Bodies in motion, `golden/motion.json`.
#[derive(Deserialize)]
struct Motions {
    step_s: f64,
    offset_m: [[f64; 3]; SEGMENTS],
    segment_mass_kg: [f64; SEGMENTS],
    segment_com_m: [[f64; 3]; SEGMENTS],
    gyration_m2: [[f64; 3]; SEGMENTS],
    cases: Vec<MotionCase>,
}

#[derive(Deserialize)]
struct MotionCase {
    load_kg: f64,
    inertia_axes: [[f64; 3]; 3],
    force_n: [f64; 3],
    moment_nm: [f64; 3],
    states: Vec<BodyState>,
}

#[derive(Deserialize)]
struct BodyState {
    pelvis_m: [f64; 3],
    quat: [[f64; 4]; SEGMENTS],
}

impl Motions {
    fn pose(&self, state: &BodyState) -> Pose<SuitWorld> {
        let rotation = state.quat.map(frame::rotation);
        let mut origin_m = [Vector3::from(state.pelvis_m); SEGMENTS];
        // Parents precede their children.
        for segment in Segment::ALL {
            let Some(parent) = segment.parent() else { continue };
            let (segment, parent) = (segment.index(), parent.index());
            origin_m[segment] = origin_m[parent] + rotation[parent] * Vector3::from(self.offset_m[segment]);
        }
        Pose::new(origin_m, rotation)
    }
}

#[test]
fn inertial_force_and_moment_of_fast_motions_agree_with_pinocchio_and_mujoco() {
    let file = folder().join("golden/motion.json");
    let motions: Motions = serde_json::from_str(&fs::read_to_string(file).unwrap()).unwrap();
    let mass_kg: f64 = motions.segment_mass_kg.iter().sum();
    let body = Anthropometry {
        mass_fraction: motions.segment_mass_kg.map(|segment_kg| segment_kg / mass_kg),
        com_m: motions.segment_com_m,
        hand_length_m: 0.0,
    };
    let masses = MassDistribution { body: &body, gyration_m2: &motions.gyration_m2 };
    let step_ns = (motions.step_s * 1e9).round() as u64;
    // The core has the body without a load, and principal axes of inertia that are the segment's.
    let is_core_s = |case: &&MotionCase| {
        case.load_kg == 0.0 && case.inertia_axes == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    };
    let mut compared = 0;
    for case in motions.cases.iter().filter(is_core_s) {
        let mut history = History::zeroed();
        for (index, state) in (1..).zip(&case.states) {
            let pose = motions.pose(state);
            history.push(Snapshot::new(index * step_ns, &pose, &pose.shifted(Vector3::zeros()), &body));
        }
        let middle_ns = case.states.len().div_ceil(2) as u64 * step_ns;
        let inertia = std::iter::from_fn(|| history.next(2 * step_ns, Accelerations::Positions, &masses))
            .find_map(|(snapshot, inertia)| inertia.filter(|_| snapshot.time_ns == middle_ns));
        let inertia = inertia.expect("motion at the middle state");
        let pose = motions.pose(&case.states[case.states.len() / 2]);
        let centre_m: Vector3<f64> = (0..SEGMENTS)
            .map(|i| {
                let com_m = pose.origin[i] + pose.world_from_segment[i] * Vector3::from(body.com_m[i]);
                body.mass_fraction[i] * com_m
            })
            .sum();
        let force_n = Vector3::from(case.force_n);
        let weight_n = mass_kg * 9.81 * Vector3::z();
        let off_n = (mass_kg * Vector3::from(inertia.acceleration_m_per_s2) + weight_n - force_n).amax();
        assert!(off_n < MOTION_TOLERANCE_N, "force off by {off_n:e} N");
        let about_centre_nm = Vector3::from(case.moment_nm) - centre_m.cross(&force_n);
        let off_nm = (mass_kg * Vector3::from(inertia.momentum_rate_m2_per_s2) - about_centre_nm).amax();
        assert!(off_nm < MOTION_TOLERANCE_N, "moment off by {off_nm:e} N m");
        compared += 1;
    }
    assert_eq!(compared, 3);
}
