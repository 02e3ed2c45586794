//! What the handovers showed, for people and for programs.

use std::fmt;

use equipoise_core::message::HandoverPlan;
use equipoise_core::message::handover::CurrentStatus;
use serde::Serialize;

use super::{Handover, Handovers, PART_KG};

/// What the handovers of one pass showed.
#[derive(Debug, Clone, Serialize)]
pub struct CobotSummary {
    /// Mass of the part, kg.
    pub part_kg: f64,
    /// At the fixed place; absent without a measurement.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fixed: Option<HandoverResult>,
    /// The plan of the daemon after that.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plan: Option<PlanResult>,
    /// At the planned place, or the nearest to it in the cobot's workspace; absent without a measurement.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub assisted: Option<HandoverResult>,
    /// From fixed to assisted, as published.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub published: Option<Change>,
    /// The same of the true limit ratio.
    #[serde(rename = "true", skip_serializing_if = "Option::is_none")]
    pub real: Option<Change>,
}

/// One handover; limit ratios are those of the worst joint, means of the hold.
#[derive(Debug, Clone, Serialize)]
pub struct HandoverResult {
    /// Place of the part, station's world, m.
    pub place_m: [f64; 3],
    /// Slope of the handles, rad; absent for handles that turn with the hands.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slope_rad: Option<f64>,
    /// MVN's name of the worst joint, as published.
    pub joint: &'static str,
    /// Published torque over its limit.
    pub limit_ratio: f64,
    /// Published 1-σ of it.
    pub limit_ratio_sigma: f64,
    /// True torque over its limit, from the simulator.
    pub true_limit_ratio: f64,
}

/// A plan of the daemon.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct PlanResult {
    /// Planned place, station's world, m.
    pub position_m: [f64; 3],
    /// Planned slope of the handles, rad.
    pub slope_rad: f64,
    /// Number of measured handovers that correct the prediction.
    pub handovers: u32,
    /// Predicted limit ratio of the worst joint there, and 1-σ.
    pub limit_ratio: [f64; 2],
    /// The same at the fixed place; absent if the part cannot be held there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fixed_limit_ratio: Option<[f64; 2]>,
}

/// Change of the worst joint's limit ratio.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Change {
    /// Whether the assisted handover has the lower one.
    pub fell: bool,
    /// Reduction, per cent of that at the fixed place; negative for a rise.
    pub reduction_percent: f64,
    /// Whether the difference exceeds its 1-σ, with independent errors of both; absent for the true values.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exceeds_sigma: Option<bool>,
}

impl CobotSummary {
    pub(in super::super) fn of(handovers: &Handovers) -> CobotSummary {
        let [fixed, assisted] =
            [&handovers.fixed, &handovers.assisted].map(|handover| handover.map(HandoverResult::of));
        let (published, real) = fixed.as_ref().zip(assisted.as_ref()).map(changes).unzip();
        let plan = handovers.plan.as_ref().map(PlanResult::of);
        CobotSummary { part_kg: PART_KG, fixed, plan, assisted, published, real }
    }

    /// Whether both handovers that are compared were measured.
    pub(in super::super) fn is_complete(&self) -> bool {
        self.published.is_some()
    }
}

/// The published and the true change.
fn changes((fixed, assisted): (&HandoverResult, &HandoverResult)) -> (Change, Change) {
    let change = |[before, after]: [f64; 2], sigma: Option<f64>| Change {
        fell: after < before,
        reduction_percent: 100.0 * (1.0 - after / before),
        exceeds_sigma: sigma.map(|sigma| (before - after).abs() > sigma),
    };
    let sigma = fixed.limit_ratio_sigma.hypot(assisted.limit_ratio_sigma);
    let published = change([fixed.limit_ratio, assisted.limit_ratio], Some(sigma));
    (published, change([fixed.true_limit_ratio, assisted.true_limit_ratio], None))
}

impl HandoverResult {
    fn of(Handover { place_m, slope_rad, held }: Handover) -> HandoverResult {
        HandoverResult {
            place_m: place_m.into(),
            slope_rad,
            joint: held.joint.name(),
            limit_ratio: held.ratio.value,
            limit_ratio_sigma: held.ratio.sigma,
            true_limit_ratio: held.truth,
        }
    }
}

