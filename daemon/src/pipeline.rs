//! The daemon's threads: started in the order of the data flow and ended in the same order, so that all results are
//! published.

mod adapters;
mod reload;
mod restored;
mod threads;

use std::net::SocketAddr;
use std::sync::Arc;

use anyhow::{Context, anyhow, bail};
use crossbeam_channel::{Sender, TryRecvError, bounded};
use equipoise_bus::{Bus, BusError, BusSettings};
use equipoise_config::{Config, WaitStrategy, similar};
use equipoise_core::message::Incident;
use equipoise_latency::Report;
use equipoise_station::DAEMON_ROLE;
use equipoise_station::proc::MemoryUse;
use equipoise_station::process_state::is_stopped;
use equipoise_station::state_directory::StateDirectory;
use equipoise_station::status::{self, Status};
use tracing::info;

use crate::active_configuration::{ActiveConfiguration, SharedConfiguration};
use crate::commands::Commands;
use crate::egress::Egress;
use crate::housekeeping::Housekeeping;
use crate::incidents::IncidentBoard;
use crate::ingress::Ingress;
use crate::latency_log::{self, LatencyLog};
use crate::planner::{Planner, SharedWorker};
use crate::realtime::{self, RequestedScheduling, ThreadReport, now_ns};
use crate::rings::{EgressEnds, IngressEnds, LoopControl, LoopEnds, Rings, SavingEnds};
use crate::saving::{self, Saver};
use crate::similar::similar_to_configured;
use crate::status_file::StatusFile;
use crate::subjects::{ProfileDestination, Subjects};
use crate::thread_registry::ThreadRegistry;
use crate::tick::{Loop, LoopSummary, Monotonic, NoObserver, Observer};
use crate::watchdog;

use self::restored::Restored;
use self::threads::{Running, Shared, start_thread};

/// SCHED_FIFO priorities of the other threads, relative to the loop's and below it in this order.
const BELOW_LOOP: [(&str, u32); 3] = [("ingress", 10), ("egress", 20), ("watchdog", 30)];
/// Threads without deadlines request the ordinary scheduler.
const ORDINARY: RequestedScheduling = RequestedScheduling { fifo_priority: 0, cpu: None };
/// Prefix of the message for a refused memory lock.
const NOT_LOCKED: &str = "not locked";

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
        let station = config.station.clone();
        let Rings {
            control,
            loop_ends,
            ingress,
            egress,
            saving,
            commands: command_ends,
            settings: settings_sender,
        } = Rings::new().context("no event file descriptor is to be had")?;
        let memory_lock = lock_memory(config)?;
        let thread_registry = Arc::new(ThreadRegistry::default());
        thread_registry.request("main", ORDINARY);

        // The command server exists once per station, so its owner is the station's daemon. Ports are bound to their
        // thread, so that thread opens it, and this thread waits for the result.
        let (shared_sender, shared) = bounded::<Shared>(1);
        let (commands, ()) = start_thread("commands", ORDINARY, &thread_registry, move |ready| {
            let bus = Bus::join(&BusSettings::new(&station, DAEMON_ROLE))?;
            // Removes nodes left by a previous daemon, for example.
            bus.clean_up_dead_nodes();
            let server = bus.command_server().map_err(|error| second_daemon(&bus, error))?;
            let mut commands = Commands::open(bus, server, command_ends)?;
            let _ = ready.send(());
            // No command is answered before the state is read.
            let Ok((active_configuration, subjects)) = shared.recv() else { return Ok(()) };
            // Keep the station until all other threads have ended, so that a next daemon reads their final output.
            let is_released = || matches!(shared.try_recv(), Err(TryRecvError::Disconnected));
            Ok(commands.run(&active_configuration, &subjects, is_released)?)
        })?;
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
            ends: (loop_ends, ingress, egress, saving),
            thread_registry: &thread_registry,
            active_configuration: &active_configuration,
            board: &board,
            subjects,
            restored,
            memory_lock,
            observer,
            serve_metrics,
        };
        match start.start_remaining(&mut running) {
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

/// Everything that the later threads need.
struct Start<'a> {
    config: &'a Config,
    control: &'a Arc<LoopControl>,
    ends: (LoopEnds, IngressEnds, EgressEnds, SavingEnds),
    thread_registry: &'a Arc<ThreadRegistry>,
    active_configuration: &'a Arc<SharedConfiguration>,
    board: &'a Arc<IncidentBoard>,
    subjects: Arc<Subjects>,
    restored: Restored,
    memory_lock: String,
    observer: Box<dyn Observer>,
    serve_metrics: Option<ServeMetrics>,
}

