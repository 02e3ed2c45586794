//! Controller side of RTDE, version 2, after Universal Robots' guide; independent of the gateway's encoder.
//!
//! Integer and double input registers 0 to 47. A register belongs to the first client that sets it up, until that
//! client disconnects: others get `IN_USE`. Other names get `NOT_FOUND`. As on a real controller, no exchange starts
//! without an output recipe; the only output is `timestamp`.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// Behaviour and contents of the simulated controller.
#[derive(Default)]
pub(crate) struct Controller {
    /// Values of the registers, integers included.
    pub(crate) inputs: Mutex<BTreeMap<String, f64>>,
    /// The client that owns each register.
    owners: Mutex<BTreeMap<String, u64>>,
    /// Data packages received.
    pub(crate) packages: AtomicU64,
    /// Connections so far.
    pub(crate) clients: AtomicU64,
    /// Supports protocol version 1 only.
    pub(crate) is_old: AtomicBool,
    /// After the start it reads nothing, and disconnects when this is reset.
    pub(crate) hangs: AtomicBool,
    /// Disconnects from a client that sends data.
    pub(crate) leaves: AtomicBool,
    /// Refuses to start.
    pub(crate) refuses_start: AtomicBool,
    /// Reads, but sends no data.
    pub(crate) is_mute: AtomicBool,
    /// Data packages sent.
    pub(crate) packages_sent: AtomicU64,
}

/// Serves in the background until the test ends.
pub(crate) fn serve(controller: Arc<Controller>, listener: TcpListener) {
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let controller = Arc::clone(&controller);
            std::thread::spawn(move || {
                let client = controller.clients.fetch_add(1, Ordering::SeqCst) + 1;
                let mut conversation =
                    Conversation { controller: &controller, client, recipes: Vec::new(), output_hz: None };
                let closing = stream.try_clone();
                conversation.run(stream);
                // The sending thread has a handle of its own, so the socket is shut down explicitly.
                let _gone = closing.and_then(|stream| stream.shutdown(std::net::Shutdown::Both));
                controller.owners.lock().unwrap().retain(|_, owner| *owner != client);
            });
        }
    });
}

/// Starts a controller on a free port.
pub(crate) fn start() -> (Arc<Controller>, SocketAddr) {
    let controller = Arc::new(Controller::default());
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    serve(Arc::clone(&controller), listener);
    (controller, address)
}

struct Conversation<'a> {
    controller: &'a Arc<Controller>,
    client: u64,
    recipes: Vec<Vec<String>>,
    /// Rate of the output recipe, once it is set up.
    output_hz: Option<f64>,
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

/// Removes the first number from `bytes` and returns it.
fn taken(kind: &str, bytes: &mut &[u8]) -> f64 {
    let size = match kind {
        "UINT8" => 1,
        "DOUBLE" => 8,
        _ => 4,
    };
    let (number, after) = bytes.split_at(size);
    *bytes = after;
    match kind {
        "UINT8" => f64::from(number[0]),
        "UINT32" => f64::from(u32::from_be_bytes(number.try_into().unwrap())),
        "INT32" => f64::from(i32::from_be_bytes(number.try_into().unwrap())),
        _ => f64::from_be_bytes(number.try_into().unwrap()),
    }
}

