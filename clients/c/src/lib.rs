//! The Rust client behind a C interface: `clients/c/equipoise.h` says what each function does.
//!
//! C sees no type of the bus, so a program in C or C++ needs neither its headers nor its version, only this library
//! and the daemon of one release. Everything that C hands over is looked at in [`border`], the one file with unsafe
//! code; everything behind it is safe.
//!
//! Floors, ground first: [`outcome`] → [`reading`] → [`handle`], [`layout`] → [`border`]

pub mod border;
pub mod handle;
pub mod layout;
pub mod outcome;
pub mod reading;

pub use handle::{Handle, Options};
pub use outcome::Outcome;
pub use reading::Reading;