impl Start<'_> {
    fn start_remaining(self, running: &mut Running) -> anyhow::Result<StatusFile> {
        let (config, thread_registry) = (self.config, self.thread_registry);
        let (loop_ends, ingress_ends, egress_ends, saving_ends) = self.ends;
        let wait_strategy = config.wait_strategy();
        let requested = |below: u32, cpu: Option<usize>| match wait_strategy {
            WaitStrategy::Sleeping => {
                RequestedScheduling { fifo_priority: config.tick.priority.saturating_sub(below), cpu }
            }
            // A polling thread must not be real-time: the kernel would throttle it for a twentieth of each second, in
            // one piece.
            WaitStrategy::Polling => RequestedScheduling { fifo_priority: 0, cpu: None },
        };

        let metrics = config.metrics.as_ref().filter(|_| !config.sensors_apart);
        if let (Some(metrics), Some(serve)) = (metrics, self.serve_metrics) {
            let (control, station, listen) =
                (Arc::clone(self.control), config.station.clone(), metrics.listen);
            let (thread, address) = start_thread("metrics-feed", ORDINARY, thread_registry, move |ready| {
                serve(&station, listen, &ready, &|| control.is_stopping())
            })?;
            info!("metrics: http://{address}/metrics");
            running.independent.push(("metrics", thread));
        }

        let (latency_feed, drain) = latency_log::feed::feed(latency_log::feed::CAPACITY);
        let log = LatencyLog::new(
            drain,
            Arc::clone(self.active_configuration),
            Arc::clone(self.board),
            self.subjects.state(),
        );
        let (latency_log, ()) = start_thread("latency log", ORDINARY, thread_registry, move |ready| {
            let _ = ready.send(());
            Ok(log.run())
        })?;
        running.latency_log = Some(latency_log);
        let station = config.station.clone();
        // On the loop's core, waking egress needs no signal between cores, and egress runs as soon as the loop sleeps.
        let requested_egress = requested(BELOW_LOOP[1].1, config.tick.cpu);
        let (egress, ()) = start_thread("egress", requested_egress, thread_registry, move |ready| {
            let egress = Egress::open(&station, egress_ends, wait_strategy, latency_feed)?;
            let _ = ready.send(());
            Ok(egress.run()?)
        })?;
        running.threads.push(("egress", egress));

        let Restored { memory, worker, tare, station_refused, messages } = self.restored;
        let (control, period_ns) = (Arc::clone(self.control), config.period_ns());
        let requested_loop =
            RequestedScheduling { fifo_priority: config.tick.priority, cpu: config.tick.cpu };
        let (settings, mut observer) = (self.active_configuration.settings(), self.observer);
        let (loop_thread, ()) = start_thread("loop", requested_loop, thread_registry, move |ready| {
            let _runs = control.mark_loop_running();
            realtime::prefault_stack();
            let _ = ready.send(());
            let the_loop = Loop::new(settings, memory, worker, loop_ends, period_ns);
            Ok(the_loop.run(&mut Monotonic, &mut *observer))
        })?;
        running.loop_thread = Some(loop_thread);

        let station = config.station.clone();
        let (ingress, ()) =
            start_thread("ingress", requested(BELOW_LOOP[0].1, None), thread_registry, move |ready| {
                let ingress = Ingress::open(&station, ingress_ends, wait_strategy)?;
                let _ = ready.send(());
                Ok(ingress.run()?)
            })?;
        running.threads.push(("ingress", ingress));
        adapters::start(config, self.control, thread_registry, self.board, &mut running.threads)?;
        let status = StatusFile::new(Status {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            process_id: std::process::id(),
            started_ns: now_ns(),
            station: config.station.clone(),
            config_toml: self.active_configuration.with(ActiveConfiguration::with_subject_in_use).to_toml(),
            model_toml: config.model_toml(),
            similar_toml: similar::to_toml(self.active_configuration.settings().similar.as_ref()),
            state_directory: self.subjects.state().path().to_owned(),
            subject: self.subjects.get(worker).map(|destination| destination.subject).unwrap_or_default(),
            restored: messages,
            reload: 0,
            memory_lock: self.memory_lock.clone(),
            memory: MemoryUse::default(),
            loop_faults: None,
            model_mismatch: None,
            weighing: None,
            incidents: self.board.messages(),
            threads: Vec::new(),
        });
        self.active_configuration.publish_in(status.clone());
        // Commands may change the configuration, so they are answered from here on.
        running.answer_commands((Arc::clone(self.active_configuration), Arc::clone(&self.subjects)));
        let worker_data = Arc::new(SharedWorker::default());
        let saver = Saver {
            ends: saving_ends,
            subjects: Arc::clone(&self.subjects),
            worker: Arc::clone(&worker_data),
            active_configuration: Arc::clone(self.active_configuration),
            board: Arc::clone(self.board),
            station_refused,
            tare,
        };
        let (saver, ()) = start_thread("saving", ORDINARY, thread_registry, move |ready| {
            let _ = ready.send(());
            saving::run(saver);
            Ok(())
        })?;
        running.threads.push(("saving", saver));
        let (station, subjects, control) = (config.station.clone(), self.subjects, Arc::clone(self.control));
        let active_configuration = Arc::clone(self.active_configuration);
        let (planner, ()) = start_thread("planner", ORDINARY, thread_registry, move |ready| {
            let planner = Planner::open(&station, worker_data, subjects, active_configuration, control)?;
            let _ = ready.send(());
            planner.run();
            Ok(())
        })?;
        running.independent.push(("planner", planner));
        let control = Arc::clone(self.control);
        // Real time, so that a load that leaves the loop its core does not delay the notification.
        let (watchdog, ()) =
            start_thread("watchdog", requested(BELOW_LOOP[2].1, None), thread_registry, move |ready| {
                let _ = ready.send(());
                watchdog::run(&control);
                Ok(())
            })?;
        running.threads.push(("watchdog", watchdog));
        let (control, board, registry) =
            (Arc::clone(self.control), Arc::clone(self.board), Arc::clone(thread_registry));
        let (configuration, file) = (config.clone(), status.clone());
        let (housekeeping, ()) = start_thread("housekeeping", ORDINARY, thread_registry, move |ready| {
            file.update_threads(&registry, 0);
            file.write().with_context(|| format!("cannot write {}", file.path.display()))?;
            let housekeeping = Housekeeping::open(&configuration, control, board, registry, file)?;
            let _ = ready.send(());
            housekeeping.run();
            Ok(())
        })?;
        running.threads.push(("housekeeping", housekeeping));
        // Every thread has requested its scheduling by now, and all initial memory is allocated.
        report_missing_privileges(config, self.board, &self.memory_lock, thread_registry)?;
        Ok(status)
    }
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

