//! The sections of the report: text, tables and drawings.

mod body;
mod load;
mod path;

use std::time::Duration;

use equipoise_config::method::StopConfig;
use equipoise_core::body::Joint;
use equipoise_core::overload::Level;
use equipoise_view::words;
use jiff::Timestamp;

use crate::constants::MINUTES_FROM_S;
use crate::report::document::{Figure, Section, Table, Text, code};
use crate::report::svg::{Axis, LegendKey, Mark, Plot, Scale, Style};

use super::document::{length, subject};
use super::exposure::Peak;
use super::gather::{Facts, Source};
use super::period::{Cause, Period};
use super::series::Series;
use super::strips::strips;

pub(super) use body::body;
pub(super) use load::{back, dose, lifts};
pub(super) use path::{latency, quality};

/// Limits of the interpretation of the torques.
const DISCLAIMER: &str = "Torques are what a load adds to each joint, by the method of Fortini et al. (2020). This is not a \
                          medical device and not a safety function.";

/// Metadata of the session.
pub(super) fn session(facts: &Facts) -> Section {
    let mut section = Section::new("Session");
    let header = &facts.header;
    let mut table = Table::new(&["item", "value"]);
    let mut row = |what: &str, value: Text| table.rows.push(vec![what.into(), value]);
    row("recording", code(facts.name.as_str()));
    if let Some(line) = &facts.authenticity {
        row("authenticity", line.clone().into());
    }
    row("station", code(facts.config.station.as_str()));
    row("subject", code(subject(facts)));
    row("begin", begin(facts).into());
    let [from_s, to_s] = facts.span_s.unwrap_or_default();
    row("states", format!("{}, t = {from_s:.3} s to {to_s:.3} s", facts.cycles).into());
    row("recorded with", software(&header.software_version).into());
    row("report made with", software(env!("CARGO_PKG_VERSION")).into());
    row("configuration", format!("{}; {} Hz", facts.config_origin, facts.config.tick.rate_hz).into());
    let model = if header.model_toml.is_empty() { "none" } else { "contained in the recording" };
    row("model file", model.into());
    let mass =
        if facts.mass_kg > 0.0 { format!("{:.1} kg", facts.mass_kg) } else { "unavailable".to_owned() };
    row("body mass at the end", mass.into());
    section.table(table);
    if facts.source == Source::Replayed {
        section.paragraph(
            "The states were computed from the samples by a replay through the same cycle, because the recording has no \
             states or another configuration was given.",
        );
    }
    if let Some(note) = several(facts) {
        section.paragraph(note);
        section.head("Workers");
        section.table(workers(facts));
    }
    section.note(DISCLAIMER);
    section
}

/// Wall-clock time of the recording's begin.
pub(super) fn begin(facts: &Facts) -> String {
    match facts.header.started_unix_ns {
        0 => "not in the recording".to_owned(),
        unix_ns => format!("{:.0}", Timestamp::UNIX_EPOCH + Duration::from_nanos(unix_ns)),
    }
}

/// A note if the numbers belong to several workers or shifts.
fn several(facts: &Facts) -> Option<String> {
    let begun_at = |(cause, what): (Cause, &str)| {
        let begun = facts.periods.iter().filter(|period| period.cause == Some(cause));
        let times: Vec<String> = begun.map(|period| format!("{:.1} s", begin_s(period))).collect();
        (!times.is_empty()).then(|| format!("{what} at t = {}", times.join(", ")))
    };
    let causes = [
        (Cause::Worker, "The worker changed"),
        (Cause::Load, "The profile of the same worker was loaded"),
        (Cause::Shift, "A new shift of the same worker began, or a restart of the daemon lost lifts,"),
    ];
    let begun: Vec<String> = causes.into_iter().filter_map(begun_at).collect();
    (!begun.is_empty()).then(|| {
        format!(
            "{}: times, peaks and largest fatigues are of all rows of the table Workers together; dose, risk and the final \
             values are of the last one, with what that worker's shift had before.",
            begun.join(". ")
        )
    })
}

