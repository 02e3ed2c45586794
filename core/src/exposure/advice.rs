//! Direction in which to move the load to relieve the joint closest to its limit.
//!
//! From Eq. 15, with constant posture and load fractions: if the load moves rigidly with the hands by a horizontal δ,
//! the ground reaction follows (C_wt moves by δ ΔF/(W + ΔF)), and the arm of joint j, `(−Δτ_y, Δτ_x)`, grows by `(Σ η_h
//! − Σ ζ_k) ΔF δ` (`leverage`). So |Δτ_j| decreases fastest along that arm, by the leverage times |ΔF| per metre:
//! joints of arms and trunk are relieved with the load above them, joints of legs with the ground reaction below them.
//! ΔF is vertical, so vertical movements of the load change no torque: the direction is horizontal.

use crate::body::Joint;
use crate::math;

/// Advice for one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Advice {
    /// Unit vector, world; zero if no motion of the load helps, or if the overload is within 1-σ of zero.
    pub direction: [f64; 3],
    /// Decrease of the joint's |Δτ|, N m per centimetre.
    pub gain_nm_per_cm: f64,
}

impl Advice {
    /// No advice.
    pub const NONE: Advice = Advice { direction: [0.0; 3], gain_nm_per_cm: 0.0 };

    /// The advice for a joint with this overload and its 1-σ, N m; `leverage` is the joint's, `delta_f_n` the load's
    /// ΔF.
    pub fn of(leverage: f64, delta_f_n: f64, torque_nm: [f64; 3], sigma_nm: f64) -> Advice {
        let arm_nm = [-torque_nm[1], torque_nm[0]];
        let magnitude_nm = math::hypot(arm_nm);
        let gain_n = leverage * delta_f_n;
        if magnitude_nm <= sigma_nm || gain_n == 0.0 {
            return Advice::NONE;
        }
        let back = -gain_n.signum() / magnitude_nm;
        Advice { direction: [back * arm_nm[0], back * arm_nm[1], 0.0], gain_nm_per_cm: 0.01 * gain_n.abs() }
    }
}

/// The joint whose overload is the largest fraction of its limit.
pub fn worst_joint(magnitude_nm: &[f64], limit_nm: &[f64]) -> Option<Joint> {
    let limit_ratio = |joint: &Joint| magnitude_nm[joint.index()] / limit_nm[joint.index()];
    Joint::ALL.into_iter().max_by(|a, b| limit_ratio(a).total_cmp(&limit_ratio(b)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{JOINTS, SEGMENTS, Side, Skeleton};
    use crate::frame::{Pose, StationWorld};
    use crate::overload::{FootDeviation, FootLoads, Loading, LoadingSigma, Swing, leverage, torques};
    use nalgebra::{UnitQuaternion, Vector3};

    const NO_SIGMA: LoadingSigma = LoadingSigma::EXACT;
    const ZETA: [f64; 2] = [0.4, 0.6];
    const ETA: [f64; 2] = [0.3, 0.7];

    fn pose() -> Pose<StationWorld> {
        let origin = Skeleton::nominal(1.77).t_pose_m();
        Pose::new(origin.map(Vector3::from), [UnitQuaternion::identity(); SEGMENTS])
    }

    /// A load in front and to the left, moved with the hands by a vector; the ground reaction follows.
    fn loaded(pose: &Pose<StationWorld>, load_n: f64, moved: Vector3<f64>) -> Loading {
        let (weight_n, body) = (700.0, [0.05, 0.01]);
        let grip_m = Side::BOTH.map(|side| pose.origin_of(side.hand()) + Vector3::new(0.3, 0.1, 0.2) + moved);
        let load = grip_m[0] * ETA[0] + grip_m[1] * ETA[1];
        let vertical_n = weight_n + load_n;
        Loading {
            cop_measured_m: [0, 1].map(|axis| (body[axis] * weight_n + load[axis] * load_n) / vertical_n),
            cop_estimated_m: body,
            vertical_n,
            delta_f_n: load_n,
            grip_m,
            eta: ETA,
            feet: FootLoads::Common { zeta: ZETA },
            deviation: FootDeviation::NONE,
            swing: Swing::NONE,
        }
    }

    fn magnitudes(pose: &Pose<StationWorld>, loading: &Loading) -> [f64; JOINTS] {
        torques(pose, loading, &NO_SIGMA).map(|torque| torque.torque_nm.norm())
    }

    #[test]
    fn the_advice_is_the_steepest_way_down_of_eq_15() {
        let pose = pose();
        let step_m = 1e-6;
        for load_n in [80.0, -60.0] {
            let base = loaded(&pose, load_n, Vector3::zeros());
            let before = magnitudes(&pose, &base);
            let base_torque = torques(&pose, &base, &NO_SIGMA);
            let mut advised = 0;
            for joint in Joint::ALL {
                let index = joint.index();
                let leverage = leverage(joint, ZETA, ETA);
                let advice = Advice::of(leverage, load_n, base_torque[index].torque_nm.into(), 0.0);
                let slope = |along: Vector3<f64>| {
                    let moved = magnitudes(&pose, &loaded(&pose, load_n, along * step_m));
                    (moved[index] - before[index]) / step_m
                };
                let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()].map(slope);
                assert!(z.abs() < 1e-6, "{}: height matters not", joint.name());
                let steepest = (x * x + y * y).sqrt();
                assert!((0.01 * steepest - advice.gain_nm_per_cm).abs() < 1e-5, "{}", joint.name());
                if advice != Advice::NONE {
                    advised += 1;
                    let along = slope(Vector3::from(advice.direction));
                    assert!((along + steepest).abs() < 1e-3, "{}: {along} {steepest}", joint.name());
                }
            }
            // Neck and balls of the feet carry no overload; all others do.
            assert_eq!(advised, JOINTS - 4);
        }
    }

    #[test]
    fn an_overload_within_its_sigma_gets_no_advice() {
        assert_eq!(Advice::of(1.0, 80.0, [3.0, 4.0, 0.0], 5.0), Advice::NONE);
        assert_ne!(Advice::of(1.0, 80.0, [3.0, 4.0, 0.0], 4.9), Advice::NONE);
    }

    #[test]
    fn the_worst_joint_is_the_one_closest_to_its_limit() {
        let (mut torque, mut limit) = ([10.0; JOINTS], [100.0; JOINTS]);
        (torque[4], torque[7]) = (90.0, 50.0);
        limit[7] = 51.0;
        assert_eq!(worst_joint(&torque, &limit).map(Joint::index), Some(7));
    }
}
