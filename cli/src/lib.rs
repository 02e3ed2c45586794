//! The program `equipoise`: its commands ([`commands`]) and what only they need: the demonstration, the checks of a
//! station, the installation, the page's server, calibration procedures.
#![forbid(unsafe_code)]

// Before all other modules, in which its macros replace those of std.
#[macro_use]
mod output;

pub mod calibration;
mod client;
pub mod commands;
pub mod deletion;
pub mod demo;
pub mod doctor;
pub mod install;
pub mod metrics_feed;
pub mod page_feed;
mod page_tokens;
mod progress_bar;
mod provenance;
pub mod receipt;
mod stations;
pub mod subject_data;
pub mod subject_export;
