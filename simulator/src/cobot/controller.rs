//! The motion rules of the reference controller (`clients/python/handover.py`), for closed loops in simulations: hold on
//! invalid states, and a commanded position that moves slowly. Its retreat and its choice of a plan are left out.

use nalgebra::Vector3;

use super::program::Inputs;

/// Motion begins after uninterrupted valid states of this duration, s.
pub const RESUME_AFTER_S: f64 = 0.5;
/// Speed of the commanded position, m/s.
pub const TARGET_M_PER_S: f64 = 0.1;

/// Where the part is to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Position, station's world, m.
    pub at_m: Vector3<f64>,
    /// Slope of the handles, rad ([`Inputs::slope_rad`]).
    pub slope_rad: f64,
    /// Heading of the handles, rad ([`Inputs::heading_rad`]).
    pub heading_rad: f64,
}

/// From the validity of the newest state to the input registers of the program.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Controller {
    valid_s: f64,
    /// The commanded position, station's world, m; `None` while the arm holds.
    sent_m: Option<Vector3<f64>>,
    sequence: i32,
}

impl Controller {
    /// The registers for the next `step_s`: toward the target if the states have been valid for long enough, otherwise
    /// hold. Without a target the arm holds. Positions are in the station's world, m.
    pub fn decide(
        &mut self,
        is_valid: bool,
        target: Option<Target>,
        tcp_m: Vector3<f64>,
        step_s: f64,
    ) -> Inputs {
        self.valid_s = if is_valid { self.valid_s + step_s } else { 0.0 };
        self.sequence = self.sequence % i32::MAX + 1;
        let target = target.filter(|_| self.valid_s >= RESUME_AFTER_S);
        self.sent_m = target.map(|Target { at_m: target_m, .. }| {
            let from_m = self.sent_m.unwrap_or(tcp_m);
            from_m + (target_m - from_m).cap_magnitude(TARGET_M_PER_S * step_s)
        });
        Inputs {
            command: i32::from(self.sent_m.is_some()),
            sequence: self.sequence,
            target_m: self.sent_m.unwrap_or(tcp_m).into(),
            slope_rad: target.map_or(0.0, |target| target.slope_rad),
            heading_rad: target.map_or(0.0, |target| target.heading_rad),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_holds_on_an_invalid_state_and_resumes_slowly_from_where_the_arm_is() {
        let (mut controller, step_s) = (Controller::default(), 0.01);
        let at_m = Vector3::new(0.5, 0.1, 1.2);
        let target_m = Some(Target { at_m: Vector3::new(0.5, 0.1, 0.9), slope_rad: 0.5, heading_rad: -0.3 });
        let mut decide = |is_valid, target_m| controller.decide(is_valid, target_m, at_m, step_s);
        let commands: Vec<i32> = (0..60).map(|_| decide(true, target_m).command).collect();
        assert_eq!(commands.iter().filter(|command| **command == 0).count(), 49);
        let sent = decide(true, target_m);
        assert!((sent.target_m[2] - (1.2 - 12.0 * TARGET_M_PER_S * step_s)).abs() < 1e-9, "{sent:?}");
        let held = decide(false, target_m);
        assert_eq!((held.command, held.target_m[2], held.sequence), (0, 1.2, sent.sequence + 1));
        assert_eq!(decide(true, target_m).command, 0);
        for _ in 0..60 {
            decide(true, target_m);
        }
        assert_eq!(decide(true, None).command, 0);
        for _ in 0..400 {
            decide(true, target_m);
        }
        let Inputs { target_m: at_m, slope_rad, heading_rad, .. } = decide(true, target_m);
        assert_eq!(Some(Target { at_m: at_m.into(), slope_rad, heading_rad }), target_m);
    }
}
