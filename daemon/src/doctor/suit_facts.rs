//! Data that arrive at the suit's port now, or that the running daemon publishes.

use std::time::{Duration, Instant};

use equipoise_adapters::source::survey;
use equipoise_adapters::suit::Survey;
use equipoise_bus::{Bus, BusError, BusSettings};
use equipoise_core::message::{AdapterHealth, SuitSample};
use serde_json::{Value, json};

use super::ports::{Holder, Port, holder_of, holds, port_of, sockets_at, suit_door};
use super::station::processes_of;
use crate::config::Config;
use crate::pipeline::DAEMON_ROLE;
use crate::sensors::{SUIT_ROLE, mvn_settings};

/// Observations of the suit.
#[derive(Debug, Clone)]
pub struct SuitFacts {
    /// State of the port.
    pub port: Port,
    /// Process that uses the port, if another one does and is visible.
    pub holder: Option<Holder>,
    /// Observation time.
    pub time: Duration,
    /// Observed data.
    pub heard: Heard,
}

/// Observed data of the suit and their source.
#[derive(Debug, Clone)]
pub enum Heard {
    /// None: observation was impossible. A sentence, unless the only reason is that the port is taken.
    Nowhere(Option<String>),
    /// Received at the port itself.
    AtThePort(Box<Survey>),
    /// Received on the bus, from an adapter.
    OnTheBus(Box<BusWord>),
}

/// Messages of an adapter.
#[derive(Debug, Clone, Default)]
pub struct BusWord {
    /// Number of samples.
    pub samples: u64,
    /// Union of their optional blocks.
    pub blocks: u32,
    /// Their character.
    pub avatar: Option<u32>,
    /// The last health message.
    pub health: Option<AdapterHealth>,
}

impl SuitFacts {
    /// Receives at the suit's port for `time`; on the bus if a process of the station uses the port or the samples come
    /// from another process.
    pub fn gather(config: &Config, time: Duration, stopping: &dyn Fn() -> bool) -> SuitFacts {
        let bus = Bus::join(&BusSettings::new(&config.station, "doctor"));
        let Ok(settings) = mvn_settings(&config.suit) else {
            return SuitFacts {
                port: Port::Free,
                holder: None,
                time,
                heard: on_the_bus(bus, time, stopping),
            };
        };
        let (bound, tables) = suit_door(&config.suit);
        let mut facts = SuitFacts { port: port_of(bound), holder: None, time, heard: Heard::Nowhere(None) };
        match facts.port {
            Port::Free => {
                facts.heard = match survey(&settings, time, stopping) {
                    Ok(survey) => Heard::AtThePort(Box::new(survey)),
                    Err(error) => Heard::Nowhere(Some(error.to_string())),
                }
            }
            Port::Taken | Port::Ours => {
                let sockets = sockets_at(tables, config.suit.listen);
                let participants = bus.as_ref().map(Bus::participants).unwrap_or_else(|_| Ok(vec![]));
                let processes = processes_of(&participants.unwrap_or_default(), &[DAEMON_ROLE, SUIT_ROLE]);
                if holds(&processes, &sockets) {
                    facts.port = Port::Ours;
                    facts.heard = on_the_bus(bus, time, stopping);
                } else {
                    facts.holder = holder_of(&sockets);
                }
            }
            Port::NotOurs => {}
        }
        facts
    }

    /// All counts as JSON.
    pub fn to_json(&self) -> Value {
        let mut facts = json!({ "listened_s": self.time.as_secs_f64(), "holder": self.holder });
        match &self.heard {
            Heard::Nowhere(_) => {}
            Heard::AtThePort(survey) => facts["at_the_port"] = survey_json(survey),
            Heard::OnTheBus(word) => {
                facts["on_the_bus"] = json!({
                    "samples": word.samples,
                    "avatar": word.avatar,
                    "received": word.health.map(|health| health.received),
                    "published": word.health.map(|health| health.published),
                    "lost": word.health.map(|health| health.lost),
                });
            }
        }
        facts
    }
}

fn on_the_bus(bus: Result<Bus, BusError>, time: Duration, stopping: &dyn Fn() -> bool) -> Heard {
    match bus.and_then(|bus| listen(&bus, time, stopping)) {
        Ok(word) => Heard::OnTheBus(Box::new(word)),
        Err(error) => Heard::Nowhere(Some(error.to_string())),
    }
}

fn listen(bus: &Bus, time: Duration, stopping: &dyn Fn() -> bool) -> Result<BusWord, BusError> {
    let mut samples = bus.subscriber::<SuitSample>(64)?;
    let mut health = bus.subscriber::<AdapterHealth>(8)?;
    let (mut word, begun) = (BusWord::default(), Instant::now());
    while begun.elapsed() < time && !stopping() {
        while let Some(sample) = samples.receive()? {
            word.samples += 1;
            word.blocks |= sample.blocks;
            word.avatar = Some(sample.avatar);
        }
        while let Some(report) = health.receive()? {
            word.health = Some(report).filter(|report| report.stream == 1).or(word.health);
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    Ok(word)
}

fn survey_json(survey: &Survey) -> Value {
    let addresses = |counts: &std::collections::BTreeMap<std::net::IpAddr, u64>| -> Value {
        counts.iter().map(|(address, count)| (address.to_string(), json!(count))).collect()
    };
    let characters: Vec<Value> = survey
        .characters
        .iter()
        .map(|(avatar, character)| {
            let types: serde_json::Map<String, Value> = character
                .types
                .iter()
                .map(|(kind, seen)| {
                    let counts = json!({
                        "datagrams": seen.datagrams, "bytes": seen.bytes, "items": seen.items,
                        "rate_hz": seen.rate_hz(), "stride": seen.stride(), "lost": seen.lost, "repeated": seen.repeated,
                    });
                    (kind.to_string(), counts)
                })
                .collect();
            let refused: serde_json::Map<String, Value> =
                character.refused().map(|(reason, count)| (reason.name().to_owned(), json!(count))).collect();
            json!({
                "avatar": avatar, "name": character.name(), "object": character.is_object(), "types": types,
                "suit_rate_hz": character.suit_rate_hz(), "refused": refused,
                "props": character.layout().map(|layout| layout.props),
                "fingers": character.layout().map(|layout| layout.fingers),
            })
        })
        .collect();
    json!({
        "senders": addresses(&survey.senders), "turned_away": addresses(&survey.turned_away), "texts": survey.texts,
        "unreadable": survey.unreadable, "bytes": survey.bytes, "characters": characters,
    })
}
