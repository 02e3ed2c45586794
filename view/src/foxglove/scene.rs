//! The scene of one state: pose, centres of pressure, suggested pose, advice.

use equipoise_core::body::{SEGMENTS, Side};
use equipoise_core::message::{State, Validity};
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_core::time::NS_PER_S;
use nalgebra::{UnitQuaternion, Vector3 as Vector};

use super::figure;
use super::primitives::{Arrow, Color, Cylinder, Entity, Pose, SceneUpdate, Short, Text};
use crate::suggested_pose::{SuggestedPose, height_m};
use crate::words;

/// The only coordinate frame: the station world, X forward, Y left, Z up.
pub const FRAME: &str = "station";
/// Lifetime of an entity that is not updated.
pub const LIFETIME_NS: u64 = NS_PER_S;

const FIGURE: &str = "figure";
const ASKED: &str = "suggested pose";
const SUPPORT: &str = "support polygon";
const MEASURED: &str = "centre of pressure, measured";
const ESTIMATED: &str = "centre of pressure, estimated";
const ADVICE: &str = "advice";
const WORDS: &str = "words";
/// All entity IDs.
const ALL: [&str; 7] = [FIGURE, ASKED, SUPPORT, MEASURED, ESTIMATED, ADVICE, WORDS];

const FORCE_M_PER_N: f64 = 1e-3;
const COP_M: f64 = 0.025;
const MEASURED_COLOR: Color = Color::new(0.75, 0.1, 0.55, 0.9);
const ESTIMATED_COLOR: Color = Color::new(0.0, 0.6, 0.65, 0.6);
const ADVICE_COLOR: Color = Color::new(0.1, 0.5, 0.2, 0.9);
const TEXT_COLOR: Color = Color::new(0.35, 0.35, 0.35, 1.0);

/// Scene of a state at `time_ns` of the viewer's clock. Values invalidated by `valid` are not drawn; the flags appear
/// as text.
pub fn of(state: &State, time_ns: u64) -> SceneUpdate {
    let entity = |id| Entity::new(id, FRAME, time_ns, LIFETIME_NS);
    let origin_m = segments(state);
    let mut entities = Vec::with_capacity(ALL.len());
    if let Some(origin_m) = origin_m {
        let height_m = height_m(origin_m);
        entities.push(Entity {
            lines: vec![figure::bones(origin_m, figure::BODY)],
            spheres: std::iter::once(figure::head(origin_m, figure::BODY))
                .chain(figure::joints(state))
                .collect(),
            ..entity(FIGURE)
        });
        if let Some(posture) = LIBRARY.get(state.suggested_pose as usize) {
            let asked = SuggestedPose::on_the_spot(posture, origin_m).segment_origin_m;
            entities.push(Entity {
                lines: vec![figure::bones(&asked, figure::ASKED)],
                spheres: vec![figure::head(&asked, figure::ASKED)],
                ..entity(ASKED)
            });
        }
        // The position of the feet on the floor is valid only if that of the centre of mass is.
        let placed_m = state.unless(Validity::INVALIDATES_COM, origin_m);
        let support = placed_m.and_then(|origin_m| figure::support(origin_m, height_m));
        entities.extend(support.map(|support| Entity { lines: vec![support], ..entity(SUPPORT) }));
        let advice = advice(state, origin_m);
        entities.extend(advice.map(|arrow| Entity { arrows: vec![arrow], ..entity(ADVICE) }));
    }
    if let Some(cop_m) = state.unless(Validity::INVALIDATES_COP_MEASURED, state.cop_measured_m) {
        let force = state.unless(Validity::INVALIDATES_GROUND_FORCE, state.ground_force_n[2]);
        entities.push(Entity {
            cylinders: vec![disc(cop_m, [COP_M; 2], MEASURED_COLOR)],
            arrows: force.filter(|force_n| *force_n > 0.0).map(|n| reaction(cop_m, n)).into_iter().collect(),
            ..entity(MEASURED)
        });
    }
    if let Some(cop_m) = state.unless(Validity::INVALIDATES_COP_ESTIMATED, state.cop_estimated_m) {
        // Two σ in each direction, and large enough to be visible.
        let size_m = state.cop_sigma_m.map(|sigma_m| (4.0 * sigma_m).max(COP_M));
        entities.push(Entity { cylinders: vec![disc(cop_m, size_m, ESTIMATED_COLOR)], ..entity(ESTIMATED) });
    }
    entities.push(Entity { texts: vec![text(caption(state))], ..entity(WORDS) });
    SceneUpdate::of(&ALL, time_ns, entities)
}

