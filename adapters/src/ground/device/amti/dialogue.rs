//! How an AMTI plate is brought to stream: stop, rate, speed, zero, start, each with its answer and its patience.
//!
//! A plate that another program, or a daemon that was killed, left streaming hears nothing but "stop", and that only at
//! the speed it streams at: it is told so at both. Whether it then wants its rate at the slow speed, as its makers'
//! receivers have it, or at the fast one, is tried in turn.

use super::Rate;
use crate::ground::device::Want;
use crate::wire::amti::{Command, SPEED_FAST, SPEED_SLOW, STARTED_ONE, STARTED_TWO, ZEROED_ONE, ZEROED_TWO};

const MS: u64 = 1_000_000;
/// A plate falls silent so long after "stop".
const SETTLE_NS: u64 = 100 * MS;
/// It answers within this, …
const ANSWER_NS: u64 = 1000 * MS;
/// … and to "zero" within this.
const ZERO_NS: u64 = 12_000 * MS;
/// After a failure it is left alone for so long.
const PAUSE_NS: u64 = 500 * MS;
/// Two plates are asked again whether they are one now only so often.
const TWO_PAUSE_NS: u64 = 5000 * MS;
/// Linking fails now and then; so many failures in a row are told.
const FAILURES: u32 = 2;
/// More bytes than these before an answer are a stream and no answer.
const CHATTER_MAX: usize = 64;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// At the fast speed: stop.
    FastSpeed,
    FastStop,
    /// At the speed that the rate is told at: stop.
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
    /// Nothing until then.
    Rests,
}

/// What went wrong last.
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
    /// Until when the step lasts at most.
    until_ns: u64,
    heard: usize,
    failures: u32,
    fault: Option<Fault>,
}

impl Dialogue {
    pub(super) fn new(rate: Rate, zero: bool) -> Dialogue {
        Dialogue { rate, zero, step: Step::FastSpeed, until_ns: 0, heard: 0, failures: 0, fault: None }
    }

    /// From the start.
    pub(super) fn begin(&mut self, now_ns: u64) {
        (self.step, self.until_ns) = (Step::FastSpeed, now_ns);
    }

    pub(super) fn streams(&self) -> bool {
        self.step == Step::Streams
    }

    /// Whether every second try is due, at the other speed.
    fn asks_at(&self) -> u32 {
        if self.failures.is_multiple_of(2) { SPEED_SLOW } else { SPEED_FAST }
    }

    /// What is to be done next; each thing is wanted once.
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

    /// Listens for the answer that is due; what follows it if that is the stream.
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
                // It still streams: no answer can be told from its frames.
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
                // Once: whoever stands on the plate when it is plugged in again must not be taken for nothing.
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
                "the AMTI plate does not answer when told its rate: is it switched on, plugged into its serial adapter, and \
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
