//! Motion of the body, and the effect of its inertia on the ground reaction.
//!
//! In motion the centre of pressure is not below the centre of mass: with the centre's acceleration C̈ and the rate of
//! the angular momentum about it L̇, both over the body's mass, the ground reaction of the body alone acts at
//! `CoP = C_xy − C_z C̈_xy/(g + C̈_z) + (−L̇_y, L̇_x)/(g + C̈_z)` (from Newton and Euler, the floor at height 0).
//!
//! Accelerations are computed from positions, by a parabola through the samples on both sides of a snapshot
//! ([`weights`]), and from the suit's own accelerations if it sends them ([`accelerations`]). So the results for a
//! snapshot are available half a window later.

pub mod accelerations;
pub mod causal;
pub mod confidence;
pub mod difference;
pub mod force_offset;
pub mod history;
pub mod inertia;
pub mod unloaded;
pub mod weights;

pub use accelerations::Accelerations;
pub use causal::{CausalMotion, causal_motion, end_kernel};
pub use confidence::{Confidence, Envelope};
pub use difference::{DifferenceVariance, VariancePrior};
pub use force_offset::ForceOffset;
pub use history::{History, Motion, Snapshot};
pub use inertia::{Inertia, MassDistribution, UpperInertia};
pub use unloaded::{ForceSigma, Load, Unloaded};
