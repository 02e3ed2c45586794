//! Controller side of RTDE, protocol version 2, after Universal Robots' "Real-Time Data Exchange (RTDE) Guide";
//! independent of the gateway's encoder.
//!
//! Inputs: integer and double registers 0 to 47, and the outputs and slider of the guide's table. A register belongs to
//! the first client that sets it up, until that client disconnects: others get `IN_USE`. Other names get `NOT_FOUND`. As
//! on a real controller, no exchange starts without an output recipe. Without an arm the only output is `timestamp`.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A value of an output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// UINT32
    Unsigned(u32),
    /// INT32
    Int(i32),
    /// DOUBLE
    Double(f64),
    /// VECTOR6D
    Vector([f64; 6]),
}

impl Value {
    fn kind(self) -> &'static str {
        match self {
            Value::Unsigned(_) => "UINT32",
            Value::Int(_) => "INT32",
            Value::Double(_) => "DOUBLE",
            Value::Vector(_) => "VECTOR6D",
        }
    }

    fn write(self, bytes: &mut Vec<u8>) {
        match self {
            Value::Unsigned(value) => bytes.extend(value.to_be_bytes()),
            Value::Int(value) => bytes.extend(value.to_be_bytes()),
            Value::Double(value) => bytes.extend(value.to_be_bytes()),
            Value::Vector(values) => values.iter().for_each(|value| bytes.extend(value.to_be_bytes())),
        }
    }
}

/// Outputs by their RTDE names, of one instant.
pub type Outputs = BTreeMap<String, Value>;

/// Behaviour and contents of the simulated controller.
#[derive(Debug, Default)]
pub struct Controller {
    /// Values of the registers, integers included.
    pub inputs: Mutex<BTreeMap<String, f64>>,
    /// The client that owns each register.
    owners: Mutex<BTreeMap<String, u64>>,
    /// Outputs of the arm, replaced in each step.
    outputs: Mutex<Arc<Outputs>>,
    /// Data packages received.
    pub packages: AtomicU64,
    /// Connections so far.
    pub clients: AtomicU64,
    /// Supports protocol version 1 only.
    pub is_old: AtomicBool,
    /// After the start it reads nothing, and disconnects when this is reset.
    pub hangs: AtomicBool,
    /// Disconnects from a client that sends data.
    pub leaves: AtomicBool,
    /// Refuses to start.
    pub refuses_start: AtomicBool,
    /// Reads, but sends no data.
    pub is_mute: AtomicBool,
    /// Data packages sent.
    pub packages_sent: AtomicU64,
}

impl Controller {
    /// Value of an input register; 0 while no client has written it.
    pub fn input(&self, name: &str) -> f64 {
        lock(&self.inputs).get(name).copied().unwrap_or(0.0)
    }

    /// Replaces the outputs. Their names and types stay the same.
    pub fn set_outputs(&self, outputs: Outputs) {
        *lock(&self.outputs) = Arc::new(outputs);
    }

    /// Present value of an output. Input registers are outputs too.
    fn output(&self, name: &str) -> Option<Value> {
        if name.starts_with("input_") {
            return match kind_of(name) {
                "INT32" => Some(Value::Int(self.input(name) as i32)),
                "DOUBLE" => Some(Value::Double(self.input(name))),
                _ => None,
            };
        }
        if let Some(value) = lock(&self.outputs).get(name) {
            return Some(*value);
        }
        match name {
            "timestamp" => Some(Value::Double(0.0)),
            _ if kind_of(&name.replacen("output_", "input_", 1)) == "INT32" => Some(Value::Int(0)),
            _ if kind_of(&name.replacen("output_", "input_", 1)) == "DOUBLE"
                && name.contains("_register_") =>
            {
                Some(Value::Double(0.0))
            }
            _ => None,
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A panicked thread cannot have left a value partly written.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Serves in the background until the process ends.
pub fn serve(controller: Arc<Controller>, listener: TcpListener) {
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let controller = Arc::clone(&controller);
            std::thread::spawn(move || {
                let client = controller.clients.fetch_add(1, Ordering::SeqCst) + 1;
                let mut session =
                    Session { controller: &controller, client, recipes: Vec::new(), output: None };
                let closing = stream.try_clone();
                session.run(stream);
                // The sending thread has a handle of its own, so the socket is shut down explicitly.
                let _gone = closing.and_then(|stream| stream.shutdown(Shutdown::Both));
                lock(&controller.owners).retain(|_, owner| *owner != client);
            });
        }
    });
}

/// Starts a controller without an arm on a free loopback port.
///
/// # Errors
/// Those of the socket.
pub fn start() -> std::io::Result<(Arc<Controller>, SocketAddr)> {
    let controller = Arc::new(Controller::default());
    let listener = TcpListener::bind("127.0.0.1:0")?;
    let address = listener.local_addr()?;
    serve(Arc::clone(&controller), listener);
    Ok((controller, address))
}

