//! Motion of the arm within its limits: one step of 2 ms at a time, a pure function of state and command.
//!
//! In each step the motion keeps the ability to stop inside the workspace: a step after which the stopping path would
//! end outside is replaced by a step of the stop. Every stop decelerates all joints by one factor, so that the TCP stays
//! on its path.

use nalgebra::{UnitQuaternion, Vector3, Vector6};

use super::arm::{self, Joints};

/// Control period of an e-Series controller, s.
pub const STEP_S: f64 = 0.002;
/// Fraction of each limit that the motion plans with; the rest covers the curvature of the path within a step.
const PLANNED: f64 = 0.9;
/// Speed per distance to the target, 1/s.
const APPROACH_PER_S: f64 = 10.0;
/// Turn rate per orientation error, 1/s, and its maximum, rad/s.
const TURN_PER_S: f64 = 5.0;
const TURN_MAX_RAD_PER_S: f64 = 0.3;
/// Distance between the stopping path and the border of the workspace, m.
const BORDER_M: f64 = 0.002;
/// Halvings in the search for the largest permitted change of velocity.
const HALVINGS: u32 = 12;

/// Limits of the motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Joint velocity, rad/s.
    pub joint_rad_per_s: f64,
    /// Joint acceleration, rad/s².
    pub joint_rad_per_s2: f64,
    /// TCP velocity, m/s.
    pub tcp_m_per_s: f64,
    /// TCP acceleration, m/s².
    pub tcp_m_per_s2: f64,
}

impl Default for Limits {
    /// Slower than ISO/TS 15066's 0.25 m/s for hand guiding; from full speed the arm stops in less than 50 ms. A UR10e
    /// permits 2 rad/s and 14 rad/s² in each joint.
    fn default() -> Limits {
        Limits { joint_rad_per_s: 0.5, joint_rad_per_s2: 14.0, tcp_m_per_s: 0.15, tcp_m_per_s2: 4.0 }
    }
}

/// Permitted positions of the TCP, base frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Workspace {
    /// Lowest corner of the box, m.
    pub low_m: Vector3<f64>,
    /// Highest corner of the box, m.
    pub high_m: Vector3<f64>,
    /// Greatest distance from the shoulder (the base's axis at the height of joint 2), m.
    pub reach_m: f64,
}

/// Height of joint 2 above the base, m.
const SHOULDER_M: f64 = 0.1807;

impl Workspace {
    /// Distance from a position to the nearest border, m; negative outside.
    #[must_use]
    pub fn margin_m(&self, at_m: &Vector3<f64>) -> f64 {
        let to_box = (at_m - self.low_m).min().min((self.high_m - at_m).min());
        to_box.min(self.reach_m - (at_m - Vector3::new(0.0, 0.0, SHOULDER_M)).norm())
    }

    /// Whether the motion can stop at this position.
    #[must_use]
    pub fn permits(&self, at_m: &Vector3<f64>) -> bool {
        self.margin_m(at_m) > BORDER_M
    }
}

impl Default for Workspace {
    fn default() -> Workspace {
        Workspace {
            low_m: Vector3::new(-0.9, -0.45, 0.0),
            high_m: Vector3::new(-0.4, 0.45, 0.7),
            reach_m: 1.1,
        }
    }
}

/// What the arm does in a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Decelerates to rest.
    Stop,
    /// Moves the TCP in a straight line to a position in the base, m, and turns it to an orientation.
    Toward(Vector3<f64>, UnitQuaternion<f64>),
}

/// The arm in motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    limits: Limits,
    workspace: Workspace,
    q_rad: Joints,
    qd_rad_per_s: Joints,
    is_stopped: bool,
}

/// The start is outside the workspace.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the cobot's start is outside its workspace")]
pub struct OutsideWorkspace;

impl Motion {
    /// An arm at rest.
    ///
    /// # Errors
    /// [`OutsideWorkspace`] if it could not stop there.
    pub fn new(q_rad: Joints, limits: Limits, workspace: Workspace) -> Result<Motion, OutsideWorkspace> {
        let pose = arm::forward(&q_rad);
        if !workspace.permits(&pose.translation.vector) {
            return Err(OutsideWorkspace);
        }
        Ok(Motion { limits, workspace, q_rad, qd_rad_per_s: Joints::zeros(), is_stopped: false })
    }

    /// Joint angles, rad.
    #[must_use]
    pub fn q_rad(&self) -> Joints {
        self.q_rad
    }

    /// Joint velocities, rad/s.
    #[must_use]
    pub fn qd_rad_per_s(&self) -> Joints {
        self.qd_rad_per_s
    }

