//! JSON schema of a state, generated from one table of its keys; a test compares the table with the JSON.

use equipoise_core::body::Joint;
use equipoise_core::message::{GroundDevice, Validity, state::Unavailable};
use equipoise_core::overload::Level;
use serde_json::{Map, Value, json};

/// Type of a key's value.
#[derive(Debug, Clone, Copy)]
pub(super) enum Kind {
    Number,
    /// Array of this many numbers.
    Numbers(usize),
    Count,
    Boolean,
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
pub(super) enum Presence {
    Always,
    /// Absent if its value is invalid or unavailable.
    IfValid,
}

/// A key of a state.
pub(super) struct Key(pub(super) &'static str, pub(super) Kind, pub(super) Presence, pub(super) &'static str);

use Kind::{Boolean, Count, Joints, Name, Names, Number, Numbers, PerJoint};
use Presence::{Always, IfValid};

/// Every key in the order of the JSON, with its description.
#[rustfmt::skip]
pub(super) const KEYS: &[Key] = &[
    Key("t", Number, Always, "due time of the cycle, s of the recording machine's CLOCK_MONOTONIC"),
    Key("cycle", Count, Always, "number of the cycle since the daemon's start"),
    Key("phase", Name(&["waiting", "identifying", "monitoring", "degraded", "unknown"]), Always, "phase of the pipeline"),
    Key("valid", Names(reasons), Always, "invalid reasons; empty if all values are valid"),
    Key("unavailable", Names(unavailable), IfValid, "quantities that the station's sensors do not provide"),
    Key("static_pose", Boolean, Always, "whether the pose is static"),
    Key("converged", Boolean, Always, "whether the stop criterion of the identification is met"),
    Key("poses_used", Count, Always, "static poses that updated the filter"),
    Key("stance", Count, Always, "number of the stance: increments at every step of the feet"),
    Key("motion_samples_used", Count, Always, "motion samples that updated the filter"),
    Key("group_delay_ns", Count, Always, "delay of the results behind the newest suit sample, ns"),
    Key("suggested_pose", Count, IfValid, "index of the suggested pose"),
    Key("suit_age_ns", Count, IfValid, "age of the newest suit sample, ns"),
    Key("ground_age_ns", Count, IfValid, "age of the newest ground sample, ns"),
    Key("mass_kg", Number, IfValid, "body mass, kg"),
    Key("body_source", Name(&[]), IfValid, "source of the segment lengths"),
    Key("foot_outline_source", Name(&[]), Always, "source of the foot outlines"),
    Key("body_rejected", Name(&[]), IfValid, "reason why the suit's null pose is not used"),
    Key("cop_measured", Numbers(2), IfValid, "measured centre of pressure, world x and y, m"),
    Key("cop_measured_sigma", Numbers(2), IfValid, "its 1-sigma, m"),
    Key("cop_estimated", Numbers(2), IfValid, "centre of pressure of the same motion without the load, world x and y, m"),
    Key("cop_sigma", Numbers(2), IfValid, "its 1-sigma, m"),
    Key("com", Numbers(3), IfValid, "estimated centre of mass, world, m"),
    Key("suit_com", Numbers(3), IfValid, "centre of mass computed by the suit's software, world, m"),
    Key("acceleration_source", Name(&[]), IfValid, "source of the body's accelerations"),
    Key("ground_force_n", Numbers(3), IfValid, "ground reaction force on the person, world axes, N"),
    Key("vertical_force_n", Number, IfValid, "its vertical component, N"),
    Key("ground_devices", Names(ground_devices), IfValid, "devices in the ground sample"),
    Key("delta_f_n", Numbers(3), IfValid, "external force, world axes, N"),
    Key("delta_f_sigma_n", Number, IfValid, "1-sigma of its vertical component, N"),
    Key("lifted_mass_kg", Number, IfValid, "mass in the hands, kg"),
    Key("lifted_mass_sigma_kg", Number, IfValid, "its 1-sigma, kg"),
    Key("foot_load_fraction", Numbers(2), IfValid, "fraction of the ground reaction under the left and the right foot, 0 to 1"),
    Key("foot_load_fraction_sigma", Number, IfValid, "1-sigma of foot_load_fraction, equal for both feet"),
    Key("sharing_source", Name(&[]), IfValid, "source of foot_load_fraction"),
    Key("hand_load_fraction", Numbers(2), IfValid, "fraction of the load in the left and the right hand, 0 to 1"),
    Key("hand_load_fraction_sigma", Number, IfValid, "1-sigma of hand_load_fraction, equal for both hands"),
    Key("load_hand_distance_m", Number, IfValid, "horizontal distance of the load from the line between the hands, m"),
    Key("reach_m", Number, IfValid, "horizontal distance of the load from the midpoint of the ankles, m"),
    Key("reach_sigma_m", Number, IfValid, "its 1-sigma, m"),
    Key("variance_max_m2", Number, IfValid, "largest variance of an identified parameter (P_jj in the paper), m2"),
    Key("predicted_cop_sigma_m", Number, IfValid, "predicted 1-sigma of the centre of pressure over the pose library, m"),
    Key("nis", Number, IfValid, "normalised innovation squared of the last pose"),
    Key("prior_inflation", Number, IfValid, "factor on the prior's covariance after a conflict with the first poses"),
    Key("pose_mismatch_rad", Number, IfValid, "difference from the suggested pose, rad"),
    Key("suit_skew_s", Number, IfValid, "delay of the suit's sample times relative to the ground's, s"),
    Key("suit_skew_sigma_s", Number, IfValid, "its 1-sigma, s"),
    Key("l5s1_moment_nm", Number, IfValid, "net moment at L5/S1 about the horizontal axes, N m"),
    Key("l5s1_moment_sigma_nm", Number, IfValid, "its 1-sigma, N m"),
    Key("l5s1_compression_n", Number, IfValid, "estimated compression of the L5/S1 disc, N"),
    Key("l5s1_compression_sigma_n", Number, IfValid, "its 1-sigma, N"),
    Key("lifts", Count, Always, "lifts in the cumulative dose"),
    Key("dose_damage", Number, IfValid, "cumulative damage of the low back, 1 at failure"),
    Key("dose_probability", Number, IfValid, "probability of a high-risk job at this dose, 0 to 1"),
    Key("worst_joint", Name(&[]), IfValid, "joint closest to its limit"),
    Key("advice_direction", Numbers(3), IfValid, "direction in which a motion of the load relieves the worst joint, unit vector, world axes"),
    Key("advice_gain_nm_per_cm", Number, IfValid, "reduction of the worst joint's torque by a motion in that direction, N m per cm"),
    Key("fatigue", PerJoint, Always, "overloading fatigue of each joint, 0 to 1"),
    Key("joints", Joints, IfValid, "each joint: overload torque and its 1-sigma (N m), level, limit (N m), fatigue"),
];

fn reasons() -> Vec<&'static str> {
    Validity::NAMES.iter().map(|(_, name)| *name).collect()
}

fn unavailable() -> Vec<&'static str> {
    Unavailable::NAMES.iter().map(|(_, name)| *name).collect()
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
            Boolean => json!({"type": "boolean"}),
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
    let always = KEYS.iter().filter(|Key(_, _, presence, _)| *presence == Always);
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
