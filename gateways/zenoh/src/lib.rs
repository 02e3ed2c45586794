//! Gateway to other machines over Zenoh: JSON for dashboards, and CDR for ROS 2 nodes on `rmw_zenoh`.
//!
//! Modules, lowest layer first: [`cdr`] → [`ros`] → [`json`] → [`session`] → [`gateway`]
#![forbid(unsafe_code)]

pub mod cdr;
pub mod gateway;
pub mod json;
pub mod ros;
pub mod session;

pub use gateway::ZenohGateway;
