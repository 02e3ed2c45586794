//! The daemon's own adapters: one thread each, restarted for as long as the daemon runs.

use std::sync::Arc;
use std::time::Instant;

use equipoise_config::Config;
use equipoise_core::message::Incident;

use super::threads::{NamedThread, start_thread};
use crate::incidents::IncidentBoard;
use crate::realtime::RequestedScheduling;
use crate::restart_policy::{Environment, run_with_restarts};
use crate::rings::LoopControl;
use crate::sensors::{self, AdapterError};
use crate::thread_registry::ThreadRegistry;

/// Starts the adapters that run inside the daemon; the first start of each must succeed.
pub(super) fn start(
    config: &Config,
    control: &Arc<LoopControl>,
    thread_registry: &Arc<ThreadRegistry>,
    board: &Arc<IncidentBoard>,
    adapters: &mut Vec<NamedThread>,
) -> anyhow::Result<()> {
    let requested = sensors::requested_scheduling(config);
    if config.reads_suit() {
        let adapter = SupervisedAdapter { name: "suit", down: Incident::SuitAdapterDown, requested };
        let (station, suit) = (config.station.clone(), config.suit.clone());
        let run = move |ready: &mut dyn FnMut(), stopping: &dyn Fn() -> bool| {
            sensors::run_suit(&station, &suit, ready, stopping)
        };
        adapter.start(control, thread_registry, board, adapters, run)?;
    }
    if config.reads_ground() {
        let adapter = SupervisedAdapter { name: "ground", down: Incident::GroundAdapterDown, requested };
        let (station, ground) = (config.station.clone(), config.ground.clone());
        let incidents = Arc::clone(board);
        let run = move |ready: &mut dyn FnMut(), stopping: &dyn Fn() -> bool| {
            let report_fault = |message: Option<&str>| match message {
                Some(message) => incidents.begin(Incident::GroundAdapterDown, message),
                None => incidents.end(Incident::GroundAdapterDown),
            };
            sensors::run_ground(&station, &ground, ready, &report_fault, stopping)
        };
        adapter.start(control, thread_registry, board, adapters, run)?;
    }
    Ok(())
}

/// One adapter of the daemon.
struct SupervisedAdapter {
    name: &'static str,
    down: Incident,
    requested: RequestedScheduling,
}

impl SupervisedAdapter {
    fn start(
        self,
        control: &Arc<LoopControl>,
        thread_registry: &Arc<ThreadRegistry>,
        board: &Arc<IncidentBoard>,
        adapters: &mut Vec<NamedThread>,
        mut run: impl FnMut(&mut dyn FnMut(), &dyn Fn() -> bool) -> Result<(), AdapterError> + Send + 'static,
    ) -> anyhow::Result<()> {
        let (control, board) = (Arc::clone(control), Arc::clone(board));
        let SupervisedAdapter { name, down, requested } = self;
        // The thread's scheduling persists across restarts of its adapter.
        let (thread, ()) = start_thread(name, requested, thread_registry, move |ready| {
            let start_time = Instant::now();
            let stopping = || control.is_stopping();
            let environment = Environment {
                now: &|| start_time.elapsed(),
                wait: &|pause| {
                    let _ = control.stopping().recv_timeout(pause);
                },
                stopping: &stopping,
                down: &|reason| match reason {
                    Some(reason) => board.begin(down, reason),
                    None => board.end(down),
                },
            };
            run_with_restarts(name, &environment, |report_working| {
                run(
                    &mut || {
                        report_working();
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
