//! What is published, as JSON. The page for who reads it is docs/consumers/mqtt.md.

use std::time::{SystemTime, UNIX_EPOCH};

use equipoise_client::NoReading;
use equipoise_core::body::Joint;
use equipoise_core::message::state::Phase;
use equipoise_core::message::{State, Validity};
use equipoise_core::overload::Level;
use equipoise_core::time::seconds;
use equipoise_gateways::Latest;
use equipoise_view::state_json::StateJson;
use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

/// Grows when a key changes its meaning or goes; a new key does not change it.
pub const VERSION: u32 = 1;

/// One message of `equipoise/STATION/summary`. An invalid value is `null`; `withheld` lists the invalid reasons.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary<'a> {
    v: u32,
    station: &'a str,
    /// When it was made, s since 1970 UTC.
    t: f64,
    /// The cycle's number since the daemon's start.
    sequence: Option<u64>,
    phase: Option<&'static str>,
    /// Reasons why something is `null`; empty if nothing is.
    withheld: Vec<&'static str>,
    /// Joints by level.
    counts: Option<Counts>,
    worst_joint: Option<&'static str>,
    levels: Option<Levels>,
    /// Lifts that entered the dose.
    lifts: Option<u32>,
}

/// How many joints have each level.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    green: u32,
    orange: u32,
    red: u32,
    above_max: u32,
    undecided: u32,
}

/// The level of every joint, by MVN's name; `null` for one that has none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Levels([Option<Level>; Joint::ALL.len()]);

impl Serialize for Levels {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (joint, level) in Joint::ALL.iter().zip(self.0) {
            map.serialize_entry(joint.name(), &level.map(Level::name))?;
        }
        map.end()
    }
}

impl Levels {
    fn of(state: &State) -> Option<Levels> {
        let numbers = state.unless(Validity::INVALIDATES_TORQUES, state.joint_level)?;
        Some(Levels(numbers.map(|number| Level::from_number(number).filter(|level| *level != Level::None))))
    }

    fn counts(&self) -> Counts {
        let mut counts = Counts::default();
        for level in self.0.into_iter().flatten() {
            match level {
                Level::None => {}
                Level::Green => counts.green += 1,
                Level::Orange => counts.orange += 1,
                Level::Red => counts.red += 1,
                Level::AboveMax => counts.above_max += 1,
                Level::Undecided => counts.undecided += 1,
            }
        }
        counts
    }
}

impl<'a> Summary<'a> {
    /// What is known at `utc_s`, seconds since 1970.
    pub fn new(station: &'a str, latest: &Latest, utc_s: f64) -> Summary<'a> {
        match latest {
            Ok(reading) => Summary::of_state(station, &reading.state, utc_s),
            Err(reason) => Summary {
                v: VERSION,
                station,
                t: utc_s,
                sequence: None,
                phase: None,
                withheld: vec![name_of(reason)],
                counts: None,
                worst_joint: None,
                levels: None,
                lifts: None,
            },
        }
    }

    fn of_state(station: &'a str, state: &State, utc_s: f64) -> Summary<'a> {
        let levels = Levels::of(state);
        let worst = state.unless(Validity::INVALIDATES_TORQUES, state.worst_joint);
        Summary {
            v: VERSION,
            station,
            t: utc_s,
            sequence: Some(state.cycle),
            phase: Phase::from_number(state.phase).map(Phase::name),
            withheld: state.validity().names().collect(),
            counts: levels.as_ref().map(Levels::counts),
            worst_joint: worst.and_then(|index| Joint::ALL.get(index as usize)).map(|joint| joint.name()),
            levels,
            lifts: Some(state.lifts),
        }
    }

    /// As JSON.
    pub fn to_bytes(&self) -> Vec<u8> {
        // Cannot fail: the document has only strings, numbers and nulls.
        serde_json::to_vec(self).unwrap_or_default()
    }
}

/// One message of `equipoise/STATION/state`: the state as in `equipoise status --json`, and its creation time.
#[derive(Serialize)]
struct WholeState<'a> {
    /// s since 1970 UTC.
    sent_unix_s: f64,
    #[serde(flatten)]
    state: StateJson<'a>,
}

/// The whole state, with positions and torques, if there is one.
pub fn state(latest: &Latest, utc_s: f64) -> Option<Vec<u8>> {
    let reading = latest.as_ref().ok()?;
    let state = StateJson::new(&reading.state, seconds(reading.state.time_ns));
    serde_json::to_vec(&WholeState { sent_unix_s: utc_s, state }).ok()
}

/// Now, s since 1970 UTC, to the millisecond.
pub fn now_utc_s() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    since.as_millis() as f64 / 1000.0
}

/// The name of a reason why there is no state at all.
fn name_of(reason: &NoReading) -> &'static str {
    match reason {
        NoReading::Silent { .. } => "daemon_silent",
        NoReading::Stale { .. } => "state_stale",
        NoReading::OtherClock { .. } => "other_clock",
        NoReading::Bus(_) => "bus_unreadable",
    }
}
