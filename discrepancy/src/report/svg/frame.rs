//! The inside of a plot: converts values to coordinates and marks to paths.

use std::fmt::Write;

use super::scale::Scale;
use super::{LEFT, Mark, Plot, RIGHT, at, is_dense, thin};
use crate::report::escape::xml;

/// Coordinates of the plot area.
pub(super) struct Frame {
    pub(super) x: Scale,
    pub(super) y: Scale,
    /// Of the whole plot.
    pub(super) width: f64,
    pub(super) top: f64,
    pub(super) bottom: f64,
}

/// Columns to which long lines are decimated.
pub(super) const COLUMNS: usize = 240;

impl Frame {
    /// Maximum number of dots of a scatter plot.
    const DOTS: usize = 500;

    fn px(&self, x: f64) -> f64 {
        LEFT + self.x.fraction(x) * (self.width - LEFT - RIGHT)
    }

    fn py(&self, y: f64) -> f64 {
        self.bottom - self.y.fraction(y) * (self.bottom - self.top)
    }

    fn path(&self, points: &[[f64; 2]]) -> String {
        let mut path = String::from("M");
        for (n, point) in points.iter().enumerate() {
            let space = if n == 0 { "" } else { " " };
            let _ = write!(path, "{space}{} {}", at(self.px(point[0])), at(self.py(point[1])));
        }
        path
    }

    pub(super) fn axes(&self, plot: &Plot, out: &mut String) {
        let (x, y) = (plot.x.named_ticks(8), plot.y.named_ticks(6));
        let (right, width) = (at(self.width - RIGHT), self.width - LEFT - RIGHT);
        let mut grid = String::new();
        for &(value, _) in &y {
            let _ = write!(grid, "M{LEFT} {}H{right}", at(self.py(value)));
        }
        let _ = write!(out, "<path class=\"grid\" d=\"{grid}\"/>");
        if self.y.from < 0.0 && self.y.to > 0.0 {
            let _ = write!(out, "<path class=\"zero\" d=\"M{LEFT} {}H{right}\"/>", at(self.py(0.0)));
        }
        let _ = write!(out, "<path class=\"axis\" d=\"M{LEFT} {}V{}h{width}", at(self.top), at(self.bottom));
        for &(value, _) in &x {
            let _ = write!(out, "M{} {}v4", at(self.px(value)), at(self.bottom));
        }
        out.push_str("\"/>");
        self.labels(&x, &y, out);
        let (middle_x, middle_y) = (at(LEFT + width / 2.0), at((self.top + self.bottom) / 2.0));
        let _ = write!(
            out,
            "<text class=\"label\" x=\"{middle_x}\" y=\"{}\" text-anchor=\"middle\">{}</text>\
             <text class=\"label\" transform=\"translate(14 {middle_y}) rotate(-90)\" \
             text-anchor=\"middle\">{}</text>",
            at(self.bottom + 33.0),
            xml(&plot.x.label),
            xml(&plot.y.label)
        );
    }

    fn labels(&self, x: &[(f64, String)], y: &[(f64, String)], out: &mut String) {
        out.push_str("<g class=\"tick\" text-anchor=\"middle\">");
        for (value, name) in x {
            let (place, line) = (at(self.px(*value)), at(self.bottom + 17.0));
            let _ = write!(out, "<text x=\"{place}\" y=\"{line}\">{}</text>", xml(name));
        }
        out.push_str("</g><g class=\"tick\" text-anchor=\"end\">");
        for (value, name) in y {
            let line = at(self.py(*value) + 4.0);
            let _ = write!(out, "<text x=\"{}\" y=\"{line}\">{}</text>", at(LEFT - 6.0), xml(name));
        }
        out.push_str("</g>");
    }

