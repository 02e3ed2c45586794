//! JSON schema of a state, generated from one table of its keys; a test compares the table with the JSON.

use equipoise_core::body::Joint;
use equipoise_core::message::{GroundDevice, Validity, state::NotGiven};
use equipoise_core::overload::Level;
use serde_json::{Map, Value, json};

/// Type of a key's value.
#[derive(Debug, Clone, Copy)]
pub(super) enum Kind {
    Number,
    /// Array of this many numbers.
    Numbers(usize),
    Count,
    YesNo,
    /// One of these names; empty: any name.
    Name(&'static [&'static str]),
    /// An array of names from a table.
    Names(fn() -> Vec<&'static str>),
    /// A number for each joint.
    PerJoint,
    /// An object for each joint.
    Joints,
}

/// Whether a key is always present.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum There {
    Always,
    /// Absent if its value is invalid or unavailable.
    IfKnown,
}

/// A key of a state.
pub(super) struct Key(pub(super) &'static str, pub(super) Kind, pub(super) There, pub(super) &'static str);

use Kind::{Count, Joints, Name, Names, Number, Numbers, PerJoint, YesNo};
use There::{Always, IfKnown};

/// Every key in the order of the JSON, with its description.
#[rustfmt::skip]
pub(super) const KEYS: &[Key] = &[
    Key("t", Number, Always, "when the cycle was due, s of the recording machine's CLOCK_MONOTONIC"),
    Key("cycle", Count, Always, "the cycle's number in this daemon's life"),
    Key("phase", Name(&["waiting", "identifying", "monitoring", "degraded", "unknown"]), Always, "what the pipeline is doing"),
    Key("valid", Names(reasons), Always, "why values are withheld; empty when all may be used"),
    Key("not_given", Names(not_given), IfKnown, "what the station's sensors do not give"),
    Key("static_pose", YesNo, Always, "whether the worker holds still"),
    Key("converged", YesNo, Always, "whether the identification has met its stop rule"),
    Key("poses_used", Count, Always, "held poses that entered the filter"),
    Key("stance", Count, Always, "grows by one with every step of the feet"),
    Key("motion_samples_used", Count, Always, "moments in motion that entered the filter"),
    Key("group_delay_ns", Count, Always, "how far the values lie behind the newest suit sample, ns"),
    Key("suggested_pose", Count, IfKnown, "index of the pose that is asked for"),
    Key("suit_age_ns", Count, IfKnown, "age of the newest suit sample, ns"),
    Key("ground_age_ns", Count, IfKnown, "age of the newest ground sample, ns"),
    Key("mass_kg", Number, IfKnown, "body mass, kg"),
    Key("body_source", Name(&[]), IfKnown, "where the bones come from"),
    Key("sole_source", Name(&[]), Always, "where the soles' outline comes from"),
    Key("body_refused", Name(&[]), IfKnown, "why the suit's null pose is not used"),
    Key("cop_measured", Numbers(2), IfKnown, "measured centre of pressure, world x and y, m"),
    Key("cop_measured_sigma", Numbers(2), IfKnown, "its 1-sigma, m"),
    Key("cop_estimated", Numbers(2), IfKnown, "centre of pressure of the unloaded body in this motion, m"),
    Key("cop_sigma", Numbers(2), IfKnown, "its 1-sigma, m"),
    Key("com", Numbers(3), IfKnown, "estimated centre of mass, world, m"),
    Key("com_suit", Numbers(3), IfKnown, "the suit maker's own centre of mass, world, m"),
    Key("acceleration_source", Name(&[]), IfKnown, "where the body's accelerations come from"),
    Key("ground_force_n", Numbers(3), IfKnown, "ground reaction force on the person, world, N"),
    Key("vertical_force_n", Number, IfKnown, "its vertical part, N"),
    Key("ground_devices", Names(ground_devices), IfKnown, "what the ground's sample is made of"),
    Key("delta_f_n", Numbers(3), IfKnown, "external force carried, world, N"),
    Key("delta_f_sigma_n", Number, IfKnown, "1-sigma of its vertical part, N"),
    Key("lifted_mass_kg", Number, IfKnown, "mass in the hands, kg"),
    Key("lifted_mass_sigma_kg", Number, IfKnown, "its 1-sigma, kg"),
    Key("zeta", Numbers(2), IfKnown, "share of the ground reaction under the left and the right foot"),
    Key("zeta_sigma", Number, IfKnown, "1-sigma of zeta, of both feet alike"),
    Key("sharing_source", Name(&[]), IfKnown, "where zeta comes from"),
    Key("eta", Numbers(2), IfKnown, "share of the load in the left and the right hand"),
    Key("eta_sigma", Number, IfKnown, "1-sigma of eta, of both hands alike"),
    Key("load_distance_m", Number, IfKnown, "horizontal distance from the load to the line between the hands, m"),
    Key("reach_m", Number, IfKnown, "horizontal distance from the middle of the ankles to the load, m"),
    Key("reach_sigma_m", Number, IfKnown, "its 1-sigma, m"),
    Key("variance_max_m2", Number, IfKnown, "largest variance of an identified parameter (the paper's P_jj), m2"),
    Key("predicted_cop_sigma_m", Number, IfKnown, "predicted 1-sigma of the CoP over the poses of the library, m"),
    Key("nis", Number, IfKnown, "normalised innovation squared of the last pose"),
    Key("prior_inflation", Number, IfKnown, "how much the prior was widened because this worker did not fit it"),
    Key("pose_mismatch_rad", Number, IfKnown, "how far the worker is from the pose that is asked for, rad"),
    Key("suit_skew_s", Number, IfKnown, "how much later than the ground's the suit's times are, s"),
    Key("suit_skew_sigma_s", Number, IfKnown, "its 1-sigma, s"),
    Key("l5s1_moment_nm", Number, IfKnown, "net moment at L5/S1, N m"),
    Key("l5s1_moment_sigma_nm", Number, IfKnown, "its 1-sigma, N m"),
    Key("l5s1_compression_n", Number, IfKnown, "estimated compression of the L5/S1 disc, N"),
    Key("l5s1_compression_sigma_n", Number, IfKnown, "its 1-sigma, N"),
    Key("lifts", Count, Always, "lifts that entered the cumulative dose"),
    Key("dose_damage", Number, IfKnown, "cumulative damage of the low back, 1 being failure"),
    Key("dose_probability", Number, IfKnown, "probability of a high-risk job by that dose, 0 to 1"),
    Key("worst_joint", Name(&[]), IfKnown, "the joint closest to its limit"),
    Key("advice_direction", Numbers(3), IfKnown, "unit vector, world: where the load should move"),
    Key("advice_gain_nm_per_cm", Number, IfKnown, "by how much that relieves the worst joint, N m per cm"),
    Key("fatigue", PerJoint, Always, "overloading fatigue of each joint, 0 to 1"),
    Key("joints", Joints, IfKnown, "overload of each joint: torque and its 1-sigma (N m), level, limit (N m), fatigue"),
];

