//! Qualisys Track Manager (QTM): extracts the forces of one plate from its frames, and issues the commands that start
//! them.
//!
//! QTM reports the force on the plate (its manual: "the actual force on the force-plate"), in the plate's own axes with
//! z down or in the laboratory's, depending on the project's settings; `[ground.frame]` must declare which.

mod pace;

use self::pace::Pace;
use super::{GroundDevice, Want};
use crate::ground::frame::Wrench;
use crate::ground::reading::{Load, Reading, Taken, Tick};
use crate::ground::refusal::GroundRefusal;
use crate::wire::qtm::{Cutter, Event, Frame, Malformed, Packet, PlateForce, VERSION, command};

const NS_PER_S: u64 = 1_000_000_000;
/// Timeout of QTM's answer to a text command.
const ANSWER_NS: u64 = 3 * NS_PER_S;
/// Without a frame for this long, frames are requested again: QTM drops the request when a measurement ends.
const ASK_AGAIN_NS: u64 = 2 * NS_PER_S;
/// Below this force the point of application is mostly noise, N.
const CHECKED_ABOVE_N: f64 = 100.0;
/// Tolerance between moment and point, N m, in addition to a fiftieth of the moment.
const CONTRADICTION_NM: f64 = 5.0;
/// This many contradictory forces in a row are reported.
const CONTRADICTIONS: u32 = 100;

/// Selection of forces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QtmSettings {
    /// The plate's number in QTM, from 1.
    pub plate: u32,
    /// 1: every force sample of the plate; n: the force sample of every n-th camera frame.
    pub divisor: u32,
}

/// QTM at the other end of a TCP connection.
#[derive(Debug, Clone)]
pub struct Qtm {
    settings: QtmSettings,
    cutter: Cutter,
    step: Step,
    pace: Pace,
    /// Why no data arrive: QTM's message or the decoder's own.
    trouble: Option<String>,
    /// QTM's last error message.
    refusal: Option<String>,
    /// The stream can no longer be decoded.
    broken: Option<Malformed>,
    contradictions: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// Connected, no command sent yet.
    Connected,
    /// The version was requested.
    AskedVersion { at_ns: u64 },
    /// The version was accepted.
    Agreed,
    /// Frames were requested or arrive.
    Streaming { since_ns: u64 },
}

impl Qtm {
    /// A QTM connection before any command.
    pub fn new(settings: QtmSettings) -> Qtm {
        Qtm {
            settings,
            cutter: Cutter::default(),
            step: Step::Connected,
            pace: Pace::new(settings.divisor),
            trouble: None,
            refusal: None,
            broken: None,
            contradictions: 0,
        }
    }

    fn text(&mut self, text: &str) {
        if let Step::AskedVersion { .. } = self.step
            && text.to_ascii_lowercase().starts_with("version set to")
        {
            self.step = Step::Agreed;
        }
    }

    fn refused(&mut self, text: &str) {
        self.refusal = Some(text.to_owned());
        self.trouble = Some(format!("Qualisys' track manager refuses: {text}"));
    }

    fn event(&mut self, event: Event) {
        match event {
            Event::Started if matches!(self.step, Step::Streaming { .. }) => self.step = Step::Agreed,
            Event::Stopped => self.nothing_measured(),
            Event::ShuttingDown => self.trouble = Some("Qualisys' track manager is being closed".to_owned()),
            Event::Started | Event::Other(_) => {}
        }
    }

    fn nothing_measured(&mut self) {
        self.trouble = Some(
            "Qualisys' track manager measures nothing: open a preview (Capture > New) or start a capture, with the \
             force plate switched on in Project options"
                .to_owned(),
        );
    }

    fn frame(&mut self, frame: &Frame<'_>, arrival_ns: u64, taken: &mut Taken) {
        self.step = Step::Streaming { since_ns: arrival_ns };
        let forces = match frame.plate(self.settings.plate) {
            Ok(Some(forces)) => forces,
            Ok(None) => {
                self.trouble = Some(self.no_such_plate(&frame.plates()));
                taken.refuse(GroundRefusal::UnknownKind);
                return;
            }
            Err(_) => {
                taken.refuse(GroundRefusal::Length);
                return;
            }
        };
        self.trouble = None;
        let first = forces.first.unwrap_or(frame.number);
        let forces: Vec<PlateForce> = forces.forces().collect();
        for force in &forces {
            self.check(force);
        }
        for due in self.pace.frame(frame, first, forces, taken) {
            taken.reading(reading(&due.force, due.time_ns, due.counter));
        }
    }

