//! The blind bench of the discrepancy workflow: sessions with something hidden in them, and a judge of what is found.
//!
//! Floors, ground first: [`truth`] → [`ladder`] (what is hidden, how large) → [`scenario`] (what the worker does) →
//! [`recording`] → [`make`] → [`cli`]. The generator has the simulator's physics and sensors and knows nothing of `core`'s effects:
//! names, places, parameters and units are those of the catalogue, columns are not used.

pub mod cli;
pub mod ladder;
pub mod make;
pub mod recording;
pub mod scenario;
pub mod truth;
