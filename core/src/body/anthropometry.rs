//! Masses and centres of mass of an average body, scaled to this subject's skeleton: the prior of the identification.
//!
//! Source: P. de Leva, "Adjustments to Zatsiorsky-Seluyanov's segment inertia parameters", J. Biomechanics 29 (1996)
//! 1223–1230, table 4 (mass fractions, longitudinal centres, segment lengths). De Leva's trunk has three parts; MVN's
//! has five segments and two shoulders. The parts are cut along the height axis into slices of uniform density at the
//! heights of the subject's own spine joints, so every slice's mass and height follow from the table alone.
//!
//! Not in the table, and therefore assumed: the distance of the trunk's centres in front of the line from mid-hip to
//! neck.

use bytemuck::{Pod, Zeroable};

use super::{SEGMENTS, Segment, Skeleton};

/// Column of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sex {
    /// De Leva's women.
    Female,
    /// De Leva's men.
    Male,
    /// The mean of both columns, if unstated.
    Unstated,
}

/// Masses and centres by the table. Arrays are indexed by [`Segment`].
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Anthropometry {
    /// Fraction of the body mass in each segment; the sum is 1.
    pub mass_fraction: [f64; SEGMENTS],
    /// Centre of mass from the segment's origin, segment axes (T-pose: X forward, Y left, Z up), m.
    pub com_m: [[f64; 3]; SEGMENTS],
    /// Wrist to third knuckle, m.
    pub hand_length_m: f64,
}

/// One row of de Leva's table, female and male: mass fraction, centre from the proximal end, length over stature.
#[derive(Clone, Copy)]
struct Row {
    mass: [f64; 2],
    centre: [f64; 2],
    length: [f64; 2],
}

const FEMALE_STATURE_MM: f64 = 1735.0;
const MALE_STATURE_MM: f64 = 1741.0;

const fn row(mass_percent: [f64; 2], centre_percent: [f64; 2], length_mm: [f64; 2]) -> Row {
    Row {
        mass: [mass_percent[0] / 100.0, mass_percent[1] / 100.0],
        centre: [centre_percent[0] / 100.0, centre_percent[1] / 100.0],
        length: [length_mm[0] / FEMALE_STATURE_MM, length_mm[1] / MALE_STATURE_MM],
    }
}

// The centres of the trunk's parts are not used: the centre of a slice of uniform density is in its middle.
const HEAD: Row = row([6.68, 6.94], [48.41, 50.02], [243.7, 242.9]); // vertex to cervicale
const UPPER_TRUNK: Row = row([15.45, 15.96], [50.50, 50.66], [228.0, 242.1]); // cervicale to xiphion
const MIDDLE_TRUNK: Row = row([14.65, 16.33], [45.12, 45.02], [205.3, 215.5]); // xiphion to omphalion
const LOWER_TRUNK: Row = row([12.47, 11.17], [49.20, 61.15], [181.5, 145.7]); // omphalion to mid-hip
const UPPER_ARM: Row = row([2.55, 2.71], [57.54, 57.72], [275.1, 281.7]);
const FOREARM: Row = row([1.38, 1.62], [45.59, 45.74], [264.3, 268.9]);
const HAND: Row = row([0.56, 0.61], [74.74, 79.00], [78.0, 86.2]); // wrist to third metacarpal
const THIGH: Row = row([14.78, 14.16], [36.12, 40.95], [368.5, 422.2]);
const SHANK: Row = row([4.81, 4.33], [43.52, 43.95], [438.6, 440.3]); // knee to ankle centre
const FOOT: Row = row([1.29, 1.37], [40.14, 44.15], [228.3, 258.1]); // heel to toe tip

