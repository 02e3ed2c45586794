//! Per-joint values of a state, as JSON objects with MVN's joint names in MVN's order.

use equipoise_core::body::{JOINTS, Joint};
use equipoise_core::message::State;
use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

use super::{all_finite, finite, level_name, positive};

/// The joints of a state: overload, limit, fatigue.
#[derive(Debug, Clone, Copy)]
pub(super) struct Joints<'a>(pub(super) &'a State);

#[derive(Serialize)]
struct JointJson {
    torque_nm: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    sigma_nm: Option<f64>,
    level: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    limit_nm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fatigue: Option<f64>,
}

impl Serialize for Joints<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for joint in Joint::ALL {
            let index = joint.index();
            if let Some(torque_nm) = all_finite(self.0.torque_nm[index]) {
                let value = JointJson {
                    torque_nm,
                    sigma_nm: finite(self.0.torque_sigma_nm[index]),
                    level: level_name(self.0.joint_level[index]),
                    limit_nm: positive(self.0.torque_limit_nm[index]),
                    fatigue: finite(self.0.fatigue[index]),
                };
                map.serialize_entry(joint.name(), &value)?;
            }
        }
        map.end()
    }
}

/// One number per joint.
#[derive(Debug, Clone, Copy)]
pub(super) struct PerJoint<'a>(pub(super) &'a [f64; JOINTS]);

impl Serialize for PerJoint<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for joint in Joint::ALL {
            if let Some(value) = finite(self.0[joint.index()]) {
                map.serialize_entry(joint.name(), &value)?;
            }
        }
        map.end()
    }
}
