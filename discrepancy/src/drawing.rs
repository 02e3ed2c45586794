//! Data of the report's figures.

use crate::answer::{Answer, display_scale};
use crate::block::{Block, Phase};
use crate::candidate::Candidate;
use crate::constants::{AUTOCORRELATION_LAGS, INNOVATION_BINS, PIECES, SHOWN_MAX};
use crate::floor::{Floor, root_mean};
use crate::gram::Gram;
use crate::holdout::HeldOut;
use crate::linear::dot;
use crate::picture::{
    PhaseGap, Picture, PosePlot, PosePoint, PredictorPlot, PredictorPoint, Signal, SurpriseBin, TimePlot,
    TimePoint, Unseen, Whiteness, Window,
};
use crate::select::Selection;

/// All figures.
pub(crate) fn picture(
    gram: &Gram<'_>,
    selection: &Selection,
    held: &HeldOut,
    answer: &Answer,
    threshold: f64,
) -> Picture {
    let session = gram.rows.session;
    Picture {
        spans_s: session.spans_s,
        length_s: session.length_s,
        block_s: session.block_s,
        threshold_log_odds: threshold,
        time: (0..3).map(|axis| time(gram, held, &answer.floor, axis)).collect(),
        pose: (0..3).flat_map(|axis| pose(gram, held, &answer.floor, axis)).collect(),
        predictors: (0..selection.accepted.len())
            .filter_map(|index| predictor(gram, selection, held, &answer.floor, index))
            .collect(),
        whiteness: (0..3).map(|axis| whiteness(gram, answer, axis)).collect(),
        surprise: surprise(gram, answer),
        windows: windows(gram, answer),
        phases: phases(gram, held, &answer.floor),
        unseen: if selection.accepted.is_empty() { unseen(gram) } else { Vec::new() },
    }
}

fn time(gram: &Gram<'_>, held: &HeldOut, floor: &Floor, axis: usize) -> TimePlot {
    let points = (0..held.before.len())
        .map(|block| TimePoint {
            time_s: gram.rows.time_s(gram.rows.work_from + block),
            still: gram.rows.blocks[gram.rows.work_from + block].still,
            before: display_scale(axis) * held.before[block][axis],
            after: display_scale(axis) * held.after[block][axis],
            noise_sigma: display_scale(axis) * floor.sigma[block][axis],
        })
        .collect();
    TimePlot { signal: Signal::ALL[axis], points }
}

/// A feature of the pose: description, unit, and its value for a block.
type Feature = (String, &'static str, Box<dyn Fn(&Block) -> f64>);

/// Pose features with their names and how to compute them from a block: elevation and direction of each arm,
/// inclination and direction of the trunk, height of the body.
fn features() -> Vec<Feature> {
    use equipoise_core::body::Segment;
    let mut list: Vec<Feature> = Vec::new();
    let parts = [
        ("trunk", Segment::Pelvis, Segment::Neck),
        ("right arm", Segment::RightUpperArm, Segment::RightHand),
        ("left arm", Segment::LeftUpperArm, Segment::LeftHand),
        ("right thigh", Segment::RightUpperLeg, Segment::RightLowerLeg),
        ("left thigh", Segment::LeftUpperLeg, Segment::LeftLowerLeg),
    ];
    for (name, from, to) in parts {
        for (axis, way) in ["forward", "to the left", "up"].into_iter().enumerate() {
            let of = move |block: &Block| {
                let origin_m = &block.observation.origin_m;
                origin_m[to.index()][axis] - origin_m[from.index()][axis]
            };
            list.push((format!("{name} {way}"), "m", Box::new(of)));
        }
    }
    list.push(("heading of the feet".to_owned(), "°", Box::new(|block| block.heading_rad.to_degrees())));
    list
}

fn pose(gram: &Gram<'_>, held: &HeldOut, floor: &Floor, axis: usize) -> Vec<PosePlot> {
    let rows = gram.rows;
    let residual: Vec<f64> = held.before.iter().map(|before| before[axis]).collect();
    let mut plots: Vec<(f64, PosePlot)> = Vec::new();
    for (feature, unit, of) in features() {
        let value: Vec<f64> = rows.blocks[rows.work_from..].iter().map(|block| of(block)).collect();
        let points = (0..value.len())
            .map(|i| PosePoint {
                feature: value[i],
                before: display_scale(axis) * held.before[i][axis],
                after: display_scale(axis) * held.after[i][axis],
            })
            .collect();
        let noise_sigma = display_scale(axis) * floor.root_mean_square(axis, |_| true);
        plots.push((
            squared_correlation(&value, &residual),
            PosePlot { signal: Signal::ALL[axis], feature, unit, points, noise_sigma },
        ));
    }
    plots.sort_by(|a, b| b.0.total_cmp(&a.0));
    let [_, features_max, _] = SHOWN_MAX;
    plots.into_iter().take(features_max).map(|(_, plot)| plot).collect()
}

/// Squared correlation.
fn squared_correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let (middle_a, middle_b) = (mean(a), mean(b));
    let sum = |f: &dyn Fn(f64, f64) -> f64| {
        a.iter().zip(b).map(|(a, b)| f(a - middle_a, b - middle_b)).sum::<f64>()
    };
    let (aa, bb, ab) = (sum(&|a, _| a * a), sum(&|_, b| b * b), sum(&|a, b| a * b));
    if aa > 1e-12 && bb > 1e-18 { ab * ab / (aa * bb) } else { 0.0 }
}

