//! The daemon's threads: started in the order of the data, ended in the same order, so that the last word gets out.

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
use crate::workers::{Saving, Workers};

use self::remembered::Remembered;
use self::threads::{Held, Running, started};

/// SCHED_FIFO priorities of the threads beside the loop, below it in this order.
const BELOW_LOOP: [(&str, u32); 2] = [("ingress", 10), ("egress", 20)];
/// Threads that keep no time ask for the ordinary scheduler.
const ORDINARY: Asked = Asked { fifo_priority: 0, cpu: None };
/// How a refused lock of the memory is told.
const NOT_LOCKED: &str = "not locked";
/// The role under which the daemon itself is found on the bus.
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

/// How a daemon fared.
#[derive(Debug, Clone)]
pub struct Summary {
    /// The loop.
    pub cycles: LoopSummary,
    /// Latency by stage.
    pub latency: Report,
    /// What each thread asked for and had.
    pub threads: Vec<ThreadReport>,
}

impl Pipeline {
    /// Starts everything that a configuration asks for.
    ///
    /// # Errors
    /// A sentence for the person who started it: another daemon on this station, a port taken, real time refused
    /// under `strict`.
    pub fn start(config: &Config) -> anyhow::Result<Pipeline> {
        Pipeline::start_observed(config, Box::new(NoObserver))
    }

    /// The same with an observer inside the loop.
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

        // The command server is the station's only one: whoever has it is the daemon. Ports belong to their thread,
        // so it is opened there, and this thread waits for the word.
        let commands_rings = Arc::clone(&rings);
        let (hold, held) = mpsc::channel::<Held>();
        let (commands, ()) = started("commands", ORDINARY, &roster, move |ready| {
            let bus = Bus::join(&BusSettings::new(&station, DAEMON_ROLE))?;
            // Of a daemon before this one, say.
            bus.clean_up_dead_nodes();
            let server = bus.command_server().map_err(|error| second_daemon(&bus, error))?;
            let mut commands = Commands::open(bus, server, commands_rings)?;
            let _ = ready.send(());
            // Nobody is answered before the state is read.
            let Ok((in_force, workers)) = held.recv() else { return Ok(()) };
            commands.run(&in_force, &workers)?;
            // The station stays this daemon's until all the others have ended: whoever comes next reads their last word.
            let _ = held.recv();
            Ok(())
        })?;
        // The station is ours: what is read from here on nobody else writes.
        let (settings, similar) = config.settings_among(&state.profiles());
        let in_force = Arc::new(InForce::new(Forced { config: config.clone(), settings, similar }));
        let subject = &config.subject;
        let configured = Saving::of(&state, &subject.id, Some(subject.build()), subject.remember);
        let workers = Arc::new(Workers::new(state, configured));
        let remembered = Remembered::find(config, &settings, &workers);
        let _ = hold.send((Arc::clone(&in_force), Arc::clone(&workers)));
        // From here on threads run: a failure must end them, and wait until they have left the bus.
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
                // The first failure is the one to tell.
                let _ = running.join(|| {});
                // Housekeeping may have written it once more.
                status::remove(&config.station);
                Err(error)
            }
        }
    }

    /// What each thread asked for and has.
    pub fn threads(&self) -> Vec<ThreadReport> {
        self.roster.reports()
    }

    /// The newest cycle.
    pub fn last_cycle(&self) -> u64 {
        self.rings.last_cycle()
    }

    /// Whether every thread still runs.
    pub fn is_whole(&self) -> bool {
        self.running.is_whole()
    }

    /// Ends every thread and says how it went.
    ///
    /// # Errors
    /// What a thread died of, if one did.
    pub fn stop(self) -> anyhow::Result<Summary> {
        self.rings.stop();
        // Housekeeping, which keeps the file in place, has ended then; and the file is not yet that of a next daemon.
        let (cycles, latency) = self.running.join(|| self.status.remove())?;
        Ok(Summary { cycles, latency, threads: self.roster.reports() })
    }
}

/// What the later threads are started from.
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
            // Real time must not poll: the kernel takes a twentieth of each second from it, all at once.
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
        // On the loop's own core egress is woken without a signal between cores, and runs as soon as the loop sleeps.
        let asked_egress = asked(BELOW_LOOP[1].1, config.tick.cpu);
        let (egress, ()) = started("egress", asked_egress, roster, move |ready| {
            let egress = Egress::open(&station, rings, waiting, latency_feed)?;
            let _ = ready.send(());
            Ok(egress.run()?)
        })?;
        running.others.push(("egress", egress));

        let Remembered { memory, worker, tare, station_refused, told } = self.remembered;
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
            remembered: told,
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
        // Every thread has asked by now, and all the memory that they begin with is there.
        refuse_or_tell(config, self.board, &self.memory_lock, roster)?;
        Ok(status)
    }
}

/// Names the daemon that is there already.
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

/// Asks for all memory to be locked; in words, how that went. Whether it really is, is read back later.
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

/// Whatever was asked and not granted, of threads and of memory: refused under `loop.strict`, else an incident that
/// lasts as long as the daemon.
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