    /// Position of the TCP, base, m.
    #[must_use]
    pub fn tcp_m(&self) -> Vector3<f64> {
        arm::forward(&self.q_rad).translation.vector
    }

    /// Orientation of the TCP, base.
    #[must_use]
    pub fn orientation(&self) -> UnitQuaternion<f64> {
        arm::forward(&self.q_rad).rotation
    }

    /// Velocity of the TCP, base axes, m/s.
    #[must_use]
    pub fn tcp_m_per_s(&self) -> Vector3<f64> {
        arm::tcp_velocity(&self.q_rad, &self.qd_rad_per_s)
    }

    /// The workspace.
    #[must_use]
    pub fn workspace(&self) -> &Workspace {
        &self.workspace
    }

    /// Whether a protective stop is active.
    #[must_use]
    pub fn is_protective_stop(&self) -> bool {
        self.is_stopped
    }

    /// From the next step on the arm decelerates to rest and ignores commands until [`Self::unlock`].
    pub fn protective_stop(&mut self) {
        self.is_stopped = true;
    }

    /// Ends a protective stop; without effect while the arm still moves.
    pub fn unlock(&mut self) {
        self.is_stopped &= self.qd_rad_per_s.amax() > 0.0;
    }

    /// One control period. A target that is not finite causes a protective stop.
    pub fn step(&mut self, command: Command) {
        if matches!(command, Command::Toward(at_m, turned) if !at_m.iter().chain(turned.coords.iter()).all(|value| value.is_finite()))
        {
            self.protective_stop();
        }
        let wanted = match command {
            Command::Toward(at_m, turned) if !self.is_stopped => self.approach(&at_m, &turned),
            _ => None,
        };
        let qd = wanted.filter(|qd| self.can_stop_after(qd)).unwrap_or_else(|| self.decelerated());
        self.q_rad += qd * STEP_S;
        self.qd_rad_per_s = qd;
    }

    /// Joint velocities of the next step toward a pose, within all limits.
    fn approach(&self, target_m: &Vector3<f64>, orientation: &UnitQuaternion<f64>) -> Option<Joints> {
        let pose = arm::forward(&self.q_rad);
        let way_m = target_m - pose.translation.vector;
        let speed = PLANNED * self.limits.tcp_m_per_s;
        let turn_rad = arm::rotation_between(&pose.rotation, orientation);
        let mut twist = Vector6::zeros();
        twist.fixed_rows_mut::<3>(0).copy_from(&(way_m * APPROACH_PER_S).cap_magnitude(speed));
        let turn = (turn_rad * TURN_PER_S).cap_magnitude(TURN_MAX_RAD_PER_S);
        twist.fixed_rows_mut::<3>(3).copy_from(&turn);
        let wanted = arm::joint_velocities(&self.q_rad, &twist);
        let fastest = wanted.amax() / (PLANNED * self.limits.joint_rad_per_s);
        self.changed_towards(&(wanted / fastest.max(1.0)))
    }

