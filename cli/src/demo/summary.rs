//! What the demonstration showed, for people and for programs.

use std::collections::BTreeMap;
use std::fmt;

use equipoise_daemon::pipeline::Summary;
use equipoise_latency::Report;
use equipoise_view::page::{LiftResult, SimulatedHuman};
use serde::Serialize;

use super::cobot::summary::CobotSummary;
use super::lift::{BOXES_KG, JOINTS_SHOWN, JointSums, LiftSums, Peak};
use super::scene::Script;

/// What one pass of the demonstration showed.
#[derive(Debug, Clone, Serialize)]
pub struct DemoSummary {
    /// Whether everything was shown: identified, checked, lifted or handed over.
    pub complete: bool,
    /// Stature of the simulated human, m.
    pub height_m: f64,
    /// Body mass of the simulated human, kg.
    pub mass_kg: f64,
    /// Held poses that entered the filter.
    pub poses_used: u32,
    /// How long identification took, s.
    pub identified_after_s: f64,
    /// Predicted standard deviation of the CoP over the library of poses, mm.
    pub predicted_cop_sigma_mm: f64,
    /// Estimated versus measured CoP, unloaded, in poses not used for identification.
    pub unloaded_cop: CopError,
    /// The boxes in turn; none with a cobot.
    pub lifts: Vec<Lift>,
    /// The handovers by a cobot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cobot: Option<CobotSummary>,
    /// Cycles, slots, deadlines.
    pub cycles: u64,
    /// Slots of the schedule that passed without a cycle.
    pub slots_skipped: u64,
    /// Cycles whose state was ready only after the next was due.
    pub deadlines_missed: u64,
    /// Whether `elapsed / period == cycles + slots_skipped`.
    pub schedule_adds_up: bool,
    /// Latency by stage, ns.
    pub latency: Report,
    /// SCHED_FIFO priority that the loop was granted; 0 without real time.
    pub loop_fifo_priority: u32,
}

/// Error of the estimated CoP while still and unloaded.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct CopError {
    /// Suit samples compared.
    pub samples: u64,
    /// Root mean square forward, mm.
    pub forward_mm: f64,
    /// Root mean square sideways, mm.
    pub sideways_mm: f64,
    /// Root mean square of the distance, mm.
    pub distance_mm: f64,
    /// Range of the measured CoP over the whole session, forward and sideways, mm.
    pub cop_range_mm: [f64; 2],
    /// `distance_mm` over the diagonal of that range, per cent.
    ///
    /// The paper states 16.17 % without its formula; this is one reading of it, and no comparison.
    pub percent: f64,
}

/// While lifting one box.
#[derive(Debug, Clone, Serialize)]
pub struct Lift {
    /// True mass of the box from the simulator, kg; 0 if it was never lifted completely with a published mass.
    pub mass_kg: f64,
    /// Mean published mass, kg.
    pub lifted_mass_kg: f64,
    /// Mean published 1-σ of it, kg.
    pub lifted_mass_sigma_kg: f64,
    /// Suit samples with valid torques.
    pub samples: u64,
    /// Mean published vertical external force, N.
    pub delta_f_n: f64,
    /// Mean published 1-σ of it, N.
    pub delta_f_sigma_n: f64,
    /// Mean true one, with the inertia of the box, N.
    pub delta_f_true_n: f64,
    /// Joints, right side.
    pub joints: Vec<JointTorque>,
    /// For each level, suit samples in which a joint has it.
    pub levels: BTreeMap<&'static str, u64>,
    /// When a joint came closest to its limit; absent without a decided level.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peak: Option<PeakTorque>,
}

/// The instant at which a joint came closest to its limit.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct PeakTorque {
    /// MVN's name of the joint.
    pub name: &'static str,
    /// Published level.
    pub level: &'static str,
    /// Published torque, N m.
    pub torque_nm: f64,
    /// Published 1-σ, N m.
    pub sigma_nm: f64,
    /// True torque, from the simulator, N m.
    pub true_nm: f64,
    /// Published torque limit, N m.
    pub limit_nm: f64,
}

