//! Failures around the real binary.
//!
//! Every test has its own bus, state directory and ports, so they run in parallel. Nothing depends on speed: expected
//! events are awaited with generous limits.

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
mod watchdog;
