//! Torque limit τ_max of each joint: by default a fraction of published strength, per direction where published.
//!
//! The paper determines τ_max by experiment on each subject, compares it with the literature (Snook & Ciriello, 1991)
//! and publishes no numbers. These tables apply until a subject's own limits are configured (`[subject] tau_max_nm`).
//! They determine levels, the worst joint and the fatigue; no torque depends on them.
//!
//! **Direction.** Extensors and flexors differ in strength. With the components τ_a of a torque along the axes of the
//! parent segment (T-pose: X forward, Y left, Z up) and the limit L of each axis and sign, the fraction of the limits
//! in use is `√Σ (τ_a / L_a)²`: for a single component its own fraction, and with equal limits `|τ| / L`. The published
//! limit of the joint is `|τ|` over that fraction: the limit in the direction of this torque. A configured limit
//! applies to all directions.
//!
//! The sign is that of the overload torque, not of the total torque: if a load relieves the muscles that hold the body,
//! as it can the extensors of a squatting knee, it is compared with the strength of their antagonists, which is
//! conservative.

use nalgebra::Vector3;

use crate::body::{JOINTS, Joint, Sex};
use crate::frame::{Pose, StationWorld};

/// Limits about the three axes of the parent segment, each against torques of negative and of positive sign.
type ByDirection = [[f64; 2]; 3];

/// τ_max of every joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TorqueLimits {
    /// Limit per joint, N m: against a load that pulls down in front, and in directions without published strength.
    nm: [f64; JOINTS],
    /// The limit of each direction over that number.
    by_direction: [ByDirection; JOINTS],
}

/// Fraction of the mean strength that three in four workers reach: 1 − 0.674 · 0.25, since the standard deviation of
/// strengths is a quarter of their mean (Anderson et al. 2007, table 3: 21 to 33 %; Benfica et al. 2018: 20 to 30 %).
const LOWER_QUARTILE: f64 = 0.83;
/// Fraction of the strength that remains for the load: an overload adds to the body's own weight. An arm held out
/// without a load takes 22 to 25 % of a man's and 34 % of a woman's strength at the shoulder ("Isometric strength in
/// flexors, abductors and external rotators of the shoulder", 186 people of Stockholm, where women's flexors have 55 %
/// of men's).
const FRACTION_FOR_LOAD: f64 = 0.7;
/// τ_max over the mean static strength of the joint, 0.58.
pub const STRENGTH_FRACTION: f64 = LOWER_QUARTILE * FRACTION_FOR_LOAD;

/// Weight times stature of the people of the table, N m: 62 kg and 1.63 m, 75 kg and 1.76 m.
const BODY_NM: [f64; 2] = [62.0 * 9.81 * 1.63, 75.0 * 9.81 * 1.76];

/// Mean maximal static strengths of women and men against a load that pulls down in front, N m; both sides alike.
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
/// - Assumed, for lack of published measurements: every level of the trunk has the strength of the lowest, the
///   collarbone 1.5 times the shoulder's, the ball of the foot (where Eq. 15 gives zero) a third of the ankle's.
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

/// Axes of the parent segment.
const X: usize = 0;
const Y: usize = 1;
const Z: usize = 2;
/// Sign of a torque.
const NEGATIVE: usize = 0;
const POSITIVE: usize = 1;

