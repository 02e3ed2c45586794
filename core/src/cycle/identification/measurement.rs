//! Measurement model of a CoP: updates θ and the stance offset.
//!
//! `CoP = offset + h θ + s + noise`: s is the displacement from the position at which the anchor placed this stance to
//! the true one. It is the same in all poses of a stance, so it is a state of the filter and not noise, which many
//! poses would average out.

use super::{Identification, pose_of};
use crate::cycle::placement::Continuity;
use crate::cycle::settings::Settings;
use crate::frame::{Pose, StationWorld};
use crate::kalman::STATES;
use crate::math;
use crate::sesc::reduction::Rows;
use crate::sesc::suit_error::{drift_variance_m2, effective_vectors};
use crate::sesc::{PARAMETERS, Phi};
use crate::static_pose::{PoseStatistics, Window};

/// 1-σ of the initial error of the plate's configured position in the suit world, m: it is entered manually, and the
/// suit has drifted since.
pub(in crate::cycle) const REGISTRATION_SIGMA_M: f64 = 0.03;

/// Exceeded with a probability of 0.001 for one degree of freedom.
const OUTLIER_SQUARE: f64 = 10.8;

/// Uncertainty of the stance offset at one instant, split into the part correlated with the predicted CoP and the rest.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StanceSigma {
    /// Expected error of the offset per metre of error of the predicted CoP, per axis.
    pub by_estimate: [f64; 2],
    /// 1-σ of the rest, per axis, m.
    pub rest_m: [f64; 2],
}

impl Identification {
    /// After a gap in the suit's samples the subject may stand elsewhere; another world also has another origin.
    pub(in crate::cycle) fn follow(&mut self, continuity: Continuity, settings: &Settings) {
        if !settings.suit_drifts || !self.has_body() {
            return;
        }
        match continuity {
            Continuity::Continuous => {}
            Continuity::Gap => self.widen_stance_offset(settings),
            Continuity::NewWorld => self.new_stance(settings),
        }
    }

    /// Starts a new stance if the number changed: the anchor keeps its shift over a step, so the offset is that of the
    /// last stance with this additional σ per axis, m. For a suit with absolute position it stays zero.
    pub fn update_stance(&mut self, stance: u64, sigma_m: [f64; 2], settings: &Settings) {
        if self.stance == stance {
            return;
        }
        self.stance = stance;
        if settings.suit_drifts {
            for (axis, sigma_m) in sigma_m.into_iter().enumerate() {
                self.filter.add_process_noise(self.reduction.count() + axis, sigma_m * sigma_m);
            }
        }
    }

    /// Resets the stance offset to zero with a σ of `REGISTRATION_SIGMA_M`; exactly zero if the suit's position is
    /// absolute. θ is kept.
    pub fn new_stance(&mut self, settings: &Settings) {
        let variance_m2 =
            if settings.suit_drifts { REGISTRATION_SIGMA_M * REGISTRATION_SIGMA_M } else { 0.0 };
        self.reset_stance_offset([variance_m2; 2]);
    }

    /// After a gap in the suit's samples the stance offset is that of the last stance, because the anchor keeps its
    /// shift, with an additional σ of `REGISTRATION_SIGMA_M`. Likewise with the terms of another model, which may explain
    /// what it has absorbed. Only for a suit that drifts.
    pub(in crate::cycle) fn widen_stance_offset(&mut self, settings: &Settings) {
        if !settings.suit_drifts || !self.has_body() {
            return;
        }
        for axis in 0..2 {
            self.filter.add_process_noise(
                self.reduction.count() + axis,
                REGISTRATION_SIGMA_M * REGISTRATION_SIGMA_M,
            );
        }
    }

    /// Sets the stance offset to zero with this variance per axis, m². θ is kept.
    pub(in crate::cycle) fn reset_stance_offset(&mut self, variance_m2: [f64; 2]) {
        for (axis, variance_m2) in variance_m2.into_iter().enumerate() {
            self.filter.reset_state(self.reduction.count() + axis, variance_m2);
        }
    }

    /// Sets the stance offset to zero, with its present uncertainty, and returns it, m; the caller moves the anchor.
    pub(in crate::cycle) fn take_stance_offset(&mut self) -> [f64; 2] {
        [0, 1].map(|axis| self.filter.take_state(self.reduction.count() + axis))
    }