/// One joint while lifting, means over the samples, N m.
#[derive(Debug, Clone, Serialize)]
pub struct JointTorque {
    /// Plain name.
    pub joint: &'static str,
    /// MVN's name.
    pub name: &'static str,
    /// Published magnitude.
    pub torque_nm: f64,
    /// True magnitude, from the simulator.
    pub true_nm: f64,
    /// Published 1-σ.
    pub sigma_nm: f64,
    /// Root mean square of the vector difference.
    pub error_nm: f64,
    /// Largest published magnitude.
    pub torque_max_nm: f64,
    /// Largest true magnitude.
    pub true_max_nm: f64,
}

impl DemoSummary {
    pub(super) fn of(script: &Script, human: SimulatedHuman, pipeline: &Summary) -> DemoSummary {
        let unloaded_cop = cop_error(script);
        let lifts: Vec<Lift> = script.lifts.iter().map(Lift::of).collect();
        let loop_thread = pipeline.threads.iter().find(|report| report.thread == "loop");
        let cobot = script.handovers.as_ref().map(CobotSummary::of);
        let all_lifted = || lifts.len() == BOXES_KG.len() && script.lifts.iter().all(LiftSums::is_complete);
        DemoSummary {
            complete: unloaded_cop.samples > 0
                && cobot.as_ref().map_or_else(all_lifted, CobotSummary::is_complete),
            height_m: human.height_m,
            mass_kg: human.mass_kg,
            poses_used: script.poses_used,
            identified_after_s: script.identified_after_s,
            predicted_cop_sigma_mm: script.predicted_sigma_m * 1e3,
            unloaded_cop,
            lifts,
            cobot,
            cycles: pipeline.cycles.cycles,
            slots_skipped: pipeline.cycles.slots_skipped,
            deadlines_missed: pipeline.cycles.deadlines_missed,
            schedule_adds_up: pipeline.cycles.adds_up,
            latency: pipeline.latency.clone(),
            loop_fifo_priority: loop_thread.map_or(0, |report| report.granted.fifo_priority),
        }
    }
}

impl Lift {
    fn of(sums: &LiftSums) -> Lift {
        let samples = sums.samples.max(1.0);
        let mass_samples = sums.mass.samples.max(1.0);
        let joint = |((joint, name), sums): (&(&'static str, &'static str), &JointSums)| JointTorque {
            joint,
            name,
            torque_nm: sums.published_nm / samples,
            true_nm: sums.true_nm / samples,
            sigma_nm: sums.sigma_nm / samples,
            error_nm: (sums.error_nm2 / samples).sqrt(),
            torque_max_nm: sums.published_max_nm,
            true_max_nm: sums.true_max_nm,
        };
        Lift {
            mass_kg: sums.mass.true_kg / mass_samples,
            lifted_mass_kg: sums.mass.published_kg / mass_samples,
            lifted_mass_sigma_kg: sums.mass.sigma_kg / mass_samples,
            samples: sums.samples as u64,
            delta_f_n: sums.delta_f_n / samples,
            delta_f_sigma_n: sums.delta_f_sigma_n / samples,
            delta_f_true_n: sums.delta_f_true_n / samples,
            joints: JOINTS_SHOWN.iter().zip(&sums.joints).map(joint).collect(),
            levels: sums.levels.iter().map(|(level, samples)| (level.name(), *samples)).collect(),
            peak: sums.peak.map(PeakTorque::of),
        }
    }
}

impl PeakTorque {
    fn of(peak: Peak) -> PeakTorque {
        PeakTorque {
            name: peak.joint.name(),
            level: peak.level.name(),
            torque_nm: peak.torque_nm,
            sigma_nm: peak.sigma_nm,
            true_nm: peak.true_nm,
            limit_nm: peak.limit_nm,
        }
    }
}

