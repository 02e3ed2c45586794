//! Drawings with one row per name: the gap relative to noise, and the evidence of the candidates.

use super::document::{Figure, Text};
use super::svg::{LegendKey, Style};
use super::svg::{Row, Rows};
use super::words;
use crate::constants::SHOWN_MAX;
use crate::finding::{AxisGap, Finding, Gap};
use crate::picture::Signal;

/// Display name of an axis of the gap: `x_still` is "forward, static".
pub(super) fn axis(name: &str) -> String {
    let (signal, how) = name.split_once('_').unwrap_or((name, ""));
    let signal = match signal {
        "x" => "forward",
        "y" => "sideways",
        "fz" => "vertical force",
        other => other,
    };
    match how {
        "" => signal.to_owned(),
        "still" => format!("{signal}, static"),
        "moving" => format!("{signal}, in motion"),
        other => format!("{signal}, {other}"),
    }
}

/// Axes of the gap in display order: each signal as a whole, then in motion and static.
pub(super) fn axes(gap: &Gap) -> Vec<(&str, AxisGap)> {
    let rank = |name: &str| {
        let signal = Signal::ALL.iter().position(|signal| name.split('_').next() == Some(signal.axis()));
        (signal.unwrap_or(Signal::ALL.len()), name.to_owned())
    };
    let mut axes: Vec<(&str, AxisGap)> =
        gap.per_axis.iter().map(|(name, gap)| (name.as_str(), *gap)).collect();
    axes.sort_by_key(|(name, _)| rank(name));
    axes
}

/// The gap relative to noise, per axis; before only, or before and after.
pub(super) fn gap(section: &str, gap: &Gap, after: bool) -> Option<Figure> {
    let rows: Vec<Row> = axes(gap)
        .into_iter()
        .filter(|(_, axis)| axis.noise_floor > 0.0)
        .map(|(name, gap)| {
            let (before, rest) = (gap.before / gap.noise_floor, gap.after / gap.noise_floor);
            let mut values = vec![(Style::Before, before)];
            let mut caption = format!("{before:.1}");
            if after {
                values.push((Style::After, rest));
                caption = format!("{before:.1} → {rest:.1}");
            }
            Row { name: axis(name), values, caption }
        })
        .collect();
    if rows.is_empty() {
        return None;
    }
    let mut legend = vec![(LegendKey::Dot, Style::Before, if after { "before" } else { "gap" }.to_owned())];
    if after {
        legend.push((LegendKey::Dot, Style::After, "after, on held-out data".to_owned()));
    }
    let drawing = Rows {
        name: format!("{section}-gap"),
        title: "Gap relative to noise".to_owned(),
        description:
            "Root mean square of the residual over that of noise alone, per axis, static and in motion."
                .to_owned(),
        label: "gap / noise alone".to_owned(),
        rows,
        rule: Some((1.0, "noise alone".to_owned())),
        bars: false,
        legend,
    };
    Some(Figure { drawing: drawing.draw(), caption: Text::default() })
}

/// The evidence of the best candidates.
pub(super) fn evidence(finding: &Finding, threshold: f64) -> Option<Figure> {
    let [.., candidates_max] = SHOWN_MAX;
    let named: Vec<String> = finding.effects.iter().map(words::full_name).collect();
    let rows: Vec<Row> = finding
        .candidates
        .iter()
        .filter_map(|candidate| {
            Some((candidate, candidate.log_odds.filter(|log_odds| log_odds.is_finite())?))
        })
        .take(candidates_max)
        .map(|(candidate, log_odds)| {
            let style = if named.contains(&candidate.name) { Style::After } else { Style::Noise };
            let caption = words::odds(log_odds);
            Row { name: candidate.name.clone(), values: vec![(style, log_odds)], caption }
        })
        .collect();
    if rows.is_empty() {
        return None;
    }
    let mut legend = vec![(LegendKey::Area, Style::Noise, "not named".to_owned())];
    if !named.is_empty() {
        legend.insert(0, (LegendKey::Area, Style::After, "named".to_owned()));
    }
    let drawing = Rows {
        name: "evidence".to_owned(),
        title: "Evidence for each effect alone".to_owned(),
        description: "Natural logarithm of the odds of each candidate against the unchanged model."
            .to_owned(),
        label: "log odds against the unchanged model".to_owned(),
        rows,
        rule: Some((threshold, format!("by chance: {}", words::odds(threshold)))),
        bars: true,
        legend,
    };
    Some(Figure { drawing: drawing.draw(), caption: Text::default() })
}
