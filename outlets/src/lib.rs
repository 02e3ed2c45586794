//! Outlets: what leaves the station's machine, each in a process of its own, so that no peer of it reaches the loop.
//!
//! An [`Outlet`] says how a reading, or the reason why there is none, looks on one wire. [`drive()`] is what all have in
//! common: it takes the newest state off the bus at the outlet's rate, as one more consumer, and feeds the watchdog.
//! [`process`] is the rest of a program: arguments, configuration, signals, log.
//!
//! Outlets that stand on a big library (`outlets/opcua`, `outlets/mqtt`, `outlets/zenoh`, `outlets/foxglove`) are crates
//! of their own, so that nobody who does not need one builds it: `equipoise outlet KIND` starts the program
//! `equipoise-outlet-KIND` that lies beside it.
//!
//! Those that need no library of their own are here: [`udp`], [`rtde`].
//!
//! Floors, ground first: [`config`] → [`outlet`] → [`drive`](mod@drive) → [`process`] → [`udp`], [`rtde`]
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
