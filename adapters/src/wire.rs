//! Wire formats: bytes to objects and back. No socket, no clock, no state.
//!
//! A parser never panics, whatever it is fed, and says what is wrong and where.

pub mod ati_rdt;
pub mod mvn;

mod reader;
