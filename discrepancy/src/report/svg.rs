//! Plots, drawn as SVG without a script. Colours come from a style sheet, for light and dark; no information is
//! conveyed by colour alone.

mod frame;
mod rows;
mod scale;
pub(super) mod thin;

use std::fmt::Write;

use super::escape::xml;
use frame::Frame;
pub use rows::{Row, Rows};
pub use scale::Scale;

/// Colours of all plots: Okabe and Ito's palette, distinguishable with any colour vision.
pub(super) const STYLE: &str = include_str!("plot.css");

/// Width of a plot, in its own units: two fit next to each other on a page.
pub(super) const WIDTH: f64 = 540.0;
/// Width of a plot over the whole page.
pub const FULL_WIDTH: f64 = 1100.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 14.0;
const BOTTOM: f64 = 40.0;

/// A finished drawing.
#[derive(Debug, Clone)]
pub struct Drawing {
    /// Stem of its file's name, and its identifier in the page.
    pub name: String,
    /// A short title.
    pub title: String,
    /// Outer size.
    width: f64,
    height: f64,
    description: String,
    body: String,
}

impl Drawing {
    /// A drawing 540 wide: `body` is SVG, in which external names are escaped already.
    pub fn new(name: &str, title: &str, description: &str, height: f64, body: String) -> Drawing {
        let (name, title, description) = (name.to_owned(), title.to_owned(), description.to_owned());
        Drawing { name, title, width: WIDTH, height, description, body }
    }

    /// A drawing over the whole page, [`FULL_WIDTH`] wide.
    pub fn full(self) -> Drawing {
        Drawing { width: FULL_WIDTH, ..self }
    }

    /// For a page that contains [`STYLE`].
    pub(super) fn inline(&self) -> String {
        self.element("", "")
    }

    /// As a separate file.
    pub(super) fn standalone(&self) -> String {
        let ground = format!("<style>{STYLE}</style><rect class=\"ground\" width=\"100%\" height=\"100%\"/>");
        let attributes = format!(" xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\"", self.width);
        let mut text = self.element(&attributes, &ground);
        text.push('\n');
        text
    }

    fn element(&self, attributes: &str, first: &str) -> String {
        let (name, width, height) = (xml(&self.name), self.width, at(self.height));
        let class = if width > WIDTH { "plot full" } else { "plot" };
        format!(
            "<svg class=\"{class}\" viewBox=\"0 0 {width} {height}\"{attributes} role=\"img\" \
             aria-labelledby=\"{name}-t {name}-d\"><title id=\"{name}-t\">{}</title>\
             <desc id=\"{name}-d\">{}</desc>{first}{}</svg>",
            xml(&self.title),
            xml(&self.description),
            self.body
        )
    }
}

/// Meaning of a mark; its name is its class in the style sheet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// The first of two.
    Before,
    /// The second of two, or the only one.
    After,
    /// Within noise.
    Noise,
    /// Expected value or target.
    Expected,
    /// Suspicious.
    Suspect,
    /// Static poses.
    Still,
}

impl Style {
    pub(super) const fn class(self) -> &'static str {
        match self {
            Style::Before => "before",
            Style::After => "after",
            Style::Noise => "noise",
            Style::Expected => "expected",
            Style::Suspect => "suspect",
            Style::Still => "still",
        }
    }
}

/// An element drawn in the axes.
#[derive(Debug, Clone)]
pub enum Mark {
    /// From `−half` to `half`: x and half. Interrupted at gaps longer than `gap`.
    Band {
        /// Style.
        style: Style,
        /// x and y.
        points: Vec<[f64; 2]>,
        /// Longest distance in x that is bridged.
        gap: f64,
    },
    /// A line through points by x, interrupted likewise. Points too dense to be resolved (`is_dense`) are drawn as the
    /// line of their means within their range.
    Line {
        /// Style.
        style: Style,
        /// x and y.
        points: Vec<[f64; 2]>,
        /// Longest distance in x that is bridged.
        gap: f64,
    },
    /// A scatter plot.
    Dots {
        /// Style.
        style: Style,
        /// x and y.
        points: Vec<[f64; 2]>,
    },
    /// Columns from zero: start, end, value.
    Columns {
        /// Style.
        style: Style,
        /// Start, end, value.
        columns: Vec<[f64; 3]>,
    },
    /// An interval of x with a letter.
    Interval {
        /// Style.
        style: Style,
        /// Start.
        from: f64,
        /// End.
        to: f64,
        /// Its letter.
        letter: String,
    },
    /// Intervals of x along the bottom of the plot.
    Strip {
        /// Style.
        style: Style,
        /// Start and end of each.
        intervals: Vec<[f64; 2]>,
    },
}

