//! The daemon's own adapters: one thread each, restarted for as long as the daemon runs.

use std::sync::Arc;
use std::time::Instant;

use equipoise_core::message::Incident;

use super::threads::{Other, started};
use crate::config::Config;
use crate::incidents::IncidentBoard;
use crate::keeper::{World, keep};
use crate::realtime::Asked;
use crate::rings::Rings;
use crate::roster::Roster;
use crate::sensors::{self, AdapterError};

/// Starts the adapters that run inside the daemon; the first start of each must succeed.
pub(super) fn start(
    config: &Config,
    rings: &Arc<Rings>,
    roster: &Arc<Roster>,
    board: &Arc<IncidentBoard>,
    adapters: &mut Vec<Other>,
) -> anyhow::Result<()> {
    let asked = sensors::asked(config);
    if config.reads_suit() {
        let kept = Kept { name: "suit", down: Incident::SuitAdapterDown, asked };
        let (station, suit) = (config.station.clone(), config.suit.clone());
        let run = move |ready: &mut dyn FnMut(), stopping: &dyn Fn() -> bool| {
            sensors::run_suit(&station, &suit, ready, stopping)
        };
        kept.start(rings, roster, board, adapters, run)?;
    }
    if config.reads_ground() {
        let kept = Kept { name: "ground", down: Incident::GroundAdapterDown, asked };
        let (station, ground) = (config.station.clone(), config.ground.clone());
        let incidents = Arc::clone(board);
        let run = move |ready: &mut dyn FnMut(), stopping: &dyn Fn() -> bool| {
            let trouble = |sentence: Option<&str>| match sentence {
                Some(sentence) => incidents.begin(Incident::GroundAdapterDown, sentence),
                None => incidents.end(Incident::GroundAdapterDown),
            };
            sensors::run_ground(&station, &ground, ready, &trouble, stopping)
        };
        kept.start(rings, roster, board, adapters, run)?;
    }
    Ok(())
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
        roster: &Arc<Roster>,
        board: &Arc<IncidentBoard>,
        adapters: &mut Vec<Other>,
        mut run: impl FnMut(&mut dyn FnMut(), &dyn Fn() -> bool) -> Result<(), AdapterError> + Send + 'static,
    ) -> anyhow::Result<()> {
        let (rings, board) = (Arc::clone(rings), Arc::clone(board));
        let Kept { name, down, asked } = self;
        // The thread's scheduling persists across restarts of its adapter.
        let (thread, ()) = started(name, asked, roster, move |ready| {
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
                        // Only the first start has a receiver; later ones fail to send.
                        let _ = ready.send(());
                    },
                    &stopping,
                )
            })?;
            Ok(())
        })?;
        adapters.push((name, thread));
        Ok(())
    }
}
