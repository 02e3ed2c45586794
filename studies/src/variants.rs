//! Settings compared by the studies: the paper's method, and the default with one change.

use std::sync::OnceLock;

use equipoise_core::body::{Anthropometry, SEGMENTS, Segment, Skeleton};
use equipoise_core::cycle::{Method, Motion, PoseChoice, PriorKind, Settings, Similar, StopRule};
use equipoise_core::pose_suggestion::Posture;
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_core::sesc::{PARAMETERS, Phi, ReductionKind};

use crate::subject::Subject;

/// The configuration's default half window of motion, ns.
pub const HALF_WINDOW_NS: u64 = 70_000_000;
/// A soft constraint of this width has no effect, m.
const UNCONSTRAINED_M: f64 = 1.0;
/// One of this many poses of the library is held out.
const HELD_OUT_EVERY: usize = 3;

/// The paper's method: no prior, Eq. 11, every P_jj below 0.002 m², static equations. It has no soft constraints, no
/// check of the load's place, and no load threshold.
pub fn paper(subject: &Subject, reduction: ReductionKind) -> Settings {
    Settings {
        reduction,
        prior: PriorKind::None,
        method: Method::Static,
        passive: false,
        symmetry_sigma_m: UNCONSTRAINED_M,
        long_axis_sigma_m: UNCONSTRAINED_M,
        pose_choice: PoseChoice::Paper,
        stop: StopRule::Paper { variance_m2: 0.002 },
        poses_min: 1,
        motion: Motion::Paper,
        load_threshold_n: 0.0,
        load_distance_max_m: f64::MAX,
        ..subject.settings()
    }
}

/// Priors, as named in the tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PriorVariant {
    /// No prior; then with the fewest parameters: the paper's hard constraints.
    None,
    /// The anthropometric table.
    Table,
    /// A confident but wrong prior: [`wrong_deviation_m`], with 3 mm.
    Wrong,
}

impl PriorVariant {
    /// All of them with their names.
    pub const ALL: [(&str, PriorVariant); 3] =
        [("none", PriorVariant::None), ("table", PriorVariant::Table), ("wrong", PriorVariant::Wrong)];

    /// Writes the prior into settings.
    pub fn put_into(self, settings: &mut Settings) {
        (settings.prior, settings.similar) = match self {
            PriorVariant::None => {
                settings.reduction = ReductionKind::Symmetric;
                (PriorKind::None, None)
            }
            PriorVariant::Table => (PriorKind::Table, None),
            PriorVariant::Wrong => {
                let similar = Similar {
                    deviation_m: wrong_deviation_m(settings),
                    variance_m2: [0.003 * 0.003; PARAMETERS],
                    likeness: 1.0,
                };
                (PriorKind::SimilarSubject, Some(similar))
            }
        };
    }
}

/// Φ of a body whose trunk is 25 % lighter and legs 25 % heavier than the table's, and whose trunk's centres lie 4 cm
/// further back, minus Φ of the table; segment axes, m.
pub fn wrong_deviation_m(settings: &Settings) -> [f64; PARAMETERS] {
    let skeleton = Skeleton::nominal(settings.height_m);
    let table = Anthropometry::de_leva(&skeleton, settings.height_m, settings.sex);
    let mut wrong = table;
    for segment in Segment::ALL {
        let index = segment.index();
        if segment < Segment::Neck {
            wrong.mass_fraction[index] *= 0.75;
            wrong.com_m[index][0] -= 0.04;
        } else if segment >= Segment::RightUpperLeg {
            wrong.mass_fraction[index] *= 1.25;
        }
    }
    let sum: f64 = wrong.mass_fraction.iter().sum();
    wrong.mass_fraction = wrong.mass_fraction.map(|fraction| fraction / sum);
    let (true_to_table, off) = (Phi::of(&skeleton, &table), Phi::of(&skeleton, &wrong));
    let mut deviation_m = [0.0; PARAMETERS];
    for segment in 0..SEGMENTS {
        for axis in 0..3 {
            deviation_m[3 * segment + axis] = off.0[segment][axis] - true_to_table.0[segment][axis];
        }
    }
    deviation_m
}

/// Every pose choice with its name.
pub const POSE_CHOICES: [(&str, PoseChoice); 4] = [
    ("paper (Eq. 11)", PoseChoice::Paper),
    ("D-optimal", PoseChoice::DOptimal),
    ("A-optimal", PoseChoice::AOptimal),
    ("I-optimal", PoseChoice::IOptimal),
];

/// Methods for overload in motion, with their names.
pub const MOTIONS: [(&str, Motion); 2] =
    [("compensated", Motion::Compensated { half_window_ns: HALF_WINDOW_NS }), ("paper", Motion::Paper)];

/// The library in two parts: for identification, and for the check.
pub fn divided_library() -> (&'static [Posture], &'static [Posture]) {
    static PARTS: OnceLock<[Vec<Posture>; 2]> = OnceLock::new();
    let [learnt, held_out] = PARTS.get_or_init(|| {
        let part = |checks: bool| {
            let chosen =
                LIBRARY.iter().enumerate().filter(|(index, _)| (index % HELD_OUT_EVERY == 1) == checks);
            chosen.map(|(_, posture)| *posture).collect()
        };
        [part(false), part(true)]
    });
    (learnt, held_out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_pose_is_both_learnt_and_checked_and_there_are_enough_of_each() {
        let (learnt, held_out) = divided_library();
        assert_eq!(learnt.len() + held_out.len(), LIBRARY.len());
        assert!(learnt.iter().all(|posture| !held_out.contains(posture)));
        assert!(learnt.len() >= 30 && held_out.len() >= 15);
    }

    #[test]
    fn the_wrong_prior_is_centimetres_off() {
        let settings = Subject::of_the_paper(1).settings();
        let deviation_m = wrong_deviation_m(&settings);
        let forward_m: f64 = (0..SEGMENTS).map(|segment| deviation_m[3 * segment]).sum();
        assert!(forward_m < -0.01, "{forward_m}");
    }
}
