//! The body as a stick figure, from the right and from behind, at each of its positions.

use std::fmt::Write;

use equipoise_core::body::Segment::{
    Head, L3, L5, LeftUpperLeg, Neck, Pelvis, RightFoot, RightForearm, RightHand, RightLowerLeg,
    RightShoulder, RightToe, RightUpperArm, RightUpperLeg, T8, T12,
};
use equipoise_core::body::{Joint, SEGMENTS, Segment, Side};
use equipoise_core::overload::Level;
use equipoise_view::levels::LevelStyle;
use equipoise_view::words;

use crate::report::document::{Scrubber, Step};
use crate::report::escaped;

use super::body_positions::{BodyPosition, BodyPositions};
use super::strips::bar_fraction;

const HEIGHT: f64 = 300.0;
/// Height of the walking surface in the drawing.
const FLOOR: f64 = 262.0;
/// Length of a metre.
const METRE: f64 = 100.0;
/// Middle of the ankles in the views from the right and from behind.
const MIDDLES: [f64; 2] = [150.0, 400.0];
/// Half the length of the drawn floor.
const HALF_FLOOR: f64 = 110.0;
/// Diameter of the dot of the highest level.
const DOT: f64 = 14.0;
/// Levels with a dot.
const DOTS: [Level; 4] = [Level::Undecided, Level::Orange, Level::Red, Level::AboveMax];

const TRUNK: &[Segment] = &[Pelvis, L5, L3, T12, T8, Neck, Head];
const RIGHT_LIMBS: [&[Segment]; 2] = [
    &[T8, RightShoulder, RightUpperArm, RightForearm, RightHand],
    &[Pelvis, RightUpperLeg, RightLowerLeg, RightFoot, RightToe],
];

/// Points of a view, by segment.
type View = [[f64; 2]; SEGMENTS];

/// One drawing for each position; `None` without a position.
pub(super) fn scrubber(body: &BodyPositions, surface_z_m: f64) -> Option<Scrubber> {
    let positions = body.positions();
    (!positions.is_empty()).then(|| Scrubber {
        name: "body".to_owned(),
        label: "Time: point at the strip, or select a time and use the arrow keys".to_owned(),
        height: HEIGHT,
        background: background(),
        steps: positions.iter().map(|position| step(position, surface_z_m)).collect(),
        selected: body.worst(),
    })
}

/// Floor, a height of 1 m and the names of the views.
fn background() -> String {
    let mut out = String::new();
    for (middle, name) in MIDDLES.into_iter().zip(["from the right", "from behind"]) {
        let (left, right, above, below) =
            (middle - HALF_FLOOR, middle + HALF_FLOOR, FLOOR - METRE, FLOOR + 20.0);
        let _ = write!(
            out,
            "<path class=\"grid\" d=\"M{left:.0} {above:.0}H{right:.0}\"/>\
             <text class=\"tick\" x=\"{left:.0}\" y=\"{:.0}\">1 m</text>\
             <path class=\"axis\" d=\"M{left:.0} {FLOOR:.0}H{right:.0}\"/>\
             <text class=\"label\" x=\"{middle:.0}\" y=\"{below:.0}\" text-anchor=\"middle\">{name}</text>",
            above - 4.0
        );
    }
    out
}

fn step(position: &BodyPosition, surface_z_m: f64) -> Step {
    let (label, level) = (label(position), position.highest_level());
    let mut body = format!("<text class=\"title\" x=\"8\" y=\"16\">{}</text>", escaped(&label));
    let views = views(position, surface_z_m);
    let mirrored = RIGHT_LIMBS.map(|limb| limb.iter().copied().map(Segment::mirrored).collect::<Vec<_>>());
    let left = mirrored.iter().map(Vec::as_slice);
    bones("bone far", &views, left, &mut body);
    bones("bone", &views, [TRUNK].into_iter().chain(RIGHT_LIMBS), &mut body);
    body.push_str("<path class=\"bone head\" d=\"");
    for view in &views {
        let [neck, head] = [Neck, Head].map(|segment| view[segment.index()]);
        let _ = write!(body, "M{:.0} {:.0}h0", 2.0 * head[0] - neck[0], 2.0 * head[1] - neck[1]);
    }
    body.push_str("\"/>");
    dots(position, &views, &mut body);
    Step { label, colour: LevelStyle::of(level).colour.clone(), fraction: bar_fraction(level), body }
}

