//! Questions to the method, answered over many synthetic subjects: offline, without sockets, as fast as it computes.
//!
//! Floors, ground first, each resting only on those before it: [`subject`] → [`sensors`] → [`mixtures`] → [`session`] → [`tasks`],
//! [`tally`], [`table`], [`variants`] → the questions: [`paper`], [`poses`], [`lifting`], [`natural`], [`coverage`], [`back`],
//! [`sources`], [`clocks`], [`restarts`], [`hidden`] → [`cli`].
//! Everything follows from a seed: the same question gives the same answer, however many threads ask it.
#![forbid(unsafe_code)]

pub mod back;
pub mod cli;
pub mod clocks;
pub mod coverage;
pub mod faults;
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
