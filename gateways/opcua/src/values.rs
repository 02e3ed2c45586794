//! Converts a state to the values of all nodes: each has a good status and a value, or a bad status and none.

use std::time::{SystemTime, UNIX_EPOCH};

use equipoise_client::clock::now_ns;
use equipoise_client::{NoReading, Reading};
use equipoise_core::body::Joint;
use equipoise_core::message::Validity;
use equipoise_gateways::Latest;
use opcua::types::{DataValue, DateTime, StatusCode, Variant};

use crate::quality;
use crate::table::{About, JOINT, Row, STATION};

/// One instant on both clocks: the bus's, and the UTC wall clock of OPC UA.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Clocks {
    /// CLOCK_MONOTONIC, ns.
    pub monotonic_ns: u64,
    /// UTC since 1970, ns.
    pub utc_ns: u64,
}

/// Offset between the epochs of OPC UA (1601) and of Unix (1970), s.
const EPOCHS_APART_S: i64 = 11_644_473_600;
const NS_PER_TICK: u64 = 100;
const TICKS_PER_S: i64 = 10_000_000;

impl Clocks {
    /// Reads both clocks. Called at every tick, so that conversions follow a wall clock that was set.
    pub fn now() -> Clocks {
        let before_ns = now_ns();
        let utc = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        // The wall clock is read between two readings of the monotonic clock; their midpoint is taken as the same
        // instant.
        let monotonic_ns = before_ns + now_ns().saturating_sub(before_ns) / 2;
        Clocks { monotonic_ns, utc_ns: utc.as_nanos() as u64 }
    }

    /// Converts a bus time stamp to UTC.
    pub fn utc(&self, stamp_ns: u64) -> DateTime {
        let utc_ns = if stamp_ns <= self.monotonic_ns {
            self.utc_ns.saturating_sub(self.monotonic_ns - stamp_ns)
        } else {
            self.utc_ns + (stamp_ns - self.monotonic_ns)
        };
        DateTime::from((utc_ns / NS_PER_TICK) as i64 + EPOCHS_APART_S * TICKS_PER_S)
    }
}

/// All rows in the order of the nodes, with the joint of each.
pub fn rows() -> impl Iterator<Item = (&'static Row, Option<Joint>)> {
    let of_joints = Joint::ALL.into_iter().flat_map(|joint| JOINT.iter().map(move |row| (row, Some(joint))));
    STATION.iter().map(|row| (row, None)).chain(of_joints)
}

/// Values of all rows; `ever`: whether there was a state since the server started.
pub fn of_latest(latest: &Latest, ever: bool, clocks: Clocks) -> Vec<DataValue> {
    match latest {
        Ok(reading) => rows().map(|(row, joint)| of_row(row, joint, reading, clocks)).collect(),
        Err(reason) => of_no_reading(reason, ever, clocks),
    }
}

/// Values of all rows while there is no state.
pub fn of_no_reading(reason: &NoReading, ever: bool, clocks: Clocks) -> Vec<DataValue> {
    let code = quality::of_no_reading(reason, ever);
    let now = clocks.utc(clocks.monotonic_ns);
    rows().map(|_| nothing(code, now)).collect()
}

fn of_row(row: &Row, joint: Option<Joint>, reading: &Reading, clocks: Clocks) -> DataValue {
    let (state, server) = (&reading.state, clocks.utc(clocks.monotonic_ns));
    if state.unless(row.invalidating, ()).is_none() {
        return nothing(quality::of_withheld(Validity(state.valid & row.invalidating.0)), server);
    }
    let Some(value) = (row.value)(reading, joint.unwrap_or(Joint::ALL[0])) else {
        // The flags allow a value, but none exists.
        return nothing(StatusCode::BadNoData, server);
    };
    let about_ns = match row.about {
        About::Sample if state.suit_sample_time_ns > 0 => state.suit_sample_time_ns,
        _ => state.time_ns,
    };
    DataValue {
        value: Some(value),
        status: Some(StatusCode::Good),
        source_timestamp: Some(clocks.utc(about_ns)),
        source_picoseconds: None,
        server_timestamp: Some(server),
        server_picoseconds: None,
    }
}

/// No value, and therefore no SourceTimestamp: a SourceTimestamp later than the next value's would make the library
/// delay that value.
fn nothing(code: StatusCode, server: DateTime) -> DataValue {
    DataValue {
        // With `None` the library loses the status and returns it as good.
        value: Some(Variant::Empty),
        status: Some(code),
        source_timestamp: None,
        source_picoseconds: None,
        server_timestamp: Some(server),
        server_picoseconds: None,
    }
}
