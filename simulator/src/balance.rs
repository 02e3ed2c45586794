//! Standing: leg poses that keep both feet in place, and the pelvis shift that balances the whole body.

use equipoise_core::body::{SEGMENTS, Segment, Side};
use nalgebra::{Matrix2, UnitQuaternion, Vector2, Vector3};

use crate::kinematics::{Rotations, centre_m, coms_m, down_the_tree, origins_m};
use crate::leg::{self, Leg};
use crate::person::Person;
use crate::pose::{Pose, straight_height_m};
use crate::stance::Stance;

/// Upper limit of a leg's extension, as a fraction of its length: a fully extended knee has no defined bending
/// direction.
const REACH: f64 = 0.9995;
/// Height over which the reach limit is rounded off, so that motion through it stays smooth, m. With 2 mm a knee that was
/// extended while the trunk rose stopped within 60 ms, and the CoP moved by 40 mm; the knees of a standing person are
/// flexed by 12°.
const REACH_ROUNDING_M: f64 = 0.004;
/// The pelvis is shifted until the centre of mass is this close to its target, m.
///
/// Dynamics takes second differences over milliseconds, so this must be far below a micrometre.
const TOLERANCE_M: f64 = 1e-13;
const MAX_ITERATIONS: usize = 40;

/// Inputs of the balance: the human, the placement of the feet, the carried load.
#[derive(Debug, Clone, Copy)]
pub struct Standing<'a> {
    /// The human.
    pub person: &'a Person,
    /// Centres of mass of the segments, segment axes, m (they deviate from the human's by breathing).
    pub com_m: &'a [Vector3<f64>; SEGMENTS],
    /// Placement of the feet.
    pub stance: &'a Stance,
    /// Load carried at the middle between the grips of the hands, kg.
    pub load_kg: f64,
}

/// Initial values of the balance iteration: the result for a similar body.
#[derive(Debug, Clone, Copy)]
pub struct Start {
    /// Offset of the pelvis from its position for massless legs, m.
    pelvis_offset_m: Vector2<f64>,
    /// Inverse Jacobian: shift of the pelvis per error of the centre of mass, m/m.
    shift_from_error: Matrix2<f64>,
}

impl Default for Start {
    fn default() -> Start {
        // Most of the mass moves with the pelvis, some stays with the feet.
        Start { pelvis_offset_m: Vector2::zeros(), shift_from_error: Matrix2::identity() * 1.2 }
    }
}

/// A body in balance.
#[derive(Debug, Clone, Copy)]
pub struct Balanced {
    /// Pelvis origin in the world, m.
    pub pelvis_m: Vector3<f64>,
    /// `world_from_segment` of all segments.
    pub world_from_segment: Rotations,
    /// Segment origins in the world, m.
    pub origin_m: [Vector3<f64>; SEGMENTS],
    /// Centres of mass of the segments in the world, m.
    pub com_m: [Vector3<f64>; SEGMENTS],
    /// Flexion of the left and right knee, rad.
    pub knee_flexion_rad: [f64; 2],
    /// Distance by which the legs miss the ankles, m; 0 unless the pose is out of reach.
    pub out_of_reach_m: f64,
}

