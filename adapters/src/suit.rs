//! The suit's brain: datagrams and arrival times in, whole samples out. No socket, no clock.

pub mod assembler;
pub mod refusal;
pub mod settings;
pub mod subject;

mod part;
mod stride;

pub use assembler::SuitAssembler;
pub use refusal::SuitRefusal;
pub use settings::{SuitSettings, TypeSet};
pub use subject::{NullPose, SuitSubject};

#[cfg(test)]
mod tests;
