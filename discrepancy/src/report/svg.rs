//! Plots, drawn as SVG without a script. Colours come from a style sheet, for light and dark; none carries meaning alone.

pub(super) mod rows;
pub(super) mod scale;
pub(super) mod thin;

use std::fmt::Write;

use super::escape::xml;
use scale::{Scale, Ticks};

/// Colours of all plots. Okabe and Ito's palette, which people with any colour vision can tell apart.
pub(super) const STYLE: &str = include_str!("plot.css");

/// Width of every plot, in its own units: what fits twice on a page.
const WIDTH: f64 = 540.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 14.0;
const BOTTOM: f64 = 40.0;
/// A finished drawing.
#[derive(Debug, Clone)]
pub(super) struct Drawing {
    /// Stem of its file's name, and its identifier in the page.
    pub(super) name: String,
    /// What is seen, in a few words.
    pub(super) title: String,
    /// Outer height.
    height: f64,
    description: String,
    body: String,
}

impl Drawing {
    pub(super) fn new(name: &str, title: &str, description: &str, height: f64, body: String) -> Drawing {
        let (name, title, description) = (name.to_owned(), title.to_owned(), description.to_owned());
        Drawing { name, title, height, description, body }
    }

    /// To stand in a page that has [`STYLE`].
    pub(super) fn inline(&self) -> String {
        self.element("", "")
    }

    /// As a file of its own.
    pub(super) fn standalone(&self) -> String {
        let ground = format!("<style>{STYLE}</style><rect class=\"ground\" width=\"100%\" height=\"100%\"/>");
        let mut text = self.element(" xmlns=\"http://www.w3.org/2000/svg\" width=\"540\"", &ground);
        text.push('\n');
        text
    }

    fn element(&self, attributes: &str, first: &str) -> String {
        let (name, height) = (xml(&self.name), at(self.height));
        format!(
            "<svg class=\"plot\" viewBox=\"0 0 {WIDTH} {height}\"{attributes} role=\"img\" \
             aria-labelledby=\"{name}-t {name}-d\"><title id=\"{name}-t\">{}</title>\
             <desc id=\"{name}-d\">{}</desc>{first}{}</svg>",
            xml(&self.title),
            xml(&self.description),
            self.body
        )
    }
}

/// What a mark stands for; its name is its class in the style sheet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Look {
    Before,
    After,
    Noise,
    Expected,
    Suspect,
    Still,
}

impl Look {
    pub(super) const fn class(self) -> &'static str {
        match self {
            Look::Before => "before",
            Look::After => "after",
            Look::Noise => "noise",
            Look::Expected => "expected",
            Look::Suspect => "suspect",
            Look::Still => "still",
        }
    }
}

/// Something drawn into the axes.
#[derive(Debug, Clone)]
pub(super) enum Mark {
    /// From `−half` to `half`: x and half. Broken where there is nothing for longer than `gap`.
    Band { look: Look, points: Vec<[f64; 2]>, gap: f64 },
    /// A line through points by x, broken likewise.
    Line { look: Look, points: Vec<[f64; 2]>, gap: f64 },
    /// A cloud.
    Dots { look: Look, points: Vec<[f64; 2]> },
    /// Columns from zero: begin, end, value.
    Columns { look: Look, columns: Vec<[f64; 3]> },
    /// A stretch of x with a letter.
    Stretch { look: Look, from: f64, to: f64, letter: String },
    /// Stretches of x along the foot of the plot.
    Strip { look: Look, stretches: Vec<[f64; 2]> },
}

/// How an entry of the legend looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Key {
    Line,
    Dot,
    Area,
}

/// An axis.
#[derive(Debug, Clone)]
pub(super) struct Axis {
    pub(super) label: String,
    pub(super) scale: Scale,
}

/// A plot with two axes.
#[derive(Debug, Clone)]
pub(super) struct Plot {
    pub(super) name: String,
    pub(super) title: String,
    pub(super) description: String,
    pub(super) x: Axis,
    pub(super) y: Axis,
    pub(super) marks: Vec<Mark>,
    pub(super) legend: Vec<(Key, Look, String)>,
}

impl Plot {
    const HEIGHT: f64 = 250.0;

    /// Draws it.
    pub(super) fn draw(&self) -> Drawing {
        let mut body = format!("<text class=\"title\" x=\"{LEFT}\" y=\"16\">{}</text>", xml(&self.title));
        let (legend, rows) = legend(&self.legend, 33.0);
        body.push_str(&legend);
        let frame = Frame {
            x: self.x.scale,
            y: self.y.scale,
            top: 26.0 + 17.0 * rows as f64,
            bottom: Self::HEIGHT - BOTTOM,
        };
        for mark in self.marks.iter().filter(|mark| mark.is_behind()) {
            frame.mark(mark, &mut body);
        }
        frame.axes(self, &mut body);
        for mark in self.marks.iter().filter(|mark| !mark.is_behind()) {
            frame.mark(mark, &mut body);
        }
        Drawing::new(&self.name, &self.title, &self.description, Self::HEIGHT, body)
    }
}

impl Mark {
    /// Whether the grid is drawn over it.
    fn is_behind(&self) -> bool {
        matches!(self, Mark::Band { .. } | Mark::Stretch { .. } | Mark::Strip { .. })
    }
}

