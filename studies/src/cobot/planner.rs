//! Choice of a place and a slope of the handles: prediction of the posture model, corrected by the limit ratios measured in
//! earlier handovers.

use equipoise_core::handover::experience::{Experience, LimitRatio};
use equipoise_core::handover::search::SLOPES_RAD;
use equipoise_core::handover::{self, Body, FootPlacement, Part, Prediction};
use nalgebra::Vector3;

use equipoise_simulator::cobot::trial::{PART_KG, WIDTH_M};

pub use crate::handover::Presentation;
use crate::handover::grid;

/// A place that was not reached excludes those within this distance, m.
const EXCLUDED_M: f64 = 0.075;
/// The part that is handed over.
const PART: Part = Part { mass_kg: PART_KG, mass_sigma_kg: 0.0, width_m: WIDTH_M, slope_rad: None };

/// A presentation with its corrected limit ratio of the worst joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The presentation.
    pub part: Presentation,
    /// Corrected limit ratio.
    pub corrected: LimitRatio,
}

/// Places, predictions and experience for one worker, whose feet stay where they are.
#[derive(Debug, Clone)]
pub struct Planner {
    body: Body,
    feet: FootPlacement,
    candidates: Vec<(Presentation, Prediction)>,
    experience: Experience,
}

impl Planner {
    /// A planner for the places in front of the worker that the cobot `permits`: those of `equipoise-study handover`,
    /// station's world.
    pub fn new(body: Body, feet: FootPlacement, permits: impl Fn(&Vector3<f64>) -> bool) -> Planner {
        let mut planner = Planner { body, feet, candidates: Vec::new(), experience: Experience::default() };
        let permitted = grid().filter(permits);
        let parts = permitted
            .flat_map(|at_m| SLOPES_RAD.map(|slope_rad| Presentation { at_m, slope_rad: Some(slope_rad) }));
        planner.candidates = parts.filter_map(|part| Some((part, planner.predict(part)?))).collect();
        planner
    }

    /// Prediction of the posture model; `None` for an infeasible presentation.
    fn predict(&self, part: Presentation) -> Option<Prediction> {
        handover::predict(&self.body, &self.feet, &PART.with_slope(part.slope_rad), part.at_m).ok()
    }

    /// A presentation and its corrected limit ratio.
    fn corrected(&self, part: Presentation, model: &Prediction) -> Candidate {
        let corrected = self.experience.correct(part.at_m, model.worst_ratio);
        Candidate { part, corrected }
    }

    /// Adds a measured limit ratio. One of an infeasible presentation has no prediction to compare with.
    pub fn observe(&mut self, part: Presentation, measured: LimitRatio) {
        if let Some(model) = self.predict(part) {
            self.experience.observe(part.at_m, model.worst_ratio.value, measured);
        }
    }

    /// Excludes a presentation that the worker did not reach, and those near to it with the same slope.
    pub fn exclude(&mut self, part: Presentation) {
        let is_same = |other: &Presentation| {
            other.slope_rad == part.slope_rad && (other.at_m - part.at_m).norm() <= EXCLUDED_M
        };
        self.candidates.retain(|(other, _)| !is_same(other));
    }

    /// The presentation with the lowest corrected limit ratio less `optimism` σ; `None` if all are infeasible or excluded.
    pub fn best(&self, optimism: f64) -> Option<Candidate> {
        let value = |it: &Candidate| it.corrected.value - optimism * it.corrected.sigma;
        let all = self.candidates.iter().map(|(part, model)| self.corrected(*part, model));
        all.min_by(|a, b| value(a).total_cmp(&value(b)))
    }

    /// The best presentation, if it is better than `from` by more than σ as in `clients/python/handover.py`.
    pub fn better_than(&self, from: Presentation) -> Option<Candidate> {
        let best = self.best(0.0)?;
        let Some(model) = self.predict(from) else { return Some(best) };
        let there = self.predict(best.part)?;
        let predicted = [model, there].map(|model| model.worst_ratio);
        let gain = self.experience.difference([from.at_m, best.part.at_m], predicted);
        (gain.value > gain.sigma).then_some(best)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::session::Session;
    use crate::subject::Subject;

    /// A planner for an identified subject.
    pub(crate) fn planner() -> Planner {
        let subject = Subject::random(6);
        let mut session = Session::new(&subject, subject.settings());
        session.identify_by_windows(4);
        let body = session.memory().identification.handover_body(session.settings(), Default::default());
        Planner::new(body, FootPlacement::natural(subject.height_m), |_| true)
    }

    #[test]
    fn the_best_place_follows_the_measurements_and_excluded_places_are_left_out() {
        let mut planner = planner();
        let best = planner.best(0.0).unwrap();
        assert!(
            planner
                .better_than(Presentation { at_m: Vector3::new(0.6, 0.0, 1.05), slope_rad: None })
                .is_some()
        );
        assert_eq!(planner.better_than(best.part), None);
        for _ in 0..3 {
            let measured = LimitRatio { value: 2.0 * best.corrected.value, sigma: 0.02 };
            planner.observe(best.part, measured);
        }
        let next = planner.best(0.0).unwrap();
        assert!(next.part != best.part, "{best:?} {next:?}");
        planner.exclude(next.part);
        assert_ne!(planner.best(0.0).unwrap().part, next.part);
    }
}
