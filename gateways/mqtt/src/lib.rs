//! Gateway to an MQTT broker: publishes levels and counts of a station for plant dashboards.
//!
//! Body motion does not leave the machine: unless configured otherwise, a message contains levels, phases and counts
//! only ([`document`]). At most one message waits, the newest; while the broker is unreachable or blocked, older ones
//! are dropped and counted ([`mailbox`]).
//!
//! Modules, lowest layer first: [`document`], [`mailbox`], [`timed`] → [`session`] → [`gateway`]
#![forbid(unsafe_code)]

pub mod document;
pub mod gateway;
pub mod mailbox;
pub mod session;
pub mod timed;

pub use gateway::Mqtt;
