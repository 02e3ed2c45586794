//! Bota and Rokubi sensors over a serial line: only received, or set up first.

use super::framing::Framing;
use super::{Action, GroundDevice};
use crate::ground::frame::Wrench;
use crate::ground::lead::Lead;
use crate::ground::reading::{Decoded, Load, Reading, Tick};
use crate::ground::refusal::GroundRefusal;
use crate::wire::bota::{FRAME_SIZE, Frame, HEADER, setup, status};
use crate::wire::sliding::{Sliding, StreamElement};

const NS_PER_MS: u64 = 1_000_000;
/// Timeout of an answer, after which the command is repeated.
const ANSWER_NS: u64 = 1000 * NS_PER_MS;
/// This many unanswered commands in a row are reported.
const UNANSWERED: u32 = 2;
/// Silence of the line that is reported.
const SILENCE_NS: u64 = 2000 * NS_PER_MS;
/// Length of the last bytes that may begin an answer.
const ANSWER_MAX: usize = 16;
/// Status bits that forbid to use a sample. A late sample is valid; other bits are undefined.
const UNFIT: u16 = status::OVERRANGE | status::INVALID | status::RAW;
/// The sensor's period is a clock step that repeats this often.
const STEPS_ALIKE: u32 = 3;
/// This many frames with a constant clock are reported.
const STANDS: u32 = 20;

/// Use of a sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BotaSettings {
    /// Speed of the line, baud.
    pub baud: u32,
    /// Length of the sinc filter to configure; `None` only receives.
    pub sinc: Option<u32>,
}

/// A sensor on a serial line.
#[derive(Debug, Clone)]
pub struct Bota {
    settings: BotaSettings,
    stream: Sliding,
    framing: Framing,
    /// The preceding bytes belong to no frame.
    passing: bool,
    clock: Clock,
    /// The current step of the set-up; frames follow the last step.
    step: usize,
    asked_ns: Option<u64>,
    unanswered: u32,
    received: Vec<u8>,
    last_ns: u64,
    silent: bool,
    raw: bool,
}

impl Bota {
    /// A sensor before any data.
    pub fn new(settings: BotaSettings) -> Bota {
        Bota {
            settings,
            stream: Sliding::default(),
            framing: Framing::new("a Bota sensor", FRAME_SIZE, settings.baud, "460800"),
            passing: false,
            clock: Clock::default(),
            step: 0,
            asked_ns: None,
            unanswered: 0,
            received: Vec::new(),
            last_ns: 0,
            silent: false,
            raw: false,
        }
    }

    /// The command that is due in the set-up, and its expected answer.
    fn due(&self) -> Option<(String, &'static str)> {
        setup(self.settings.sinc?, self.settings.baud)?.into_iter().nth(self.step)
    }

    /// Searches for an answer among frames that still arrive; returns the bytes after it.
    fn receive<'a>(&mut self, bytes: &'a [u8], answer: &str) -> Option<&'a [u8]> {
        let before = self.received.len();
        self.received.extend_from_slice(bytes);
        let place = self.received.windows(answer.len()).position(|window| window == answer.as_bytes());
        if place.is_none() {
            self.received.drain(..self.received.len().saturating_sub(ANSWER_MAX));
        }
        let end = (place? + answer.len()).saturating_sub(before);
        self.received.clear();
        (self.step, self.asked_ns, self.unanswered) = (self.step + 1, None, 0);
        bytes.get(end..)
    }

    fn read(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        self.stream.push(bytes);
        while let Some(element) = self.stream.next(Frame::parse) {
            match element {
                StreamElement::Frame(frame) => self.frame(&frame, arrival_ns, decoded),
                StreamElement::Skipped { bytes, first } => {
                    let damaged = first == HEADER;
                    if !core::mem::replace(&mut self.passing, true) {
                        decoded.refuse(if damaged {
                            GroundRefusal::Checksum
                        } else {
                            GroundRefusal::Garbage
                        });
                    }
                    self.framing.skipped(bytes);
                }
            }
        }
    }

    fn frame(&mut self, frame: &Frame, arrival_ns: u64, decoded: &mut Decoded) {
        self.passing = false;
        self.framing.frame();
        self.raw = frame.status & status::RAW != 0;
        match self.clock.follow(frame.timestamp_us, arrival_ns) {
            Step::Stands => return decoded.refuse(GroundRefusal::Duplicate),
            Step::Forward { lost: 0 } => {}
            Step::Forward { lost } => decoded.lost(lost),
            Step::Rebooted => decoded.rebooted(),
        }
        decoded.reading(Reading {
            sequence: None,
            tick: Tick::Counter(frame.timestamp_us),
            device_counter: frame.timestamp_us,
            status: u32::from(frame.status & UNFIT),
            load: Load::Wrench(Wrench {
                force_n: frame.force_n.map(f64::from),
                moment_nm: frame.torque_nm.map(f64::from),
            }),
        });
    }
}