/// Mean maximal static strengths of women and men in the other directions, N m, of the trunk and of the left side;
/// those of the right side are about the mirrored axes (X and Z change their sign). A torque is the one that the parent
/// exerts on the segment.
///
/// - Hip and knee flexion, dorsiflexion: Anderson et al. 2007 as above.
/// - Trunk flexion and lateral flexion, vertical ab- and adduction of the shoulder, elbow extension: Chaffin, Andersson
///   & Martin, 50th percentiles after Stobbe (1982); quoted from memory.
/// - Wrist: Delp et al. 1996, men's flexion 12.2, extension 7.1, ulnar deviation 9.5 N m, quoted from memory; women by
///   the 55 % of the shoulder.
const OTHER_STRENGTH_NM: [(&str, usize, usize, [f64; 2]); 21] = [
    ("L5S1", Y, POSITIVE, TRUNK_FLEXION_NM),
    ("L5S1", X, NEGATIVE, TRUNK_ASIDE_NM),
    ("L5S1", X, POSITIVE, TRUNK_ASIDE_NM),
    ("L4L3", Y, POSITIVE, TRUNK_FLEXION_NM),
    ("L4L3", X, NEGATIVE, TRUNK_ASIDE_NM),
    ("L4L3", X, POSITIVE, TRUNK_ASIDE_NM),
    ("L1T12", Y, POSITIVE, TRUNK_FLEXION_NM),
    ("L1T12", X, NEGATIVE, TRUNK_ASIDE_NM),
    ("L1T12", X, POSITIVE, TRUNK_ASIDE_NM),
    ("T9T8", Y, POSITIVE, TRUNK_FLEXION_NM),
    ("T9T8", X, NEGATIVE, TRUNK_ASIDE_NM),
    ("T9T8", X, POSITIVE, TRUNK_ASIDE_NM),
    ("Shoulder", X, NEGATIVE, [30.0, 67.0]),
    ("Shoulder", X, POSITIVE, [37.0, 71.0]),
    ("Elbow", Z, POSITIVE, [27.0, 46.0]),
    ("Wrist", X, NEGATIVE, [6.7, 12.2]),
    ("Wrist", X, POSITIVE, [3.9, 7.1]),
    ("Wrist", Z, POSITIVE, [5.2, 9.5]),
    ("Hip", Y, NEGATIVE, of_body([0.109, 0.110])),
    ("Knee", Y, POSITIVE, of_body([0.070, 0.084])),
    ("Ankle", Y, NEGATIVE, of_body([0.0255, 0.0305])),
];
const TRUNK_FLEXION_NM: [f64; 2] = [75.0, 143.0];
const TRUNK_ASIDE_NM: [f64; 2] = [94.0, 159.0];

/// A joint's name without its side, and whether it is on the right.
fn without_side(joint: Joint) -> (&'static str, bool) {
    let name = joint.name();
    match name.strip_prefix("Right") {
        Some(of_right) => (of_right, true),
        None => (name.strip_prefix("Left").unwrap_or(name), false),
    }
}

impl TorqueLimits {
    /// Limits by the tables: [`STRENGTH_FRACTION`] of the mean strength; the mean of both sexes if unstated.
    pub fn of(sex: Sex) -> TorqueLimits {
        let of_sex = |[female, male]: [f64; 2]| match sex {
            Sex::Female => female,
            Sex::Male => male,
            Sex::Unstated => 0.5 * (female + male),
        };
        let main_nm = |joint: Joint| {
            let (name, _) = without_side(joint);
            // Every joint has a row (verified by a test); the weakest row is the fallback.
            let row = STRENGTH_NM.iter().find(|(row, _)| *row == name);
            of_sex(row.map_or([STRENGTH_NM[9].1[0]; 2], |(_, strength_nm)| *strength_nm))
        };
        TorqueLimits {
            nm: Joint::ALL.map(|joint| STRENGTH_FRACTION * main_nm(joint)),
            by_direction: Joint::ALL.map(|joint| {
                let (name, is_right) = without_side(joint);
                let mut fractions = [[1.0; 2]; 3];
                for (_, axis, sign, strength_nm) in OTHER_STRENGTH_NM.iter().filter(|row| row.0 == name) {
                    let is_mirrored = is_right && *axis != Y;
                    let sign = if is_mirrored { 1 - sign } else { *sign };
                    fractions[*axis][sign] = of_sex(*strength_nm) / main_nm(joint);
                }
                fractions
            }),
        }
    }

    /// The same limit for every joint and direction, N m.
    pub fn uniform(limit_nm: f64) -> TorqueLimits {
        TorqueLimits { nm: [limit_nm; JOINTS], by_direction: [[[1.0; 2]; 3]; JOINTS] }
    }

    /// Sets the limit of a joint in all directions, N m.
    pub fn set(&mut self, joint: Joint, limit_nm: f64) {
        self.nm[joint.index()] = limit_nm;
        self.by_direction[joint.index()] = [[1.0; 2]; 3];
    }

    /// Limit per joint without a torque, N m: against a load that pulls down in front.
    pub fn without_torque_nm(&self) -> &[f64; JOINTS] {
        &self.nm
    }

    /// Limit of each joint in the direction of its torque (world axes, N m), N m.
    pub fn along_nm(&self, pose: &Pose<StationWorld>, torque_nm: &[[f64; 3]; JOINTS]) -> [f64; JOINTS] {
        Joint::ALL.map(|joint| {
            let parent = joint.segment().parent().unwrap_or(joint.segment());
            let to_parent = pose.world_from_segment[parent.index()].conjugate();
            self.in_direction_nm(joint, to_parent * Vector3::from(torque_nm[joint.index()]))
        })
    }

