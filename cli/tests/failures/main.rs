//! Failures around the real binary.
//!
//! Every test has its own bus, state directory and ports, so they run in parallel. Nothing depends on speed: expected
//! events are awaited with generous limits.

mod adapters;
mod calibration;
mod commands;
mod consumers;
mod doctor;
mod exclusive_publishers;
mod flight;
mod full_disk;
mod gateways;
mod incidents;
mod install;
mod kill_and_restart;
mod latency;
mod malformed_datagrams;
mod metrics;
mod monitor;
mod network;
mod page;
mod plate;
mod private;
mod process;
mod random_kills;
mod reload;
mod schedule;
mod serial;
mod shutdown;
mod silence;
mod simulate;
mod startup;
mod station;
mod streams;
mod subject_deletion;
mod suit_sources;
mod two_plates;
mod usage;
mod watch;
mod watchdog;
