//! Insoles measure the pressure under each sole in the sole's own frame; the suit gives the position of that frame.
//!
//! Components that they cannot measure are unavailable and never replaced by zero: shear and the moment about the
//! vertical. If no plate measures the ground's wrench too, the moment about the horizontal axes is computed from the
//! feet's vertical forces and positions.

use super::foot_outline::FootOutline;
use super::settings::{Motion, Settings};
use crate::body::Side;
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::message::{Component, FootFrame, GroundSample};
use crate::motion::ForceOffset;

/// Standard deviations of the ground sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GroundSigma {
    /// 1-σ of the CoP per axis, m.
    pub(super) cop_m: f64,
    /// The part of it that a static pose does not average out, m.
    pub(super) lasting_cop_m: f64,
    /// 1-σ of the difference between vertical force and body weight, N.
    pub(super) force_n: f64,
}

impl GroundSigma {
    /// σ by the kind of the devices: a plate, with its force offset, or insoles alone.
    pub(super) fn of(
        ground: Option<&GroundSample>,
        offset: &ForceOffset,
        settings: &Settings,
    ) -> GroundSigma {
        if ground.is_some_and(GroundSample::is_by_insoles_alone) {
            let cop_m = settings.insole_cop_sigma_m;
            GroundSigma { cop_m, lasting_cop_m: cop_m, force_n: settings.insole_force_sigma_n }
        } else {
            let force_n = match settings.motion {
                Motion::Paper => settings.force_sigma_n,
                Motion::Compensated { .. } => offset.sigma_n(settings.force_sigma_n),
            };
            GroundSigma { cop_m: settings.cop_sigma_m, lasting_cop_m: 0.0, force_n }
        }
    }

    /// Adds the error of a sample whose time is uncertain by `time_sigma_s` while force and CoP change at these rates,
    /// N/s and m/s: to first order σ(t) times the rate.
    pub(super) fn add_time_error(&mut self, time_sigma_s: f64, [force_n_per_s, cop_m_per_s]: [f64; 2]) {
        self.force_n = math::hypot([self.force_n, time_sigma_s * force_n_per_s]);
        self.cop_m = math::hypot([self.cop_m, time_sigma_s * cop_m_per_s]);
    }
}

