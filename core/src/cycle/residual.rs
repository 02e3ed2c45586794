//! Residual while no load is carried: it measures the error of the compensation and the lag of the clocks, and updates
//! the filter.

use super::body_motion::{ACCELERATION_AT_REST_M_PER_S2, BodyMotion};
use super::memory::Memory;
use super::monitoring::SUPPORT_MARGIN_M;
use super::settings::{Method, Motion, Settings};
use super::{foot_outline, support};
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::message::Component;
use crate::motion::{ForceSigma, Snapshot};
use crate::overload::GRAVITY_M_PER_S2;
use crate::sesc::PARAMETERS;
use crate::sesc::reduction::Rows;

/// Minimum interval between motion samples that update the filter, ns …
pub(super) const MOTION_ROW_EVERY_NS: u64 = 100_000_000;
/// … and the number of them that carry the information of one: errors of a motion last about half a second.
pub(super) const ROWS_PER_INDEPENDENT: f64 = 5.0;
/// After a longer gap, whether the hands are empty is unknown, s.
const GAP_MAX_S: f64 = 0.2;
/// 1-σ of a configured or stored mass, kg: clothing, a meal, bathroom scales.
const OTHER_MASS_SIGMA_KG: f64 = 0.5;
/// Exceeded with a probability of 0.001 for two degrees of freedom.
const NIS_OUTLIER: f64 = 13.8;

impl Memory {
    /// While no load is carried, estimates the error of the compensation from the residual, and updates the filter with
    /// motion.
    pub(super) fn update_from_residual(
        &mut self,
        pose: &Pose<StationWorld>,
        snapshot: &Snapshot,
        body: &BodyMotion,
        step_s: f64,
        settings: &Settings,
    ) {
        let mass_kg = self.identification.mass_kg;
        if mass_kg <= 0.0 || !self.identification.has_body() {
            return;
        }
        if step_s > GAP_MAX_S {
            self.unloaded.clear();
        }
        let sigma = ForceSigma {
            at_rest_n: self.ground_sigma.force_n,
            by_motion_n: self.noise.vertical.sigma(self.noise.vertical_activity_n.height()),
        };
        // A step below the plate's assumed σ, such as a tool in a pocket, belongs to the force offset.
        let gate = ForceSigma { at_rest_n: sigma.at_rest_n.max(settings.force_sigma_n), ..sigma };
        if !self.unloaded.update(self.estimate.delta_f_n[2], step_s, settings.load_threshold_n, gate) {
            return;
        }
        if self.registration.is_lost() {
            self.register(pose, snapshot, body, settings);
            return;
        }
        if self.noise.may_have_external_force() {
            return;
        }
        self.update_motion_noise(snapshot, body);
        if settings.motion != Motion::Paper && !snapshot.ground.is_by_insoles_alone() {
            self.force_offset.update(self.estimate.delta_f_n[2], step_s, sigma);
        }
        self.register(pose, snapshot, body, settings);
        let steady = snapshot.both_feet_stand == 1 || !settings.suit_drifts;
        let due = snapshot.time_ns.saturating_sub(self.motion_update_ns) >= MOTION_ROW_EVERY_NS;
        if steady && due {
            self.update_from_motion(pose, snapshot, body, settings);
        }
    }

    /// Applies the mass in use to the force offset.
    pub(super) fn apply_mass_to_force_offset(&mut self) {
        let subject = &self.identification;
        let sigma_n = subject.weighed_sigma_n().unwrap_or(OTHER_MASS_SIGMA_KG * GRAVITY_M_PER_S2);
        self.force_offset.apply_mass(subject.mass_kg, sigma_n);
    }

    /// Vertical force of the unloaded body in a motion that needs this force per kilogram, m/s², with the force offset,
    /// N.
    pub(super) fn unloaded_force_n(&self, specific_force_m_per_s2: f64) -> f64 {
        self.identification.mass_kg * specific_force_m_per_s2 + self.force_offset.mean_n()
    }

