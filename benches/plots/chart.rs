//! A chart with classes along x, drawn as SVG without a script: grouped bars, or lines.

use std::fmt::Write;

const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 320.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 70.0;
const BOTTOM: f64 = 58.0;
/// Okabe and Ito's colours, distinguishable with any colour vision.
const COLOURS: [&str; 6] = ["#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#56b4e9"];
const STYLE: &str = "text{font:12px system-ui,'DejaVu Sans',sans-serif;fill:#17202b}.soft{fill:#566273}\
    .title{font-size:14px;font-weight:600}.ground{fill:#fff}.grid{stroke:#e3e8ee}.axis{stroke:#8a96a5;fill:none}\
    @media(prefers-color-scheme:dark){text{fill:#e8edf4}.soft{fill:#a9b5c4}.ground{fill:#19202a}.grid{stroke:#29323e}}";

/// Style of the values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Bars,
    Lines,
}

/// One series: a name and a value for each class; NaN where there is none.
#[derive(Debug, Clone)]
pub(crate) struct Series {
    pub(crate) name: String,
    pub(crate) values: Vec<f64>,
}

/// A whole chart.
#[derive(Debug, Clone)]
pub(crate) struct Chart {
    pub(crate) title: &'static str,
    pub(crate) x: &'static str,
    pub(crate) y: &'static str,
    pub(crate) kind: Kind,
    /// Powers of ten along y.
    pub(crate) logarithmic: bool,
    pub(crate) classes: Vec<String>,
    pub(crate) series: Vec<Series>,
}

/// Converts values to coordinates.
struct Scale {
    from: f64,
    to: f64,
    logarithmic: bool,
}

impl Scale {
    fn y(&self, value: f64) -> f64 {
        let fraction = if self.logarithmic {
            (value.max(self.from) / self.from).log10() / (self.to / self.from).log10()
        } else {
            (value - self.from) / (self.to - self.from)
        };
        HEIGHT - BOTTOM - fraction * (HEIGHT - BOTTOM - TOP)
    }

    fn ticks(&self) -> Vec<f64> {
        if self.logarithmic {
            let decades = (self.to / self.from).log10().round() as i32;
            return (0..=decades).map(|decade| self.from * 10_f64.powi(decade)).collect();
        }
        let step = step_of(self.to);
        (0..).map(|n| f64::from(n) * step).take_while(|tick| *tick <= self.to * 1.0001).collect()
    }
}

/// A round step that divides a range into four to eight.
fn step_of(range: f64) -> f64 {
    let rough = 10_f64.powf((range / 5.0).log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * rough);
    steps.into_iter().find(|step| range / step <= 6.0).unwrap_or(range)
}

impl Chart {
    fn scale(&self) -> Scale {
        let all = || self.series.iter().flat_map(|one| one.values.iter().copied());
        let finite = || all().filter(|value| value.is_finite() && *value > 0.0);
        let most = finite().fold(0.0, f64::max).max(1e-9);
        if self.logarithmic {
            let decade = |value: f64, round: fn(f64) -> f64| 10_f64.powf(round(value.log10()));
            let least = finite().fold(most, f64::min);
            return Scale {
                from: decade(0.8 * least, f64::floor),
                to: decade(most, f64::ceil),
                logarithmic: true,
            };
        }
        let step = step_of(most);
        Scale { from: 0.0, to: (most / step).ceil() * step, logarithmic: false }
    }

