//! Torque that an external load adds at every joint, in addition to the static torque (Fortini et al., §IV, Eq. 12–15).
//!
//! The joint between a segment and its parent transmits the moment of every force that acts distal of it, so Eq. 15
//! needs no Jacobian: for joint j with origin o_j,
//! `Δτ_j = Σ_hands η_h (a_h − o_j) × ΔF − Σ_feet [f_k (c_k − o_j) − f'_k (c'_k − o_j)] × ẑ`,
//! summed over the hands and feet distal of j; f_k and c_k are the ground's force on a foot and its point of action
//! with the load, f'_k and c'_k without it ([`feet`]). With both feet's forces at the common CoPs
//! ([`FootLoads::Common`]) this is Eq. 15 as published. Beyond the paper, an accelerated load exerts horizontal forces
//! ([`Loading::swing`]).
//!
//! **Covariance**: each source of error changes one input by its 1-σ; the resulting differences of the torques are the
//! columns of a factor of their covariance. First order, with independent sources, except: the heading by a three-point
//! rule ([`LoadingSigma::heading_rad`]), and errors of a hand's position with the largest η that its σ allows.

mod errors;
pub mod feet;
pub mod level;
pub mod limits;
pub mod load_position;
pub mod sharing;

use nalgebra::Vector3;

use crate::body::{JOINTS, Joint, Segment, Side};
use crate::frame::{Pose, StationWorld};
use crate::math;

pub use errors::LoadingSigma;
pub use feet::{FootDeviation, FootLoads, FootReaction};
pub use level::{Level, Levels};
pub use limits::TorqueLimits;
pub use load_position::LoadPosition;

/// Inputs of the overload, except the pose.
#[derive(Debug, Clone, Copy)]
pub struct Loading {
    /// C_wt: the measured CoP, m.
    pub cop_measured_m: [f64; 2],
    /// Ĉ_wo: the CoP of the unloaded body, m.
    pub cop_estimated_m: [f64; 2],
    /// Vertical ground reaction with the load, N.
    pub vertical_n: f64,
    /// ΔF: the part of it that the load causes, N, upwards.
    pub delta_f_n: f64,
    /// Point of action of each hand's fraction of the load, m: left, right.
    pub grip_m: [Vector3<f64>; 2],
    /// η: hand load fractions, left and right.
    pub eta: [f64; 2],
    /// Distribution of the ground reaction between the feet.
    pub feet: FootLoads,
    /// Deviation from that distribution: an error; [`FootDeviation::NONE`] for the estimate.
    pub deviation: FootDeviation,
    /// Horizontal forces of the motion.
    pub swing: Swing,
}

/// Horizontal forces that accelerate load and body; the ground provides them at the walking surface, through each foot,
/// together with the free moment, in proportion to its vertical force ([`FootDeviation::shear`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swing {
    /// The load's mass times the hands' acceleration, N.
    pub force_n: [f64; 2],
    /// The body's own mass times its acceleration, N. It acts without the load too, but is then distributed differently
    /// between the feet.
    pub body_n: [f64; 2],
    /// Height of the walking surface, m.
    pub surface_z_m: f64,
}

impl Swing {
    /// A load at rest, as in Eq. 15.
    pub const NONE: Swing = Swing { force_n: [0.0; 2], body_n: [0.0; 2], surface_z_m: 0.0 };
}

impl Loading {
    /// W: weight of the body alone, N.
    fn weight_n(&self) -> f64 {
        self.vertical_n - self.delta_f_n
    }

    /// Forces on the left and right foot of a pose.
    pub fn foot_reactions(&self, pose: &Pose<StationWorld>) -> [FootReaction; 2] {
        let ankle_m = Side::BOTH.map(|side| {
            let ankle = pose.origin_of(side.foot());
            [ankle.x, ankle.y]
        });
        feet::reactions(self, ankle_m)
    }

    /// The loading relative to a body whose position on the plate is off by `by_m`.
    #[must_use]
    pub fn displaced(mut self, by_m: [f64; 2]) -> Loading {
        for (axis, by_m) in by_m.into_iter().enumerate() {
            self.cop_measured_m[axis] -= by_m;
            self.cop_estimated_m[axis] -= by_m;
        }
        self.feet = self.feet.relative_to(by_m);
        self
    }
}

/// Overload torque of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Torque {
    /// Δτ_j, world axes, N m.
    pub torque_nm: Vector3<f64>,
    /// 1-σ of its magnitude, N m.
    pub sigma_nm: f64,
    /// Covariance of its horizontal components, (N m)²: xx, xy, yy.
    pub covariance_nm2: [f64; 3],
}

