//! Prior of the filter, and its test against the first poses.

use super::Identification;
use super::consistency::{Consistency, PoseInnovation};
use crate::body::Anthropometry;
use crate::cycle::settings::{PriorKind, Settings};
use crate::kalman::STATES;
use crate::sesc::prior::{misalignments_m, soft_constraints};
use crate::sesc::reduction::Rows;
use crate::sesc::suit_error::effective_vectors;
use crate::sesc::{Phi, Prior, Reduction};

impl Identification {
    /// Scales the table to the bone lengths and initialises the filter with the prior: the body's distribution, general
    /// constraints on bodies, and the effect of the suit's errors. The stance offset, which the caller has moved into
    /// the anchor, is not less uncertain than before.
    pub(super) fn initialise_prior(&mut self, settings: &Settings) {
        let (skeleton, stance_m2) = (self.skeleton(), self.stance_variance_m2());
        self.anthropometry = Anthropometry::de_leva(&skeleton, settings.height_m, settings.sex);
        let phi = Phi::of(&skeleton, &self.anthropometry);
        self.reduction = Reduction::new(settings.reduction, &phi);
        let table = || Prior::table(&self.reduction, &skeleton, &self.anthropometry);
        let prior = match (settings.prior, &settings.similar) {
            (PriorKind::None, _) => Prior::none(&self.reduction),
            (PriorKind::SimilarSubject, Some(similar)) => table().similar(&self.reduction, similar),
            (PriorKind::Table | PriorKind::SimilarSubject, _) => table(),
        };
        let count = self.reduction.count();
        self.filter.reset(count, &prior);
        for constraint in
            soft_constraints(&self.reduction, settings.symmetry_sigma_m, settings.long_axis_sigma_m)
        {
            let mut h = [0.0; STATES];
            h[..count].copy_from_slice(&constraint.h[..count]);
            self.filter.update(&h, constraint.value_m, constraint.sigma_m * constraint.sigma_m);
        }
        let psi = effective_vectors(&phi, &skeleton, settings.suit_drifts);
        for along_m in misalignments_m(&self.reduction, &psi, settings.suit_misalignment_rad) {
            self.filter.widen(&along_m);
        }
        self.consistency = Consistency::start();
        self.new_stance(settings);
        self.widen_stance_offset_to(stance_m2);
    }

    /// Factor by which the prior's covariance was inflated because this subject contradicts it; 1 for none.
    pub fn prior_inflation(&self) -> f64 {
        self.consistency.inflation().max(1.0)
    }

    /// Treats the present estimate as established by poses, so that no innovation inflates it.
    #[cfg(test)]
    pub(in crate::cycle) fn accept_prior(&mut self) {
        self.consistency.accept();
    }

    /// Tests a pose against the prior before the update, and inflates P if the first poses contradict it.
    pub(super) fn test_prior(&mut self, rows: &Rows, cop_m: [f64; 2], variance_m2: [f64; 2]) {
        let h = [0, 1].map(|axis| self.with_stance(rows, axis));
        let [xx, xy, yy] = self.filter.covariance_of(&h[0], &h[1]);
        let (xx, yy) = (xx + variance_m2[0], yy + variance_m2[1]);
        let predicted_m = self.predict_cop_m(rows);
        let [x, y] = [cop_m[0] - predicted_m[0], cop_m[1] - predicted_m[1]];
        let nis = (x * x * yy - 2.0 * x * y * xy + y * y * xx) / (xx * yy - xy * xy);
        let theta_m2: f64 = [0, 1]
            .iter()
            .map(|&axis| self.filter.projected_variance_m2(&self.without_stance(rows, axis)))
            .sum();
        let innovation =
            PoseInnovation { nis, square_m2: x * x + y * y, theta_m2, rest_m2: xx + yy - theta_m2 };
        if !nis.is_finite() {
            return;
        }
        if let Some(factor) = self.consistency.test(innovation) {
            self.filter.inflate(factor);
        }
    }
}
