//! Observes the limits of a moving arm from outside: by differences of positions, not by the motion's own velocities.

use nalgebra::Vector3;

use super::arm::Joints;
use super::motion::{Limits, Motion, STEP_S};

/// Counts the steps that exceed a limit.
#[derive(Debug, Clone, PartialEq)]
pub struct LimitMonitor {
    limits: Limits,
    q_rad: [Joints; 3],
    tcp_m: [Vector3<f64>; 3],
    exceeded: u64,
    largest: [f64; 4],
}

impl LimitMonitor {
    /// An observer of these limits and of the arm's workspace, from the present position of an arm at rest on.
    #[must_use]
    pub fn new(motion: &Motion, limits: Limits) -> LimitMonitor {
        let (q_rad, tcp_m) = ([motion.q_rad(); 3], [motion.tcp_m(); 3]);
        LimitMonitor { limits, q_rad, tcp_m, exceeded: 0, largest: [0.0; 4] }
    }

    /// Adds the position after one more step.
    pub fn observe(&mut self, motion: &Motion) {
        self.q_rad = [self.q_rad[1], self.q_rad[2], motion.q_rad()];
        self.tcp_m = [self.tcp_m[1], self.tcp_m[2], motion.tcp_m()];
        let [a, b, c] = self.q_rad;
        let [d, e, f] = self.tcp_m;
        let used = [
            (c - b).amax() / STEP_S / self.limits.joint_rad_per_s,
            (a - b * 2.0 + c).amax() / (STEP_S * STEP_S) / self.limits.joint_rad_per_s2,
            (f - e).norm() / STEP_S / self.limits.tcp_m_per_s,
            (d - e * 2.0 + f).norm() / (STEP_S * STEP_S) / self.limits.tcp_m_per_s2,
        ];
        let is_inside = motion.workspace().margin_m(&f) > 0.0;
        self.exceeded += u64::from(!is_inside || used.iter().any(|used| *used > 1.0));
        for (largest, used) in self.largest.iter_mut().zip(used) {
            *largest = largest.max(used);
        }
    }

    /// Number of steps that exceeded a limit or ended outside the workspace.
    #[must_use]
    pub fn exceeded(&self) -> u64 {
        self.exceeded
    }

    /// Largest value over its limit: velocity and acceleration of the joints, then of the TCP.
    #[must_use]
    pub fn largest(&self) -> [f64; 4] {
        self.largest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cobot::motion::{Command, Workspace};
    use crate::cobot::program::start_rad;

    #[test]
    fn only_a_motion_beyond_the_observed_limits_is_counted() {
        let limits = Limits::default();
        let observed = |of_tcp: f64| {
            let mut motion = Motion::new(start_rad(), limits, Workspace::default()).unwrap();
            let limits = Limits { tcp_m_per_s: of_tcp * limits.tcp_m_per_s, ..limits };
            let mut monitor = LimitMonitor::new(&motion, limits);
            for _ in 0..500 {
                let turned = motion.orientation();
                motion.step(Command::Toward(Vector3::new(-0.7, 0.2, 0.3), turned));
                monitor.observe(&motion);
            }
            monitor
        };
        assert_eq!(observed(1.0).exceeded(), 0);
        let slower = observed(0.5);
        assert!(slower.exceeded() > 100 && slower.largest()[2] > 1.5, "{slower:?}");
    }
}
