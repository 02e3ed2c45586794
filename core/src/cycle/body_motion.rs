//! Contribution of the body's own motion to the ground reaction, and its uncertainty.

use bytemuck::{Pod, Zeroable};

use super::outputs::Outputs;
use super::residual::Residual;
use crate::GRAVITY_M_PER_S2;
use crate::math;
use crate::message::Component;
use crate::motion::{Confidence, Envelope, Inertia, UpperInertia};

/// Errors of the inertia compensation, estimated from motion without a load.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct MotionNoise {
    /// Error of the vertical force; activity in N.
    pub vertical: Confidence,
    /// Error of the CoM's horizontal acceleration; activity in m/s².
    pub horizontal: Confidence,
    /// Error of the CoP, forward and sideways; activity in m.
    pub cop: [Confidence; 2],
    /// Recent size of the compensation, N.
    pub vertical_activity_n: Envelope,
    /// Likewise, m/s².
    pub horizontal_activity_m_per_s2: Envelope,
    /// Likewise, m.
    pub cop_activity_m: [Envelope; 2],
    /// Inertial part of the moment at L5/S1 about the horizontal axes, over the body's mass, m²/s².
    upper_activity_m2_per_s2: [Envelope; 2],
    /// Short-term mean of the shear that the suit's motion does not explain, over the mass, m/s² …
    external_m_per_s2: [f64; 2],
    /// … and its long-term mean.
    bias_m_per_s2: [f64; 2],
}

impl MotionNoise {
    /// Whether every number is in range; a stored one is checked before use.
    pub fn is_sound(&self) -> bool {
        self.cop.iter().chain([&self.vertical, &self.horizontal]).all(Confidence::is_sound)
            && self.horizontal_activity_m_per_s2.is_sound()
            && self.cop_activity_m.iter().chain([&self.vertical_activity_n]).all(Envelope::is_sound)
            && self.upper_activity_m2_per_s2.iter().all(Envelope::is_sound)
            && self.external_m_per_s2.iter().chain(&self.bias_m_per_s2).all(|value| value.is_finite())
    }

    /// The errors at the present size of the compensation.
    pub(super) fn sigma(&self) -> NoiseSigma {
        let horizontal = |activity: f64| self.horizontal.sigma(activity);
        NoiseSigma {
            vertical_n: self.vertical.sigma(self.vertical_activity_n.height()),
            cop_m: [0, 1].map(|axis: usize| self.cop[axis].sigma(self.cop_activity_m[axis].height())),
            moving_acceleration_m_per_s2: horizontal(self.horizontal_activity_m_per_s2.height()),
            upper_m2_per_s2: self.upper_activity_m2_per_s2.map(|activity| horizontal(activity.height())),
            has_external_force: self.has_external_force(),
            may_have_external_force: math::hypot(self.external_m_per_s2) > 0.5 * EXTERNAL_M_PER_S2,
        }
    }

    /// Resets the external horizontal force, which cannot be detected without shear.
    pub(super) fn reset_external_force(&mut self) {
        self.external_m_per_s2 = [0.0; 2];
    }

    /// Resets the means of unexplained shear: the plate's zero has changed.
    pub(super) fn reset_shear(&mut self) {
        self.reset_external_force();
        self.bias_m_per_s2 = [0.0; 2];
    }

    /// Long-term mean of unexplained shear, m/s²: that of a plate that is not level.
    pub(super) fn shear_bias_m_per_s2(&self) -> [f64; 2] {
        self.bias_m_per_s2
    }

    /// Ingests the shear that the suit's motion does not explain, m/s². An external force, which the short-term mean
    /// detects, does not update the long-term mean.
    pub(super) fn update_shear(&mut self, unexplained_m_per_s2: [f64; 2], step_s: f64) {
        let unexplained =
            unexplained_m_per_s2.map(|shear| shear.clamp(-SHEAR_MAX_M_PER_S2, SHEAR_MAX_M_PER_S2));
        update_mean(&mut self.external_m_per_s2, unexplained, step_s, EXTERNAL_OVER_S);
        if !self.has_external_force() {
            update_mean(&mut self.bias_m_per_s2, unexplained, step_s, BIAS_OVER_S);
        }
    }

    /// Whether an external horizontal force acts: persistent shear that no motion explains.
    pub(super) fn has_external_force(&self) -> bool {
        math::hypot(self.external_m_per_s2) > EXTERNAL_M_PER_S2
    }