/// One client's connection.
struct Session<'a> {
    controller: &'a Arc<Controller>,
    client: u64,
    recipes: Vec<Vec<String>>,
    /// Rate and names of the output recipe, once it is set up.
    output: Option<(f64, Vec<String>)>,
}

/// Type of an input, or `NOT_FOUND`: the guide's table without its bit registers.
fn kind_of(name: &str) -> &'static str {
    let number = |prefix: &str| name.strip_prefix(prefix).and_then(|number| number.parse::<u8>().ok());
    let exists = |number: Option<u8>| number.is_some_and(|number| number < 48);
    match name {
        "speed_slider_mask" => "UINT32",
        "speed_slider_fraction" | "standard_analog_output_0" | "standard_analog_output_1" => "DOUBLE",
        "standard_digital_output_mask"
        | "standard_digital_output"
        | "configurable_digital_output_mask"
        | "configurable_digital_output"
        | "tool_digital_output_mask"
        | "tool_digital_output"
        | "standard_analog_output_mask"
        | "standard_analog_output_type" => "UINT8",
        _ if exists(number("input_int_register_")) => "INT32",
        _ if exists(number("input_double_register_")) => "DOUBLE",
        _ => "NOT_FOUND",
    }
}

/// Removes the first number of an input from `bytes` and returns it; `None` if they are too few.
fn take_number(kind: &str, bytes: &mut &[u8]) -> Option<f64> {
    let size = match kind {
        "UINT8" => 1,
        "DOUBLE" => 8,
        _ => 4,
    };
    let (number, after) = bytes.split_at_checked(size)?;
    *bytes = after;
    Some(match kind {
        "UINT8" => f64::from(number[0]),
        "UINT32" => f64::from(u32::from_be_bytes(number.try_into().ok()?)),
        "INT32" => f64::from(i32::from_be_bytes(number.try_into().ok()?)),
        _ => f64::from_be_bytes(number.try_into().ok()?),
    })
}

fn names_of(payload: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(payload);
    text.split(',').filter(|name| !name.is_empty()).map(str::to_owned).collect()
}