/// Whether a line has too many points to be resolved.
pub(super) const fn is_dense(points: usize) -> bool {
    points > 6 * frame::COLUMNS
}

/// Symbol of a legend entry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LegendKey {
    /// A line.
    Line,
    /// A dot.
    Dot,
    /// An area.
    Area,
}

/// An axis.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Quantity and unit.
    pub label: String,
    /// Its range.
    pub scale: Scale,
    /// Categories instead of a scale: position and name of each.
    pub classes: Vec<(f64, String)>,
}

impl Axis {
    /// An axis with a scale.
    pub fn new(label: impl Into<String>, scale: Scale) -> Axis {
        Axis { label: label.into(), scale, classes: Vec::new() }
    }

    /// Positions and labels of the ticks.
    fn named_ticks(&self, most: usize) -> Vec<(f64, String)> {
        if !self.classes.is_empty() {
            return self.classes.clone();
        }
        let ticks = self.scale.ticks(most);
        ticks.values.iter().map(|&value| (value, ticks.label(value))).collect()
    }
}

/// A plot with two axes.
#[derive(Debug, Clone)]
pub struct Plot {
    /// Identifier, unique in its page.
    pub name: String,
    /// A short title.
    pub title: String,
    /// Text alternative of the figure.
    pub description: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Elements.
    pub marks: Vec<Mark>,
    /// Legend entries.
    pub legend: Vec<(LegendKey, Style, String)>,
}

impl Plot {
    const HEIGHT: f64 = 250.0;

    /// Draws it.
    pub fn draw(&self) -> Drawing {
        self.draw_at(WIDTH)
    }

    /// Draws it over the whole page.
    pub fn draw_full(&self) -> Drawing {
        self.draw_at(FULL_WIDTH).full()
    }

    fn draw_at(&self, width: f64) -> Drawing {
        let mut body = format!("<text class=\"title\" x=\"{LEFT}\" y=\"16\">{}</text>", xml(&self.title));
        let (legend, rows) = legend(&self.legend, 33.0);
        body.push_str(&legend);
        let frame = Frame {
            x: self.x.scale,
            y: self.y.scale,
            width,
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
        frame.letters(&self.marks, &mut body);
        Drawing::new(&self.name, &self.title, &self.description, Self::HEIGHT, body)
    }
}

impl Mark {
    /// Whether it is drawn beneath the grid.
    fn is_behind(&self) -> bool {
        matches!(self, Mark::Band { .. } | Mark::Interval { .. } | Mark::Strip { .. })
    }
}

/// Lays out entries in rows; returns the number of rows.
pub(super) fn legend(entries: &[(LegendKey, Style, String)], first_y: f64) -> (String, usize) {
    /// Average advance of a letter in the legend's font.
    const LETTER: f64 = 5.8;
    let (mut out, mut x, mut row) = (String::new(), LEFT, 0);
    for (key, style, text) in entries {
        let width = 35.0 + LETTER * text.chars().count() as f64;
        if x > LEFT && x + width > WIDTH - RIGHT {
            (x, row) = (LEFT, row + 1);
        }
        let (class, y) = (style.class(), first_y + 17.0 * row as f64);
        let (left, middle) = (at(x), at(y - 4.0));
        let _ = match key {
            LegendKey::Line => write!(out, "<path class=\"line {class}\" d=\"M{left} {middle}h18\"/>"),
            LegendKey::Dot => write!(out, "<path class=\"dots {class}\" d=\"M{} {middle}h0\"/>", at(x + 9.0)),
            LegendKey::Area => {
                write!(out, "<path class=\"area {class}\" d=\"M{left} {}h18v10h-18z\"/>", at(y - 9.0))
            }
        };
        let _ =
            write!(out, "<text class=\"key\" x=\"{}\" y=\"{}\">{}</text>", at(x + 23.0), at(y), xml(text));
        x += width;
    }
    (out, if entries.is_empty() { 0 } else { row + 1 })
}

/// A coordinate to a tenth of a unit, in the shortest form.
pub(super) fn at(value: f64) -> String {
    let text = format!("{value:.1}");
    text.strip_suffix(".0").map_or(text.clone(), str::to_owned)
}