    fn no_such_plate(&self, there: &[u32]) -> String {
        let wanted = self.settings.plate;
        if there.is_empty() {
            "Qualisys' track manager measures no force plate: add it under Project options > Force data"
                .to_owned()
        } else {
            let there: Vec<String> = there.iter().map(u32::to_string).collect();
            format!(
                "Qualisys' track manager has no force plate {wanted} but {}: set ground.qtm.plate",
                there.join(", ")
            )
        }
    }

    /// The moment minus that of the force at its point must be a free moment about the vertical, in any axes; otherwise
    /// moment and point have different origins.
    fn check(&mut self, force: &PlateForce) {
        let [fx, fy, fz] = force.force_n.map(f64::from);
        let [mx, my, _] = force.moment_nm.map(f64::from);
        let [px, py, pz] = force.point_mm.map(|mm| f64::from(mm) * 1e-3);
        if fz.abs() < CHECKED_ABOVE_N || (px == 0.0 && py == 0.0) || !(px + py + pz).is_finite() {
            return;
        }
        let off_nm = (mx - (py * fz - pz * fy)).hypot(my - (pz * fx - px * fz));
        let contradicts = off_nm > CONTRADICTION_NM + mx.hypot(my) / 50.0;
        self.contradictions = if contradicts { self.contradictions.saturating_add(1) } else { 0 };
    }
}

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
        self.cutter.clear();
        self.step = Step::Connected;
        self.pace.forget();
        // The fault remains until a valid frame arrives.
        (self.broken, self.contradictions) = (None, 0);
    }

    fn take(&mut self, bytes: &[u8], arrival_ns: u64, taken: &mut Taken) {
        let mut cutter = core::mem::take(&mut self.cutter);
        cutter.push(bytes);
        while let Some(packet) = cutter.next_packet() {
            match packet {
                Ok(Packet::Frame(frame)) => self.frame(&frame, arrival_ns, taken),
                Ok(Packet::Text(text)) => self.text(text),
                Ok(Packet::Error(text)) => self.refused(text),
                Ok(Packet::Event(event)) => self.event(event),
                Ok(Packet::NoMoreData) => self.nothing_measured(),
                Ok(Packet::Other(_)) => taken.refuse(GroundRefusal::UnknownKind),
                Err(error @ Malformed::Size { .. }) => {
                    self.broken = Some(error);
                    taken.refuse(GroundRefusal::Garbage);
                }
                Err(_) => taken.refuse(GroundRefusal::Length),
            }
        }
        self.cutter = cutter;
    }

    fn wants(&mut self, now_ns: u64) -> Want {
        if let Some(broken) = self.broken {
            let why = format!("{broken}; check ground.address");
            self.trouble = Some(why.clone());
            return Want::Reopen(why);
        }
        match self.step {
            Step::Connected => {
                self.step = Step::AskedVersion { at_ns: now_ns };
                Want::Send(command(&format!("Version {VERSION}")))
            }
            Step::AskedVersion { at_ns } if now_ns.saturating_sub(at_ns) > ANSWER_NS => {
                let said = self.refusal.take().unwrap_or_else(|| "it does not answer".to_owned());
                let why = format!(
                    "no agreement on version {VERSION} of Qualisys' protocol: {said}; is ground.address that of a QTM of \
                     2021 or later?"
                );
                self.trouble = Some(why.clone());
                Want::Reopen(why)
            }
            Step::Agreed => {
                self.step = Step::Streaming { since_ns: now_ns };
                Want::Send(command(&match self.settings.divisor {
                    1 => "StreamFrames AllFrames Force".to_owned(),
                    divisor => format!("StreamFrames FrequencyDivisor:{divisor} ForceSingle"),
                }))
            }
            Step::Streaming { since_ns } if now_ns.saturating_sub(since_ns) > ASK_AGAIN_NS => {
                self.step = Step::Agreed;
                if self.trouble.is_none() {
                    self.nothing_measured();
                }
                self.wants(now_ns)
            }
            Step::AskedVersion { .. } | Step::Streaming { .. } => Want::Nothing,
        }
    }

    fn farewell(&mut self) -> Option<Vec<u8>> {
        Some(command("StreamFrames Stop"))
    }

    fn trouble(&self) -> Option<String> {
        let contradicts = (self.contradictions >= CONTRADICTIONS).then(|| {
            "moment and application point of the plate contradict each other: they are counted from different origins; \
             correct the plate's origin and corners in QTM's Project options"
                .to_owned()
        });
        self.trouble.clone().or(contradicts)
    }
}

#[cfg(test)]
mod tests;