/// Time of a period's first state, s since the start of the recording.
fn begin_s(period: &Period) -> f64 {
    period.span_s.unwrap_or_default()[0]
}

/// One row for each worker and shift.
fn workers(facts: &Facts) -> Table {
    let mut table = Table::new(&[
        "worker",
        ">from, s",
        ">to, s",
        ">torques reported",
        "closest to its limit",
        ">of the limit",
        ">high or overloaded",
        ">lifts",
        ">L5/S1 at most, N",
        ">risk",
    ]);
    for (index, period) in facts.periods.iter().enumerate() {
        let [from_s, to_s] = period.span_s.unwrap_or_default();
        let worst = period.exposure.worst();
        let peak = worst.and_then(|joint| period.exposure.joints[joint.index()].peak);
        let name = period.subject.clone().unwrap_or_else(|| (index + 1).to_string());
        table.rows.push(vec![
            name.into(),
            format!("{from_s:.1}").into(),
            format!("{to_s:.1}").into(),
            length(period.exposure.valid_s).into(),
            or_none(worst, |joint| words::joint(joint).to_owned()),
            or_none(peak, |peak| format!("{:.0} %", 100.0 * peak.limit_ratio)),
            length(period.high_s()).into(),
            period.lifts.lifts.len().to_string().into(),
            or_none(period.back.peak, |[peak_n, sigma_n, _]| format!("{peak_n:.0} ± {sigma_n:.0}")),
            or_none(period.back.dose, |[_, probability]| format!("{:.0} %", 100.0 * probability)),
        ]);
    }
    table
}

/// A release by its version.
pub(super) fn software(version: &str) -> String {
    if version.is_empty() { "unknown".to_owned() } else { format!("Equipoise {version}") }
}

/// Progress of the identification.
pub(super) fn identification(facts: &Facts) -> Section {
    let mut section = Section::new("Identification");
    let found = &facts.identification;
    let is_load = |period: &&Period| matches!(period.cause, Some(Cause::Worker | Cause::Load));
    let loaded_s = facts.periods.iter().rfind(is_load).map(begin_s);
    if let Some(loaded_s) = loaded_s {
        section.paragraph(format!(
            "The last worker was loaded at t = {loaded_s:.1} s; what follows is since then."
        ));
    }
    section.paragraph(match (found.identified_before, found.converged_s) {
        (true, _) if loaded_s.is_some() => "The worker was identified when loaded.".to_owned(),
        (true, _) => "The worker was identified when the recording began.".to_owned(),
        (false, Some(time_s)) if found.stopped => {
            format!(
                "Identification was stopped by a command at t = {time_s:.1} s; the stop rule was not met."
            )
        }
        (false, Some(time_s)) => format!("The stop rule was met at t = {time_s:.1} s."),
        (false, None) => "The stop rule was not met: the worker is not identified.".to_owned(),
    });
    if found.resets > 0 {
        section.paragraph(format!("It was reset {} times; the table is of the last run.", found.resets));
    }
    let mut table = Table::new(&[
        ">poses",
        ">t, s",
        "suggested pose",
        ">predicted CoP σ, mm",
        ">largest P_jj, m²",
        ">NIS",
    ]);
    for pose in &found.poses {
        table.rows.push(vec![
            pose.poses.to_string().into(),
            format!("{:.1}", pose.time_s).into(),
            pose.requested.unwrap_or("-").into(),
            or_none(pose.cop_sigma_m, |sigma_m| format!("{:.2}", 1e3 * sigma_m)),
            or_none(pose.variance_max_m2, |variance_m2| format!("{variance_m2:.2e}")),
            or_none(pose.nis, |nis| format!("{nis:.2}")),
        ]);
    }
    section.table(table);
    section.figures(convergence(facts));
    section.note(
        "NIS: the normalised innovation squared of each pose. It has two degrees of freedom: 2 on average, above 5.99 \
         in one pose of twenty, if the filter's σ is correct.",
    );
    if found.motion_samples > 0 {
        section.paragraph(format!("{} motion samples were used as well.", found.motion_samples));
    }
    if let Some(inflation) = found.prior_inflation.filter(|inflation| *inflation > 1.0) {
        section.paragraph(format!(
            "The prior did not fit this worker: its covariance was inflated {inflation:.1} times."
        ));
    }
    section
}

