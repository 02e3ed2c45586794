//! Data that arrive at the suit's port now, or that the running daemon publishes.

use std::time::{Duration, Instant};

use equipoise_adapters::source::survey;
use equipoise_adapters::suit::Survey;
use equipoise_bus::{Bus, BusError, BusSettings};
use equipoise_config::Config;
use equipoise_core::message::{AdapterHealth, SuitSample};
use equipoise_daemon::sensors::SUIT_ROLE;
use equipoise_station::DAEMON_ROLE;
use serde_json::{Value, json};

use super::ports::{Holder, Port, bind_suit, holder_of, holds, port_of, sockets_at};
use super::station::processes_of;

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
    pub observed: SuitObservation,
}

/// Observed data of the suit and their source.
#[derive(Debug, Clone)]
pub enum SuitObservation {
    /// None: observation was impossible. A sentence, unless the only reason is that the port is taken.
    Nothing(Option<String>),
    /// Received at the port itself.
    AtThePort(Box<Survey>),
    /// Received on the bus, from an adapter.
    OnTheBus(Box<BusObservation>),
}

/// Messages of an adapter.
#[derive(Debug, Clone, Default)]
pub struct BusObservation {
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
        let Ok(settings) = config.suit.mvn_settings() else {
            return SuitFacts {
                port: Port::Free,
                holder: None,
                time,
                observed: on_the_bus(bus, time, stopping),
            };
        };
        let (bound, tables) = bind_suit(&config.suit);
        let mut facts =
            SuitFacts { port: port_of(bound), holder: None, time, observed: SuitObservation::Nothing(None) };
        match facts.port {
            Port::Free => {
                facts.observed = match survey(&settings, time, stopping) {
                    Ok(survey) => SuitObservation::AtThePort(Box::new(survey)),
                    Err(error) => SuitObservation::Nothing(Some(error.to_string())),
                }
            }
            Port::InUse | Port::OwnProcess => {
                let sockets = sockets_at(tables, config.suit.listen);
                let participants = bus.as_ref().map(Bus::participants).unwrap_or_else(|_| Ok(vec![]));
                let processes = processes_of(&participants.unwrap_or_default(), &[DAEMON_ROLE, SUIT_ROLE]);
                if holds(&processes, &sockets) {
                    facts.port = Port::OwnProcess;
                    facts.observed = on_the_bus(bus, time, stopping);
                } else {
                    facts.holder = holder_of(&sockets);
                }
            }
            Port::AddressUnavailable => {}
        }
        facts
    }

    /// All counts as JSON.
    pub fn to_json(&self) -> Value {
        let mut facts = json!({ "listened_s": self.time.as_secs_f64(), "holder": self.holder });
        match &self.observed {
            SuitObservation::Nothing(_) => {}
            SuitObservation::AtThePort(survey) => facts["at_the_port"] = survey_json(survey),
            SuitObservation::OnTheBus(observation) => {
                facts["on_the_bus"] = json!({
                    "samples": observation.samples,
                    "avatar": observation.avatar,
                    "received": observation.health.map(|health| health.received),
                    "published": observation.health.map(|health| health.published),
                    "lost": observation.health.map(|health| health.lost),
                });
            }
        }
        facts
    }
}

fn on_the_bus(bus: Result<Bus, BusError>, time: Duration, stopping: &dyn Fn() -> bool) -> SuitObservation {
    match bus.and_then(|bus| observe(&bus, time, stopping)) {
        Ok(observation) => SuitObservation::OnTheBus(Box::new(observation)),
        Err(error) => SuitObservation::Nothing(Some(error.to_string())),
    }
}

fn observe(bus: &Bus, time: Duration, stopping: &dyn Fn() -> bool) -> Result<BusObservation, BusError> {
    let mut samples = bus.subscriber::<SuitSample>(64)?;
    let mut health = bus.subscriber::<AdapterHealth>(8)?;
    let (mut observation, started) = (BusObservation::default(), Instant::now());
    while started.elapsed() < time && !stopping() {
        while let Some(sample) = samples.receive()? {
            observation.samples += 1;
            observation.blocks |= sample.blocks;
            observation.avatar = Some(sample.avatar);
        }
        while let Some(report) = health.receive()? {
            observation.health = Some(report).filter(|report| report.stream == 1).or(observation.health);
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    Ok(observation)
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
                .map(|(kind, stream)| {
                    let counts = json!({
                        "datagrams": stream.datagrams, "bytes": stream.bytes, "items": stream.items,
                        "rate_hz": stream.rate_hz(), "stride": stream.stride(), "lost": stream.lost, "repeated": stream.repeated,
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
