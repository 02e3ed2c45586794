//! The message for dashboards: one JSON object, either with a state or with the reason why there is none.

use equipoise_client::NoReading;
use equipoise_gateways::Latest;
use equipoise_view::state_json::StateJson;
use serde::Serialize;

/// The public names of the reasons why there is no state.
pub fn reason_name(reason: &NoReading) -> &'static str {
    match reason {
        NoReading::Silent { .. } => "silent",
        NoReading::Stale { .. } => "stale",
        NoReading::OtherClock { .. } => "other_clock",
        NoReading::Bus(_) => "bus",
    }
}

/// Contents of one tick's message, with its sequence number.
#[derive(Debug, Clone, Copy)]
pub struct JsonMessage<'a> {
    /// Name of the station.
    pub station: &'a str,
    /// Session of the gateway: another one counts from 1 again.
    pub session: &'a str,
    /// Number of the message on its key, from 1: a gap is loss.
    pub sequence: u64,
    /// The station's wall clock when it was sent, ns since 1970.
    pub sent_unix_ns: u64,
    /// A state or why there is none.
    pub latest: &'a Latest,
    /// With the worker's mass and centre of mass.
    pub with_body: bool,
}

#[derive(Serialize)]
struct Message<'a> {
    station: &'a str,
    session: &'a str,
    sequence: u64,
    sent_unix_ns: u64,
    current: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    no_state_reason: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    age_ns: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sample_age_ns: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    state: Option<StateJson<'a>>,
}

impl JsonMessage<'_> {
    /// The object as text.
    ///
    /// # Errors
    /// None that a state could cause.
    pub fn to_text(&self) -> serde_json::Result<String> {
        let reading = self.latest.as_ref().ok();
        serde_json::to_string(&Message {
            station: self.station,
            session: self.session,
            sequence: self.sequence,
            sent_unix_ns: self.sent_unix_ns,
            current: reading.is_some(),
            no_state_reason: self.latest.as_ref().err().map(reason_name),
            age_ns: reading.map(|reading| reading.age_ns),
            sample_age_ns: reading.and_then(|reading| reading.sample_age_ns),
            state: reading.map(|reading| {
                let state = StateJson::new(&reading.state, reading.state.time_ns as f64 * 1e-9);
                if self.with_body { state } else { state.without_body() }
            }),
        })
    }
}
