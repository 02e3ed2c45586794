//! The world in: wire formats (pure parsers and encoders), sources (sockets), captures and recordings (files).

pub mod capture;
pub mod recording;
