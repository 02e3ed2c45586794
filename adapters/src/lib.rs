//! The world in: wire formats (pure parsers and encoders), sources (sockets), captures and recordings (files).
//!
//! Each floor uses only those before it:
//! [`wire`] knows bytes and nothing else.
#![forbid(unsafe_code)]

pub mod wire;

pub mod capture;
pub mod recording;
