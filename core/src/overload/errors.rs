//! Sources of error of the overload torques: the inputs, each changed by its 1-σ.

use nalgebra::{Rotation3, Vector3};

use super::Loading;
use super::feet::FootLoads;
use super::load_position::GRIP_SIGMA_M;
use crate::GRAVITY_M_PER_S2;
use crate::body::{SEGMENTS, Side};
use crate::frame::{Pose, StationWorld};
use crate::math;

/// 1-σ of the points of action under the feet ([`LoadingSigma::press_m`]), m: measured on people who lift objects on two
/// plates.
const PRESS_SIGMA_M: [f64; 2] = [0.020, 0.007];
/// 1-σ of the division of the ground reaction without the load ([`LoadingSigma::unloaded_press_m`], m, and ζ) at a load
/// of [`UNLOADED_AT_N`], in proportion to it: assumed. ζ as by the sideways error of the pressure points.
const UNLOADED_PRESS_SIGMA_M: [f64; 2] = [0.005, 0.002];
const UNLOADED_ZETA_SIGMA: f64 = 0.02;
/// Weight of the box of the recordings, 11.3 kg, N.
const UNLOADED_AT_N: f64 = 11.3 * GRAVITY_M_PER_S2;
/// 1-σ of the division of the horizontal forces ([`LoadingSigma::shear`]): assumed.
const SHEAR_SIGMA: f64 = 0.1;

/// 1-σ of the inputs of the overload.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadingSigma {
    /// σ of the measured CoP per axis, m.
    pub cop_measured_m: f64,
    /// σ of the estimated CoP per axis, m.
    pub cop_estimated_m: [f64; 2],
    /// Error of the body's position on the plate per metre of error of the estimated CoP, per axis: both contain the
    /// stance offset.
    pub position_by_estimate: [f64; 2],
    /// σ of the rest of the body's position on the plate, per axis, m.
    pub position_m: [f64; 2],
    /// σ of the difference between vertical ground reaction and body weight, N.
    pub delta_f_n: f64,
    /// σ of the load's fraction in one hand, in [0, 0.5].
    pub eta: f64,
    /// σ of the load's distance ahead of the grips: a horizontal vector, m.
    pub load_ahead_m: [f64; 2],
    /// σ of a measured fraction of the ground reaction under one foot, in [0, 0.5].
    pub zeta: f64,
    /// σ of the points of action under the feet, m: forward from the line common to both, while both carry the same force
    /// (`FootDeviation::apart_m`), and sideways of each foot, in its axes. Used only if they are not measured.
    pub press_m: [f64; 2],
    /// σ of how the feet divide the ground reaction without the load, besides the rule of [`super::feet`]: the points of
    /// action, forward and sideways, opposite under both feet (`FootDeviation::unloaded_apart_m`), m, and ζ.
    pub unloaded_press_m: [f64; 2],
    /// See [`LoadingSigma::unloaded_press_m`]; in [0, 0.5].
    pub unloaded_zeta: f64,
    /// σ of the division of the horizontal forces between the feet (`FootDeviation::shear`), in [0, 0.5].
    pub shear: f64,
    /// σ per axis of the load's position if that by the two CoPs contradicts that in the hands, m; an error of either.
    pub contradiction_m: f64,
    /// σ of each segment's orientation per axis, rad.
    pub orientation_rad: f64,
    /// σ of the body's heading on the plate, rad; an error rotates the body about the middle between the feet.
    pub heading_rad: f64,
    /// σ of the point of action on each hand along the hand's axes, m: across, along, normal to the palm.
    pub grip_m: [f64; 3],
    /// Error of the segments' origins, common to all, m: the difference between the suit's positions and the positions
    /// by its orientations along constant bones.
    pub origin_m: [Vector3<f64>; SEGMENTS],
}

impl LoadingSigma {
    /// No errors.
    pub const EXACT: LoadingSigma = LoadingSigma {
        cop_measured_m: 0.0,
        cop_estimated_m: [0.0; 2],
        position_by_estimate: [0.0; 2],
        position_m: [0.0; 2],
        delta_f_n: 0.0,
        eta: 0.0,
        load_ahead_m: [0.0; 2],
        zeta: 0.0,
        press_m: [0.0; 2],
        unloaded_press_m: [0.0; 2],
        unloaded_zeta: 0.0,
        shear: 0.0,
        contradiction_m: 0.0,
        orientation_rad: 0.0,
        heading_rad: 0.0,
        grip_m: [0.0; 3],
        origin_m: [Vector3::new(0.0, 0.0, 0.0); SEGMENTS],
    };

    /// The contacts of hands and feet with a load of this weight, N; no other errors.
    pub fn of_contacts(delta_f_n: f64) -> LoadingSigma {
        let by_load = delta_f_n / UNLOADED_AT_N;
        LoadingSigma {
            press_m: PRESS_SIGMA_M,
            unloaded_press_m: UNLOADED_PRESS_SIGMA_M.map(|sigma_m| by_load * sigma_m),
            unloaded_zeta: by_load * UNLOADED_ZETA_SIGMA,
            shear: SHEAR_SIGMA,
            grip_m: GRIP_SIGMA_M,
            ..LoadingSigma::EXACT
        }
    }

