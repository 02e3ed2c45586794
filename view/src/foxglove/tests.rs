//! Tests of what is drawn and what is not.

use bytemuck::Zeroable;
use equipoise_core::body::{Joint, Segment, Side, Skeleton};
use equipoise_core::message::{State, Validity};
use equipoise_core::overload::Level;
use serde_json::Value;

use super::figure::{hull, look};
use super::scene::{self, LIFETIME_NS};
use super::{Channel, SceneUpdate};
use crate::schema_check::misfits;
use crate::state_json::tests::monitoring;
use crate::suggested_pose::height_m as stature_m;

const TIME_NS: u64 = 12_000_000_034;

/// A person standing upright, with all values valid.
fn standing() -> State {
    let mut state = monitoring();
    state.segment_origin_m = Skeleton::nominal(1.77).t_pose_m().map(|[x, y, z]| [x, y, z + 0.95]);
    state.suggested_pose = 3;
    state.joint_level[state.worst_joint as usize] = Level::Red as u32;
    state
}

fn drawn(state: &State) -> SceneUpdate {
    scene::of(state, TIME_NS)
}

fn parsed(scene: &SceneUpdate) -> Value {
    serde_json::from_str(&scene.to_text().unwrap()).unwrap()
}

fn ids(scene: &Value, what: &str) -> Vec<String> {
    scene[what].as_array().unwrap().iter().map(|one| one["id"].as_str().unwrap().to_owned()).collect()
}

fn entity<'a>(scene: &'a Value, id: &str) -> &'a Value {
    scene["entities"].as_array().unwrap().iter().find(|one| one["id"] == id).unwrap_or(&Value::Null)
}

#[test]
fn every_scene_fits_its_schema_and_is_whole() {
    let schema: Value = serde_json::from_str(&Channel::SCENE.schema_text()).unwrap();
    let mut withheld = standing();
    withheld.valid = u64::MAX;
    for scene in [drawn(&standing()), drawn(&withheld), drawn(&State::zeroed()), scene::nothing("silent", 1)]
    {
        let json = parsed(&scene);
        assert_eq!(misfits(&schema, &json), [""; 0]);
        let mut all = [ids(&json, "entities"), ids(&json, "deletions")].concat();
        all.sort();
        all.dedup();
        assert_eq!(all.len(), 7, "each is drawn or taken away: {json}");
        for entity in json["entities"].as_array().unwrap() {
            assert_eq!(entity["lifetime"]["sec"], LIFETIME_NS / 1_000_000_000, "nothing stays for ever");
        }
    }
}

#[test]
fn a_whole_state_is_drawn_whole() {
    let json = parsed(&drawn(&standing()));
    assert_eq!(ids(&json, "deletions"), [""; 0]);
    let figure = entity(&json, "figure");
    assert_eq!(figure["timestamp"], serde_json::json!({"sec": 12, "nsec": 34}));
    assert_eq!(figure["spheres"].as_array().unwrap().len(), 23, "a head and 22 joints");
    assert_eq!(figure["lines"][0]["points"].as_array().unwrap().len(), 44);
    let cop = &entity(&json, "centre of pressure, measured")["cylinders"][0]["pose"]["position"];
    assert_eq!((&cop["x"], &cop["y"]), (&0.0625.into(), &(-0.01).into()));
    let sigma = &entity(&json, "centre of pressure, estimated")["cylinders"][0]["size"];
    assert_eq!((&sigma["x"], &sigma["y"]), (&0.025.into(), &0.025.into()), "never too small to be seen");
}

#[test]
fn joints_are_coloured_and_sized_by_their_level_and_grey_when_withheld() {
    let state = standing();
    let [none, red] = [Level::None, Level::Red].map(look);
    let diameter = |state: &State, joint: Joint| {
        let json = parsed(&drawn(state));
        entity(&json, "figure")["spheres"][1 + joint.index()]["size"]["x"].as_f64().unwrap()
    };
    // Lengths are rounded to 0.1 mm.
    let is = |drawn_m: f64, expected_m: f64| (drawn_m - expected_m).abs() < 1e-4;
    assert!(is(diameter(&state, Joint::ALL[0]), red.0));
    assert!(is(diameter(&state, Joint::ALL[1]), none.0));
    for (reason, name) in
        Validity::NAMES.iter().filter(|(reason, _)| !Validity::INVALIDATES_POSE.any_of(*reason))
    {
        let mut withheld = state;
        withheld.valid = reason.0;
        assert!(is(diameter(&withheld, Joint::ALL[0]), none.0), "{name}");
    }
}

