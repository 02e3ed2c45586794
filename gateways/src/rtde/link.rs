//! Connection to a controller: established in a thread of its own, used without blocking.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, TryRecvError, bounded};
use equipoise_core::message::Printable;
use socket2::SockRef;
use tracing::{info, warn};

use super::wire::{self, Kind, PROTOCOL, Word};
use crate::config::Register;

/// Time limit from connecting to the start of the exchange. Without it, a peer that sends data but never the expected
/// answer would block reconnection.
const START_WITHIN: Duration = Duration::from_secs(4);
/// Maximum number of the controller's text messages logged per [`TEXTS_WITHIN`]; a flood of them would fill the log.
const TEXTS_MAX: usize = 8;
/// At this rate the log stays readable; more messages indicate a fault that the first ones name.
const TEXTS_WITHIN: Duration = Duration::from_secs(10);
/// Longest type name quoted in the log; the longest of RTDE, `VECTOR6UINT32`, has 13 characters.
const TYPE_CHARS_MAX: usize = 32;
/// First pause before reconnecting after a refusal or a lost connection; each further failure doubles it.
const TRY_AGAIN_AFTER: Duration = Duration::from_secs(1);
const TRY_AGAIN_AFTER_MAX: Duration = Duration::from_secs(30);
/// Output requested from the controller: it starts no exchange without one, and its packages serve as its sign of life.
const OUTPUT: &str = "timestamp";
/// Requested output rate; the controller uses the next lower rate that divides its own.
const OUTPUT_HZ: f64 = 50.0;
/// After this silence of the controller nothing more is sent: data queued in the network would arrive late.
const HOLD_AFTER: Duration = Duration::from_millis(100);
/// After this time in which the controller sends, accepts or acknowledges nothing, the connection is closed: TCP itself
/// would wait for minutes, and then deliver stale data as new.
const LEAVE_AFTER: Duration = Duration::from_millis(300);

/// Why a controller cannot be written to.
#[derive(Debug, thiserror::Error)]
pub(super) enum LinkError {
    /// A network error.
    #[error("{0}; is the robot switched on, and RTDE not blocked in its security settings?")]
    Io(#[from] io::Error),
    /// No complete answer within the time limit.
    #[error("it did not answer within {} s; is this the RTDE port, 30004?", START_WITHIN.as_secs())]
    Late,
    /// The answer has an unexpected package type.
    #[error("it answered a package of type {0:#04x}; is this the RTDE port, 30004?")]
    Answer(u8),
    /// The controller does not support this protocol version.
    #[error("it does not speak version {PROTOCOL} of the protocol: RTDE needs a newer controller")]
    Protocol,
    /// Registers are unavailable or have another type.
    #[error("{0}")]
    Registers(String),
    /// The controller does not provide the output that serves as sign of life.
    #[error("it does not send its {OUTPUT}, and starts no exchange without an output")]
    Output,
    /// The controller refused to start the exchange.
    #[error("it did not start the exchange")]
    Start,
}

/// Logs text messages of the controller, with a rate limit.
#[derive(Debug)]
struct Texts {
    since: Instant,
    count: usize,
}

impl Texts {
    fn new() -> Texts {
        Texts { since: Instant::now(), count: 0 }
    }

    fn write(&mut self, payload: &[u8]) {
        if self.is_due(Instant::now()) {
            warn!("message of the controller: {}", wire::text(payload));
        }
    }

    fn is_due(&mut self, now: Instant) -> bool {
        if now.saturating_duration_since(self.since) >= TEXTS_WITHIN {
            let left_out = self.count.saturating_sub(TEXTS_MAX);
            if left_out > 0 {
                warn!("{left_out} more messages of the controller are not in this log");
            }
            *self = Texts { since: now, count: 0 };
        }
        self.count += 1;
        self.count <= TEXTS_MAX
    }
}

/// A connection on which data packages of one recipe may be sent.
#[derive(Debug)]
pub(super) struct Started {
    stream: TcpStream,
    recipe: u8,
    /// Rest of a package that the network has not accepted yet; it must go out before the next package.
    rest: Vec<u8>,
    received: Vec<u8>,
    took_at: Instant,
    /// When the last data package was received.
    received_at: Instant,
    texts: Texts,
}

/// Result of sending a package.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sent {
    Whole,
    /// Dropped: an earlier package is still being sent, or the controller is silent.
    Dropped,
}

impl Started {
    /// Sends a package if the network accepts one now; never blocks.
    pub(super) fn send(&mut self, words: impl IntoIterator<Item = Word>) -> io::Result<Sent> {
        self.listen()?;
        self.flush()?;
        let quiet = self.received_at.elapsed();
        if quiet > LEAVE_AFTER {
            return Err(io::Error::new(ErrorKind::TimedOut, "it sends no more packages"));
        }
        if quiet > HOLD_AFTER {
            return Ok(Sent::Dropped);
        }
        if !self.rest.is_empty() {
            if self.took_at.elapsed() > LEAVE_AFTER {
                return Err(io::Error::new(ErrorKind::TimedOut, "it takes no more packages"));
            }
            return Ok(Sent::Dropped);
        }
        self.rest = wire::data(self.recipe, words);
        self.flush()?;
        Ok(Sent::Whole)
    }

