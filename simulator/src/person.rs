//! One simulated person: segment lengths, masses, centres and inertias.
//!
//! Masses, centres and radii of gyration: D. A. Winter, *Biomechanics and Motor Control of Human Movement* (after
//! Dempster), with the trunk's three parts distributed over MVN's spine segments by this project. Lengths: Drillis and
//! Contini's proportions of stature as given by Winter, with joint heights of the spine read off an MVN null pose.

use equipoise_core::body::{SEGMENTS, Segment};
use nalgebra::{Matrix3, Vector3};

use crate::random::Random;

/// A body, segment by segment, in segment axes (T-pose: X forward, Y left, Z up). Arrays are indexed by [`Segment`].
#[derive(Debug, Clone, PartialEq)]
pub struct Person {
    /// Stature, m.
    pub height_m: f64,
    /// Mass of the whole body, kg.
    pub mass_kg: f64,
    /// The segment's origin from its parent's origin, parent's axes, m; zero for the pelvis.
    pub offset_m: [Vector3<f64>; SEGMENTS],
    /// Mass of each segment, kg; the sum is `mass_kg`.
    pub segment_mass_kg: [f64; SEGMENTS],
    /// Centre of mass from the segment's origin, m.
    pub com_m: [Vector3<f64>; SEGMENTS],
    /// Inertia about the centre of mass, segment axes, kg m².
    pub inertia_kg_m2: [Matrix3<f64>; SEGMENTS],
    /// Grip points of the left and right hand, from the wrist, hand's axes, m.
    pub grip_m: [Vector3<f64>; 2],
    /// Height of the ankle joint above the floor in flat standing, m.
    pub ankle_height_m: f64,
    /// Foot outline, from the ankle: back to the heel, forward to the tip of the toes, half its width, m.
    pub foot_outline_m: FootOutline,
}

/// Foot outline on the floor, from the point below the ankle, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FootOutline {
    /// Ankle to heel.
    pub back: f64,
    /// Ankle to the tip of the toes.
    pub forward: f64,
    /// Half the width at the ball.
    pub half_width: f64,
}

/// One segment of an average body: mass over body mass; centre, length vector and inertia over stature.
struct Average {
    segment: Segment,
    mass: f64,
    /// From the parent's origin.
    offset: [f64; 3],
    com: [f64; 3],
    /// Length, and radius of gyration over length, across and along the long axis.
    length: f64,
    gyration: [f64; 2],
}

const fn average(
    segment: Segment,
    mass: f64,
    offset: [f64; 3],
    com: [f64; 3],
    length: f64,
    gyration: [f64; 2],
) -> Average {
    Average { segment, mass, offset, com, length, gyration }
}

const ANKLE_HEIGHT: f64 = 0.050;
const FOOT_OUTLINE: FootOutline = FootOutline { back: 0.036, forward: 0.122, half_width: 0.027 };
const GRIP: f64 = 0.050;

/// Midline and left side; the right side mirrors the left.
const AVERAGE: [Average; 15] = [
    average(Segment::Pelvis, 0.125, [0.0, 0.0, 0.0], [-0.004, 0.0, 0.018], 0.100, [0.60, 0.70]),
    average(Segment::L5, 0.050, [-0.006, 0.0, 0.055], [0.012, 0.0, 0.028], 0.060, [0.85, 1.00]),
    average(Segment::L3, 0.055, [0.002, 0.0, 0.060], [0.015, 0.0, 0.027], 0.055, [0.90, 1.05]),
    average(Segment::T12, 0.075, [0.0, 0.0, 0.055], [0.014, 0.0, 0.028], 0.055, [0.95, 1.10]),
    average(Segment::T8, 0.156, [0.0, 0.0, 0.055], [0.012, 0.0, 0.050], 0.105, [0.65, 0.70]),
    average(Segment::Neck, 0.016, [0.002, 0.0, 0.104], [0.004, 0.0, 0.026], 0.053, [0.50, 0.50]),
    average(Segment::Head, 0.065, [0.002, 0.0, 0.053], [0.010, 0.0, 0.036], 0.100, [0.48, 0.42]),
    average(Segment::LeftShoulder, 0.018, [0.0, 0.016, 0.075], [0.0, 0.050, 0.0], 0.090, [0.40, 0.30]),
    average(Segment::LeftUpperArm, 0.028, [0.0, 0.090, 0.0], [0.0, 0.0785, 0.0], 0.180, [0.322, 0.12]),
    average(Segment::LeftForearm, 0.016, [0.0, 0.180, 0.0], [0.0, 0.0628, 0.0], 0.146, [0.303, 0.10]),
    average(Segment::LeftHand, 0.006, [0.0, 0.146, 0.0], [0.0, 0.048, 0.0], 0.108, [0.297, 0.15]),
    average(Segment::LeftUpperLeg, 0.100, [0.0, 0.049, 0.0], [0.0, 0.0, -0.106], 0.245, [0.323, 0.14]),
    average(Segment::LeftLowerLeg, 0.0465, [0.0, 0.0, -0.245], [0.0, 0.0, -0.1018], 0.235, [0.302, 0.10]),
    average(Segment::LeftFoot, 0.0120, [0.0, 0.0, -0.235], [0.026, 0.0, -0.027], 0.130, [0.30, 0.20]),
    average(Segment::LeftToe, 0.0025, [0.086, 0.0, -0.038], [0.015, 0.0, 0.0], 0.036, [0.35, 0.35]),
];