#[test]
fn what_a_reason_spoils_is_taken_away_and_the_reason_is_written() {
    let mut state = standing();
    state.valid = Validity::SUIT_STALE.0;
    let json = parsed(&drawn(&state));
    for id in ["figure", "suggested pose", "support polygon", "centre of pressure, estimated", "advice"] {
        assert!(ids(&json, "deletions").contains(&id.to_owned()), "{id}");
    }
    let text = entity(&json, "words")["texts"][0]["text"].as_str().unwrap();
    assert!(text.contains("The suit is silent"), "{text}");

    state.valid = Validity::GROUND_STALE.0;
    let json = parsed(&drawn(&state));
    assert!(ids(&json, "deletions").contains(&"centre of pressure, measured".to_owned()));
    assert!(ids(&json, "entities").contains(&"figure".to_owned()));

    state.valid = Validity::POSITION_UNKNOWN.0;
    let json = parsed(&drawn(&state));
    assert!(ids(&json, "deletions").contains(&"support polygon".to_owned()));
    assert!(ids(&json, "entities").contains(&"figure".to_owned()));
}

#[test]
fn advice_is_drawn_only_at_orange_and_red() {
    for level in [Level::Green, Level::AboveMax, Level::Undecided] {
        let mut state = standing();
        state.joint_level[state.worst_joint as usize] = level as u32;
        assert!(ids(&parsed(&drawn(&state)), "deletions").contains(&"advice".to_owned()), "{level:?}");
    }
}

#[test]
fn without_a_state_only_the_reason_is_shown() {
    let json = parsed(&scene::nothing("silent: no state for 50 ms", TIME_NS));
    assert_eq!(ids(&json, "entities"), ["words"]);
    assert_eq!(entity(&json, "words")["texts"][0]["text"], "silent: no state for 50 ms");
}

#[test]
fn the_support_polygon_holds_both_ankles() {
    let state = standing();
    let json = parsed(&drawn(&state));
    let line = &entity(&json, "support polygon")["lines"][0];
    let points: Vec<[f64; 2]> = line["points"]
        .as_array()
        .unwrap()
        .iter()
        .map(|point| [point["x"].as_f64().unwrap(), point["y"].as_f64().unwrap()])
        .collect();
    for side in Side::BOTH {
        let [x, y, _] = state.segment_origin_m[side.foot().index()];
        // A point inside a convex, counter-clockwise polygon lies left of every edge.
        for (a, b) in points.iter().zip(points.iter().cycle().skip(1)) {
            assert!((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0.0, "{side:?}");
        }
    }
}

#[test]
fn stature_comes_from_the_bones_whatever_the_pose() {
    for height_m in [1.5, 1.77, 2.0] {
        let mut origin_m = Skeleton::nominal(height_m).t_pose_m();
        // A forearm with another direction.
        let [elbow, hand] = [Segment::LeftForearm, Segment::LeftHand].map(Segment::index);
        let length_m =
            (nalgebra::Vector3::from(origin_m[hand]) - nalgebra::Vector3::from(origin_m[elbow])).norm();
        origin_m[hand] = [origin_m[elbow][0] + length_m, origin_m[elbow][1], origin_m[elbow][2]];
        assert!((stature_m(&origin_m) - height_m).abs() < 1e-9, "{height_m}");
    }
}

#[test]
fn a_hull_leaves_out_what_lies_within() {
    let square = vec![[0.0, 0.0], [1.0, 1.0], [0.5, 0.5], [1.0, 0.0], [0.0, 1.0], [0.5, 0.0]];
    assert_eq!(hull(square), [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
}
