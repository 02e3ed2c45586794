//! Shared memory through iceoryx2: the only crate that imports it, with one table of services.
//!
//! A thread joins a station's [`Bus`] under a role name and creates its ports there. [`service::TABLE`] lists the
//! services; the message type selects the row:
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
//! A slow or dead reader never blocks a writer: it loses the oldest messages and detects the loss by their counts. A
//! bus and its ports belong to the thread that created them (they are not `Send`); each further thread joins
//! separately. Do not send or receive in the loop's thread: when a peer connects or disconnects, the next call on this
//! side does the necessary work, with allocations and system calls.
#![forbid(unsafe_code)]

pub mod command;
mod empty_memory;
pub mod error;
pub mod event;
mod half_made;
pub mod node;
mod open;
mod orphaned_connections;
pub mod publisher;
pub mod root;
pub mod service;
pub mod subscriber;
pub mod words;

pub use command::{
    CommandClient, CommandServer, HandoverClient, HandoverServer, Request, RequestClient, parse_text,
};
pub use error::BusError;
pub use event::{Channel, Event, Events, Listener, Notifier};
pub use node::{Bus, BusSettings, Participant};
pub use publisher::{Publisher, RetainedService};
pub use service::{Service, Topic};
pub use subscriber::Subscriber;