/// Results of the lifts so far, for the page; a lift without a published mass and level has none.
pub(super) fn page_results(script: &Script, human: SimulatedHuman) -> Vec<LiftResult> {
    let result = |(sums, box_kg): (&LiftSums, &f64)| {
        let (lift, peak) = (Lift::of(sums), sums.peak?);
        (sums.mass.samples > 0.0).then_some(LiftResult {
            human: SimulatedHuman { box_kg: Some(*box_kg), ..human },
            load_kg: lift.lifted_mass_kg,
            load_sigma_kg: lift.lifted_mass_sigma_kg,
            joint: peak.joint.name(),
            level: peak.level.name(),
            torque_nm: peak.torque_nm,
            torque_sigma_nm: peak.sigma_nm,
        })
    };
    script.lifts.iter().zip(&BOXES_KG).filter_map(result).collect()
}

fn cop_error(script: &Script) -> CopError {
    let sums = &script.unloaded;
    let samples = sums.samples.max(1.0);
    let square = |axis: usize| sums.error_m2[axis] / samples;
    let distance = (square(0) + square(1)).sqrt();
    let [range_x, range_y] = script.cop_range.extent_m();
    let range = range_x.hypot(range_y);
    CopError {
        samples: sums.samples as u64,
        forward_mm: square(0).sqrt() * 1e3,
        sideways_mm: square(1).sqrt() * 1e3,
        distance_mm: distance * 1e3,
        cop_range_mm: [range_x * 1e3, range_y * 1e3],
        percent: if range > 0.0 { 100.0 * distance / range } else { 0.0 },
    }
}

impl fmt::Display for DemoSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let cop = &self.unloaded_cop;
        writeln!(
            f,
            "{:.2} m, {:.0} kg: identified with {} poses in {:.0} s; predicted CoP standard deviation {:.1} mm",
            self.height_m,
            self.mass_kg,
            self.poses_used,
            self.identified_after_s,
            self.predicted_cop_sigma_mm
        )?;
        let [forward_mm, sideways_mm] = cop.cop_range_mm;
        writeln!(
            f,
            "unloaded CoP error in new poses: {:.1} mm forward, {:.1} mm sideways, {:.1} mm; {:.0} % of the diagonal of its \
             range ({forward_mm:.0} x {sideways_mm:.0} mm)",
            cop.forward_mm, cop.sideways_mm, cop.distance_mm, cop.percent
        )?;
        match &self.cobot {
            Some(cobot) => write!(f, "{cobot}")?,
            None => self.fmt_lifts(f)?,
        }
        writeln!(
            f,
            "\n{} cycles, {} deadlines missed, {} slots skipped, loop at {}",
            self.cycles,
            self.deadlines_missed,
            self.slots_skipped,
            match self.loop_fifo_priority {
                0 => "ordinary priority".to_owned(),
                priority => format!("SCHED_FIFO {priority}"),
            }
        )?;
        write!(f, "{}", self.latency)
    }
}

impl DemoSummary {
    /// A column for each box: published ± 1-σ, and the true value.
    fn fmt_lifts(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let line = |f: &mut fmt::Formatter<'_>, label: &str, cell: &dyn Fn(&Lift) -> String| {
            let cells: String = self.lifts.iter().map(|lift| format!("{:>22}", cell(lift))).collect();
            writeln!(f, "  {label:<10}{cells}")
        };
        let value =
            |published: f64, sigma: f64, real: f64| format!("{published:.1} ± {sigma:.1} ({real:.1})");
        writeln!(f, "\npublished ± 1-sigma (true); torques of the right side, N m, mean of the lift")?;
        line(f, "load, kg", &|lift| value(lift.lifted_mass_kg, lift.lifted_mass_sigma_kg, lift.mass_kg))?;
        for (index, (joint, _)) in JOINTS_SHOWN.iter().enumerate() {
            line(f, joint, &|lift| {
                let joint = &lift.joints[index];
                value(joint.torque_nm, joint.sigma_nm, joint.true_nm)
            })?;
        }
        line(f, "level", &|lift| lift.peak.map_or("-", |peak| peak.level).to_owned())
    }
}
