//! The daemon's threads: started in the order of the data, ended in the same order, so that the last word gets out.

mod remembered;
mod threads;

use std::sync::Arc;
use std::sync::mpsc;

use anyhow::{Context, anyhow, bail};
use equipoise_bus::{Bus, BusError, BusSettings};
use equipoise_latency::Report;
use equipoise_view::page::Page;
use tracing::{info, warn};

use crate::commands::Commands;
use crate::config::{Config, GroundSourceKind, SuitSourceKind};
use crate::egress::Egress;
use crate::housekeeping::Housekeeping;
use crate::incidents::IncidentBoard;
use crate::ingress::Ingress;
use crate::page_feed;
use crate::profile;
use crate::realtime::{self, Asked, ThreadReport};
use crate::rings::{Rings, Waiting};
use crate::status::{Status, StatusFile, ThreadStatus};
use crate::tick::{Loop, LoopSummary, NoObserver, Observer};
use crate::workers::{Saving, Workers};
use crate::{saving, sensors};

use self::threads::{Other, Running, started};

/// SCHED_FIFO priorities of the threads beside the loop, below it in this order.
const BELOW_LOOP: [(&str, u32); 2] = [("ingress", 10), ("egress", 20)];
/// The role under which the daemon itself is found on the bus.
const DAEMON_ROLE: &str = "daemon";

/// A running daemon.
pub struct Pipeline {
    rings: Arc<Rings>,
    running: Running,
    page: Option<Page>,
    status: StatusFile,
    threads: Vec<ThreadReport>,
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
        let settings = config.settings_among(&profile::folder());
        let station = config.station.clone();
        let rings = Arc::new(Rings::new().context("no event file descriptor is to be had")?);
        let memory_lock = lock_memory(config)?;

        // The command server is the station's only one: whoever has it is the daemon. Ports belong to their thread,
        // so it is opened there, and this thread waits for the word.
        let workers = Workers::new(Saving::of(
            &config.subject.id,
            Some(config.subject.build()),
            config.subject.remember,
        ));
        let workers = Arc::new(workers);
        let (commands_rings, commands_workers) = (Arc::clone(&rings), Arc::clone(&workers));
        let (commands, ()) = started("commands", move |ready| {
            let bus = Bus::join(&BusSettings::new(&station, DAEMON_ROLE))?;
            let server = bus.command_server().map_err(|error| second_daemon(&bus, error))?;
            let commands = Commands::open(bus, server, commands_rings, settings, commands_workers)?;
            let _ = ready.send(());
            Ok(commands.run()?)
        })?;
        // From here on threads run: a failure must end them, and wait until they have left the bus.
        let mut running = Running { others: vec![("commands", commands)], ..Running::default() };
        let board = Arc::new(IncidentBoard::default());
        let start = Start { config, rings: &rings, board, workers, memory_lock, observer };
        match start.the_rest(settings, &mut running) {
            Ok((page, status, threads)) => Ok(Pipeline { rings, running, page, status, threads }),
            Err(error) => {
                rings.stop();
                // The first failure is the one to tell.
                let _ = running.join();
                Err(error)
            }
        }
    }

    /// Where the page is, if it is served.
    pub fn page_url(&self) -> Option<String> {
        self.page.as_ref().map(Page::url)
    }

    /// What each thread asked for and has.
    pub fn threads(&self) -> &[ThreadReport] {
        &self.threads
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
        if let Some(page) = self.page {
            page.stop();
        }
        let outcome = self.running.join();
        // Housekeeping, which keeps the file in place, has ended.
        self.status.remove();
        let (cycles, latency) = outcome?;
        Ok(Summary { cycles, latency, threads: self.threads })
    }
}

/// What the later threads are started from.
struct Start<'a> {
    config: &'a Config,
    rings: &'a Arc<Rings>,
    board: Arc<IncidentBoard>,
    workers: Arc<Workers>,
    memory_lock: String,
    observer: Box<dyn Observer>,
}

