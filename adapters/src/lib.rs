//! The world in: wire formats (pure parsers and encoders), sources (sockets), captures and recordings (files).
//!
//! Each floor uses only those before it:
//! [`wire`] knows bytes and nothing else → [`suit`] and [`ground`] make samples of datagrams, with no socket and no
//! clock → [`source`] has the sockets and the clock. [`calibration`] finds from samples what ties two sensors together.
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
