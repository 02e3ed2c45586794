//! Dialogue from an open line to a measuring controller: one command after the other.

use super::TecGihanSettings;
use crate::ground::reading::Decoded;
use crate::ground::refusal::GroundRefusal;
use crate::wire::tec_gihan::{Answer, BAUD, FullScales, Line, PLATES_MAX, State};

const NS_PER_MS: u64 = 1_000_000;
/// Time after a stop in which blocks under way still arrive.
const SETTLE_NS: u64 = 500 * NS_PER_MS;
/// Time in which the plates apply a new range; earlier requests overrun.
const RANGE_NS: u64 = 100 * NS_PER_MS;
/// Timeout of an answer, …
const ANSWER_NS: u64 = 1000 * NS_PER_MS;
/// … and count of attempts of a command.
const TRIES: u32 = 3;
/// Waking takes up to 20 s.
const WAKE_NS: u64 = 20_000 * NS_PER_MS;
const WAKE_STEP_NS: u64 = 200 * NS_PER_MS;
/// Longest answer; a longer line comes from another device or at another speed.
const LINE_MAX: usize = 512;

/// Results of the dialogue.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DialogueResult {
    pub(super) plates: u32,
    pub(super) surface_height_m: Option<f64>,
    pub(super) scales: FullScales,
}

/// The next action.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Next {
    Wait,
    Say(Line),
    Start(DialogueResult),
    GiveUp(String),
}

#[derive(Debug, Clone)]
pub(super) struct Dialogue {
    settings: TecGihanSettings,
    step: Step,
    line: Vec<u8>,
    /// A line that is too long is skipped to its end.
    overlong: bool,
    waking_since_ns: Option<u64>,
    plates: u32,
    serial: u32,
    surface_height_m: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Step {
    Opened,
    /// Input is discarded as outdated; then this command is sent.
    Settling {
        until_ns: Option<u64>,
        pause_ns: u64,
        then: Line,
    },
    Asking {
        line: Line,
        at_ns: u64,
        tries: u32,
    },
    Answered {
        line: Line,
        answer: Answer,
    },
}

impl Dialogue {
    pub(super) fn new(settings: TecGihanSettings) -> Dialogue {
        Dialogue {
            settings,
            step: Step::Opened,
            line: Vec::new(),
            overlong: false,
            waking_since_ns: None,
            plates: 0,
            serial: 0,
            surface_height_m: None,
        }
    }

    /// Collects lines that answer the pending command; discards other input.
    pub(super) fn take(&mut self, bytes: &[u8], decoded: &mut Decoded) {
        for byte in bytes {
            let Step::Asking { line, .. } = self.step else {
                self.line.clear();
                return;
            };
            if *byte != b'\n' {
                if self.line.len() == LINE_MAX && !core::mem::replace(&mut self.overlong, true) {
                    decoded.refuse(GroundRefusal::TooLong);
                }
                if !self.overlong {
                    self.line.push(*byte);
                }
                continue;
            }
            let said = String::from_utf8_lossy(&self.line).into_owned();
            self.line.clear();
            if core::mem::take(&mut self.overlong) {
                continue;
            }
            match line.answer(&said) {
                Some(answer) => self.step = Step::Answered { line, answer },
                None => decoded.refuse(GroundRefusal::Garbage),
            }
        }
    }

    pub(super) fn next(&mut self, now_ns: u64) -> Next {
        match self.step {
            Step::Opened => self.say_and_settle(Line::Stop, SETTLE_NS, Line::State),
            Step::Settling { until_ns: None, pause_ns, then } => {
                self.step = Step::Settling { until_ns: Some(now_ns + pause_ns), pause_ns, then };
                Next::Wait
            }
            Step::Settling { until_ns: Some(until_ns), then, .. } if now_ns >= until_ns => {
                self.ask(then, now_ns, 1)
            }
            Step::Asking { line, at_ns, tries } if now_ns.saturating_sub(at_ns) > ANSWER_NS => {
                self.unanswered(line, tries, now_ns)
            }
            Step::Answered { line, answer } => self.answered(line, answer, now_ns),
            Step::Settling { .. } | Step::Asking { .. } => Next::Wait,
        }
    }