fn predictor(
    gram: &Gram<'_>,
    selection: &Selection,
    held: &HeldOut,
    floor: &Floor,
    index: usize,
) -> Option<PredictorPlot> {
    let predicted = &held.of_term[index];
    let strength = |axis: usize| {
        let noise = floor.root_mean_square(axis, |_| true);
        if noise > 0.0 { root_mean(predicted.iter().map(|value| value[axis].powi(2))) / noise } else { 0.0 }
    };
    let axis = (0..3).max_by(|&a, &b| strength(a).total_cmp(&strength(b)))?;
    let candidate = gram.terms[selection.accepted[index].term].candidate.as_ref()?;
    let points = (0..predicted.len())
        .filter(|&block| candidate.acts(gram.rows, gram.rows.work_from + block))
        .map(|block| PredictorPoint {
            predicted: display_scale(axis) * predicted[block][axis],
            residual: display_scale(axis) * (held.after[block][axis] + predicted[block][axis]),
        })
        .collect();
    Some(PredictorPlot {
        effect: Candidate::name(candidate),
        signal: Signal::ALL[axis],
        points,
        noise_sigma: display_scale(axis) * floor.root_mean_square(axis, |_| true),
    })
}

/// The work's whitened rows of one signal.
fn whitened(gram: &Gram<'_>, rows: &[f64], axis: usize) -> Vec<f64> {
    let blocks = gram.rows.work_from..gram.rows.len();
    match axis {
        0 | 1 => blocks.map(|block| rows[2 * block + axis]).collect(),
        _ => blocks.map(|block| rows[gram.cop_rows() + block]).collect(),
    }
}

fn whiteness(gram: &Gram<'_>, answer: &Answer, axis: usize) -> Whiteness {
    let of = |rows: &[f64]| {
        let values = whitened(gram, rows, axis);
        let square = dot(&values, &values);
        (1..=AUTOCORRELATION_LAGS.min(values.len().saturating_sub(2)))
            .map(|lag| if square > 0.0 { dot(&values[lag..], &values) / square } else { 0.0 })
            .collect()
    };
    let count = (gram.rows.len() - gram.rows.work_from).max(1);
    Whiteness {
        signal: Signal::ALL[axis],
        before: of(&answer.rest.before),
        after: of(&answer.rest.after),
        bound: 1.96 / (count as f64).sqrt(),
    }
}

fn surprise(gram: &Gram<'_>, answer: &Answer) -> Vec<SurpriseBin> {
    let squares = |rows: &[f64]| -> Vec<f64> {
        (0..3).flat_map(|axis| whitened(gram, rows, axis)).map(|value| value * value).collect()
    };
    let (before, after) = (squares(&answer.rest.before), squares(&answer.rest.after));
    let fraction = |list: &[f64], from: f64, to: f64| {
        list.iter().filter(|&&value| value >= from && value < to).count() as f64 / list.len().max(1) as f64
    };
    INNOVATION_BINS
        .windows(2)
        .map(|edge| {
            let [from, to] = [edge[0], edge[1]];
            let expected = chi_square_cdf(to) - chi_square_cdf(from);
            SurpriseBin {
                from,
                to,
                before: fraction(&before, from, to),
                after: fraction(&after, from, to),
                expected,
            }
        })
        .collect()
}