    /// Variance of the stance offset per axis, m².
    pub(in crate::cycle) fn stance_variance_m2(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.filter.variance_m2(self.reduction.count() + axis))
    }

    /// Increases the variance of the stance offset to at least this per axis, m².
    pub(in crate::cycle) fn widen_stance_offset_to(&mut self, variance_m2: [f64; 2]) {
        for (axis, present_m2) in self.stance_variance_m2().into_iter().enumerate() {
            let more_m2 = (variance_m2[axis] - present_m2).max(0.0);
            self.filter.add_process_noise(self.reduction.count() + axis, more_m2);
        }
    }

    /// Predicted CoP of the unloaded body by the present estimate, m; including the stance offset.
    pub fn predict_cop_m(&self, rows: &Rows) -> [f64; 2] {
        [0, 1].map(|axis| rows.offset_m[axis] + self.filter.project(&self.with_stance(rows, axis)))
    }

    /// Stance offset: from the body's position by the anchor to its estimated position on the plate, world x and y, m.
    pub fn stance_offset_m(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.filter.theta_m()[self.reduction.count() + axis])
    }

    /// Uncertainty of the stance offset, given the error of a predicted CoP whose variance is `cop_variance_m2`, m².
    pub fn stance_sigma(&self, rows: &Rows, cop_variance_m2: [f64; 2]) -> StanceSigma {
        let mut sigma = StanceSigma { by_estimate: [0.0; 2], rest_m: [0.0; 2] };
        for (axis, cop_variance_m2) in cop_variance_m2.into_iter().enumerate() {
            let [_, with_cop, offset] =
                self.filter.projected_with_nuisance_m2(&self.with_stance(rows, axis), axis);
            sigma.by_estimate[axis] = with_cop / cop_variance_m2.max(f64::MIN_POSITIVE);
            sigma.rest_m[axis] = math::sqrt((offset - sigma.by_estimate[axis] * with_cop).max(0.0));
        }
        sigma
    }

    /// Variance of [`Identification::predict_cop_m`] by P, m²; excludes the errors of suit and body.
    pub fn cop_variance_m2(&self, rows: &Rows) -> [f64; 2] {
        [0, 1].map(|axis| self.filter.projected_variance_m2(&self.with_stance(rows, axis)))
    }

    /// Variance of rows applied to θ alone, m²: without the stance offset.
    pub fn parameter_variance_m2(&self, rows: &[[f64; PARAMETERS]; 2]) -> [f64; 2] {
        rows.map(|h| {
            let mut padded = [0.0; STATES];
            padded[..PARAMETERS].copy_from_slice(&h);
            padded[self.reduction.count()..].fill(0.0);
            self.filter.projected_variance_m2(&padded)
        })
    }

    /// Variance of the predicted CoP by the drift of the suit's orientations in a pose, and by the model error, m².
    pub fn drift_variance_m2(&self, pose: &Pose<StationWorld>, settings: &Settings) -> [f64; 2] {
        let psi = effective_vectors(&self.phi(), &self.skeleton(), settings.suit_drifts);
        let drift_m2 = drift_variance_m2(pose, &psi, settings.suit_drift_rad);
        let misfit_m2 = self.misfit_variance_m2();
        [0, 1].map(|axis| drift_m2[axis] + misfit_m2[axis])
    }

    /// Variance of the predicted CoP by the model error for this subject, m².
    pub fn misfit_variance_m2(&self) -> [f64; 2] {
        self.misfit.variance_m2()
    }

    /// Compares a measured CoP with the prediction, before the update: the part of the difference that neither P nor
    /// `variance_m2` explains is model error. `weight`: number of motion samples that it counts as.
    pub(in crate::cycle) fn update_misfit(
        &mut self,
        rows: &Rows,
        cop_m: [f64; 2],
        variance_m2: [f64; 2],
        weight: f64,
    ) {
        let (predicted_m, theta_m2) = (self.predict_cop_m(rows), self.cop_variance_m2(rows));
        let innovation_m = [0, 1].map(|axis| cop_m[axis] - predicted_m[axis]);
        if innovation_m.iter().chain(&variance_m2).all(|value| value.is_finite()) {
            self.misfit.update(innovation_m, [0, 1].map(|axis| theta_m2[axis] + variance_m2[axis]), weight);
        }
    }

    /// Updates the filter with one measured CoP as two scalar measurements. Returns the normalised innovation squared
    /// of both together (2 degrees of freedom), relative to the previous estimate; `None`, and nothing changes, if a
    /// number is not finite or a variance not positive.
    pub fn update_from_cop(&mut self, rows: &Rows, cop_m: [f64; 2], variance_m2: [f64; 2]) -> Option<f64> {
        let numbers = rows.h.iter().flatten().chain(&rows.offset_m).chain(&cop_m).chain(&variance_m2);
        if !numbers.copied().all(f64::is_finite) || variance_m2.iter().any(|variance| *variance <= 0.0) {
            return None;
        }
        // The second innovation is relative to the estimate after the first, so the squares add up to that of the joint
        // innovation.
        let mut nis = 0.0;
        for axis in 0..2 {
            let h = self.with_stance(rows, axis);
            let innovation = self.filter.update(&h, cop_m[axis] - rows.offset_m[axis], variance_m2[axis])?;
            nis += innovation.normalised_square();
        }
        Some(nis)
    }

    /// Updates the stance offset alone with a measured CoP; θ is kept, and its uncertainty is included.
    pub fn update_stance_offset(&mut self, rows: &Rows, cop_m: [f64; 2], variance_m2: [f64; 2]) {
        for axis in 0..2 {
            let h = self.with_stance(rows, axis);
            self.filter.update_nuisance(&h, cop_m[axis] - rows.offset_m[axis], variance_m2[axis]);
        }
    }

    /// Updates with the two force rows `Σ_k w_k (x0 + BΦ)_k = F_xy/M`, m/s² per m: second derivatives of the chain
    /// against measured shear. Skips a row whose innovation is an outlier. Returns whether any was used.
    pub fn update_from_force(&mut self, rows: &Rows, force_m_per_s2: [f64; 2], variance: f64) -> bool {
        let mut taken = false;
        for (axis, measured) in force_m_per_s2.into_iter().enumerate() {
            let mut h = [0.0; STATES];
            h[..self.reduction.count()].copy_from_slice(&rows.h[axis][..self.reduction.count()]);
            let measured = measured - rows.offset_m[axis];
            let innovation = measured - self.filter.project(&h);
            let expected = self.filter.projected_variance_m2(&h) + variance;
            if innovation * innovation < OUTLIER_SQUARE * expected {
                taken |= self.filter.update(&h, measured, variance).is_some();
            }
        }
        taken
    }

    /// The present estimate of Φ.
    pub fn phi(&self) -> Phi {
        self.reduction.phi(self.filter.theta_m())
    }

    /// Mean rows of a static pose window; `None` while it fills.
    pub(super) fn mean_rows(&self, window: &Window) -> Option<Rows> {
        let mut mean = Rows { h: [[0.0; PARAMETERS]; 2], offset_m: [0.0; 2] };
        let count = window.samples().count() as f64;
        for held in window.samples() {
            let rows = self.reduction.rows(&pose_of(held), [0.0; 2]);
            for axis in 0..2 {
                mean.offset_m[axis] += rows.offset_m[axis] / count;
                for (mean, value) in mean.h[axis].iter_mut().zip(rows.h[axis]) {
                    *mean += value / count;
                }
            }
        }
        window.is_full().then_some(mean)
    }

    /// R of a static pose, m²: the suit's drift, which a window is too short to average out; the body's own motion; the
    /// spread of the CoP over the window, most of which is slow drift and does not average out; and the constant
    /// errors, 1-σ in m, of the ground and of the residual motion.
    pub(super) fn pose_variance_m2(
        &self,
        pose: &Pose<StationWorld>,
        statistics: &PoseStatistics,
        lasting_m: [f64; 2],
        settings: &Settings,
    ) -> [f64; 2] {
        let suit_m2 = self.drift_variance_m2(pose, settings);
        [0, 1].map(|axis| {
            let noise_m = statistics.cop_sigma_m[axis];
            suit_m2[axis]
                + settings.measurement_sigma_m * settings.measurement_sigma_m
                + noise_m * noise_m
                + lasting_m[axis] * lasting_m[axis]
        })
    }

    /// A row over all states: the parameters, then the stance offset on this axis.
    pub(in crate::cycle) fn with_stance(&self, rows: &Rows, axis: usize) -> [f64; STATES] {
        let mut row = self.without_stance(rows, axis);
        row[self.reduction.count() + axis] = 1.0;
        row
    }

    /// A row over the parameters alone.
    pub(super) fn without_stance(&self, rows: &Rows, axis: usize) -> [f64; STATES] {
        let mut row = [0.0; STATES];
        let count = self.reduction.count();
        row[..count].copy_from_slice(&rows.h[axis][..count]);
        row
    }
}
