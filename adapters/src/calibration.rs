//! Calibration of one sensor against another, or against a reference, from their samples: pure functions and state
//! machines without I/O or clock.

pub mod average;
pub mod register;
pub mod stomp;
pub mod verify;