/// Requests that all memory is locked; returns the result in words. Whether it is locked is checked later.
fn lock_memory(config: &Config) -> anyhow::Result<String> {
    if !config.tick.lock_memory {
        return Ok("not asked for".to_owned());
    }
    match realtime::lock_memory() {
        Ok(()) => Ok("locked".to_owned()),
        Err(reason) if config.tick.strict => bail!("loop.strict: memory is not locked: {reason}"),
        Err(reason) => {
            info!("memory is not locked: {reason}");
            Ok(format!("{NOT_LOCKED}: {reason}"))
        }
    }
}

/// Requests of threads and memory that were not granted: refused under `loop.strict`, otherwise an incident for the
/// daemon's lifetime.
fn report_missing_privileges(
    config: &Config,
    board: &IncidentBoard,
    memory_lock: &str,
    thread_registry: &ThreadRegistry,
) -> anyhow::Result<()> {
    let mut missing = thread_registry.missing();
    let memory = MemoryUse::read();
    if memory_lock.starts_with(NOT_LOCKED) {
        missing.push(format!("memory is {memory_lock}"));
    } else if config.tick.lock_memory && !memory.is_locked() {
        missing.push(format!(
            "memory is not locked: {} KiB of {} KiB in memory are; run as root, or under systemd with \
             LimitMEMLOCK=infinity",
            memory.locked_kib, memory.resident_kib
        ));
    }
    let Some(first) = missing.first() else { return Ok(()) };
    if config.tick.strict {
        bail!("loop.strict: {first}");
    }
    let others = match missing.len() - 1 {
        0 => String::new(),
        others => format!(" (and {others} more; `equipoise status` shows all)"),
    };
    board.begin(Incident::RealTimeRefused, &format!("{first}{others}"));
    Ok(())
}
