//! Encodes a reading, or the reason why there is none, as a datagram.

use crc::{CRC_32_ISO_HDLC, Crc};
use equipoise_client::{NoReading, Reading};
use equipoise_core::message::{State, Validity};

use super::layout::{FIELDS, Field, Kind, LENGTH, Number};
use crate::gateway::Latest;

/// CRC-32 of Ethernet and zlib.
pub const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Contents of a datagram.
#[derive(Debug)]
pub struct Datagram<'a> {
    /// Name of the station.
    pub station: &'a str,
    /// When the sender started, ns since 1970.
    pub session_ns: u64,
    /// Sequence number of the datagram in the session, from 1.
    pub sequence: u64,
    /// Number of the daemon's starts since the session started.
    pub daemon_life: u16,
    /// 0 with a state, otherwise why there is none: an index of [`STATUSES`].
    pub status: u32,
    /// Duration that the status refers to, ns.
    pub status_ns: u64,
    /// The state with its ages. Without a state all validity flags are set and all ages have the maximum value.
    pub reading: Reading,
}

/// Names of `status`, by number.
pub const STATUSES: [&str; 5] = ["current", "silent", "stale", "other_clock", "bus"];

impl<'a> Datagram<'a> {
    /// Contents of the datagram for `latest`.
    pub fn new(
        station: &'a str,
        session_ns: u64,
        sequence: u64,
        daemon_life: u16,
        latest: &Latest,
    ) -> Datagram<'a> {
        let (status, status_ns) = status(latest);
        let reading = latest.as_ref().map_or_else(|_| nothing(), Clone::clone);
        Datagram { station, session_ns, sequence, daemon_life, status, status_ns, reading }
    }

    /// The state.
    pub(super) fn state(&self) -> &State {
        &self.reading.state
    }

    /// Groups of usable values: bit n is the n-th of [`Validity::FLAG_SETS`].
    pub(super) fn usable(&self) -> u32 {
        let valid = self.reading.validity();
        let groups = Validity::FLAG_SETS.iter().enumerate();
        groups.filter(|(_, (invalidating, _))| !valid.any_of(*invalidating)).map(|(bit, _)| 1 << bit).sum()
    }
}

/// Number of the status, and the duration that it refers to.
fn status(latest: &Latest) -> (u32, u64) {
    let ns = |time: &std::time::Duration| u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
    match latest {
        Ok(_) => (0, 0),
        Err(NoReading::Silent { silent }) => (1, ns(silent)),
        Err(NoReading::Stale { age, .. }) => (2, ns(age)),
        Err(NoReading::OtherClock { ahead }) => (3, ns(ahead)),
        Err(NoReading::Bus(_)) => (4, 0),
    }
}

/// Placeholder without a state: all values are invalid, also for a receiver that ignores the status.
fn nothing() -> Reading {
    let state = State {
        valid: u64::MAX,
        suit_age_ns: u64::MAX,
        ground_age_ns: u64::MAX,
        worst_joint: u32::MAX,
        ..bytemuck::Zeroable::zeroed()
    };
    Reading {
        state,
        received_ns: 0,
        age_ns: u64::MAX,
        sample_age_ns: None,
        missed: 0,
        restarted: false,
        daemon_life: 0,
        is_new: false,
    }
}

/// Encodes the datagram.
pub fn encode(data: &Datagram<'_>) -> [u8; LENGTH] {
    let mut bytes = [0; LENGTH];
    let mut rest = &mut bytes[..];
    for field in FIELDS {
        let (place, after) = rest.split_at_mut(field.bytes());
        for (at, place) in place.chunks_exact_mut(field.kind.bytes()).enumerate() {
            write(place, field.kind, value(field, data, at));
        }
        rest = after;
    }
    let crc = CRC.checksum(&bytes[..LENGTH - 4]);
    bytes[LENGTH - 4..].copy_from_slice(&crc.to_le_bytes());
    bytes
}

/// An invalid value is encoded as zero.
fn value(field: &Field, data: &Datagram<'_>, at: usize) -> Number {
    let invalid = field.needs.is_some_and(|reasons| data.reading.validity().any_of(reasons));
    if invalid { Number::Whole(0) } else { (field.value)(data, at) }
}

fn write(place: &mut [u8], kind: Kind, number: Number) {
    let bytes = match (kind, number) {
        (Kind::F32, Number::Real(value)) => u64::from(real(value).to_bits()),
        (_, Number::Whole(value)) => value,
        (_, Number::Real(_)) => 0,
    };
    place.copy_from_slice(&bytes.to_le_bytes()[..place.len()]);
}

/// Never NaN or infinite: messages contain neither, and no value reaches the range of binary32.
fn real(value: f64) -> f32 {
    if value.is_finite() { value.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32 } else { 0.0 }
}