/// De Leva's cervicale lies above MVN's neck joint: cervicale over neck joint, both from mid-hip.
const CERVICALE_OVER_NECK: f64 = 1.066;
/// Neck joint to C1 joint, over stature, for a skeleton in which they coincide.
const NECK_LENGTH: f64 = 0.055;
/// Fraction of the mass of de Leva's head (which includes the neck) below MVN's C1 joint.
const NECK_MASS_FRACTION: f64 = 0.20;
/// Fraction of the upper trunk's mass that moves with each shoulder segment.
const SHOULDER_MASS_FRACTION: f64 = 0.03;
/// Fraction of the foot's mass in front of the ball.
const TOE_MASS_FRACTION: f64 = 0.12;
/// The trunk's slices lie in front of the line from mid-hip to neck, over stature.
const TRUNK_FORWARD: f64 = 0.006;
/// The head's centre lies in front of the C1 joint, over stature.
const HEAD_FORWARD: f64 = 0.008;
/// Ball of the foot in front of the ankle, and heel behind it, over stature.
const BALL_FORWARD: f64 = 0.100;
const HEEL_BACK: f64 = 0.035;
/// From the middle of the hand to the palm's surface, m: half of a hand's thickness at the third knuckle, 28 to 33 mm.
const PALM_M: f64 = 0.015;
/// Height of the ankle joint above the sole, over stature.
pub(crate) const ANKLE_HEIGHT: f64 = 0.054;

/// The segments of one side, proximal first.
const LEFT_ARM_AND_LEG: [Segment; 8] = [
    Segment::LeftShoulder,
    Segment::LeftUpperArm,
    Segment::LeftForearm,
    Segment::LeftHand,
    Segment::LeftUpperLeg,
    Segment::LeftLowerLeg,
    Segment::LeftFoot,
    Segment::LeftToe,
];

/// A row of the table for one sex and stature.
#[derive(Clone, Copy)]
struct Part {
    mass: f64,
    /// Centre from the proximal end, over length.
    centre: f64,
    length_m: f64,
}

impl Anthropometry {
    /// The table scaled to a skeleton, for a stature in metres and a sex.
    ///
    /// The left side is computed and mirrored: the table has no sides.
    pub fn de_leva(skeleton: &Skeleton, height_m: f64, sex: Sex) -> Anthropometry {
        let pick = |[female, male]: [f64; 2]| match sex {
            Sex::Female => female,
            Sex::Male => male,
            Sex::Unstated => 0.5 * (female + male),
        };
        let part = |row: Row| Part {
            mass: pick(row.mass),
            centre: pick(row.centre),
            length_m: pick(row.length) * height_m,
        };
        let hand_length_m = part(HAND).length_m;
        let mut body =
            Anthropometry { mass_fraction: [0.0; SEGMENTS], com_m: [[0.0; 3]; SEGMENTS], hand_length_m };
        let trunk = [part(LOWER_TRUNK), part(MIDDLE_TRUNK), part(UPPER_TRUNK)];
        body.set_trunk(skeleton, &trunk, height_m);
        body.set_head(skeleton, part(HEAD), height_m);
        body.set_arm(skeleton, part(UPPER_TRUNK).mass, [part(UPPER_ARM), part(FOREARM), part(HAND)]);
        body.set_leg(skeleton, [part(THIGH), part(SHANK), part(FOOT)], height_m);
        for left in LEFT_ARM_AND_LEG {
            let (mass, [x, y, z]) = (body.mass_fraction[left.index()], body.com_m[left.index()]);
            body.set(left.mirrored(), mass, [x, -y, z]);
        }
        let sum: f64 = body.mass_fraction.iter().sum();
        body.mass_fraction = body.mass_fraction.map(|fraction| fraction / sum);
        body
    }

    fn set(&mut self, segment: Segment, mass: f64, com_m: [f64; 3]) {
        self.mass_fraction[segment.index()] = mass;
        self.com_m[segment.index()] = com_m;
    }