impl Standing<'_> {
    /// The body in `pose` with its centre of mass (with the load) above `target_m`.
    pub fn balance(&self, pose: &Pose, target_m: Vector2<f64>) -> Balanced {
        self.balance_near(pose, target_m, &mut Start::default())
    }

    /// As [`Self::balance`], from given initial values, which are replaced by the result.
    pub fn balance_near(&self, pose: &Pose, target_m: Vector2<f64>, start: &mut Start) -> Balanced {
        let upper = Upper::new(self, pose);
        let Start { pelvis_offset_m, mut shift_from_error } = *start;
        let massless_legs_pelvis_m = target_m - upper.centre_from_pelvis.xy();
        let mut pelvis_xy = massless_legs_pelvis_m + pelvis_offset_m;
        let mut legs = self.legs(pose, &upper, pelvis_xy);
        let mut error = upper.centre(self, &legs).xy() - target_m;
        for _ in 0..MAX_ITERATIONS {
            if error.norm() < TOLERANCE_M {
                break;
            }
            let shift = -(shift_from_error * error);
            pelvis_xy += shift;
            legs = self.legs(pose, &upper, pelvis_xy);
            let now = upper.centre(self, &legs).xy() - target_m;
            // Broyden's update of the inverse Jacobian.
            let turned = shift_from_error * (now - error);
            let weight = shift.dot(&turned);
            if weight.abs() > 1e-300 {
                shift_from_error += (shift - turned) * (shift.transpose() * shift_from_error) / weight;
            }
            error = now;
        }
        *start = Start { pelvis_offset_m: pelvis_xy - massless_legs_pelvis_m, shift_from_error };
        self.assemble(&upper, &legs)
    }

    /// Both legs for a pelvis above `pelvis_xy`, at the pose's height as far as the legs reach.
    fn legs(&self, pose: &Pose, upper: &Upper, pelvis_xy: Vector2<f64>) -> Legs {
        let mut wanted = [pose.pelvis_height * straight_height_m(self.person); 3];
        for (k, hip) in upper.hip_from_pelvis.iter().enumerate() {
            let ankle = self.stance.ankle_m[k];
            let aside = (pelvis_xy + hip.xy() - ankle.xy()).norm();
            let reach = REACH * upper.leg_lengths_m[k].iter().sum::<f64>();
            wanted[k + 1] = ankle.z + (reach * reach - aside * aside).max(0.0).sqrt() - hip.z;
        }
        let pelvis_m = pelvis_xy.push(soft_min(wanted));
        let leg = |k: usize| {
            let knee_forward = self.stance.world_from_foot[k] * Vector3::x();
            let hip_m = pelvis_m + upper.hip_from_pelvis[k];
            leg::solve(hip_m, self.stance.ankle_m[k], upper.leg_lengths_m[k], knee_forward)
        };
        Legs { pelvis_m, leg: [leg(0), leg(1)] }
    }

    fn assemble(&self, upper: &Upper, legs: &Legs) -> Balanced {
        let mut world_from_segment = upper.world_from_segment;
        for (k, side) in Side::BOTH.into_iter().enumerate() {
            let Leg { world_from_upper, world_from_lower, .. } = &legs.leg[k];
            let [upper, lower] =
                [world_from_upper, world_from_lower].map(UnitQuaternion::from_rotation_matrix);
            let foot = self.stance.world_from_foot[k];
            for (segment, rotation) in Stance::leg(side).into_iter().zip([upper, lower, foot, foot]) {
                world_from_segment[segment.index()] = rotation;
            }
        }
        let origin_m = origins_m(self.person, legs.pelvis_m, &world_from_segment);
        let miss = |k: usize| (origin_m[Side::BOTH[k].foot().index()] - self.stance.ankle_m[k]).norm();
        let out_of_reach_m = miss(0).max(miss(1));
        Balanced {
            out_of_reach_m,
            pelvis_m: legs.pelvis_m,
            world_from_segment,
            origin_m,
            com_m: coms_m(self.com_m, &origin_m, &world_from_segment),
            knee_flexion_rad: legs.leg.map(|leg| leg.knee_flexion_rad()),
        }
    }
}

/// The middle between the grips of both hands, m.
pub fn between_the_grips_m(
    person: &Person,
    origin_m: &[Vector3<f64>; SEGMENTS],
    world_from_segment: &Rotations,
) -> Vector3<f64> {
    let grips = grips_m(person, origin_m, world_from_segment);
    (grips[0] + grips[1]) * 0.5
}

/// Grip points of the left and right hand, world, m.
pub fn grips_m(
    person: &Person,
    origin_m: &[Vector3<f64>; SEGMENTS],
    world_from_segment: &Rotations,
) -> [Vector3<f64>; 2] {
    std::array::from_fn(|k| {
        let hand = Side::BOTH[k].hand().index();
        origin_m[hand] + world_from_segment[hand] * person.grip_m[k]
    })
}

/// All parts that move rigidly with the pelvis once the pose is chosen.
struct Upper {
    world_from_segment: Rotations,
    /// Their mass with the load, kg, and their centre from the pelvis origin, world axes, m.
    mass_kg: f64,
    centre_from_pelvis: Vector3<f64>,
    hip_from_pelvis: [Vector3<f64>; 2],
    leg_lengths_m: [[f64; 2]; 2],
    /// Mass of foot and toe, kg, and their centre from the ankle, world axes, m; the toes are aligned with the foot.
    foot: [(f64, Vector3<f64>); 2],
}

