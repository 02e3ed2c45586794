//! Suit decoding: datagrams and arrival times in, complete samples out. Does no I/O and reads no clock.

pub mod assembler;
pub mod body_cadence;
pub mod refusal;
pub mod router;
pub mod settings;
pub mod subject;
pub mod survey;

mod part;

pub use assembler::SuitAssembler;
pub use body_cadence::BodyCadence;
pub use refusal::SuitRefusal;
pub use router::SuitRouter;
pub use settings::{SuitSettings, TypeSet, UpAxis};
pub use subject::{NullPose, SuitSubject};
pub use survey::Survey;

#[cfg(test)]
mod tests;