    pub(super) fn mark(&self, mark: &Mark, out: &mut String) {
        let (kind, style, path) = match mark {
            Mark::Band { style, points, gap } => ("area", style, self.band(points, *gap)),
            Mark::Line { style, points, gap } if is_dense(points.len()) => {
                let ranges = thin::ranges(points, self.x, COLUMNS, *gap);
                let around = ranges.iter().map(|run| self.range(run)).collect::<String>();
                let _ = write!(out, "<path class=\"area range {}\" d=\"{around}\"/>", style.class());
                let mean = |run: &Vec<thin::Range>| {
                    self.path(&run.iter().map(|r| [r.x, r.mean]).collect::<Vec<_>>())
                };
                ("line", style, ranges.iter().map(mean).collect())
            }
            Mark::Line { style, points, gap } => {
                let runs = thin::line(points, self.x, COLUMNS, *gap);
                ("line", style, runs.iter().map(|run| self.path(run)).collect())
            }
            Mark::Dots { style, points } => ("dots", style, self.cloud(points)),
            Mark::Columns { style, columns } => ("area", style, self.columns(columns)),
            Mark::Interval { style, from, to, .. } => {
                ("area", style, self.interval(*from, *to, self.top, 1.5))
            }
            Mark::Strip { style, intervals } => (
                "area",
                style,
                intervals.iter().map(|s| self.interval(s[0], s[1], self.bottom - 5.0, 0.5)).collect(),
            ),
        };
        if !path.is_empty() {
            let _ = write!(out, "<path class=\"{kind} {}\" d=\"{path}\"/>", style.class());
        }
    }

    /// Letters are drawn above everything else.
    pub(super) fn letters(&self, marks: &[Mark], out: &mut String) {
        for mark in marks {
            let Mark::Interval { from, to, letter, .. } = mark else { continue };
            let middle = (self.px(*from) + self.px(*to)) / 2.0;
            let (x, y) = (at(middle), at(self.top + 13.0));
            let _ = write!(
                out,
                "<text class=\"letter\" x=\"{x}\" y=\"{y}\" text-anchor=\"middle\">{}</text>",
                xml(letter)
            );
        }
    }

    fn range(&self, run: &[thin::Range]) -> String {
        let there = run.iter().map(|range| [range.x, range.highest]);
        let back = run.iter().rev().map(|range| [range.x, range.lowest]);
        self.path(&there.chain(back).collect::<Vec<_>>()) + "z"
    }

    /// Fewer columns than for a line, since noise changes slowly.
    fn band(&self, points: &[[f64; 2]], gap: f64) -> String {
        let mut path = String::new();
        for run in thin::line(points, self.x, COLUMNS / 4, gap) {
            let back = run.iter().rev().map(|&[x, half]| [x, -half]);
            let around: Vec<[f64; 2]> = run.iter().copied().chain(back).collect();
            path.push_str(&self.path(&around));
            path.push('z');
        }
        path
    }

    fn cloud(&self, points: &[[f64; 2]]) -> String {
        let mut path = String::new();
        for point in thin::dots(points, self.x, self.y, Self::DOTS) {
            let _ = write!(path, "M{} {}h0", at(self.px(point[0])), at(self.py(point[1])));
        }
        path
    }

    fn columns(&self, columns: &[[f64; 3]]) -> String {
        let mut path = String::new();
        for &[from, to, value] in columns.iter().filter(|column| column.iter().all(|v| v.is_finite())) {
            let (left, right) = (self.px(from), self.px(to));
            let _ = write!(
                path,
                "M{} {}V{}H{}V{}z",
                at(left),
                at(self.py(0.0)),
                at(self.py(value)),
                at(right),
                at(self.py(0.0))
            );
        }
        path
    }

    /// From `top` down to the bottom, with a minimum visible width.
    fn interval(&self, from: f64, to: f64, top: f64, least: f64) -> String {
        let (left, right) = (self.px(from), self.px(to));
        let right = right.max(left + least);
        format!("M{} {}H{}V{}H{}z", at(left), at(top), at(right), at(self.bottom), at(left))
    }
}