    /// One loading per source of error, changed by 1-σ of that source.
    pub(super) fn errors(&self, pose: &Pose<StationWorld>, loading: &Loading) -> [Loading; SOURCES] {
        let mut off = [*loading; SOURCES];
        for axis in 0..2 {
            let mut along = [0.0; 2];
            along[axis] = 1.0;
            let by = |metres: f64| along.map(|part| part * metres);
            let estimated_m = self.cop_estimated_m[axis];
            off[axis] = loading.displaced(by(self.position_by_estimate[axis] * estimated_m));
            off[axis].cop_estimated_m[axis] += estimated_m;
            off[2 + axis] = loading.displaced(by(self.position_m[axis]));
            displace_cop(&mut off[4 + axis], axis, self.cop_measured_m);
        }
        self.change_feet(pose, &mut off);
        off[10].eta = [loading.eta[0] - self.eta, loading.eta[1] + self.eta];
        let [x, y] = self.load_ahead_m;
        off[11].grip_m = loading.grip_m.map(|grip_m| grip_m + Vector3::new(x, y, 0.0));
        off[12].delta_f_n += self.delta_f_n;
        let load_ratio = loading.delta_f_n / loading.vertical_n;
        for axis in 0..2 {
            off[13 + axis].grip_m.iter_mut().for_each(|grip_m| grip_m[axis] += self.contradiction_m);
            displace_cop(&mut off[15 + axis], axis, self.contradiction_m * load_ratio);
        }
        off
    }

    /// The sources of error under the feet.
    fn change_feet(&self, pose: &Pose<StationWorld>, off: &mut [Loading; SOURCES]) {
        let forward = Side::BOTH.map(|side| {
            let ahead = pose.world_from_segment[side.foot().index()] * Vector3::x();
            level([ahead.x, ahead.y])
        });
        let ahead = level([0, 1].map(|axis| forward[0][axis] + forward[1][axis]));
        if let FootLoads::Geometry { .. } | FootLoads::Fractions { .. } = off[6].feet {
            off[6].deviation.apart_m = ahead.map(|part| part * self.press_m[0]);
        }
        for (foot, [x, y]) in forward.into_iter().enumerate() {
            let off = &mut off[7 + foot].feet;
            if let FootLoads::Geometry { press_m, .. } | FootLoads::Fractions { press_m, .. } = off {
                press_m[foot][0] -= y * self.press_m[1];
                press_m[foot][1] += x * self.press_m[1];
            }
        }
        if let FootLoads::Fractions { zeta, .. } | FootLoads::Measured { zeta, .. } = &mut off[9].feet {
            *zeta = [zeta[0] - self.zeta, zeta[1] + self.zeta];
        }
        off[17].deviation.unloaded_zeta = self.unloaded_zeta;
        off[18].deviation.unloaded_apart_m = ahead.map(|part| part * self.unloaded_press_m[0]);
        off[19].deviation.unloaded_apart_m =
            [-ahead[1], ahead[0]].map(|part| part * self.unloaded_press_m[1]);
        off[20].deviation.shear = self.shear;
    }
}

/// Displaces the measured centre of pressure along an axis, and with it those of the feet.
fn displace_cop(loading: &mut Loading, axis: usize, by_m: f64) {
    loading.cop_measured_m[axis] += by_m;
    if let FootLoads::Measured { cop_m, .. } = &mut loading.feet {
        cop_m.iter_mut().for_each(|cop_m| cop_m[axis] += by_m);
    }
}

/// Unit vector in the direction of a horizontal one.
fn level(vector: [f64; 2]) -> [f64; 2] {
    let length = math::hypot(vector).max(1e-9);
    vector.map(|part| part / length)
}

impl LoadingSigma {
    /// Pose and loading with the segments' origins changed by their 1-σ, and with the body turned to either side by √3
    /// σ of its heading; each with its weight. The three-point Gauss-Hermite rule covers headings uncertain by tens of
    /// degrees.
    pub(super) fn pose_errors(
        &self,
        pose: &Pose<StationWorld>,
        loading: &Loading,
    ) -> [(Pose<StationWorld>, Loading, f64); 3] {
        let [left, right] = Side::BOTH.map(|side| pose.origin_of(side.foot()));
        let between = 0.5 * (left + right);
        let turned = |by_rad: f64| {
            let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), by_rad);
            let about = |point: Vector3<f64>| between + turn * (point - between);
            let pose = Pose::new(pose.origin.map(about), pose.world_from_segment);
            (pose, Loading { grip_m: loading.grip_m.map(about), ..*loading }, 1.0 / 6.0)
        };
        let origin = core::array::from_fn(|index| pose.origin[index] + self.origin_m[index]);
        let grip_m =
            Side::BOTH.map(|side| loading.grip_m[side as usize] + self.origin_m[side.hand().index()]);
        let moved = (Pose::new(origin, pose.world_from_segment), Loading { grip_m, ..*loading }, 1.0);
        let by_rad = math::sqrt(3.0) * self.heading_rad;
        [moved, turned(by_rad), turned(-by_rad)]
    }
}

/// Sources of error: estimated CoP (x, y), body's position (x, y), measured CoP (x, y), points of action under the feet
/// (forward of both, sideways of the left one and of the right one), ζ, η, load ahead of the grips, force, contradictory
/// position of the load (x, y) as an error of the grips and of the measured CoP; without the load ζ and the points of
/// action (forward, sideways); division of the horizontal forces.
pub(super) const SOURCES: usize = 21;
