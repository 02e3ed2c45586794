//! The choice of a place: the posture model's prediction, corrected by the limit ratios measured in earlier handovers.

use equipoise_core::handover::experience::{Experience, LimitRatio};
use equipoise_core::handover::{self, Body, FootPlacement, Part, Prediction};
use nalgebra::Vector3;

use equipoise_simulator::cobot::trial::{PART_KG, WIDTH_M};

use crate::handover::grid;

/// A place that was not reached excludes those within this distance, m.
const EXCLUDED_M: f64 = 0.075;
/// The part that is handed over.
const PART: Part = Part { mass_kg: PART_KG, mass_sigma_kg: 0.0, width_m: WIDTH_M };

/// A place with its corrected limit ratio of the worst joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// Station's world, m.
    pub at_m: Vector3<f64>,
    /// Corrected limit ratio.
    pub corrected: LimitRatio,
}

/// Places, predictions and experience for one worker, whose feet stay where they are.
#[derive(Debug, Clone)]
pub struct Planner {
    body: Body,
    feet: FootPlacement,
    places: Vec<(Vector3<f64>, Prediction)>,
    experience: Experience,
}

impl Planner {
    /// A planner for the places in front of the worker that the cobot `permits`: those of `equipoise-study handover`,
    /// station's world.
    pub fn new(body: Body, feet: FootPlacement, permits: impl Fn(&Vector3<f64>) -> bool) -> Planner {
        let mut planner = Planner { body, feet, places: Vec::new(), experience: Experience::default() };
        let permitted = grid().filter(permits);
        planner.places = permitted.filter_map(|at_m| Some((at_m, planner.predict(at_m)?))).collect();
        planner
    }

    /// Prediction of the posture model; `None` for an infeasible place.
    fn predict(&self, at_m: Vector3<f64>) -> Option<Prediction> {
        handover::predict(&self.body, &self.feet, &PART, at_m).ok()
    }

    /// A place and its corrected limit ratio.
    fn corrected(&self, at_m: Vector3<f64>, model: &Prediction) -> Choice {
        let corrected = self.experience.correct(at_m, model.worst_with_sigma());
        Choice { at_m, corrected }
    }

    /// Adds the limit ratio measured at a place. One at an infeasible place has no prediction to compare with.
    pub fn observe(&mut self, at_m: Vector3<f64>, measured: LimitRatio) {
        if let Some(model) = self.predict(at_m) {
            self.experience.observe(at_m, model.worst_limit_ratio(), measured);
        }
    }

    /// Excludes a place that the worker did not reach.
    pub fn exclude(&mut self, at_m: Vector3<f64>) {
        self.places.retain(|(place_m, _)| (place_m - at_m).norm() > EXCLUDED_M);
    }

    /// The place with the lowest corrected limit ratio less `optimism` σ; `None` if all are infeasible or excluded.
    pub fn best(&self, optimism: f64) -> Option<Choice> {
        let value = |choice: &Choice| choice.corrected.value - optimism * choice.corrected.sigma;
        let all = self.places.iter().map(|(at_m, model)| self.corrected(*at_m, model));
        all.min_by(|a, b| value(a).total_cmp(&value(b)))
    }

    /// The best place, if it is better than `from_m` by more than σ as in `clients/python/handover.py`.
    pub fn better_than(&self, from_m: Vector3<f64>) -> Option<Choice> {
        let best = self.best(0.0)?;
        let Some(model) = self.predict(from_m) else { return Some(best) };
        let there = self.predict(best.at_m)?;
        let predicted = [model, there].map(|model| model.worst_with_sigma());
        let gain = self.experience.difference([from_m, best.at_m], predicted);
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
        let subject = Subject::somebody(6);
        let mut session = Session::new(&subject, subject.settings());
        session.identify_by_windows(4);
        let body = session.memory().identification.handover_body(session.settings(), Default::default());
        Planner::new(body, FootPlacement::natural(subject.height_m), |_| true)
    }

    #[test]
    fn the_best_place_follows_the_measurements_and_excluded_places_are_left_out() {
        let mut planner = planner();
        let best = planner.best(0.0).unwrap();
        assert!(planner.better_than(Vector3::new(0.6, 0.0, 1.05)).is_some());
        assert_eq!(planner.better_than(best.at_m), None);
        for _ in 0..3 {
            let measured = LimitRatio { value: 2.0 * best.corrected.value, sigma: 0.02 };
            planner.observe(best.at_m, measured);
        }
        let next = planner.best(0.0).unwrap();
        assert!((next.at_m - best.at_m).norm() > 0.1, "{best:?} {next:?}");
        planner.exclude(next.at_m);
        assert_ne!(planner.best(0.0).unwrap().at_m, next.at_m);
    }
}
