//! Studies of the method with many synthetic subjects: offline, without sockets, as fast as possible.
//!
//! Layers, lowest first, each dependent only on the previous ones: [`subject`] → [`sensors`] → [`mixtures`] →
//! [`session`] → [`tasks`], [`tally`], [`table`], [`variants`] → the studies: [`paper`], [`poses`], [`lifting`],
//! [`natural`], [`coverage`], [`back`], [`sources`], [`clocks`], [`early`], [`restarts`], [`handover`] → [`cobot`],
//! [`hidden`] → [`cli`]. All results follow from a seed and are independent of the number of threads.
#![forbid(unsafe_code)]

pub mod back;
pub mod cli;
pub mod clocks;
pub mod cobot;
pub mod coverage;
pub mod early;
pub mod faults;
pub mod handover;
pub mod hidden;
pub mod lifting;
pub mod mixtures;
pub mod natural;
pub mod paper;
pub mod poses;
pub mod restarts;
pub mod sensors;
pub mod session;
pub mod sources;
pub mod subject;
pub mod table;
pub mod tally;
pub mod tasks;
pub mod variants;
