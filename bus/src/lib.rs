//! Shared memory: the only importer of iceoryx2, and one table of services.
//!
//! A thread joins a station's [`Bus`] under a role name and makes its ports there. What there is to read and write
//! stands in [`service::TABLE`]; the message type chooses the row:
//!
//! ```no_run
//! use equipoise_bus::{Bus, BusSettings, Channel};
//! use equipoise_core::message::State;
//! use std::time::Duration;
//!
//! let bus = Bus::join(&BusSettings::new("station-1", "controller"))?;
//! let mut states = bus.subscriber::<State>(1)?; // one slot: only ever the newest
//! let events = bus.listener(Channel::Results)?;
//! loop {
//!     events.wait(Duration::from_millis(20))?;
//!     if let Some(state) = states.latest()? {
//!         println!("cycle {}", state.cycle);
//!     }
//! }
//! # #[expect(unreachable_code, reason = "the example never ends, but must have a type")]
//! # Ok::<(), equipoise_bus::BusError>(())
//! ```
//!
//! A reader that is slow or dead never blocks a writer: it loses the oldest messages, and sees so by their counts.
//! A bus and its ports belong to the thread that made them (they are not `Send`); another thread joins anew. Neither
//! sending nor receiving is for the loop's thread: work for a peer that comes or goes is done, with allocations and
//! system calls, inside the next call of this side.
#![forbid(unsafe_code)]

pub mod command;
mod empty_memory;
pub mod error;
pub mod event;
mod half_made;
pub mod node;
mod open;
pub mod publisher;
pub mod root;
pub mod service;
pub mod subscriber;
pub mod words;

pub use command::{CommandClient, CommandServer};
pub use error::BusError;
pub use event::{Channel, Event, Events, Listener, Notifier};
pub use node::{Bus, BusSettings, Participant};
pub use publisher::{Kept, Publisher};
pub use service::{Service, Topic};
pub use subscriber::Subscriber;
