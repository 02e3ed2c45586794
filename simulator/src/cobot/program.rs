//! The on-robot program of `clients/ur/handover.script`, on the simulated arm: input registers in, motion out.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::arm::{self, Joints};
use super::motion::{Command, Limits, Motion, OutsideWorkspace, STEP_S, Workspace};

/// Without a change of the sequence for this long the program holds, s.
pub const STALE_S: f64 = 0.06;
/// After an interruption it moves only when the sequence has changed for this long, s.
pub const SETTLED_S: f64 = 0.4;
/// Range of the slope of the handles, rad.
pub const SLOPE_MAX_RAD: f64 = 1.2;
/// Range of the heading of the handles about that of the level handles, rad.
pub const HEADING_MAX_RAD: f64 = 1.5;
/// Number of the first register: int 36 and 37, double 36 to 38, as inputs and as outputs, and double 39
/// and 40 as inputs.
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
    /// Target of their heading, rad: that of the worker's feet, from the station's X axis about Z. The grips lie on the
    /// station's Y axis turned by it, and slope about that axis.
    pub heading_rad: f64,
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
    /// Holds: the target is outside the workspace, or slope or heading outside its range.
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
    /// Heading of a worker who faces the level handles, rad.
    pub level_heading_rad: f64,
    /// Limits of the motion.
    pub limits: Limits,
    /// Permitted positions, base frame.
    pub workspace: Workspace,
}

impl CobotSettings {
    /// With the base at a position of the station's world, m, turned about the vertical, rad. Its −X axis points to the
    /// worker.
    #[must_use]
    pub fn at(base_m: [f64; 3], yaw_rad: f64) -> CobotSettings {
        let at = Translation3::from(Vector3::from(base_m));
        let world_from_base = Isometry3::from_parts(at, about_z(yaw_rad));
        let retreat_m = (world_from_base * Translation3::from(RETREAT_IN_BASE_M)).translation.vector;
        let (limits, workspace) = Default::default();
        CobotSettings { world_from_base, retreat_m, level_heading_rad: yaw_rad, limits, workspace }
    }

    /// Whether the TCP may be at a position of the station's world, m.
    #[must_use]
    pub fn permits(&self, at_m: &Vector3<f64>) -> bool {
        self.workspace.permits(&base_position(self, at_m))
    }

    /// Slope of the handles with these joint angles, rad.
    #[must_use]
    pub fn slope_rad(&self, q_rad: &Joints) -> f64 {
        let along = self.world_from_handles(&arm::forward(q_rad).rotation) * Vector3::x();
        -along.z.clamp(-1.0, 1.0).asin()
    }

    /// Heading of the handles with these joint angles, rad.
    #[must_use]
    pub fn heading_rad(&self, q_rad: &Joints) -> f64 {
        let aside = self.world_from_handles(&arm::forward(q_rad).rotation) * Vector3::y();
        (-aside.x).atan2(aside.y)
    }

    /// Orientation of the handles with this one of the TCP in the base: X along hands that follow them, Y from the right
    /// to the left grip.
    fn world_from_handles(&self, base_from_tcp: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        self.world_from_base.rotation * base_from_tcp * self.tcp_from_handles()
    }

    /// Orientation of the handles in the TCP, as at the start: level, and facing a worker of the heading for that.
    fn tcp_from_handles(&self) -> UnitQuaternion<f64> {
        let world_from_tcp = self.world_from_base.rotation * arm::forward(&start_rad()).rotation;
        world_from_tcp.inverse() * about_z(self.level_heading_rad)
    }

    /// Orientation of the TCP in the base with this slope and heading of the handles.
    fn base_from_tcp(&self, slope_rad: f64, heading_rad: f64) -> UnitQuaternion<f64> {
        let world_from_handles =
            about_z(heading_rad) * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), slope_rad);
        self.world_from_base.rotation.inverse() * world_from_handles * self.tcp_from_handles().inverse()
    }

    /// Whether slope and heading of the handles are in their ranges; false for values that are not finite, too.
    fn permits_turn(&self, slope_rad: f64, heading_rad: f64) -> bool {
        let (sin, cos) = (heading_rad - self.level_heading_rad).sin_cos();
        slope_rad.abs() <= SLOPE_MAX_RAD && sin.atan2(cos).abs() <= HEADING_MAX_RAD
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
        let settings = &self.settings;
        let (activity, target_m, slope_rad, heading_rad) = match inputs.command {
            1 => (Activity::Move, inputs.target_m.into(), inputs.slope_rad, inputs.heading_rad),
            2 => (Activity::Retreat, settings.retreat_m, 0.0, settings.level_heading_rad),
            _ => return (Activity::Hold, Command::Stop),
        };
        let target_m = base_position(settings, &target_m);
        let is_finite = target_m.iter().all(|value| value.is_finite());
        let is_permitted = is_finite && self.motion.workspace().permits(&target_m);
        if !is_permitted || !settings.permits_turn(slope_rad, heading_rad) {
            return (Activity::Unreachable, Command::Stop);
        }
        (activity, Command::Toward(target_m, settings.base_from_tcp(slope_rad, heading_rad)))
    }

    /// Slope of the handles, rad.
    #[must_use]
    pub fn slope_rad(&self) -> f64 {
        self.settings.slope_rad(&self.motion.q_rad())
    }

    /// Heading of the handles, rad.
    #[must_use]
    pub fn heading_rad(&self) -> f64 {
        self.settings.heading_rad(&self.motion.q_rad())
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

fn about_z(rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), rad)
}

fn base_position(settings: &CobotSettings, world_m: &Vector3<f64>) -> Vector3<f64> {
    settings.world_from_base.inverse_transform_point(&(*world_m).into()).coords
}

