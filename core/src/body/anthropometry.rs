//! What an average body weighs and where, scaled to this worker: the starting point of the identification.
//!
//! Source: P. de Leva, "Adjustments to Zatsiorsky-Seluyanov's segment inertia parameters", J. Biomechanics 29 (1996)
//! 1223–1230, table 4 (mass fractions, longitudinal centres, segment lengths over stature). De Leva's trunk has
//! three parts; MVN's has five segments and two shoulders. The parts are cut along the height axis into slices of
//! even density at MVN's joint heights, so every slice's mass and height follow from the table alone.
//!
//! Not in the table, and therefore ours: the heights of the spine's joints (proportions of an MVN null pose) and the
//! forward offset of the trunk's centres from the spine's joints.

use super::{SEGMENTS, Segment};

/// Which column of the table to use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sex {
    /// De Leva's women.
    Female,
    /// De Leva's men.
    Male,
    /// The mean of both columns, where it is not stated.
    Unstated,
}

/// A body as the table predicts it. Arrays are indexed by [`Segment`].
#[derive(Debug, Clone, Copy)]
pub struct Anthropometry {
    /// Stature, m.
    pub height_m: f64,
    /// Share of the body mass in each segment; the sum is 1.
    pub mass_fraction: [f64; SEGMENTS],
    /// Centre of mass from the segment's origin, segment axes (T-pose: X forward, Y left, Z up), m.
    pub com_m: [[f64; 3]; SEGMENTS],
    /// The segment's origin from its parent's origin, parent's axes, m; the pelvis has none.
    pub offset_m: [[f64; 3]; SEGMENTS],
    /// Height of the ankle above the floor, m.
    pub ankle_height_m: f64,
}

/// One row of de Leva's table, female and male: mass share, centre from the proximal end, length over stature.
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

// The centres of the trunk's parts are not used: a slice of even density has its own in the middle.
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

/// Mid-hip to MVN's neck joint, over stature.
const NECK_HEIGHT: f64 = 0.325;
/// Heights of MVN's spine joints (L5S1, L4L3, L1T12, T9T8) above mid-hip, as shares of [`NECK_HEIGHT`].
const SPINE_JOINT_SHARE: [f64; 4] = [0.179, 0.379, 0.562, 0.745];
/// Neck joint to C1 joint, over stature.
const NECK_LENGTH: f64 = 0.055;
/// Share of de Leva's head (which includes the neck) below MVN's C1 joint.
const NECK_MASS_SHARE: f64 = 0.20;
/// Share of the upper trunk that moves with each shoulder segment.
const SHOULDER_MASS_SHARE: f64 = 0.03;
/// Share of the foot's mass in front of the ball.
const TOE_MASS_SHARE: f64 = 0.12;
/// The trunk's slices lie in front of the spine's joints, over stature.
const TRUNK_FORWARD: f64 = 0.012;
/// The head's centre lies in front of the C1 joint, over stature.
const HEAD_FORWARD: f64 = 0.008;
/// Half the distance of the hip joints, over stature.
const HIP_HALF_WIDTH: f64 = 0.048;
/// The shoulder segment's origin and the shoulder joint, from the midline, over stature.
const CLAVICLE_START: f64 = 0.018;
const SHOULDER_HALF_WIDTH: f64 = 0.102;
/// Height below the neck joint at which the shoulder segments start, over stature.
const SHOULDER_BELOW_NECK: f64 = 0.0365;
/// Ankle above the floor; ball of the foot in front of the ankle and above the floor; heel behind the ankle.
const ANKLE_HEIGHT: f64 = 0.054;
const BALL_FORWARD: f64 = 0.100;
const BALL_HEIGHT: f64 = 0.011;
const HEEL_BACK: f64 = 0.035;

/// The segments of one side, proximal first.
const ARM_AND_LEG: [Segment; 8] = [
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
    centre_m: f64,
    length_m: f64,
}

