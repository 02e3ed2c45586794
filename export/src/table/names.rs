//! Names and units of columns, and the meanings of enumerated numbers.

use equipoise_core::body::{JOINTS, Joint, SEGMENTS, Segment};
use equipoise_core::cycle::{BodyRejection, BodySource};
use equipoise_core::message::layout::Field;
use equipoise_core::message::state::{
    AccelerationSource, FootOutlineSource, Phase, SharingSource, Unavailable,
};
use equipoise_core::message::{GroundDevice, Validity};
use equipoise_core::overload::Level;
use equipoise_core::pose_suggestion::library::LIBRARY;
use serde_json::{Map, Value, json};

const AXES: [&str; 3] = ["x", "y", "z"];
const QUATERNION: [&str; 4] = ["w", "x", "y", "z"];
/// Elements of the covariance of two horizontal components.
const COVARIANCE: [&str; 3] = ["xx", "xy", "yy"];
const SIDES: [&str; 2] = ["left", "right"];
/// Names of MVN's joint angles.
const ANGLES: [&str; 3] = ["abduction", "axial_rotation", "flexion"];

/// Suffixes of field names, longer ones first, and the units that they denote.
const UNITS: [(&str, &str); 18] = [
    ("_nm_per_cm", "N m/cm"),
    ("_m_per_s2", "m/s^2"),
    ("_m_per_s", "m/s"),
    ("_rad_per_s", "rad/s"),
    ("_nm2", "(N m)^2"),
    ("_m2", "m^2"),
    ("_ns", "ns"),
    ("_ms", "ms"),
    ("_kg", "kg"),
    ("_nm", "N m"),
    ("_rad", "rad"),
    ("_deg", "deg"),
    ("_hz", "Hz"),
    ("_m", "m"),
    ("_n", "N"),
    ("_s", "s"),
    ("_wxyz", "1"),
    ("_direction", "1"),
];

/// Unit of a field, from the suffix of its name.
pub(super) fn unit(field: &str) -> Option<&'static str> {
    UNITS.iter().find(|(end, _)| field.ends_with(end)).map(|(_, unit)| *unit)
}

/// Column name of one element of a field: joints, segments, sides and axes appear by name.
pub(super) fn column(field: &Field, index: usize) -> String {
    let name = field.name;
    let joint = |index: usize| Joint::ALL[index].name();
    let segment = |index: usize| Segment::ALL[index].name();
    match (name, field.count) {
        (_, 1) => name.to_owned(),
        ("foot_load_fraction" | "hand_load_fraction" | "foot_vertical_n", 2) => {
            format!("{name}_{}", SIDES[index])
        }
        ("foot_cop_m", 4) => format!("{name}_{}_{}", SIDES[index / 2], AXES[index % 2]),
        ("joint_angle_deg", _) => format!("{name}_{}_{}", joint(index / 3), ANGLES[index % 3]),
        ("orientation_wxyz", _) => format!("{name}_{}_{}", segment(index / 4), QUATERNION[index % 4]),
        ("torque_covariance_nm2", _) => format!("{name}_{}_{}", joint(index / 3), COVARIANCE[index % 3]),
        (_, 2 | 3) => format!("{name}_{}", AXES[index]),
        (_, JOINTS) => format!("{name}_{}", joint(index)),
        (_, count) if count == 3 * JOINTS => format!("{name}_{}_{}", joint(index / 3), AXES[index % 3]),
        (_, count) if count == 3 * SEGMENTS => format!("{name}_{}_{}", segment(index / 3), AXES[index % 3]),
        _ => format!("{name}_{index}"),
    }
}

/// Names of the numbers in states, by column: values, or bits where numbers are bit sets.
pub(super) fn numbers() -> Value {
    let list = |names: &mut dyn Iterator<Item = &'static str>| -> Value {
        names
            .enumerate()
            .map(|(number, name)| (number.to_string(), name.into()))
            .collect::<Map<_, _>>()
            .into()
    };
    let bits = |bits: &mut dyn Iterator<Item = (u64, &'static str)>| -> Value {
        bits.map(|(bit, name)| (bit.to_string(), name.into())).collect::<Map<_, _>>().into()
    };
    let known = 0..16_u32;
    json!({
        "valid": bits(&mut Validity::NAMES.iter().map(|(reason, name)| (reason.0, *name))),
        "unavailable": bits(&mut Unavailable::NAMES.iter().map(|(bit, name)| (*bit as u64, *name))),
        "ground_devices": bits(&mut GroundDevice::NAMES.iter().map(|(bit, name)| (*bit as u64, *name))),
        "phase": list(&mut known.clone().map_while(Phase::from_number).map(Phase::name)),
        "joint_level": list(&mut known.clone().map_while(Level::from_number).map(Level::name)),
        "sharing_source": list(&mut known.clone().map_while(SharingSource::from_number).map(SharingSource::name)),
        "foot_outline_source": list(&mut known.clone().map_while(FootOutlineSource::from_number).map(FootOutlineSource::name)),
        "acceleration_source":
            list(&mut known.clone().map_while(AccelerationSource::from_number).map(AccelerationSource::name)),
        "body_source": list(&mut known.clone().map_while(BodySource::from_number).map(BodySource::name)),
        "body_rejected": list(&mut known.map_while(BodyRejection::from_number).map(BodyRejection::name)),
        "worst_joint": list(&mut Joint::ALL.iter().map(|joint| joint.name())),
        "suggested_pose": list(&mut LIBRARY.iter().map(|posture| posture.name)),
    })
}
