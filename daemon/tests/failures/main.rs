//! The real binary, and everything that goes wrong around it.
//!
//! Every test has a bus, a state directory and ports of its own, so they run side by side. Nothing depends on speed:
//! what must come is waited for, generously.

mod adapters;
mod calibration;
mod commands;
mod consumers;
mod death;
mod doctor;
mod ending;
mod eyes;
mod flight;
mod forget;
mod full_disk;
mod incidents;
mod install;
mod latency;
mod metrics;
mod network;
mod outlets;
mod page;
mod plate;
mod play;
mod private;
mod process;
mod reload;
mod schedule;
mod serial;
mod silence;
mod starting;
mod station;
mod streams;
mod suit_sources;
mod suit_storm;
mod survive;
mod taking_over;
mod two_plates;
mod usage;
mod watch;