impl Anthropometry {
    /// The table scaled to a stature in metres and a sex.
    pub fn de_leva(height_m: f64, sex: Sex) -> Anthropometry {
        let pick = |[female, male]: [f64; 2]| match sex {
            Sex::Female => female,
            Sex::Male => male,
            Sex::Unstated => 0.5 * (female + male),
        };
        let part = |row: Row| {
            let length_m = pick(row.length) * height_m;
            Part { mass: pick(row.mass), centre_m: pick(row.centre) * length_m, length_m }
        };
        let mut body = Anthropometry {
            height_m,
            mass_fraction: [0.0; SEGMENTS],
            com_m: [[0.0; 3]; SEGMENTS],
            offset_m: [[0.0; 3]; SEGMENTS],
            ankle_height_m: ANKLE_HEIGHT * height_m,
        };
        let upper_trunk = part(UPPER_TRUNK);
        body.lay_the_trunk(&[part(LOWER_TRUNK), part(MIDDLE_TRUNK), upper_trunk]);
        body.lay_the_head(part(HEAD));
        body.lay_the_arm(SHOULDER_MASS_SHARE * upper_trunk.mass, part(UPPER_ARM), part(FOREARM), part(HAND));
        body.lay_the_leg(part(THIGH), part(SHANK), part(FOOT));
        for left in ARM_AND_LEG {
            body.mirror(left);
        }
        body.close_the_sum();
        body
    }

    /// Where a hand grips, from the wrist, in the hand's axes, m: de Leva's centre of mass of the hand.
    pub fn grip_m(&self, hand: Segment) -> [f64; 3] {
        self.com_m[hand.index()]
    }

    fn set(&mut self, segment: Segment, mass: f64, com_m: [f64; 3], offset_m: [f64; 3]) {
        self.mass_fraction[segment.index()] = mass;
        self.com_m[segment.index()] = com_m;
        self.offset_m[segment.index()] = offset_m;
    }

    /// Cuts the trunk's parts (from mid-hip up) into the five MVN segments.
    fn lay_the_trunk(&mut self, parts: &[Part; 3]) {
        let neck = NECK_HEIGHT * self.height_m;
        let joints = SPINE_JOINT_SHARE.map(|share| share * neck);
        let cervicale: f64 = parts.iter().map(|part| part.length_m).sum();
        let trunk = [Segment::Pelvis, Segment::L5, Segment::L3, Segment::T12, Segment::T8];
        let mut below = 0.0;
        for (index, segment) in trunk.into_iter().enumerate() {
            let from = if index == 0 { 0.0 } else { joints[index - 1] };
            let to = joints.get(index).copied().unwrap_or(cervicale);
            let (mut mass, mut moment, mut floor) = (0.0, 0.0, 0.0);
            for part in parts {
                let (low, high) = (from.max(floor), to.min(floor + part.length_m));
                if high > low {
                    let share = part.mass * (high - low) / part.length_m;
                    mass += share;
                    moment += share * 0.5 * (low + high);
                }
                floor += part.length_m;
            }
            let shoulders = match segment {
                Segment::T8 => 2.0 * SHOULDER_MASS_SHARE * parts[2].mass,
                _ => 0.0,
            };
            let com = [TRUNK_FORWARD * self.height_m, 0.0, moment / mass - from];
            self.set(segment, mass - shoulders, com, [0.0, 0.0, from - below]);
            below = from;
        }
        self.offset_m[Segment::Neck.index()] = [0.0, 0.0, neck - below];
    }

    /// De Leva's head reaches from the vertex down to the cervicale; neck and head together have its centre.
    fn lay_the_head(&mut self, whole: Part) {
        let neck_length = NECK_LENGTH * self.height_m;
        let neck_centre = 0.5 * neck_length;
        let whole_centre = whole.length_m - whole.centre_m;
        let head_centre = (whole_centre - NECK_MASS_SHARE * neck_centre) / (1.0 - NECK_MASS_SHARE);
        let neck = Segment::Neck.index();
        self.mass_fraction[neck] = NECK_MASS_SHARE * whole.mass;
        self.com_m[neck] = [0.0, 0.0, neck_centre];
        let com = [HEAD_FORWARD * self.height_m, 0.0, head_centre - neck_length];
        self.set(Segment::Head, (1.0 - NECK_MASS_SHARE) * whole.mass, com, [0.0, 0.0, neck_length]);
    }

