//! Radii of gyration of each segment about its own centre.
//!
//! Source: P. de Leva, J. Biomechanics 29 (1996), table 4, men's radii over segment length. Limbs use them directly.
//! The trunk's three parts are cut into MVN's five: a slice has its part's breadth and depth (the radius about each
//! horizontal axis without the contribution of the part's own height) and its own height.

use super::{SEGMENTS, Segment, Skeleton};
use crate::math;

/// Radii of gyration over length: about two axes across, and about the long axis.
type Radii = ([f64; 2], f64);

const UPPER_ARM: Radii = ([0.285, 0.269], 0.158);
const FOREARM: Radii = ([0.276, 0.265], 0.121);
const HAND: Radii = ([0.628, 0.513], 0.401);
const THIGH: Radii = ([0.329, 0.329], 0.149);
const SHANK: Radii = ([0.255, 0.249], 0.103);
const FOOT: Radii = ([0.257, 0.245], 0.124);
/// Wrist to knuckles, heel to toe, over stature (de Leva, men).
const HAND_LENGTH: f64 = 0.0495;
const FOOT_LENGTH: f64 = 0.148;
/// Head: about X, Y and Z, over stature.
const HEAD: [f64; 3] = [0.042, 0.044, 0.036];

/// Breadth and depth of a trunk slice as radii of gyration over stature, from de Leva's three parts.
const TRUNK: [(Segment, [f64; 2]); 5] = [
    (Segment::Pelvis, [0.045, 0.039]),
    (Segment::L5, [0.047, 0.034]),
    (Segment::L3, [0.048, 0.031]),
    (Segment::T12, [0.052, 0.026]),
    (Segment::T8, [0.058, 0.019]),
];

/// Squares of the radii of gyration about each segment's own axes X, Y, Z (T-pose: forward, left, up), m².
pub fn gyration_m2(skeleton: &Skeleton, height_m: f64) -> [[f64; 3]; SEGMENTS] {
    let mut gyration = [[0.0; 3]; SEGMENTS];
    let mut set = |segment: Segment, [x, y, z]: [f64; 3]| {
        for side in [segment, segment.mirrored()] {
            gyration[side.index()] = [x * x, y * y, z * z];
        }
    };
    for (index, (segment, [breadth, depth])) in TRUNK.into_iter().enumerate() {
        let next = TRUNK.get(index + 1).map_or(Segment::Neck, |(next, _)| *next);
        // A uniform slice of height h has a radius of h/√12 about its middle.
        let height = skeleton.length_m(next) / math::sqrt(12.0);
        let [breadth, depth] = [breadth * height_m, depth * height_m];
        let about = |across: f64| math::hypot([across, height]);
        set(segment, [about(breadth), about(depth), math::hypot([breadth, depth])]);
    }
    let along_y = |([a, b], long): Radii, length: f64| [a * length, long * length, b * length];
    let along_z = |([a, b], long): Radii, length: f64| [a * length, b * length, long * length];
    set(Segment::Head, HEAD.map(|radius| radius * height_m));
    set(Segment::LeftUpperArm, along_y(UPPER_ARM, skeleton.length_m(Segment::LeftForearm)));
    set(Segment::LeftForearm, along_y(FOREARM, skeleton.length_m(Segment::LeftHand)));
    set(Segment::LeftHand, along_y(HAND, HAND_LENGTH * height_m));
    set(Segment::LeftUpperLeg, along_z(THIGH, skeleton.length_m(Segment::LeftLowerLeg)));
    set(Segment::LeftLowerLeg, along_z(SHANK, skeleton.length_m(Segment::LeftFoot)));
    let ([across, upright], long) = FOOT;
    set(Segment::LeftFoot, [long, across, upright].map(|radius| radius * FOOT_LENGTH * height_m));
    gyration
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Anthropometry, Sex};

    #[test]
    fn a_stiff_trunk_has_the_inertia_of_the_whole_trunk() {
        // De Leva's men: the whole trunk of 43.5 % of the mass has radii of 0.328 and 0.306 of its length of 0.603 m
        // (cervicale to mid-hip), at a stature of 1.741 m.
        let height_m = 1.741;
        let skeleton = Skeleton::nominal(height_m);
        let (body, gyration) =
            (Anthropometry::de_leva(&skeleton, height_m, Sex::Male), gyration_m2(&skeleton, height_m));
        let origin = skeleton.t_pose_m();
        let trunk = TRUNK.map(|(segment, _)| segment.index());
        let height = |index: usize| origin[index][2] + body.com_m[index][2];
        let mass: f64 = trunk.iter().map(|index| body.mass_fraction[*index]).sum();
        let centre =
            trunk.iter().map(|index| body.mass_fraction[*index] * height(*index)).sum::<f64>() / mass;
        for (axis, known) in [(0, 0.328 * 0.603), (1, 0.306 * 0.603)] {
            let square: f64 = trunk
                .iter()
                .map(|index| {
                    let off = height(*index) - centre;
                    body.mass_fraction[*index] * (gyration[*index][axis] + off * off)
                })
                .sum::<f64>()
                / mass;
            let radius = math::sqrt(square);
            assert!((radius / known - 1.0).abs() < 0.1, "axis {axis}: {radius} m, de Leva {known} m");
        }
    }
}