/// Lays entries side by side; returns how many rows they took.
pub(super) fn legend(entries: &[(Key, Look, String)], first_y: f64) -> (String, usize) {
    /// Advance of an average letter of the legend's type.
    const LETTER: f64 = 5.5;
    let (mut out, mut x, mut row) = (String::new(), LEFT, 0);
    for (key, look, text) in entries {
        let width = 34.0 + LETTER * text.chars().count() as f64;
        if x > LEFT && x + width > WIDTH - RIGHT {
            (x, row) = (LEFT, row + 1);
        }
        let (class, y) = (look.class(), first_y + 17.0 * row as f64);
        let (left, middle) = (at(x), at(y - 4.0));
        let _ = match key {
            Key::Line => write!(out, "<path class=\"line {class}\" d=\"M{left} {middle}h18\"/>"),
            Key::Dot => write!(out, "<path class=\"dots {class}\" d=\"M{} {middle}h0\"/>", at(x + 9.0)),
            Key::Area => {
                write!(out, "<path class=\"area {class}\" d=\"M{left} {}h18v10h-18z\"/>", at(y - 9.0))
            }
        };
        let _ =
            write!(out, "<text class=\"key\" x=\"{}\" y=\"{}\">{}</text>", at(x + 23.0), at(y), xml(text));
        x += width;
    }
    (out, if entries.is_empty() { 0 } else { row + 1 })
}

/// Where values come to lie.
struct Frame {
    x: Scale,
    y: Scale,
    top: f64,
    bottom: f64,
}

impl Frame {
    /// Columns into which long lines are thinned.
    const COLUMNS: usize = 330;
    /// Most dots of a cloud.
    const DOTS: usize = 500;

    fn px(&self, x: f64) -> f64 {
        LEFT + self.x.share(x) * (WIDTH - LEFT - RIGHT)
    }

    fn py(&self, y: f64) -> f64 {
        self.bottom - self.y.share(y) * (self.bottom - self.top)
    }

    fn path(&self, points: &[[f64; 2]]) -> String {
        let mut path = String::from("M");
        for (n, point) in points.iter().enumerate() {
            let space = if n == 0 { "" } else { " " };
            let _ = write!(path, "{space}{} {}", at(self.px(point[0])), at(self.py(point[1])));
        }
        path
    }

    fn axes(&self, plot: &Plot, out: &mut String) {
        let (x, y) = (self.x.ticks(8), self.y.ticks(6));
        let (right, width) = (at(WIDTH - RIGHT), WIDTH - LEFT - RIGHT);
        let mut grid = String::new();
        for &value in &y.values {
            let _ = write!(grid, "M{LEFT} {}H{right}", at(self.py(value)));
        }
        let _ = write!(out, "<path class=\"grid\" d=\"{grid}\"/>");
        if self.y.from < 0.0 && self.y.to > 0.0 {
            let _ = write!(out, "<path class=\"zero\" d=\"M{LEFT} {}H{right}\"/>", at(self.py(0.0)));
        }
        let _ = write!(out, "<path class=\"axis\" d=\"M{LEFT} {}V{}h{width}", at(self.top), at(self.bottom));
        for &value in &x.values {
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

    fn labels(&self, x: &Ticks, y: &Ticks, out: &mut String) {
        out.push_str("<g class=\"tick\" text-anchor=\"middle\">");
        for &value in &x.values {
            let (place, line) = (at(self.px(value)), at(self.bottom + 17.0));
            let _ = write!(out, "<text x=\"{place}\" y=\"{line}\">{}</text>", x.label(value));
        }
        out.push_str("</g><g class=\"tick\" text-anchor=\"end\">");
        for &value in &y.values {
            let line = at(self.py(value) + 4.0);
            let _ = write!(out, "<text x=\"{}\" y=\"{line}\">{}</text>", at(LEFT - 6.0), y.label(value));
        }
        out.push_str("</g>");
    }

    fn mark(&self, mark: &Mark, out: &mut String) {
        let (kind, look, path) = match mark {
            Mark::Band { look, points, gap } => ("area", look, self.band(points, *gap)),
            Mark::Line { look, points, gap } => {
                let runs = thin::line(points, self.x, Self::COLUMNS, *gap);
                ("line", look, runs.iter().map(|run| self.path(run)).collect())
            }
            Mark::Dots { look, points } => ("dots", look, self.cloud(points)),
            Mark::Columns { look, columns } => ("area", look, self.columns(columns)),
            Mark::Stretch { look, from, to, letter } => {
                let middle = (self.px(*from) + self.px(*to)) / 2.0;
                let (x, y) = (at(middle), at(self.top + 13.0));
                let _ = write!(
                    out,
                    "<text class=\"letter\" x=\"{x}\" y=\"{y}\" text-anchor=\"middle\">{}</text>",
                    xml(letter)
                );
                ("area", look, self.stretch(*from, *to, self.top, 1.5))
            }
            Mark::Strip { look, stretches } => (
                "area",
                look,
                stretches.iter().map(|s| self.stretch(s[0], s[1], self.bottom - 5.0, 0.5)).collect(),
            ),
        };
        if !path.is_empty() {
            let _ = write!(out, "<path class=\"{kind} {}\" d=\"{path}\"/>", look.class());
        }
    }

    /// Fewer columns than a line has: noise changes slowly.
    fn band(&self, points: &[[f64; 2]], gap: f64) -> String {
        let mut path = String::new();
        for run in thin::line(points, self.x, Self::COLUMNS / 4, gap) {
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

    /// From `top` down to the foot, at least so wide that it is seen.
    fn stretch(&self, from: f64, to: f64, top: f64, least: f64) -> String {
        let (left, right) = (self.px(from), self.px(to));
        let right = right.max(left + least);
        format!("M{} {}H{}V{}H{}z", at(left), at(top), at(right), at(self.bottom), at(left))
    }
}

/// A coordinate with a tenth of a unit, as short as it goes.
pub(super) fn at(value: f64) -> String {
    let text = format!("{value:.1}");
    text.strip_suffix(".0").map_or(text.clone(), str::to_owned)
}