/// Probability that the square of a standard normal is below a value: `erf(√(x/2))` by Abramowitz and Stegun 7.1.26.
fn chi_square_cdf(value: f64) -> f64 {
    if value.is_infinite() {
        return 1.0;
    }
    let x = (0.5 * value).sqrt();
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let series = t
        * (0.254_829_592
            + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    1.0 - series * (-x * x).exp()
}

fn windows(gram: &Gram<'_>, answer: &Answer) -> Vec<Window> {
    let rows = gram.rows;
    let work = rows.len() - rows.work_from;
    let length = work.div_ceil(PIECES).max(1);
    let mut list = Vec::new();
    for axis in 0..3 {
        let (before, after) =
            (whitened(gram, &answer.rest.before, axis), whitened(gram, &answer.rest.after, axis));
        for from in (0..work).step_by(length) {
            let to = (from + length).min(work);
            let root = |values: &[f64]| root_mean(values[from..to].iter().map(|value| value * value));
            list.push(Window {
                from_s: rows.time_s(rows.work_from + from) - 0.5 * rows.session.block_s,
                to_s: rows.time_s(rows.work_from + to - 1) + 0.5 * rows.session.block_s,
                signal: Signal::ALL[axis],
                times_noise_before: root(&before),
                times_noise_after: root(&after),
            });
        }
    }
    list.sort_by(|a, b| b.times_noise_after.total_cmp(&a.times_noise_after));
    let [windows_max, ..] = SHOWN_MAX;
    list.truncate(windows_max);
    list
}

fn phases(gram: &Gram<'_>, held: &HeldOut, floor: &Floor) -> Vec<PhaseGap> {
    let rows = gram.rows;
    let mut list = Vec::new();
    for phase in [Phase::Identify, Phase::Reference, Phase::Work] {
        for (axis, signal) in Signal::ALL.into_iter().enumerate() {
            let gap = if phase == Phase::Work {
                let root = |list: &[[f64; 3]]| {
                    display_scale(axis) * root_mean(list.iter().map(|value| value[axis].powi(2)))
                };
                let noise_floor = display_scale(axis) * floor.root_mean_square(axis, |_| true);
                PhaseGap { phase, signal, before: root(&held.before), after: root(&held.after), noise_floor }
            } else {
                let blocks = (0..rows.work_from).filter(|&block| rows.blocks[block].phase == phase);
                let residual = |block: usize| match axis {
                    0 | 1 => rows.cop_residual_m(block)[axis],
                    _ => rows.force_residual_n(block, 2),
                };
                let root =
                    display_scale(axis) * root_mean(blocks.clone().map(|block| residual(block).powi(2)));
                if blocks.count() == 0 {
                    continue;
                }
                PhaseGap { phase, signal, before: root, after: root, noise_floor: root }
            };
            list.push(gap);
        }
    }
    list
}

/// Upper bounds of effects that were not detected, each alone: 95 % bound of its largest parameter in the unit of the
/// first, over its variants.
fn unseen(gram: &Gram<'_>) -> Vec<Unseen> {
    let mut list: Vec<Unseen> = Vec::new();
    for (index, term) in gram.terms.iter().enumerate() {
        let Some(candidate) = term.candidate.as_ref().filter(|_| !term.is_derived) else { continue };
        // Factors on a shape and large rotations are not about zero.
        if candidate.mean.iter().any(|mean| *mean != 0.0) {
            continue;
        }
        let Some(estimate) = gram.estimate(&[index]) else { continue };
        let effect = candidate.name();
        let parameters = candidate.effect.parameters_of(candidate.shape);
        let unit =
            list.iter().find(|other| other.effect == effect).map_or(parameters[0].unit, |other| other.unit);
        for (k, parameter) in parameters.iter().enumerate().filter(|(_, parameter)| parameter.unit == unit) {
            let at_most = estimate.value[k].abs() + 1.96 * estimate.sigma[k];
            let (effect, parameter) = (effect.clone(), parameter.name.to_owned());
            let bound = Unseen { effect, parameter, at_most, unit };
            match list.iter_mut().find(|other| other.effect == bound.effect) {
                Some(other) if other.at_most < at_most => *other = bound,
                Some(_) => {}
                None => list.push(bound),
            }
        }
    }
    list
}

#[cfg(test)]
mod tests {
    use equipoise_core::effect::{Effect, Place};

    use super::*;
    use crate::candidate::Scope;
    use crate::noise::Noise;
    use crate::rows::Rows;
    use crate::support::{END_S, REFERENCE_S, clean, hide};

    #[test]
    fn the_bound_of_an_effect_is_that_of_its_largest_parameter() {
        let mut session = clean(5);
        hide(&mut session, Effect::PlateOffset, Place::Whole, &[0.0, 0.03], [REFERENCE_S, END_S]);
        let all = Rows::of(&session);
        let rows = all.subset(&(0..all.len()).step_by(5).collect::<Vec<usize>>());
        let noise = Noise::fit(&rows).unwrap();
        let candidate = Candidate::new(Effect::PlateOffset, Place::Whole, 0.0, Scope::Work);
        let gram = Gram::of(&rows, &noise, vec![candidate]);
        let estimate = gram.estimate(&[0]).unwrap();
        let [bound]: [Unseen; 1] = unseen(&gram).try_into().unwrap();
        assert_eq!((bound.effect.as_str(), bound.parameter.as_str()), ("plate_offset", "dy_m"));
        let two_sided = estimate.value[1].abs() + 1.96 * estimate.sigma[1];
        assert!((bound.at_most - two_sided).abs() < 1e-12, "{bound:?} instead of {two_sided}");
    }
}
