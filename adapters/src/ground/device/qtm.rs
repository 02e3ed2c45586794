//! Qualisys Track Manager (QTM): extracts the wrench of one force plate from its frames, and issues the commands of the
//! real-time protocol that start them.
//!
//! Input is the byte stream of a TCP connection. Outputs are one reading per force (force in N, moment about the
//! sensor's origin in N m, QTM's time in ns), and a message with the remedy while no data arrive.
//!
//! QTM reports the force on the plate (its manual: "the actual force on the force-plate"), in the plate's own axes with
//! z down or in the laboratory's, depending on the project's settings; `[ground.frame]` must declare which.

mod pace;

use self::pace::Pace;
use super::{Action, GroundDevice};
use crate::ground::frame::Wrench;
use crate::ground::reading::{Decoded, Load, Reading, Tick};
use crate::ground::refusal::GroundRefusal;
use crate::wire::qtm::{Deframer, Event, Frame, Malformed, Packet, PlateForce, VERSION, command};

const NS_PER_S: u64 = 1_000_000_000;
/// Timeout of QTM's answer to a text command, ns.
const ANSWER_NS: u64 = 3 * NS_PER_S;
/// Without a frame for this long, frames are requested again, ns: QTM drops the request when a measurement ends.
const REQUEST_AGAIN_NS: u64 = 2 * NS_PER_S;
/// Minimum vertical force for the check of moment and point, N: below it the point of application is mostly noise.
const CHECK_FORCE_MIN_N: f64 = 100.0;
/// Tolerance between moment and point, N m, in addition to a fiftieth of the moment.
const CONTRADICTION_NM: f64 = 5.0;
/// Number of consecutive contradictory forces that is reported.
const CONTRADICTIONS_MIN: u32 = 100;

/// Selection of forces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QtmSettings {
    /// The plate's number in QTM, from 1.
    pub plate: u32,
    /// 1: every force sample of the plate; n: the force sample of every n-th camera frame.
    pub divisor: u32,
}

/// Decoder and state machine of one connection to QTM.
#[derive(Debug, Clone)]
pub struct Qtm {
    settings: QtmSettings,
    deframer: Deframer,
    step: Step,
    pace: Pace,
    /// Cause and remedy while no data arrive: QTM's message or the decoder's own.
    diagnostic: Option<String>,
    /// QTM's last error message.
    refusal: Option<String>,
    /// The stream can no longer be decoded.
    broken: Option<Malformed>,
    /// Consecutive forces whose moment and point of application contradict each other.
    contradictions: u32,
}

/// State of the exchange with QTM; times in ns of CLOCK_MONOTONIC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// Connected, no command sent yet.
    Connected,
    /// The protocol version was requested at `at_ns`.
    VersionRequested { at_ns: u64 },
    /// The version was accepted; frames are requested next.
    VersionAccepted,
    /// Frames were requested, or the newest one arrived, at `since_ns`.
    Streaming { since_ns: u64 },
}

impl Qtm {
    /// A QTM connection before any command.
    pub fn new(settings: QtmSettings) -> Qtm {
        Qtm {
            settings,
            deframer: Deframer::default(),
            step: Step::Connected,
            pace: Pace::new(settings.divisor),
            diagnostic: None,
            refusal: None,
            broken: None,
            contradictions: 0,
        }
    }

    /// Processes the answer to a text command.
    fn text(&mut self, text: &str) {
        if let Step::VersionRequested { .. } = self.step
            && text.to_ascii_lowercase().starts_with("version set to")
        {
            self.step = Step::VersionAccepted;
        }
    }

    /// Processes an error packet.
    fn refused(&mut self, text: &str) {
        self.refusal = Some(text.to_owned());
        self.diagnostic = Some(format!("Qualisys' track manager refuses: {text}"));
    }

    /// Processes an event: begin or end of a measurement, shutdown of QTM.
    fn event(&mut self, event: Event) {
        match event {
            Event::Started if matches!(self.step, Step::Streaming { .. }) => {
                self.step = Step::VersionAccepted;
            }
            Event::Stopped => self.nothing_measured(),
            Event::ShuttingDown => {
                self.diagnostic = Some("Qualisys' track manager is being closed".to_owned());
            }
            Event::Started | Event::Other(_) => {}
        }
    }

    /// Sets the fault of a QTM that does not measure.
    fn nothing_measured(&mut self) {
        self.diagnostic = Some(
            "Qualisys' track manager measures nothing: open a preview (Capture > New) or start a capture, with the \
             force plate switched on in Project options"
                .to_owned(),
        );
    }

    /// Converts the forces of a frame to readings.
    fn frame(&mut self, frame: &Frame<'_>, arrival_ns: u64, decoded: &mut Decoded) {
        self.step = Step::Streaming { since_ns: arrival_ns };
        let forces = match frame.plate(self.settings.plate) {
            Ok(Some(forces)) => forces,
            Ok(None) => {
                self.diagnostic = Some(self.plate_missing(&frame.plates()));
                decoded.refuse(GroundRefusal::UnknownKind);
                return;
            }
            Err(_) => {
                decoded.refuse(GroundRefusal::Length);
                return;
            }
        };
        self.diagnostic = None;
        let first = forces.first.unwrap_or(frame.number);
        let forces: Vec<PlateForce> = forces.forces().collect();
        for force in &forces {
            self.check_moment(force);
        }
        for due in self.pace.frame(frame, first, forces, decoded) {
            decoded.reading(reading(&due.force, due.time_ns, due.counter));
        }
    }