    fn flush(&mut self) -> io::Result<()> {
        while !self.rest.is_empty() {
            match self.stream.write(&self.rest) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(count) => {
                    self.rest.drain(..count);
                    self.took_at = Instant::now();
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Reads the controller's packages: signs of life, and texts for the log. Also detects a closed connection.
    fn listen(&mut self) -> io::Result<()> {
        let mut bytes = [0; 4096];
        loop {
            match self.stream.read(&mut bytes) {
                Ok(0) => return Err(io::Error::new(ErrorKind::ConnectionReset, "it closed the connection")),
                Ok(count) => self.received.extend(&bytes[..count]),
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                Err(error) => return Err(error),
            }
            while let Some((kind, payload)) = wire::take(&mut self.received) {
                if kind == Kind::Data as u8 {
                    self.received_at = Instant::now();
                } else if kind == Kind::Text as u8 {
                    self.texts.write(&payload);
                }
            }
        }
    }
}

/// A handshake with a controller, and the deadline for its completion.
struct Asking {
    stream: TcpStream,
    end: Instant,
    texts: Texts,
}

impl Asking {
    /// Connects.
    fn begin(robot: SocketAddr) -> io::Result<Asking> {
        let end = Instant::now() + START_WITHIN;
        let stream = TcpStream::connect_timeout(&robot, START_WITHIN)?;
        stream.set_nodelay(true)?;
        // Data that is undelivered when the connection closes must never arrive: reset instead of a graceful close.
        SockRef::from(&stream).set_linger(Some(Duration::ZERO))?;
        Ok(Asking { stream, end, texts: Texts::new() })
    }

    /// Sends a request and waits for an answer of the same type. Texts in between are logged, and data may precede the
    /// answer to a start.
    fn ask(&mut self, kind: Kind, payload: &[u8]) -> Result<Vec<u8>, LinkError> {
        self.write_all(&wire::package(kind, payload)).map_err(late)?;
        loop {
            match wire::read(self).map_err(late)? {
                (answer, payload) if answer == kind as u8 => return Ok(payload),
                (answer, payload) if answer == Kind::Text as u8 => {
                    self.texts.write(&payload);
                }
                (answer, _) if answer == Kind::Data as u8 => {}
                (answer, _) => return Err(LinkError::Answer(answer)),
            }
        }
    }

    /// Time until the deadline.
    fn left(&self) -> io::Result<Duration> {
        let left = self.end.saturating_duration_since(Instant::now());
        if left.is_zero() { Err(ErrorKind::TimedOut.into()) } else { Ok(left) }
    }
}

/// Each read gets the remaining time, because a package may arrive byte by byte.
impl Read for Asking {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.stream.set_read_timeout(Some(self.left()?))?;
        self.stream.read(bytes)
    }
}

impl Write for Asking {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.stream.set_write_timeout(Some(self.left()?))?;
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

/// Blocking sockets report a time-out as `WouldBlock`.
fn late(error: io::Error) -> LinkError {
    match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::TimedOut => LinkError::Late,
        _ => LinkError::Io(error),
    }
}

/// Connects, negotiates the recipes, and starts the exchange.
fn start(robot: SocketAddr, recipe: &[Register]) -> Result<Started, LinkError> {
    let mut asking = Asking::begin(robot)?;
    if asking.ask(Kind::Protocol, &PROTOCOL.to_be_bytes())?.first() != Some(&1) {
        return Err(LinkError::Protocol);
    }
    let version = asking.ask(Kind::Version, &[])?;
    let numbers: Vec<_> = version
        .chunks_exact(4)
        .map(|four| four.iter().fold(0, |sum, byte| sum << 8 | u32::from(*byte)))
        .collect();
    let output = [&OUTPUT_HZ.to_be_bytes()[..], OUTPUT.as_bytes()].concat();
    if !matches!(asking.ask(Kind::Outputs, &output)?.split_first(), Some((1.., b"DOUBLE"))) {
        return Err(LinkError::Output);
    }
    let names: Vec<_> = recipe.iter().map(|register| register.name()).collect();
    let answer = asking.ask(Kind::Inputs, names.join(",").as_bytes())?;
    let number = recipe_number(&answer, recipe, &names)?;
    if asking.ask(Kind::Start, &[])?.first() != Some(&1) {
        return Err(LinkError::Start);
    }
    let (stream, texts) = (asking.stream, asking.texts);
    SockRef::from(&stream).set_tcp_user_timeout(Some(LEAVE_AFTER))?;
    stream.set_nonblocking(true)?;
    let version: Vec<_> = numbers.iter().map(u32::to_string).collect();
    info!("{robot}: controller {}, {} registers are written", version.join("."), names.len());
    let now = Instant::now();
    Ok(Started {
        stream,
        recipe: number,
        rest: Vec::new(),
        received: Vec::new(),
        took_at: now,
        received_at: now,
        texts,
    })
}

/// The recipe number, if every register is available and has the written type.
fn recipe_number(answer: &[u8], recipe: &[Register], names: &[String]) -> Result<u8, LinkError> {
    let (number, types) = answer.split_first().map_or((0, &[][..]), |(number, types)| (*number, types));
    let types = String::from_utf8_lossy(types).into_owned();
    let mut faults = Vec::new();
    for (at, name) in names.iter().enumerate() {
        let expected = if recipe[at].value.is_whole() { "INT32" } else { "DOUBLE" };
        match types.split(',').map(str::trim).nth(at) {
            Some(kind) if kind == expected => {}
            Some("IN_USE") => {
                faults.push(format!("{name} is written by another client: choose another number"));
            }
            Some("NOT_FOUND") => faults.push(format!("{name} does not exist on this controller")),
            other => {
                let other =
                    Printable { text: other.unwrap_or("not answered for"), chars_max: TYPE_CHARS_MAX };
                faults.push(format!("{name} is {other}, not {expected}"));
            }
        }
    }
    if !faults.is_empty() {
        return Err(LinkError::Registers(format!("{}; see [gateways.rtde.registers]", faults.join("; "))));
    }
    if number == 0 {
        return Err(LinkError::Registers("it refuses the registers together".to_owned()));
    }
    Ok(number)
}

/// Establishes connections, with back-off after failures.
#[derive(Debug)]
pub(super) struct Connector {
    robot: SocketAddr,
    recipe: Vec<Register>,
    pending: Option<Receiver<Result<Started, LinkError>>>,
    due: Instant,
    pause: Duration,
    logged: String,
}

impl Connector {
    pub(super) fn new(robot: SocketAddr, recipe: Vec<Register>) -> Connector {
        let due = Instant::now();
        Connector { robot, recipe, pending: None, due, pause: TRY_AGAIN_AFTER, logged: String::new() }
    }

    /// Returns a connection if one is ready; never blocks.
    pub(super) fn poll(&mut self) -> Option<Started> {
        let Some(pending) = &self.pending else {
            if Instant::now() >= self.due {
                self.dial();
            }
            return None;
        };
        let outcome = match pending.try_recv() {
            Ok(outcome) => outcome,
            Err(TryRecvError::Empty) => return None,
            Err(TryRecvError::Disconnected) => Err(LinkError::Start),
        };
        self.pending = None;
        match outcome {
            Ok(started) => {
                self.logged.clear();
                Some(started)
            }
            Err(error) => {
                self.lost(&error.to_string());
                None
            }
        }
    }

    /// Schedules a reconnection after a pause. A repeated reason is logged once.
    pub(super) fn lost(&mut self, why: &str) {
        if self.logged != why {
            warn!("{}: {why}; tried again from {} s on", self.robot, self.pause.as_secs());
            why.clone_into(&mut self.logged);
        }
        self.due = Instant::now() + self.pause;
        self.pause = (2 * self.pause).min(TRY_AGAIN_AFTER_MAX);
    }

    /// Packages go out: reset the back-off.
    pub(super) fn went_well(&mut self) {
        self.pause = TRY_AGAIN_AFTER;
    }

    fn dial(&mut self) {
        let (sender, receiver) = bounded(1);
        let (robot, recipe) = (self.robot, self.recipe.clone());
        let thread = std::thread::Builder::new().name("rtde dialling".to_owned());
        let begun = thread.spawn(move || {
            // Sending fails only if the program is ending.
            let _ = sender.send(start(robot, &recipe));
        });
        match begun {
            Ok(_) => self.pending = Some(receiver),
            Err(error) => self.lost(&error.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Value;

    #[test]
    fn texts_of_a_controller_are_printable_and_few() {
        let payload = [&[9][..], b"red\x1b[31m\n", &[4], b"a\rb\t", &[1]].concat();
        assert_eq!(wire::text(&payload), "a\\rb\\t: red\\u{1b}[31m\\n");
        let mut texts = Texts::new();
        let begin = texts.since;
        let due = |texts: &mut Texts, after| (0..100).filter(|_| texts.is_due(begin + after)).count();
        assert_eq!(due(&mut texts, Duration::ZERO), TEXTS_MAX);
        assert_eq!(due(&mut texts, TEXTS_WITHIN), TEXTS_MAX);
        assert_eq!(due(&mut texts, TEXTS_WITHIN + Duration::from_secs(1)), 0);
    }

    #[test]
    fn the_type_of_a_register_is_quoted_in_part() {
        let register = Register { value: Value::WorstLevel, number: 24 };
        let answer = [&[1][..], &b"\x1b".repeat(60_000)].concat();
        let message = recipe_number(&answer, &[register], &["input_int_register_24".to_owned()])
            .unwrap_err()
            .to_string();
        assert!(
            message.len() < 400 && !message.contains('\x1b') && message.contains("not INT32"),
            "{message}"
        );
    }
}
