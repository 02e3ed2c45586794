//! Gateway for PLCs and MES: a read-only OPC UA server with a station's states.
//!
//! One table ([`table`]) declares all variables: name, type, unit, the validity flags that invalidate it, and the time
//! it refers to. An invalid value has a bad status and no value ([`quality`], [`values`]); old values are never held,
//! even if the gateway itself hangs ([`gateway`]).
//!
//! Modules, lowest layer first: [`quality`] → [`table`] → [`values`] → [`space`] → [`nodes`]; [`users`],
//! [`certificates`] → [`server`]; [`leftovers`] → [`gateway`]
#![forbid(unsafe_code)]

pub mod certificates;
pub mod gateway;
pub mod leftovers;
pub mod nodes;
pub mod quality;
pub mod server;
pub mod space;
pub mod table;
pub mod users;
pub mod values;

pub use gateway::OpcUa;