    /// Weighs the body, unless its mass comes from another source.
    pub(super) fn weigh(
        &mut self,
        pose: &Pose<StationWorld>,
        snapshot: &Snapshot,
        body: &BodyMotion,
        step_s: f64,
        settings: &Settings,
    ) {
        let outlines = foot_outline::both(pose, self.reported_body.body(), settings.height_m);
        let supported = self.registration.is_lost()
            || support::is_supported(pose, self.estimate.cop_measured_m, &outlines, SUPPORT_MARGIN_M);
        let vertical_n = snapshot.ground.force_n[2] - self.terms.force_n[2];
        let subject = &self.identification;
        let loaded = subject.mass_kg > 0.0
            && (vertical_n - self.unloaded_force_n(body.specific_force_m_per_s2)).abs()
                > self.load_limit_n(settings);
        // A mass discarded after the identification is still needed.
        let is_wanted = subject.identifying == 1 || subject.mass_kg <= 0.0;
        if loaded || !supported || snapshot.both_feet_stand != 1 || !is_wanted {
            return;
        }
        let inertia_n = vertical_n * body.suit_acceleration_m_per_s2[2] / body.specific_force_m_per_s2;
        let sigma_n = self.noise.vertical.sigma(inertia_n.abs());
        self.identification.weigh(vertical_n, body.specific_force_m_per_s2, sigma_n, step_s, settings);
    }

    /// The body's own horizontal acceleration in use: without the forces of the model's terms, m/s².
    fn body_acceleration_m_per_s2(&self, body: &BodyMotion, axis: usize) -> f64 {
        body.acceleration_m_per_s2(axis) - self.terms.force_n[axis] / self.identification.mass_kg
    }

    /// Estimates the error of the compensation while the body alone explains the measurement.
    fn update_motion_noise(&mut self, snapshot: &Snapshot, body: &BodyMotion) {
        let by_plate = [0, 1].map(|axis| self.body_acceleration_m_per_s2(body, axis));
        let noise = &mut self.noise;
        let activity_n = noise.vertical_activity_n.height();
        noise.vertical.update(self.estimate.delta_f_n[2], activity_n, self.ground_sigma.force_n);
        let [force_x_n, force_y_n, _] = snapshot.ground.force_n;
        for (axis, shear_n) in [force_x_n, force_y_n].into_iter().enumerate() {
            // A device that reports exactly zero without declaring shear unavailable does not measure it either.
            if snapshot.ground.measures(Component::Shear) && shear_n != 0.0 {
                let error = by_plate[axis] - body.suit_acceleration_m_per_s2[axis];
                let activity = noise.horizontal_activity_m_per_s2.height();
                noise.horizontal.update(error, activity, ACCELERATION_AT_REST_M_PER_S2);
            }
            let activity_m = noise.cop_activity_m[axis].height();
            let [sigma_m, moving_m] = [self.estimate.cop_sigma_m[axis], noise.cop[axis].sigma(activity_m)];
            let at_rest_m = math::sqrt((sigma_m * sigma_m - moving_m * moving_m).max(0.0));
            let error_m = self.estimate.cop_measured_m[axis] - self.estimate.cop_estimated_m[axis];
            noise.cop[axis].update(error_m, activity_m, at_rest_m);
        }
    }

    /// Whether motion may update the filter: requested, compensated, and no static pose.
    fn accepts_motion(&self, settings: &Settings) -> bool {
        let subject = &self.identification;
        let is_requested = subject.identifying == 1 || (settings.passive && subject.identified == 1);
        settings.method == Method::StaticAndDynamic
            && settings.motion != Motion::Paper
            && is_requested
            && self.estimate.static_pose == 0
    }