impl Person {
    /// The average body of that stature (m) and mass (kg), left like right.
    pub fn nominal(height_m: f64, mass_kg: f64) -> Person {
        let mut person = Person {
            height_m,
            mass_kg,
            offset_m: [Vector3::zeros(); SEGMENTS],
            segment_mass_kg: [0.0; SEGMENTS],
            com_m: [Vector3::zeros(); SEGMENTS],
            inertia_kg_m2: [Matrix3::zeros(); SEGMENTS],
            grip_m: [Vector3::new(0.0, GRIP * height_m, 0.0), Vector3::new(0.0, -GRIP * height_m, 0.0)],
            ankle_height_m: ANKLE_HEIGHT * height_m,
            foot_outline_m: FootOutline {
                back: FOOT_OUTLINE.back * height_m,
                forward: FOOT_OUTLINE.forward * height_m,
                half_width: FOOT_OUTLINE.half_width * height_m,
            },
        };
        for row in &AVERAGE {
            let mass_kg = row.mass * mass_kg;
            let [across, along] =
                row.gyration.map(|fraction| mass_kg * (fraction * row.length * height_m).powi(2));
            let inertia = match long_axis(row) {
                0 => [along, across, across],
                1 => [across, along, across],
                _ => [across, across, along],
            };
            for (segment, side) in [(row.segment, 1.0), (row.segment.mirrored(), -1.0)] {
                let placed = |[x, y, z]: [f64; 3]| Vector3::new(x, side * y, z) * height_m;
                let index = segment.index();
                person.offset_m[index] = placed(row.offset);
                person.com_m[index] = placed(row.com);
                person.segment_mass_kg[index] = mass_kg;
                person.inertia_kg_m2[index] = Matrix3::from_diagonal(&inertia.into());
            }
        }
        person.close_the_sum();
        person
    }

    /// An individual person: the average of that stature and mass, with lengths varied by 3 %, segment masses by 10 %
    /// and centres of mass by 1 cm, by the seed.
    pub fn new(seed: u64, height_m: f64, mass_kg: f64) -> Person {
        let mut person = Person::nominal(height_m, mass_kg);
        let mut random = Random::new(seed, "person");
        for row in &AVERAGE {
            let mirrored = row.segment.mirrored();
            let longer = 1.0 + random.between(-0.03, 0.03);
            let heavier = 1.0 + random.between(-0.09, 0.09);
            for segment in [row.segment, mirrored] {
                // Left and right differ slightly.
                let own = heavier * (1.0 + random.between(-0.01, 0.01));
                let index = segment.index();
                person.offset_m[index] *= longer;
                person.segment_mass_kg[index] *= own;
                person.inertia_kg_m2[index] *= own * (1.0 + random.between(-0.1, 0.1));
                // Small segments vary by less than the centimetre of a trunk's centre.
                let reach = (0.10 * row.length * height_m).min(0.010);
                for axis in 0..3 {
                    person.com_m[index][axis] += random.between(-reach, reach);
                }
                if segment == mirrored {
                    break;
                }
            }
        }
        person.close_the_sum();
        person
    }

    /// Length of thigh and shank of the leg whose upper leg is given, m.
    pub fn leg_lengths_m(&self, upper_leg: Segment) -> [f64; 2] {
        [upper_leg.index() + 1, upper_leg.index() + 2].map(|index| self.offset_m[index].norm())
    }

    /// Normalises the segment masses to the body mass.
    fn close_the_sum(&mut self) {
        let scale = self.mass_kg / self.segment_mass_kg.iter().sum::<f64>();
        for (mass, inertia) in self.segment_mass_kg.iter_mut().zip(&mut self.inertia_kg_m2) {
            *mass *= scale;
            *inertia *= scale;
        }
    }
}

/// The long axis of a segment: its centre's largest coordinate; a foot's origin is the ankle, which is above its axis.
fn long_axis(row: &Average) -> usize {
    if row.segment == Segment::LeftFoot {
        return 0;
    }
    (0..3).max_by(|a, b| row.com[*a].abs().total_cmp(&row.com[*b].abs())).unwrap_or(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_make_up_the_body() {
        for person in [Person::nominal(1.77, 72.0), Person::new(3, 1.62, 58.0)] {
            assert!((person.segment_mass_kg.iter().sum::<f64>() - person.mass_kg).abs() < 1e-9);
            for segment in Segment::ALL {
                assert!(person.segment_mass_kg[segment.index()] > 0.0, "{segment:?}");
                assert!(person.inertia_kg_m2[segment.index()].trace() > 0.0, "{segment:?}");
            }
        }
    }

    #[test]
    fn a_foot_turns_most_easily_about_its_length() {
        let person = Person::nominal(1.77, 72.0);
        for foot in [Segment::LeftFoot, Segment::RightFoot] {
            let about = person.inertia_kg_m2[foot.index()].diagonal();
            assert!(about.x < 0.5 * about.y && about.y == about.z, "{about}");
        }
    }

    #[test]
    fn the_hip_stands_at_its_proportion_of_stature() {
        let person = Person::nominal(2.0, 80.0);
        let [thigh, shank] = person.leg_lengths_m(Segment::LeftUpperLeg);
        assert!((person.ankle_height_m + thigh + shank - 0.53 * 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_seed_is_a_person_and_another_seed_another() {
        assert_eq!(Person::new(5, 1.77, 72.0), Person::new(5, 1.77, 72.0));
        assert_ne!(Person::new(5, 1.77, 72.0), Person::new(6, 1.77, 72.0));
    }

    #[test]
    fn a_person_is_never_far_from_the_average() {
        let nominal = Person::nominal(1.77, 72.0);
        for seed in 0..20 {
            let person = Person::new(seed, 1.77, 72.0);
            for i in 0..SEGMENTS {
                let ratio = person.segment_mass_kg[i] / nominal.segment_mass_kg[i];
                assert!((0.85..1.15).contains(&ratio), "{ratio}");
                assert!((person.com_m[i] - nominal.com_m[i]).amax() <= 0.010 + 1e-12);
            }
        }
    }
}
