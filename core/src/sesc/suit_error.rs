//! Effect of the suit's orientation errors on the CoM, and hence on θ and on a measurement.
//!
//! The suit's body is rigid: wrong orientations also give wrong joint positions. With the feet held on the floor, an
//! error δ of a leg segment also moves the pelvis and all segments above. So an error δ_s (a small rotation, world
//! axes) of segment s moves the predicted CoM by `δ_s × R_s ψ_s`, where the effective vector ψ_s is φ_s minus the
//! segment's contribution between the feet and the pelvis.
//!
//! A constant error (sensor to segment) is equivalent to a rotated φ_s: it belongs to the prior of φ_s, and the filter
//! estimates it. A varying error (drift) belongs to the measurement.

use nalgebra::Vector3;

use super::Phi;
use crate::body::{SEGMENTS, Side, Skeleton};
use crate::frame::{Pose, StationWorld};

/// ψ of every segment, segment axes, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectiveVectors(pub [[f64; 3]; SEGMENTS]);

/// ψ from φ.
///
/// `tied_to_feet`: the position is that of the feet, as [`crate::anchor`] holds it: the mean over both feet of the
/// middle between ankle and ball. Each leg's bones then contribute one half to the pelvis' position, the foot's one
/// quarter. Otherwise the position is measured independently, and ψ = φ.
pub fn effective_vectors(phi: &Phi, skeleton: &Skeleton, tied_to_feet: bool) -> EffectiveVectors {
    let mut psi = phi.0;
    if tied_to_feet {
        for side in Side::BOTH {
            for (bone_end, fraction) in [(side.lower_leg(), 0.5), (side.foot(), 0.5), (side.toe(), 0.25)] {
                let Some(bone) = bone_end.parent() else { continue };
                for (psi, along) in psi[bone.index()].iter_mut().zip(skeleton.offset_m[bone_end.index()]) {
                    *psi -= fraction * along;
                }
            }
        }
    }
    EffectiveVectors(psi)
}

/// Variance of the predicted CoM, x and y, m², if every segment's orientation drifts by `sigma_rad` about each axis,
/// independently of the others: `σ² Σ (v_y² + v_z²)` and `σ² Σ (v_x² + v_z²)` with `v = R_s ψ_s`.
pub fn drift_variance_m2(pose: &Pose<StationWorld>, psi: &EffectiveVectors, sigma_rad: f64) -> [f64; 2] {
    let (mut x, mut y) = (0.0, 0.0);
    for (rotation, psi) in pose.world_from_segment.iter().zip(psi.0) {
        let arm = rotation * Vector3::from(psi);
        x += arm.y * arm.y + arm.z * arm.z;
        y += arm.x * arm.x + arm.z * arm.z;
    }
    [x, y].map(|squares| sigma_rad * sigma_rad * squares)
}