    /// Message for a frame without the configured plate; `available`: numbers of its plates.
    fn plate_missing(&self, available: &[u32]) -> String {
        let wanted = self.settings.plate;
        if available.is_empty() {
            "Qualisys' track manager measures no force plate: add it under Project options > Force data"
                .to_owned()
        } else {
            let available: Vec<String> = available.iter().map(u32::to_string).collect();
            format!(
                "Qualisys' track manager has no force plate {wanted} but {}: set ground.qtm.plate",
                available.join(", ")
            )
        }
    }

    /// Counts consecutive forces whose moment contradicts the point of application: the moment (N m) minus that of the
    /// force (N) at its point (m) must be a free moment about the vertical, in any axes; otherwise moment and point
    /// refer to different origins.
    fn check_moment(&mut self, force: &PlateForce) {
        let [fx, fy, fz] = force.force_n.map(f64::from);
        let [mx, my, _] = force.moment_nm.map(f64::from);
        let [px, py, pz] = force.point_mm.map(|mm| f64::from(mm) * 1e-3);
        if fz.abs() < CHECK_FORCE_MIN_N || (px == 0.0 && py == 0.0) || !(px + py + pz).is_finite() {
            return;
        }
        let horizontal_nm = (mx - (py * fz - pz * fy)).hypot(my - (pz * fx - px * fz));
        let contradicts = horizontal_nm > CONTRADICTION_NM + mx.hypot(my) / 50.0;
        self.contradictions = if contradicts { self.contradictions.saturating_add(1) } else { 0 };
    }
}

/// The reading of one force, at a time of QTM's clock.
fn reading(force: &PlateForce, time_ns: u64, counter: u32) -> Reading {
    Reading {
        sequence: None,
        tick: Tick::Time(time_ns),
        device_counter: counter,
        status: 0,
        load: Load::Wrench(Wrench {
            force_n: force.force_n.map(f64::from),
            moment_nm: force.moment_nm.map(f64::from),
        }),
    }
}

impl GroundDevice for Qtm {
    fn opened(&mut self, _now_ns: u64) {
        self.deframer.clear();
        self.step = Step::Connected;
        self.pace.reset();
        // The fault remains until a valid frame arrives.
        (self.broken, self.contradictions) = (None, 0);
    }

    fn take(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        let mut deframer = core::mem::take(&mut self.deframer);
        deframer.push(bytes);
        while let Some(packet) = deframer.next_packet() {
            match packet {
                Ok(Packet::Frame(frame)) => self.frame(&frame, arrival_ns, decoded),
                Ok(Packet::Text(text)) => self.text(text),
                Ok(Packet::Error(text)) => self.refused(text),
                Ok(Packet::Event(event)) => self.event(event),
                Ok(Packet::NoMoreData) => self.nothing_measured(),
                Ok(Packet::Other(_)) => decoded.refuse(GroundRefusal::UnknownKind),
                Err(error @ Malformed::Size { .. }) => {
                    self.broken = Some(error);
                    decoded.refuse(GroundRefusal::Garbage);
                }
                Err(_) => decoded.refuse(GroundRefusal::Length),
            }
        }
        self.deframer = deframer;
    }

    fn next_action(&mut self, now_ns: u64) -> Action {
        if let Some(broken) = self.broken {
            let why = format!("{broken}; check ground.address");
            self.diagnostic = Some(why.clone());
            return Action::Reopen(why);
        }
        match self.step {
            Step::Connected => {
                self.step = Step::VersionRequested { at_ns: now_ns };
                Action::Send(command(&format!("Version {VERSION}")))
            }
            Step::VersionRequested { at_ns } if now_ns.saturating_sub(at_ns) > ANSWER_NS => {
                let answer = self.refusal.take().unwrap_or_else(|| "it does not answer".to_owned());
                let why = format!(
                    "no agreement on version {VERSION} of Qualisys' protocol: {answer}; is ground.address that of a QTM of \
                     2021 or later?"
                );
                self.diagnostic = Some(why.clone());
                Action::Reopen(why)
            }
            Step::VersionAccepted => {
                self.step = Step::Streaming { since_ns: now_ns };
                Action::Send(command(&match self.settings.divisor {
                    1 => "StreamFrames AllFrames Force".to_owned(),
                    divisor => format!("StreamFrames FrequencyDivisor:{divisor} ForceSingle"),
                }))
            }
            Step::Streaming { since_ns } if now_ns.saturating_sub(since_ns) > REQUEST_AGAIN_NS => {
                self.step = Step::VersionAccepted;
                if self.diagnostic.is_none() {
                    self.nothing_measured();
                }
                self.next_action(now_ns)
            }
            Step::VersionRequested { .. } | Step::Streaming { .. } => Action::Nothing,
        }
    }

    fn close_command(&mut self) -> Option<Vec<u8>> {
        Some(command("StreamFrames Stop"))
    }

    fn diagnostic(&self) -> Option<String> {
        let contradicts = (self.contradictions >= CONTRADICTIONS_MIN).then(|| {
            "moment and application point of the plate contradict each other: they are counted from different origins; \
             correct the plate's origin and corners in QTM's Project options"
                .to_owned()
        });
        self.diagnostic.clone().or(contradicts)
    }
}

#[cfg(test)]
mod tests;