#[cfg(test)]
mod tests {
    use super::*;

    const TARGET_M: [f64; 3] = [0.45, 0.1, 1.1];
    const CLIENTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../clients");

    fn inputs(target_m: [f64; 3]) -> Inputs {
        Inputs { command: 1, target_m, ..Inputs::default() }
    }

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
        let mut inputs = Inputs { sequence: 77, ..inputs(TARGET_M) };
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
    fn it_holds_for_a_target_outside_or_one_that_is_not_finite() {
        let mut program = Program::new(CobotSettings::default()).unwrap();
        let mut inputs = inputs([0.0, 0.0, 1.0]);
        run(&mut program, &mut inputs, 1.0, true);
        assert_eq!((program.activity(), speed(&program)), (Activity::Unreachable, 0.0));
        inputs.target_m[2] = f64::INFINITY;
        run(&mut program, &mut inputs, 0.1, true);
        assert_eq!((program.activity(), speed(&program)), (Activity::Unreachable, 0.0));
    }

    #[test]
    fn its_constants_are_those_of_the_script() {
        let script = std::fs::read_to_string(format!("{CLIENTS}/ur/handover.script")).unwrap();
        let value_of = |name: &str| -> f64 {
            let start = format!("{name} = ");
            let mut values = script.lines().filter_map(|line| line.trim().strip_prefix(&start));
            let value = values.next().unwrap_or_else(|| panic!("{name}")).parse().unwrap();
            assert_eq!(values.next(), None, "{name}");
            value
        };
        for (name, value) in [
            ("HANDOVER_STALE_S", STALE_S),
            ("HANDOVER_SETTLED_S", SETTLED_S),
            ("HANDOVER_SLOPE_MAX_RAD", SLOPE_MAX_RAD),
            ("HANDOVER_HEADING_MAX_RAD", HEADING_MAX_RAD),
            ("HANDOVER_LEVEL_HEADING_RAD", CobotSettings::default().level_heading_rad),
            ("HANDOVER_SPEED_M_PER_S", Limits::default().tcp_m_per_s),
            ("HANDOVER_ACCELERATION_M_PER_S2", Limits::default().tcp_m_per_s2),
        ] {
            assert_eq!(value_of(name), value, "{name}");
        }
    }

    /// `.ci/cobot.py` compares the script with the same vectors.
    #[test]
    fn the_handles_turn_to_the_worker_as_in_the_test_vectors() {
        let table = std::fs::read_to_string(format!("{CLIENTS}/handover_vectors.txt")).unwrap();
        let numbers = |words: &str| -> Vec<f64> {
            words.split([' ', ',']).map(|word| word.parse().unwrap_or_else(|_| panic!("{words}"))).collect()
        };
        let mut count = 0;
        for line in table.lines().filter_map(|line| line.strip_prefix("turn ")) {
            let (given, expected) = line.split_once(" => ").unwrap();
            let [slope_rad, heading_rad, level_heading_rad] = numbers(given)[..] else { panic!("{line}") };
            let settings = CobotSettings { level_heading_rad, ..CobotSettings::default() };
            let mut program = Program::new(settings).unwrap();
            let begun = program.motion().q_rad();
            run(&mut program, &mut Inputs { slope_rad, heading_rad, ..inputs(TARGET_M) }, 12.0, true);
            count += 1;
            if expected == "outside" {
                assert_eq!(program.activity(), Activity::Unreachable, "{line}");
                assert_eq!(program.motion().q_rad(), begun, "{line}");
                continue;
            }
            let turn = program.motion().orientation() * arm::forward(&begun).rotation.inverse();
            let world_from_handles = turn * about_z(level_heading_rad);
            let found = [Vector3::x(), Vector3::y()].map(|axis| world_from_handles * axis);
            let off = found.iter().flat_map(Vector3::iter).zip(numbers(expected)).map(|(a, b)| (a - b).abs());
            assert!(off.fold(0.0, f64::max) < 1e-3, "{found:?} for {line}");
            assert!((program.slope_rad() - slope_rad).abs() < 1e-3, "{line}");
            let off_rad = program.heading_rad() - heading_rad;
            assert!(off_rad.sin().abs() < 1e-3 && off_rad.cos() > 0.0, "{line}");
        }
        assert!(count >= 9, "only {count} turns");
    }

    #[test]
    fn the_level_handles_of_a_turned_base_face_the_worker_in_front_of_it() {
        let settings = CobotSettings::at([0.0, 1.15, 0.75], FRAC_PI_2);
        let mut program = Program::new(settings).unwrap();
        assert!((program.heading_rad() - FRAC_PI_2).abs() < 1e-3 && program.slope_rad().abs() < 1e-3);
        let mut inputs = Inputs { slope_rad: 0.5, heading_rad: FRAC_PI_2, ..inputs([-0.1, 0.45, 1.1]) };
        run(&mut program, &mut inputs, 12.0, true);
        assert_eq!(program.activity(), Activity::Move);
        let along = settings.world_from_base.rotation
            * (program.motion().orientation() * arm::forward(&start_rad()).rotation.inverse())
            * Vector3::x();
        let expected = Vector3::new(0.0, 0.5_f64.cos(), -0.5_f64.sin());
        assert!((along - expected).norm() < 1e-3, "{along}");
        inputs.heading_rad = -0.1;
        run(&mut program, &mut inputs, 0.1, true);
        assert_eq!(program.activity(), Activity::Unreachable);
    }

    #[test]
    fn equal_inputs_give_equal_motion() {
        let run = || {
            let mut program = Program::new(CobotSettings::default()).unwrap();
            run(&mut program, &mut inputs(TARGET_M), 2.0, true);
            program
        };
        assert_eq!(run(), run());
    }
}
