//! What an external load adds to the static torque of every joint (Fortini et al., §IV, Eq. 12–15).
//!
//! The joint between a segment and its parent carries the moment of every force that acts distal of it, so Eq. 15
//! needs no Jacobian: for joint j with origin o_j,
//! `Δτ_j = Σ_hands η_h (a_h − o_j) × ΔF − Σ_feet [ζ_k (Ĉ_wo − o_j) × ΔF + (C_wt − Ĉ_wo) × ζ_k f_wt]`,
//! summed over the hands and feet distal of j. ΔF and f_wt are vertical, as in the paper. Beyond the paper, each only
//! where it is known: feet that are measured each by itself have centres of pressure of their own in place of the
//! common ones, the feet may share the body's weight otherwise than weight and load (`overload/feet.rs`), and a load
//! that is swung pushes horizontally ([`Loading::swing`]).

mod feet;
pub mod level;
pub mod limits;
pub mod sharing;

use nalgebra::Vector3;

use crate::body::{JOINTS, Joint, Side};
use crate::frame::{Pose, StationWorld};
use crate::math;

pub use level::{Level, Levels};
pub use limits::TorqueLimits;
pub use sharing::Sharing;

/// Standard gravity is 9.80665 m/s²; golden values and the paper use two decimals.
pub const GRAVITY_M_PER_S2: f64 = 9.81;

/// Everything that Eq. 15 depends on beside the pose.
#[derive(Debug, Clone, Copy)]
pub struct Loading {
    /// C_wt: the measured centre of pressure, m.
    pub cop_measured_m: [f64; 2],
    /// Ĉ_wo: the centre of pressure that the unloaded body would have, m.
    pub cop_estimated_m: [f64; 2],
    /// Vertical ground reaction with the load, N.
    pub vertical_n: f64,
    /// ΔF: what of it the load causes, N, upwards.
    pub delta_f_n: f64,
    /// Where the hands grip, m: left, right.
    pub grip_m: [Vector3<f64>; 2],
    /// How ground reaction and load are shared between the sides.
    pub sharing: Sharing,
    /// What comes of the load being swung.
    pub swing: Swing,
}

/// Horizontal forces of a load that the hands accelerate; the ground answers them at the walking surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swing {
    /// The load's mass times the hands' acceleration, N.
    pub force_n: [f64; 2],
    /// Height of the walking surface, m.
    pub surface_z_m: f64,
}

impl Swing {
    /// The load is held still, as in Eq. 15.
    pub const NONE: Swing = Swing { force_n: [0.0; 2], surface_z_m: 0.0 };
}

impl Loading {
    /// W: what the body alone weighs, N.
    fn weight_n(&self) -> f64 {
        self.vertical_n - self.delta_f_n
    }
}

/// 1-σ of what was measured, for the σ of the torques.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadingSigma {
    /// Of the measured centre of pressure per axis, m.
    pub cop_measured_m: f64,
    /// Of the estimated centre of pressure per axis, m.
    pub cop_estimated_m: [f64; 2],
    /// Of the vertical ground reaction and of the body weight together, N.
    pub delta_f_n: f64,
    /// Of the load's share in one hand, in [0, 0.5].
    pub eta: f64,
    /// Of the ground reaction's share under one foot, in [0, 0.5].
    pub zeta: f64,
    /// Of where each foot would press without the load, beside what the rule for it says, per axis, m.
    pub foot_without_load_m: f64,
    /// Of where the load is in the hands, as seen from the joints, per axis, m.
    pub grip_m: f64,
    /// Of where the joints are, as seen from the floor, per axis, m.
    pub joint_m: f64,
}

impl LoadingSigma {
    /// Everything is exact.
    pub const EXACT: LoadingSigma = LoadingSigma {
        cop_measured_m: 0.0,
        cop_estimated_m: [0.0; 2],
        delta_f_n: 0.0,
        eta: 0.0,
        zeta: 0.0,
        foot_without_load_m: 0.0,
        grip_m: 0.0,
        joint_m: 0.0,
    };
}

/// One joint's overload.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Torque {
    /// Δτ_j, world axes, N m.
    pub torque_nm: Vector3<f64>,
    /// 1-σ of its magnitude, N m.
    pub sigma_nm: f64,
}

/// Which hands and feet (left, right) hang on a joint.
#[derive(Clone, Copy)]
struct Ends {
    hands: [bool; 2],
    feet: [bool; 2],
}

