//! The well-known messages of a scene, as far as they are used here; field names are theirs (docs.foxglove.dev, SceneUpdate).

use serde::{Serialize, Serializer};

use equipoise_core::time::NS_PER_S;

/// A length or a share, written to four decimals.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Short(pub(super) f64);

impl Serialize for Short {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        // + 0.0 converts negative zero to zero.
        serializer.serialize_f64((self.0 * 1e4).round() / 1e4 + 0.0)
    }
}

/// A time or a duration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Time {
    sec: u64,
    nsec: u64,
}

impl Time {
    pub(super) fn from_ns(ns: u64) -> Time {
        Time { sec: ns / NS_PER_S, nsec: ns % NS_PER_S }
    }
}

/// A point or a size, m.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Vector3 {
    x: Short,
    y: Short,
    z: Short,
}

impl From<[f64; 3]> for Vector3 {
    fn from([x, y, z]: [f64; 3]) -> Vector3 {
        Vector3 { x: Short(x), y: Short(y), z: Short(z) }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Quaternion {
    x: Short,
    y: Short,
    z: Short,
    w: Short,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Pose {
    pub(super) position: Vector3,
    orientation: Quaternion,
}

impl Pose {
    /// At a point, not turned.
    pub(super) fn at(point_m: [f64; 3]) -> Pose {
        Pose::turned(point_m, nalgebra::UnitQuaternion::identity())
    }

    /// At a point, turned.
    pub(super) fn turned(point_m: [f64; 3], turn: nalgebra::UnitQuaternion<f64>) -> Pose {
        let [x, y, z, w] = [turn.i, turn.j, turn.k, turn.w].map(Short);
        Pose { position: point_m.into(), orientation: Quaternion { x, y, z, w } }
    }
}

/// Red, green, blue, opacity; 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Color {
    r: Short,
    g: Short,
    b: Short,
    a: Short,
}

impl Color {
    pub(super) const fn new(r: f64, g: f64, b: f64, a: f64) -> Color {
        Color { r: Short(r), g: Short(g), b: Short(b), a: Short(a) }
    }
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Arrow {
    pub(super) pose: Pose,
    pub(super) shaft_length: Short,
    pub(super) shaft_diameter: Short,
    pub(super) head_length: Short,
    pub(super) head_diameter: Short,
    pub(super) color: Color,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Sphere {
    pub(super) pose: Pose,
    pub(super) size: Vector3,
    pub(super) color: Color,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Cylinder {
    pub(super) pose: Pose,
    pub(super) size: Vector3,
    pub(super) bottom_scale: Short,
    pub(super) top_scale: Short,
    pub(super) color: Color,
}

/// How the points of a line belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LineType {
    /// A closed line.
    Loop = 1,
    /// Pairs of points.
    List = 2,
}

impl Serialize for LineType {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u8(*self as u8)
    }
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Line {
    #[serde(rename = "type")]
    pub(super) kind: LineType,
    pub(super) pose: Pose,
    pub(super) thickness: Short,
    pub(super) scale_invariant: bool,
    pub(super) points: Vec<Vector3>,
    pub(super) color: Color,
    /// One colour for each point; none.
    colors: [Color; 0],
    /// Order of the points where it is not their own; none.
    indices: [u32; 0],
}

impl Line {
    pub(super) fn new(kind: LineType, thickness_m: f64, points: Vec<Vector3>, color: Color) -> Line {
        let (pose, thickness) = (Pose::at([0.0; 3]), Short(thickness_m));
        Line { kind, pose, thickness, scale_invariant: false, points, color, colors: [], indices: [] }
    }
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Text {
    pub(super) pose: Pose,
    pub(super) billboard: bool,
    pub(super) font_size: Short,
    pub(super) scale_invariant: bool,
    pub(super) color: Color,
    pub(super) text: String,
}

/// What is drawn and taken away together.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Entity {
    pub(super) timestamp: Time,
    pub(super) frame_id: &'static str,
    pub(super) id: &'static str,
    pub(super) lifetime: Time,
    pub(super) frame_locked: bool,
    pub(super) metadata: [(); 0],
    pub(super) arrows: Vec<Arrow>,
    pub(super) cubes: [(); 0],
    pub(super) spheres: Vec<Sphere>,
    pub(super) cylinders: Vec<Cylinder>,
    pub(super) lines: Vec<Line>,
    pub(super) triangles: [(); 0],
    pub(super) texts: Vec<Text>,
    pub(super) models: [(); 0],
}

impl Entity {
    /// Nothing yet, in a frame, from a time on and for a while, ns.
    pub(super) fn new(id: &'static str, frame_id: &'static str, time_ns: u64, lifetime_ns: u64) -> Entity {
        let (timestamp, lifetime) = (Time::from_ns(time_ns), Time::from_ns(lifetime_ns));
        let (arrows, spheres, cylinders, lines, texts) = Default::default();
        let (metadata, cubes, triangles, models) = ([], [], [], []);
        #[rustfmt::skip]
        let entity = Entity {
            timestamp, frame_id, id, lifetime, frame_locked: true, metadata, arrows, cubes, spheres, cylinders, lines,
            triangles, texts, models,
        };
        entity
    }
}

/// An entity that is there no more.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Deletion {
    timestamp: Time,
    /// 0: the one of this id.
    #[serde(rename = "type")]
    kind: u8,
    pub(super) id: &'static str,
}

/// One picture: what is there now, and what is there no more. Each is whole: a viewer that comes late, or jumps in a
/// recording, needs none before it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SceneUpdate {
    pub(super) deletions: Vec<Deletion>,
    pub(super) entities: Vec<Entity>,
}

impl SceneUpdate {
    /// Of all entities that there may be, those that are there.
    pub(super) fn of(all: &[&'static str], time_ns: u64, entities: Vec<Entity>) -> SceneUpdate {
        let is_there = |id: &str| entities.iter().any(|entity| entity.id == id);
        let gone = all.iter().filter(|id| !is_there(id));
        let deletion = |id: &&'static str| Deletion { timestamp: Time::from_ns(time_ns), kind: 0, id };
        SceneUpdate { deletions: gone.map(deletion).collect(), entities }
    }

    /// The message.
    ///
    /// # Errors
    /// None that can happen: serde's signature.
    pub fn to_text(&self) -> serde_json::Result<String> {
        serde_json::to_string(self)
    }
}
