//! The daemon's threads: started in the order of the data, ended in the same order, so that the last word gets out.

use std::sync::Arc;
use std::sync::mpsc;
use std::thread::JoinHandle;

use anyhow::{Context, anyhow, bail};
use equipoise_bus::{Bus, BusError, BusSettings};
use equipoise_core::cycle::Memory;
use equipoise_latency::Report;
use equipoise_view::page::Page;
use tracing::{info, warn};

use crate::commands::Commands;
use crate::config::{Config, GroundSourceKind, SuitSourceKind};
use crate::egress::Egress;
use crate::housekeeping::Housekeeping;
use crate::page_feed;
use crate::profile::{self, Profile};
use crate::realtime::{self, Asked, ThreadReport};
use crate::rings::Rings;
use crate::status::{Status, StatusFile, ThreadStatus};
use crate::tick::{Loop, LoopSummary, NoObserver, Observer};
use crate::workers::{self, Saving, Workers};
use crate::{ingress, sensors};

/// SCHED_FIFO priorities of the threads beside the loop, below it in this order.
const BELOW_LOOP: [(&str, u32); 2] = [("ingress", 10), ("egress", 20)];
/// Stack of every thread; the loop's is prefaulted, and locked memory counts each.
const STACK_BYTES: usize = 2 << 20;
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

/// The threads that were started so far.
#[derive(Default)]
struct Running {
    looping: Option<JoinHandle<anyhow::Result<LoopSummary>>>,
    egress: Option<JoinHandle<anyhow::Result<Report>>>,
    others: Vec<Other>,
    /// Takes states off the bus for the page; if it ends, the page says so and all else goes on.
    page_feed: Option<JoinHandle<()>>,
}

impl Running {
    fn is_whole(&self) -> bool {
        fn runs<T>(thread: &Option<JoinHandle<T>>) -> bool {
            thread.as_ref().is_some_and(|thread| !thread.is_finished())
        }
        runs(&self.looping)
            && runs(&self.egress)
            && self.others.iter().all(|(_, thread)| !thread.is_finished())
    }

    /// Waits for every thread, so that each takes what it owns off the bus; then tells what they ended with.
    fn join(self) -> anyhow::Result<(LoopSummary, Report)> {
        let cycles = self.looping.map(|thread| joined("loop", thread));
        let latency = self.egress.map(|thread| joined("egress", thread));
        let others: Vec<_> = self.others.into_iter().map(|(name, thread)| joined(name, thread)).collect();
        if let Some(feed) = self.page_feed {
            // A panic was printed by its own thread.
            let _ = feed.join();
        }
        others.into_iter().collect::<anyhow::Result<()>>()?;
        match (cycles, latency) {
            (Some(cycles), Some(latency)) => Ok((cycles?, latency?)),
            _ => bail!("the pipeline was not started whole"),
        }
    }
}

fn joined<T>(name: &'static str, thread: JoinHandle<anyhow::Result<T>>) -> anyhow::Result<T> {
    match thread.join() {
        Ok(outcome) => outcome.with_context(|| format!("thread {name}")),
        Err(_) => Err(anyhow!("thread {name} panicked")),
    }
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
        let start = Start { config, rings: &rings, workers, memory_lock, observer };
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
    workers: Arc<Workers>,
    memory_lock: String,
    observer: Box<dyn Observer>,
}

type Other = (&'static str, JoinHandle<anyhow::Result<()>>);

impl Start<'_> {
    fn the_rest(
        self,
        settings: equipoise_core::cycle::Settings,
        running: &mut Running,
    ) -> anyhow::Result<(Option<Page>, StatusFile, Vec<ThreadReport>)> {
        let config = self.config;
        let mut threads = Vec::new();
        let asked =
            |below: u32| Asked { fifo_priority: config.tick.priority.saturating_sub(below), cpu: None };

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
        let (rings, station, hlog) =
            (Arc::clone(self.rings), config.station.clone(), config.latency.hlog.clone());
        let ask = asked(BELOW_LOOP[1].1);
        let (egress, report) = started("egress", move |ready| {
            let report = realtime::ask("egress", ask);
            let egress = Egress::open(&station, rings, worker_changed, hlog.as_deref())?;
            let _ = ready.send(report);
            Ok(egress.run()?)
        })?;
        running.egress = Some(egress);
        threads.push(report);

        let memory = remembered(&settings, &self.workers);
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

        let (rings, station, ask) = (Arc::clone(self.rings), config.station.clone(), asked(BELOW_LOOP[0].1));
        let (ingress, report) = started("ingress", move |ready| {
            let report = realtime::ask("ingress", ask);
            Ok(ingress::run(&station, &rings, || drop(ready.send(report)))?)
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
        let (rings, station, file) = (Arc::clone(self.rings), config.station.clone(), status.clone());
        let workers = self.workers;
        let (housekeeping, ()) = started("housekeeping", move |ready| {
            let housekeeping = Housekeeping::open(&station, rings, changed_workers, workers, file)?;
            let _ = ready.send(());
            housekeeping.run();
            Ok(())
        })
        .inspect_err(|_| status.remove())?;
        running.others.push(("housekeeping", housekeeping));
        Ok((page, status, threads))
    }
}

/// Starts a thread and waits until it says that it is ready; if it ends before, that is the error.
fn started<Ready: Send + 'static, T: Send + 'static>(
    name: &'static str,
    body: impl FnOnce(mpsc::Sender<Ready>) -> anyhow::Result<T> + Send + 'static,
) -> anyhow::Result<(JoinHandle<anyhow::Result<T>>, Ready)> {
    let (sender, receiver) = mpsc::channel();
    let thread =
        std::thread::Builder::new().name(name.into()).stack_size(STACK_BYTES).spawn(move || body(sender))?;
    match receiver.recv() {
        Ok(ready) => Ok((thread, ready)),
        Err(_) => match thread.join() {
            Ok(Err(error)) => Err(error),
            _ => Err(anyhow!("thread {name} ended before it began")),
        },
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

/// The loop's memory, with what is known of the configured worker. A profile that cannot be used is left alone.
fn remembered(settings: &equipoise_core::cycle::Settings, workers: &Workers) -> Box<Memory> {
    let mut memory = bytemuck::zeroed_box::<Memory>();
    memory.start(settings);
    let Some(saving) = workers.get(workers::CONFIGURED).filter(|saving| saving.remember) else {
        return memory;
    };
    let known = Profile::read(&saving.path).map_err(|error| error.to_string()).and_then(|profile| {
        let Some(profile) = profile else { return Ok(None) };
        let worker = profile.worker(settings).map_err(|why| {
            format!("the profile {} is not used: {why}; it is left as it is", saving.path.display())
        })?;
        Ok(Some((profile, worker)))
    });
    match known {
        Ok(None) => {}
        Ok(Some((profile, worker))) => {
            let (poses, identified) = (profile.poses_used, profile.identified);
            info!(poses, identified, "profile {} is in use", profile.subject);
            memory.identification = *worker;
            // What the configuration says of the mass is newer than the profile.
            if let Some(mass_kg) = settings.mass_kg {
                memory.identification.mass_kg = mass_kg;
            }
        }
        Err(why) => {
            warn!("{why}; what is learnt now is not saved");
            workers.refuse(workers::CONFIGURED, format!("{why} (not overwritten; move it away and restart)"));
        }
    }
    memory
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
