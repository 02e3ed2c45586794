//! JSON schema of `foxglove.SceneUpdate`, with the fields of the well-known schema. `.ci/scene.py` parses scenes with
//! the messages that Foxglove itself publishes, which reject unknown fields.

use serde_json::{Value, json};

fn object(title: &str, properties: &[(&str, Value)]) -> Value {
    let required: Vec<&str> = properties.iter().map(|(name, _)| *name).collect();
    let properties: serde_json::Map<String, Value> =
        properties.iter().map(|(name, schema)| ((*name).to_owned(), schema.clone())).collect();
    json!({"title": title, "type": "object", "properties": properties, "required": required})
}

fn array(items: Value) -> Value {
    json!({"type": "array", "items": items})
}

fn numbers(title: &str, names: &[&str]) -> Value {
    let properties: Vec<(&str, Value)> = names.iter().map(|name| (*name, number())).collect();
    object(title, &properties)
}

fn number() -> Value {
    json!({"type": "number"})
}

fn text() -> Value {
    json!({"type": "string"})
}

fn yes_or_no() -> Value {
    json!({"type": "boolean"})
}

fn time(title: &str) -> Value {
    let nsec = json!({"type": "integer", "minimum": 0, "maximum": 999_999_999});
    object(title, &[("sec", json!({"type": "integer", "minimum": 0})), ("nsec", nsec)])
}

/// An enumeration.
fn choice(title: &str, names: &[&str]) -> Value {
    let one = |(number, name): (usize, &&str)| json!({"title": name, "const": number});
    let one_of: Vec<Value> = names.iter().enumerate().map(one).collect();
    json!({"title": title, "oneOf": one_of})
}

/// Kinds of primitives that are never used: their arrays are empty.
fn never(title: &str) -> Value {
    array(object(title, &[]))
}

pub(super) fn scene_update() -> Value {
    let deletion = object(
        "foxglove.SceneEntityDeletion",
        &[
            ("timestamp", time("time")),
            ("type", choice("foxglove.SceneEntityDeletionType", &["MATCHING_ID", "ALL"])),
            ("id", text()),
        ],
    );
    let (deletions, entities) = (array(deletion), array(entity()));
    object("foxglove.SceneUpdate", &[("deletions", deletions), ("entities", entities)])
}

fn vector() -> Value {
    numbers("foxglove.Vector3", &["x", "y", "z"])
}

fn pose() -> Value {
    let orientation = numbers("foxglove.Quaternion", &["x", "y", "z", "w"]);
    object("foxglove.Pose", &[("position", vector()), ("orientation", orientation)])
}

fn color() -> Value {
    numbers("foxglove.Color", &["r", "g", "b", "a"])
}

/// Primitives of one kind: its fields and those of all kinds.
fn primitive(name: &str, fields: &[(&str, Value)]) -> Value {
    let common = [("pose", pose()), ("color", color())];
    array(object(&format!("foxglove.{name}Primitive"), &[fields, &common].concat()))
}

fn entity() -> Value {
    let all_numbers = |names: &[&'static str]| names.iter().map(|name| (*name, number())).collect::<Vec<_>>();
    object(
        "foxglove.SceneEntity",
        &[
            ("timestamp", time("time")),
            ("frame_id", text()),
            ("id", text()),
            ("lifetime", time("duration")),
            ("frame_locked", yes_or_no()),
            ("metadata", array(object("foxglove.KeyValuePair", &[("key", text()), ("value", text())]))),
            (
                "arrows",
                primitive(
                    "Arrow",
                    &all_numbers(&["shaft_length", "shaft_diameter", "head_length", "head_diameter"]),
                ),
            ),
            ("cubes", never("foxglove.CubePrimitive")),
            ("spheres", primitive("Sphere", &[("size", vector())])),
            (
                "cylinders",
                primitive(
                    "Cylinder",
                    &[("size", vector()), ("bottom_scale", number()), ("top_scale", number())],
                ),
            ),
            (
                "lines",
                primitive(
                    "Line",
                    &[
                        ("type", choice("foxglove.LineType", &["LINE_STRIP", "LINE_LOOP", "LINE_LIST"])),
                        ("thickness", number()),
                        ("scale_invariant", yes_or_no()),
                        ("points", array(vector())),
                        ("colors", array(color())),
                        ("indices", array(json!({"type": "integer", "minimum": 0}))),
                    ],
                ),
            ),
            ("triangles", never("foxglove.TriangleListPrimitive")),
            (
                "texts",
                primitive(
                    "Text",
                    &[
                        ("billboard", yes_or_no()),
                        ("font_size", number()),
                        ("scale_invariant", yes_or_no()),
                        ("text", text()),
                    ],
                ),
            ),
            ("models", never("foxglove.ModelPrimitive")),
        ],
    )
}