    /// Cuts the trunk's parts, stacked from mid-hip up, into the five MVN segments.
    fn set_trunk(&mut self, skeleton: &Skeleton, parts: &[Part; 3], height_m: f64) {
        let origin = skeleton.t_pose_m();
        let hip = mean(origin[Segment::LeftUpperLeg.index()], origin[Segment::RightUpperLeg.index()]);
        let neck = origin[Segment::Neck.index()];
        let rise = (neck[2] - hip[2]).max(1e-3);
        let cervicale = CERVICALE_OVER_NECK * rise;
        let stretch = cervicale / parts.iter().map(|part| part.length_m).sum::<f64>();

        let trunk = [Segment::Pelvis, Segment::L5, Segment::L3, Segment::T12, Segment::T8];
        let mut from = 0.0;
        for (index, segment) in trunk.into_iter().enumerate() {
            let to =
                trunk.get(index + 1).map_or(cervicale, |next| origin[next.index()][2] - hip[2]).max(from);
            let (mut mass, mut moment, mut floor) = (0.0, 0.0, 0.0);
            for part in parts {
                let length = part.length_m * stretch;
                let (low, high) = (f64::max(from, floor), f64::min(to, floor + length));
                if high > low {
                    let mass_within = part.mass * (high - low) / length;
                    mass += mass_within;
                    moment += mass_within * 0.5 * (low + high);
                }
                floor += length;
            }
            // A skeleton may have two joints in one position; the slice between them is empty.
            if mass > 0.0 {
                let height = moment / mass;
                let forward = hip[0] + (neck[0] - hip[0]) * height / rise + TRUNK_FORWARD * height_m;
                let here = origin[segment.index()];
                let shoulders =
                    if segment == Segment::T8 { 2.0 * SHOULDER_MASS_FRACTION * parts[2].mass } else { 0.0 };
                self.set(segment, mass - shoulders, [forward - here[0], 0.0, hip[2] + height - here[2]]);
            }
            from = to;
        }
    }

    /// De Leva's head extends from the vertex down to the cervicale; neck and head together have its centre.
    fn set_head(&mut self, skeleton: &Skeleton, whole: Part, height_m: f64) {
        let neck_length = skeleton.length_m(Segment::Head);
        let nominal = NECK_LENGTH * height_m;
        let neck_centre = 0.5 * nominal;
        let whole_centre = whole.length_m * (1.0 - whole.centre);
        let head_centre = (whole_centre - NECK_MASS_FRACTION * neck_centre) / (1.0 - NECK_MASS_FRACTION);
        self.set(Segment::Neck, NECK_MASS_FRACTION * whole.mass, [0.0, 0.0, neck_centre]);
        let com = [HEAD_FORWARD * height_m, 0.0, head_centre - neck_length];
        self.set(Segment::Head, (1.0 - NECK_MASS_FRACTION) * whole.mass, com);
    }

    fn set_arm(&mut self, skeleton: &Skeleton, upper_trunk_mass: f64, [upper_arm, forearm, hand]: [Part; 3]) {
        let along = |next: Segment, fraction: f64| skeleton.offset_m[next.index()].map(|d| fraction * d);
        let shoulder_mass = SHOULDER_MASS_FRACTION * upper_trunk_mass;
        self.set(Segment::LeftShoulder, shoulder_mass, along(Segment::LeftUpperArm, 0.5));
        self.set(Segment::LeftUpperArm, upper_arm.mass, along(Segment::LeftForearm, upper_arm.centre));
        self.set(Segment::LeftForearm, forearm.mass, along(Segment::LeftHand, forearm.centre));
        self.set(Segment::LeftHand, hand.mass, [0.0, hand.centre * hand.length_m, 0.0]);
    }

    fn set_leg(&mut self, skeleton: &Skeleton, [thigh, shank, foot]: [Part; 3], height_m: f64) {
        let along = |next: Segment, fraction: f64| skeleton.offset_m[next.index()].map(|d| fraction * d);
        self.set(Segment::LeftUpperLeg, thigh.mass, along(Segment::LeftLowerLeg, thigh.centre));
        self.set(Segment::LeftLowerLeg, shank.mass, along(Segment::LeftFoot, shank.centre));
        // De Leva measures the foot's centre from the heel; the toes' fraction is subtracted from the whole. In a
        // skeleton without a ball joint the toe's origin is in the ankle.
        let ball = BALL_FORWARD * height_m;
        let toe_centre = ball + 0.4 * (foot.length_m - HEEL_BACK * height_m - ball);
        let whole = foot.centre * foot.length_m - HEEL_BACK * height_m;
        let rear = (whole - TOE_MASS_FRACTION * toe_centre) / (1.0 - TOE_MASS_FRACTION);
        let height = -0.55 * ANKLE_HEIGHT * height_m;
        self.set(Segment::LeftFoot, (1.0 - TOE_MASS_FRACTION) * foot.mass, [rear, 0.0, height]);
        let toe_origin = skeleton.offset_m[Segment::LeftToe.index()];
        let toe_com = [toe_centre - toe_origin[0], 0.0, -0.8 * ANKLE_HEIGHT * height_m - toe_origin[2]];
        self.set(Segment::LeftToe, TOE_MASS_FRACTION * foot.mass, toe_com);
    }