    /// Draws it.
    pub(crate) fn svg(&self) -> String {
        let scale = self.scale();
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" \
             role=\"img\"><title>{0}</title><style>{STYLE}</style><rect class=\"ground\" width=\"100%\" \
             height=\"100%\"/><text class=\"title\" x=\"{LEFT}\" y=\"20\">{0}</text>",
            self.title
        );
        self.legend(&mut out);
        self.axes(&scale, &mut out);
        for (index, one) in self.series.iter().enumerate() {
            match self.kind {
                Kind::Lines => self.line(&scale, index, one, &mut out),
                Kind::Bars => self.bars(&scale, index, one, &mut out),
            }
        }
        out.push_str("</svg>\n");
        out
    }

    fn middle(&self, class: usize) -> f64 {
        LEFT + (class as f64 + 0.5) * self.class_width()
    }

    fn class_width(&self) -> f64 {
        (WIDTH - LEFT - RIGHT) / self.classes.len() as f64
    }

    fn legend(&self, out: &mut String) {
        let (mut x, mut y) = (LEFT, 41.0);
        for (index, one) in self.series.iter().enumerate() {
            let width = 30.0 + 6.6 * one.name.chars().count() as f64;
            if x + width > WIDTH && x > LEFT {
                (x, y) = (LEFT, y + 17.0);
            }
            let _ = write!(
                out,
                "<rect x=\"{x:.1}\" y=\"{:.1}\" width=\"12\" height=\"10\" fill=\"{}\"/><text class=\"soft\" x=\"{:.1}\" \
                 y=\"{y:.1}\">{}</text>",
                y - 9.0,
                COLOURS[index % COLOURS.len()],
                x + 17.0,
                one.name
            );
            x += width;
        }
    }

    fn axes(&self, scale: &Scale, out: &mut String) {
        for tick in scale.ticks() {
            let y = scale.y(tick);
            let _ = write!(
                out,
                "<path class=\"grid\" d=\"M{LEFT} {y:.1}H{}\"/><text class=\"soft\" x=\"{}\" y=\"{:.1}\" \
                 text-anchor=\"end\">{tick}</text>",
                WIDTH - RIGHT,
                LEFT - 6.0,
                y + 4.0
            );
        }
        let foot = HEIGHT - BOTTOM;
        let _ = write!(out, "<path class=\"axis\" d=\"M{LEFT} {TOP}V{foot}H{}\"/>", WIDTH - RIGHT);
        for (class, name) in self.classes.iter().enumerate() {
            let x = self.middle(class);
            // Long names take two lines.
            for (line, part) in name.splitn(2, ", ").enumerate() {
                let y = foot + 17.0 + 14.0 * line as f64;
                let _ = write!(out, "<text x=\"{x:.1}\" y=\"{y}\" text-anchor=\"middle\">{part}</text>");
            }
        }
        let _ = write!(
            out,
            "<text class=\"soft\" x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text><text class=\"soft\" \
             transform=\"translate(15 {}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            (LEFT + WIDTH - RIGHT) / 2.0,
            HEIGHT - 8.0,
            self.x,
            f64::midpoint(TOP, foot),
            self.y
        );
    }

    fn bars(&self, scale: &Scale, index: usize, one: &Series, out: &mut String) {
        let side_by_side = self.series.len() as f64;
        let width = 0.8 * self.class_width() / side_by_side;
        for (class, value) in one.values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
            let x = self.middle(class) + width * (index as f64 - side_by_side / 2.0);
            let (y, foot) = (scale.y(*value), scale.y(scale.from));
            let _ = write!(
                out,
                "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{}\"/>",
                width - 1.0,
                foot - y,
                COLOURS[index % COLOURS.len()]
            );
        }
    }

    fn line(&self, scale: &Scale, index: usize, one: &Series, out: &mut String) {
        let colour = COLOURS[index % COLOURS.len()];
        let places = one.values.iter().enumerate().filter(|(_, value)| value.is_finite());
        let places: Vec<(f64, f64)> =
            places.map(|(class, value)| (self.middle(class), scale.y(*value))).collect();
        let path: Vec<String> = places.iter().map(|(x, y)| format!("{x:.1} {y:.1}")).collect();
        let _ = write!(
            out,
            "<path d=\"M{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>",
            path.join("L")
        );
        for (x, y) in places {
            let _ = write!(out, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\" fill=\"{colour}\"/>");
        }
    }
}
