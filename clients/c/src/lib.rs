//! C interface of the Rust client; `clients/c/equipoise.h` documents each function.
//!
//! The interface exposes no type of the bus, so a C or C++ program needs neither the bus's headers nor its version,
//! only this library and a daemon of the same release. All data from C is checked in [`ffi`], the only file with
//! unsafe code; the code below it is safe.
//!
//! Modules, lowest layer first: [`outcome`] → [`reading`] → [`handle`], [`layout`] → [`ffi`]

pub mod ffi;
pub mod handle;
pub mod layout;
pub mod outcome;
pub mod reading;

pub use handle::{Handle, Options};
pub use outcome::Outcome;
pub use reading::{EarlyReading, Reading};
