//! Starts the threads after the command thread, in the order of the data flow.

use std::sync::Arc;

use anyhow::Context;
use equipoise_config::{Config, WaitStrategy, similar};
use equipoise_core::cycle::Memory;
use equipoise_station::proc::MemoryUse;
use equipoise_station::status::Status;
use tracing::info;

use super::restored::Restored;
use super::threads::{Running, start_thread};
use super::{ORDINARY, ServeMetrics, adapters, privileges};
use crate::active_configuration::{ActiveConfiguration, SharedConfiguration};
use crate::egress::Egress;
use crate::housekeeping::Housekeeping;
use crate::incidents::IncidentBoard;
use crate::ingress::Ingress;
use crate::latency_log::{self, LatencyLog};
use crate::planner::{Planner, SharedWorker};
use crate::realtime::{self, RequestedScheduling, now_ns};
use crate::rings::{EgressEnds, IngressEnds, LoopControl, LoopEnds, SavingEnds};
use crate::saving::{self, Saver};
use crate::status_file::StatusFile;
use crate::subjects::Subjects;
use crate::thread_registry::ThreadRegistry;
use crate::tick::{Loop, Monotonic, Observer};
use crate::watchdog;

/// SCHED_FIFO priorities of the other threads, relative to the loop's and below it in this order.
const BELOW_LOOP: [(&str, u32); 3] = [("ingress", 10), ("egress", 20), ("watchdog", 30)];

/// Data shared by the threads.
pub(super) struct Start<'a> {
    pub(super) config: &'a Config,
    pub(super) control: &'a Arc<LoopControl>,
    pub(super) thread_registry: &'a Arc<ThreadRegistry>,
    pub(super) active_configuration: &'a Arc<SharedConfiguration>,
    pub(super) board: &'a Arc<IncidentBoard>,
    pub(super) subjects: Arc<Subjects>,
    pub(super) memory_lock: String,
}

/// Data that each belong to one thread.
pub(super) struct Owned {
    pub(super) ends: (LoopEnds, IngressEnds, EgressEnds, SavingEnds),
    pub(super) restored: Restored,
    pub(super) observer: Box<dyn Observer>,
    pub(super) serve_metrics: Option<ServeMetrics>,
}

