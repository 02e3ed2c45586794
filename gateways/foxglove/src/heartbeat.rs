//! The heartbeat: published at every tick, with or without a state.

use equipoise_client::NoReading;
use equipoise_gateways::Latest;
use serde::Serialize;
use serde_json::{Value, json};

/// The topic.
pub const TOPIC: &str = "/equipoise/heartbeat";
/// The name of its schema.
pub const SCHEMA_NAME: &str = "equipoise.Heartbeat";

/// Whether there is a current state, and how old it is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Heartbeat {
    /// Number of the heartbeat since the gateway's start, from 1; a gap: messages that the viewer did not receive in
    /// time.
    pub sequence: u64,
    /// Whether there is a current state. If not, earlier scenes and states are outdated.
    pub fresh: bool,
    /// Cycle of the state.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cycle: Option<u64>,
    /// Age of the state since its cycle's due time, ns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub age_ns: Option<u64>,
    /// Age of the sample time that forces and torques refer to, ns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sample_age_ns: Option<u64>,
    /// Reason why there is no state: `silent`, `stale`, `other_clock`, `bus`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub no_state_reason: Option<&'static str>,
    /// The reason as a sentence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub message: Option<String>,
}

impl Heartbeat {
    /// The heartbeat of a tick.
    pub fn of(sequence: u64, latest: &Latest) -> Heartbeat {
        let reading = latest.as_ref().ok();
        let reason = latest.as_ref().err();
        Heartbeat {
            sequence,
            fresh: reading.is_some(),
            cycle: reading.map(|reading| reading.state.cycle),
            age_ns: reading.map(|reading| reading.age_ns),
            sample_age_ns: reading.and_then(|reading| reading.sample_age_ns),
            no_state_reason: reason.map(name),
            message: reason.map(ToString::to_string),
        }
    }
}

fn name(reason: &NoReading) -> &'static str {
    match reason {
        NoReading::Silent { .. } => "silent",
        NoReading::Stale { .. } => "stale",
        NoReading::OtherClock { .. } => "other_clock",
        NoReading::Bus(_) => "bus",
    }
}

/// JSON schema of a heartbeat.
pub fn schema() -> Value {
    let count = |what: &str| json!({"type": "integer", "minimum": 0, "description": what});
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": SCHEMA_NAME,
        "description": "Whether there is a current state, and how old it is.",
        "type": "object",
        "properties": {
            "sequence": count("number of the heartbeat since the gateway's start, from 1; a gap is loss"),
            "fresh": {"type": "boolean", "description": "whether there is a current state"},
            "cycle": count("the state's cycle"),
            "age_ns": count("age of the state since its cycle's due time, ns"),
            "sample_age_ns": count("age of the sample time that forces and torques refer to, ns"),
            "no_state_reason": {"type": "string", "enum": ["silent", "stale", "other_clock", "bus"]},
            "message": {"type": "string", "description": "reason why there is no state, and remedy"},
        },
        "required": ["sequence", "fresh"],
        "additionalProperties": false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn without_a_state_there_is_a_reason_and_no_age() {
        let silent = Err(NoReading::Silent { silent: Duration::from_millis(80) });
        let json = serde_json::to_value(Heartbeat::of(3, &silent)).expect("a heartbeat is JSON");
        assert_eq!(
            (&json["sequence"], &json["fresh"], &json["no_state_reason"]),
            (&3.into(), &false.into(), &"silent".into())
        );
        assert!(json["message"].as_str().is_some_and(|message| message.contains("80 ms")), "{json}");
        assert!(json.get("age_ns").is_none() && json.get("cycle").is_none());
        let known = schema();
        for key in json.as_object().into_iter().flat_map(|object| object.keys()) {
            assert!(known["properties"].get(key).is_some(), "{key} is not in the schema");
        }
    }
}