/// [`Ends`] of every joint, found once by the compiler: a pose walks no chain.
const ENDS: [Ends; JOINTS] = {
    let mut ends = [Ends { hands: [false; 2], feet: [false; 2] }; JOINTS];
    let mut joint = 0;
    while joint < JOINTS {
        let root = Joint::ALL[joint].segment();
        let mut index = 0;
        while index < 2 {
            ends[joint].hands[index] = Side::BOTH[index].hand().is_distal_to(root);
            ends[joint].feet[index] = Side::BOTH[index].foot().is_distal_to(root);
            index += 1;
        }
        joint += 1;
    }
    ends
};

/// Which shares act distal of a joint.
#[derive(Clone, Copy)]
struct Distal {
    hands: [f64; 2],
    /// −1 for the left, 1 for the right hand if it hangs there: how a larger share of the right hand shows.
    hand_slope: [f64; 2],
    feet: [bool; 2],
}

impl Distal {
    fn of(joint: Joint, sharing: &Sharing) -> Distal {
        let ends = ENDS[joint.index()];
        let mut distal = Distal { hands: [0.0; 2], hand_slope: [0.0; 2], feet: ends.feet };
        for (index, side) in Side::BOTH.into_iter().enumerate() {
            if ends.hands[index] {
                distal.hands[index] = sharing.eta[index];
                distal.hand_slope[index] = if side == Side::Right { 1.0 } else { -1.0 };
            }
        }
        distal
    }
}

/// How much of ΔF acts at a joint per metre that the load moves sideways, in [−1, 1].
///
/// Moving the load by δ, posture and shares as they are, moves the measured centre of pressure by δ ΔF/(W + ΔF); in
/// Eq. 15 the hands' term then grows by Σ η_h δ ΔF and the feet's by Σ ζ_k δ ΔF, whatever the joint's place.
pub fn leverage(joint: Joint, zeta: [f64; 2], eta: [f64; 2]) -> f64 {
    let ends = ENDS[joint.index()];
    let share = |hang: [bool; 2], share: [f64; 2]| -> f64 {
        (0..2).filter(|side| hang[*side]).map(|side| share[side]).sum()
    };
    share(ends.hands, eta) - share(ends.feet, zeta)
}

/// Eq. 15 for all joints.
///
/// The ball-of-foot joints carry nothing: the ground's force is taken to act on the foot, proximal of them.
pub fn torques(pose: &Pose<StationWorld>, loading: &Loading, sigma: &LoadingSigma) -> [Torque; JOINTS] {
    let feet = feet::reactions(loading);
    Joint::ALL.map(|joint| {
        let distal = Distal::of(joint, &loading.sharing);
        let standing =
            || feet.iter().zip(distal.feet).filter_map(|(foot, is_distal)| is_distal.then_some(foot));
        let origin = pose.origin_of(joint.segment());
        let mut by_axis = [0.0; 2];
        // What each source of doubt adds, by axis: one column each of the sources below.
        let mut doubt = [[0.0; SOURCES]; 2];
        for axis in 0..2 {
            // Horizontal arms of the load and of the ground reaction, weighted by their shares.
            let (mut load_arm, mut load_arm_slope) = (0.0, 0.0);
            for (hand, grip) in loading.grip_m.iter().enumerate() {
                load_arm += distal.hands[hand] * (grip[axis] - origin[axis]);
                load_arm_slope += distal.hand_slope[hand] * (grip[axis] - origin[axis]);
            }
            by_axis[axis] = load_arm * loading.delta_f_n;
            let (mut force_arm, mut by_measurement, mut by_foot) = (load_arm, 0.0, 0.0);
            let mut by_estimate = [0.0; 2];
            for foot in standing() {
                by_axis[axis] -= foot.added(axis, origin[axis], loading.vertical_n);
                force_arm -= foot.share * (foot.with_m[axis] - origin[axis]);
                let plate_nm = foot.share * loading.vertical_n * sigma.cop_measured_m;
                let habit_nm = foot.without_n * sigma.foot_without_load_m;
                by_measurement += math::hypot([plate_nm, habit_nm]);
                // No joint has both feet distal of it, so the sign of the share does not matter.
                by_foot += foot.by_share(axis, origin[axis], loading) * sigma.zeta;
                for (by, sum) in by_estimate.iter_mut().enumerate() {
                    *sum += foot.by_estimate(axis, origin[axis], by) * sigma.cop_estimated_m[by];
                }
            }
            let by_hand = load_arm_slope * loading.delta_f_n * sigma.eta;
            let carried: f64 = distal.hands.iter().sum();
            let stood: f64 = standing().map(|foot| foot.share).sum();
            let by_place = loading.delta_f_n * (carried * sigma.grip_m + stood * sigma.joint_m);
            let by_measurement = math::hypot([by_measurement, by_place]);
            let by_force = force_arm * sigma.delta_f_n;
            // Noise of plate and feet is another along each axis; all else moves both axes at once.
            let plate = if axis == 0 { [by_measurement, 0.0] } else { [0.0, by_measurement] };
            doubt[axis] = [by_estimate[0], by_estimate[1], plate[0], plate[1], by_foot, by_hand, by_force];
        }
        // r × f ẑ = (r_y f, −r_x f, 0).
        let still_nm = Vector3::new(by_axis[1], -by_axis[0], 0.0);
        let torque_nm = still_nm + swing(origin, &distal, &feet, loading);
        let by_axis = [-torque_nm.y, torque_nm.x];
        Torque { torque_nm, sigma_nm: sigma_of_magnitude(by_axis, &doubt) }
    })
}

