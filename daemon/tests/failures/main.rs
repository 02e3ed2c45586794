//! The real binary, and everything that goes wrong around it.
//!
//! Every test has a bus, a state directory and ports of its own, so they run side by side. Nothing depends on speed:
//! what must come is waited for, generously.

mod adapters;
mod commands;
mod consumers;
mod death;
mod ending;
mod eyes;
mod install;
mod network;
mod page;
mod plate;
mod play;
mod process;
mod silence;
mod starting;
mod station;
mod streams;
mod suit_storm;
mod usage;
