//! The feet from above: support polygon, centres of pressure and mass, hands. Forward is up, so left is left.

use equipoise_core::body::{Segment, Side};
use equipoise_core::message::{State, Validity};
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Color, Style};
use ratatui::symbols::Marker;
use ratatui::text::Span;
use ratatui::widgets::canvas::{Canvas, Context, Line};

use super::{faint, heading};

/// Minimum extent of the view in each direction, m.
const SHOWN_MIN_M: f64 = 0.5;
/// Margin around the contents, m.
const BORDER_M: f64 = 0.05;
/// Half the width of a drawn foot, m.
const FOOT_HALF_WIDTH_M: f64 = 0.045;
/// Distances of the heel behind the ankle and of the tip in front of the ball, relative to the length from ankle to
/// ball.
const HEEL_BACK: f64 = 0.25;
const TIP_FORWARD: f64 = 0.3;
/// Number of corners of an ellipse.
const ELLIPSE: usize = 24;

/// World X (forward) and Y (left), m.
type Point = [f64; 2];

pub(super) fn draw(frame: &mut Frame<'_>, state: &State, area: Rect) {
    let title = Rect { height: 1, ..area };
    frame.render_widget(heading("Plate, forward is up"), title);
    let area = Rect { y: area.y + 1, height: area.height - 1, ..area };
    let feet = soles(state);
    let support = hull(&feet.concat());
    let measured = state.unless(Validity::INVALIDATES_COP_MEASURED, state.cop_measured_m);
    let estimated = state.unless(Validity::INVALIDATES_COP_ESTIMATED, state.cop_estimated_m);
    let seen: Vec<Point> = support.iter().copied().chain(measured).chain(estimated).collect();
    let Some(bounds) = bounds(&seen, area) else {
        frame.render_widget(ratatui::text::Line::styled(" -", faint()), area);
        return;
    };
    let canvas = Canvas::default()
        .marker(Marker::Braille)
        .x_bounds([-bounds[1][1], -bounds[1][0]])
        .y_bounds(bounds[0])
        .paint(|context| {
            polygon(context, &support, Color::DarkGray);
            for foot in &feet {
                polygon(context, foot, Color::Reset);
            }
            if let Some(estimated) = estimated {
                polygon(context, &ellipse(estimated, state.cop_sigma_m), Color::Blue);
                mark(context, estimated, "o", Color::Blue);
            }
            if let Some([x, y, _]) = state.unless(Validity::INVALIDATES_COM, state.com_m) {
                mark(context, [x, y], "x", Color::Blue);
            }
            for (hand, name) in hands(state) {
                mark(context, hand, name, Color::Reset);
            }
            if let Some(measured) = measured {
                mark(context, measured, "+", Color::Red);
            }
        });
    frame.render_widget(canvas, area);
}

/// Outlines of the feet as on the page: from a little behind the ankle to the tip of the toes.
fn soles(state: &State) -> Vec<Vec<Point>> {
    if state.suit_sample_time_ns == 0 || state.validity().any_of(Validity::INVALIDATES_COM) {
        return Vec::new();
    }
    let at = |segment: Segment| state.segment_origin_m[segment.index()];
    let outline = |side: Side| {
        let ([ax, ay, _], [bx, by, _]) = (at(side.foot()), at(side.toe()));
        let (dx, dy) = (bx - ax, by - ay);
        let length = dx.hypot(dy);
        (length > 1e-3).then(|| {
            let (wx, wy) = (-dy / length * FOOT_HALF_WIDTH_M, dx / length * FOOT_HALF_WIDTH_M);
            let (heel, tip) = (-HEEL_BACK, 1.0 + TIP_FORWARD);
            [(heel, 1.0), (tip, 1.0), (tip, -1.0), (heel, -1.0)]
                .map(|(along, across)| [ax + along * dx + across * wx, ay + along * dy + across * wy])
                .to_vec()
        })
    };
    Side::BOTH.into_iter().filter_map(outline).collect()
}

