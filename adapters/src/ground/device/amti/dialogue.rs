//! Start-up dialogue with an AMTI plate over its serial line: stop, sampling rate, line speed, start.
//!
//! A state machine without I/O. Inputs are the bytes received and the time (ns, CLOCK_MONOTONIC), outputs are the
//! bytes to send and the line speeds to set. Each command has a timeout; after a failure the dialogue restarts.
//!
//! A plate left streaming (by another program, or by a killed daemon) accepts only "stop", and only at its streaming
//! speed; "stop" is therefore sent at both speeds. Whether the plate then accepts its rate at the slow speed, as the
//! makers' receivers assume, or at the fast one, is determined by alternating.

use super::Rate;
use crate::ground::device::Action;
use crate::wire::amti::{Command, SPEED_FAST, SPEED_SLOW, STARTED_ONE, STARTED_TWO};

const NS_PER_MS: u64 = 1_000_000;
/// Time from "stop" until the plate is silent, and from a change of speed to the next command, ns.
const SETTLE_NS: u64 = 100 * NS_PER_MS;
/// Timeout of an answer, ns.
const ANSWER_NS: u64 = 1000 * NS_PER_MS;
/// Pause after a failure, ns.
const PAUSE_NS: u64 = 500 * NS_PER_MS;
/// Pause between checks whether one of two connected plates was removed, ns.
const TWO_PAUSE_NS: u64 = 5000 * NS_PER_MS;
/// Number of consecutive failures that are reported; single failures of the dialogue are normal.
const FAILURES: u32 = 2;
/// Maximum number of bytes before an answer: more are a stream, in which an answer cannot be identified.
const BYTES_BEFORE_ANSWER_MAX: usize = 64;

/// The next action, or the answer that is awaited.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// Set the fast speed.
    FastSpeed,
    /// Send "stop" at the fast speed.
    FastStop,
    /// Set the speed of the command phase.
    CommandSpeed,
    /// Send "stop" at that speed.
    CommandStop,
    Rate,
    RateAnswer,
    /// Set the speed at which the plate streams.
    StreamSpeed,
    Start,
    StartAnswer,
    Streaming,
    /// Pause until `until_ns`, then restart.
    Pause,
}

/// The last failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    NoAnswer,
    NoStart,
    TwoPlates,
}

/// State of the dialogue.
#[derive(Debug, Clone)]
pub(super) struct Dialogue {
    rate: Rate,
    step: Step,
    /// Timeout of the step, ns.
    until_ns: u64,
    /// Bytes received in this step without an answer.
    bytes_before_answer: usize,
    /// Consecutive failures.
    failures: u32,
    fault: Option<Fault>,
}

impl Dialogue {
    /// A dialogue before its first step.
    pub(super) fn new(rate: Rate) -> Dialogue {
        Dialogue {
            rate,
            step: Step::FastSpeed,
            until_ns: 0,
            bytes_before_answer: 0,
            failures: 0,
            fault: None,
        }
    }

    /// Restarts the dialogue.
    pub(super) fn begin(&mut self, now_ns: u64) {
        (self.step, self.until_ns) = (Step::FastSpeed, now_ns);
    }

    /// Whether the plate has confirmed its start.
    pub(super) fn is_streaming(&self) -> bool {
        self.step == Step::Streaming
    }

    /// Speed of the command phase, baud: the two speeds alternate with each failure.
    fn command_speed(&self) -> u32 {
        if self.failures.is_multiple_of(2) { SPEED_SLOW } else { SPEED_FAST }
    }