/// σ and P_jj over the number of poses.
fn convergence(facts: &Facts) -> Vec<Figure> {
    let poses = &facts.identification.poses;
    let points = |value: fn(&super::identification::Pose) -> Option<f64>| -> Vec<[f64; 2]> {
        poses.iter().filter_map(|pose| Some([f64::from(pose.poses), value(pose)?])).collect()
    };
    let method = &facts.config.identification;
    let target = (method.stop == StopConfig::PredictedCop).then_some(method.stop_cop_sigma_mm);
    let sigma = points(|pose| pose.cop_sigma_m.map(|sigma_m| 1e3 * sigma_m));
    let variance = points(|pose| pose.variance_max_m2.map(|variance_m2| 1e3 * variance_m2.sqrt()));
    let figure = |name: &str, title: &str, label: &str, points: Vec<[f64; 2]>, target: Option<f64>| {
        if points.len() < 2 {
            return None;
        }
        let (first, last) = (points[0][0], points[points.len() - 1][0]);
        let mut marks = vec![
            Mark::Line { style: Style::After, points: points.clone(), gap: f64::INFINITY },
            Mark::Dots { style: Style::After, points: points.clone() },
        ];
        let mut legend = Vec::new();
        if let Some(target) = target {
            let points = vec![[first, target], [last, target]];
            marks.push(Mark::Line { style: Style::Expected, points, gap: f64::INFINITY });
            legend.push((LegendKey::Line, Style::Expected, format!("stop rule: {target} mm")));
        }
        let values = points.iter().map(|point| point[1]).chain(target).chain([0.0]);
        let y = Axis::new(label, Scale::covering(values));
        let x = Axis::new("poses in the model", Scale::exactly(first, last));
        let (name, title) = (name.to_owned(), title.to_owned());
        let description = format!("{label} over the number of poses");
        let plot = Plot { name, title, description, x, y, marks, legend };
        Some(Figure { drawing: plot.draw(), caption: Text::default() })
    };
    let title = "Predicted standard deviation of the CoP";
    let cop = figure("cop-sigma", title, "predicted CoP σ, mm", sigma, target);
    let title = "Parameter of the largest variance";
    cop.into_iter().chain(figure("p-jj", title, "√ of the largest P_jj, mm", variance, None)).collect()
}

/// Each joint over time, and its minutes at each level.
pub(super) fn exposure(facts: &Facts) -> Section {
    let mut section = Section::new("Exposure by joint");
    let (found, span_s) = (&facts.exposure, facts.span_s.unwrap_or_default());
    if found.valid_s <= 0.0 {
        section.paragraph(
            "No torque was reported. Torques need an identified worker, a load and valid data: see data quality for the \
             reasons.",
        );
        return section;
    }
    if let Some(note) = several(facts) {
        section.paragraph(note);
    }
    if let Some(worst) = found.worst() {
        let worst_s = found.joints[worst.index()].worst_s;
        section.paragraph(format!(
            "Torques were reported for {} in all. The {} was the joint closest to its limit for {}.",
            length(found.valid_s),
            words::joint(worst),
            length(worst_s)
        ));
    }
    let drawing = strips(found, span_s, is_long(facts));
    section
        .figures(drawing.map(|drawing| Figure { drawing, caption: Text::default() }).into_iter().collect());
    section.head("Minutes at each level");
    section.table(levels(facts));
    section.note(
        "Low is up to 0.3, medium up to 0.6, high up to 1 of the joint's limit (Table I of the paper), overloaded \
         is beyond; not sure where the torque's σ does not let two levels be distinguished. Peak: the closest to the \
         limit, ± 1-σ.",
    );
    section
}

