//! What is said at every beat, with a state and without.

use equipoise_client::NoReading;
use equipoise_gateways::Latest;
use serde::Serialize;
use serde_json::{Value, json};

/// The topic.
pub const TOPIC: &str = "/equipoise/beat";
/// The name of its schema.
pub const SCHEMA_NAME: &str = "equipoise.Beat";

/// Whether there is a current state, and how old it is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Beat {
    /// The beat's number since the gateway's start, from 1: a gap is what the viewer did not take in time.
    pub beat: u64,
    /// Whether there is a current state. If not, scene and state of before are over.
    pub fresh: bool,
    /// The state's cycle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cycle: Option<u64>,
    /// Since the state's cycle was due, ns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub age_ns: Option<u64>,
    /// How old the moment is that forces and torques are about, ns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moment_age_ns: Option<u64>,
    /// Why there is no state: `silent`, `stale`, `other_clock`, `bus`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub missing: Option<&'static str>,
    /// The same for people.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
}

impl Beat {
    /// What is known at a beat.
    pub fn of(beat: u64, latest: &Latest) -> Beat {
        let reading = latest.as_ref().ok();
        let reason = latest.as_ref().err();
        Beat {
            beat,
            fresh: reading.is_some(),
            cycle: reading.map(|reading| reading.state.cycle),
            age_ns: reading.map(|reading| reading.age_ns),
            moment_age_ns: reading.and_then(|reading| reading.moment_age_ns),
            missing: reason.map(name),
            why: reason.map(ToString::to_string),
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

/// The JSON schema of a beat.
pub fn schema() -> Value {
    let count = |what: &str| json!({"type": "integer", "minimum": 0, "description": what});
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": SCHEMA_NAME,
        "description": "Whether there is a current state, and how old it is.",
        "type": "object",
        "properties": {
            "beat": count("number of the beat since the gateway's start; a gap is what was not taken in time"),
            "fresh": {"type": "boolean", "description": "whether there is a current state"},
            "cycle": count("the state's cycle"),
            "age_ns": count("since the state's cycle was due, ns"),
            "moment_age_ns": count("age of the moment that forces and torques are about, ns"),
            "missing": {"type": "string", "enum": ["silent", "stale", "other_clock", "bus"]},
            "why": {"type": "string", "description": "why there is no state, and what to do"},
        },
        "required": ["beat", "fresh"],
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
        let json = serde_json::to_value(Beat::of(3, &silent)).expect("a beat is JSON");
        assert_eq!(
            (&json["beat"], &json["fresh"], &json["missing"]),
            (&3.into(), &false.into(), &"silent".into())
        );
        assert!(json["why"].as_str().is_some_and(|why| why.contains("80 ms")), "{json}");
        assert!(json.get("age_ns").is_none() && json.get("cycle").is_none());
        let known = schema();
        for key in json.as_object().into_iter().flat_map(|object| object.keys()) {
            assert!(known["properties"].get(key).is_some(), "{key} is not in the schema");
        }
    }
}
