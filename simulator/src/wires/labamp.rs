//! Kistler LabAmp 5165A: JSON over HTTP to set it up, frames over TCP; little-endian, as the makers' clients read it.
//!
//! After "API documentation 5165A", streaming and REST parts.

/// Version of the frames.
const VERSION: u16 = 1;
/// The only measurement of a 5165A.
pub const MEASUREMENT: u16 = 1;
/// A client's name, as the device makes them up.
pub const CLIENT: &str = "97b908e1-53ea-40df-a627-1d8a8a17ccb5";

/// What may happen to a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum Event {
    /// It was closed over the REST interface.
    Closed = 0,
    /// The client did not read fast enough.
    Overrun = 1,
    /// Times of the frames do not fit each other.
    TimeSkew = 2,
    /// Channels or rate were changed.
    Reconfigured = 3,
    /// The measurement was stopped.
    Stopped = 4,
}

fn frame(kind: u16, sequence: u32, sub_frame: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(16 + sub_frame.len());
    bytes.extend_from_slice(&VERSION.to_le_bytes());
    bytes.extend_from_slice(&kind.to_le_bytes());
    bytes.extend_from_slice(&(16 + sub_frame.len() as u32).to_le_bytes());
    bytes.extend_from_slice(&sequence.to_le_bytes());
    bytes.extend_from_slice(&MEASUREMENT.to_le_bytes());
    // An event is of subtype 0, data with a time of subtype 1: as their types.
    bytes.extend_from_slice(&kind.to_le_bytes());
    bytes.extend_from_slice(sub_frame);
    bytes
}

/// An event frame.
pub fn event(sequence: u32, level: u8, event: Event) -> Vec<u8> {
    let [low, high] = (event as u16).to_le_bytes();
    frame(0, sequence, &[level, 0, low, high])
}

/// A data frame: scans one after the other, each with all channels; `unix` is the first scan's time, s and ns.
pub fn data(sequence: u32, unix: (u64, u32), scans: &[Vec<f32>]) -> Vec<u8> {
    let mut sub_frame = Vec::new();
    sub_frame.extend_from_slice(&unix.0.to_le_bytes());
    sub_frame.extend_from_slice(&unix.1.to_le_bytes());
    for value in scans.iter().flatten() {
        sub_frame.extend_from_slice(&value.to_le_bytes());
    }
    frame(1, sequence, &sub_frame)
}

/// Fewest scans of a frame at a rate.
pub fn fewest_scans(rate_hz: f64) -> u32 {
    match rate_hz {
        rate if rate <= 10.0 => 1,
        rate if rate <= 100.0 => 10,
        rate if rate <= 1000.0 => 100,
        rate if rate <= 2500.0 => 250,
        _ => 512,
    }
}

/// A channel that is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Signal {
    /// Its name, as the user gave it.
    pub name: String,
    /// `N`, `Nm`, `V`, …
    pub unit: String,
}

/// What a request over HTTP asks of the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asked {
    /// Open a port for this many scans a frame (`None`: the default).
    Open(Option<u32>),
    /// Measure so often, Hz.
    Rate(u32),
    /// Begin to measure.
    Start,
    /// Stop measuring.
    Stop,
    /// Close the stream.
    Close,
    /// Answered, and nothing else to do.
    Nothing,
}

