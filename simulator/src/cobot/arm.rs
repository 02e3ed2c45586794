//! Kinematics of a UR10e: Denavit–Hartenberg parameters as published in Universal Robots' article "DH Parameters for
//! calculations of kinematics and dynamics".
//!
//! Frame: base of the arm, Z up, metres. The tool centre point (TCP) is the middle of the tool flange.

use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};

/// Number of joints.
pub const JOINTS: usize = 6;
/// Joint angles, rad, or their derivatives.
pub type Joints = Vector6<f64>;

/// Link offsets d of the joints, m.
const D_M: [f64; JOINTS] = [0.1807, 0.0, 0.0, 0.174_15, 0.119_85, 0.116_55];
/// Link lengths a, m.
const A_M: [f64; JOINTS] = [0.0, -0.6127, -0.571_55, 0.0, 0.0, 0.0];
/// Link twists α, rad.
const ALPHA_RAD: [f64; JOINTS] =
    [std::f64::consts::FRAC_PI_2, 0.0, 0.0, std::f64::consts::FRAC_PI_2, -std::f64::consts::FRAC_PI_2, 0.0];
/// Damping of the inverse near singular configurations. Units differ (m, rad); it is small against both.
const DAMPING: f64 = 0.02;

/// Pose of each joint's frame after its link; the last one is that of the TCP.
fn frames(q_rad: &Joints) -> [Isometry3<f64>; JOINTS] {
    let mut pose = Isometry3::identity();
    std::array::from_fn(|joint| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), q_rad[joint]);
        let link = Translation3::new(A_M[joint], 0.0, D_M[joint]);
        let twist = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), ALPHA_RAD[joint]);
        pose = pose * Isometry3::from_parts(Translation3::identity(), turn) * link * twist;
        pose
    })
}

/// Pose of the TCP in the base.
#[must_use]
pub fn forward(q_rad: &Joints) -> Isometry3<f64> {
    frames(q_rad)[JOINTS - 1]
}

/// Base, the end of each link, and thus the TCP last, base frame, m: for drawings.
#[must_use]
pub fn chain_m(q_rad: &Joints) -> [Vector3<f64>; JOINTS + 1] {
    let frames = frames(q_rad);
    std::array::from_fn(|end| {
        end.checked_sub(1).map_or_else(Vector3::zeros, |link| frames[link].translation.vector)
    })
}

/// Jacobian of the TCP: rows 0 to 2 linear (m/s), 3 to 5 angular (rad/s), base axes.
#[must_use]
pub fn jacobian(q_rad: &Joints) -> Matrix6<f64> {
    let frames = frames(q_rad);
    let tcp_m = frames[JOINTS - 1].translation.vector;
    let mut columns = Matrix6::zeros();
    for joint in 0..JOINTS {
        let before = if joint == 0 { Isometry3::identity() } else { frames[joint - 1] };
        let axis = before.rotation * Vector3::z();
        let linear = axis.cross(&(tcp_m - before.translation.vector));
        columns.fixed_view_mut::<3, 1>(0, joint).copy_from(&linear);
        columns.fixed_view_mut::<3, 1>(3, joint).copy_from(&axis);
    }
    columns
}

/// Linear velocity of the TCP, m/s.
#[must_use]
pub fn tcp_velocity(q_rad: &Joints, qd_rad_per_s: &Joints) -> Vector3<f64> {
    (jacobian(q_rad) * qd_rad_per_s).fixed_rows::<3>(0).into_owned()
}

/// Joint velocities of a twist (m/s, rad/s) by damped least squares: Jᵀ (J Jᵀ + λ² I)⁻¹ v (Wampler 1986).
#[must_use]
pub fn joint_velocities(q_rad: &Joints, twist: &Vector6<f64>) -> Joints {
    let jacobian = jacobian(q_rad);
    let damped = jacobian * jacobian.transpose() + Matrix6::identity() * (DAMPING * DAMPING);
    // Symmetric and positive definite because of the damping.
    damped.cholesky().map_or_else(Joints::zeros, |factor| jacobian.transpose() * factor.solve(twist))
}

/// Rotation vector, rad, that turns `from` into `to`, base axes.
#[must_use]
pub fn rotation_between(from: &UnitQuaternion<f64>, to: &UnitQuaternion<f64>) -> Vector3<f64> {
    (to * from.inverse()).scaled_axis()
}

/// Maximum number of iterations of [`inverse`].
const ITERATIONS_MAX: usize = 200;

/// Joint angles near `start_rad` whose TCP has this pose to 0.1 mm and 0.1 mrad; `None` without convergence.
#[must_use]
pub fn inverse(start_rad: &Joints, pose: &Isometry3<f64>) -> Option<Joints> {
    let mut q_rad = *start_rad;
    for _ in 0..ITERATIONS_MAX {
        let at = forward(&q_rad);
        let shift_m = pose.translation.vector - at.translation.vector;
        let turn_rad = rotation_between(&at.rotation, &pose.rotation);
        if shift_m.norm() < 1e-4 && turn_rad.norm() < 1e-4 {
            return Some(q_rad);
        }
        let mut twist = Vector6::zeros();
        twist.fixed_rows_mut::<3>(0).copy_from(&shift_m.cap_magnitude(0.1));
        twist.fixed_rows_mut::<3>(3).copy_from(&turn_rad.cap_magnitude(0.2));
        q_rad += joint_velocities(&q_rad, &twist);
    }
    None
}

