//! What the handovers showed, for people and for programs.

use std::fmt;

use equipoise_studies::cobot::course::Purpose;
use equipoise_studies::handover::PART_KG;
use serde::Serialize;

use super::{Handover, Handovers};

/// What the handovers of one pass showed.
#[derive(Debug, Clone, Serialize)]
pub struct CobotSummary {
    /// Mass of the part, kg.
    pub part_kg: f64,
    /// At the fixed place; absent without a measurement.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub before: Option<HandoverResult>,
    /// Where the controller learned.
    pub learning: Vec<HandoverResult>,
    /// At the planned place, which is the fixed one if no other is better by more than σ; absent without a measurement.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub after: Option<HandoverResult>,
    /// Reduction of the published limit ratio, per cent of that before.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reduction_percent: Option<f64>,
    /// The same of the true limit ratio.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub true_reduction_percent: Option<f64>,
}

/// One handover; limit ratios are those of the worst joint, means of the hold.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct HandoverResult {
    /// Place of the part, station's world, m.
    pub place_m: [f64; 3],
    /// Published torque over its limit.
    pub limit_ratio: f64,
    /// Published 1-σ of it.
    pub limit_ratio_sigma: f64,
    /// True torque over its limit, from the simulator.
    pub true_limit_ratio: f64,
}

impl CobotSummary {
    pub(in super::super) fn of(handovers: &Handovers) -> CobotSummary {
        let all = |purpose: Purpose| {
            let of_purpose = handovers.done.iter().filter(move |handover| handover.purpose == purpose);
            of_purpose.map(HandoverResult::of)
        };
        let [before, after] = [Purpose::Baseline, Purpose::Assisted].map(|purpose| all(purpose).next());
        let reduction =
            |ratio: fn(HandoverResult) -> f64| Some(100.0 * (1.0 - ratio(after?) / ratio(before?)));
        CobotSummary {
            part_kg: PART_KG,
            before,
            learning: all(Purpose::Learning).collect(),
            after,
            reduction_percent: reduction(|result| result.limit_ratio),
            true_reduction_percent: reduction(|result| result.true_limit_ratio),
        }
    }

    /// Whether both handovers that are compared were measured.
    pub(in super::super) fn is_complete(&self) -> bool {
        self.before.is_some() && self.after.is_some()
    }
}

impl HandoverResult {
    fn of(handover: &Handover) -> HandoverResult {
        HandoverResult {
            place_m: handover.at_m.into(),
            limit_ratio: handover.held.measured,
            limit_ratio_sigma: handover.held.sigma,
            true_limit_ratio: handover.held.truth,
        }
    }
}

impl fmt::Display for HandoverResult {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.place_m;
        let [ratio, sigma, real] =
            [self.limit_ratio, self.limit_ratio_sigma, self.true_limit_ratio].map(|ratio| 100.0 * ratio);
        write!(
            f,
            "{x:5.2} m forward {y:5.2} m left {z:5.2} m up  {ratio:3.0} ± {sigma:.0} % of the limit ({real:.0})"
        )
    }
}

impl fmt::Display for CobotSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\npart of {} kg by the cobot; worst joint, published ± 1-sigma (true)", self.part_kg)?;
        let rows = [
            ("fixed", self.before.as_slice()),
            ("learning", &self.learning),
            ("assisted", self.after.as_slice()),
        ];
        for (label, results) in rows {
            for result in results {
                writeln!(f, "  {label:<10}{result}")?;
            }
        }
        if let (Some(published), Some(real)) = (self.reduction_percent, self.true_reduction_percent) {
            writeln!(f, "  reduction {published:.0} % ({real:.0})")?;
        }
        Ok(())
    }
}
