//! A simulated collaborative robot with a Universal Robots interface (RTDE).
//!
//! [`arm`] (kinematics) → [`motion`] (limits) → [`program`] (the on-robot program of
//! `clients/ur/handover.script`) are pure functions of inputs and simulated time; [`monitor`] observes the limits, and
//! [`controller`] commands the program. [`rtde`] serves the protocol, and [`server`] steps the program at 500 Hz of the wall clock.

pub mod arm;
pub mod controller;
pub mod monitor;
pub mod motion;
pub mod program;
pub mod rtde;
pub mod server;
pub mod trial;