    /// Limit of a joint in the direction of a torque in the axes of the parent segment, N m.
    fn in_direction_nm(&self, joint: Joint, torque: Vector3<f64>) -> f64 {
        let index = joint.index();
        let mut weighted = torque;
        for (value, [negative, positive]) in weighted.iter_mut().zip(self.by_direction[index]) {
            *value /= if *value < 0.0 { negative } else { positive };
        }
        let (magnitude, weighted_norm) = (torque.norm(), weighted.norm());
        if weighted_norm > 0.0 { self.nm[index] * magnitude / weighted_norm } else { self.nm[index] }
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
    use crate::body::{SEGMENTS, Skeleton};
    use nalgebra::UnitQuaternion;

    fn joint(name: &str) -> Joint {
        Joint::named(name).unwrap()
    }

    #[test]
    fn every_joint_has_a_row_and_every_row_a_joint() {
        for joint in Joint::ALL {
            assert!(STRENGTH_NM.iter().any(|(row, _)| *row == without_side(joint).0), "{}", joint.name());
        }
        for (name, ..) in OTHER_STRENGTH_NM {
            assert!(Joint::ALL.into_iter().any(|joint| without_side(joint).0 == name), "{name}");
        }
    }

    #[test]
    fn the_limits_of_the_table_are_these() {
        let at = |sex, name| TorqueLimits::of(sex).without_torque_nm()[joint(name).index()];
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

    #[test]
    fn each_direction_has_its_own_limit() {
        let limits = TorqueLimits::of(Sex::Male);
        for (name, torque, expected_nm) in [
            ("L5S1", -Vector3::y(), 136.0),
            ("L5S1", Vector3::y(), 83.1),
            ("L4L3", -Vector3::x(), 92.4),
            ("LeftHip", Vector3::y(), 124.9),
            ("LeftHip", -Vector3::y(), 82.7),
            ("RightKnee", Vector3::y(), 63.2),
            ("LeftAnkle", -Vector3::y(), 22.9),
            ("LeftElbow", -Vector3::z(), 44.7),
            ("LeftElbow", Vector3::z(), 26.7),
            ("RightElbow", Vector3::z(), 44.7),
            ("RightShoulder", -Vector3::x(), 41.3),
        ] {
            for size_nm in [1e-3, 1.0, 80.0] {
                let limit_nm = limits.in_direction_nm(joint(name), torque * size_nm);
                assert!((limit_nm - expected_nm).abs() < 0.1, "{name} {torque:?}: {limit_nm}");
            }
        }
    }

    #[test]
    fn limits_form_an_ellipsoid() {
        let limits = TorqueLimits::of(Sex::Male);
        let (l5s1, torque) = (joint("L5S1"), Vector3::new(30.0, -60.0, 0.0));
        let of = |part: Vector3<f64>| part.norm() / limits.in_direction_nm(l5s1, part);
        let apart = of(Vector3::x() * 30.0).hypot(of(Vector3::y() * -60.0));
        assert!((of(torque) - apart).abs() < 1e-12);
        assert_eq!(limits.in_direction_nm(l5s1, Vector3::zeros()), limits.nm[l5s1.index()]);
    }

    #[test]
    fn a_configured_limit_holds_in_all_directions() {
        let mut limits = TorqueLimits::of(Sex::Female);
        limits.set(joint("LeftKnee"), 70.0);
        for torque in [Vector3::x(), -Vector3::y(), Vector3::new(3.0, 4.0, -5.0)] {
            assert!((limits.in_direction_nm(joint("LeftKnee"), torque) - 70.0).abs() < 1e-12);
        }
    }

    #[test]
    fn both_sides_have_the_same_limits_and_a_turned_body_too() {
        let limits = TorqueLimits::of(Sex::Female);
        let origin = Skeleton::nominal(1.77).t_pose_m().map(Vector3::from);
        let pose_of = |turn| Pose::<StationWorld>::new(origin, [turn; SEGMENTS]);
        let upright = pose_of(UnitQuaternion::identity());
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -1.1, 0.7));
        let torque = Vector3::new(3.0, -5.0, 2.0);
        // A torque is a pseudovector: mirrored left to right, X and Z change their sign.
        let mirrored = Vector3::new(-3.0, -5.0, -2.0);
        let along =
            |pose: &Pose<StationWorld>, torque: Vector3<f64>| limits.along_nm(pose, &[torque.into(); JOINTS]);
        let (straight, mirrored) = (along(&upright, torque), along(&upright, mirrored));
        let turned = along(&pose_of(turn), turn * torque);
        for joint in Joint::ALL {
            let other = joint.segment().mirrored().proximal_joint().unwrap();
            assert!((straight[joint.index()] - mirrored[other.index()]).abs() < 1e-9, "{}", joint.name());
            assert!((straight[joint.index()] - turned[joint.index()]).abs() < 1e-9, "{}", joint.name());
        }
    }
}