    fn lay_the_arm(&mut self, shoulder_mass: f64, upper_arm: Part, forearm: Part, hand: Part) {
        let start = [
            0.0,
            CLAVICLE_START * self.height_m,
            self.offset_m[Segment::Neck.index()][2] - SHOULDER_BELOW_NECK * self.height_m,
        ];
        let clavicle = (SHOULDER_HALF_WIDTH - CLAVICLE_START) * self.height_m;
        let left = |distance: f64| [0.0, distance, 0.0];
        self.set(Segment::LeftShoulder, shoulder_mass, left(0.5 * clavicle), start);
        self.set(Segment::LeftUpperArm, upper_arm.mass, left(upper_arm.centre_m), left(clavicle));
        self.set(Segment::LeftForearm, forearm.mass, left(forearm.centre_m), left(upper_arm.length_m));
        self.set(Segment::LeftHand, hand.mass, left(hand.centre_m), left(forearm.length_m));
    }

    fn lay_the_leg(&mut self, thigh: Part, shank: Part, foot: Part) {
        let down = |distance: f64| [0.0, 0.0, -distance];
        let hip = [0.0, HIP_HALF_WIDTH * self.height_m, 0.0];
        self.set(Segment::LeftUpperLeg, thigh.mass, down(thigh.centre_m), hip);
        self.set(Segment::LeftLowerLeg, shank.mass, down(shank.centre_m), down(thigh.length_m));
        // De Leva measures the foot's centre from the heel; the toes' share is taken out of the whole.
        let heel_back = HEEL_BACK * self.height_m;
        let ball = [BALL_FORWARD * self.height_m, 0.0, (BALL_HEIGHT - ANKLE_HEIGHT) * self.height_m];
        let toe_length = foot.length_m - heel_back - ball[0];
        let toe_centre = 0.4 * toe_length;
        let whole = foot.centre_m - heel_back;
        let rear = (whole - TOE_MASS_SHARE * (ball[0] + toe_centre)) / (1.0 - TOE_MASS_SHARE);
        let rear_com = [rear, 0.0, -0.55 * self.ankle_height_m];
        self.set(Segment::LeftFoot, (1.0 - TOE_MASS_SHARE) * foot.mass, rear_com, down(shank.length_m));
        self.set(Segment::LeftToe, TOE_MASS_SHARE * foot.mass, [toe_centre, 0.0, 0.0], ball);
    }

    fn mirror(&mut self, left: Segment) {
        let flip = |[x, y, z]: [f64; 3]| [x, -y, z];
        let index = left.index();
        let (mass, com, offset) = (self.mass_fraction[index], self.com_m[index], self.offset_m[index]);
        self.set(left.mirrored(), mass, flip(com), flip(offset));
    }

    /// The table's percentages are rounded; the shares must be whole.
    fn close_the_sum(&mut self) {
        let sum: f64 = self.mass_fraction.iter().sum();
        for fraction in &mut self.mass_fraction {
            *fraction /= sum;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_segment_weighs_something_and_together_they_are_one_body() {
        for sex in [Sex::Female, Sex::Male, Sex::Unstated] {
            let body = Anthropometry::de_leva(1.77, sex);
            assert!((body.mass_fraction.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            for segment in Segment::ALL {
                let fraction = body.mass_fraction[segment.index()];
                assert!(fraction > 0.0005 && fraction < 0.16, "{segment:?}: {fraction}");
            }
        }
    }

    #[test]
    fn left_mirrors_right() {
        let body = Anthropometry::de_leva(1.62, Sex::Female);
        for segment in Segment::ALL {
            let (here, there) = (segment.index(), segment.mirrored().index());
            assert!((body.mass_fraction[here] - body.mass_fraction[there]).abs() < 1e-15);
            for (a, b) in [(body.com_m[here], body.com_m[there]), (body.offset_m[here], body.offset_m[there])]
            {
                assert!(
                    (a[0] - b[0]).abs() < 1e-15 && (a[1] + b[1]).abs() < 1e-15 && (a[2] - b[2]).abs() < 1e-15
                );
            }
        }
    }

    #[test]
    fn the_body_is_as_tall_as_it_was_told() {
        for (height, sex) in [(1.77, Sex::Male), (1.60, Sex::Female)] {
            let body = Anthropometry::de_leva(height, sex);
            let up = |segment: Segment| body.offset_m[segment.index()][2];
            let leg = body.ankle_height_m - up(Segment::RightLowerLeg) - up(Segment::RightFoot);
            let spine: f64 = Segment::ALL[1..6].iter().map(|segment| up(*segment)).sum();
            // The vertex lies about 0.13 of the stature above MVN's neck joint.
            let sum = leg + spine + 0.13 * height;
            assert!((sum - height).abs() < 0.05 * height, "{sum} for {height}");
        }
    }
}