/// The sample with the feet's CoPs transformed to the world, at the pose of the sample's time. A sample whose feet are
/// in the world already, or that has none, is unchanged.
pub(super) fn to_world(
    ground: &GroundSample,
    pose: &Pose<StationWorld>,
    outlines: &[FootOutline; 2],
) -> GroundSample {
    if ground.foot_frame != FootFrame::Insole as u32 || !ground.has_feet() {
        return *ground;
    }
    let foot_cop_m = Side::BOTH
        .map(|side| outlines[side as usize].on_the_floor_m(pose, side, ground.foot_cop_m[side as usize]));
    let mut placed = GroundSample { foot_cop_m, foot_frame: FootFrame::World as u32, ..*ground };
    if ground.measures(Component::Tilt) {
        return placed;
    }
    let pressing_n = ground.foot_vertical_n.map(|newtons| newtons.max(0.0));
    let sum_n = pressing_n[0] + pressing_n[1];
    let fraction = |foot: usize| if sum_n > 0.0 { pressing_n[foot] / sum_n } else { 0.0 };
    let [x, y] = [0, 1].map(|axis| fraction(0) * foot_cop_m[0][axis] + fraction(1) * foot_cop_m[1][axis]);
    // Moments about the world's origin, the inverse of the equation for the CoP. Unmeasured shear is zero in the
    // message and not used elsewhere: at the surface it does not affect the CoP.
    let ([fx, fy, fz], z) = (ground.force_n, ground.surface_z_m);
    placed.moment_nm[0] = y * fz - z * fy;
    placed.moment_nm[1] = z * fx - x * fz;
    placed.not_measured &= !(Component::Tilt as u32);
    placed
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;
    use crate::body::{SEGMENTS, Segment, Skeleton};
    use crate::cycle::foot_outline;
    use crate::message::GroundDevice;
    use nalgebra::{UnitQuaternion, Vector3};

    const HEIGHT_M: f64 = 1.77;

    #[test]
    fn an_uncertain_time_adds_its_sigma_times_the_rate() {
        let mut sigma = GroundSigma { cop_m: 0.003, lasting_cop_m: 0.0, force_n: 3.0 };
        sigma.add_time_error(0.004, [1000.0, 1.0]);
        assert!((sigma.force_n - 5.0).abs() < 1e-12 && (sigma.cop_m - 0.005).abs() < 1e-12, "{sigma:?}");
    }

    fn standing(turn_rad: f64, at: Vector3<f64>) -> Pose<StationWorld> {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn_rad);
        let origin = Skeleton::nominal(HEIGHT_M).t_pose_m().map(|origin| at + turn * Vector3::from(origin));
        Pose::new(origin, [turn; SEGMENTS])
    }

    fn insoles(vertical_n: [f64; 2], cop_m: [[f64; 2]; 2]) -> GroundSample {
        GroundSample {
            per_foot: 1,
            force_n: [0.0, 0.0, vertical_n[0] + vertical_n[1]],
            foot_vertical_n: vertical_n,
            foot_cop_m: cop_m,
            foot_frame: FootFrame::Insole as u32,
            not_measured: Component::Shear as u32 | Component::Tilt as u32 | Component::FreeMoment as u32,
            devices: GroundDevice::Insoles as u32,
            surface_z_m: 0.1,
            ..Zeroable::zeroed()
        }
    }

    #[test]
    fn the_common_centre_is_the_force_weighted_mean_of_the_feet_in_any_place_and_heading() {
        let measured = insoles([200.0, 500.0], [[0.03, -0.01], [-0.02, 0.005]]);
        assert!(measured.cop_m().is_err(), "the places of the feet are unknown");
        for (turn, x, y) in [(0.0, 0.0, 0.0), (1.2, 0.4, -0.3), (-2.5, -1.0, 2.0)] {
            let pose = standing(turn, Vector3::new(x, y, 0.95));
            let outlines = foot_outline::both(&pose, None, HEIGHT_M);
            let placed = to_world(&measured, &pose, &outlines);
            let feet = placed.feet().unwrap();
            assert_eq!(feet.vertical_n, [200.0, 500.0]);
            let at = feet.cop_m.unwrap();
            let cop = placed.cop_m().unwrap();
            for axis in 0..2 {
                let expected = (200.0 * at[0][axis] + 500.0 * at[1][axis]) / 700.0;
                assert!((cop[axis] - expected).abs() < 1e-12, "{cop:?}");
            }
            // Transformed back to the foot's axes, it equals the insole's measurement.
            for side in Side::BOTH {
                let ankle = pose.origin_of(side.foot());
                let away = Vector3::new(at[side as usize][0] - ankle.x, at[side as usize][1] - ankle.y, 0.0);
                let on_foot = pose.world_from_segment[side.foot().index()].inverse() * away;
                let middle = outlines[side as usize].middle_m();
                for axis in 0..2 {
                    let measured = measured.foot_cop_m[side as usize][axis];
                    assert!((on_foot[axis] - middle[axis] - measured).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn what_insoles_do_not_measure_stays_unavailable() {
        let pose = standing(0.3, Vector3::zeros());
        let placed =
            to_world(&insoles([350.0; 2], [[0.0; 2]; 2]), &pose, &foot_outline::both(&pose, None, HEIGHT_M));
        assert!(placed.measures(Component::Tilt));
        assert!(!placed.measures(Component::Shear) && !placed.measures(Component::FreeMoment));
    }

    #[test]
    fn with_a_plate_insoles_give_only_the_feet() {
        let pose = standing(0.0, Vector3::zeros());
        let both = GroundSample {
            moment_nm: [30.0, -20.0, 1.0],
            force_n: [12.0, -3.0, 700.0],
            not_measured: 0,
            devices: GroundDevice::Plate as u32 | GroundDevice::Insoles as u32,
            ..insoles([300.0, 400.0], [[0.0; 2]; 2])
        };
        let placed = to_world(&both, &pose, &foot_outline::both(&pose, None, HEIGHT_M));
        assert_eq!((placed.moment_nm, placed.cop_m()), (both.moment_nm, both.cop_m()));
        assert_eq!(both.feet().unwrap().cop_m, None, "a sole's own frame is no place in the world");
        let at = placed.feet().unwrap().cop_m.unwrap();
        let foot = pose.origin_of(Segment::LeftFoot);
        assert!((at[0][1] - foot.y).abs() < 1e-12 && at[0][0] > foot.x);
    }

    #[test]
    fn empty_insoles_mean_that_no_person_stands_and_a_contradiction_gives_no_centre() {
        let pose = standing(0.0, Vector3::zeros());
        let outlines = foot_outline::both(&pose, None, HEIGHT_M);
        let empty = to_world(&insoles([0.0; 2], [[0.0; 2]; 2]), &pose, &outlines);
        assert!(matches!(empty.cop_m(), Err(crate::message::ground::NoCop::TooLittleForce { .. })));
        let contradicting = GroundSample { force_n: [0.0, 0.0, 900.0], ..insoles([350.0; 2], [[0.0; 2]; 2]) };
        let placed = to_world(&contradicting, &pose, &outlines);
        assert_eq!(placed.cop_m(), Err(crate::message::ground::NoCop::NotMeasured));
    }
}
