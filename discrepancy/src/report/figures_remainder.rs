//! Figures of the remaining residual: its whiteness and its normalised innovations.

use super::document::{Figure, Text};
use super::figures::{sentence, signal};
use super::svg::Scale;
use super::svg::{Axis, LegendKey, Mark, Plot, Style};
use crate::constants::AUTOCORRELATION_LAGS;
use crate::picture::{SurpriseBin, Whiteness};

/// Autocorrelation of the remaining residual.
pub(super) fn whiteness(of: &Whiteness, block_s: f64, changed: bool) -> Figure {
    let lag = |n: usize| (n + 1) as f64 * block_s;
    let count = of.before.len().max(of.after.len()).min(AUTOCORRELATION_LAGS);
    let x = Scale::exactly(0.0, lag(count.max(1) - 1) + block_s);
    let columns: Vec<[f64; 3]> = of
        .after
        .iter()
        .take(AUTOCORRELATION_LAGS)
        .enumerate()
        .map(|(n, &value)| [lag(n) - 0.35 * block_s, lag(n) + 0.35 * block_s, value])
        .collect();
    let before: Vec<[f64; 2]> =
        of.before.iter().take(AUTOCORRELATION_LAGS).enumerate().map(|(n, &value)| [lag(n), value]).collect();
    let y = Scale::covering(of.before.iter().chain(&of.after).copied().chain([of.bound, -of.bound]));
    let band = vec![[x.from, of.bound], [x.to, of.bound]];
    let mut marks = vec![
        Mark::Band { style: Style::Noise, points: band, gap: f64::INFINITY },
        Mark::Columns { style: Style::After, columns },
    ];
    let mut legend = vec![
        (LegendKey::Area, Style::After, if changed { "after" } else { "residual" }.to_owned()),
        (LegendKey::Area, Style::Noise, "white noise (95 %)".to_owned()),
    ];
    if changed {
        marks.push(Mark::Line { style: Style::Before, points: before, gap: f64::INFINITY });
        legend.insert(0, (LegendKey::Line, Style::Before, "before".to_owned()));
    }
    let plot = Plot {
        name: format!("whiteness-{}", of.signal.name()),
        title: format!("{}: autocorrelation", sentence(signal(of.signal))),
        description: format!(
            "Autocorrelation of the whitened residual of the {} by lag, with the bounds of white noise.",
            signal(of.signal)
        ),
        x: Axis::new("lag, s".to_owned(), x),
        y: Axis::new("autocorrelation".to_owned(), y),
        marks,
        legend,
    };
    Figure { drawing: plot.draw(), caption: Text::default() }
}

/// Histogram of the normalised innovations: one column per bin, independent of its width.
pub(super) fn surprise(bins: &[SurpriseBin], changed: bool) -> Option<Figure> {
    let highest = bins.iter().flat_map(|bin| [bin.before, bin.after, bin.expected]).fold(0.0, f64::max);
    let columns = |[from, to]: [f64; 2], value: fn(&SurpriseBin) -> f64| -> Vec<[f64; 3]> {
        let place = |n: usize| n as f64;
        bins.iter().enumerate().map(|(n, bin)| [place(n) + from, place(n) + to, 100.0 * value(bin)]).collect()
    };
    let steps = columns([0.0, 1.0], |bin| bin.expected);
    let steps = steps.iter().flat_map(|&[from, to, value]| [[from, value], [to, value]]).collect();
    let (left, right) = ([0.1, 0.49], if changed { [0.51, 0.9] } else { [0.2, 0.8] });
    let mut marks = vec![
        Mark::Columns { style: Style::After, columns: columns(right, |bin| bin.after) },
        Mark::Line { style: Style::Expected, points: steps, gap: f64::INFINITY },
    ];
    let mut legend = vec![
        (LegendKey::Area, Style::After, if changed { "after" } else { "residual" }.to_owned()),
        (LegendKey::Line, Style::Expected, "noise alone".to_owned()),
    ];
    if changed {
        marks.insert(0, Mark::Columns { style: Style::Before, columns: columns(left, |bin| bin.before) });
        legend.insert(0, (LegendKey::Area, Style::Before, "before".to_owned()));
    }
    let name = |bin: &SurpriseBin| match bin.to {
        to if to.is_finite() => format!("{} to {to}", bin.from),
        _ => format!("above {}", bin.from),
    };
    let mut x = Axis::new("whitened residual squared", Scale::exactly(0.0, bins.len() as f64));
    x.classes = bins.iter().enumerate().map(|(n, bin)| (n as f64 + 0.5, name(bin))).collect();
    let plot = Plot {
        name: "surprise".to_owned(),
        title: "Distribution of the squared residual".to_owned(),
        description:
            "Fraction of blocks by the square of the whitened residual, next to that of noise alone."
                .to_owned(),
        x,
        y: Axis::new("fraction of blocks, %", Scale::exactly(0.0, 104.0 * highest.max(0.01))),
        marks,
        legend,
    };
    (!bins.is_empty()).then(|| Figure { drawing: plot.draw(), caption: Text::default() })
}
