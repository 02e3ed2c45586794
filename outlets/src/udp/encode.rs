//! A reading, or the reason why there is none, as a datagram.

use crc::{CRC_32_ISO_HDLC, Crc};
use equipoise_client::{NoReading, Reading};
use equipoise_core::message::{State, Validity};

use super::layout::{FIELDS, Field, Kind, LENGTH, Number};
use crate::outlet::Seen;

/// The CRC-32 of Ethernet and of zlib.
pub const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Everything that a datagram is made of.
#[derive(Debug)]
pub struct Told<'a> {
    /// Name of the station.
    pub station: &'a str,
    /// When the sender started, ns since 1970.
    pub session_ns: u64,
    /// Number of the datagram in the session, from 1.
    pub sequence: u64,
    /// How many daemons were heard in the session.
    pub daemon_life: u16,
    /// 0 with a state, else why there is none: an index of [`STATUSES`].
    pub status: u32,
    /// What the status is about, ns.
    pub status_ns: u64,
    /// The state, and what is known of it. Without one every reason is raised, and ages are as large as can be.
    pub reading: Reading,
}

/// Names of `status`, by number.
pub const STATUSES: [&str; 5] = ["current", "silent", "stale", "other_clock", "bus"];

impl<'a> Told<'a> {
    /// What is told of `seen`.
    pub fn new(station: &'a str, session_ns: u64, sequence: u64, daemon_life: u16, seen: &Seen) -> Told<'a> {
        let (status, status_ns) = status(seen);
        let reading = seen.as_ref().map_or_else(|_| nothing(), Clone::clone);
        Told { station, session_ns, sequence, daemon_life, status, status_ns, reading }
    }

    /// The state.
    pub(super) fn state(&self) -> &State {
        &self.reading.state
    }

    /// Groups of values that may be used: bit n is the n-th of [`Validity::SPOILERS`].
    pub(super) fn usable(&self) -> u32 {
        let valid = self.reading.validity();
        let groups = Validity::SPOILERS.iter().enumerate();
        groups.filter(|(_, (spoilers, _))| !valid.any_of(*spoilers)).map(|(bit, _)| 1 << bit).sum()
    }
}

/// Number of the status, and the time it is about.
fn status(seen: &Seen) -> (u32, u64) {
    let ns = |time: &std::time::Duration| u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
    match seen {
        Ok(_) => (0, 0),
        Err(NoReading::Silent { silent }) => (1, ns(silent)),
        Err(NoReading::Stale { age, .. }) => (2, ns(age)),
        Err(NoReading::OtherClock { ahead }) => (3, ns(ahead)),
        Err(NoReading::Bus(_)) => (4, 0),
    }
}

/// In the place of a reading: who forgets to look at the status finds no value that may be used.
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
        picked_up_ns: 0,
        age_ns: u64::MAX,
        moment_age_ns: None,
        missed: 0,
        restarted: false,
        daemon_life: 0,
        is_new: false,
    }
}

/// The datagram.
pub fn encode(told: &Told<'_>) -> [u8; LENGTH] {
    let mut bytes = [0; LENGTH];
    let mut rest = &mut bytes[..];
    for field in FIELDS {
        let (place, after) = rest.split_at_mut(field.bytes());
        for (at, place) in place.chunks_exact_mut(field.kind.bytes()).enumerate() {
            write(place, field.kind, value(field, told, at));
        }
        rest = after;
    }
    let crc = CRC.checksum(&bytes[..LENGTH - 4]);
    bytes[LENGTH - 4..].copy_from_slice(&crc.to_le_bytes());
    bytes
}

/// A spoilt value is zero.
fn value(field: &Field, told: &Told<'_>, at: usize) -> Number {
    let spoilt = field.needs.is_some_and(|spoilers| told.reading.validity().any_of(spoilers));
    if spoilt { Number::Whole(0) } else { (field.value)(told, at) }
}

fn write(place: &mut [u8], kind: Kind, number: Number) {
    let bytes = match (kind, number) {
        (Kind::F32, Number::Real(value)) => u64::from(real(value).to_bits()),
        (_, Number::Whole(value)) => value,
        (_, Number::Real(_)) => 0,
    };
    place.copy_from_slice(&bytes.to_le_bytes()[..place.len()]);
}

/// Never NaN, never infinite: a message holds neither, and no value of it is as large as a binary32 may be.
fn real(value: f64) -> f32 {
    if value.is_finite() { value.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32 } else { 0.0 }
}
