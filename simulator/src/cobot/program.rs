//! The on-robot program of `clients/ur/handover.script`, on the simulated arm: input registers in, motion out.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};

use super::arm::{self, Joints};
use super::motion::{Command, Limits, Motion, OutsideWorkspace, STEP_S, Workspace};

/// Without a change of the sequence for this long the program holds, s.
pub const STALE_S: f64 = 0.06;
/// After an interruption it moves only when the sequence has changed for this long, s.
pub const SETTLED_S: f64 = 0.2;
/// Number of the first register: int 36 and 37, double 36 to 38, as inputs and as outputs, and double 39 as an input.
pub const FIRST_REGISTER: u8 = 36;

/// Default retreat position, base frame, m.
const RETREAT_IN_BASE_M: Vector3<f64> = Vector3::new(-0.45, -0.174, 0.4);

/// Values of the input registers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Inputs {
    /// 1: move, 2: retreat, otherwise hold.
    pub command: i32,
    /// Changes with each package of the controller.
    pub sequence: i32,
    /// Target of the TCP in the station's world, m.
    pub target_m: [f64; 3],
    /// Target of the slope of the part's handles, rad: how far hands that follow them point below the horizontal; 0 at
    /// the start.
    pub slope_rad: f64,
}

/// What the program does, as its output register 36.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(i32)]
pub enum Activity {
    /// Holds as commanded.
    Hold = 0,
    /// Moves to the target.
    Move = 1,
    /// Moves to the retreat position.
    Retreat = 2,
    /// Holds: the target is outside the workspace.
    Unreachable = 3,
    /// Holds: the sequence does not change, or has not changed for long enough.
    NoHeartbeat = 4,
    /// Protective stop.
    Protective = 5,
}

/// Pose and limits of a cobot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CobotSettings {
    /// The robot's base in the station's world.
    pub world_from_base: Isometry3<f64>,
    /// Retreat position and start of the TCP in the station's world, m.
    pub retreat_m: Vector3<f64>,
    /// Limits of the motion.
    pub limits: Limits,
    /// Permitted positions, base frame.
    pub workspace: Workspace,
}

impl CobotSettings {
    /// With the base at a position of the station's world, m, turned about the vertical, rad.
    #[must_use]
    pub fn at(base_m: [f64; 3], yaw_rad: f64) -> CobotSettings {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
        let world_from_base = Isometry3::from_parts(Translation3::from(Vector3::from(base_m)), turn);
        let retreat_m = (world_from_base * Translation3::from(RETREAT_IN_BASE_M)).translation.vector;
        let (limits, workspace) = Default::default();
        CobotSettings { world_from_base, retreat_m, limits, workspace }
    }

    /// Whether the TCP may be at a position of the station's world, m.
    #[must_use]
    pub fn permits(&self, at_m: &Vector3<f64>) -> bool {
        self.workspace.permits(&base_position(self, at_m))
    }

    /// Slope of the handles with these joint angles, rad.
    #[must_use]
    pub fn slope_rad(&self, q_rad: &Joints) -> f64 {
        let turn = arm::forward(q_rad).rotation * arm::forward(&start_rad()).rotation.inverse();
        turn.scaled_axis().dot(&self.aside())
    }

    /// Direction to the left of the worker, who faces the world's X axis, base.
    fn aside(&self) -> Unit<Vector3<f64>> {
        self.world_from_base.rotation.inverse() * Vector3::y_axis()
    }
}

impl Default for CobotSettings {
    /// On a table of 0.75 m, 1.15 m in front of the middle of the plate; its −X axis points to the worker.
    fn default() -> CobotSettings {
        CobotSettings::at([1.15, 0.0, 0.75], 0.0)
    }
}

/// Joint angles at the start: elbow up, flange horizontally toward −X.
#[must_use]
pub fn start_rad() -> Joints {
    let (shoulder, elbow) = (-1.0, 2.0);
    Joints::new(0.0, shoulder, elbow, -PI - shoulder - elbow, -FRAC_PI_2, 0.0)
}

/// The program and its arm.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    settings: CobotSettings,
    motion: Motion,
    steps: u64,
    /// Sequence of the last step; `None` before the first.
    sequence: Option<i32>,
    still_s: f64,
    changing_s: f64,
    activity: Activity,
}

impl Program {
    /// The program at its start, with the arm at rest at the retreat position.
    ///
    /// # Errors
    /// [`OutsideWorkspace`] if that position is outside the workspace or the arm cannot reach it.
    pub fn new(settings: CobotSettings) -> Result<Program, OutsideWorkspace> {
        let start = arm::forward(&start_rad());
        let at = Translation3::from(base_position(&settings, &settings.retreat_m));
        let pose = Isometry3::from_parts(at, start.rotation);
        let q_rad = arm::inverse(&start_rad(), &pose).ok_or(OutsideWorkspace)?;
        let motion = Motion::new(q_rad, settings.limits, settings.workspace)?;
        Ok(Program {
            settings,
            motion,
            steps: 0,
            sequence: None,
            still_s: f64::INFINITY,
            changing_s: 0.0,
            activity: Activity::NoHeartbeat,
        })
    }

    /// One control period.
    pub fn step(&mut self, inputs: &Inputs) {
        self.watch(inputs.sequence);
        let (activity, command) = self.decide(inputs);
        self.motion.step(command);
        self.activity = if self.motion.is_protective_stop() { Activity::Protective } else { activity };
        self.steps += 1;
    }

