//! Questions to the method, answered over many synthetic subjects: offline, without sockets, as fast as it computes.
//!
//! Floors, ground first: [`subject`] → [`sensors`] → [`session`] → [`tasks`], each resting only on those before it.
//! Everything follows from a seed: the same question gives the same answer, however many threads ask it.
#![forbid(unsafe_code)]

pub mod sensors;
pub mod session;
pub mod subject;
pub mod tasks;