    /// Updates with the moment rows `(B_xy − s B_z) Φ = CoP − x0_xy + s x0_z − turning` (DESIGN §4); R increases with
    /// the motion.
    fn update_from_motion(
        &mut self,
        pose: &Pose<StationWorld>,
        snapshot: &Snapshot,
        body: &BodyMotion,
        settings: &Settings,
    ) {
        // The static equation does not apply to a moving body, not even for its position.
        if settings.motion == Motion::Paper && self.estimate.static_pose == 0 {
            return;
        }
        self.motion_update_ns = snapshot.time_ns;
        let rows = self.identification.reduction.rows(pose, body.slope);
        let drift_m2 = self.identification.drift_variance_m2(pose, settings);
        let cop_m = core::array::from_fn(|axis| {
            self.estimate.cop_measured_m[axis] - body.cop_beyond_rows_m(axis) - self.terms.cop_m[axis]
        });
        let floor = settings.measurement_sigma_m * settings.measurement_sigma_m;
        let one_m2: [f64; 2] = core::array::from_fn(|axis| {
            let moving_m = self.noise.cop[axis].sigma(self.noise.cop_activity_m[axis].height());
            let lasting_m = self.ground_sigma.lasting_cop_m;
            drift_m2[axis] + floor + moving_m * moving_m + lasting_m * lasting_m
        });
        let variance_m2 = one_m2.map(|variance_m2| ROWS_PER_INDEPENDENT * variance_m2);
        let predicted_m = self.identification.predict_cop_m(&rows);
        let theta_m2 = self.identification.cop_variance_m2(&rows);
        let nis: f64 = (0..2)
            .map(|axis| {
                let innovation_m: f64 = cop_m[axis] - predicted_m[axis];
                innovation_m * innovation_m / (theta_m2[axis] + variance_m2[axis])
            })
            .sum();
        self.identification.update_misfit(&rows, cop_m, one_m2, 1.0);
        // Reject outliers: contacts and stumbles violate the model.
        if nis >= NIS_OUTLIER {
            return;
        }
        if !self.accepts_motion(settings) {
            // After identification the subject still steps about: update the stance offset and keep θ.
            self.identification.update_stance_offset(&rows, cop_m, variance_m2);
        } else if self.identification.update_from_cop(&rows, cop_m, variance_m2).is_some() {
            self.estimate.motion_samples_used = self.estimate.motion_samples_used.saturating_add(1);
            self.update_from_shear(snapshot, body, settings);
            if self.identification.identifying == 1 {
                self.identification.finish_row(settings);
            }
        }
        self.identification.update_predicted_cop_sigma(settings);
    }

    /// Updates with the force rows `d²(x0 + BΦ)/dt² = F_xy/M` (DESIGN §4), if shear is measured.
    fn update_from_shear(&mut self, snapshot: &Snapshot, body: &BodyMotion, settings: &Settings) {
        let Motion::Compensated { half_window_ns } = settings.motion else { return };
        let [x_n, y_n, _] = snapshot.ground.force_n;
        if !snapshot.ground.measures(Component::Shear) || (x_n, y_n) == (0.0, 0.0) {
            return;
        }
        let mut sum = Rows { h: [[0.0; PARAMETERS]; 2], offset_m: [0.0; 2] };
        let reduction = &self.identification.reduction;
        let complete = self.history.differentiate_twice(half_window_ns, |weight, near| {
            let rows = reduction.rows(&near.pose(), [0.0; 2]);
            for axis in 0..2 {
                sum.offset_m[axis] += weight * (rows.offset_m[axis] - near.station_from_suit_m[axis]);
                for (sum, value) in sum.h[axis].iter_mut().zip(&rows.h[axis]) {
                    *sum += weight * value;
                }
            }
        });
        let sigma = self.noise.acceleration_sigma_m_per_s2();
        if complete {
            let acceleration_m_per_s2 = [0, 1].map(|axis| self.body_acceleration_m_per_s2(body, axis));
            self.identification.update_from_force(
                &sum,
                acceleration_m_per_s2,
                ROWS_PER_INDEPENDENT * sigma * sigma,
            );
        }
    }
}