/// Changes of φ_s, segment axes, m, by a constant misalignment of the segment of `sigma_rad` about each of its axes: `ε
/// × ψ`, one vector per axis. Their outer products add up to φ_s's covariance `σ² (|ψ|² I − ψ ψᵀ)`.
pub fn misalignment_m([x, y, z]: [f64; 3], sigma_rad: f64) -> [[f64; 3]; 3] {
    [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]].map(|moved| moved.map(|metres| sigma_rad * metres))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Anthropometry, Segment, Sex};
    use crate::pose_suggestion::{Posture, posture};
    use crate::sesc::centre_of_mass;
    use nalgebra::UnitQuaternion;

    fn body() -> (Skeleton, Phi) {
        let skeleton = Skeleton::nominal(1.77);
        let phi = Phi::of(&skeleton, &Anthropometry::de_leva(&skeleton, 1.77, Sex::Male));
        (skeleton, phi)
    }

    /// An asymmetric pose with errors of its orientations, segment axes, and the resulting joint positions of a rigid
    /// body; the feet's mean is held, as by the anchor, if `tied`.
    fn pose_with(skeleton: &Skeleton, off: &[Vector3<f64>; SEGMENTS], tied: bool) -> Pose<StationWorld> {
        let mut rotation_deg = [[0; 3]; SEGMENTS];
        for (index, degrees) in rotation_deg.iter_mut().enumerate() {
            *degrees = [index as i16 * 3 - 20, 15 - index as i16, (index as i16 % 5) * 9];
        }
        let right = posture::pose_of(&Posture { name: "any", rotation_deg }, skeleton, [0.3, -0.2, 0.95]);
        let mut rotation = right.world_from_segment;
        for (rotation, off) in rotation.iter_mut().zip(off) {
            *rotation *= UnitQuaternion::from_scaled_axis(*off);
        }
        let mut origin = right.origin;
        for segment in Segment::ALL {
            if let Some(parent) = segment.parent() {
                let along = Vector3::from(skeleton.offset_m[segment.index()]);
                origin[segment.index()] = origin[parent.index()] + rotation[parent.index()] * along;
            }
        }
        let feet = |origin: &[Vector3<f64>; SEGMENTS]| -> Vector3<f64> {
            Side::BOTH
                .map(|side| 0.25 * (origin[side.foot().index()] + origin[side.toe().index()]))
                .iter()
                .sum()
        };
        let shift = feet(&right.origin) - feet(&origin);
        Pose::new(if tied { origin.map(|origin| origin + shift) } else { origin }, rotation)
    }

    fn off(at: usize, axis: usize, radians: f64) -> [Vector3<f64>; SEGMENTS] {
        let mut off = [Vector3::zeros(); SEGMENTS];
        off[at][axis] = radians;
        off
    }

    #[test]
    fn a_small_error_of_one_segment_moves_the_centre_along_its_effective_vector() {
        let (skeleton, phi) = body();
        let none = [Vector3::zeros(); SEGMENTS];
        let small = 1e-6;
        for tied in [true, false] {
            let psi = effective_vectors(&phi, &skeleton, tied);
            let right = pose_with(&skeleton, &none, tied);
            for segment in 0..SEGMENTS {
                for axis in 0..3 {
                    let off = off(segment, axis, small);
                    let wrong = pose_with(&skeleton, &off, tied);
                    let moved = (centre_of_mass(&wrong, &phi) - centre_of_mass(&right, &phi)) / small;
                    let reported = right.world_from_segment[segment]
                        * (off[segment] / small).cross(&Vector3::from(psi.0[segment]));
                    assert!((moved - reported).norm() < 1e-5, "{tied} {segment} {axis}: {moved} {reported}");
                }
            }
        }
    }

    #[test]
    fn the_variance_is_the_sum_over_all_small_errors() {
        let (skeleton, phi) = body();
        let (small, sigma_rad) = (1e-6, 0.005);
        for tied in [true, false] {
            let right = pose_with(&skeleton, &[Vector3::zeros(); SEGMENTS], tied);
            let mut sum = [0.0; 2];
            for at in 0..3 * SEGMENTS {
                let wrong = pose_with(&skeleton, &off(at / 3, at % 3, small), tied);
                let moved = (centre_of_mass(&wrong, &phi) - centre_of_mass(&right, &phi)) / small;
                sum = [0, 1].map(|axis| sum[axis] + sigma_rad * sigma_rad * moved[axis] * moved[axis]);
            }
            let reported = drift_variance_m2(&right, &effective_vectors(&phi, &skeleton, tied), sigma_rad);
            for axis in 0..2 {
                assert!((reported[axis] - sum[axis]).abs() < 1e-4 * sum[axis], "{reported:?} {sum:?}");
            }
        }
    }

    #[test]
    fn a_constant_misalignment_is_absorbed_by_a_rotated_phi_in_every_pose() {
        let (skeleton, phi) = body();
        let (segment, sigma_rad) = (Segment::LeftUpperLeg.index(), 1e-6);
        let psi = effective_vectors(&phi, &skeleton, true).0[segment];
        let right = pose_with(&skeleton, &[Vector3::zeros(); SEGMENTS], true);
        for (axis, moved) in misalignment_m(psi, sigma_rad).into_iter().enumerate() {
            let wrong = pose_with(&skeleton, &off(segment, axis, sigma_rad), true);
            let mut rotated = phi;
            for (value, moved) in rotated.0[segment].iter_mut().zip(moved) {
                *value -= moved;
            }
            let apart = centre_of_mass(&wrong, &rotated) - centre_of_mass(&right, &phi);
            assert!(apart.norm() < 1e-4 * sigma_rad, "{axis}: {apart}");
        }
    }

    #[test]
    fn misalignments_about_all_axes_have_the_covariance_of_a_random_rotation() {
        let psi = [0.03, -0.2, 0.1];
        let square: f64 = psi.iter().map(|value| value * value).sum();
        let moved = misalignment_m(psi, 0.01);
        for row in 0..3 {
            for column in 0..3 {
                let sum: f64 = moved.iter().map(|moved| moved[row] * moved[column]).sum();
                let along = if row == column { square } else { 0.0 };
                assert!((sum - 1e-4 * (along - psi[row] * psi[column])).abs() < 1e-15);
            }
        }
    }
}
