//! The real-time loop and its threads, commands, configuration, and the command line.
//!
//! `adapters → bus → ingress → ring → LOOP → ring → egress → bus → consumers`; one file each: [`sensors`], [`ingress`],
//! [`rings`], [`tick`], [`egress`]; [`pipeline`] starts and ends them.

pub mod active_configuration;
pub mod calibration;
pub mod cli;
pub mod commands;
pub mod deletion;
pub mod demo;
pub mod doctor;
pub mod egress;
pub mod housekeeping;
pub mod incidents;
pub mod ingress;
pub mod install;
pub mod latency_log;
pub mod metrics_feed;
pub mod model_watch;
pub mod page_feed;
mod page_tokens;
pub mod pipeline;
pub mod profile;
mod provenance;
pub mod realtime;
pub mod receipt;
pub mod reconcile;
pub mod report;
pub mod restart_policy;
pub mod rings;
pub mod saving;
pub mod schedule;
pub mod sensors;
pub mod similar;
pub mod station_file;
pub mod status_file;
pub mod stored_file;
pub mod subjects;
pub mod supervision;
pub mod thread_registry;
pub mod tick;
pub mod watchdog;
