//! Serial lines and the plates on them, over real pseudo terminals: plugged in, unplugged, noisy, at a wrong speed.

mod devices;
mod line;
mod plate;
mod pty;
mod sheet;