fn reasons() -> Vec<&'static str> {
    Validity::NAMES.iter().map(|(_, name)| *name).collect()
}

fn not_given() -> Vec<&'static str> {
    NotGiven::NAMES.iter().map(|(_, name)| *name).collect()
}

fn ground_devices() -> Vec<&'static str> {
    GroundDevice::NAMES.iter().map(|(_, name)| *name).collect()
}

fn levels() -> Vec<&'static str> {
    (0..).map_while(Level::from_number).map(Level::name).collect()
}

impl Kind {
    fn schema(self) -> Value {
        match self {
            Number => json!({"type": "number"}),
            Numbers(count) => {
                json!({"type": "array", "items": {"type": "number"}, "minItems": count, "maxItems": count})
            }
            Count => json!({"type": "integer", "minimum": 0}),
            YesNo => json!({"type": "boolean"}),
            Name([]) => json!({"type": "string"}),
            Name(names) => json!({"type": "string", "enum": names}),
            Names(names) => json!({"type": "array", "items": {"type": "string", "enum": names()}}),
            PerJoint => for_each_joint(&json!({"type": "number"})),
            Joints => for_each_joint(&one_joint()),
        }
    }
}

fn for_each_joint(what: &Value) -> Value {
    let properties: Map<String, Value> =
        Joint::ALL.iter().map(|joint| (joint.name().to_owned(), what.clone())).collect();
    json!({"type": "object", "properties": properties, "additionalProperties": false})
}

fn one_joint() -> Value {
    let number = Number.schema();
    json!({
        "type": "object",
        "properties": {
            "torque_nm": Numbers(3).schema(),
            "sigma_nm": number,
            "level": {"type": "string", "enum": levels()},
            "limit_nm": number,
            "fatigue": number,
        },
        "required": ["torque_nm", "level"],
        "additionalProperties": false,
    })
}

/// The schema of [`super::StateJson`].
pub fn state() -> Value {
    let mut properties = Map::new();
    for Key(name, kind, _, description) in KEYS {
        let mut schema = kind.schema();
        schema["description"] = (*description).into();
        properties.insert((*name).to_owned(), schema);
    }
    let always = KEYS.iter().filter(|Key(_, _, there, _)| *there == Always);
    let required: Vec<&str> = always.map(|Key(name, ..)| *name).collect();
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "equipoise.State",
        "description": "A state of an Equipoise station. A key whose value must not be used is absent.",
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": false,
    })
}
