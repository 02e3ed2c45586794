//! Levels and counts of a station for plant dashboards, published to an MQTT broker.
//!
//! How a person moves does not leave the machine: a message names levels, phases and counts, nothing else, unless the
//! configuration says otherwise ([`document`]). One message waits at most, the newest; a broker that is away or stuck costs
//! nothing but what it misses, which is counted ([`mailbox`]).
//!
//! Floors, ground first: [`document`], [`mailbox`], [`timed`] → [`session`] → [`outlet`]
#![forbid(unsafe_code)]

pub mod document;
pub mod mailbox;
pub mod outlet;
pub mod session;
pub mod timed;

pub use outlet::Mqtt;