impl Session<'_> {
    fn run(&mut self, mut stream: TcpStream) {
        let _unsupported = stream.set_nodelay(true);
        // Set by a pause; the sending thread ends.
        let mut sending = Arc::new(AtomicBool::new(false));
        while let Some((kind, payload)) = read_package(&mut stream) {
            let answer = match kind {
                b'V' => self.protocol(&payload),
                b'v' => [5_u32, 22, 3, 123_456].iter().flat_map(|number| number.to_be_bytes()).collect(),
                b'O' => self.set_outputs(&payload),
                b'I' => self.set_inputs(&payload),
                b'S' => vec![u8::from(self.may_start())],
                b'P' => {
                    sending.store(false, Ordering::SeqCst);
                    vec![1]
                }
                b'U' if self.data(&payload) => {
                    if self.controller.leaves.load(Ordering::SeqCst) {
                        return;
                    }
                    continue;
                }
                b'U' => {
                    let _gone = write_package(&mut stream, b'M', &text("data unlike the recipe", "RTDE", 1));
                    return;
                }
                _ => {
                    let _gone = write_package(&mut stream, b'M', &text("unknown package", "RTDE", 1));
                    continue;
                }
            };
            if kind == b'S' {
                // A controller may send texts at any time, and a real one's data may precede its answer.
                let _gone = write_package(&mut stream, b'M', &text("hello", "RTDE", 3));
                if answer == [1] {
                    sending.store(false, Ordering::SeqCst);
                    sending = Arc::new(AtomicBool::new(true));
                    self.send_outputs(&stream, Arc::clone(&sending));
                }
            }
            if write_package(&mut stream, kind, &answer).is_err() {
                return;
            }
            if kind == b'S' && self.controller.hangs.load(Ordering::SeqCst) {
                while self.controller.hangs.load(Ordering::SeqCst) {
                    std::thread::sleep(Duration::from_millis(10));
                }
                return;
            }
        }
    }

    fn protocol(&self, payload: &[u8]) -> Vec<u8> {
        let most = if self.controller.is_old.load(Ordering::SeqCst) { 1 } else { 2 };
        let asked = u16::from_be_bytes(payload.try_into().unwrap_or([0, 0]));
        vec![u8::from((1..=most).contains(&asked))]
    }

    fn may_start(&self) -> bool {
        self.output.is_some() && !self.controller.refuses_start.load(Ordering::SeqCst)
    }

    fn set_outputs(&mut self, payload: &[u8]) -> Vec<u8> {
        let Some((rate, names)) = payload.split_at_checked(8) else { return vec![0] };
        let rate_hz = f64::from_be_bytes(rate.try_into().unwrap_or_default());
        let names = names_of(names);
        let kinds: Vec<_> =
            names.iter().map(|name| self.controller.output(name).map_or("NOT_FOUND", Value::kind)).collect();
        let is_right = (1.0..=500.0).contains(&rate_hz) && !names.is_empty() && !kinds.contains(&"NOT_FOUND");
        let answer = [&[u8::from(is_right)], kinds.join(",").as_bytes()].concat();
        self.output = is_right.then_some((rate_hz, names));
        answer
    }

    /// Sends the outputs until the client disconnects or pauses.
    fn send_outputs(&self, stream: &TcpStream, sending: Arc<AtomicBool>) {
        let (Some((rate_hz, names)), Ok(mut stream)) = (self.output.clone(), stream.try_clone()) else {
            return;
        };
        let controller = Arc::clone(self.controller);
        std::thread::spawn(move || {
            let (begun, period) = (Instant::now(), Duration::from_secs_f64(1.0 / rate_hz));
            let mut due = begun;
            while sending.load(Ordering::SeqCst) {
                let is_quiet =
                    [&controller.hangs, &controller.is_mute].iter().any(|quiet| quiet.load(Ordering::SeqCst));
                let mut payload = vec![1];
                let has_clock = lock(&controller.outputs).contains_key("timestamp");
                for name in &names {
                    let value = match controller.output(name) {
                        Some(Value::Double(_)) if name == "timestamp" && !has_clock => {
                            Value::Double(begun.elapsed().as_secs_f64())
                        }
                        Some(value) => value,
                        None => return,
                    };
                    value.write(&mut payload);
                }
                if !is_quiet && write_package(&mut stream, b'U', &payload).is_err() {
                    return;
                }
                controller.packages_sent.fetch_add(u64::from(!is_quiet), Ordering::SeqCst);
                // A late thread sends no burst of packages.
                due = (due + period).max(Instant::now().checked_sub(period).unwrap_or(due));
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
        });
    }

    fn set_inputs(&mut self, payload: &[u8]) -> Vec<u8> {
        let names = names_of(payload);
        let mut owners = lock(&self.controller.owners);
        let is_taken = |name: &String| owners.get(name).is_some_and(|owner| *owner != self.client);
        let answers: Vec<_> =
            names.iter().map(|name| if is_taken(name) { "IN_USE" } else { kind_of(name) }).collect();
        let all_right = answers.iter().all(|kind| !["IN_USE", "NOT_FOUND"].contains(kind));
        let mut number = 0;
        if all_right && self.recipes.len() < usize::from(u8::MAX) {
            owners.extend(names.iter().map(|name| (name.clone(), self.client)));
            self.recipes.push(names);
            number = self.recipes.len() as u8;
        }
        [&[number], answers.join(",").as_bytes()].concat()
    }

    /// Writes the registers of a data package; false if it is unlike its recipe.
    fn data(&self, payload: &[u8]) -> bool {
        let Some((number, mut rest)) = payload.split_first() else { return false };
        let Some(recipe) = self.recipes.get(usize::from(*number).wrapping_sub(1)) else { return false };
        let values: Option<Vec<f64>> =
            recipe.iter().map(|name| take_number(kind_of(name), &mut rest)).collect();
        let Some(values) = values.filter(|_| rest.is_empty()) else { return false };
        lock(&self.controller.inputs).extend(recipe.iter().cloned().zip(values));
        self.controller.packages.fetch_add(1, Ordering::SeqCst);
        true
    }
}

fn read_package(stream: &mut TcpStream) -> Option<(u8, Vec<u8>)> {
    let mut header = [0; 3];
    stream.read_exact(&mut header).ok()?;
    let size = u16::from_be_bytes([header[0], header[1]]);
    let mut payload = vec![0; usize::from(size).checked_sub(3)?];
    stream.read_exact(&mut payload).ok()?;
    Some((header[2], payload))
}

fn write_package(stream: &mut TcpStream, kind: u8, payload: &[u8]) -> std::io::Result<()> {
    stream.write_all(&package(kind, payload))
}

/// A package with its header.
#[must_use]
pub fn package(kind: u8, payload: &[u8]) -> Vec<u8> {
    let size = payload.len() as u16 + 3;
    [&size.to_be_bytes()[..], &[kind], payload].concat()
}

/// Payload of a text message.
#[must_use]
pub fn text(message: &str, source: &str, level: u8) -> Vec<u8> {
    let part = |text: &str| [&[text.len() as u8], text.as_bytes()].concat();
    [part(message), part(source), vec![level]].concat()
}
