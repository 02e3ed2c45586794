//! Programs in C, C++ and Python on the library and the header: one test binary, so that waits overlap.
#![expect(clippy::unwrap_used, reason = "a test may panic")]

#[path = "../../../rust/tests/common/mod.rs"]
mod common;
mod compiler;
mod ffi;
#[path = "../../../rust/tests/common/flag_sets.rs"]
mod flag_sets;
mod handover;
mod header;
#[path = "../../../rust/tests/common/names.rs"]
mod names;