    /// The next action; each is returned once.
    pub(super) fn next_action(&mut self, now_ns: u64) -> Action {
        let is_waiting = now_ns < self.until_ns;
        let send = |command: Command| Action::Send(vec![command as u8]);
        match self.step {
            Step::FastSpeed => self.enter(Step::FastStop, now_ns, Action::Speed(SPEED_FAST)),
            Step::FastStop => self.enter(Step::CommandSpeed, now_ns + SETTLE_NS, send(Command::Stop)),
            _ if is_waiting => Action::Nothing,
            Step::CommandSpeed => self.enter(Step::CommandStop, now_ns, Action::Speed(self.command_speed())),
            Step::CommandStop => self.enter(Step::Rate, now_ns + SETTLE_NS, send(Command::Stop)),
            Step::Rate => self.enter(Step::RateAnswer, now_ns + ANSWER_NS, send(self.rate.command())),
            Step::StreamSpeed => {
                self.enter(Step::Start, now_ns + SETTLE_NS, Action::Speed(self.rate.speed()))
            }
            Step::Start => self.enter(Step::StartAnswer, now_ns + ANSWER_NS, send(Command::Start)),
            Step::RateAnswer => self.fail(Fault::NoAnswer, now_ns),
            Step::StartAnswer => self.fail(Fault::NoStart, now_ns),
            Step::Pause => self.enter(Step::FastStop, now_ns, Action::Speed(SPEED_FAST)),
            Step::Streaming => Action::Nothing,
        }
    }

    /// Searches received bytes for the expected answer; returns the bytes after it if they belong to the stream.
    pub(super) fn ingest<'a>(&mut self, bytes: &'a [u8], now_ns: u64) -> Option<&'a [u8]> {
        let expected: &[u8] = match self.step {
            Step::RateAnswer => &[self.rate.command() as u8],
            Step::StartAnswer => &[STARTED_ONE, STARTED_TWO],
            _ => return None,
        };
        let Some(position) = bytes.iter().position(|byte| expected.contains(byte)) else {
            self.bytes_before_answer += bytes.len();
            if self.bytes_before_answer > BYTES_BEFORE_ANSWER_MAX {
                // The plate still streams: an answer cannot be distinguished from its frames.
                self.until_ns = now_ns;
            }
            return None;
        };
        if self.step == Step::RateAnswer {
            let _ = self.enter(Step::StreamSpeed, now_ns, Action::Nothing);
            return None;
        }
        if bytes.get(position) == Some(&STARTED_TWO) {
            let _stop = self.fail(Fault::TwoPlates, now_ns);
            return None;
        }
        (self.step, self.failures, self.fault) = (Step::Streaming, 0, None);
        bytes.get(position + 1..)
    }

    /// The last failure with its remedy, if it is to be reported.
    pub(super) fn diagnostic(&self) -> Option<String> {
        let message = match self.fault? {
            Fault::TwoPlates => {
                "two AMTI plates answer on this line, and how two send has never been verified: switch the adapter from A+B \
                 to A, and give the second plate a line and a [ground.second] of its own"
            }
            _ if self.failures < FAILURES => return None,
            Fault::NoAnswer => {
                "the AMTI plate does not answer to the command that sets its rate: is it switched on, plugged into its serial adapter, and \
                 the adapter switched to A (with A+B and one plate it sends nothing)? If it is, unplug its power and plug \
                 it in again"
            }
            Fault::NoStart => {
                "the AMTI plate answers, but does not start: try rate_hz = 50, the only one that every serial adapter \
                 carries; if that does not help, unplug its power and plug it in again"
            }
        };
        Some(message.to_owned())
    }

    /// Enters the next step with its timeout; returns the action that leads to it.
    fn enter(&mut self, next: Step, until_ns: u64, action: Action) -> Action {
        (self.step, self.until_ns, self.bytes_before_answer) = (next, until_ns, 0);
        action
    }

    /// Counts a failure, stops the plate and pauses.
    fn fail(&mut self, fault: Fault, now_ns: u64) -> Action {
        self.failures = self.failures.saturating_add(1);
        self.fault = Some(fault);
        let pause_ns = if fault == Fault::TwoPlates { TWO_PAUSE_NS } else { PAUSE_NS };
        self.enter(Step::Pause, now_ns + pause_ns, Action::Send(vec![Command::Stop as u8]))
    }
}
