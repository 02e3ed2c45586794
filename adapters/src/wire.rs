//! Wire formats: bytes to objects and back. No socket, no clock, no state.
//!
//! A parser never panics, whatever it is fed, and says what is wrong and where.

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