    /// Updates the error model of the compensation while the body alone explains the measurement.
    pub(super) fn update_from_residual(&mut self, outputs: &Outputs<'_>, residual: &Residual) {
        let Outputs { instant, ground, prediction, estimate, .. } = *outputs;
        let activity_n = self.vertical_activity_n.height();
        self.vertical.update(residual.delta_f_n, activity_n, ground.sigma.force_n);
        let sample = &instant.snapshot.ground;
        let [force_x_n, force_y_n, _] = sample.force_n;
        for (axis, shear_n) in [force_x_n, force_y_n].into_iter().enumerate() {
            // A device that reports exactly zero without declaring shear unavailable does not measure it either.
            if sample.measures(Component::Shear) && shear_n != 0.0 {
                let by_suit = prediction.body.suit_acceleration_m_per_s2[axis];
                let error = residual.body_acceleration_m_per_s2[axis] - by_suit;
                let activity = self.horizontal_activity_m_per_s2.height();
                self.horizontal.update(error, activity, ACCELERATION_AT_REST_M_PER_S2);
            }
            let activity_m = self.cop_activity_m[axis].height();
            let [sigma_m, moving_m] = [estimate.cop_sigma_m[axis], self.cop[axis].sigma(activity_m)];
            let at_rest_m = math::sqrt((sigma_m * sigma_m - moving_m * moving_m).max(0.0));
            self.cop[axis].update(residual.cop_error_m[axis], activity_m, at_rest_m);
        }
    }

    /// Ingests the size of the compensation at a snapshot, `step_s` after the previous one.
    pub(super) fn update(&mut self, body: &BodyMotion, mass_kg: f64, step_s: f64) {
        self.vertical_activity_n.update(mass_kg * body.suit_acceleration_m_per_s2[2], step_s);
        let [x, y, _] = body.suit_acceleration_m_per_s2;
        self.horizontal_activity_m_per_s2.update(math::hypot([x, y]), step_s);
        for axis in 0..2 {
            self.cop_activity_m[axis].update(body.shift_m(axis), step_s);
            self.upper_activity_m2_per_s2[axis].update(body.upper.moment_m2_per_s2[axis], step_s);
        }
    }
}

/// Errors of the inertia compensation at one instant.
#[derive(Debug, Clone, Copy)]
pub(super) struct NoiseSigma {
    /// 1-σ of the vertical force, N.
    pub(super) vertical_n: f64,
    /// 1-σ of the CoP, forward and sideways, m.
    pub(super) cop_m: [f64; 2],
    /// Part of the 1-σ of the suit's horizontal acceleration that motion causes, m/s²: zero at rest.
    pub(super) moving_acceleration_m_per_s2: f64,
    /// 1-σ of the inertial part of the moment at L5/S1 about the world's X and Y axes, over the body's mass, m²/s²:
    /// proportional to the relative error of the suit's horizontal accelerations.
    pub(super) upper_m2_per_s2: [f64; 2],
    /// Whether an external horizontal force acts.
    pub(super) has_external_force: bool,
    /// Whether one cannot be excluded; the filter is not updated then.
    pub(super) may_have_external_force: bool,
}

impl NoiseSigma {
    /// 1-σ of the suit's horizontal acceleration per axis, m/s².
    pub(super) fn acceleration_m_per_s2(&self) -> f64 {
        math::hypot([self.moving_acceleration_m_per_s2, ACCELERATION_AT_REST_M_PER_S2])
    }
}

/// Motion of the body without the load at one snapshot.
#[derive(Debug, Clone, Copy)]
pub(super) struct BodyMotion {
    /// Horizontal over vertical force of the ground on the body alone.
    pub(super) slope: [f64; 2],
    /// Whether the slope comes from measured shear.
    pub(super) slope_is_measured: bool,
    /// Shift of the CoP by the rotation of the body, m.
    pub(super) turning_m: [f64; 2],
    /// Vertical force over mass, g + C̈_z, m/s².
    pub(super) specific_force_m_per_s2: f64,
    /// C̈ by the suit, m/s².
    pub(super) suit_acceleration_m_per_s2: [f64; 3],
    /// Accelerations of the hands, left and right, m/s².
    pub(super) hand_acceleration_m_per_s2: [[f64; 3]; 2],
    /// Inertial forces and moments of the body above L5/S1.
    pub(super) upper: UpperInertia,
    /// Height of the walking surface, and of the centre of mass above it, m.
    floor_m: f64,
    centre_height_m: f64,
}

impl BodyMotion {
    /// A body at rest, as in the paper's static equations.
    pub(super) const REST: BodyMotion = BodyMotion {
        slope: [0.0; 2],
        slope_is_measured: false,
        turning_m: [0.0; 2],
        specific_force_m_per_s2: GRAVITY_M_PER_S2,
        suit_acceleration_m_per_s2: [0.0; 3],
        hand_acceleration_m_per_s2: [[0.0; 3]; 2],
        upper: UpperInertia::REST,
        floor_m: 0.0,
        centre_height_m: 0.0,
    };