    /// The largest permitted change from the present joint velocities to the wanted ones.
    fn changed_towards(&self, wanted: &Joints) -> Option<Joints> {
        let difference = wanted - self.qd_rad_per_s;
        let (mut permitted, mut refused) = (None, 1.0);
        let at = |fraction: f64| self.qd_rad_per_s + difference * fraction;
        if self.is_within_limits(&at(1.0)) {
            return Some(at(1.0));
        }
        let mut low = 0.0;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + refused);
            if self.is_within_limits(&at(middle)) {
                (permitted, low) = (Some(at(middle)), middle);
            } else {
                refused = middle;
            }
        }
        permitted
    }

    fn is_within_limits(&self, qd: &Joints) -> bool {
        let limits = &self.limits;
        let velocity = arm::tcp_velocity(&(self.q_rad + qd * STEP_S), qd);
        qd.amax() <= PLANNED * limits.joint_rad_per_s
            && (qd - self.qd_rad_per_s).amax() <= PLANNED * limits.joint_rad_per_s2 * STEP_S
            && velocity.norm() <= PLANNED * limits.tcp_m_per_s
            && (velocity - self.tcp_m_per_s()).norm() <= PLANNED * limits.tcp_m_per_s2 * STEP_S
    }

    /// Time to rest from these velocities, s.
    fn stopping_s(&self, qd: &Joints, tcp_m_per_s: f64) -> f64 {
        let joints_s = qd.amax() / (PLANNED * self.limits.joint_rad_per_s2);
        joints_s.max(tcp_m_per_s / (PLANNED * self.limits.tcp_m_per_s2))
    }

    /// Whether the arm would come to rest inside the workspace if it stopped after a step with these velocities.
    fn can_stop_after(&self, qd: &Joints) -> bool {
        let q_rad = self.q_rad + qd * STEP_S;
        let velocity = arm::tcp_velocity(&q_rad, qd);
        let at_m = arm::forward(&q_rad).translation.vector;
        let rest_m = at_m + velocity * (0.5 * self.stopping_s(qd, velocity.norm()) + STEP_S);
        self.workspace.permits(&at_m) && self.workspace.permits(&rest_m)
    }

    /// Joint velocities of the next step of a stop.
    fn decelerated(&self) -> Joints {
        let rest_s = self.stopping_s(&self.qd_rad_per_s, self.tcp_m_per_s().norm());
        if rest_s <= STEP_S { Joints::zeros() } else { self.qd_rad_per_s * (1.0 - STEP_S / rest_s) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cobot::monitor::LimitMonitor;
    use crate::cobot::program::start_rad;
    use crate::random::Random;

    /// To a position, turned from the start about the base's Y axis, rad.
    fn toward(at_m: Vector3<f64>, turned_rad: f64) -> Command {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), turned_rad);
        Command::Toward(at_m, turn * arm::forward(&start_rad()).rotation)
    }

    fn motion() -> Motion {
        Motion::new(start_rad(), Limits::default(), Workspace::default()).unwrap()
    }

    #[test]
    fn no_limit_is_exceeded_in_an_hour_of_random_commands() {
        let mut random = Random::new(1, "cobot");
        let (mut motion, mut command) = (motion(), Command::Stop);
        let mut monitor = LimitMonitor::new(&motion, Limits::default());
        for _ in 0..3_600 * 500 {
            if random.happens(0.01) {
                // A third are outside the workspace, some by metres.
                let span = if random.happens(0.1) { 10.0 } else { 0.7 };
                let at_m =
                    Vector3::from_fn(|_, _| random.between(-span, span)) + Vector3::new(-0.65, 0.0, 0.35);
                command = if random.happens(0.2) { Command::Stop } else { toward(at_m, 1.0) };
            }
            if random.happens(0.0005) {
                motion.protective_stop();
            }
            if random.happens(0.01) {
                motion.unlock();
            }
            motion.step(command);
            monitor.observe(&motion);
        }
        assert_eq!(monitor.exceeded(), 0);
        // The test is one of the limits only if the motion uses them.
        assert!(monitor.largest().iter().all(|used| *used > 0.6), "{:?}", monitor.largest());
    }

    #[test]
    fn the_tcp_arrives_and_turns_to_its_orientation() {
        let mut motion = motion();
        let turned = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -0.5) * motion.orientation();
        for target in [[-0.7, 0.2, 0.3], [-0.5, -0.3, 0.5], [-0.8, 0.0, 0.1]] {
            let target_m = Vector3::from(target);
            for _ in 0..6 * 500 {
                motion.step(toward(target_m, -0.5));
            }
            assert!((motion.tcp_m() - target_m).norm() < 0.001, "{} of {target_m}", motion.tcp_m());
            assert!(motion.orientation().angle_to(&turned) < 0.01);
        }
    }

    #[test]
    fn every_stop_ends_within_50_ms() {
        let mut random = Random::new(2, "cobot");
        let mut motion = motion();
        for _ in 0..1000 {
            let low = motion.workspace.low_m;
            let size = motion.workspace.high_m - low;
            let at_m = low + Vector3::from_fn(|axis, _| random.unit() * size[axis]);
            for _ in 0..(random.unit() * 500.0) as u32 {
                motion.step(toward(at_m, 0.0));
            }
            (0..25).for_each(|_| motion.step(Command::Stop));
            assert_eq!(motion.qd_rad_per_s, Joints::zeros());
        }
    }

    #[test]
    fn a_protective_stop_ignores_commands_until_it_is_unlocked() {
        let (mut motion, to) = (motion(), toward(Vector3::new(-0.7, 0.2, 0.3), 0.0));
        (0..100).for_each(|_| motion.step(to));
        motion.step(toward(Vector3::new(f64::NAN, 0.0, 0.0), 0.0));
        motion.unlock();
        assert!(motion.is_protective_stop(), "it still moves");
        (0..100).for_each(|_| motion.step(to));
        assert_eq!(motion.tcp_m_per_s(), Vector3::zeros());
        motion.unlock();
        (0..100).for_each(|_| motion.step(to));
        assert!(motion.tcp_m_per_s().norm() > 0.1);
    }
}
