//! Figures, from the data that the engine stored for them.

use super::document::{Figure, Text};
use super::svg;
use super::svg::Scale;
use super::svg::{Axis, LegendKey, Mark, Plot, Style, thin};
use super::words;
use crate::constants::{DRAWN_POSES, TREND};
use crate::finding::Suspicion;
use crate::picture::{Picture, PosePlot, PosePoint, PredictorPlot, Signal, TimePlot, TimePoint};

/// The state shown by a drawing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum When {
    Before,
    After,
}

impl When {
    const fn style(self) -> Style {
        match self {
            When::Before => Style::Before,
            When::After => Style::After,
        }
    }

    const fn words(self) -> &'static str {
        match self {
            When::Before => "before",
            When::After => "after, on held-out data",
        }
    }

    const fn name(self) -> &'static str {
        match self {
            When::Before => "before",
            When::After => "after",
        }
    }
}

/// The step that shows before and after.
pub(super) const HELD_OUT: &str = "again";

/// Display name of a signal.
pub(super) fn signal(signal: Signal) -> &'static str {
    match signal {
        Signal::CopX => "forward centre of pressure",
        Signal::CopY => "sideways centre of pressure",
        Signal::Fz => "vertical force",
    }
}

/// Label of an axis of residuals: positive direction and unit.
fn residual(signal: Signal) -> String {
    let way = match signal {
        Signal::CopX => "forward",
        Signal::CopY => "to the left",
        Signal::Fz => "upward",
    };
    format!("residual {way}, {}", signal.unit())
}

pub(super) fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// Letter of a suspicious span, as in the accompanying table.
pub(super) fn letter(n: usize) -> String {
    char::from_u32('A' as u32 + n as u32)
        .filter(char::is_ascii_uppercase)
        .map_or_else(|| (n + 1).to_string(), String::from)
}

/// Unit of a time axis for a length: seconds, minutes, hours.
fn time_unit(length_s: f64) -> (f64, &'static str) {
    match length_s {
        long if long > 3.0 * 3600.0 => (3600.0, "h"),
        long if long > 300.0 => (60.0, "min"),
        _ => (1.0, "s"),
    }
}

/// The residual of one signal over time. `section` makes the names of drawings unique.
pub(super) fn over_time(
    section: &str,
    picture: &Picture,
    of: &TimePlot,
    spans: &[Suspicion],
    when: When,
) -> Figure {
    let times = || of.points.iter().map(|point| point.time_s);
    let [from, to] = picture.spans_s.work;
    let from = times().fold(from, f64::min);
    let to = times().fold(to, f64::max);
    let (second, time_name) = time_unit(to - from);
    let y =
        Scale::covering(of.points.iter().flat_map(|point| {
            [point.before, point.after, 2.0 * point.noise_sigma, -2.0 * point.noise_sigma]
        }));
    let held = held_poses(of, picture.block_s, second);
    let mut legend = vec![
        (LegendKey::Line, when.style(), "measured − predicted".to_owned()),
        (LegendKey::Area, Style::Noise, "noise (2 σ)".to_owned()),
    ];
    if !spans.is_empty() {
        legend.push((LegendKey::Area, Style::Suspect, "beyond noise".to_owned()));
    }
    if !held.is_empty() {
        legend.push((LegendKey::Area, Style::Still, "static pose".to_owned()));
    }
    let mut marks: Vec<Mark> = spans
        .iter()
        .enumerate()
        .filter(|(_, span)| span.to_s >= from && span.from_s <= to)
        .map(|(n, span)| Mark::Interval {
            style: Style::Suspect,
            from: span.from_s / second,
            to: span.to_s / second,
            letter: letter(n),
        })
        .collect();
    marks.extend(residual_marks(of, picture.block_s, second, held, when));

    let what = sentence(signal(of.signal));
    let plot = Plot {
        name: format!("{section}-{}-{}", of.signal.name(), when.name()),
        title: format!("{what}{}", suffix(section, when.words())),
        description: format!(
            "Residual of the {} over time, {}, with the 2 σ band of noise alone.",
            signal(of.signal),
            when.words()
        ),
        x: Axis::new(
            format!("time in the recording, {time_name}"),
            Scale::exactly(from / second, to / second),
        ),
        y: Axis::new(residual(of.signal), y),
        marks,
        legend,
    };
    let caption = if svg::is_dense(of.points.len()) { "Line: mean; shaded: minimum to maximum." } else { "" };
    Figure {
        drawing: plot.draw(),
        caption: if caption.is_empty() { Text::default() } else { caption.into() },
    }
}

/// The band of noise, the static poses and the residual itself.
fn residual_marks(
    of: &TimePlot,
    block_s: f64,
    second: f64,
    held: Vec<[f64; 2]>,
    when: When,
) -> impl Iterator<Item = Mark> {
    let gap = 3.0 * block_s.max(0.1) / second;
    let series = |value: fn(&TimePoint) -> f64| -> Vec<[f64; 2]> {
        of.points.iter().map(|point| [point.time_s / second, value(point)]).collect()
    };
    let residual = series(match when {
        When::Before => |point| point.before,
        When::After => |point| point.after,
    });
    let band = Mark::Band { style: Style::Noise, points: series(|point| 2.0 * point.noise_sigma), gap };
    let strip = (!held.is_empty()).then_some(Mark::Strip { style: Style::Still, intervals: held });
    let line = Mark::Line { style: when.style(), points: residual, gap };
    [Some(band), strip, Some(line)].into_iter().flatten()
}

/// Only the step that shows both figures requires a suffix to distinguish them.
fn suffix(section: &str, when: &str) -> String {
    if section == HELD_OUT { format!(": {when}") } else { String::new() }
}

