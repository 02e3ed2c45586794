//! The daemon's threads: started in the order of the data flow and ended in the same order, so that all results are
//! published.

mod adapters;
mod reload;
mod remembered;
mod threads;

use std::sync::{Arc, mpsc};

use anyhow::{Context, anyhow, bail};
use equipoise_bus::{Bus, BusError, BusSettings};
use equipoise_core::message::Incident;
use equipoise_latency::Report;
use tracing::info;

use crate::commands::Commands;
use crate::config::Config;
use crate::egress::Egress;
use crate::housekeeping::Housekeeping;
use crate::in_force::{Forced, InForce};
use crate::incidents::IncidentBoard;
use crate::ingress::Ingress;
use crate::latency_log::{self, LatencyLog};
use crate::metrics_feed;
use crate::process_state::is_stopped;
use crate::realtime::{self, Asked, ThreadReport};
use crate::rings::{Rings, Waiting};
use crate::roster::{MemoryUse, Roster};
use crate::saving::{self, Saver};
use crate::state_directory::StateDirectory;
use crate::status::{self, Status, StatusFile};
use crate::tick::{Loop, LoopSummary, Monotonic, NoObserver, Observer};
use crate::watchdog;
use crate::workers::{Saving, Workers};

use self::remembered::Remembered;
use self::threads::{Held, Running, started};

/// SCHED_FIFO priorities of the other threads, relative to the loop's and below it in this order.
const BELOW_LOOP: [(&str, u32); 3] = [("ingress", 10), ("egress", 20), ("watchdog", 30)];
/// Threads without deadlines request the ordinary scheduler.
const ORDINARY: Asked = Asked { fifo_priority: 0, cpu: None };
/// Prefix of the message for a refused memory lock.
const NOT_LOCKED: &str = "not locked";
/// Role of the daemon on the bus.
pub(crate) const DAEMON_ROLE: &str = "daemon";

/// A running daemon.
pub struct Pipeline {
    rings: Arc<Rings>,
    in_force: Arc<InForce>,
    board: Arc<IncidentBoard>,
    running: Running,
    status: StatusFile,
    roster: Arc<Roster>,
}

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
        Pipeline::start_observed(config, Box::new(NoObserver))
    }

    /// As [`Pipeline::start`], with an observer inside the loop.
    ///
    /// # Errors
    /// As [`Pipeline::start`].
    pub fn start_observed(config: &Config, observer: Box<dyn Observer>) -> anyhow::Result<Pipeline> {
        let state = StateDirectory::of_environment()?;
        let station = config.station.clone();
        let rings = Arc::new(Rings::new().context("no event file descriptor is to be had")?);
        let memory_lock = lock_memory(config)?;
        let roster = Arc::new(Roster::default());
        roster.ask("main", ORDINARY);

        // The command server exists once per station, so its owner is the station's daemon. Ports are bound to their
        // thread, so that thread opens it, and this thread waits for the result.
        let commands_rings = Arc::clone(&rings);
        let (hold, held) = mpsc::channel::<Held>();
        let (commands, ()) = started("commands", ORDINARY, &roster, move |ready| {
            let bus = Bus::join(&BusSettings::new(&station, DAEMON_ROLE))?;
            // Removes nodes left by a previous daemon, for example.
            bus.clean_up_dead_nodes();
            let server = bus.command_server().map_err(|error| second_daemon(&bus, error))?;
            let mut commands = Commands::open(bus, server, commands_rings)?;
            let _ = ready.send(());
            // No command is answered before the state is read.
            let Ok((in_force, workers)) = held.recv() else { return Ok(()) };
            commands.run(&in_force, &workers)?;
            // Keep the station until all other threads have ended, so that a next daemon reads their final output.
            let _ = held.recv();
            Ok(())
        })?;
        // This daemon owns the station: no other process writes the files read from here on.
        let (settings, similar) = config.settings_among(&state.profiles());
        let in_force = Arc::new(InForce::new(Forced { config: config.clone(), settings, similar }));
        let subject = &config.subject;
        let configured = Saving::of(&state, &subject.id, Some(subject.build()), subject.remember);
        let workers = Arc::new(Workers::new(state, configured));
        let remembered = Remembered::find(config, &settings, &workers);
        let _ = hold.send((Arc::clone(&in_force), Arc::clone(&workers)));
        // Threads are running from here on: a failure must end them and wait until they have left the bus.
        let mut running = Running::holding(commands, hold);
        let board = Arc::new(IncidentBoard::default());
        let start = Start {
            config,
            rings: &rings,
            roster: &roster,
            in_force: &in_force,
            board: &board,
            workers,
            remembered,
            memory_lock,
            observer,
        };
        match start.the_rest(settings, &mut running) {
            Ok(status) => Ok(Pipeline { rings, in_force, board, running, status, roster }),
            Err(error) => {
                rings.stop();
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
        self.roster.reports()
    }

    /// Number of the newest cycle.
    pub fn last_cycle(&self) -> u64 {
        self.rings.last_cycle()
    }

    /// Whether every thread is running.
    pub fn is_whole(&self) -> bool {
        self.running.is_whole()
    }

    /// Ends every thread and returns the statistics.
    ///
    /// # Errors
    /// The error that ended a thread, if any.
    pub fn stop(self) -> anyhow::Result<Summary> {
        self.rings.stop();
        // Housekeeping, which rewrites the file, has ended by then, and the next daemon has not written its own yet.
        let (cycles, latency) = self.running.join(|| self.status.remove())?;
        Ok(Summary { cycles, latency, threads: self.roster.reports() })
    }
}

/// Everything that the later threads need.
struct Start<'a> {
    config: &'a Config,
    rings: &'a Arc<Rings>,
    roster: &'a Arc<Roster>,
    in_force: &'a Arc<InForce>,
    board: &'a Arc<IncidentBoard>,
    workers: Arc<Workers>,
    remembered: Remembered,
    memory_lock: String,
    observer: Box<dyn Observer>,
}