/// Both views, relative to the middle of the ankles and the heading of the hips.
fn views(position: &BodyPosition, surface_z_m: f64) -> [View; 2] {
    let at_m = |segment: Segment| position.origin_m[segment.index()];
    let [left_m, right_m] = Side::BOTH.map(|side| at_m(side.foot()));
    let ankles_m = [0, 1].map(|axis| 0.5 * (left_m[axis] + right_m[axis]));
    let (left_m, right_m) = (at_m(LeftUpperLeg), at_m(RightUpperLeg));
    let (x_m, y_m) = (left_m[0] - right_m[0], left_m[1] - right_m[1]);
    let length_m = x_m.hypot(y_m);
    // Unit vector to the body's left.
    let [x, y] = if length_m > 0.0 { [x_m / length_m, y_m / length_m] } else { [0.0, 1.0] };
    let relative_m = position.origin_m.map(|point_m| {
        let [dx_m, dy_m] = [0, 1].map(|axis| point_m[axis] - ankles_m[axis]);
        [dx_m * y - dy_m * x, dx_m * x + dy_m * y, point_m[2] - surface_z_m]
    });
    let [from_right, from_behind] = MIDDLES;
    [
        relative_m.map(|[forward_m, _, up_m]| [from_right + METRE * forward_m, FLOOR - METRE * up_m]),
        relative_m.map(|[_, left_m, up_m]| [from_behind - METRE * left_m, FLOOR - METRE * up_m]),
    ]
}

/// Draws lines through the origins of chains of segments, in both views.
fn bones<'a>(
    class: &str,
    views: &[View; 2],
    chains: impl Iterator<Item = &'a [Segment]> + Clone,
    out: &mut String,
) {
    let _ = write!(out, "<path class=\"{class}\" d=\"");
    for view in views {
        for chain in chains.clone() {
            for (index, segment) in chain.iter().enumerate() {
                let [x, y] = view[segment.index()];
                let _ = write!(out, "{}{x:.0} {y:.0}", if index == 0 { "M" } else { " " });
            }
        }
    }
    out.push_str("\"/>");
}

/// The joints of the levels that have a dot.
fn dots(position: &BodyPosition, views: &[View; 2], out: &mut String) {
    for level in DOTS {
        let joints = || Joint::ALL.into_iter().filter(|joint| position.levels[joint.index()] == level);
        if joints().next().is_none() {
            continue;
        }
        let style = LevelStyle::of(level);
        let (colour, size) = (&style.colour, DOT * style.size);
        let _ = write!(out, "<path class=\"joint\" stroke=\"{colour}\" stroke-width=\"{size:.1}\" d=\"");
        for view in views {
            for joint in joints() {
                let [x, y] = view[joint.segment().index()];
                let _ = write!(out, "M{x:.0} {y:.0}h0");
            }
        }
        out.push_str("\"/>");
    }
}

/// Time, joint closest to its limit, and load; or the reason why they are withheld.
fn label(position: &BodyPosition) -> String {
    let mut text = format!("t = {:.1} s", position.time_s);
    match (position.worst, position.withheld) {
        (Some((joint, [limit_ratio, sigma])), _) => {
            let level = words::level(position.levels[joint.index()] as u32);
            let (name, percent) = (words::joint(joint), [limit_ratio, sigma].map(|ratio| 100.0 * ratio));
            let _ = write!(text, ": {name} {:.0} % ± {:.0} % of its limit ({level})", percent[0], percent[1]);
        }
        (None, Some(reason)) => {
            let _ = write!(text, ": torques withheld ({reason})");
        }
        (None, None) => {}
    }
    if let Some([mass_kg, sigma_kg]) = position.load_kg {
        let _ = write!(text, ", load {mass_kg:.1} ± {sigma_kg:.1} kg");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::body::Skeleton;
    use equipoise_core::message::State;

    #[test]
    fn the_figure_has_the_heading_of_the_body() {
        let shoulder = Joint::named("RightShoulder").unwrap();
        // A T-pose 3 m away on a floor at 0.1 m, as it is and turned left by a quarter.
        let t_pose_m = Skeleton::nominal(1.8).t_pose_m().map(|[x, y, z]| [x, y, z + 1.0]);
        let turned_m = t_pose_m.map(|[x, y, z]| [3.0 - y, x - 2.0, z]);
        let drawn = [t_pose_m, turned_m].map(|segment_origin_m| {
            let mut state = State { segment_origin_m, suit_sample_time_ns: 1, ..State::zeroed() };
            state.joint_level[shoulder.index()] = Level::Red as u32;
            let mut body = BodyPositions::default();
            body.ingest(&state, 7.0);
            scrubber(&body, 0.1).unwrap().steps.remove(0).body
        });
        assert_eq!(drawn[0], drawn[1]);
        let position = |at: [f64; 3]| {
            let mut state = State { suit_sample_time_ns: 1, ..State::zeroed() };
            state.segment_origin_m[LeftUpperLeg.index()] = [0.0, 0.1, 0.0];
            state.segment_origin_m[RightHand.index()] = at;
            let mut body = BodyPositions::default();
            body.ingest(&state, 0.0);
            views(&body.positions()[0], 0.0).map(|view| view[RightHand.index()])
        };
        // Forward is to the right in the view from the right; the body's left is on the left in the view from behind.
        assert_eq!(position([0.5, 0.25, 1.0]), [[200.0, 162.0], [375.0, 162.0]]);
    }
}
