//! The figure: bones, joints, support polygon.

use equipoise_core::body::{Joint, SEGMENTS, Segment, Side};
use equipoise_core::cycle::foot_outline::FootOutline;
use equipoise_core::frame::Pose as BodyPose;
use equipoise_core::frame::StationWorld;
use equipoise_core::message::{State, Validity};
use equipoise_core::overload::Level;
use nalgebra::{UnitQuaternion, Vector3 as Vector};

use super::primitives::{Color, Line, LineType, Pose, Sphere, Vector3};
use crate::levels::LevelStyle;

const BONE_M: f64 = 0.03;
const HEAD_M: f64 = 0.2;
/// Diameter of the sphere of the highest level.
const JOINT_M: f64 = 0.13;
const FLOOR_LINE_M: f64 = 0.008;

/// Colours of the present and the suggested pose (the paper's Fig. 5: blue and black).
pub(super) const BODY: Color = Color::new(0.16, 0.38, 0.78, 1.0);
pub(super) const ASKED: Color = Color::new(0.1, 0.1, 0.1, 0.5);
const SOLE: Color = Color::new(0.5, 0.5, 0.5, 0.9);

/// Every segment as a line from its parent's origin.
pub(super) fn bones(origin_m: &[[f64; 3]; SEGMENTS], color: Color) -> Line {
    let mut points: Vec<Vector3> = Vec::with_capacity(2 * SEGMENTS);
    for segment in Segment::ALL {
        if let Some(parent) = segment.parent() {
            points.extend([origin_m[parent.index()].into(), Vector3::from(origin_m[segment.index()])]);
        }
    }
    Line::new(LineType::List, BONE_M, points, color)
}

/// The head, half its diameter above its joint.
pub(super) fn head(origin_m: &[[f64; 3]; SEGMENTS], color: Color) -> Sphere {
    let [x, y, z] = origin_m[Segment::Head.index()];
    Sphere { pose: Pose::at([x, y, z + 0.5 * HEAD_M]), size: [HEAD_M; 3].into(), color }
}

/// A sphere for each joint, larger for a worse level, so that the level is visible without colour.
pub(super) fn joints(state: &State) -> Vec<Sphere> {
    let published = |number: u32| {
        let level = Level::from_number(number).unwrap_or(Level::None);
        state.unless(Validity::INVALIDATES_TORQUES, level).unwrap_or(Level::None)
    };
    let sphere = |joint: Joint| {
        let (diameter_m, color) = look(published(state.joint_level[joint.index()]));
        let at_m = state.segment_origin_m[joint.segment().index()];
        Sphere { pose: Pose::at(at_m), size: [diameter_m; 3].into(), color }
    };
    Joint::ALL.into_iter().map(sphere).collect()
}

/// Diameter, m, and colour of a level.
pub(super) fn look(level: Level) -> (f64, Color) {
    let style = LevelStyle::of(level);
    let [r, g, b] = style.rgb().map(|part| f64::from(part) / 255.0);
    (JOINT_M * style.size, Color::new(r, g, b, 1.0))
}

/// The support polygon on the floor: convex hull of both foot outlines, scaled by body height. `None` if the feet have
/// no heading.
pub(super) fn support(origin_m: &[[f64; 3]; SEGMENTS], height_m: f64) -> Option<Line> {
    let mut turns = [UnitQuaternion::identity(); SEGMENTS];
    for side in Side::BOTH {
        let [foot, toe] = [side.foot(), side.toe()].map(|segment| Vector::from(origin_m[segment.index()]));
        let ahead = toe - foot;
        if ahead.xy().norm() < 1e-3 {
            return None;
        }
        turns[side.foot().index()] =
            UnitQuaternion::from_axis_angle(&Vector::z_axis(), ahead.y.atan2(ahead.x));
    }
    let pose = BodyPose::<StationWorld>::new(origin_m.map(Vector::from), turns);
    let corners =
        Side::BOTH.map(|side| FootOutline::by_stature(&pose, side, height_m).corners_m(&pose, side)).concat();
    let points = hull(corners).into_iter().map(|[x, y]| Vector3::from([x, y, 0.002])).collect();
    Some(Line::new(LineType::Loop, FLOOR_LINE_M, points, SOLE))
}

/// The convex hull, counter-clockwise (Andrew's monotone chain).
pub(super) fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let turns_left = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| {
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0
    };
    let chain = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..]
                && !turns_left(a, b, point)
            {
                chain.pop();
            }
            chain.push(point);
        }
        // The last point is also the first of the other chain.
        chain.pop();
        chain
    };
    let mut lower = chain(&mut points.iter().copied());
    lower.extend(chain(&mut points.iter().rev().copied()));
    lower
}
