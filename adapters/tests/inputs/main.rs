//! What is read from files, sockets and serial lines: one test binary, so that waits overlap.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking, in its helpers too")]

mod files;
mod net;
mod serial;