impl Start<'_> {
    /// Starts all threads and returns the status file, which is kept up to date from then on.
    pub(super) fn start_remaining(self, owned: Owned, running: &mut Running) -> anyhow::Result<StatusFile> {
        let Owned { ends, restored, observer, serve_metrics } = owned;
        let (loop_ends, ingress_ends, egress_ends, saving_ends) = ends;
        self.start_metrics(serve_metrics, running)?;
        let latency_feed = self.start_latency_log(running)?;
        self.start_egress(egress_ends, latency_feed, running)?;
        let Restored { memory, worker, tare, station_refused, messages } = restored;
        self.start_loop(loop_ends, memory, worker, observer, running)?;
        self.start_ingress(ingress_ends, running)?;
        adapters::start(self.config, self.control, self.thread_registry, self.board, &mut running.threads)?;
        let status = self.status_file(worker, messages);
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
        self.start_saving(saver, running)?;
        self.start_planner(worker_data, running)?;
        self.start_watchdog(running)?;
        self.start_housekeeping(&status, running)?;
        // Every thread has requested its scheduling by now, and all initial memory is allocated.
        privileges::report_missing(self.config, self.board, &self.memory_lock, self.thread_registry)?;
        Ok(status)
    }

    /// Scheduling of a thread with a priority so much below the loop's.
    fn requested(&self, below: u32, cpu: Option<usize>) -> RequestedScheduling {
        match self.config.wait_strategy() {
            WaitStrategy::Sleeping => {
                RequestedScheduling { fifo_priority: self.config.tick.priority.saturating_sub(below), cpu }
            }
            // A polling thread must not be real-time: the kernel would throttle it for a twentieth of each second, in
            // one piece.
            WaitStrategy::Polling => RequestedScheduling { fifo_priority: 0, cpu: None },
        }
    }

    /// The metrics, unless they are disabled or a process of their own.
    fn start_metrics(&self, serve: Option<ServeMetrics>, running: &mut Running) -> anyhow::Result<()> {
        let metrics = self.config.metrics.as_ref().filter(|_| !self.config.sensors_apart);
        let (Some(metrics), Some(serve)) = (metrics, serve) else { return Ok(()) };
        let (control, station, listen) =
            (Arc::clone(self.control), self.config.station.clone(), metrics.listen);
        let (thread, address) = start_thread("metrics-feed", ORDINARY, self.thread_registry, move |ready| {
            serve(&station, listen, &ready, &|| control.is_stopping())
        })?;
        info!("metrics: http://{address}/metrics");
        running.independent.push(("metrics", thread));
        Ok(())
    }

    /// Returns the end of the log's ring that belongs to egress.
    fn start_latency_log(&self, running: &mut Running) -> anyhow::Result<latency_log::feed::Feed> {
        let (latency_feed, drain) = latency_log::feed::feed(latency_log::feed::CAPACITY);
        let log = LatencyLog::new(
            drain,
            Arc::clone(self.active_configuration),
            Arc::clone(self.board),
            self.subjects.state(),
        );
        let (latency_log, ()) = start_thread("latency log", ORDINARY, self.thread_registry, move |ready| {
            let _ = ready.send(());
            Ok(log.run())
        })?;
        running.latency_log = Some(latency_log);
        Ok(latency_feed)
    }

    fn start_egress(
        &self,
        ends: EgressEnds,
        latency_feed: latency_log::feed::Feed,
        running: &mut Running,
    ) -> anyhow::Result<()> {
        let (station, wait_strategy) = (self.config.station.clone(), self.config.wait_strategy());
        // On the loop's core, waking egress needs no signal between cores, and egress runs as soon as the loop sleeps.
        let requested = self.requested(BELOW_LOOP[1].1, self.config.tick.cpu);
        let (egress, ()) = start_thread("egress", requested, self.thread_registry, move |ready| {
            let egress = Egress::open(&station, ends, wait_strategy, latency_feed)?;
            let _ = ready.send(());
            Ok(egress.run()?)
        })?;
        running.threads.push(("egress", egress));
        Ok(())
    }

    fn start_loop(
        &self,
        ends: LoopEnds,
        memory: Box<Memory>,
        worker: u64,
        mut observer: Box<dyn Observer>,
        running: &mut Running,
    ) -> anyhow::Result<()> {
        let tick = &self.config.tick;
        let requested = RequestedScheduling { fifo_priority: tick.priority, cpu: tick.cpu };
        let (control, period_ns) = (Arc::clone(self.control), self.config.period_ns());
        let settings = self.active_configuration.settings();
        let (loop_thread, ()) = start_thread("loop", requested, self.thread_registry, move |ready| {
            let _runs = control.mark_loop_running();
            realtime::prefault_stack();
            let _ = ready.send(());
            let the_loop = Loop::new(settings, memory, worker, ends, period_ns);
            Ok(the_loop.run(&mut Monotonic, &mut *observer))
        })?;
        running.loop_thread = Some(loop_thread);
        Ok(())
    }

    fn start_ingress(&self, ends: IngressEnds, running: &mut Running) -> anyhow::Result<()> {
        let (station, wait_strategy) = (self.config.station.clone(), self.config.wait_strategy());
        let requested = self.requested(BELOW_LOOP[0].1, None);
        let (ingress, ()) = start_thread("ingress", requested, self.thread_registry, move |ready| {
            let ingress = Ingress::open(&station, ends, wait_strategy)?;
            let _ = ready.send(());
            Ok(ingress.run()?)
        })?;
        running.threads.push(("ingress", ingress));
        Ok(())
    }

    /// The initial status; `messages` describe what was restored.
    fn status_file(&self, worker: u64, messages: Vec<String>) -> StatusFile {
        StatusFile::new(Status {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            process_id: std::process::id(),
            started_ns: now_ns(),
            station: self.config.station.clone(),
            config_toml: self.active_configuration.with(ActiveConfiguration::with_subject_in_use).to_toml(),
            model_toml: self.config.model_toml(),
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
        })
    }

    fn start_saving(&self, saver: Saver, running: &mut Running) -> anyhow::Result<()> {
        let (saver, ()) = start_thread("saving", ORDINARY, self.thread_registry, move |ready| {
            let _ = ready.send(());
            saving::run(saver);
            Ok(())
        })?;
        running.threads.push(("saving", saver));
        Ok(())
    }

    fn start_planner(&self, worker_data: Arc<SharedWorker>, running: &mut Running) -> anyhow::Result<()> {
        let (station, control) = (self.config.station.clone(), Arc::clone(self.control));
        let (subjects, active_configuration) =
            (Arc::clone(&self.subjects), Arc::clone(self.active_configuration));
        let (planner, ()) = start_thread("planner", ORDINARY, self.thread_registry, move |ready| {
            let planner = Planner::open(&station, worker_data, subjects, active_configuration, control)?;
            let _ = ready.send(());
            planner.run();
            Ok(())
        })?;
        running.independent.push(("planner", planner));
        Ok(())
    }

    fn start_watchdog(&self, running: &mut Running) -> anyhow::Result<()> {
        let control = Arc::clone(self.control);
        // Real time, so that a load that leaves the loop its core does not delay the notification.
        let requested = self.requested(BELOW_LOOP[2].1, None);
        let (watchdog, ()) = start_thread("watchdog", requested, self.thread_registry, move |ready| {
            let _ = ready.send(());
            watchdog::run(&control);
            Ok(())
        })?;
        running.threads.push(("watchdog", watchdog));
        Ok(())
    }

    fn start_housekeeping(&self, status: &StatusFile, running: &mut Running) -> anyhow::Result<()> {
        let (control, board, registry) =
            (Arc::clone(self.control), Arc::clone(self.board), Arc::clone(self.thread_registry));
        let (configuration, file) = (self.config.clone(), status.clone());
        let (housekeeping, ()) =
            start_thread("housekeeping", ORDINARY, self.thread_registry, move |ready| {
                file.update_threads(&registry, 0);
                file.write().with_context(|| format!("cannot write {}", file.path.display()))?;
                let housekeeping = Housekeeping::open(&configuration, control, board, registry, file)?;
                let _ = ready.send(());
                housekeeping.run();
                Ok(())
            })?;
        running.threads.push(("housekeeping", housekeeping));
        Ok(())
    }
}
