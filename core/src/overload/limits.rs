//! What each joint is allowed: τ_max, by default a share of published strength.
//!
//! The paper finds τ_max by experiment on each subject, compares it with the literature (Snook & Ciriello, 1991) and
//! publishes no numbers. Until a worker's own limits are configured (`[subject] tau_max_nm`), this table stands in.
//! It sets colours, the worst joint and the fatigue; no torque depends on it.

use crate::body::{JOINTS, Joint, Sex};

/// τ_max of every joint, N m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TorqueLimits(pub [f64; JOINTS]);

/// Three workers in four reach this share of the mean strength: 1 − 0.674 · 0.25, since strengths spread by a
/// quarter of their mean (Anderson et al. 2007, table 3: 21 to 33 %; Benfica et al. 2018: 20 to 30 %).
const THREE_IN_FOUR: f64 = 0.83;
/// An overload comes on top of the body's own weight. An arm held out without a load takes 22 to 25 % of a man's and
/// 34 % of a woman's strength at the shoulder ("Isometric strength in flexors, abductors and external rotators of the
/// shoulder", 186 people of Stockholm, where women's flexors have 55 % of men's); this share is left for the load.
const LEFT_FOR_THE_LOAD: f64 = 0.7;
/// τ_max over the mean static strength of the joint, 0.58.
pub const STRENGTH_SHARE: f64 = THREE_IN_FOUR * LEFT_FOR_THE_LOAD;

/// Weight times stature of the people of the table, N m: 62 kg and 1.63 m, 75 kg and 1.76 m.
const BODY_NM: [f64; 2] = [62.0 * 9.81 * 1.63, 75.0 * 9.81 * 1.76];

/// Mean maximal static strengths of women and men against a load that pulls down, N m; both sides alike.
///
/// - Hip and knee extension, plantar flexion: Anderson, Madigan & Nussbaum, J. Biomechanics 40 (2007) 3105–3113,
///   table 3, c1 (strength over weight times stature), mean of the groups 18–25 and 55–65 years; read from the copy
///   of that table in RBDL's torque muscles.
/// - Shoulder flexion: Koski & McGill, Clinical Biomechanics 9 (1994) 99–104, static at 45°: men 68.6 N m, women half.
/// - Elbow flexion and trunk extension: Chaffin, Andersson & Martin, *Occupational Biomechanics*, 50th percentiles
///   after Stobbe (1982); quoted from memory. Nordin et al. (1987) found 38 to 168 N m of trunk extension in women.
/// - Wrist: Delp, Grierson & Buchanan, J. Biomechanics 29 (1996) 1371–1375, radial deviation of men, 11.0 N m, quoted
///   from memory; women by the 55 % of the shoulder.
/// - Neck: Vasavada, Li & Delp, Spine 26 (2001) 1904–1909, extension; quoted from memory. Nothing held in the hands
///   acts there.
/// - Ours, since nobody measured them: every level of the trunk has the strength of the lowest, the collarbone one
///   and a half times the shoulder's, the ball of the foot (where Eq. 15 finds nothing) a third of the ankle's.
const STRENGTH_NM: [(&str, [f64; 2]); 14] = [
    ("L5S1", TRUNK_NM),
    ("L4L3", TRUNK_NM),
    ("L1T12", TRUNK_NM),
    ("T9T8", TRUNK_NM),
    ("T1C7", NECK_NM),
    ("C1Head", NECK_NM),
    ("T4Shoulder", [1.5 * SHOULDER_NM[0], 1.5 * SHOULDER_NM[1]]),
    ("Shoulder", SHOULDER_NM),
    ("Elbow", [41.0, 77.0]),
    ("Wrist", [6.1, 11.0]),
    ("Hip", of_body([0.1605, 0.166])),
    ("Knee", of_body([0.1435, 0.1595])),
    ("Ankle", ANKLE_NM),
    ("BallFoot", [ANKLE_NM[0] / 3.0, ANKLE_NM[1] / 3.0]),
];
const TRUNK_NM: [f64; 2] = [134.0, 234.0];
const NECK_NM: [f64; 2] = [21.0, 52.0];
const SHOULDER_NM: [f64; 2] = [34.3, 68.6];
const ANKLE_NM: [f64; 2] = of_body([0.0985, 0.1045]);

const fn of_body([female, male]: [f64; 2]) -> [f64; 2] {
    [female * BODY_NM[0], male * BODY_NM[1]]
}

impl TorqueLimits {
    /// The table's limits: [`STRENGTH_SHARE`] of the mean strength; the mean of both sexes where it is not stated.
    pub fn of(sex: Sex) -> TorqueLimits {
        TorqueLimits(Joint::ALL.map(|joint| {
            let name = joint.name();
            let name = name.strip_prefix("Left").or_else(|| name.strip_prefix("Right")).unwrap_or(name);
            // Every joint has a row, as a test holds; the weakest stands for one that had none.
            let [female, male] = STRENGTH_NM
                .iter()
                .find(|(row, _)| *row == name)
                .map_or([STRENGTH_NM[9].1[0]; 2], |(_, strength_nm)| *strength_nm);
            STRENGTH_SHARE
                * match sex {
                    Sex::Female => female,
                    Sex::Male => male,
                    Sex::Unstated => 0.5 * (female + male),
                }
        }))
    }
}

impl Default for TorqueLimits {
    fn default() -> Self {
        TorqueLimits::of(Sex::Unstated)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_joint_has_a_row_and_both_sides_the_same_limits() {
        let limits = TorqueLimits::default();
        for joint in Joint::ALL {
            assert!(STRENGTH_NM.iter().any(|(row, _)| joint.name().ends_with(row)), "{}", joint.name());
            let mirrored = joint.segment().mirrored().proximal_joint().unwrap();
            assert_eq!(limits.0[joint.index()], limits.0[mirrored.index()]);
        }
    }

    #[test]
    fn the_limits_of_the_table_are_these() {
        let at = |sex, name| TorqueLimits::of(sex).0[Joint::named(name).unwrap().index()];
        for (name, female_nm, male_nm) in [
            ("L5S1", 77.9, 136.0),
            ("RightShoulder", 19.9, 39.9),
            ("LeftElbow", 23.8, 44.7),
            ("LeftHip", 92.5, 124.9),
            ("RightKnee", 82.7, 120.0),
            ("LeftAnkle", 56.7, 78.6),
        ] {
            assert!((at(Sex::Female, name) - female_nm).abs() < 0.1, "{name} {}", at(Sex::Female, name));
            assert!((at(Sex::Male, name) - male_nm).abs() < 0.1, "{name} {}", at(Sex::Male, name));
            let mean = 0.5 * (at(Sex::Female, name) + at(Sex::Male, name));
            assert!((at(Sex::Unstated, name) - mean).abs() < 1e-12);
        }
    }
}