/// Which hands and feet (left, right) are distal of a joint.
#[derive(Clone, Copy)]
struct Ends {
    hands: [bool; 2],
    feet: [bool; 2],
}

/// [`Ends`] of every joint, computed at compile time.
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

/// Change of the joint's moment, over ΔF, per metre of horizontal movement of the load, in [−1, 1].
///
/// Moving the load by δ, with constant posture and fractions, moves the measured CoP by δ ΔF/(W + ΔF); in Eq. 15 the
/// hands' term then grows by Σ η_h δ ΔF and the feet's by Σ ζ_k δ ΔF, independently of the joint's position.
pub fn leverage(joint: Joint, zeta: [f64; 2], eta: [f64; 2]) -> f64 {
    let ends = ENDS[joint.index()];
    let sum = |hang: [bool; 2], fraction: [f64; 2]| -> f64 {
        (0..2).filter(|side| hang[*side]).map(|side| fraction[side]).sum()
    };
    sum(ends.hands, eta) - sum(ends.feet, zeta)
}

/// Horizontal covariance (xx, xy, yy) of the point of action on a hand, from its 1-σ along the hand's axes, m².
pub fn grip_covariance_m2(pose: &Pose<StationWorld>, side: Side, sigma_m: [f64; 3]) -> [f64; 3] {
    let turn = pose.world_from_segment[side.hand().index()];
    let mut covariance_m2 = [0.0; 3];
    for (axis, sigma_m) in [Vector3::x(), Vector3::y(), Vector3::z()].into_iter().zip(sigma_m) {
        let error_m = turn * axis * sigma_m;
        let products = [error_m.x * error_m.x, error_m.x * error_m.y, error_m.y * error_m.y];
        covariance_m2.iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
    }
    covariance_m2
}

/// 1-σ of the foot load fraction ζ with the load, from all sources of error.
pub fn zeta_sigma(pose: &Pose<StationWorld>, loading: &Loading, sigma: &LoadingSigma) -> f64 {
    let right = |pose: &Pose<StationWorld>, loading: &Loading| {
        let [left_n, right_n] = loading.foot_reactions(pose).map(|foot| foot.with_n);
        right_n / (left_n + right_n).max(1e-9)
    };
    let base = right(pose, loading);
    let pose_errors = sigma.pose_errors(pose, loading);
    let pose_errors = pose_errors.iter().map(|(pose, loading, weight)| (right(pose, loading), *weight));
    let errors = sigma.errors(pose, loading);
    let changed = errors.iter().map(|off| (right(pose, off), 1.0)).chain(pose_errors);
    math::sqrt(changed.map(|(changed, weight)| weight * (changed - base) * (changed - base)).sum())
}

/// Loading with the resulting reactions of both feet.
struct Acting<'a> {
    loading: &'a Loading,
    feet: [FootReaction; 2],
    /// Fractions of the horizontal forces with and without the load, per foot.
    fractions: [[f64; 2]; 2],
}