fn levels(facts: &Facts) -> Table {
    let mut table = Table::new(&[
        "joint",
        ">low",
        ">medium",
        ">high",
        ">overloaded",
        ">not sure",
        ">peak, N m",
        ">of the limit",
        ">at t, s",
        ">fatigue at the end",
    ]);
    let mut joints: Vec<(Joint, Peak)> = Joint::ALL
        .into_iter()
        .filter_map(|joint| Some((joint, facts.exposure.joints[joint.index()].peak?)))
        .collect();
    joints.sort_by(|(_, a), (_, b)| b.limit_ratio.total_cmp(&a.limit_ratio));
    for (joint, peak) in joints {
        let exposure = &facts.exposure.joints[joint.index()];
        let minutes = |level: Level| Text::from(format!("{:.3}", exposure.at(level) / 60.0));
        table.rows.push(vec![
            words::joint(joint).into(),
            minutes(Level::Green),
            minutes(Level::Orange),
            minutes(Level::Red),
            minutes(Level::AboveMax),
            minutes(Level::Undecided),
            format!("{:.1} ± {:.1}", peak.torque_nm, peak.sigma_nm).into(),
            format!("{:.0} %", 100.0 * peak.limit_ratio).into(),
            format!("{:.1}", peak.time_s).into(),
            format!("{:.1} %", 100.0 * exposure.fatigue).into(),
        ]);
    }
    table
}

fn or_none<T>(value: Option<T>, format: impl Fn(T) -> String) -> Text {
    value.map_or_else(|| "-".to_owned(), format).into()
}

fn is_long(facts: &Facts) -> bool {
    facts.span_s.is_some_and(|[from_s, to_s]| to_s - from_s > MINUTES_FROM_S)
}

/// A quantity over the time of the session; the line breaks where it was invalid for a second. `None` if it was never
/// valid.
fn over_time(facts: &Facts, name: &str, title: &str, label: &str, series: &Series) -> Option<Figure> {
    if series.is_empty() {
        return None;
    }
    let (unit_s, unit) = if is_long(facts) { (60.0, "min") } else { (1.0, "s") };
    let points: Vec<[f64; 2]> =
        series.points().iter().map(|[time_s, value]| [time_s / unit_s, *value]).collect();
    let [from_s, to_s] = facts.span_s.unwrap_or_default();
    let plot = Plot {
        name: name.to_owned(),
        title: title.to_owned(),
        description: format!("{label} over time; the line breaks where it was withheld"),
        x: Axis::new(format!("time, {unit}"), Scale::exactly(from_s / unit_s, to_s / unit_s)),
        y: Axis::new(label, Scale::covering(points.iter().map(|point| point[1]))),
        marks: vec![
            Mark::Line { style: Style::After, points: points.clone(), gap: 1.0 / unit_s },
            // An isolated point gives no line, so draw a dot.
            Mark::Dots { style: Style::After, points: isolated_points(&points, 1.0 / unit_s) },
        ],
        legend: Vec::new(),
    };
    Some(Figure { drawing: plot.draw_full(), caption: Text::default() })
}

/// The points that have no neighbour within a gap.
fn isolated_points(points: &[[f64; 2]], gap: f64) -> Vec<[f64; 2]> {
    let near = |a: Option<&[f64; 2]>, b: &[f64; 2]| a.is_some_and(|a| (a[0] - b[0]).abs() <= gap);
    let lonely = |index: usize| {
        let before = index.checked_sub(1).and_then(|before| points.get(before));
        !near(before, &points[index]) && !near(points.get(index + 1), &points[index])
    };
    (0..points.len()).filter(|index| lonely(*index)).map(|index| points[index]).collect()
}