impl Conversation<'_> {
    fn run(&mut self, mut stream: TcpStream) {
        while let Some((kind, payload)) = read_package(&mut stream) {
            let answer = match kind {
                b'V' => self.protocol(&payload),
                b'v' => [5_u32, 22, 3, 123_456].iter().flat_map(|number| number.to_be_bytes()).collect(),
                b'O' => self.outputs(&payload),
                b'I' => self.inputs(&payload),
                b'S' => vec![u8::from(self.may_start())],
                b'P' => vec![1],
                b'U' => {
                    self.data(&payload);
                    if self.controller.leaves.load(Ordering::SeqCst) {
                        return;
                    }
                    continue;
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
                    self.send_outputs(&stream);
                }
            }
            if write_package(&mut stream, kind, &answer).is_err() {
                return;
            }
            if kind == b'S' && self.controller.hangs.load(Ordering::SeqCst) {
                while self.controller.hangs.load(Ordering::SeqCst) {
                    std::thread::sleep(std::time::Duration::from_millis(10));
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
        self.output_hz.is_some() && !self.controller.refuses_start.load(Ordering::SeqCst)
    }

    fn outputs(&mut self, payload: &[u8]) -> Vec<u8> {
        let (rate, names) = payload.split_at(8);
        let rate_hz = f64::from_be_bytes(rate.try_into().unwrap());
        let kind = |name: &str| if name == "timestamp" { "DOUBLE" } else { "NOT_FOUND" };
        let names = String::from_utf8_lossy(names).into_owned();
        let answers: Vec<_> = names.split(',').map(kind).collect();
        let is_right = (1.0..=500.0).contains(&rate_hz) && answers.iter().all(|kind| *kind == "DOUBLE");
        self.output_hz = is_right.then_some(rate_hz);
        [&[u8::from(is_right)], answers.join(",").as_bytes()].concat()
    }

    /// Sends the outputs until the client disconnects.
    fn send_outputs(&self, stream: &TcpStream) {
        let (Some(rate_hz), Ok(mut stream)) = (self.output_hz, stream.try_clone()) else { return };
        let controller = Arc::clone(self.controller);
        std::thread::spawn(move || {
            let begun = std::time::Instant::now();
            loop {
                let is_quiet =
                    [&controller.hangs, &controller.is_mute].iter().any(|quiet| quiet.load(Ordering::SeqCst));
                let timestamp = begun.elapsed().as_secs_f64().to_be_bytes();
                if !is_quiet && write_package(&mut stream, b'U', &[&[1], &timestamp[..]].concat()).is_err() {
                    return;
                }
                controller.packages_sent.fetch_add(u64::from(!is_quiet), Ordering::SeqCst);
                std::thread::sleep(std::time::Duration::from_secs_f64(1.0 / rate_hz));
            }
        });
    }

    fn inputs(&mut self, payload: &[u8]) -> Vec<u8> {
        let text = String::from_utf8_lossy(payload).into_owned();
        let names: Vec<String> = text.split(',').filter(|name| !name.is_empty()).map(str::to_owned).collect();
        let mut owners = self.controller.owners.lock().unwrap();
        let is_taken = |name: &String| owners.get(name).is_some_and(|owner| *owner != self.client);
        let answers: Vec<_> =
            names.iter().map(|name| if is_taken(name) { "IN_USE" } else { kind_of(name) }).collect();
        let all_right = answers.iter().all(|kind| !["IN_USE", "NOT_FOUND"].contains(kind));
        let mut number = 0;
        if all_right {
            owners.extend(names.iter().map(|name| (name.clone(), self.client)));
            self.recipes.push(names);
            number = self.recipes.len() as u8;
        }
        [&[number], answers.join(",").as_bytes()].concat()
    }

    fn data(&mut self, payload: &[u8]) {
        let Some(recipe) = self.recipes.get(usize::from(payload[0]).wrapping_sub(1)) else { return };
        let mut rest = &payload[1..];
        let mut inputs = self.controller.inputs.lock().unwrap();
        for name in recipe {
            let value = taken(kind_of(name), &mut rest);
            inputs.insert(name.clone(), value);
        }
        assert!(rest.is_empty(), "{} bytes more than the recipe has", rest.len());
        self.controller.packages.fetch_add(1, Ordering::SeqCst);
    }
}

fn read_package(stream: &mut TcpStream) -> Option<(u8, Vec<u8>)> {
    let mut header = [0; 3];
    stream.read_exact(&mut header).ok()?;
    let size = u16::from_be_bytes([header[0], header[1]]);
    let mut payload = vec![0; usize::from(size) - 3];
    stream.read_exact(&mut payload).ok()?;
    Some((header[2], payload))
}

fn write_package(stream: &mut TcpStream, kind: u8, payload: &[u8]) -> std::io::Result<()> {
    stream.write_all(&package(kind, payload))
}

pub(crate) fn package(kind: u8, payload: &[u8]) -> Vec<u8> {
    let size = payload.len() as u16 + 3;
    [&size.to_be_bytes()[..], &[kind], payload].concat()
}

pub(crate) fn text(message: &str, source: &str, level: u8) -> Vec<u8> {
    let part = |text: &str| [&[text.len() as u8], text.as_bytes()].concat();
    [part(message), part(source), vec![level]].concat()
}

/// Not a test: with `EQUIPOISE_RTDE_CONTROLLER` set to an address, serves a controller that prints its registers until
/// it is killed.
#[test]
fn serves() {
    let Some(address) = std::env::var_os("EQUIPOISE_RTDE_CONTROLLER") else { return };
    let controller = Arc::new(Controller::default());
    serve(Arc::clone(&controller), TcpListener::bind(address.to_str().unwrap()).unwrap());
    loop {
        let inputs = controller.inputs.lock().unwrap().clone();
        let words: Vec<_> = inputs.iter().map(|(name, value)| format!("{name}={value}")).collect();
        println!("packages={} {}", controller.packages.load(Ordering::SeqCst), words.join(" "));
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
}
