//! Selects the next pose and evaluates the uncertainty of the CoP over the poses of the work: a small part of both in
//! every cycle, so that no cycle is long.

use super::{Identification, NO_POSE};
use crate::cycle::foot_outline;
use crate::cycle::settings::{PoseChoice, Settings};
use crate::cycle::support::is_supported;
use crate::math;
use crate::message::SuitBody;
use crate::pose_suggestion::gain::{a_gain, d_gain, i_gain};
use crate::pose_suggestion::{Posture, posture};
use crate::sesc::centre_of_mass;
use crate::time::NS_PER_S;

/// A pose suggested for this long, in suit time, without being held counts as impossible for the subject, ns.
const SUGGESTION_TIMEOUT_NS: u64 = 20 * NS_PER_S;
/// The CoM of a suggested pose must lie this far inside the foot outlines, m: about the error of a prior.
const BALANCE_MARGIN_M: f64 = 0.015;

impl Identification {
    /// One step of planning: evaluates one pose of the library or one candidate, or checks how long the suggestion has
    /// been pending. Called once per cycle.
    ///
    /// `suit_time_ns` is the newest suit sample's; `stands` is whether a person stands on the plate, otherwise the time
    /// does not count. `body` is the body reported by the suit.
    pub fn plan_step(
        &mut self,
        suit_time_ns: u64,
        stands: bool,
        body: Option<&SuitBody>,
        settings: &Settings,
    ) {
        let size = settings.library.len();
        if !self.has_body() || size == 0 {
            return;
        }
        if let Some(index) = self.planner.next_pose(size) {
            let pose = posture::pose_of(&settings.library[index], &self.skeleton(), [0.0; 3]);
            self.planner.add_pose(&self.reduction.rows(&pose, [0.0; 2]), size);
            self.update_predicted_cop_sigma(settings);
        } else if self.identified == 1 || self.identifying == 0 {
            self.suggested = NO_POSE;
        } else if self.suggested != NO_POSE {
            self.check_suggestion_timeout(suit_time_ns, stands);
        } else {
            self.evaluate_candidate(suit_time_ns, body, settings);
        }
    }

    /// Marks the suggested pose as impossible for the subject and selects another. `false` if none was suggested.
    pub fn skip_pose(&mut self) -> bool {
        let suggested = self.suggested;
        if suggested == NO_POSE {
            return false;
        }
        self.planner.mark_unholdable(suggested);
        self.withdraw_suggestion();
        true
    }

    /// Withdraws the suggestion; the next cycles select another.
    pub(in crate::cycle) fn withdraw_suggestion(&mut self) {
        self.suggested = NO_POSE;
        self.planner.begin_sweep();
    }

    /// Root mean square of the predicted 1-σ of the CoP over the library and both axes in this stance, including the
    /// model error, m; 0 while unavailable.
    pub(in crate::cycle) fn update_predicted_cop_sigma(&mut self, settings: &Settings) {
        let [forward_m2, sideways_m2] = self.misfit_variance_m2();
        self.predicted_cop_sigma_m = if self.has_evaluated_library(settings) {
            math::hypot([self.parameter_sigma_m(), math::sqrt(0.5 * (forward_m2 + sideways_m2))])
        } else {
            0.0
        };
    }

    /// The part of it from P, m.
    pub(super) fn parameter_sigma_m(&self) -> f64 {
        math::sqrt(self.filter.mean_variance_m2(self.planner.weight(), self.planner.mean_row()))
    }

    /// Whether all poses of the work have been evaluated.
    pub(super) fn has_evaluated_library(&self, settings: &Settings) -> bool {
        self.has_body() && self.planner.next_pose(settings.library.len()).is_none()
    }

    fn check_suggestion_timeout(&mut self, suit_time_ns: u64, stands: bool) {
        let waits = stands && self.identifying == 1;
        if !waits || self.suggested_ns == 0 {
            self.suggested_ns = suit_time_ns;
        } else if suit_time_ns.saturating_sub(self.suggested_ns) > SUGGESTION_TIMEOUT_NS {
            self.skip_pose();
        }
    }

    fn evaluate_candidate(&mut self, suit_time_ns: u64, body: Option<&SuitBody>, settings: &Settings) {
        match self.planner.candidate(settings.library.len()) {
            Some(index) => {
                let (gain, balanced) = self.candidate_gain(index, &settings.library[index], body, settings);
                self.planner.ingest_gain(index, gain, balanced);
            }
            None => {
                self.suggested = self.planner.select().map_or(NO_POSE, |index| index as u64);
                self.planner.begin_sweep();
                self.suggested_ns = suit_time_ns;
            }
        }
    }

    /// Gain of a candidate, and whether this subject keeps balance in it.
    fn candidate_gain(
        &self,
        index: usize,
        posture: &Posture,
        body: Option<&SuitBody>,
        settings: &Settings,
    ) -> (f64, bool) {
        let pose = posture::pose_of(posture, &self.skeleton(), [0.0; 3]);
        let centre = centre_of_mass(&pose, &self.phi());
        let outlines = foot_outline::both(&pose, body, settings.height_m);
        let balanced = is_supported(&pose, [centre.x, centre.y], &outlines, -BALANCE_MARGIN_M);
        // The library's first pose is the one to start from: any person can hold it.
        if self.performed.count() == 0 && index == 0 {
            return (f64::MAX, balanced);
        }
        let rows = self.reduction.rows(&pose, [0.0; 2]);
        let body_m2 = settings.measurement_sigma_m * settings.measurement_sigma_m;
        let variance_m2 = self.drift_variance_m2(&pose, settings).map(|suit_m2| suit_m2 + body_m2);
        let gain = match settings.pose_choice {
            PoseChoice::Paper => {
                let variance = self.reduction.raw_variance(|index| self.filter.variance_m2(index));
                self.performed.distance(posture, &variance)
            }
            PoseChoice::DOptimal => d_gain(&self.filter, &rows, variance_m2),
            PoseChoice::AOptimal => a_gain(&self.filter, &rows, variance_m2),
            PoseChoice::IOptimal => i_gain(&self.filter, self.planner.weight(), &rows, variance_m2),
        };
        (gain, balanced)
    }
}
