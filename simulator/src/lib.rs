//! A simulated human on the real wires, with its own physics.
//!
//! Layers, lowest first: [`random`] → [`person`] → [`kinematics`] → [`leg`] → [`stance`] → [`pose`] → [`balance`] →
//! [`intention`] → [`repertoire`], [`limits`], [`reach`], [`grasp`] → [`schedule`] → [`march`], [`stomp`], [`walk`],
//! [`feet`] → [`motion`] →
//! [`realism`], [`dynamics`] → [`truth`] → [`two_plates`], [`colour`] → [`noise`], [`burden`] → [`plate_fault`] →
//! [`scene`]; [`wires`] → [`wire`], [`plate`], [`ports`] → [`suit_sender`], [`plate_server`] (through [`faults`]),
//! [`clock`] → [`devices`] → [`simulation`], [`player`]; [`cobot`]. Geometry, masses and dynamics are the simulator's own: it
//! shares the names of segments and joints with `equipoise_core`, and never its anthropometry or its estimator, so that
//! agreement between the two is independent evidence.
//!
//! World: X forward, Y left, Z up, metres; the floor under the feet is `z = 0`.
#![forbid(unsafe_code)]

pub mod balance;
pub mod burden;
pub mod clock;
pub mod cobot;
pub mod colour;
pub mod devices;
pub mod dynamics;
pub mod faults;
pub mod feet;
pub mod grasp;
pub mod intention;
pub mod kinematics;
pub mod leg;
pub mod limits;
pub mod march;
pub mod motion;
pub mod noise;
pub mod person;
pub mod plate;
pub mod plate_fault;
pub mod plate_server;
pub mod player;
pub mod ports;
pub mod pose;
pub mod random;
pub mod reach;
pub mod realism;
pub mod repertoire;
pub mod scene;
pub mod schedule;
pub mod settings;
pub mod simulation;
pub mod stance;
pub mod stomp;
mod suit_more;
pub mod suit_sender;
mod threads;
pub mod truth;
pub mod two_plates;
pub mod walk;
pub mod wire;
pub mod wires;

/// Standard gravity at the simulated plate, m/s².
pub const GRAVITY_M_PER_S2: f64 = 9.81;