fn hands(state: &State) -> Vec<(Point, &'static str)> {
    if state.suit_sample_time_ns == 0 || state.validity().any_of(Validity::INVALIDATES_COM) {
        return Vec::new();
    }
    let at = |segment: Segment| {
        let [x, y, _] = state.segment_origin_m[segment.index()];
        [x, y]
    };
    vec![(at(Segment::LeftHand), "L"), (at(Segment::RightHand), "R")]
}

/// Limits of the view in X and Y, with one scale for both: a dot of a terminal is as high as it is wide.
fn bounds(points: &[Point], area: Rect) -> Option<[[f64; 2]; 2]> {
    if points.is_empty() || area.width == 0 || area.height == 0 {
        return None;
    }
    let range = |axis: usize| {
        let least = points.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        let most = points.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        let span = (most - least + 2.0 * BORDER_M).max(SHOWN_MIN_M);
        ((least + most) / 2.0, span)
    };
    let ((x, x_span), (y, y_span)) = (range(0), range(1));
    let (wide, high) = (2.0 * f64::from(area.width), 4.0 * f64::from(area.height));
    let metres_per_dot = (x_span / high).max(y_span / wide);
    let (half_x, half_y) = (metres_per_dot * high / 2.0, metres_per_dot * wide / 2.0);
    Some([[x - half_x, x + half_x], [y - half_y, y + half_y]])
}

/// The canvas's horizontal axis is −Y, because world Y points left.
fn polygon(context: &mut Context<'_>, corners: &[Point], color: Color) {
    for (index, from) in corners.iter().enumerate() {
        let to = corners[(index + 1) % corners.len()];
        context.draw(&Line { x1: -from[1], y1: from[0], x2: -to[1], y2: to[0], color });
    }
}

fn mark(context: &mut Context<'_>, at: Point, text: &'static str, color: Color) {
    context.print(-at[1], at[0], Span::styled(text, Style::new().fg(color)));
}

/// Two sigma: contains the true point with a probability of about 86 %.
fn ellipse(middle: Point, sigma: [f64; 2]) -> Vec<Point> {
    (0..ELLIPSE)
        .map(|corner| {
            let (sin, cos) = (core::f64::consts::TAU * corner as f64 / ELLIPSE as f64).sin_cos();
            [middle[0] + 2.0 * sigma[0] * cos, middle[1] + 2.0 * sigma[1] * sin]
        })
        .collect()
}

/// The convex hull, counter-clockwise (Andrew's monotone chain).
fn hull(points: &[Point]) -> Vec<Point> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let turns_left =
        |a: Point, b: Point, c: Point| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0;
    let chain = |points: &mut dyn Iterator<Item = Point>| {
        let mut chain: Vec<Point> = Vec::new();
        for point in points {
            while chain.len() >= 2 && !turns_left(chain[chain.len() - 2], chain[chain.len() - 1], point) {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut lower = chain(&mut sorted.iter().copied());
    lower.extend(chain(&mut sorted.iter().rev().copied()));
    lower
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hull_holds_every_point_and_has_no_corner_inside() {
        let points = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.5], [0.5, 0.0]];
        let mut corners = hull(&points);
        corners.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        assert_eq!(corners, [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]);
        assert!(hull(&[]).is_empty());
    }

    #[test]
    fn both_directions_have_one_scale() {
        let area = Rect { x: 0, y: 0, width: 40, height: 10 };
        let [[x0, x1], [y0, y1]] = bounds(&[[0.0, 0.0], [0.1, 1.0]], area).unwrap();
        assert!(((x1 - x0) / 40.0 - (y1 - y0) / 80.0).abs() < 1e-12);
        assert!(y0 < 0.0 && y1 > 1.0 && x0 < 0.0 && x1 > 0.1);
        assert!(bounds(&[], area).is_none());
    }
}
