//! HTTP requests to a LabAmp and their answers: JSON in both directions, every request a POST.

use serde_json::{Value, json};

/// The port of the device's web page and of its API.
pub const DEFAULT_PORT: u16 = 80;
/// The supported sampling rates, Hz.
pub const RATES_HZ: [u32; 17] = [
    10, 100, 1000, 2500, 6250, 10_000, 12_500, 25_000, 31_250, 50_000, 62_500, 78_125, 100_000, 125_000,
    156_250, 200_000, 208_333,
];
/// The only measurement of a LabAmp.
const MEASUREMENT: u16 = 1;
const CHANNELS_MAX: usize = 64;

/// Minimum count of scans in a frame at a sampling rate; a device refuses fewer.
pub fn least_scans_per_frame(rate_hz: u32) -> u32 {
    match rate_hz {
        0..=10 => 1,
        11..=100 => 10,
        101..=1000 => 100,
        1001..=2500 => 250,
        _ => 512,
    }
}

/// A request: path and body.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    /// Path relative to the device's address.
    pub path: &'static str,
    /// JSON.
    pub body: String,
}

fn request(path: &'static str, body: &Value) -> Request {
    Request { path, body: body.to_string() }
}

impl Request {
    /// Disables the measurement, so that it can be configured.
    pub fn disable() -> Request {
        request(
            "/api/daq/measurement/enabled/set",
            &json!({ "measurementId": MEASUREMENT, "enabled": false }),
        )
    }

    /// Sets the sampling rate.
    pub fn set_rate(rate_hz: u32) -> Request {
        let value = rate_hz.to_string();
        request("/api/param/set", &json!({ "params": [{ "name": "/daq/samplingRate", "value": value }] }))
    }

    /// Sets start and stop of the measurement to be upon request, and enables it.
    pub fn configure() -> Request {
        let body = json!({
            "measurementId": MEASUREMENT,
            "startTrigger": { "triggerUpon": "request" },
            "stopTrigger": { "triggerUpon": "request" },
            "signalProvider": "daq-provider",
            "enabled": true,
        });
        request("/api/daq/measurement/configuration/set", &body)
    }

    /// Requests the channels with their order, unit and rate.
    pub fn metadata() -> Request {
        request("/api/daq/measurement/metadata/get", &json!({ "measurementId": MEASUREMENT }))
    }

    /// Registers as a client.
    pub fn register() -> Request {
        request("/api/daq/stream/register", &json!({}))
    }

    /// Opens a stream with this many scans in a frame, or the device's default.
    pub fn open(client: &str, scans_per_frame: Option<u32>) -> Request {
        let mut measurement = json!({ "measurementId": MEASUREMENT });
        if let Some(scans) = scans_per_frame {
            measurement["scansPerFrame"] = json!(scans);
        }
        request("/api/daq/stream/open", &json!({ "measurements": [measurement], "clientId": client }))
    }

    /// Starts the measurement.
    pub fn start() -> Request {
        request("/api/daq/measurement/start", &json!({ "measurementId": MEASUREMENT }))
    }

    /// Closes a stream.
    pub fn close(client: &str, stream: u64) -> Request {
        request("/api/daq/stream/close", &json!({ "clientId": client, "streamId": stream }))
    }

    /// Unregisters the client.
    pub fn unregister(client: &str) -> Request {
        request("/api/daq/stream/unregister", &json!({ "clientId": client }))
    }
}

/// The status that every answer contains: success, or why not.
///
/// # Errors
/// The device's refusal, or an answer that is not a LabAmp's.
pub fn done(answer: &str) -> Result<Value, Refused> {
    let value: Value = serde_json::from_str(answer).map_err(|_| Refused::NotJson)?;
    match value.get("result").and_then(Value::as_i64) {
        Some(0) => Ok(value),
        Some(code) => {
            let why = value.get("error").map_or_else(|| format!("result {code}"), Value::to_string);
            Err(Refused::Device { why })
        }
        None => Err(Refused::Field { field: "result" }),
    }
}

