//! Gateways: send a station's states to other machines. Each runs in a process of its own, so that no
//! remote peer affects the loop.
//!
//! A [`Gateway`] encodes a reading, or the reason why there is none, for one protocol. [`drive()`] is common to all: it
//! reads the newest state from the bus at the gateway's rate, like any other consumer, and notifies the watchdog.
//! [`process`] is the rest of the program: arguments, configuration, signals, log.
//!
//! Gateways that depend on a large library (`gateways/opcua`, `gateways/mqtt`, `gateways/zenoh`, `gateways/foxglove`)
//! are crates of their own, so that they are built only where needed: `equipoise gateway KIND` starts the program
//! `equipoise-gateway-KIND` in its own folder.
//!
//! Gateways without such a library are in this crate: [`udp`], [`rtde`].
//!
//! Modules, lowest layer first: [`config`] → [`gateway`] → [`drive`](mod@drive) → [`process`] → [`udp`], [`rtde`]
#![forbid(unsafe_code)]

pub mod drive;
pub mod gateway;
pub mod process;
pub mod rtde;
pub mod udp;

pub use drive::drive;
pub use equipoise_config::gateways as config;
pub use equipoise_config::gateways::{GatewaysConfig, StationFile};
pub use gateway::{Gateway, Latest, Tally};
