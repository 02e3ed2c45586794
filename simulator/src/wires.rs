//! Encoders of other makers' sensor protocols, written from their manuals and never from this project's parsers.
//!
//! One file per device, pure functions from numbers to bytes (and from a host's requests to their content). No
//! dependency on a person, a socket or a clock.

pub mod amti;
pub mod ati_rdt;
pub mod binary;
pub mod bota;
pub mod crc;
pub mod labamp;
pub mod lsl;
pub mod moticon;
pub mod mvn;
pub mod qtm;
pub mod tec_gihan;
pub mod text;
