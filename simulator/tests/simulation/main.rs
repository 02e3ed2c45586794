//! The simulated human and its sensors: laws, other programs' values, real sockets.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking, in its helpers too")]

mod independence;
mod laws;
mod live;
mod pose_library;
mod rigid_body;
mod suit_streams;
mod wire_vectors;
