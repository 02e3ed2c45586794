//! Input side: wire formats (pure parsers and encoders), sources (sockets), captures and recordings (files).
//!
//! Each layer uses only the preceding ones: [`wire`] decodes bytes → [`suit`] and [`ground`] convert datagrams to
//! samples, without I/O or clock → [`source`] contains sockets and clock. [`calibration`] estimates the relation of two
//! sensors from samples.
#![forbid(unsafe_code)]

pub mod calibration;
pub mod clock;
pub mod counts;
pub mod ground;
pub mod sequence;
pub mod source;
mod stride;
pub mod suit;
mod units;
pub mod wire;

pub mod capture;
pub mod recording;
