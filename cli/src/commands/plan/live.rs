//! The plan of a running daemon.

use anyhow::{Context, bail};
use bytemuck::Zeroable;
use equipoise_bus::parse_text;
use equipoise_core::body::Joint;
use equipoise_core::handover::Infeasible;
use equipoise_core::handover::experience::LimitRatio;
use equipoise_core::handover::search::PlacePrediction;
use equipoise_core::message::handover::{CurrentFrame, CurrentStatus, HandoverRefusal};
use equipoise_core::message::{HandoverPlan, HandoverRequest, Validity};

use super::{HandoverArguments, Plan, infeasible, mass_unknown};
use crate::client;

/// For the worker who stands at the station.
pub(super) fn plan(station: &str, id: &str, arguments: &HandoverArguments) -> anyhow::Result<Plan> {
    let request = HandoverRequest {
        mass_kg: arguments.mass,
        width_m: arguments.width,
        current_m: arguments.now.unwrap_or_default().into(),
        current_frame: arguments.now.map_or(CurrentFrame::None, |_| CurrentFrame::Feet) as u32,
        ..HandoverRequest::zeroed()
    };
    let plan = client::plan_handover(station, &request)?;
    let subject = parse_text(&plan.subject);
    if !subject.is_empty() && subject != id {
        bail!("{id} is not the subject at the station, {subject}: run `equipoise subject load {id}`");
    }
    if plan.refused != HandoverRefusal::None as u32 {
        bail!(why_refused(&plan, id, arguments.mass));
    }
    if subject.is_empty() {
        bail!("the person at the station is unnamed, not {id}: run `equipoise subject load {id}`");
    }
    let ratio = |joint: u32, value: f64, sigma: f64| {
        let joint = Joint::ALL.get(joint as usize).context("the daemon's plan names no joint")?;
        anyhow::Ok((*joint, LimitRatio { value, sigma }))
    };
    let best = ratio(plan.worst_joint, plan.limit_ratio, plan.limit_ratio_sigma)?;
    let now = match CurrentStatus::from_number(plan.current_status) {
        Some(CurrentStatus::Predicted) => {
            let (value, sigma) = (plan.current_limit_ratio, plan.current_limit_ratio_sigma);
            Some(Ok(ratio(plan.current_worst_joint, value, sigma)?))
        }
        Some(CurrentStatus::OutOfReach) => Some(Err(Infeasible::OutOfReach)),
        Some(CurrentStatus::OutOfBalance) => Some(Err(Infeasible::OutOfBalance)),
        Some(CurrentStatus::None) | None => None,
    };
    Ok(Plan {
        best: PlacePrediction {
            place_m: plan.place_m.into(),
            position_m: plan.position_m.into(),
            slope_rad: Some(plan.slope_rad),
            predicted: Ok(best),
        },
        feet_heading_rad: plan.feet_heading_rad,
        now: arguments.now.zip(now),
        handovers: plan.handovers as usize,
        map: Vec::new(),
    })
}

fn why_refused(plan: &HandoverPlan, id: &str, mass_kg: f64) -> String {
    match HandoverRefusal::from_number(plan.refused) {
        Some(HandoverRefusal::NotIdentified) => {
            format!("{id} is not identified yet; see `equipoise identify`")
        }
        Some(HandoverRefusal::MassUnknown) => mass_unknown(id),
        Some(HandoverRefusal::Infeasible) => infeasible(id, mass_kg),
        Some(HandoverRefusal::Stale) => {
            "the daemon has no state newer than 50 ms; see `equipoise status`, or plan without --live"
                .to_owned()
        }
        Some(HandoverRefusal::Invalid) => {
            let names: Vec<&str> = Validity(plan.valid).names().collect();
            format!(
                "the position of the worker's feet is not available: {}; see `equipoise status`, or plan without --live",
                names.join(", ")
            )
        }
        Some(HandoverRefusal::None | HandoverRefusal::Request) | None => {
            format!("the daemon refused the request, reason {}: is it of this version?", plan.refused)
        }
    }
}
