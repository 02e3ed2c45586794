//! The joints over time, one strip each; colour and height of a bar are the level. Invalid intervals stay empty.

use std::fmt::Write;

use equipoise_core::body::Joint;
use equipoise_core::overload::Level;
use equipoise_view::levels::{LevelStyle, severity};
use equipoise_view::words;

use crate::report::escaped;
use crate::report::svg::{Drawing, FULL_WIDTH as WIDTH};

use super::exposure::Exposure;
use crate::constants::COLUMN_S;

const NAMES: f64 = 132.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 48.0;
const ROW: f64 = 18.0;
/// Height of the highest bar.
const BAR: f64 = 14.0;
/// Number of columns of the drawing.
const COLUMNS: usize = 480;

/// Heights of the bars.
const HEIGHTS: [(Level, f64); 5] = [
    (Level::Green, 0.12),
    (Level::Undecided, 0.25),
    (Level::Orange, 0.5),
    (Level::Red, 0.75),
    (Level::AboveMax, 1.0),
];

/// Height of a level's bar as a fraction of the highest one; 0 for `none`.
pub(super) fn bar_fraction(level: Level) -> f64 {
    HEIGHTS.iter().find(|(of, _)| *of == level).map_or(0.0, |(_, fraction)| *fraction)
}

/// Draws the joints with valid torques; `None` if there are none.
pub(super) fn strips(exposure: &Exposure, span_s: [f64; 2], minutes: bool) -> Option<Drawing> {
    let joints: Vec<Joint> =
        Joint::ALL.into_iter().filter(|joint| exposure.joints[joint.index()].peak.is_some()).collect();
    if joints.is_empty() {
        return None;
    }
    let mut body =
        String::from("<text class=\"title\" x=\"8\" y=\"16\">Level of every joint over time</text>");
    legend(&mut body);
    for (row, joint) in joints.iter().enumerate() {
        let foot = TOP + ROW * (row as f64 + 1.0) - 2.0;
        let _ = write!(
            body,
            "<text x=\"{:.0}\" y=\"{:.0}\" text-anchor=\"end\">{}</text>\
             <path class=\"grid\" d=\"M{NAMES} {foot:.1}H{:.1}\"/>",
            NAMES - 8.0,
            foot - 3.0,
            escaped(words::joint(*joint)),
            WIDTH - RIGHT
        );
        strip(exposure, *joint, span_s, foot, &mut body);
    }
    let bottom = TOP + ROW * joints.len() as f64;
    axis(span_s, minutes, bottom, &mut body);
    let title = "Level of every joint over time";
    let description =
        "One strip per joint; the higher the bar, the higher the level. Gaps: torques were withheld.";
    Some(Drawing::new("levels", title, description, bottom + 42.0, body).full())
}

fn strip(exposure: &Exposure, joint: Joint, span_s: [f64; 2], foot: f64, out: &mut String) {
    let length_s = (span_s[1] - span_s[0]).max(COLUMN_S);
    // A column shows the highest level of the seconds that it covers.
    let mut levels: [Option<Level>; COLUMNS] = [None; COLUMNS];
    for (number, column) in &exposure.columns {
        let Some(level) = column[joint.index()] else { continue };
        let column_at =
            |time_s: f64| ((time_s - span_s[0]) / length_s * COLUMNS as f64).clamp(0.0, COLUMNS as f64);
        let from_s = *number as f64 * COLUMN_S;
        let first = (column_at(from_s) as usize).min(COLUMNS - 1);
        let last = (column_at(from_s + COLUMN_S).ceil() as usize).clamp(first + 1, COLUMNS);
        for place in &mut levels[first..last] {
            if place.is_none_or(|before| severity(level) > severity(before)) {
                *place = Some(level);
            }
        }
    }
    let width = (WIDTH - RIGHT - NAMES) / COLUMNS as f64;
    for (level, fraction) in HEIGHTS {
        let height = BAR * fraction;
        let mut path = String::new();
        let mut from = 0;
        while from < COLUMNS {
            let run = levels[from..].iter().take_while(|levels| **levels == Some(level)).count();
            if run > 0 {
                let (left, long) = (NAMES + width * from as f64, width * run as f64);
                let _ = write!(path, "M{left:.1} {foot:.1}h{long:.1}v-{height:.1}h-{long:.1}z");
            }
            from += run.max(1);
        }
        if !path.is_empty() {
            let _ = write!(out, "<path fill=\"{}\" d=\"{path}\"/>", LevelStyle::of(level).colour);
        }
    }
}

fn legend(out: &mut String) {
    let mut left = 8.0;
    for (level, fraction) in HEIGHTS {
        let (name, height) = (words::level(level as u32), BAR * fraction);
        let colour = &LevelStyle::of(level).colour;
        let _ = write!(
            out,
            "<path fill=\"{colour}\" d=\"M{left:.0} 37h14v-{height:.1}h-14z\"/>\
             <text class=\"key\" x=\"{:.0}\" y=\"37\">{name}</text>",
            left + 19.0
        );
        left += 34.0 + 7.0 * name.len() as f64;
    }
    let _ = write!(out, "<text class=\"key\" x=\"{left:.0}\" y=\"37\">gap: withheld</text>");
}

fn axis(span_s: [f64; 2], minutes: bool, bottom: f64, out: &mut String) {
    let (unit_s, name) = if minutes { (60.0, "min") } else { (1.0, "s") };
    for quarter in 0..=4 {
        let fraction = f64::from(quarter) / 4.0;
        let x = NAMES + fraction * (WIDTH - RIGHT - NAMES);
        let time = (span_s[0] + fraction * (span_s[1] - span_s[0])) / unit_s;
        let _ = write!(
            out,
            "<path class=\"axis\" d=\"M{x:.1} {bottom:.1}v4\"/>\
             <text class=\"tick\" x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{time:.0}</text>",
            bottom + 17.0
        );
    }
    let middle = (NAMES + WIDTH - RIGHT) / 2.0;
    let _ = write!(
        out,
        "<text class=\"label\" x=\"{middle:.0}\" y=\"{:.1}\" text-anchor=\"middle\">time, {name}</text>",
        bottom + 34.0
    );
}
