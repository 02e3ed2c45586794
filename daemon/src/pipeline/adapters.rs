//! The daemon's own adapters: one thread each, kept running for as long as the daemon runs.

use std::sync::Arc;
use std::time::Instant;

use equipoise_core::message::Incident;

use super::threads::{Other, started};
use crate::config::{Config, GroundSourceKind, SuitSourceKind};
use crate::incidents::IncidentBoard;
use crate::keeper::{World, keep};
use crate::realtime::{self, Asked, ThreadReport};
use crate::rings::Rings;
use crate::sensors::{self, AdapterError};

/// Starts the adapters that the configuration gives to the daemon; the first start of each must succeed.
pub(super) fn start(
    config: &Config,
    rings: &Arc<Rings>,
    board: &Arc<IncidentBoard>,
    adapters: &mut Vec<Other>,
) -> anyhow::Result<Vec<ThreadReport>> {
    let mut reports = Vec::new();
    let asked = sensors::asked(config);
    if config.suit.source == SuitSourceKind::MvnUdp {
        let kept = Kept { name: "suit", down: Incident::SuitAdapterDown, asked };
        let (station, suit) = (config.station.clone(), config.suit.clone());
        let run = move |ready: &mut dyn FnMut(), stopping: &dyn Fn() -> bool| {
            sensors::run_suit(&station, &suit, ready, stopping)
        };
        reports.push(kept.start(rings, board, adapters, run)?);
    }
    if config.ground.source == GroundSourceKind::AtiRdt {
        let kept = Kept { name: "ground", down: Incident::GroundAdapterDown, asked };
        let (station, ground) = (config.station.clone(), config.ground.clone());
        let run = move |ready: &mut dyn FnMut(), stopping: &dyn Fn() -> bool| {
            sensors::run_ground(&station, &ground, ready, stopping)
        };
        reports.push(kept.start(rings, board, adapters, run)?);
    }
    Ok(reports)
}

/// One adapter of the daemon.
struct Kept {
    name: &'static str,
    down: Incident,
    asked: Asked,
}

impl Kept {
    fn start(
        self,
        rings: &Arc<Rings>,
        board: &Arc<IncidentBoard>,
        adapters: &mut Vec<Other>,
        mut run: impl FnMut(&mut dyn FnMut(), &dyn Fn() -> bool) -> Result<(), AdapterError> + Send + 'static,
    ) -> anyhow::Result<ThreadReport> {
        let (rings, board) = (Arc::clone(rings), Arc::clone(board));
        let Kept { name, down, asked } = self;
        let (thread, report) = started(name, move |ready| {
            // The thread's, and so each of its adapter's lives'.
            let mut report = Some(realtime::ask(name, asked));
            let begun = Instant::now();
            let stopping = || rings.is_stopping();
            let world = World {
                now: &|| begun.elapsed(),
                sleep: &std::thread::sleep,
                stopping: &stopping,
                down: &|why| match why {
                    Some(why) => board.begin(down, why),
                    None => board.end(down),
                },
            };
            keep(name, &world, |works| {
                run(
                    &mut || {
                        works();
                        if let Some(report) = report.take() {
                            let _ = ready.send(report);
                        }
                    },
                    &stopping,
                )
            })?;
            Ok(())
        })?;
        adapters.push((name, thread));
        Ok(report)
    }
}
