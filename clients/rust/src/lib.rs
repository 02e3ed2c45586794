//! Subscribes to a station's states, and reports their delays.
//!
//! ```no_run
//! use equipoise_client::{Consumer, NoReading};
//! use equipoise_core::message::Validity;
//! use std::time::Duration;
//!
//! let mut consumer = Consumer::join("station-1", "controller")?;
//! loop {
//!     match consumer.next(Duration::from_millis(20)) {
//!         Ok(reading) => match reading.state.unless(Validity::INVALIDATES_TORQUES, reading.state.torque_nm) {
//!             Some(torque_nm) => println!("{torque_nm:?}, {} ns after its cycle was due", reading.age_ns),
//!             None => println!("withheld: {:?}", reading.validity().names().collect::<Vec<_>>()),
//!         },
//!         Err(NoReading::Bus(error)) => eprintln!("{error}"), // until it has rejoined, by itself
//!         Err(nothing) => println!("no value: {nothing}"),    // now the robot goes to its safe speed
//!     }
//! }
//! # #[expect(unreachable_code, reason = "the example never ends, but must have a type")]
//! # Ok::<(), equipoise_bus::BusError>(())
//! ```
//!
//! A [`Reading`] is a current state: it is not older than [`ConsumerSettings::stale_after`], and no later one was
//! returned before it. Otherwise a [`NoReading`] gives the reason. Values of a current state may still be invalid: see
//! `valid` ([`equipoise_core::message::Validity`]).
//!
//! A consumer survives the daemon's end and joins the next daemon by itself. Once a second it publishes the delays of
//! states ([`equipoise_core::message::ConsumerReceipt`]), which `equipoise latency` displays as the end of the path.
//!
//! Modules, lowest layer first: [`clock`] → `sequence` → [`reading`], [`early`] → `reporting` → [`consumer`]
#![forbid(unsafe_code)]

pub mod clock;
pub mod consumer;
pub mod early;
pub mod reading;
mod reporting;
mod sequence;

pub use consumer::{Consumer, ConsumerSettings};
pub use early::EarlyReading;
pub use reading::{NoReading, Reading};