    /// Measures how long the sequence has been unchanged, and how long it has changed without an interruption. The value
    /// at the start may be of an earlier controller.
    fn watch(&mut self, sequence: i32) {
        let has_changed = self.sequence.is_some_and(|before| before != sequence);
        self.sequence = Some(sequence);
        self.still_s = if has_changed { 0.0 } else { self.still_s + STEP_S };
        self.changing_s = if self.still_s > STALE_S { 0.0 } else { self.changing_s + STEP_S };
    }

    fn decide(&self, inputs: &Inputs) -> (Activity, Command) {
        if self.changing_s < SETTLED_S {
            return (Activity::NoHeartbeat, Command::Stop);
        }
        let (activity, target_m, slope_rad) = match inputs.command {
            1 => (Activity::Move, Vector3::from(inputs.target_m), inputs.slope_rad),
            2 => (Activity::Retreat, self.settings.retreat_m, 0.0),
            _ => return (Activity::Hold, Command::Stop),
        };
        let target_m = base_position(&self.settings, &target_m);
        if target_m.iter().all(|value| value.is_finite()) && !self.motion.workspace().permits(&target_m) {
            return (Activity::Unreachable, Command::Stop);
        }
        (activity, Command::Toward(target_m, self.sloped(slope_rad)))
    }

    /// Orientation of the TCP with this slope of the handles, base: the side of the part away from the worker goes down.
    fn sloped(&self, slope_rad: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&self.settings.aside(), slope_rad)
            * arm::forward(&start_rad()).rotation
    }

    /// Slope of the handles, rad.
    #[must_use]
    pub fn slope_rad(&self) -> f64 {
        self.settings.slope_rad(&self.motion.q_rad())
    }

    /// The arm.
    #[must_use]
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// The arm, for a protective stop and its end.
    pub fn motion_mut(&mut self) -> &mut Motion {
        &mut self.motion
    }

    /// What the program does.
    #[must_use]
    pub fn activity(&self) -> Activity {
        self.activity
    }

    /// Time since the start, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.steps as f64 * STEP_S
    }

    /// Sequence that the last step used; 0 before the first.
    #[must_use]
    pub fn sequence(&self) -> i32 {
        self.sequence.unwrap_or(0)
    }

    /// Position of the TCP in the station's world, m.
    #[must_use]
    pub fn tcp_in_world_m(&self) -> Vector3<f64> {
        (self.settings.world_from_base * Translation3::from(self.motion.tcp_m())).translation.vector
    }
}

fn base_position(settings: &CobotSettings, world_m: &Vector3<f64>) -> Vector3<f64> {
    settings.world_from_base.inverse_transform_point(&(*world_m).into()).coords
}

#[cfg(test)]
mod tests {
    use super::*;

    const TARGET_M: [f64; 3] = [0.45, 0.1, 1.1];

    /// Runs for a time; the sequence changes every 8 ms if `is_alive`.
    fn run(program: &mut Program, inputs: &mut Inputs, seconds: f64, is_alive: bool) {
        for step in 0..(seconds / STEP_S).round() as u32 {
            inputs.sequence += i32::from(is_alive && step.is_multiple_of(4));
            program.step(inputs);
        }
    }

    fn speed(program: &Program) -> f64 {
        program.motion().tcp_m_per_s().norm()
    }

    #[test]
    fn it_moves_to_the_target_and_back_only_while_the_sequence_changes() {
        let mut program = Program::new(CobotSettings::default()).unwrap();
        let start_m = program.tcp_in_world_m();
        let mut inputs = Inputs { command: 1, sequence: 77, target_m: TARGET_M, slope_rad: 0.0 };
        run(&mut program, &mut inputs, 1.0, false);
        assert_eq!((program.activity(), speed(&program)), (Activity::NoHeartbeat, 0.0));
        run(&mut program, &mut inputs, SETTLED_S - 0.02, true);
        assert_eq!(speed(&program), 0.0);
        run(&mut program, &mut inputs, 0.5, true);
        assert_eq!(program.activity(), Activity::Move);
        assert!(speed(&program) > 0.1, "{}", speed(&program));
        run(&mut program, &mut inputs, STALE_S + 0.05, false);
        assert_eq!((program.activity(), speed(&program)), (Activity::NoHeartbeat, 0.0));
        run(&mut program, &mut inputs, 8.0, true);
        assert!((program.tcp_in_world_m() - Vector3::from(TARGET_M)).norm() < 0.001);
        inputs.command = 2;
        run(&mut program, &mut inputs, 8.0, true);
        assert_eq!(program.activity(), Activity::Retreat);
        assert!((program.tcp_in_world_m() - start_m).norm() < 0.001);
        inputs.command = 0;
        run(&mut program, &mut inputs, 0.1, true);
        assert_eq!(program.activity(), Activity::Hold);
    }

    #[test]
    fn it_holds_for_a_target_outside_and_stops_for_one_that_is_not_finite() {
        let mut program = Program::new(CobotSettings::default()).unwrap();
        let mut inputs = Inputs { command: 1, sequence: 0, target_m: [0.0, 0.0, 1.0], slope_rad: 0.0 };
        run(&mut program, &mut inputs, 1.0, true);
        assert_eq!((program.activity(), speed(&program)), (Activity::Unreachable, 0.0));
        inputs.target_m[2] = f64::INFINITY;
        run(&mut program, &mut inputs, 0.1, true);
        assert_eq!((program.activity(), speed(&program)), (Activity::Protective, 0.0));
    }

    #[test]
    fn equal_inputs_give_equal_motion() {
        let run = || {
            let mut program = Program::new(CobotSettings::default()).unwrap();
            run(
                &mut program,
                &mut Inputs { command: 1, sequence: 0, target_m: TARGET_M, slope_rad: 0.0 },
                2.0,
                true,
            );
            program
        };
        assert_eq!(run(), run());
    }
}
