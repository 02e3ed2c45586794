//! Gateway to other machines over Zenoh: JSON for dashboards, and CDR for ROS 2 nodes on `rmw_zenoh`.
//!
//! Modules, lowest layer first: [`cdr`] → [`ros`] → [`json`] → [`session`] → [`outlet`]
#![forbid(unsafe_code)]

pub mod cdr;
pub mod json;
pub mod outlet;
pub mod ros;
pub mod session;

pub use outlet::ZenohOutlet;
