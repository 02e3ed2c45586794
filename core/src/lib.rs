//! Scientific core of Equipoise: computes, from the pose of a body and the ground reaction, the mass distribution of
//! the subject and the overload torque of every joint (Fortini et al., 2020).
//!
//! Uses no clock, files, threads, heap or unsafe code: its input is samples and a time, its output a state. Modules in
//! the order of dependency:
//! [`body`] and [`frame`] → [`time`] → [`message`] → [`effect`] → [`motion`] → [`sesc`] → [`kalman`] → [`anchor`],
//! [`registration`], [`static_pose`] → [`pose_suggestion`], [`overload`] → [`handover`], [`exposure`] → [`cycle`].
#![no_std]
#![forbid(unsafe_code)]

pub mod anchor;
pub mod body;
pub mod cycle;
pub mod effect;
pub mod exposure;
pub mod frame;
pub mod handover;
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

/// Standard gravity is 9.80665 m/s²; golden values and the paper use two decimals.
pub const GRAVITY_M_PER_S2: f64 = 9.81;
