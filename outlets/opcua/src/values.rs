//! What the station knows, as the values of all nodes: a good one, or a bad status and none.

use std::time::{SystemTime, UNIX_EPOCH};

use equipoise_client::clock::now_ns;
use equipoise_client::{NoReading, Reading};
use equipoise_core::body::Joint;
use equipoise_core::message::Validity;
use equipoise_outlets::Seen;
use opcua::types::{DataValue, DateTime, StatusCode, Variant};

use crate::quality;
use crate::table::{About, JOINT, Row, STATION};

/// One instant by both clocks: the bus's, and the wall clock that OPC UA speaks of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Clocks {
    /// CLOCK_MONOTONIC, ns.
    pub monotonic_ns: u64,
    /// UTC since 1970, ns.
    pub utc_ns: u64,
}

/// Between the epochs of OPC UA (1601) and of Unix (1970), s.
const EPOCHS_APART_S: i64 = 11_644_473_600;
const NS_PER_TICK: u64 = 100;
const TICKS_PER_S: i64 = 10_000_000;

impl Clocks {
    /// Now. Taken anew for every beat, so that a wall clock that was set is followed.
    pub fn now() -> Clocks {
        let before_ns = now_ns();
        let utc = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        // What lies between the two readings is shared out evenly.
        let monotonic_ns = before_ns + now_ns().saturating_sub(before_ns) / 2;
        Clocks { monotonic_ns, utc_ns: utc.as_nanos() as u64 }
    }

    /// The wall clock's time of a stamp of the bus.
    pub fn utc(&self, stamp_ns: u64) -> DateTime {
        let utc_ns = if stamp_ns <= self.monotonic_ns {
            self.utc_ns.saturating_sub(self.monotonic_ns - stamp_ns)
        } else {
            self.utc_ns + (stamp_ns - self.monotonic_ns)
        };
        DateTime::from((utc_ns / NS_PER_TICK) as i64 + EPOCHS_APART_S * TICKS_PER_S)
    }
}

/// Every row in the order of the nodes, with the joint it is for.
pub fn rows() -> impl Iterator<Item = (&'static Row, Option<Joint>)> {
    let of_joints = Joint::ALL.into_iter().flat_map(|joint| JOINT.iter().map(move |row| (row, Some(joint))));
    STATION.iter().map(|row| (row, None)).chain(of_joints)
}

/// The values of all rows; `ever`: whether there was a state since the server began.
pub fn of_seen(seen: &Seen, ever: bool, clocks: Clocks) -> Vec<DataValue> {
    match seen {
        Ok(reading) => rows().map(|(row, joint)| of_row(row, joint, reading, clocks)).collect(),
        Err(reason) => of_no_reading(reason, ever, clocks),
    }
}

/// The values of all rows while there is no state.
pub fn of_no_reading(reason: &NoReading, ever: bool, clocks: Clocks) -> Vec<DataValue> {
    let code = quality::of_no_reading(reason, ever);
    let now = clocks.utc(clocks.monotonic_ns);
    rows().map(|_| nothing(code, now)).collect()
}

fn of_row(row: &Row, joint: Option<Joint>, reading: &Reading, clocks: Clocks) -> DataValue {
    let (state, server) = (&reading.state, clocks.utc(clocks.monotonic_ns));
    if state.unless(row.spoilers, ()).is_none() {
        return nothing(quality::of_withheld(Validity(state.valid & row.spoilers.0)), server);
    }
    let Some(value) = (row.value)(reading, joint.unwrap_or(Joint::ALL[0])) else {
        // Told, but there is nothing to say.
        return nothing(StatusCode::BadNoData, server);
    };
    let about_ns = match row.about {
        About::Moment if state.suit_sample_time_ns > 0 => state.suit_sample_time_ns,
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

/// No value, and so no time that it would be about: the library would take one that lies after the next value's for a
/// reason to hold that back.
fn nothing(code: StatusCode, server: DateTime) -> DataValue {
    DataValue {
        // `None` would lose the status on its way through the library: it is read back as good.
        value: Some(Variant::Empty),
        status: Some(code),
        source_timestamp: None,
        source_picoseconds: None,
        server_timestamp: Some(server),
        server_picoseconds: None,
    }
}
