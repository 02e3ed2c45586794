//! A station's states for PLCs and MES: an OPC UA server that is read only.
//!
//! What it shows is one table ([`table`]): name, type, unit, what spoils it, and which time it is about. A value that
//! must not be used has a bad status and no value ([`quality`], [`values`]); nothing is held over, not even when the
//! outlet itself hangs ([`outlet`]).
//!
//! Floors, ground first: [`quality`] → [`table`] → [`values`] → [`space`] → [`nodes`]; [`users`], [`certificates`] → [`server`];
//! [`leftovers`] → [`outlet`]
#![forbid(unsafe_code)]

pub mod certificates;
pub mod leftovers;
pub mod nodes;
pub mod outlet;
pub mod quality;
pub mod server;
pub mod space;
pub mod table;
pub mod users;
pub mod values;

pub use outlet::OpcUa;