impl GroundDevice for Bota {
    fn opened(&mut self, now_ns: u64) {
        self.stream.clear();
        self.received.clear();
        self.framing.restart(self.settings.baud);
        self.clock = Clock::default();
        (self.step, self.asked_ns, self.unanswered) = (0, None, 0);
        (self.last_ns, self.silent) = (now_ns, false);
    }

    fn take(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        (self.last_ns, self.silent) = (arrival_ns, false);
        match self.due() {
            None => self.read(bytes, arrival_ns, decoded),
            Some((_, answer)) => {
                if let (Some(rest), None) = (self.receive(bytes, answer), self.due()) {
                    self.stream.clear();
                    self.read(rest, arrival_ns, decoded);
                }
            }
        }
    }

    fn next_action(&mut self, now_ns: u64) -> Action {
        self.silent = now_ns.saturating_sub(self.last_ns) > SILENCE_NS;
        let Some((said, _)) = self.due() else { return Action::Nothing };
        match self.asked_ns {
            Some(asked_ns) if now_ns.saturating_sub(asked_ns) < ANSWER_NS => return Action::Nothing,
            // The sensor may have executed some of the commands: restart the set-up from the first.
            Some(_) if self.step > 0 => {
                (self.step, self.asked_ns, self.unanswered) = (0, None, self.unanswered + 1);
                return self.next_action(now_ns);
            }
            Some(_) => self.unanswered += 1,
            None => {}
        }
        self.asked_ns = Some(now_ns);
        Action::Send(said.into_bytes())
    }

    fn diagnostic(&self) -> Option<String> {
        let baud = self.settings.baud;
        if self.due().is_some() && self.unanswered >= UNANSWERED {
            return Some(format!(
                "the Bota sensor does not answer when it is to be set up: is it on, and does it speak at {baud} baud \
                 ([ground.serial] baud; usually 460800)? Without `sinc` in [ground.bota] it is only listened to"
            ));
        }
        if self.silent {
            return Some(format!(
                "nothing comes from the Bota sensor: look at its power and cable, and whether it speaks at {baud} baud \
                 ([ground.serial] baud; usually 460800). One that was left being set up falls silent: switch it off and on, \
                 or give [ground.bota] a `sinc`"
            ));
        }
        if self.raw {
            let raw = "the Bota sensor sends what its gauges read and no forces: set it to calibrated values, or give \
                       [ground.bota] a `sinc`, with which it is set up so";
            return Some(raw.to_owned());
        }
        if self.clock.stood >= STANDS {
            let stands = "the clock of the Bota sensor stands still, so nothing it sends can be dated: switch it off and on";
            return Some(stands.to_owned());
        }
        self.framing.diagnostic()
    }
}

/// The sensor's clock, which reveals lost frames, as frames have no number.
#[derive(Debug, Clone, Copy, Default)]
struct Clock {
    last_us: Option<u32>,
    lead: Lead,
    period_us: u32,
    alike: u32,
    stood: u32,
}

/// Interpretation of a frame's time.
enum Step {
    Stands,
    Forward { lost: u32 },
    Rebooted,
}

impl Clock {
    fn follow(&mut self, now_us: u32, arrival_ns: u64) -> Step {
        let Some(last_us) = self.last_us.replace(now_us) else {
            self.lead.begin(arrival_ns);
            return Step::Forward { lost: 0 };
        };
        let step_us = now_us.wrapping_sub(last_us);
        if step_us == 0 {
            self.stood = self.stood.saturating_add(1);
            return Step::Stands;
        }
        self.stood = 0;
        // Power cycle: a step back (which appears as a large one forward), or a step longer than the elapsed host time.
        if step_us.cast_signed() < 0 || !self.lead.allows(u64::from(step_us) * 1000, arrival_ns) {
            self.lead.begin(arrival_ns);
            (self.period_us, self.alike) = (0, 0);
            return Step::Rebooted;
        }
        if step_us.abs_diff(self.period_us) <= self.period_us / 10 {
            self.alike = self.alike.saturating_add(1);
        } else if self.alike < STEPS_ALIKE || step_us < self.period_us {
            (self.period_us, self.alike) = (step_us, 0);
        }
        let periods =
            if self.alike < STEPS_ALIKE { 1 } else { (step_us + self.period_us / 2) / self.period_us.max(1) };
        Step::Forward { lost: periods.saturating_sub(1) }
    }
}

#[cfg(test)]
mod tests;
