//! The service: the real-time loop, its threads, their supervision and the state on disk.
//!
//! `adapters → bus → ingress → ring → LOOP → ring → egress → bus → consumers`; one file each: [`sensors`], [`ingress`],
//! [`rings`], [`tick`], [`egress`]; [`pipeline`] starts and ends them, [`run`](mod@run) is the program.

pub mod active_configuration;
pub mod commands;
pub mod egress;
#[cfg(test)]
mod example_config;
pub mod housekeeping;
pub mod incidents;
pub mod ingress;
pub mod latency_log;
pub mod model_watch;
pub mod pipeline;
pub mod planner;
pub mod profile;
pub mod realtime;
pub mod restart_policy;
pub mod rings;
pub mod run;
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
mod weighing;