/// The answer to a request: body, and what is asked. An `Open` still needs its port: [`opened`]. `None`: no such service.
pub fn answer(path: &str, body: &str, signals: &[Signal], rate_hz: f64) -> Option<(String, Asked)> {
    let done = |asked| Some((r#"{"result": 0}"#.to_owned(), asked));
    match path {
        "/api/daq/stream/register" => {
            Some((format!(r#"{{"result": 0, "clientId": "{CLIENT}"}}"#), Asked::Nothing))
        }
        "/api/daq/stream/open" if body.contains(CLIENT) => {
            let scans = number_after(body, "\"scansPerFrame\"");
            if scans.is_some_and(|scans| scans < fewest_scans(rate_hz)) {
                return Some((r#"{"result": 1, "error": "scansPerFrame_too_low"}"#.into(), Asked::Nothing));
            }
            Some((String::new(), Asked::Open(scans)))
        }
        "/api/daq/stream/open" => {
            Some((r#"{"result": 1, "error": "unknown_client"}"#.into(), Asked::Nothing))
        }
        "/api/daq/stream/close" => done(Asked::Close),
        "/api/daq/measurement/start" => done(Asked::Start),
        "/api/daq/measurement/stop" => done(Asked::Stop),
        "/api/daq/stream/protocol-version" => Some((r#"{"version": 1, "result": 0}"#.into(), Asked::Nothing)),
        "/api/daq/measurement/metadata/get" => Some((metadata(signals, rate_hz), Asked::Nothing)),
        "/api/param/set" => done(
            body.split_once("/daq/samplingRate")
                .and_then(|(_, rest)| number_after(rest, "\"value\""))
                .map_or(Asked::Nothing, Asked::Rate),
        ),
        "/api/daq/stream/unregister"
        | "/api/daq/measurement/configuration/set"
        | "/api/daq/measurement/start-trigger/set"
        | "/api/daq/measurement/stop-trigger/set"
        | "/api/daq/measurement/signal-provider/set"
        | "/api/daq/measurement/enabled/set" => done(Asked::Nothing),
        "/api/daq/measurement/enabled/get" => {
            Some((r#"{"result": 0, "enabled": true}"#.into(), Asked::Nothing))
        }
        _ => None,
    }
}

/// The answer to `open`.
pub fn opened(port: u16, stream: u32) -> String {
    format!(r#"{{"result": 0, "port": {port}, "streamId": {stream}}}"#)
}

fn metadata(signals: &[Signal], rate_hz: f64) -> String {
    let listed: Vec<String> = signals
        .iter()
        .enumerate()
        .map(|(index, Signal { name, unit })| {
            format!(
                r#"{{"dataType": "FLOAT32", "source": "Sensor-{}", "name": "{name}", "unit": "{unit}", "offset": {}}}"#,
                index + 1,
                4 * index
            )
        })
        .collect();
    format!(
        r#"{{"result": 0, "metadata": {{"version": "1.0", "measurement": {{"measurementId": 1, "signalProvider": {{"name": "daq-provider", "samplingRate": {rate_hz:.1}, "signals": [{}]}}}}}}}}"#,
        listed.join(", ")
    )
}

/// The whole number behind a key in a JSON text.
fn number_after(text: &str, key: &str) -> Option<u32> {
    let behind = text.split_once(key)?.1.trim_start().strip_prefix(':')?.trim_start();
    // A number may stand in quotes.
    let behind = behind.trim_start_matches('"');
    behind[..behind.find(|c: char| !c.is_ascii_digit()).unwrap_or(behind.len())].parse().ok()
}

/// An eight-channel plate: sensors' distances from the middle along X and Y, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EightChannels {
    /// Along X and Y, m.
    pub half_m: [f64; 2],
}

impl EightChannels {
    /// The channels' names, in order.
    pub const NAMES: [&'static str; 8] = ["fx12", "fx34", "fy14", "fy23", "fz1", "fz2", "fz3", "fz4"];

    /// The eight forces (N) that make this wrench about the plate's origin, by the plate's formulae turned round. What
    /// the formulae leave open (a twist of the four vertical forces) is zero.
    pub fn forces_n(&self, force_n: [f64; 3], moment_nm: [f64; 3]) -> [f64; 8] {
        let ([a, b], [fx, fy, fz], [mx, my, mz]) = (self.half_m, force_n, moment_nm);
        let (quarter, about_x, about_y) = (fz / 4.0, mx / (4.0 * b), my / (4.0 * a));
        [
            fx / 2.0 - mz / (4.0 * b),
            fx / 2.0 + mz / (4.0 * b),
            fy / 2.0 + mz / (4.0 * a),
            fy / 2.0 - mz / (4.0 * a),
            quarter + about_x - about_y,
            quarter + about_x + about_y,
            quarter - about_x + about_y,
            quarter - about_x - about_y,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_forces_are_the_wrench() {
        let plate = EightChannels { half_m: [0.12, 0.2] };
        let [fx12, fx34, fy14, fy23, fz1, fz2, fz3, fz4] =
            plate.forces_n([10.0, -20.0, 700.0], [30.0, -40.0, 5.0]);
        let ([a, b], close) =
            (plate.half_m, |is: f64, meant: f64| assert!((is - meant).abs() < 1e-9, "{is}"));
        close(fx12 + fx34, 10.0);
        close(fy14 + fy23, -20.0);
        close(fz1 + fz2 + fz3 + fz4, 700.0);
        close(b * (fz1 + fz2 - fz3 - fz4), 30.0);
        close(a * (-fz1 + fz2 + fz3 - fz4), -40.0);
        close(b * (fx34 - fx12) + a * (fy14 - fy23), 5.0);
    }

    #[test]
    fn a_host_sets_it_up_in_json() {
        let signals = [Signal { name: "fz1".into(), unit: "N".into() }];
        let ask = |path: &str, body: &str| answer(path, body, &signals, 1000.0);
        let (registered, _) = ask("/api/daq/stream/register", "").unwrap();
        assert!(registered.contains(CLIENT));
        let open = |scans: &str| {
            let body = format!(
                r#"{{"measurements": [{{"measurementId": 1, "scansPerFrame": {scans}}}], "clientId": "{CLIENT}"}}"#
            );
            ask("/api/daq/stream/open", &body).unwrap()
        };
        assert_eq!(open("200").1, Asked::Open(Some(200)));
        let (refused, asked) = open("10");
        assert!(asked == Asked::Nothing && refused.contains("\"result\": 1"));
        assert_eq!(ask("/api/daq/measurement/start", r#"{"measurementId": 1}"#).unwrap().1, Asked::Start);
        let rate = r#"{"params": [{"name": "/daq/samplingRate", "value": "62500"}]}"#;
        assert_eq!(ask("/api/param/set", rate).unwrap().1, Asked::Rate(62_500));
        assert_eq!(ask("/api/nothing", ""), None);
        let (told, _) = ask("/api/daq/measurement/metadata/get", "{}").unwrap();
        let told: serde_json::Value = serde_json::from_str(&told).unwrap();
        let provider = &told["metadata"]["measurement"]["signalProvider"];
        assert_eq!(provider["samplingRate"], 1000.0);
        assert_eq!(provider["signals"][0]["unit"], "N");
    }
}