    /// The motion measured by the suit.
    pub(super) fn by_suit(inertia: &Inertia, centre_z_m: f64, floor_m: f64) -> BodyMotion {
        let specific_force = inertia.specific_force_m_per_s2().unwrap_or(GRAVITY_M_PER_S2);
        let [x, y, _] = inertia.acceleration_m_per_s2;
        BodyMotion {
            slope: [x / specific_force, y / specific_force],
            slope_is_measured: false,
            turning_m: inertia.turning_shift_m(specific_force),
            specific_force_m_per_s2: specific_force,
            suit_acceleration_m_per_s2: inertia.acceleration_m_per_s2,
            hand_acceleration_m_per_s2: inertia.hand_acceleration_m_per_s2,
            upper: inertia.upper,
            floor_m,
            centre_height_m: centre_z_m - floor_m,
        }
    }

    /// The body's horizontal acceleration by measured shear, without the part that accelerates the load in the hands;
    /// and its difference from the suit's, m/s². `None` without shear: exactly zero means not measured.
    pub(super) fn by_shear(
        &self,
        ground_force_n: [f64; 3],
        mass_kg: f64,
        load_kg: f64,
    ) -> Option<[[f64; 2]; 2]> {
        let [x, y, _] = ground_force_n;
        if mass_kg <= 0.0 || (x == 0.0 && y == 0.0) {
            return None;
        }
        let hands = self.hands_acceleration_m_per_s2();
        let shear = [(x - load_kg * hands[0]) / mass_kg, (y - load_kg * hands[1]) / mass_kg];
        let suit = self.suit_acceleration_m_per_s2;
        Some([shear, [shear[0] - suit[0], shear[1] - suit[1]]])
    }

    /// Uses this horizontal acceleration of the body, m/s².
    pub(super) fn use_acceleration(&mut self, acceleration_m_per_s2: [f64; 2]) {
        self.slope = acceleration_m_per_s2.map(|value| value / self.specific_force_m_per_s2);
        self.slope_is_measured = true;
    }

    /// The horizontal acceleration in use, m/s².
    pub(super) fn acceleration_m_per_s2(&self, axis: usize) -> f64 {
        self.slope[axis] * self.specific_force_m_per_s2
    }

    /// Mass in the hands that a vertical force supports in this motion, kg; never negative.
    pub(super) fn load_kg(&self, delta_f_n: f64) -> f64 {
        (delta_f_n / self.load_weight_m_per_s2()).max(0.0)
    }

    /// Weight of one kilogram in the hands in this motion, N/kg; at least half of the weight at rest.
    pub(super) fn load_weight_m_per_s2(&self) -> f64 {
        let [_, _, up] = self.hands_acceleration_m_per_s2();
        (GRAVITY_M_PER_S2 + up).max(0.5 * GRAVITY_M_PER_S2)
    }

    /// Acceleration of the middle between the hands, m/s².
    pub(super) fn hands_acceleration_m_per_s2(&self) -> [f64; 3] {
        let [left, right] = self.hand_acceleration_m_per_s2;
        core::array::from_fn(|axis| 0.5 * (left[axis] + right[axis]))
    }

    /// Part of the CoP that the rows of the chain omit, m: rotation of the body, and height of the floor.
    pub(super) fn cop_beyond_rows_m(&self, axis: usize) -> f64 {
        self.turning_m[axis] + self.slope[axis] * self.floor_m
    }

    /// Effect of a 1-σ of the horizontal acceleration on the CoP, m.
    pub(super) fn cop_sigma_by_acceleration_m(&self, sigma_m_per_s2: f64) -> f64 {
        self.centre_height_m.abs() * sigma_m_per_s2 / self.specific_force_m_per_s2
    }

    /// Shift of the CoP on an axis by acceleration and rotation, m.
    pub(super) fn shift_m(&self, axis: usize) -> f64 {
        (self.centre_height_m * self.slope[axis]).abs() + self.turning_m[axis].abs()
    }
}

/// Updates an exponential mean with the time constant `over_s`, s, by a value that lasted `step_s`, s.
fn update_mean(mean: &mut [f64; 2], value: [f64; 2], step_s: f64, over_s: f64) {
    let step_s = step_s.max(0.0);
    let gain = (step_s / (over_s + step_s)).min(1.0);
    for (mean, value) in mean.iter_mut().zip(value) {
        *mean += gain * (value - *mean);
    }
}

/// 1-σ of a suit's acceleration at rest, m/s².
const ACCELERATION_AT_REST_M_PER_S2: f64 = 0.05;
/// Persistent shear that no motion explains counts as an external horizontal force above this, m/s² …
const EXTERNAL_M_PER_S2: f64 = 0.35;
/// … averaged over about this time, s, since the noise of accelerations is not persistent.
const EXTERNAL_OVER_S: f64 = 0.5;
/// Averaging time of the plate's constant shear, s.
const BIAS_OVER_S: f64 = 8.0;
/// Limit of a body's horizontal acceleration, m/s²; larger values are noise.
const SHEAR_MAX_M_PER_S2: f64 = 5.0;