/// What swinging the load adds: its horizontal force at the hands, and the ground's answer to it under the feet.
fn swing(
    origin: Vector3<f64>,
    distal: &Distal,
    feet: &[feet::FootReaction; 2],
    loading: &Loading,
) -> Vector3<f64> {
    let force_n = Vector3::new(loading.swing.force_n[0], loading.swing.force_n[1], 0.0);
    let mut arm_m = Vector3::zeros();
    for (share, grip) in distal.hands.iter().zip(&loading.grip_m) {
        arm_m += (grip - origin) * *share;
    }
    for (foot, _) in feet.iter().zip(distal.feet).filter(|(_, is_distal)| *is_distal) {
        let on_floor = Vector3::new(foot.with_m[0], foot.with_m[1], loading.swing.surface_z_m);
        arm_m -= (on_floor - origin) * foot.share;
    }
    arm_m.cross(&force_n)
}

/// Sources of a torque's doubt: estimated centre of pressure (x, y), measured one (x, y), foot, hand, force.
const SOURCES: usize = 7;

/// First-order σ of the length of a horizontal vector; the larger axis where the vector is zero.
pub(crate) fn sigma_of_magnitude<const SOURCES: usize>(vector: [f64; 2], doubt: &[[f64; SOURCES]; 2]) -> f64 {
    let along = |direction: [f64; 2]| {
        let part = |source: usize| direction[0] * doubt[0][source] + direction[1] * doubt[1][source];
        (0..SOURCES).map(|source| part(source) * part(source)).sum::<f64>()
    };
    let square = vector[0] * vector[0] + vector[1] * vector[1];
    let variance =
        if square > 1e-12 { along(vector) / square } else { along([1.0, 0.0]).max(along([0.0, 1.0])) };
    math::sqrt(variance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{SEGMENTS, Segment, Skeleton};
    use nalgebra::UnitQuaternion;

    const NO_SIGMA: LoadingSigma = LoadingSigma::EXACT;

    fn t_pose() -> Pose<StationWorld> {
        let origin = Skeleton::nominal(1.77).t_pose_m();
        Pose::new(
            origin.map(|origin| Vector3::from(origin) + Vector3::new(0.0, 0.0, 0.96)),
            [UnitQuaternion::identity(); SEGMENTS],
        )
    }

    fn loaded(pose: &Pose<StationWorld>, load_n: f64) -> Loading {
        let weight_n = 700.0;
        let body = [0.05, 0.0];
        let grip_m = Side::BOTH.map(|side| pose.origin_of(side.hand()) + Vector3::new(0.3, 0.0, 0.0));
        let load = 0.5 * (grip_m[0] + grip_m[1]);
        let vertical_n = weight_n + load_n;
        let cop = |axis: usize| (body[axis] * weight_n + load[axis] * load_n) / vertical_n;
        let cop_measured_m = [cop(0), cop(1)];
        Loading {
            cop_measured_m,
            cop_estimated_m: body,
            vertical_n,
            delta_f_n: load_n,
            grip_m,
            sharing: Sharing::of([0.5; 2], [0.5; 2]),
            swing: Swing::NONE,
        }
    }

    #[test]
    fn no_load_no_overload() {
        let pose = t_pose();
        for torque in torques(&pose, &loaded(&pose, 0.0), &NO_SIGMA) {
            assert_eq!(torque, Torque { torque_nm: Vector3::zeros(), sigma_nm: 0.0 });
        }
    }

    #[test]
    fn a_wrist_carries_its_share_of_the_load_on_its_arm() {
        let pose = t_pose();
        let torque = torques(&pose, &loaded(&pose, 40.0), &NO_SIGMA);
        let wrist = torque[Joint::named("LeftWrist").unwrap().index()].torque_nm;
        // 20 N at 0.3 m in front of the joint.
        assert!((wrist - Vector3::new(0.0, -6.0, 0.0)).norm() < 1e-12, "{wrist}");
        assert_eq!(torque[Joint::named("C1Head").unwrap().index()].torque_nm, Vector3::zeros());
    }

    #[test]
    fn the_pelvis_is_in_balance() {
        // Seen from the pelvis, the moments of trunk and both legs must cancel about any one point: shift the three
        // joints' torques to the pelvis' origin and add them.
        let pose = t_pose();
        let loading = loaded(&pose, 60.0);
        let torque = torques(&pose, &loading, &NO_SIGMA);
        let at = |name: &str| Joint::named(name).unwrap();
        let arm = |name: &str| pose.origin_of(at(name).segment()) - pose.origin_of(Segment::Pelvis);
        let up = Vector3::new(0.0, 0.0, loading.delta_f_n);
        let spine = torque[at("L5S1").index()].torque_nm + arm("L5S1").cross(&up);
        let legs: Vector3<f64> = ["LeftHip", "RightHip"]
            .map(|name| torque[at(name).index()].torque_nm - arm(name).cross(&(0.5 * up)))
            .iter()
            .sum();
        assert!((spine + legs).norm() < 1e-9, "{spine} {legs}");
    }

    #[test]
    fn an_unsure_share_makes_arms_unsure_and_leaves_legs_alone() {
        let pose = t_pose();
        let loading = loaded(&pose, 60.0);
        let torque = torques(&pose, &loading, &LoadingSigma { eta: 0.1, ..NO_SIGMA });
        let sigma_nm = |name: &str| torque[Joint::named(name).unwrap().index()].sigma_nm;
        // A tenth of 60 N at 0.3 m in front of the wrist.
        assert!((sigma_nm("RightWrist") - 1.8).abs() < 1e-9, "{}", sigma_nm("RightWrist"));
        assert_eq!(sigma_nm("RightHip"), 0.0);
    }

    #[test]
    fn an_unsure_foot_makes_its_leg_unsure_and_leaves_the_rest_alone() {
        let pose = t_pose();
        let loading = loaded(&pose, 60.0);
        let sigma = LoadingSigma { zeta: 0.05, ..NO_SIGMA };
        let sigma_nm =
            |name: &str| torques(&pose, &loading, &sigma)[Joint::named(name).unwrap().index()].sigma_nm;
        assert_eq!((sigma_nm("RightWrist"), sigma_nm("L5S1")), (0.0, 0.0));
        let mut shifted = loading;
        shifted.sharing = Sharing::of([0.45, 0.55], loading.sharing.eta);
        let hip = Joint::named("RightHip").unwrap().index();
        let change = torques(&pose, &shifted, &NO_SIGMA)[hip].torque_nm.norm()
            - torques(&pose, &loading, &NO_SIGMA)[hip].torque_nm.norm();
        assert!((sigma_nm("RightHip") - change.abs()).abs() < 1e-9, "{change}");
    }

    #[test]
    fn sigma_is_the_spread_of_the_magnitude() {
        let pose = t_pose();
        let loading = loaded(&pose, 60.0);
        let sigma = LoadingSigma { cop_measured_m: 0.0, cop_estimated_m: [1e-7, 0.0], ..NO_SIGMA };
        let base = torques(&pose, &loading, &sigma);
        let mut moved = loading;
        moved.cop_estimated_m[0] += 1e-7;
        let shifted = torques(&pose, &moved, &sigma);
        for joint in Joint::ALL {
            let change = shifted[joint.index()].torque_nm.norm() - base[joint.index()].torque_nm.norm();
            assert!((change.abs() - base[joint.index()].sigma_nm).abs() < 1e-9, "{}", joint.name());
        }
    }
}
