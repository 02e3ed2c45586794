//! What the sensors of other makers put on their wires, written from their manuals and never from our own parsers.
//!
//! One file a device, pure functions from numbers to bytes (and from a host's requests to what they ask). Nothing here
//! knows a person, a socket or a clock.

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
