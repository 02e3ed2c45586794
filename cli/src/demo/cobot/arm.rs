//! The simulated arm and its controller: from the newest state to RTDE's registers.

use std::net::{Ipv4Addr, SocketAddr};
use std::time::{Duration, Instant};

use anyhow::Context;
use equipoise_core::message::{State, Validity};
use equipoise_daemon::realtime::now_ns;
use equipoise_simulator::cobot::arm::{JOINTS, chain_m};
use equipoise_simulator::cobot::controller::{Controller, Target};
use equipoise_simulator::cobot::program::{Activity, CobotSettings};
use equipoise_simulator::cobot::server::Cobot;
use nalgebra::{Point3, Vector3};

use super::robot_link::{Reading, RobotLink};

/// Interval of the commands: that of `clients/python/handover_controller.py`.
const SEND_EVERY: Duration = Duration::from_millis(8);
/// Maximum age of a state, ns, and longest time between two decisions without an interruption, s: those of
/// `clients/python/handover.py`.
const AGE_MAX_NS: u64 = 50_000_000;
const GAP_MAX_S: f64 = 0.05;
/// Flags that stop the arm: a worker without a load is a valid state.
const STOPS: Validity = Validity(Validity::INVALIDATES_TORQUES.0 & !Validity::BELOW_LOAD_THRESHOLD.0);

/// Position of the base in the station's world, and height of the workspace above it, m: it contains the places that the
/// daemon plans, from 0.6 to 1.5 m above the floor.
const BASE_M: [f64; 3] = [1.05, 0.0, 0.55];
const WORKSPACE_M: f64 = 1.0;

/// What the arm is commanded to do.
#[derive(Debug, Clone, Copy)]
pub(super) enum Goal {
    /// Hold the part at rest.
    Hold,
    /// Move the part while the state is valid.
    Present(Target),
    /// Move to the retreat position.
    Retreat,
}

/// A simulated UR10e on a loopback port, and the connection to it.
#[derive(Debug)]
pub(in super::super) struct Arm {
    settings: CobotSettings,
    robot: RobotLink,
    controller: Controller,
    decided: Instant,
    /// The arm moves while this exists.
    _cobot: Cobot,
}

impl Arm {
    pub(in super::super) fn start() -> anyhow::Result<Arm> {
        let mut settings = CobotSettings::at(BASE_M, 0.0);
        settings.workspace.high_m.z = WORKSPACE_M;
        let cobot = Cobot::start(settings, SocketAddr::from((Ipv4Addr::LOCALHOST, 0)))
            .context("the simulated cobot")?;
        let robot = RobotLink::connect(cobot.address())?;
        let controller = Controller::default();
        Ok(Arm { settings, robot, controller, decided: Instant::now(), _cobot: cobot })
    }

    pub(super) fn settings(&self) -> &CobotSettings {
        &self.settings
    }

    /// Base, the end of each link and the part, station's world, m; `None` before the first data.
    pub(super) fn chain_m(&self) -> Option<[[f64; 3]; JOINTS + 1]> {
        let in_world =
            |at_m: Vector3<f64>| (self.settings.world_from_base * Point3::from(at_m)).coords.into();
        Some(chain_m(&self.robot.newest()?.q_rad).map(in_world))
    }

    /// Slope of the handles, rad; `None` before the first data.
    pub(super) fn slope_rad(&self) -> Option<f64> {
        Some(self.settings.slope_rad(&self.robot.newest()?.q_rad))
    }

    /// Heading of the handles, rad; `None` before the first data.
    pub(super) fn heading_rad(&self) -> Option<f64> {
        Some(self.settings.heading_rad(&self.robot.newest()?.q_rad))
    }

    /// Commands the arm; it moves to a place only while the newest state is valid. Returns the position of the part,
    /// station's world, m; `None` before the first data.
    pub(super) fn drive(&mut self, state: &State, goal: Goal) -> anyhow::Result<Option<Vector3<f64>>> {
        let Some(Reading { part_m, .. }) = self.robot.poll()? else { return Ok(None) };
        let since = self.decided.elapsed();
        if since >= SEND_EVERY {
            self.decided = Instant::now();
            let step_s = since.as_secs_f64();
            let is_current = now_ns().saturating_sub(state.published_ns) <= AGE_MAX_NS && step_s <= GAP_MAX_S;
            let is_valid = is_current && !state.validity().any_of(STOPS);
            let target = match goal {
                Goal::Present(target) => Some(target),
                Goal::Hold | Goal::Retreat => None,
            };
            let mut inputs = self.controller.decide(is_valid, target, part_m, step_s.min(GAP_MAX_S));
            if matches!(goal, Goal::Retreat) {
                inputs.command = Activity::Retreat as i32;
            }
            self.robot.send(&inputs)?;
        }
        Ok(Some(part_m))
    }
}
