//! The world in: wire formats (pure parsers and encoders), sources (sockets), captures and recordings (files).
#![forbid(unsafe_code)]

pub mod capture;
pub mod recording;
