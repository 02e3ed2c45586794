//! Layout of a datagram, declared once: the encoder, the table of docs/consumers/udp.md, the C header and the Python
//! module all derive from [`FIELDS`].
//!
//! Little-endian, each number aligned to its size, without padding. A change of layout or of meaning requires a new
//! [`VERSION`].

use equipoise_core::body::JOINTS;
use equipoise_core::message::Validity;
use equipoise_core::message::state::Unavailable;

use super::encode::Datagram;
use Kind::{Char, F32, U8, U16, U32, U64};
use Number::{Real, Whole};

/// The first four bytes.
pub const MAGIC: [u8; 4] = *b"EQPU";
/// Version of this layout.
pub const VERSION: u16 = 2;
/// Length of a datagram in bytes.
pub const LENGTH: usize = {
    let (mut at, mut bytes) = (0, 0);
    while at < FIELDS.len() {
        bytes += FIELDS[at].bytes();
        at += 1;
    }
    bytes
};
/// Length of a station's name in bytes.
const STATION_BYTES: usize = 32;

const _: () = assert!(LENGTH <= 1400, "a datagram must fit into one packet of every network");

/// Number type of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A byte of text; texts are padded with zeros.
    Char,
    /// Unsigned, 1 byte.
    U8,
    /// Unsigned, 2 bytes.
    U16,
    /// Unsigned, 4 bytes.
    U32,
    /// Unsigned, 8 bytes.
    U64,
    /// IEEE-754 binary32.
    F32,
}

impl Kind {
    /// Size of one number in bytes.
    pub const fn bytes(self) -> usize {
        match self {
            Char | U8 => 1,
            U16 => 2,
            U32 | F32 => 4,
            U64 => 8,
        }
    }

    /// Name of the type in the documentation.
    pub const fn name(self) -> &'static str {
        match self {
            Char => "char",
            U8 => "u8",
            U16 => "u16",
            U32 => "u32",
            U64 => "u64",
            F32 => "f32",
        }
    }
}

/// One number before encoding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Number {
    /// An integer, or a byte of text.
    Whole(u64),
    /// A real number.
    Real(f64),
}

/// One field of the datagram.
#[derive(Debug)]
pub struct Field {
    /// Name, ending in the unit.
    pub name: &'static str,
    /// Type of its numbers.
    pub kind: Kind,
    /// Shape: `[]` a scalar, `[n]` a vector, `[n, m]` a matrix in row-major order.
    pub shape: &'static [usize],
    /// Unit, for the documentation.
    pub unit: &'static str,
    /// The field is zero while one of these validity flags is raised: one of [`Validity::FLAG_SETS`]. `None`: never.
    pub needs: Option<Validity>,
    /// Description.
    pub meaning: &'static str,
    pub(super) value: fn(&Datagram<'_>, usize) -> Number,
}

impl Field {
    /// Number of elements.
    pub const fn count(&self) -> usize {
        let (mut at, mut count) = (0, 1);
        while at < self.shape.len() {
            count *= self.shape[at];
            at += 1;
        }
        count
    }

