//! Plots with one row per name: bars of evidence, and pairs of dots.

use std::fmt::Write;

use super::scale::Scale;
use super::{Drawing, LegendKey, RIGHT, Style, WIDTH, at, legend};
use crate::report::escape::xml;

/// Width of the names, where values begin.
const NAMES: f64 = 196.0;
/// Space for a value behind its bar.
const VALUES: f64 = 52.0;
const ROW: f64 = 22.0;
/// Maximum length of a name, in letters.
const LETTERS: usize = 27;

/// A row of bars or dots.
#[derive(Debug, Clone)]
pub struct Row {
    /// Label of the row.
    pub name: String,
    /// Bars from zero, or dots.
    pub values: Vec<(Style, f64)>,
    /// Text at its end.
    pub caption: String,
}

/// A plot of rows.
#[derive(Debug, Clone)]
pub struct Rows {
    /// Identifier, unique in its page.
    pub name: String,
    /// A short title.
    pub title: String,
    /// Text alternative of the figure.
    pub description: String,
    /// Quantity and unit.
    pub label: String,
    /// Rows from top to bottom.
    pub rows: Vec<Row>,
    /// A reference value with its label.
    pub rule: Option<(f64, String)>,
    /// Bars from zero; else dots.
    pub bars: bool,
    /// Legend entries.
    pub legend: Vec<(LegendKey, Style, String)>,
}

impl Rows {
    /// Draws it.
    pub fn draw(&self) -> Drawing {
        let mut keys = self.legend.clone();
        keys.extend(self.rule.iter().map(|(_, text)| (LegendKey::Line, Style::Expected, text.clone())));
        let (legend, lines) = legend(&keys, 33.0);
        let top = 30.0 + 17.0 * lines as f64;
        let bottom = top + ROW * self.rows.len() as f64;
        let values = self.rows.iter().flat_map(|row| row.values.iter().map(|&(_, value)| value));
        let scale = Scale::covering(values.chain([0.0]).chain(self.rule.iter().map(|&(value, _)| value)));
        let scale = if scale.from > -0.05 * scale.to { Scale::exactly(0.0, scale.to) } else { scale };

        let mut body = format!("<text class=\"title\" x=\"8\" y=\"16\">{}</text>{legend}", xml(&self.title));
        self.axis(scale, top, bottom, &mut body);
        for (n, row) in self.rows.iter().enumerate() {
            self.row(row, scale, top + ROW * (n as f64 + 0.5), &mut body);
        }
        if let Some((value, _)) = self.rule {
            let _ = write!(
                body,
                "<path class=\"line expected\" d=\"M{} {}V{}\"/>",
                at(px(scale, value)),
                at(top),
                at(bottom)
            );
        }
        Drawing::new(&self.name, &self.title, &self.description, bottom + 42.0, body)
    }

    fn axis(&self, scale: Scale, top: f64, bottom: f64, out: &mut String) {
        let ticks = scale.ticks(6);
        let mut grid = String::new();
        let mut labels = String::new();
        for &value in &ticks.values {
            let x = at(px(scale, value));
            let _ = write!(grid, "M{x} {}V{}", at(top), at(bottom));
            let _ =
                write!(labels, "<text x=\"{x}\" y=\"{}\">{}</text>", at(bottom + 16.0), ticks.label(value));
        }
        let zero = at(px(scale, 0.0));
        let _ = write!(
            out,
            "<path class=\"grid\" d=\"{grid}\"/><path class=\"axis\" d=\"M{zero} {}V{}\"/>\
             <g class=\"tick\" text-anchor=\"middle\">{labels}</g>\
             <text class=\"label\" x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            at(top),
            at(bottom),
            at((NAMES + WIDTH - RIGHT - VALUES) / 2.0),
            at(bottom + 33.0),
            xml(&self.label)
        );
    }

    fn row(&self, row: &Row, scale: Scale, y: f64, out: &mut String) {
        let line = at(y + 4.0);
        let _ = write!(
            out,
            "<text x=\"{}\" y=\"{line}\" text-anchor=\"end\">{}</text>\
             <text class=\"key\" x=\"{}\" y=\"{line}\" text-anchor=\"end\">{}</text>",
            at(NAMES - 8.0),
            xml(&shortened(&row.name)),
            at(WIDTH - 6.0),
            xml(&row.caption)
        );
        let finite: Vec<(Style, f64)> = row.values.iter().copied().filter(|(_, v)| v.is_finite()).collect();
        if self.bars {
            for (style, value) in finite {
                let (from, to) = (px(scale, 0.0), px(scale, value));
                let (left, width) = (at(from.min(to)), at((from - to).abs().max(1.0)));
                let _ = write!(
                    out,
                    "<path class=\"area {}\" d=\"M{left} {}h{width}v12h-{width}z\"/>",
                    style.class(),
                    at(y - 6.0)
                );
            }
            return;
        }
        if let [(_, first), .., (_, last)] = finite[..] {
            let (from, to) = (at(px(scale, first)), at(px(scale, last)));
            let _ = write!(out, "<path class=\"axis\" d=\"M{from} {0}H{to}\"/>", at(y));
        }
        for (style, value) in finite {
            let _ = write!(
                out,
                "<path class=\"dots solid {}\" d=\"M{} {}h0\"/>",
                style.class(),
                at(px(scale, value)),
                at(y)
            );
        }
    }
}

fn px(scale: Scale, value: f64) -> f64 {
    NAMES + scale.fraction(value) * (WIDTH - RIGHT - VALUES - NAMES)
}

fn shortened(name: &str) -> String {
    if name.chars().count() <= LETTERS {
        return name.to_owned();
    }
    name.chars().take(LETTERS - 1).chain(['…']).collect()
}
