//! Wire formats: bytes to objects and back. No I/O, no clock, no state.
//!
//! A parser never panics, for any input, and reports the fault and its position.

pub mod amti;
pub mod ati_rdt;
pub mod bota;
pub mod checksum;
pub mod frame;
pub mod labamp;
pub mod lsl;
pub mod mvn;
pub mod netft_xml;
pub mod qtm;
pub mod sliding;
pub mod tec_gihan;
pub mod text_line;

mod reader;
mod sized;