impl Start<'_> {
    fn the_rest(
        self,
        settings: equipoise_core::cycle::Settings,
        running: &mut Running,
    ) -> anyhow::Result<StatusFile> {
        let (config, roster) = (self.config, self.roster);
        let waiting = config.waiting();
        let asked = |below: u32, cpu: Option<usize>| match waiting {
            Waiting::Sleeping => Asked { fifo_priority: config.tick.priority.saturating_sub(below), cpu },
            // A polling thread must not be real-time: the kernel would throttle it for a twentieth of each second, in
            // one piece.
            Waiting::Polling => Asked { fifo_priority: 0, cpu: None },
        };

        if let Some(metrics) = config.metrics.as_ref().filter(|_| !config.sensors_apart) {
            let (rings, station, listen) = (Arc::clone(self.rings), config.station.clone(), metrics.listen);
            let (thread, address) = started("metrics-feed", ORDINARY, roster, move |ready| {
                metrics_feed::run(&station, listen, &ready, &|| rings.is_stopping())
            })?;
            info!("metrics: http://{address}/metrics");
            running.metrics = Some(thread);
        }

        let (latency_feed, drain) = latency_log::feed::feed(latency_log::feed::PLACES);
        let log =
            LatencyLog::new(drain, Arc::clone(self.in_force), Arc::clone(self.board), self.workers.state());
        let (latency_log, ()) = started("latency log", ORDINARY, roster, move |ready| {
            let _ = ready.send(());
            Ok(log.run())
        })?;
        running.latency_log = Some(latency_log);
        let (rings, station) = (Arc::clone(self.rings), config.station.clone());
        // On the loop's core, waking egress needs no signal between cores, and egress runs as soon as the loop sleeps.
        let asked_egress = asked(BELOW_LOOP[1].1, config.tick.cpu);
        let (egress, ()) = started("egress", asked_egress, roster, move |ready| {
            let egress = Egress::open(&station, rings, waiting, latency_feed)?;
            let _ = ready.send(());
            Ok(egress.run()?)
        })?;
        running.others.push(("egress", egress));

        let Remembered { memory, worker, tare, station_refused, messages } = self.remembered;
        let (rings, period_ns) = (Arc::clone(self.rings), config.period_ns());
        let asked_loop = Asked { fifo_priority: config.tick.priority, cpu: config.tick.cpu };
        let mut observer = self.observer;
        let (looping, ()) = started("loop", asked_loop, roster, move |ready| {
            let _runs = rings.loop_runs();
            realtime::prefault_stack();
            let _ = ready.send(());
            let the_loop = Loop::new(settings, memory, worker, Arc::clone(&rings), period_ns);
            Ok(the_loop.run(&mut Monotonic, &mut *observer))
        })?;
        running.looping = Some(looping);

        let (rings, station) = (Arc::clone(self.rings), config.station.clone());
        let (ingress, ()) = started("ingress", asked(BELOW_LOOP[0].1, None), roster, move |ready| {
            let ingress = Ingress::open(&station, rings, waiting)?;
            let _ = ready.send(());
            Ok(ingress.run()?)
        })?;
        running.others.push(("ingress", ingress));
        adapters::start(config, self.rings, roster, self.board, &mut running.others)?;
        let status = StatusFile::new(Status {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            process_id: std::process::id(),
            station: config.station.clone(),
            config_toml: config.to_toml(),
            model_toml: config.model_toml(),
            state_directory: self.workers.state().path().to_owned(),
            subject: self.workers.get(worker).map(|saving| saving.subject).unwrap_or_default(),
            remembered: messages,
            reload: 0,
            memory_lock: self.memory_lock.clone(),
            memory: MemoryUse::default(),
            loop_faults: None,
            model_suspicion: None,
            incidents: self.board.sentences(),
            threads: Vec::new(),
        });
        let saver = Saver {
            rings: Arc::clone(self.rings),
            workers: self.workers,
            in_force: Arc::clone(self.in_force),
            board: Arc::clone(self.board),
            status: status.clone(),
            station_refused,
            tare,
        };
        let (saver, ()) = started("saving", ORDINARY, roster, move |ready| {
            let _ = ready.send(());
            saving::run(saver);
            Ok(())
        })?;
        running.others.push(("saving", saver));
        let rings = Arc::clone(self.rings);
        // Real time, so that a load that leaves the loop its core does not delay the notification.
        let (watchdog, ()) = started("watchdog", asked(BELOW_LOOP[2].1, None), roster, move |ready| {
            let _ = ready.send(());
            watchdog::run(&rings);
            Ok(())
        })?;
        running.others.push(("watchdog", watchdog));
        let (rings, board, people) = (Arc::clone(self.rings), Arc::clone(self.board), Arc::clone(roster));
        let (settled, file) = (config.clone(), status.clone());
        let (housekeeping, ()) = started("housekeeping", ORDINARY, roster, move |ready| {
            file.note_threads(&people, 0);
            file.write().with_context(|| format!("cannot write {}", file.path.display()))?;
            let housekeeping = Housekeeping::open(&settled, rings, board, people, file)?;
            let _ = ready.send(());
            housekeeping.run();
            Ok(())
        })?;
        running.others.push(("housekeeping", housekeeping));
        // Every thread has requested its scheduling by now, and all initial memory is allocated.
        refuse_or_tell(config, self.board, &self.memory_lock, roster)?;
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
        Err(why) if config.tick.strict => bail!("loop.strict: memory is not locked: {why}"),
        Err(why) => {
            info!("memory is not locked: {why}");
            Ok(format!("{NOT_LOCKED}: {why}"))
        }
    }
}

/// Requests of threads and memory that were not granted: refused under `loop.strict`, otherwise an incident for the
/// daemon's lifetime.
fn refuse_or_tell(
    config: &Config,
    board: &IncidentBoard,
    memory_lock: &str,
    roster: &Roster,
) -> anyhow::Result<()> {
    let mut missing = roster.missing();
    let memory = MemoryUse::now();
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