    /// Size in bytes.
    pub const fn bytes(&self) -> usize {
        self.count() * self.kind.bytes()
    }
}

type Value = fn(&Datagram<'_>, usize) -> Number;

/// A field that is valid regardless of `valid`.
const fn always(
    name: &'static str,
    kind: Kind,
    shape: &'static [usize],
    unit: &'static str,
    meaning: &'static str,
    value: Value,
) -> Field {
    Field { name, kind, shape, unit, needs: None, meaning, value }
}

/// Real numbers that are zero while a flag of `needs` is raised.
const fn unless(
    needs: Validity,
    name: &'static str,
    shape: &'static [usize],
    unit: &'static str,
    meaning: &'static str,
    value: Value,
) -> Field {
    Field { name, kind: F32, shape, unit, needs: Some(needs), meaning, value }
}

const TORQUES: Validity = Validity::INVALIDATES_TORQUES;
const BACK: Validity = Validity::INVALIDATES_LOW_BACK;
const PER_JOINT: &[usize] = &[JOINTS];

/// All fields in order.
#[rustfmt::skip]
pub const FIELDS: &[Field] = &[
    always("magic", Char, &[4], "", "`EQPU`", |_, at| Whole(u64::from(MAGIC[at]))),
    always("version", U16, &[], "", "number of this table: 2", |_, _| Whole(u64::from(VERSION))),
    always("length", U16, &[], "bytes", "of the whole datagram", |_, _| Whole(LENGTH as u64)),
    always("station", Char, &[STATION_BYTES], "", "name of the station, padded with zeros", |data, at| {
        Whole(u64::from(data.station.as_bytes().get(at).copied().unwrap_or(0)))
    }),
    always("session_ns", U64, &[], "ns", "start of the sender since 1970 (UTC): `sequence` restarts from 1 with a later one",
        |data, _| Whole(data.session_ns)),
    always("sequence", U64, &[], "", "number of the datagram in the session, from 1; the same for all receivers",
        |data, _| Whole(data.sequence)),
    always("status", U32, &[], "", "0: there is a current state. Otherwise the reason why there is none: 1 silent, 2 stale, 3 other_clock, \
        4 bus", |data, _| Whole(u64::from(data.status))),
    always("phase", U32, &[], "", "0 waiting, 1 identifying, 2 monitoring, 3 degraded",
        |data, _| Whole(u64::from(data.state().phase))),
    always("status_ns", U64, &[], "ns", "silent: duration; stale: age of the newest state; other_clock: lead of its \
        clock; otherwise 0", |data, _| Whole(data.status_ns)),
    always("cycle", U64, &[], "", "number of the cycle since the daemon's start, from 1",
        |data, _| Whole(data.state().cycle)),
    always("state_time_ns", U64, &[], "ns", "due time of the cycle, the station's CLOCK_MONOTONIC",
        |data, _| Whole(data.state().time_ns)),
    always("sample_time_ns", U64, &[], "ns", "sample time that torques, forces and centres refer to, same clock; 0 \
        before the first", |data, _| Whole(data.state().suit_sample_time_ns)),
    always("age_ns", U64, &[], "ns", "age of the state at sending; all ones without a state",
        |data, _| Whole(data.reading.age_ns)),
    always("sample_age_ns", U64, &[], "ns", "age of `sample_time_ns` at sending; all ones before the first",
        |data, _| Whole(data.reading.sample_age_ns.unwrap_or(u64::MAX))),
    always("suit_age_ns", U64, &[], "ns", "age of the newest suit sample at `state_time_ns`; all ones: no sample",
        |data, _| Whole(data.state().suit_age_ns)),
    always("ground_age_ns", U64, &[], "ns", "age of the newest ground sample at `state_time_ns`; all ones: no sample",
        |data, _| Whole(data.state().ground_age_ns)),
    always("valid", U64, &[], "bits", "invalid reasons (below); all ones without a state",
        |data, _| Whole(data.state().valid)),
    always("usable", U32, &[], "bits", "groups of valid values (below); 0 without a state",
        |data, _| Whole(u64::from(data.usable()))),
    always("unavailable", U32, &[], "bits", "quantities that the station's sensors do not provide: 1 suit_com, 2 shear",
        |data, _| Whole(u64::from(data.state().unavailable))),
    always("flags", U32, &[], "bits", "sum of: 1 new state; 4 static pose; 8 identified", |data, _| Whole(flags(data))),
    Field { name: "worst_joint", kind: U32, shape: &[], unit: "joint", needs: None,
        meaning: "joint closest to its limit; all ones while torques are invalid", value: |data, _| {
            let worst = data.reading.state.unless(TORQUES, data.state().worst_joint);
            Whole(u64::from(worst.unwrap_or(u32::MAX)))
        } },
    always("lifts", U32, &[], "", "number of lifts in the dose", |data, _| Whole(u64::from(data.state().lifts))),
    Field { name: "joint_level", kind: U8, shape: PER_JOINT, unit: "", needs: Some(TORQUES),
        meaning: "0 none, 1 green, 2 orange, 3 red, 4 above_max, 5 undecided: treat it as the highest",
        value: |data, at| Whole(u64::from(data.state().joint_level[at])) },
    always("daemon_life", U16, &[], "", "number of daemon starts that the sender has detected in this session; 0: none yet. \
        Another number or another session: the daemon was restarted", |data, _| Whole(data.daemon_life.into())),
    unless(TORQUES, "torque_magnitude_nm", PER_JOINT, "N m", "magnitude of the overload torque of each joint",
        |data, at| Real(length(data.state().torque_nm[at]))),
    unless(TORQUES, "torque_nm", &[JOINTS, 3], "N m", "overload torque of each joint, world axes",
        |data, at| Real(data.state().torque_nm[at / 3][at % 3])),
    unless(TORQUES, "torque_sigma_nm", PER_JOINT, "N m", "1-σ of `torque_magnitude_nm`",
        |data, at| Real(data.state().torque_sigma_nm[at])),
    unless(TORQUES, "torque_limit_nm", PER_JOINT, "N m", "τ_max of each joint for this worker",
        |data, at| Real(data.state().torque_limit_nm[at])),
    always("fatigue", F32, PER_JOINT, "0 to 1", "overloading fatigue of each joint",
        |data, at| Real(data.state().fatigue[at])),
    unless(Validity::INVALIDATES_LIFTED_MASS, "lifted_mass_kg", &[], "kg", "mass in the hands",
        |data, _| Real(data.state().lifted_mass_kg)),
    unless(Validity::INVALIDATES_LIFTED_MASS, "lifted_mass_sigma_kg", &[], "kg", "1-σ of the value above",
        |data, _| Real(data.state().lifted_mass_sigma_kg)),
    unless(TORQUES, "load_hand_distance_m", &[], "m", "horizontal distance of the load from the line between the hands",
        |data, _| Real(data.state().load_hand_distance_m)),
    unless(TORQUES, "reach_m", &[], "m", "horizontal distance of the load from the midpoint of the ankles",
        |data, _| Real(data.state().reach_m)),
    unless(TORQUES, "hand_load_fraction", &[2], "0 to 1", "η: fraction of the load in the left and the right hand",
        |data, at| Real(data.state().hand_load_fraction[at])),
    unless(TORQUES, "advice_direction", &[3], "1", "direction in which a motion of the load relieves the worst joint, unit vector, \
        world axes; zero if none does", |data, at| Real(data.state().advice_direction[at])),
    unless(TORQUES, "advice_gain_nm_per_cm", &[], "N m/cm", "reduction of its torque by a motion in that direction",
        |data, _| Real(data.state().advice_gain_nm_per_cm)),
    unless(Validity::INVALIDATES_DELTA_F, "delta_f_n", &[3], "N", "external force, world axes; x and y always 0, not published",
        |data, at| Real(data.state().delta_f_n[at])),
    unless(Validity::INVALIDATES_DELTA_F, "delta_f_sigma_n", &[], "N", "1-σ of its vertical component",
        |data, _| Real(data.state().delta_f_sigma_n)),
    unless(Validity::INVALIDATES_GROUND_FORCE, "ground_force_n", &[3], "N", "ground reaction on the person, world axes; x and \
        y are 0 where `unavailable` has shear", |data, at| Real(ground_force_n(data, at))),
    unless(Validity::INVALIDATES_COP_MEASURED, "cop_measured_m", &[2], "m", "measured centre of pressure, world x and y",
        |data, at| Real(data.state().cop_measured_m[at])),
    unless(Validity::INVALIDATES_COP_ESTIMATED, "cop_estimated_m", &[2], "m", "centre of pressure of the same motion without the load, world x and y",
        |data, at| Real(data.state().cop_estimated_m[at])),
    unless(Validity::INVALIDATES_COM, "com_m", &[3], "m", "estimated centre of mass of the unloaded body, world",
        |data, at| Real(data.state().com_m[at])),
    unless(BACK, "l5s1_moment_nm", &[], "N m", "net moment at L5/S1 about the horizontal axes", |data, _| Real(data.state().l5s1_moment_nm)),
    unless(BACK, "l5s1_moment_sigma_nm", &[], "N m", "1-σ of the value above", |data, _| Real(data.state().l5s1_moment_sigma_nm)),
    unless(BACK, "l5s1_compression_n", &[], "N", "estimated compression of the L5/S1 disc",
        |data, _| Real(data.state().l5s1_compression_n)),
    unless(BACK, "l5s1_compression_sigma_n", &[], "N", "1-σ of the value above",
        |data, _| Real(data.state().l5s1_compression_sigma_n)),
    always("dose_damage", F32, &[], "1", "cumulative damage of the low back, 1 at failure",
        |data, _| Real(data.state().dose_damage)),
    always("dose_probability", F32, &[], "0 to 1", "probability of a high-risk job at this dose",
        |data, _| Real(data.state().dose_probability)),
    always("crc32", U32, &[], "", "CRC-32 (ISO-HDLC: Ethernet's, zlib's) of all bytes before it", |_, _| Whole(0)),
];

fn flags(data: &Datagram<'_>) -> u64 {
    let (reading, state) = (&data.reading, data.state());
    // Bit 1 was a one-time restart flag, which was lost if its datagram was lost; `daemon_life` in each datagram
    // replaces it.
    let bits = [reading.is_new, false, state.static_pose != 0, state.converged != 0];
    bits.into_iter().enumerate().map(|(bit, is)| u64::from(is) << bit).sum()
}

fn length(vector: [f64; 3]) -> f64 {
    vector.iter().map(|value| value * value).sum::<f64>().sqrt()
}

fn ground_force_n(data: &Datagram<'_>, axis: usize) -> f64 {
    let given = axis == 2 || data.state().provides(Unavailable::Shear);
    if given { data.state().ground_force_n[axis] } else { 0.0 }
}
