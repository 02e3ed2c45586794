//! The daemon's threads: started in the order of the data flow and ended in the same order, so that all results are
//! published.

mod adapters;
mod privileges;
mod reload;
mod restored;
mod start;
mod threads;

use std::net::SocketAddr;
use std::sync::Arc;
use std::thread::JoinHandle;

use anyhow::{Context, anyhow};
use crossbeam_channel::{Sender, TryRecvError, bounded};
use equipoise_bus::{Bus, BusError, BusSettings};
use equipoise_config::Config;
use equipoise_latency::Report;
use equipoise_station::DAEMON_ROLE;
use equipoise_station::process_state::is_stopped;
use equipoise_station::state_directory::StateDirectory;
use equipoise_station::status;

use crate::active_configuration::{ActiveConfiguration, SharedConfiguration};
use crate::commands::Commands;
use crate::incidents::IncidentBoard;
use crate::realtime::{RequestedScheduling, ThreadReport};
use crate::rings::{CommandEnds, LoopControl, Rings};
use crate::similar::similar_to_configured;
use crate::status_file::StatusFile;
use crate::subjects::{ProfileDestination, Subjects};
use crate::thread_registry::ThreadRegistry;
use crate::tick::{LoopSummary, NoObserver, Observer};

use self::restored::Restored;
use self::start::{Owned, Start};
use self::threads::{Running, Shared, start_thread};

/// Threads without deadlines request the ordinary scheduler.
const ORDINARY: RequestedScheduling = RequestedScheduling { fifo_priority: 0, cpu: None };

/// A running daemon.
pub struct Pipeline {
    control: Arc<LoopControl>,
    active_configuration: Arc<SharedConfiguration>,
    board: Arc<IncidentBoard>,
    running: Running,
    status: StatusFile,
    thread_registry: Arc<ThreadRegistry>,
}

/// Serves the metrics of a station at an address until stopped, and sends the actual address. It is an ordinary consumer of
/// the bus; the caller provides it, because this crate links no HTTP server.
pub type ServeMetrics = fn(&str, SocketAddr, &Sender<SocketAddr>, &dyn Fn() -> bool) -> anyhow::Result<()>;

/// Statistics of a daemon's run.
#[derive(Debug, Clone)]
pub struct Summary {
    /// Summary of the loop.
    pub cycles: LoopSummary,
    /// Latencies by stage.
    pub latency: Report,
    /// Requested and granted scheduling of each thread.
    pub threads: Vec<ThreadReport>,
}

impl Pipeline {
    /// Starts all components that a configuration enables.
    ///
    /// # Errors
    /// Another daemon runs on this station, a port is taken, or real-time scheduling is refused under `strict`.
    pub fn start(config: &Config) -> anyhow::Result<Pipeline> {
        Pipeline::start_with(config, Box::new(NoObserver), None)
    }

    /// As [`Pipeline::start`]; `serve` serves the configured metrics, unless they are a process of their own.
    ///
    /// # Errors
    /// As [`Pipeline::start`].
    pub fn start_serving(config: &Config, serve: Option<ServeMetrics>) -> anyhow::Result<Pipeline> {
        Pipeline::start_with(config, Box::new(NoObserver), serve)
    }

    /// As [`Pipeline::start`], with an observer inside the loop.
    ///
    /// # Errors
    /// As [`Pipeline::start`].
    pub fn start_observed(config: &Config, observer: Box<dyn Observer>) -> anyhow::Result<Pipeline> {
        Pipeline::start_with(config, observer, None)
    }