impl Upper {
    fn new(standing: &Standing, pose: &Pose) -> Upper {
        let person = standing.person;
        let world_from_segment = down_the_tree(&pose.parent_from_segment);
        let origin_m = origins_m(person, Vector3::zeros(), &world_from_segment);
        let com_m = coms_m(standing.com_m, &origin_m, &world_from_segment);
        // The legs are last in the segment order.
        let trunk = ..Segment::RightUpperLeg.index();
        let body_kg: f64 = person.segment_mass_kg[trunk].iter().sum();
        let body = centre_m(&person.segment_mass_kg[trunk], &com_m[trunk]);
        let load = between_the_grips_m(person, &origin_m, &world_from_segment);
        let mass_kg = body_kg + standing.load_kg;
        let hips = Side::BOTH.map(|side| Stance::leg(side)[0]);
        Upper {
            world_from_segment,
            mass_kg,
            centre_from_pelvis: (body * body_kg + load * standing.load_kg) / mass_kg,
            hip_from_pelvis: hips.map(|hip| origin_m[hip.index()]),
            leg_lengths_m: hips.map(|hip| person.leg_lengths_m(hip)),
            foot: [0, 1].map(|k: usize| {
                let [foot, toe] = [Side::BOTH[k].foot(), Side::BOTH[k].toe()].map(Segment::index);
                let (mass_kg, com_m) = (&person.segment_mass_kg, standing.com_m);
                let total_kg = mass_kg[foot] + mass_kg[toe];
                let moment = com_m[foot] * mass_kg[foot] + (person.offset_m[toe] + com_m[toe]) * mass_kg[toe];
                (total_kg, standing.stance.world_from_foot[k] * (moment / total_kg))
            }),
        }
    }

    /// Centre of mass of everything, m.
    fn centre(&self, standing: &Standing, legs: &Legs) -> Vector3<f64> {
        let person = standing.person;
        let mut mass = self.mass_kg;
        let mut moment = (legs.pelvis_m + self.centre_from_pelvis) * self.mass_kg;
        let mut add_mass = |mass_kg: f64, point_m: Vector3<f64>| {
            mass += mass_kg;
            moment += point_m * mass_kg;
        };
        for (k, side) in Side::BOTH.into_iter().enumerate() {
            let [thigh, shank, foot, _] = Stance::leg(side).map(Segment::index);
            let Leg { world_from_upper, world_from_lower, .. } = legs.leg[k];
            let hip_m = legs.pelvis_m + self.hip_from_pelvis[k];
            let knee_m = hip_m + world_from_upper * person.offset_m[shank];
            let ankle_m = knee_m + world_from_lower * person.offset_m[foot];
            add_mass(person.segment_mass_kg[thigh], hip_m + world_from_upper * standing.com_m[thigh]);
            add_mass(person.segment_mass_kg[shank], knee_m + world_from_lower * standing.com_m[shank]);
            let (foot_kg, foot_from_ankle_m) = self.foot[k];
            add_mass(foot_kg, ankle_m + foot_from_ankle_m);
        }
        moment / mass
    }
}

struct Legs {
    pelvis_m: Vector3<f64>,
    leg: [Leg; 2],
}

/// Smooth minimum of three heights, rounded off where two of them meet; never above the minimum.
fn soft_min(heights_m: [f64; 3]) -> f64 {
    let least = heights_m.into_iter().fold(f64::INFINITY, f64::min);
    let sum: f64 = heights_m.iter().map(|height| ((least - height) / REACH_ROUNDING_M).exp()).sum();
    least - REACH_ROUNDING_M * sum.ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::intention::{Arm, Intention};

    #[test]
    fn the_centre_of_mass_comes_to_stand_over_its_target_and_the_feet_stay() {
        let person = Person::new(11, 1.70, 66.0);
        let stance = Stance::shoulder_wide(&person);
        let intention = Intention {
            pelvis_drop: 0.15,
            trunk_flex_deg: 30.0,
            trunk_twist_deg: 15.0,
            left_arm: Arm { elevation_deg: 90.0, forward_deg: 90.0, ..Arm::DOWN },
            ..Intention::STAND
        };
        for load_kg in [0.0, 4.0] {
            let standing = Standing { person: &person, com_m: &person.com_m, stance: &stance, load_kg };
            let target = stance.between_the_feet_m(0.05);
            let body = standing.balance(&intention.pose(), target);
            let mut mass = person.segment_mass_kg.to_vec();
            let mut point = body.com_m.to_vec();
            mass.push(load_kg);
            point.push(between_the_grips_m(&person, &body.origin_m, &body.world_from_segment));
            assert!((centre_m(&mass, &point).xy() - target).norm() < 1e-12);
            for (k, side) in Side::BOTH.into_iter().enumerate() {
                assert!((body.origin_m[side.foot().index()] - stance.ankle_m[k]).norm() < 1e-9);
            }
        }
    }
}