impl PlanResult {
    fn of(plan: &HandoverPlan) -> PlanResult {
        let is_feasible = plan.current_status == CurrentStatus::Predicted as u32;
        PlanResult {
            position_m: plan.position_m,
            slope_rad: plan.slope_rad,
            handovers: plan.handovers,
            limit_ratio: [plan.limit_ratio, plan.limit_ratio_sigma],
            fixed_limit_ratio: is_feasible
                .then_some([plan.current_limit_ratio, plan.current_limit_ratio_sigma]),
        }
    }
}

impl fmt::Display for HandoverResult {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [ratio, sigma, real] =
            [self.limit_ratio, self.limit_ratio_sigma, self.true_limit_ratio].map(|ratio| 100.0 * ratio);
        write!(
            f,
            "{}  {ratio:3.0} ± {sigma:.0} % ({real:.0} %)  {}",
            PartPose(self.place_m, self.slope_rad),
            self.joint
        )
    }
}

/// Formats the position of a part and the slope of its handles.
struct PartPose([f64; 3], Option<f64>);

impl fmt::Display for PartPose {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.0;
        write!(f, "{x:.2} m forward, {y:5.2} m left, {z:.2} m up, ")?;
        match self.1 {
            Some(slope_rad) => write!(f, "sloped {:2.0}°", slope_rad.to_degrees()),
            None => write!(f, "turning   "),
        }
    }
}

impl fmt::Display for PlanResult {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [ratio, sigma] = self.limit_ratio.map(|ratio| 100.0 * ratio);
        write!(
            f,
            "{}  {ratio:3.0} ± {sigma:.0} % predicted",
            PartPose(self.position_m, Some(self.slope_rad))
        )?;
        if let Some(fixed) = self.fixed_limit_ratio {
            let [ratio, sigma] = fixed.map(|ratio| 100.0 * ratio);
            write!(f, ", {ratio:.0} ± {sigma:.0} % at the fixed place")?;
        }
        write!(f, "; measured handovers used: {}", self.handovers)
    }
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let change = -self.reduction_percent;
        write!(f, "{} ({change:+.0} %)", if self.fell { "fell" } else { "did not fall" })?;
        match self.exceeds_sigma {
            Some(true) => write!(f, ", more than 1 sigma"),
            Some(false) => write!(f, ", less than 1 sigma"),
            None => Ok(()),
        }
    }
}

impl fmt::Display for CobotSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "\npart of {} kg presented by the cobot: overload of the worst joint over its limit, published ± 1 sigma (true)",
            self.part_kg
        )?;
        let row = |f: &mut fmt::Formatter<'_>, label: &str, row: Option<&dyn fmt::Display>| match row {
            Some(row) => writeln!(f, "  {label:<10}{row}"),
            None => writeln!(f, "  {label:<10}not measured"),
        };
        row(f, "fixed", self.fixed.as_ref().map(|row| row as _))?;
        row(f, "plan", self.plan.as_ref().map(|row| row as _))?;
        row(f, "assisted", self.assisted.as_ref().map(|row| row as _))?;
        if let (Some(published), Some(real)) = (&self.published, &self.real) {
            writeln!(f, "  published it {published}; in truth it {real}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn result(limit_ratio: f64, true_limit_ratio: f64) -> HandoverResult {
        let (place_m, joint) = ([0.45, 0.0, 1.05], "L5S1");
        HandoverResult {
            place_m,
            slope_rad: None,
            joint,
            limit_ratio,
            limit_ratio_sigma: 0.03,
            true_limit_ratio,
        }
    }

    #[test]
    fn a_rise_is_reported_as_one_and_a_difference_is_compared_with_its_sigma() {
        let words = |before: HandoverResult, after: HandoverResult| {
            let (published, real) = changes((&before, &after));
            format!("published it {published}; in truth it {real}")
        };
        assert_eq!(
            words(result(0.5, 0.4), result(0.4, 0.44)),
            "published it fell (-20 %), more than 1 sigma; in truth it did not fall (+10 %)"
        );
        assert_eq!(
            words(result(0.40, 0.4), result(0.44, 0.3)),
            "published it did not fall (+10 %), less than 1 sigma; in truth it fell (-25 %)"
        );
    }
}