    fn start_with(
        config: &Config,
        observer: Box<dyn Observer>,
        serve_metrics: Option<ServeMetrics>,
    ) -> anyhow::Result<Pipeline> {
        let state = StateDirectory::of_environment()?;
        let Rings {
            control,
            loop_ends,
            ingress,
            egress,
            saving,
            commands: command_ends,
            settings: settings_sender,
        } = Rings::new().context("no event file descriptor is to be had")?;
        let memory_lock = privileges::lock_memory(config)?;
        let thread_registry = Arc::new(ThreadRegistry::default());
        thread_registry.request("main", ORDINARY);
        let (commands, shared_sender) = start_commands(&config.station, command_ends, &thread_registry)?;
        // This daemon owns the station: no other process writes the files read from here on.
        let similar = similar_to_configured(config, &state);
        let mut active = ActiveConfiguration { config: config.clone(), loaded: None, similar };
        let subject = &config.subject;
        let configured =
            ProfileDestination::of(&state, &subject.id, Some(subject.build()), subject.save_profile);
        let subjects = Arc::new(Subjects::new(state, &config.station, configured));
        let restored = Restored::find(&mut active, &subjects);
        let active_configuration = Arc::new(SharedConfiguration::new(active, settings_sender));
        // Threads are running from here on: a failure must end them and wait until they have left the bus.
        let mut running = Running::with_commands(commands, shared_sender);
        let board = Arc::new(IncidentBoard::default());
        let start = Start {
            config,
            control: &control,
            thread_registry: &thread_registry,
            active_configuration: &active_configuration,
            board: &board,
            subjects,
            memory_lock,
        };
        let ends = (loop_ends, ingress, egress, saving);
        match start.start_remaining(Owned { ends, restored, observer, serve_metrics }, &mut running) {
            Ok(status) => {
                Ok(Pipeline { control, active_configuration, board, running, status, thread_registry })
            }
            Err(error) => {
                control.stop();
                // Return the first error.
                let _ = running.join(|| {});
                // Housekeeping may have written the file again.
                status::remove(&config.station);
                Err(error)
            }
        }
    }

    /// Requested and granted scheduling of each thread.
    pub fn threads(&self) -> Vec<ThreadReport> {
        self.thread_registry.reports()
    }

    /// Number of the newest cycle.
    pub fn last_cycle(&self) -> u64 {
        self.control.last_cycle()
    }

    /// Whether every thread is running.
    pub fn is_running(&self) -> bool {
        self.running.is_running()
    }

    /// Ends every thread and returns the statistics.
    ///
    /// # Errors
    /// The error that ended a thread, if any.
    pub fn stop(self) -> anyhow::Result<Summary> {
        self.control.stop();
        // Housekeeping, which rewrites the file, has ended by then, and the next daemon has not written its own yet.
        let (cycles, latency) = self.running.join(|| self.status.remove())?;
        Ok(Summary { cycles, latency, threads: self.thread_registry.reports() })
    }
}

/// Starts the command thread, which owns the station until the returned sender is dropped.
///
/// The command server exists once per station, so its owner is the station's daemon. Ports are bound to their thread, so
/// that thread opens it, and this thread waits for the result.
fn start_commands(
    station: &str,
    ends: CommandEnds,
    thread_registry: &Arc<ThreadRegistry>,
) -> anyhow::Result<(JoinHandle<anyhow::Result<()>>, Sender<Shared>)> {
    let station = station.to_owned();
    let (shared_sender, shared) = bounded::<Shared>(1);
    let (commands, ()) = start_thread("commands", ORDINARY, thread_registry, move |ready| {
        let bus = Bus::join(&BusSettings::new(&station, DAEMON_ROLE))?;
        // Removes nodes left by a previous daemon, for example.
        bus.clean_up_dead_nodes();
        let server = bus.command_server().map_err(|error| second_daemon(&bus, error))?;
        let mut commands = Commands::open(bus, server, ends)?;
        let _ = ready.send(());
        // No command is answered before the state is read.
        let Ok((active_configuration, subjects)) = shared.recv() else { return Ok(()) };
        // Keep the station until all other threads have ended, so that a next daemon reads their final output.
        let is_released = || matches!(shared.try_recv(), Err(TryRecvError::Disconnected));
        Ok(commands.run(&active_configuration, &subjects, is_released)?)
    })?;
    Ok((commands, shared_sender))
}

/// Adds the process id of the running daemon to the error.
fn second_daemon(bus: &Bus, error: BusError) -> anyhow::Error {
    let own = std::process::id();
    let other = bus
        .participants()
        .ok()
        .and_then(|all| all.into_iter().find(|one| one.role == DAEMON_ROLE && one.process_id != own));
    match (&error, other) {
        (BusError::Full { .. }, Some(other)) => {
            let process = other.process_id;
            let remedy = if is_stopped(process) {
                format!("which is stopped: let it continue with `kill -CONT {process}`")
            } else {
                "stop it".to_owned()
            };
            anyhow!(
                "station {} already has a daemon: process {process}; {remedy}, or give this one another `station`",
                bus.station()
            )
        }
        _ => error.into(),
    }
}