/// Intervals of static poses, adjacent ones merged; none in a recording too long to resolve them.
fn held_poses(of: &TimePlot, block_s: f64, second: f64) -> Vec<[f64; 2]> {
    let (intervals_max, join_max_s) = DRAWN_POSES;
    let length_s = match of.points[..] {
        [first, .., last] => last.time_s - first.time_s,
        _ => block_s,
    };
    let join_s = (length_s / intervals_max as f64).max(1.1 * block_s);
    let mut held: Vec<[f64; 2]> = Vec::new();
    if join_s > join_max_s.max(1.1 * block_s) {
        return held;
    }
    for point in of.points.iter().filter(|point| point.still) {
        let [from, to] = [point.time_s - block_s / 2.0, point.time_s + block_s / 2.0];
        match held.last_mut() {
            Some(last) if from - last[1] < join_s - block_s => last[1] = to,
            _ => held.push([from, to]),
        }
    }
    held.iter().map(|interval| interval.map(|time_s| time_s / second)).collect()
}

/// The residual of one signal over a feature of the pose.
pub(super) fn over_pose(section: &str, number: usize, of: &PosePlot, when: When) -> Figure {
    let (parts, _) = TREND;
    let points = |when: When| -> Vec<[f64; 2]> {
        let value = |point: &PosePoint| match when {
            When::Before => point.before,
            When::After => point.after,
        };
        of.points.iter().map(|point| [point.feature, value(point)]).collect()
    };
    let x = Scale::covering(of.points.iter().map(|point| point.feature));
    let noise = [2.0 * of.noise_sigma, -2.0 * of.noise_sigma];
    let both = points(When::Before).into_iter().chain(points(When::After));
    let all = both.map(|point| point[1]).chain(noise);
    let y = Scale::covering(all);
    let shown = points(when);
    let mean = thin::means(&shown, x, parts);
    let what = sentence(signal(of.signal));
    let plot = Plot {
        name: format!("{section}-pose-{number}-{}", when.name()),
        title: format!("{what} by {}{}", of.feature, suffix(section, when.name())),
        description: format!(
            "Residual of the {} against {}, {}, with its mean and the band of noise.",
            signal(of.signal),
            of.feature,
            when.words()
        ),
        x: Axis::new(format!("{}, {}", of.feature, of.unit), x),
        y: Axis::new(residual(of.signal), y),
        marks: vec![
            level_band(x, of.noise_sigma),
            Mark::Dots { style: when.style(), points: shown },
            Mark::Line { style: Style::Expected, points: mean, gap: f64::INFINITY },
        ],
        legend: vec![
            (LegendKey::Dot, when.style(), "block".to_owned()),
            (LegendKey::Line, Style::Expected, "mean".to_owned()),
            (LegendKey::Area, Style::Noise, "noise (2 σ)".to_owned()),
        ],
    };
    Figure { drawing: plot.draw(), caption: Text::default() }
}

fn level_band(x: Scale, sigma: f64) -> Mark {
    let points = vec![[x.from, 2.0 * sigma], [x.to, 2.0 * sigma]];
    Mark::Band { style: Style::Noise, points, gap: f64::INFINITY }
}

/// The residual over the prediction of one effect.
pub(super) fn over_predictor(number: usize, of: &PredictorPlot) -> Figure {
    let points: Vec<[f64; 2]> = of.points.iter().map(|point| [point.predicted, point.residual]).collect();
    let x = Scale::covering(points.iter().map(|point| point[0]));
    let y = Scale::covering(points.iter().map(|point| point[1]).chain([x.from, x.to]));
    let around = |way: f64| {
        let points = [x.from, x.to].map(|at| [at, at + way * 2.0 * of.noise_sigma]).to_vec();
        Mark::Line { style: Style::Noise, points: clipped(points, y), gap: f64::INFINITY }
    };
    let (unit, words) = (of.signal.unit(), words::candidate(&of.effect));
    let plot = Plot {
        name: format!("predictor-{number}"),
        title: format!("{}: predicted and measured", of.effect),
        description: format!(
            "Residual of the {} over the prediction of {words}. On the diagonal the effect explains it.",
            signal(of.signal)
        ),
        x: Axis::new(format!("predicted by the effect, {unit}"), x),
        y: Axis::new(residual(of.signal), y),
        marks: vec![
            Mark::Dots { style: Style::Before, points },
            around(1.0),
            around(-1.0),
            Mark::Line {
                style: Style::Expected,
                points: vec![[x.from, x.from], [x.to, x.to]],
                gap: f64::INFINITY,
            },
        ],
        legend: vec![
            (LegendKey::Dot, Style::Before, "block".to_owned()),
            (LegendKey::Line, Style::Expected, "measured = predicted".to_owned()),
            (LegendKey::Line, Style::Noise, "noise (2 σ)".to_owned()),
        ],
    };
    let caption = format!("{}. Parameters are fitted on other blocks.", sentence(signal(of.signal)));
    Figure { drawing: plot.draw(), caption: caption.into() }
}

/// A straight line, clipped to the range of y.
fn clipped(line: Vec<[f64; 2]>, y: Scale) -> Vec<[f64; 2]> {
    let [Some(&a), Some(&b)] = [line.first(), line.last()] else { return line };
    let slope = (b[1] - a[1]) / (b[0] - a[0]);
    let cut = |p: [f64; 2]| {
        let level = p[1].clamp(y.from, y.to);
        if level == p[1] || slope == 0.0 { p } else { [p[0] + (level - p[1]) / slope, level] }
    };
    vec![cut(a), cut(b)]
}