/// The client's identifier in an answer to [`Request::register`].
///
/// # Errors
/// As [`done`].
pub fn client(answer: &str) -> Result<String, Refused> {
    let client = done(answer)?;
    let client =
        client.get("clientId").and_then(Value::as_str).ok_or(Refused::Field { field: "clientId" })?;
    Ok(client.to_owned())
}

/// Port and number of the stream in an answer to [`Request::open`].
///
/// # Errors
/// As [`done`].
pub fn stream(answer: &str) -> Result<(u16, u64), Refused> {
    let stream = done(answer)?;
    let number = |field| stream.get(field).and_then(Value::as_u64).ok_or(Refused::Field { field });
    let port = u16::try_from(number("port")?).map_err(|_| Refused::Field { field: "port" })?;
    Ok((port, number("streamId")?))
}

/// Contents of the stream.
#[derive(Debug, Clone, PartialEq)]
pub struct Metadata {
    /// Sampling rate of all channels, Hz.
    pub rate_hz: f64,
    /// The channels, in the order of transmission.
    pub signals: Vec<Signal>,
}

/// One channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Signal {
    /// The device's name of the channel, `Sensor-1`.
    pub source: String,
    /// The user's name of the channel.
    pub name: String,
    /// Its unit.
    pub unit: String,
}

impl Metadata {
    /// Parses the answer to [`Request::metadata`].
    ///
    /// # Errors
    /// As [`done`], and inconsistent values.
    pub fn parse(answer: &str) -> Result<Metadata, Refused> {
        let value = done(answer)?;
        let metadata = value.get("metadata").ok_or(Refused::Field { field: "metadata" })?;
        // The guide nests the field in `measurement`, the reference does not.
        let provider =
            metadata.pointer("/measurement/signalProvider").or_else(|| metadata.get("signalProvider"));
        let provider = provider.ok_or(Refused::Field { field: "signalProvider" })?;
        let rate_hz = provider.get("samplingRate").and_then(Value::as_f64).filter(|rate_hz| *rate_hz > 0.0);
        let signals =
            provider.get("signals").and_then(Value::as_array).ok_or(Refused::Field { field: "signals" })?;
        let mut placed = signals.iter().map(Signal::parse).collect::<Result<Vec<_>, _>>()?;
        placed.sort_by_key(|(offset, _)| *offset);
        let in_a_row = placed.iter().zip(0_u64..).all(|((offset, _), index)| *offset == 4 * index);
        if placed.is_empty() || placed.len() > CHANNELS_MAX || !in_a_row {
            return Err(Refused::Field { field: "offset" });
        }
        Ok(Metadata {
            rate_hz: rate_hz.ok_or(Refused::Field { field: "samplingRate" })?,
            signals: placed.into_iter().map(|(_, signal)| signal).collect(),
        })
    }
}

impl Signal {
    fn parse(value: &Value) -> Result<(u64, Signal), Refused> {
        let text = |field| value.get(field).and_then(Value::as_str).ok_or(Refused::Field { field });
        if text("dataType")? != "FLOAT32" {
            return Err(Refused::Field { field: "dataType" });
        }
        let offset = value.get("offset").and_then(Value::as_u64).ok_or(Refused::Field { field: "offset" })?;
        let signal = Signal {
            source: text("source")?.to_owned(),
            name: value.get("name").and_then(Value::as_str).unwrap_or_default().to_owned(),
            unit: text("unit")?.to_owned(),
        };
        Ok((offset, signal))
    }
}

/// Why an answer cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// The device refuses the request.
    #[error("it refuses: {why}")]
    Device {
        /// The device's message.
        why: String,
    },
    /// Not JSON.
    #[error("its answer is not one of a LabAmp; is it another device's web page?")]
    NotJson,
    /// A field of the answer is missing or malformed.
    #[error("its answer has no {field} of the form that is known")]
    Field {
        /// The field.
        field: &'static str,
    },
}