    fn say_and_settle(&mut self, line: Line, pause_ns: u64, then: Line) -> Next {
        self.step = Step::Settling { until_ns: None, pause_ns, then };
        Next::Say(line)
    }

    fn ask(&mut self, line: Line, now_ns: u64, tries: u32) -> Next {
        self.line.clear();
        self.overlong = false;
        self.step = Step::Asking { line, at_ns: now_ns, tries };
        Next::Say(line)
    }

    fn unanswered(&mut self, line: Line, tries: u32, now_ns: u64) -> Next {
        if tries < TRIES {
            return self.ask(line, now_ns, tries + 1);
        }
        // The surface height serves only as a check, so the dialogue continues without it.
        if matches!(line, Line::SurfaceHeight(_)) {
            return self.ask(Line::FullScales(self.serial), now_ns, 1);
        }
        let asked = String::from_utf8(line.to_bytes()).unwrap_or_default();
        Next::GiveUp(format!(
            "Tec Gihan's controller does not answer {}; is ground.serial.port its line, ground.serial.baud its \
             speed (usually {BAUD} baud), is it on, and does nothing else use it?",
            asked.trim()
        ))
    }

    fn answered(&mut self, line: Line, answer: Answer, now_ns: u64) -> Next {
        match (line, answer) {
            (_, Answer::State(state)) => self.state(state, now_ns),
            (Line::SetRate(_), Answer::Done) => {
                self.say_and_settle(Line::SetRange(self.settings.range), RANGE_NS, Line::PlateCount)
            }
            (Line::PlateCount, Answer::Number(plates)) => self.count(plates, now_ns),
            (Line::PlateSerial(_), Answer::Number(serial)) => {
                self.serial = serial;
                self.ask(Line::SurfaceHeight(serial), now_ns, 1)
            }
            (Line::SurfaceHeight(_), Answer::Metres(metres)) => {
                self.surface_height_m = Some(metres.abs());
                self.ask(Line::FullScales(self.serial), now_ns, 1)
            }
            (_, Answer::FullScales(scales)) => Next::Start(DialogueResult {
                plates: self.plates,
                surface_height_m: self.surface_height_m,
                scales,
            }),
            // No command has an answer of another kind.
            (_, Answer::Done | Answer::Number(_) | Answer::Metres(_)) => {
                Next::GiveUp("no answer fits".to_owned())
            }
        }
    }

    fn state(&mut self, state: State, now_ns: u64) -> Next {
        match state {
            State::Idle => self.ask(Line::SetRate(self.settings.rate), now_ns, 1),
            State::Busy => self.say_and_settle(Line::Stop, SETTLE_NS, Line::State),
            State::Error => Next::GiveUp(
                "Tec Gihan's controller reports an error of its own: switch it off and on, with the plates connected"
                    .to_owned(),
            ),
            State::Sleeping => match self.waking_since_ns {
                None => {
                    self.waking_since_ns = Some(now_ns);
                    self.say_and_settle(Line::Wake, WAKE_STEP_NS, Line::State)
                }
                Some(since_ns) if now_ns.saturating_sub(since_ns) < WAKE_NS => {
                    self.step = Step::Settling { until_ns: None, pause_ns: WAKE_STEP_NS, then: Line::State };
                    Next::Wait
                }
                Some(_) => Next::GiveUp("Tec Gihan's controller sleeps and does not wake up".to_owned()),
            },
        }
    }

    fn count(&mut self, plates: u32, now_ns: u64) -> Next {
        let wanted = self.settings.plate;
        if !(1..=PLATES_MAX).contains(&plates) || wanted > plates {
            return Next::GiveUp(format!(
                "Tec Gihan's controller has {plates} plates, and number {wanted} is asked for: set \
                 ground.tec_gihan.plate, or check the plates' cables"
            ));
        }
        self.plates = plates;
        self.ask(Line::PlateSerial(wanted - 1), now_ns, 1)
    }
}