    /// Whether every number is finite; a stored table is checked before use.
    pub fn is_sound(&self) -> bool {
        self.mass_fraction.iter().chain(self.com_m.iter().flatten()).all(|value| value.is_finite())
            && self.hand_length_m.is_finite()
    }

    /// Grip point of a hand, from the wrist, in the hand's axes, m: at the third knuckle, by which NIOSH's lifting
    /// equation defines the grasp (Waters, Putz-Anderson & Garg 1994, 1.1) and where de Leva's hand ends, on the palm's
    /// surface.
    pub fn grip_m(&self, hand: Segment) -> [f64; 3] {
        let side = if hand == Segment::LeftHand { 1.0 } else { -1.0 };
        [0.0, side * self.hand_length_m, -PALM_M]
    }
}

fn mean(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    core::array::from_fn(|axis| 0.5 * (a[axis] + b[axis]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(height_m: f64, sex: Sex) -> Anthropometry {
        Anthropometry::de_leva(&Skeleton::nominal(height_m), height_m, sex)
    }

    #[test]
    fn every_segment_weighs_something_and_together_they_are_one_body() {
        for sex in [Sex::Female, Sex::Male, Sex::Unstated] {
            let body = body(1.77, sex);
            assert!((body.mass_fraction.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            for segment in Segment::ALL {
                let fraction = body.mass_fraction[segment.index()];
                assert!(fraction > 0.0005 && fraction < 0.16, "{segment:?}: {fraction}");
            }
        }
    }

    #[test]
    fn left_mirrors_right() {
        let body = body(1.62, Sex::Female);
        for segment in Segment::ALL {
            let (here, there) = (segment.index(), segment.mirrored().index());
            assert_eq!(body.mass_fraction[here], body.mass_fraction[there]);
            let ([ax, ay, az], [bx, by, bz]) = (body.com_m[here], body.com_m[there]);
            assert!(ax == bx && ay == -by && az == bz, "{segment:?}");
        }
    }

    #[test]
    fn a_standing_body_has_its_centre_where_textbooks_have_it() {
        // Winter: the CoM of a person who stands with arms down is at 0.55 to 0.58 of the stature; with the arms out
        // sideways it is slightly higher.
        let skeleton = Skeleton::nominal(1.77);
        let body = body(1.77, Sex::Male);
        let origin = skeleton.t_pose_m();
        let centre: f64 = Segment::ALL
            .map(|s| body.mass_fraction[s.index()] * (origin[s.index()][2] + body.com_m[s.index()][2]))
            .iter()
            .sum();
        let hip_height = 1.77 * (0.245 + 0.246 + ANKLE_HEIGHT);
        let height_ratio = (hip_height + centre) / 1.77;
        assert!((0.55..0.62).contains(&height_ratio), "{height_ratio}");
    }

    #[test]
    fn joints_in_one_place_leave_an_empty_slice_and_a_whole_body() {
        let mut skeleton = Skeleton::nominal(1.8);
        skeleton.offset_m[Segment::L5.index()] = [0.0; 3];
        skeleton.offset_m[Segment::T8.index()] = [0.0; 3];
        let body = Anthropometry::de_leva(&skeleton, 1.8, Sex::Male);
        assert!((body.mass_fraction.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(body.com_m.iter().flatten().all(|metres| metres.abs() < 0.3));
    }
}
