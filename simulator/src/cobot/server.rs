//! A simulated cobot live: the program steps at 500 Hz of CLOCK_MONOTONIC, and RTDE clients write its registers.

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::Vector3;

use super::arm;
use super::motion::STEP_S;
use super::program::{Activity, CobotSettings, FIRST_REGISTER, Inputs, Program};
use super::rtde::{self, Controller, Outputs, Value};
use crate::clock::{monotonic_ns, sleep_until_ns, span_ns};
use crate::threads::Threads;

/// Motion of a running cobot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Snapshot {
    /// What its program does.
    pub activity: Activity,
    /// Position of the TCP in the station's world, m.
    pub tcp_m: Vector3<f64>,
    /// Speed of the TCP, m/s.
    pub tcp_m_per_s: f64,
    /// Sequence that the program used last.
    pub sequence: i32,
}

impl Snapshot {
    fn of(program: &Program) -> Snapshot {
        Snapshot {
            activity: program.activity(),
            tcp_m: program.tcp_in_world_m(),
            tcp_m_per_s: program.motion().tcp_m_per_s().norm(),
            sequence: program.sequence(),
        }
    }
}

/// A running cobot. Dropping it stops its motion; RTDE connections remain until the process ends.
#[derive(Debug)]
pub struct Cobot {
    address: SocketAddr,
    controller: Arc<Controller>,
    program: Arc<Mutex<Program>>,
    threads: Threads<()>,
}

impl Cobot {
    /// Starts the arm and its RTDE server.
    ///
    /// # Errors
    /// Those of the socket; `InvalidInput` for a retreat position outside the workspace.
    pub fn start(settings: CobotSettings, address: SocketAddr) -> io::Result<Cobot> {
        let program =
            Program::new(settings).map_err(|error| io::Error::new(io::ErrorKind::InvalidInput, error))?;
        let listener = TcpListener::bind(address)?;
        let address = listener.local_addr()?;
        let controller = Arc::new(Controller::default());
        controller.set_outputs(outputs(&program));
        let program = Arc::new(Mutex::new(program));
        let mut threads = Threads::new();
        let (stepped, registers) = (Arc::clone(&program), Arc::clone(&controller));
        threads.spawn("sim-cobot", move |stop| {
            run(&stepped, &registers, stop);
            Ok(())
        })?;
        rtde::serve(Arc::clone(&controller), listener);
        Ok(Cobot { address, controller, program, threads })
    }

    /// Address of the RTDE server.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The RTDE server.
    pub fn controller(&self) -> &Arc<Controller> {
        &self.controller
    }

    /// Present motion.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot::of(&self.program.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Stops the arm's thread.
    ///
    /// # Errors
    /// None at present; those of the thread.
    pub fn stop(mut self) -> io::Result<()> {
        self.threads.stop().map(drop)
    }
}

/// Steps at absolute times; late steps follow at once, so that simulated time keeps up with the clock.
fn run(program: &Mutex<Program>, controller: &Controller, stop: &AtomicBool) {
    let (start_ns, mut step) = (monotonic_ns(), 0_u64);
    while !stop.load(Ordering::Relaxed) {
        sleep_until_ns(start_ns + step * span_ns(STEP_S));
        let inputs = inputs(controller);
        let mut program = program.lock().unwrap_or_else(PoisonError::into_inner);
        program.step(&inputs);
        controller.set_outputs(outputs(&program));
        step += 1;
    }
}

fn inputs(controller: &Controller) -> Inputs {
    let registers = controller.inputs.lock().unwrap_or_else(PoisonError::into_inner);
    let value = |kind: &str, offset: u8| {
        registers.get(&format!("input_{kind}_register_{}", FIRST_REGISTER + offset)).copied().unwrap_or(0.0)
    };
    Inputs {
        command: value("int", 0) as i32,
        sequence: value("int", 1) as i32,
        target_m: [0, 1, 2].map(|axis| value("double", axis)),
        slope_rad: value("double", 3),
        heading_rad: value("double", 4),
    }
}

/// Numbers of the RTDE guide: robot mode "running", runtime state "playing".
const ROBOT_RUNNING: i32 = 7;
const PROGRAM_PLAYING: u32 = 2;
/// Safety mode "normal" and "protective stop".
const SAFETY_NORMAL: i32 = 1;
const SAFETY_PROTECTIVE_STOP: i32 = 3;

fn outputs(program: &Program) -> Outputs {
    let motion = program.motion();
    let (q_rad, qd) = (motion.q_rad(), motion.qd_rad_per_s());
    let pose = arm::pose_vector(&arm::forward(&q_rad));
    let speed = arm::jacobian(&q_rad) * qd;
    let safety = if motion.is_protective_stop() { SAFETY_PROTECTIVE_STOP } else { SAFETY_NORMAL };
    let world_m = program.tcp_in_world_m();
    let mut outputs: Outputs = [
        ("timestamp", Value::Double(program.time_s())),
        ("robot_mode", Value::Int(ROBOT_RUNNING)),
        ("runtime_state", Value::Unsigned(PROGRAM_PLAYING)),
        ("safety_mode", Value::Int(safety)),
        ("safety_status", Value::Int(safety)),
    ]
    .map(|(name, value)| (name.to_owned(), value))
    .into();
    // The simulated arm follows its targets without error.
    for prefix in ["actual", "target"] {
        for (name, vector) in
            [("q", q_rad.into()), ("qd", qd.into()), ("TCP_pose", pose), ("TCP_speed", speed.into())]
        {
            outputs.insert(format!("{prefix}_{name}"), Value::Vector(vector));
        }
    }
    let int = |offset: u8| format!("output_int_register_{}", FIRST_REGISTER + offset);
    outputs.insert(int(0), Value::Int(program.activity() as i32));
    outputs.insert(int(1), Value::Int(program.sequence()));
    for (offset, value) in (0..).zip(world_m.iter()) {
        let name = format!("output_double_register_{}", FIRST_REGISTER + offset);
        outputs.insert(name, Value::Double(*value));
    }
    outputs
}
