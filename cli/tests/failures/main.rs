//! The real binary in real time, with simulated sensors: failures, recorders, sessions over the wires.
//!
//! Every test has its own bus, state directory and ports, so they run in parallel. Nothing depends on speed: expected
//! events are awaited with generous limits. Tests that compute without waiting are in other binaries, so that they do not
//! delay these.
#![expect(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod acceptance;
mod adapters;
mod calibration;
mod commands;
#[path = "../common/mod.rs"]
mod common;
mod consumers;
mod doctor;
mod exclusive_publishers;
mod flight;
mod full_disk;
mod gateways;
mod guidance;
mod incidents;
mod insoles;
mod install;
mod kill_and_restart;
mod latency;
#[path = "../reconcile/make.rs"]
#[expect(dead_code, reason = "the live model needs a part of it")]
mod make;
mod malformed_datagrams;
mod metrics;
mod monitor;
mod network;
mod null_pose;
mod page;
mod plate;
mod private;
mod process;
mod record_live;
mod record_pictures;
mod record_service;
mod record_signed;
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
mod subject_export;
mod suit_sources;
mod two_stations;
mod usage;
mod watch;
mod watchdog;
