//! Serial lines and the plates on them, over real pseudo terminals: plugged in, unplugged, noisy, at a wrong speed.
#![expect(clippy::unwrap_used, reason = "what a test is made of may panic as the test does")]

mod devices;
mod line;
mod plate;
mod pty;
mod sheet;