impl Start<'_> {
    fn the_rest(
        self,
        settings: equipoise_core::cycle::Settings,
        running: &mut Running,
    ) -> anyhow::Result<(Option<Page>, StatusFile, Vec<ThreadReport>)> {
        let config = self.config;
        let mut threads = Vec::new();
        let waiting = config.waiting();
        let asked = |below: u32, cpu: Option<usize>| match waiting {
            Waiting::Sleeping => Asked { fifo_priority: config.tick.priority.saturating_sub(below), cpu },
            // Real time must not poll: the kernel takes a twentieth of each second from it, all at once.
            Waiting::Polling => Asked { fifo_priority: 0, cpu: None },
        };

        // The page's thread inherits the ordinary scheduler from this one.
        let page = match &config.page {
            Some(page) => {
                let (feed, states) = page_feed::follow(&config.station)?;
                running.page_feed = Some(feed);
                Some(page_feed::serve(page.listen, config, states)?)
            }
            None => None,
        };

        let (worker_changed, changed_workers) = mpsc::channel();
        let (workers, board) = (Arc::clone(&self.workers), Arc::clone(&self.board));
        let (saver, ()) = started("saving", move |ready| {
            let _ = ready.send(());
            saving::run(&changed_workers, &workers, &board);
            Ok(())
        })?;
        running.others.push(("saving", saver));
        let (rings, station, hlog) =
            (Arc::clone(self.rings), config.station.clone(), config.latency.hlog.clone());
        // On the loop's own core egress is woken without a signal between cores, and runs as soon as the loop sleeps.
        let ask = asked(BELOW_LOOP[1].1, config.tick.cpu);
        let (egress, report) = started("egress", move |ready| {
            let report = realtime::ask("egress", ask);
            let egress = Egress::open(&station, rings, waiting, worker_changed, hlog.as_deref())?;
            let _ = ready.send(report);
            Ok(egress.run()?)
        })?;
        running.egress = Some(egress);
        threads.push(report);

        let memory = remembered::remembered(&settings, &self.workers);
        let (rings, cpu) = (Arc::clone(self.rings), config.tick.cpu);
        let (asked_loop, period_ns) =
            (Asked { fifo_priority: config.tick.priority, cpu }, config.period_ns());
        let mut observer = self.observer;
        let (looping, report) = started("loop", move |ready| {
            let _runs = rings.loop_runs();
            realtime::prefault_stack();
            let _ = ready.send(realtime::ask("loop", asked_loop));
            Ok(Loop::new(settings, memory, Arc::clone(&rings), period_ns).run(&mut *observer))
        })?;
        running.looping = Some(looping);
        threads.push(report);

        let (rings, station, ask) =
            (Arc::clone(self.rings), config.station.clone(), asked(BELOW_LOOP[0].1, None));
        let (ingress, report) = started("ingress", move |ready| {
            let report = realtime::ask("ingress", ask);
            let ingress = Ingress::open(&station, rings, waiting)?;
            let _ = ready.send(report);
            Ok(ingress.run()?)
        })?;
        threads.push(report);
        running.others.push(("ingress", ingress));
        start_adapters(config, self.rings, &mut running.others)?;

        for missing in threads.iter().filter_map(ThreadReport::missing) {
            if config.tick.strict {
                bail!("loop.strict: {missing}");
            }
            warn!("{missing}");
        }
        let status = StatusFile::new(Status {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            process_id: std::process::id(),
            station: config.station.clone(),
            config_toml: config.to_toml(),
            model_toml: config.model_toml(),
            page: page.as_ref().map(Page::url),
            memory_lock: self.memory_lock,
            model_suspicion: None,
            threads: threads.iter().map(ThreadStatus::from).collect(),
        });
        status.write().with_context(|| format!("cannot write {}", status.path.display()))?;
        let (rings, board) = (Arc::clone(self.rings), self.board);
        let (station, file) = (config.station.clone(), status.clone());
        let (housekeeping, ()) = started("housekeeping", move |ready| {
            let housekeeping = Housekeeping::open(&station, rings, board, file)?;
            let _ = ready.send(());
            housekeeping.run();
            Ok(())
        })
        .inspect_err(|_| status.remove())?;
        running.others.push(("housekeeping", housekeeping));
        Ok((page, status, threads))
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
        (BusError::Full { .. }, Some(other)) => anyhow!(
            "station {} already has a daemon: process {}; stop it, or give this one another `station`",
            bus.station(),
            other.process_id
        ),
        _ => error.into(),
    }
}

fn lock_memory(config: &Config) -> anyhow::Result<String> {
    if !config.tick.lock_memory {
        return Ok("not asked for".to_owned());
    }
    match realtime::lock_memory() {
        Ok(()) => Ok("locked".to_owned()),
        Err(why) if config.tick.strict => bail!("loop.strict: memory is not locked: {why}"),
        Err(why) => {
            info!("memory is not locked: {why}");
            Ok(format!("not locked: {why}"))
        }
    }
}

fn start_adapters(config: &Config, rings: &Arc<Rings>, adapters: &mut Vec<Other>) -> anyhow::Result<()> {
    if config.suit.source == SuitSourceKind::MvnUdp {
        let (rings, station, suit) = (Arc::clone(rings), config.station.clone(), config.suit.clone());
        let (thread, ()) = started("suit", move |ready| {
            Ok(sensors::run_suit(&station, &suit, || ready.send(()).unwrap_or(()), &|| rings.is_stopping())?)
        })?;
        adapters.push(("suit", thread));
    }
    if config.ground.source == GroundSourceKind::AtiRdt {
        let (rings, station, ground) = (Arc::clone(rings), config.station.clone(), config.ground.clone());
        let (thread, ()) = started("ground", move |ready| {
            Ok(sensors::run_ground(&station, &ground, || ready.send(()).unwrap_or(()), &|| {
                rings.is_stopping()
            })?)
        })?;
        adapters.push(("ground", thread));
    }
    Ok(())
}