/// A scene with text only: why there is no state.
pub fn nothing(why: &str, time_ns: u64) -> SceneUpdate {
    let words =
        Entity { texts: vec![text(why.to_owned())], ..Entity::new(WORDS, FRAME, time_ns, LIFETIME_NS) };
    SceneUpdate::of(&ALL, time_ns, vec![words])
}

/// Segment origins; `None` while the pose is invalid.
fn segments(state: &State) -> Option<&[[f64; 3]; SEGMENTS]> {
    state.segment_origin_m().filter(|origin_m| origin_m.iter().flatten().all(|value| value.is_finite()))
}

/// A flat disc on the floor.
fn disc([x, y]: [f64; 2], [width_x_m, width_y_m]: [f64; 2], color: Color) -> Cylinder {
    let (pose, size) = (Pose::at([x, y, 0.004]), [width_x_m, width_y_m, 0.004].into());
    Cylinder { pose, size, bottom_scale: Short(1.0), top_scale: Short(1.0), color }
}

/// An arrow from a point in a direction, which must not be zero.
fn arrow(from_m: [f64; 3], direction: [f64; 3], length_m: f64, color: Color) -> Arrow {
    // An arrow points along X; for the opposite direction the shortest rotation is not unique.
    let turn = UnitQuaternion::rotation_between(&Vector::x(), &Vector::from(direction))
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector::z_axis(), std::f64::consts::PI));
    let head_m = 0.05_f64.min(0.5 * length_m);
    Arrow {
        pose: Pose::turned(from_m, turn),
        shaft_length: Short(length_m - head_m),
        shaft_diameter: Short(0.015),
        head_length: Short(head_m),
        head_diameter: Short(0.035),
        color,
    }
}

/// The vertical ground reaction, 1 m per 1000 N.
fn reaction([x, y]: [f64; 2], force_n: f64) -> Arrow {
    arrow([x, y, 0.0], [0.0, 0.0, 1.0], force_n * FORCE_M_PER_N, MEASURED_COLOR)
}

/// Direction in which to move the load, from the midpoint between the hands; `None` if the page displays no advice.
fn advice(state: &State, origin_m: &[[f64; 3]; SEGMENTS]) -> Option<Arrow> {
    words::advice_name(state)?;
    let hands = Side::BOTH.map(|side| Vector::from(origin_m[side.hand().index()]));
    let from_m = (0.5 * (hands[0] + hands[1])).into();
    Some(arrow(from_m, state.advice_direction, 0.25, ADVICE_COLOR))
}

/// The phase, and a line for each validity flag.
fn caption(state: &State) -> String {
    let mut lines = vec![words::phase(state).to_owned()];
    // Only the part before the colon, which names the condition; the remedy follows it.
    let what = |text: &'static str| text.split(':').next().unwrap_or(text).to_owned();
    lines.extend(words::reasons(state).into_iter().map(|reason| what(reason.text)));
    lines.join("\n")
}

fn text(text: String) -> Text {
    let (pose, font_size) = (Pose::at([0.0, 0.0, 2.2]), Short(0.08));
    Text { pose, billboard: true, font_size, scale_invariant: false, color: TEXT_COLOR, text }
}
