//! What ties one sensor to another, or to a known thing, found from their own samples: pure functions and steps, no
//! clock, no socket.

pub mod average;
pub mod register;
pub mod stomp;
pub mod verify;
