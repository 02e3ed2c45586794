//! The science of Equipoise: from a body's pose and the ground's reaction to this worker's mass distribution and to
//! the overload torque of every joint (Fortini et al., 2020).
//!
//! No clock, no file, no thread, no heap, no unsafe: samples and a time go in, a state comes out. Floors, ground
//! first, each resting only on those before it:
//! [`time`], [`body`] and [`frame`] → [`message`] → [`effect`] → [`motion`], [`sesc`] → [`kalman`] → [`anchor`], [`registration`], [`static_pose`] →
//! [`pose_suggestion`] → [`overload`] → [`exposure`] → [`cycle`].
#![no_std]
#![forbid(unsafe_code)]

pub mod anchor;
pub mod body;
pub mod cycle;
pub mod effect;
pub mod exposure;
pub mod frame;
pub mod kalman;
mod math;
pub mod message;
pub mod motion;
pub mod overload;
pub mod pose_suggestion;
pub mod registration;
pub mod sesc;
pub mod static_pose;
pub mod time;