impl<'a> Acting<'a> {
    fn new(pose: &Pose<StationWorld>, loading: &'a Loading) -> Acting<'a> {
        let feet = loading.foot_reactions(pose);
        let per_n = [loading.vertical_n, loading.weight_n()].map(f64::recip);
        let [left, right] = feet.each_ref().map(|foot| [foot.with_n * per_n[0], foot.without_n * per_n[1]]);
        let divided = [0, 1]
            .map(|case: usize| FootDeviation::divided(loading.deviation.shear, [left[case], right[case]]));
        let fractions = [0, 1].map(|foot: usize| [divided[0][foot], divided[1][foot]]);
        Acting { loading, feet, fractions }
    }

    /// Δτ of a joint, N m.
    fn torque_nm(&self, ends: &Ends, origin: Vector3<f64>) -> Vector3<f64> {
        let [x, y] = self.horizontal_nm(ends, origin);
        Vector3::new(x, y, self.vertical_nm(ends, origin))
    }

    /// Horizontal components of a joint's Δτ, N m.
    fn horizontal_nm(&self, ends: &Ends, origin: Vector3<f64>) -> [f64; 2] {
        let Loading { swing, grip_m, eta, .. } = self.loading;
        let [arm_x, arm_y] = self.arm_nm(ends, origin);
        // Horizontal forces times their heights above the joint: of the load at the hands, and of the ground.
        let [mut force_x, mut force_y] = [0.0; 2];
        let mut add = |[x, y]: [f64; 2], height_m: f64| {
            force_x += x * height_m;
            force_y += y * height_m;
        };
        for hand in (0..2).filter(|hand| ends.hands[*hand]) {
            add(swing.force_n, eta[hand] * (grip_m[hand].z - origin.z));
        }
        for foot in (0..2).filter(|foot| ends.feet[*foot]) {
            let [with, without] = self.fractions[foot];
            let height_m = swing.surface_z_m - origin.z;
            add(swing.force_n, -with * height_m);
            add(swing.body_n, (without - with) * height_m);
        }
        // r × (f_x, f_y, f_z) = (r_y f_z − r_z f_y, r_z f_x − r_x f_z, …).
        [arm_y - force_y, force_x - arm_x]
    }

    /// Horizontal arms of all vertical forces distal of a joint, times these forces, N m: x and y.
    fn arm_nm(&self, ends: &Ends, origin: Vector3<f64>) -> [f64; 2] {
        [0, 1].map(|axis| {
            let hands: f64 = (0..2)
                .filter(|hand| ends.hands[*hand])
                .map(|hand| self.loading.eta[hand] * (self.loading.grip_m[hand][axis] - origin[axis]))
                .sum();
            let feet: f64 = (0..2)
                .filter(|foot| ends.feet[*foot])
                .map(|foot| self.feet[foot].added_nm(axis, origin[axis]))
                .sum();
            hands * self.loading.delta_f_n - feet
        })
    }

    /// Vertical component of a joint's Δτ, N m: of the load's horizontal force at the hands, and of the difference of
    /// the ground's with and without the load.
    fn vertical_nm(&self, ends: &Ends, origin: Vector3<f64>) -> f64 {
        let Loading { swing, grip_m, eta, cop_measured_m, cop_estimated_m, .. } = self.loading;
        let about = |[x, y]: [f64; 2], [force_x, force_y]: [f64; 2]| x * force_y - y * force_x;
        let from = |[x, y]: [f64; 2]| [x - origin.x, y - origin.y];
        let (load_n, body_n) = (swing.force_n, swing.body_n);
        let with_load_n = [load_n[0] + body_n[0], load_n[1] + body_n[1]];
        let load_m = grip_m[0] * eta[0] + grip_m[1] * eta[1];
        // The ground also provides the load's moment about the vertical: the part not due to its forces is a free
        // moment.
        let free_nm = about([load_m.x, load_m.y], load_n) - about(*cop_measured_m, with_load_n)
            + about(*cop_estimated_m, body_n);
        let hands = (0..2).filter(|hand| ends.hands[*hand]);
        let at_hands_nm: f64 =
            hands.map(|hand| about(from([grip_m[hand].x, grip_m[hand].y]), load_n) * eta[hand]).sum();
        let at_feet_nm: f64 = (0..2)
            .filter(|foot| ends.feet[*foot])
            .map(|foot| {
                let ([with, without], reaction) = (self.fractions[foot], &self.feet[foot]);
                with * (about(from(reaction.with_m), with_load_n) + free_nm)
                    - without * about(from(reaction.without_m), body_n)
            })
            .sum();
        at_hands_nm - at_feet_nm
    }
}

/// The overload torques of all joints without their σ, world axes, N m.
pub fn torque_vectors(pose: &Pose<StationWorld>, loading: &Loading) -> [Vector3<f64>; JOINTS] {
    let acting = Acting::new(pose, loading);
    Joint::ALL.map(|joint| acting.torque_nm(&ENDS[joint.index()], pose.origin_of(joint.segment())))
}

/// The overload torques of all joints.
///
/// The ball-of-foot joints carry none: the ground's force is assumed to act on the foot, proximal of them.
pub fn torques(pose: &Pose<StationWorld>, loading: &Loading, sigma: &LoadingSigma) -> [Torque; JOINTS] {
    let errors = sigma.errors(pose, loading);
    let (base, errors) = (Acting::new(pose, loading), errors.each_ref().map(|off| Acting::new(pose, off)));
    let pose_errors = sigma.pose_errors(pose, loading);
    let pose_errors =
        pose_errors.each_ref().map(|(pose, off, weight)| (pose, Acting::new(pose, off), *weight));
    Joint::ALL.map(|joint| {
        let (ends, origin) = (&ENDS[joint.index()], pose.origin_of(joint.segment()));
        let torque_nm = base.torque_nm(ends, origin);
        let [arm_xx, arm_xy, arm_yy] = base.place_covariance_nm2(pose, joint, sigma);
        let mut covariance_nm2 = [arm_yy, -arm_xy, arm_xx];
        let mut add = |off_nm: [f64; 2], weight: f64| {
            let [x, y] = [off_nm[0] - torque_nm.x, off_nm[1] - torque_nm.y];
            let products = [x * x, x * y, y * y];
            covariance_nm2.iter_mut().zip(products).for_each(|(sum, product)| *sum += weight * product);
        };
        errors.iter().for_each(|off| add(off.horizontal_nm(ends, origin), 1.0));
        for (pose, off, weight) in &pose_errors {
            add(off.horizontal_nm(ends, pose.origin_of(joint.segment())), *weight);
        }
        let sigma_nm = sigma_of_length([torque_nm.x, torque_nm.y], covariance_nm2);
        Torque { torque_nm, sigma_nm, covariance_nm2 }
    })
}

impl Acting<'_> {
    /// Covariance (xx, xy, yy) of the arms of a joint's torque due to the position of the hands or the foot relative to
    /// the joint, (N m)².
    ///
    /// The error φ of a segment's orientation moves the end of the segment d by `φ × d`: perpendicular to it, with the
    /// covariance `σ² (|d|² I − d dᵀ)`.
    fn place_covariance_nm2(
        &self,
        pose: &Pose<StationWorld>,
        joint: Joint,
        sigma: &LoadingSigma,
    ) -> [f64; 3] {
        let ends = &ENDS[joint.index()];
        let chain_m2 = |end: Segment| {
            let (mut segment, mut sum_m2) = (end, [0.0; 3]);
            while segment != joint.segment() {
                let Some(parent) = segment.parent() else { break };
                let along = pose.origin_of(segment) - pose.origin_of(parent);
                let [x, y, square] = [along.x, along.y, along.norm_squared()];
                for (sum, part) in sum_m2.iter_mut().zip([square - x * x, -x * y, square - y * y]) {
                    *sum += part * sigma.orientation_rad * sigma.orientation_rad;
                }
                segment = parent;
            }
            sum_m2
        };
        let mut covariance = [0.0; 3];
        let mut add = |force_n: f64, covariance_m2: [f64; 3]| {
            for (sum, part) in covariance.iter_mut().zip(covariance_m2) {
                *sum += force_n * force_n * part;
            }
        };
        for (index, side) in Side::BOTH.into_iter().enumerate() {
            if ends.hands[index] {
                let [xx, xy, yy] = chain_m2(side.hand());
                let grip_m2 = grip_covariance_m2(pose, side, sigma.grip_m);
                let of_hand_m2 = [xx + grip_m2[0], xy + grip_m2[1], yy + grip_m2[2]];
                // The error of the hand's position counts with the largest η of a uniform distribution: a hand that
                // seems empty may hold the load.
                let eta_range = math::sqrt(3.0) * sigma.eta;
                let eta_max = (self.loading.eta[index] + eta_range).min(1.0);
                add(eta_max * self.loading.delta_f_n, of_hand_m2);
                if ends.hands != [true; 2] {
                    let ([x, y], off_m) = (sigma.load_ahead_m, sigma.contradiction_m);
                    let of_load_m2 = [x * x + off_m * off_m, x * y, y * y + off_m * off_m];
                    add(eta_range * self.loading.delta_f_n, of_load_m2);
                    // A heading's error turns the arm of that load too.
                    let arm = self.loading.grip_m[index] - pose.origin_of(joint.segment());
                    let [x, y] = [-arm.y, arm.x].map(|across_m| across_m * sigma.heading_rad);
                    add(eta_range * self.loading.delta_f_n, [x * x, x * y, y * y]);
                }
            }
            if ends.feet[index] {
                let foot = &self.feet[index];
                add(foot.with_n - foot.without_n, chain_m2(side.foot()));
            }
        }
        covariance
    }
}

/// σ of the length of a horizontal vector v with this covariance (xx, xy, yy).
///
/// Along v an error changes the length directly. Across v, with variance s², an error e changes it to √(v² + e²): by
/// the three-point Gauss-Hermite rule the mean square of the change is `(√(v² + 3 s²) − v)²/3`. That is s² for small v,
/// and 3 s⁴/(4 v²) for large v.
pub fn sigma_of_length([x, y]: [f64; 2], [xx, xy, yy]: [f64; 3]) -> f64 {
    let square = x * x + y * y;
    let along = if square > 1e-12 { (x * x * xx + 2.0 * x * y * xy + y * y * yy) / square } else { xx };
    let across = (xx + yy - along).max(0.0);
    let bent = math::sqrt(square + 3.0 * across) - math::sqrt(square);
    math::sqrt(along.max(0.0) + bent * bent / 3.0)
}

#[cfg(test)]
mod tests;
