//! The real-time loop and its threads, commands, configuration, and the command line.
//!
//! `adapters → bus → ingress → ring → LOOP → ring → egress → bus → consumers`; one file each: [`sensors`], [`ingress`],
//! [`rings`], [`tick`], [`egress`]; [`pipeline`] starts and ends them.

pub mod adapter_fault;
pub mod calibration;
pub mod cli;
pub mod commands;
pub mod config;
pub mod deletion;
pub mod demo;
pub mod doctor;
pub mod egress;
pub mod housekeeping;
pub mod import;
pub mod in_force;
pub mod incidents;
pub mod ingress;
pub mod install;
mod joined;
pub mod keeper;
pub mod latency_log;
pub mod metrics_feed;
pub mod model;
pub mod model_watch;
pub mod page_feed;
mod page_tokens;
pub mod picked_up;
pub mod pipeline;
mod process_state;
pub mod profile;
mod provenance;
pub mod realtime;
pub mod reconcile;
pub mod record;
pub mod replay;
pub mod report;
pub mod rings;
pub mod roster;
pub mod saving;
pub mod schedule;
pub mod sensors;
pub mod similar;
pub mod state_directory;
pub mod station_file;
pub mod status;
pub mod stored_file;
pub mod supervision;
pub mod tick;
pub mod trace;
pub mod watchdog;
pub mod whole_file;
pub mod workers;
