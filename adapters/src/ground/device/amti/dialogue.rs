//! Start-up dialogue of an AMTI plate: stop, rate, speed, zero, start, each with its answer and its timeout.
//!
//! A plate left streaming (by another program, or by a killed daemon) accepts only "stop", and only at its streaming
//! speed; "stop" is therefore sent at both speeds. Whether the plate then accepts its rate at the slow speed, as the
//! makers' receivers assume, or at the fast one, is determined by alternating.

use super::Rate;
use crate::ground::device::Want;
use crate::wire::amti::{Command, SPEED_FAST, SPEED_SLOW, STARTED_ONE, STARTED_TWO, ZEROED_ONE, ZEROED_TWO};

const MS: u64 = 1_000_000;
/// Time from "stop" until the plate is silent.
const SETTLE_NS: u64 = 100 * MS;
/// Timeout of an answer, …
const ANSWER_NS: u64 = 1000 * MS;
/// … and of the answer to "zero".
const ZERO_NS: u64 = 12_000 * MS;
/// Pause after a failure.
const PAUSE_NS: u64 = 500 * MS;
/// Pause between checks whether one of two connected plates was removed.
const TWO_PAUSE_NS: u64 = 5000 * MS;
/// Occasional failures of the dialogue are normal; this many in a row are reported.
const FAILURES: u32 = 2;
/// More bytes than this before an answer are a stream, not an answer.
const CHATTER_MAX: usize = 64;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// At the fast speed: stop.
    FastSpeed,
    FastStop,
    /// At the speed at which the rate is sent: stop.
    AskSpeed,
    AskStop,
    Rate,
    RateAnswer,
    StreamSpeed,
    Zero,
    ZeroAnswer,
    Start,
    StartAnswer,
    Streams,
    /// Pause until `until_ns`.
    Rests,
}

/// The last failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    NoAnswer,
    NoZero,
    NoStart,
    Two,
}

#[derive(Debug, Clone)]
pub(super) struct Dialogue {
    rate: Rate,
    zero: bool,
    step: Step,
    /// End of the step, at the latest.
    until_ns: u64,
    heard: usize,
    failures: u32,
    fault: Option<Fault>,
}

impl Dialogue {
    pub(super) fn new(rate: Rate, zero: bool) -> Dialogue {
        Dialogue { rate, zero, step: Step::FastSpeed, until_ns: 0, heard: 0, failures: 0, fault: None }
    }

    /// Restarts the dialogue.
    pub(super) fn begin(&mut self, now_ns: u64) {
        (self.step, self.until_ns) = (Step::FastSpeed, now_ns);
    }

    pub(super) fn streams(&self) -> bool {
        self.step == Step::Streams
    }

    /// Speed of the command phase: the two speeds alternate with each failure.
    fn asks_at(&self) -> u32 {
        if self.failures.is_multiple_of(2) { SPEED_SLOW } else { SPEED_FAST }
    }

    /// The next action; each is returned once.
    pub(super) fn wants(&mut self, now_ns: u64) -> Want {
        let waits = now_ns < self.until_ns;
        let say = |command: Command| Want::Send(vec![command as u8]);
        match self.step {
            Step::FastSpeed => self.go(Step::FastStop, now_ns, Want::Speed(SPEED_FAST)),
            Step::FastStop => self.go(Step::AskSpeed, now_ns + SETTLE_NS, say(Command::Stop)),
            _ if waits => Want::Nothing,
            Step::AskSpeed => self.go(Step::AskStop, now_ns, Want::Speed(self.asks_at())),
            Step::AskStop => self.go(Step::Rate, now_ns + SETTLE_NS, say(Command::Stop)),
            Step::Rate => self.go(Step::RateAnswer, now_ns + ANSWER_NS, say(self.rate.command())),
            Step::StreamSpeed => {
                let next = if self.zero { Step::Zero } else { Step::Start };
                self.go(next, now_ns + SETTLE_NS, Want::Speed(self.rate.speed()))
            }
            Step::Zero => self.go(Step::ZeroAnswer, now_ns + ZERO_NS, say(Command::AutoZero)),
            Step::Start => self.go(Step::StartAnswer, now_ns + ANSWER_NS, say(Command::Start)),
            Step::RateAnswer => self.fail(Fault::NoAnswer, now_ns),
            Step::ZeroAnswer => self.fail(Fault::NoZero, now_ns),
            Step::StartAnswer => self.fail(Fault::NoStart, now_ns),
            Step::Rests => self.go(Step::FastStop, now_ns, Want::Speed(SPEED_FAST)),
            Step::Streams => Want::Nothing,
        }
    }

    /// Searches for the expected answer; returns the bytes after it if they belong to the stream.
    pub(super) fn hear<'a>(&mut self, bytes: &'a [u8], now_ns: u64) -> Option<&'a [u8]> {
        let expected: &[u8] = match self.step {
            Step::RateAnswer => &[self.rate.command() as u8],
            Step::ZeroAnswer => &[ZEROED_ONE, ZEROED_TWO],
            Step::StartAnswer => &[STARTED_ONE, STARTED_TWO],
            _ => return None,
        };
        let Some(place) = bytes.iter().position(|byte| expected.contains(byte)) else {
            self.heard += bytes.len();
            if self.heard > CHATTER_MAX {
                // The plate still streams: an answer cannot be distinguished from its frames.
                self.until_ns = now_ns;
            }
            return None;
        };
        if matches!(bytes.get(place), Some(&(ZEROED_TWO | STARTED_TWO))) && self.step != Step::RateAnswer {
            let _stop = self.fail(Fault::Two, now_ns);
            return None;
        }
        match self.step {
            Step::RateAnswer => _ = self.go(Step::StreamSpeed, now_ns, Want::Nothing),
            Step::ZeroAnswer => {
                // Zero once only: a person may stand on the plate when it is reconnected, and their weight must not
                // become the zero.
                self.zero = false;
                _ = self.go(Step::Start, now_ns, Want::Nothing);
            }
            _ => {
                (self.step, self.failures, self.fault) = (Step::Streams, 0, None);
                return bytes.get(place + 1..);
            }
        }
        None
    }

    pub(super) fn trouble(&self) -> Option<String> {
        let said = match self.fault? {
            Fault::Two => {
                "two AMTI plates answer on this line, and how two send has never been verified: switch the adapter from A+B \
                 to A, and give the second plate a line and a [ground.second] of its own"
            }
            _ if self.failures < FAILURES => return None,
            Fault::NoAnswer => {
                "the AMTI plate does not answer to the command that sets its rate: is it switched on, plugged into its serial adapter, and \
                 the adapter switched to A (with A+B and one plate it sends nothing)? If it is, unplug its power and plug \
                 it in again"
            }
            Fault::NoZero => {
                "the AMTI plate does not finish taking its zero: unplug its power and plug it in again, with nothing on it"
            }
            Fault::NoStart => {
                "the AMTI plate answers, but does not start: try rate_hz = 50, the only one that every serial adapter \
                 carries; if that does not help, unplug its power and plug it in again"
            }
        };
        Some(said.to_owned())
    }

    fn go(&mut self, next: Step, until_ns: u64, want: Want) -> Want {
        (self.step, self.until_ns, self.heard) = (next, until_ns, 0);
        want
    }

    fn fail(&mut self, fault: Fault, now_ns: u64) -> Want {
        self.failures = self.failures.saturating_add(1);
        self.fault = Some(fault);
        let pause_ns = if fault == Fault::Two { TWO_PAUSE_NS } else { PAUSE_NS };
        self.go(Step::Rests, now_ns + pause_ns, Want::Send(vec![Command::Stop as u8]))
    }
}
