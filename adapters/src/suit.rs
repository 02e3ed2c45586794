//! The suit's brain: datagrams and arrival times in, whole samples out. No socket, no clock.

pub mod assembler;
pub mod refusal;
pub mod subject;

mod part;
mod stride;

pub use assembler::{SuitAssembler, SuitSettings, TypeSet};
pub use refusal::SuitRefusal;
pub use subject::{NullPose, SuitSubject};

#[cfg(test)]
mod tests;