/// Pose as six numbers of RTDE: position, m, and rotation vector, rad.
#[must_use]
pub fn pose_vector(pose: &Isometry3<f64>) -> [f64; 6] {
    let (at_m, turn_rad) = (pose.translation.vector, pose.rotation.scaled_axis());
    [at_m.x, at_m.y, at_m.z, turn_rad.x, turn_rad.y, turn_rad.z]
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;
    use crate::random::Random;

    fn position_m(q_rad: [f64; 6]) -> Vector3<f64> {
        forward(&Joints::from(q_rad)).translation.vector
    }

    #[test]
    fn forward_kinematics_match_the_published_dimensions() {
        // Stretched along −X: reach of both arms 0.6127 + 0.57155; offsets of wrist and flange sideways.
        let zero = position_m([0.0; 6]);
        assert!((zero - Vector3::new(-1.184_25, -0.290_7, 0.060_85)).norm() < 1e-12, "{zero}");
        // "Home" of the teach pendant: upright, 0.1807 + 0.6127 + 0.57155 + 0.11985.
        let home = position_m([0.0, -FRAC_PI_2, 0.0, -FRAC_PI_2, 0.0, 0.0]);
        assert!((home - Vector3::new(0.0, -0.290_7, 1.484_8)).norm() < 1e-12, "{home}");
        // Upper arm upright, forearm horizontal along −X, wrist down.
        let bent = position_m([0.0, -FRAC_PI_2, FRAC_PI_2, -FRAC_PI_2, -FRAC_PI_2, 0.0]);
        let expected = Vector3::new(-0.571_55 - 0.119_85, -0.174_15, 0.1807 + 0.6127 - 0.116_55);
        assert!((bent - expected).norm() < 1e-9, "{bent}");
    }

    /// The chain of the ROS description (`ur_description/config/ur10e/default_kinematics.yaml`): origin (x, y, z) and
    /// roll of each joint; no Denavit–Hartenberg parameters.
    const URDF: [([f64; 3], f64); 6] = [
        ([0.0, 0.0, 0.1807], 0.0),
        ([0.0, 0.0, 0.0], FRAC_PI_2),
        ([-0.6127, 0.0, 0.0], 0.0),
        ([-0.571_55, 0.0, 0.174_15], 0.0),
        ([0.0, -0.119_85, 0.0], FRAC_PI_2),
        ([0.0, 0.116_55, 0.0], -FRAC_PI_2),
    ];

    #[test]
    fn forward_kinematics_match_the_chain_of_the_ros_description() {
        let mut random = Random::new(1, "arm");
        for _ in 0..100 {
            let q_rad = Joints::from_fn(|_, _| random.between(-PI, PI));
            let mut pose = Isometry3::identity();
            for (joint, ([x, y, z], roll)) in URDF.into_iter().enumerate() {
                let turn = UnitQuaternion::from_euler_angles(roll, 0.0, 0.0);
                pose *= Isometry3::from_parts(Translation3::new(x, y, z), turn);
                pose *= UnitQuaternion::from_axis_angle(&Vector3::z_axis(), q_rad[joint]);
            }
            let difference = forward(&q_rad).inverse() * pose;
            assert!(difference.translation.vector.norm() < 1e-12, "{difference}");
            assert!(difference.rotation.angle() < 1e-7, "{difference}");
        }
    }

    #[test]
    fn the_jacobian_is_the_derivative_of_the_position() {
        let mut random = Random::new(2, "arm");
        for _ in 0..100 {
            let q_rad = Joints::from_fn(|_, _| random.between(-PI, PI));
            let qd = Joints::from_fn(|_, _| random.between(-1.0, 1.0));
            let half_s = 1e-6;
            let at_m = |time_s: f64| forward(&(q_rad + qd * time_s)).translation.vector;
            let numeric = (at_m(half_s) - at_m(-half_s)) / (2.0 * half_s);
            assert!((tcp_velocity(&q_rad, &qd) - numeric).norm() < 1e-8);
        }
    }

    #[test]
    fn the_inverse_is_found_near_the_present_configuration() {
        let mut random = Random::new(3, "arm");
        let start_rad = Joints::from([0.2, -1.2, 1.9, -0.7, 1.5, 0.3]);
        for _ in 0..100 {
            let wanted = start_rad + Joints::from_fn(|_, _| random.between(-0.4, 0.4));
            let pose = forward(&wanted);
            let found = inverse(&start_rad, &pose).unwrap();
            assert!((forward(&found).translation.vector - pose.translation.vector).norm() < 1e-4);
        }
        let far = Isometry3::from_parts(Translation3::new(2.0, 0.0, 0.5), UnitQuaternion::identity());
        assert_eq!(inverse(&start_rad, &far), None);
    }
}
