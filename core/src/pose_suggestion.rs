//! Which pose to ask for next, from a library of poses that people can hold.

pub mod library;
pub mod posture;

pub use posture::Posture;
