//! The identified body as the planning of handovers needs it.

use nalgebra::{UnitQuaternion, Vector3};

use super::Identification;
use crate::body::{JOINTS, SEGMENTS, Side};
use crate::cycle::Settings;
use crate::frame::Pose;
use crate::handover::Body;
use crate::math;

impl Identification {
    /// The identified body; `fatigue` of each joint, in [0, 1].
    pub fn handover_body(&self, settings: &Settings, fatigue: [f64; JOINTS]) -> Body {
        let skeleton = self.skeleton();
        // A handover is near to upright standing, in which the model's error is that of the whole trunk.
        let upright = [UnitQuaternion::identity(); SEGMENTS];
        let pose = Pose::new(skeleton.t_pose_m().map(Vector3::from), upright);
        // The stance offset displaces body and feet equally, so its variance does not contribute.
        let [x, y] = self.parameter_variance_m2(&self.reduction.rows(&pose, [0.0; 2]).h);
        let floor = settings.measurement_sigma_m * settings.measurement_sigma_m;
        Body {
            skeleton,
            grip_m: Side::BOTH.map(|side| self.anthropometry().grip_m(side.hand())),
            phi: self.phi(),
            cop_sigma_m: math::sqrt(x.max(y) + floor),
            mass_kg: self.mass_kg,
            limits: settings.limits,
            fatigue,
        }
    }
}
