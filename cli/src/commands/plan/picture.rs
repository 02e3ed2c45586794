//! The map as a picture: a cell for each place in front of the worker, seen from the worker's right.

use std::fmt::Write as _;

use equipoise_core::handover::search::{PlacePrediction, REGION_M, SPACING_M};
use equipoise_core::overload::Level;
use equipoise_view::levels::LevelStyle;

/// Width and height of a cell, and margins left and below, px.
const CELL: f64 = 44.0;
const MARGIN: [f64; 2] = [70.0, 60.0];

pub(super) fn svg(map: &[PlacePrediction], best: &PlacePrediction, mass_kg: f64, subject: &str) -> String {
    let [[x_min, x_max], _, [z_min, z_max]] = REGION_M;
    let cells = |low: f64, high: f64| ((high - low) / SPACING_M).round() + 1.0;
    let (width, height) = (cells(x_min, x_max) * CELL, cells(z_min, z_max) * CELL);
    let [left, below] = MARGIN;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{:.0}\" height=\"{:.0}\" font-family=\"sans-serif\" \
         font-size=\"14\" text-anchor=\"middle\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n<text x=\"{:.0}\" \
         y=\"24\" font-size=\"16\">{mass_kg} kg, {subject}: limit ratio, %</text>\n",
        left + width + 20.0,
        40.0 + height + below,
        left + 0.5 * width,
    );
    // The slice with the best place.
    for place in map.iter().filter(|place| (place.place_m.y - best.place_m.y).abs() < 0.5 * SPACING_M) {
        let x = left + (place.place_m.x - x_min) / SPACING_M * CELL;
        let y = 40.0 + (z_max - place.place_m.z) / SPACING_M * CELL;
        let (fill, ink, text) = match place.predicted {
            Ok((_, ratio)) => {
                let style = LevelStyle::of(Level::of(ratio.value, 1.0));
                (style.colour.as_str(), style.ink.as_str(), format!("{:.0}", 100.0 * ratio.value))
            }
            Err(_) => ("#eeeeee", "#555555", "–".to_owned()),
        };
        let line = if place.place_m == best.place_m { "black\" stroke-width=\"4" } else { "white" };
        let _ = writeln!(
            svg,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.0}\" height=\"{:.0}\" fill=\"{fill}\" stroke=\"{line}\"/><text \
             x=\"{:.1}\" y=\"{:.1}\" fill=\"{ink}\">{text}</text>",
            x + 2.0,
            y + 2.0,
            CELL - 4.0,
            CELL - 4.0,
            x + 0.5 * CELL,
            y + 0.5 * CELL + 5.0
        );
    }
    for step in 0..cells(x_min, x_max) as u32 {
        let (x, metres) = (left + (f64::from(step) + 0.5) * CELL, x_min + f64::from(step) * SPACING_M);
        let _ = writeln!(svg, "<text x=\"{x:.0}\" y=\"{:.0}\">{metres:.2}</text>", 40.0 + height + 20.0);
    }
    for step in 0..cells(z_min, z_max) as u32 {
        let (y, metres) = (40.0 + (f64::from(step) + 0.5) * CELL, z_max - f64::from(step) * SPACING_M);
        let _ = writeln!(svg, "<text x=\"40\" y=\"{:.0}\">{metres:.2}</text>", y + 5.0);
    }
    let _ = writeln!(
        svg,
        "<text x=\"{:.0}\" y=\"{:.0}\">forward of the ankles, m; height, m; {:.2} m to the left</text>\n</svg>",
        left + 0.5 * width,
        40.0 + height + 44.0,
        best.place_m.y
    );
    svg
}
