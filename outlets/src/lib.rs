//! Gateways ("outlets"): send a station's states to other machines. Each runs in a process of its own, so that no
//! remote peer affects the loop.
//!
//! An [`Outlet`] encodes a reading, or the reason why there is none, for one protocol. [`drive()`] is common to all: it
//! reads the newest state from the bus at the gateway's rate, like any other consumer, and notifies the watchdog.
//! [`process`] is the rest of the program: arguments, configuration, signals, log.
//!
//! Gateways that depend on a large library (`outlets/opcua`, `outlets/mqtt`, `outlets/zenoh`, `outlets/foxglove`) are
//! crates of their own, so that they are built only where needed: `equipoise outlet KIND` starts the program
//! `equipoise-outlet-KIND` in its own folder.
//!
//! Gateways without such a library are in this crate: [`udp`], [`rtde`].
//!
//! Modules, lowest layer first: [`config`] → [`outlet`] → [`drive`](mod@drive) → [`process`] → [`udp`], [`rtde`]
#![forbid(unsafe_code)]

pub mod config;
pub mod drive;
pub mod outlet;
pub mod process;
pub mod rtde;
pub mod udp;

pub use config::{OutletsConfig, StationFile};
pub use drive::drive;
pub use outlet::{Outlet, Seen, Tally};
