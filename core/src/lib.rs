//! The science of Equipoise: from a body's pose and the ground's reaction to this worker's mass distribution and to
//! the overload torque of every joint (Fortini et al., 2020).
//!
//! No clock, no file, no thread, no heap, no unsafe: samples and a time go in, a state comes out. Floors, ground
//! first; each may use those above it in this list:
//! [`time`] → [`body`] → [`message`]
#![no_std]
#![forbid(unsafe_code)]

pub mod anchor;
pub mod body;
pub mod frame;
pub mod kalman;
pub mod message;
pub mod pose_suggestion;
pub mod sesc;
pub mod static_pose;
pub mod time;
