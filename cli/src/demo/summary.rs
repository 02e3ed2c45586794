//! What the demonstration showed, for people and for programs.

use std::fmt;

use equipoise_core::overload::GRAVITY_M_PER_S2;
use equipoise_daemon::pipeline::Summary;
use equipoise_latency::Report;
use serde::Serialize;

use super::scene::{BOX_KG, JOINTS_SHOWN, Script};

/// What the demonstration showed.
#[derive(Debug, Clone, Serialize)]
pub struct DemoSummary {
    /// Whether everything was shown: identified, checked, lifted.
    pub complete: bool,
    /// Held poses that entered the filter.
    pub poses_used: u32,
    /// How long identification took, s.
    pub identified_after_s: f64,
    /// Predicted standard deviation of the CoP over the library of poses, mm.
    pub predicted_cop_sigma_mm: f64,
    /// Estimated versus measured CoP, unloaded, in poses not used for identification.
    pub unloaded_cop: CopError,
    /// The box.
    pub lift: Lift,
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

/// While lifting.
#[derive(Debug, Clone, Serialize)]
pub struct Lift {
    /// What was lifted, kg.
    pub mass_kg: f64,
    /// Suit samples with valid torques.
    pub samples: u64,
    /// Mean published external force, N.
    pub delta_f_n: f64,
    /// The box's weight, N.
    pub delta_f_true_n: f64,
    /// Joints, right side.
    pub joints: Vec<JointTorque>,
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
    pub(super) fn of(script: Script, pipeline: &Summary) -> DemoSummary {
        let samples = script.loaded_samples.max(1.0);
        let joints = JOINTS_SHOWN
            .iter()
            .zip(&script.joints)
            .map(|((joint, name), sums)| JointTorque {
                joint,
                name,
                torque_nm: sums.published_nm / samples,
                true_nm: sums.true_nm / samples,
                sigma_nm: sums.sigma_nm / samples,
                error_nm: (sums.error_nm2 / samples).sqrt(),
                torque_max_nm: sums.published_max_nm,
                true_max_nm: sums.true_max_nm,
            })
            .collect();
        let unloaded_cop = cop_error(&script);
        let loop_thread = pipeline.threads.iter().find(|report| report.thread == "loop");
        DemoSummary {
            complete: unloaded_cop.samples > 0 && script.loaded_samples > 0.0,
            poses_used: script.poses_used,
            identified_after_s: script.identified_after_s,
            predicted_cop_sigma_mm: script.predicted_sigma_m * 1e3,
            unloaded_cop,
            lift: Lift {
                mass_kg: BOX_KG,
                samples: script.loaded_samples as u64,
                delta_f_n: script.delta_f_n / samples,
                delta_f_true_n: BOX_KG * GRAVITY_M_PER_S2,
                joints,
            },
            cycles: pipeline.cycles.cycles,
            slots_skipped: pipeline.cycles.slots_skipped,
            deadlines_missed: pipeline.cycles.deadlines_missed,
            schedule_adds_up: pipeline.cycles.adds_up,
            latency: pipeline.latency.clone(),
            loop_fifo_priority: loop_thread.map_or(0, |report| report.granted.fifo_priority),
        }
    }
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
            "identified with {} poses in {:.0} s; predicted CoP standard deviation {:.1} mm",
            self.poses_used, self.identified_after_s, self.predicted_cop_sigma_mm
        )?;
        writeln!(
            f,
            "unloaded CoP error in new poses: {:.1} mm forward, {:.1} mm sideways, {:.1} mm",
            cop.forward_mm, cop.sideways_mm, cop.distance_mm
        )?;
        let [forward_mm, sideways_mm] = cop.cop_range_mm;
        writeln!(
            f,
            "range of the CoP in this session: {forward_mm:.0} mm forward, {sideways_mm:.0} mm sideways; the error is {:.0} % of its \
             diagonal",
            cop.percent
        )?;
        writeln!(
            f,
            "\nlifting {} kg: external force {:.1} N, true {:.1} N ({} samples with valid torques)",
            self.lift.mass_kg, self.lift.delta_f_n, self.lift.delta_f_true_n, self.lift.samples
        )?;
        writeln!(f, "  joint       published    1-sigma       true      error")?;
        for joint in &self.lift.joints {
            writeln!(
                f,
                "  {:<10} {:>10.1} {:>10.1} {:>10.1} {:>10.1}",
                joint.joint, joint.torque_nm, joint.sigma_nm, joint.true_nm, joint.error_nm
            )?;
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
