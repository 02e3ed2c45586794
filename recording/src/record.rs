//! Records a station: a consumer of the bus that stores all data that a replay requires.
//!
//! Inputs, results, cycle records and checkpoints go into one file as published. A recorder that is too slow loses
//! messages and reports it; the loop never waits for it. After a loss it requests a new checkpoint, from which the rest
//! can be replayed exactly.

pub mod authenticity;
mod finished_files;
mod pictures;
mod ports;
pub mod service;
pub mod signature;
pub mod storage;
pub mod summary;
mod syncer;

use std::cell::Cell;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow, bail};
use bytemuck::Zeroable;
use equipoise_adapters::clock::now_monotonic_ns;
use equipoise_adapters::recording::{Predecessor, Recorded, Recorder, RecordingHeader, Reloaded};
use equipoise_bus::{Bus, BusSettings, CommandClient};
use equipoise_config::Config;
use equipoise_core::message::{Command, CommandKind};
use equipoise_files::{TEXT_BYTES_MAX, read_text};
use equipoise_station::bus_directory::BusDirectory;
use equipoise_station::state_directory::StateDirectory;
use equipoise_station::status::{self, Status};
use equipoise_station::{ANONYMOUS, DAEMON_ROLE};

pub use summary::RecordSummary;

use pictures::Pictures;
use ports::{Daemons, Ports};
use syncer::Syncer;

/// Polling interval: well within the buffers, which hold a quarter of a second at the highest rates.
const POLL_INTERVAL: Duration = Duration::from_millis(10);
/// Maximum loss in a crash of the recorder; of the machine: see [`syncer`].
const FLUSH_EVERY: Duration = Duration::from_secs(1);
/// Timeout of the daemon's reply.
const REPLY_TIMEOUT: Duration = Duration::from_secs(2);
/// After this time, samples that the loop ingested just before the subscription are in its memory.
const SETTLE: Duration = Duration::from_millis(300);
/// Interval for checking that the file is still at its path.
const DIRECTORY_CHECK_INTERVAL: Duration = Duration::from_secs(1);
/// Minimum interval of checkpoint requests after losses.
const CHECKPOINT_PAUSE: Duration = Duration::from_secs(2);

/// Records `station` into a new file until `stopping` returns true, with `pictures_hz` pictures per second; 0 disables
/// them.
///
/// `started` is called when writing begins. Returns a summary and the SHA-256 of the file.
///
/// # Errors
/// No daemon runs, the file exists or cannot be written (data already written remain readable), or the bus fails or is
/// replaced.
pub fn record(
    station: &str,
    out: &Path,
    pictures_hz: f64,
    stopping: &dyn Fn() -> bool,
    started: impl FnOnce(),
) -> anyhow::Result<(RecordSummary, String)> {
    let mut tap = Tap::open(station)?;
    let (checked, removed) = (Cell::new(Instant::now()), Cell::new(false));
    let ending = |progress: &Progress<'_>| {
        if checked.get().elapsed() < DIRECTORY_CHECK_INTERVAL {
            return stopping();
        }
        checked.set(Instant::now());
        removed.set(progress.recorder.bytes_in_place().is_none());
        removed.get() || progress.bus_directory.is_replaced() || stopping()
    };
    let recorded = tap.record(out, None, (pictures_hz, Daemons::All), &ending, started);
    let summary = tap.summary;
    if tap.is_replaced() {
        tap.leak();
        let replaced = format!(
            "the directory of the bus was removed or replaced, so this process receives nothing from station {station} \
             any more: the recording ends"
        );
        return match recorded {
            Ok(_) => {
                Err(anyhow!("{replaced}, {} contains what came before; record a new file", out.display()))
            }
            Err(error) => Err(error.context(replaced)),
        };
    }
    let (sha256, syncer) = recorded?;
    syncer.finish()?;
    if removed.get() {
        bail!(
            "{} was removed or replaced while it was written: recording ends, and what it held is gone",
            out.display()
        );
    }
    Ok((summary, sha256))
}

/// State of the file being written.
struct Progress<'a> {
    recorder: &'a Recorder,
    summary: &'a RecordSummary,
    /// [`Status::instance`] of the daemon whose configuration is in the file's header.
    instance: (u32, u64),
    bus: &'a Bus,
    bus_directory: &'a BusDirectory,
}

impl Progress<'_> {
    /// Whether a daemon is on the bus. Not by its process id: the recorder's service sees no other processes.
    fn has_daemon(&self) -> bool {
        self.bus.participants().is_ok_and(|all| all.iter().any(|one| one.role == DAEMON_ROLE))
    }
}

/// Subscriptions to a station's bus: several files can be recorded in sequence without loss between them.
struct Tap {
    station: String,
    summary: RecordSummary,
    ports: Ports,
    /// [`Status::instance`] of the daemon in the header of the last file.
    instance: (u32, u64),
    commands: CommandClient,
    // Must be dropped after its ports.
    bus: Bus,
    bus_directory: BusDirectory,
}

impl Tap {
    fn open(station: &str) -> anyhow::Result<Tap> {
        if status::read(station).is_none() {
            bail!(
                "no daemon runs on station {station}, so there is nothing to record; start `equipoise run`, or name \
                 another --station"
            );
        }
        let settings = BusSettings::new(station, "record");
        let bus = Bus::join(&settings)?;
        let commands = bus.command_client()?;
        let ports = Ports::open(&bus)?;
        // Also verifies that the daemon in the status file is alive before a file is created.
        request_checkpoint(&commands)?;
        let bus_directory = BusDirectory::read(&settings.root);
        let (station, summary) = (station.to_owned(), RecordSummary::default());
        Ok(Tap { station, summary, ports, instance: (0, 0), commands, bus, bus_directory })
    }

    /// Whether the bus directory was replaced, so that processes joining now are not received.
    fn is_replaced(&self) -> bool {
        self.bus_directory.is_replaced()
    }

    /// Ends without closing the ports, which after a replacement would remove files of the new bus with equal names.
    fn leak(self) {
        std::mem::forget(self);
    }

    /// Creates a file with its header.
    fn begin(
        &self,
        out: &Path,
        previous: Option<Predecessor>,
        (pictures_hz, daemons): (f64, Daemons),
    ) -> anyhow::Result<Sink> {
        let Some(facts) = status::read(&self.station) else {
            bail!("the daemon of station {} has ended", self.station);
        };
        let instance = facts.instance();
        let header = RecordingHeader {
            subject_toml: read_profile(&facts),
            config_toml: recorded_config(&facts)?,
            software_version: facts.version,
            started_unix_ns: unix_ns(),
            started_monotonic_ns: now_monotonic_ns(),
            model_toml: facts.model_toml,
            similar_toml: facts.similar_toml,
            previous,
            ..RecordingHeader::default()
        };
        let mut recorder = Recorder::create(out, &header)?;
        let pictures = Pictures::announce(&mut recorder, pictures_hz)?;
        let (newest_ns, station) = (header.started_monotonic_ns, self.station.clone());
        let subject = facts.subject;
        Ok(Sink { recorder, pictures, newest_ns, station, subject, settings_number: 0, instance, daemons })
    }

    /// Records into a new file, the successor of `previous`, until `ending` returns true, or up to the first message of
    /// the next daemon with [`Daemons::One`]; returns its SHA-256, and the thread that still writes it to the disk.
    /// `contents`: pictures per second, and the daemons.
    fn record(
        &mut self,
        out: &Path,
        previous: Option<Predecessor>,
        contents: (f64, Daemons),
        ending: &dyn Fn(&Progress<'_>) -> bool,
        started: impl FnOnce(),
    ) -> anyhow::Result<(String, Syncer)> {
        let mut sink = self.begin(out, previous, contents)?;
        self.instance = sink.instance;
        let file = sink.recorder.second_handle().context("the recording has no second handle")?;
        let mut syncer = Syncer::start(out, file);
        started();
        let (ports, summary) = (&mut self.ports, &mut self.summary);
        let (bus, bus_directory) = (&self.bus, &self.bus_directory);
        let mut checkpoint_due = Some(Instant::now() + SETTLE);
        let (mut flushed, mut lost) = (Instant::now(), summary.lost());
        ports.begin(&mut sink, summary)?;
        while !ports.is_next_daemon() {
            let (recorder, instance) = (&sink.recorder, sink.instance);
            if ending(&Progress { recorder, summary, instance, bus, bus_directory }) {
                break;
            }
            std::thread::sleep(POLL_INTERVAL);
            ports.fetch(&mut sink, summary)?;
            if summary.lost() > lost {
                lost = summary.lost();
                checkpoint_due.get_or_insert(Instant::now() + CHECKPOINT_PAUSE);
            }
            if checkpoint_due.is_some_and(|due| Instant::now() >= due) {
                checkpoint_due = None;
                // May fail if the daemon has ended: a restarted one publishes a checkpoint by itself.
                let _ = request_checkpoint(&self.commands);
            }
            if flushed.elapsed() >= FLUSH_EVERY {
                flushed = Instant::now();
                sink.record_subject()?;
                sink.recorder.flush()?;
                syncer.check()?;
            }
        }
        ports.fetch(&mut sink, summary)?;
        sink.record_subject()?;
        Ok((sink.recorder.finish_unsynchronised()?, syncer))
    }
}

/// Requests a checkpoint, which the loop takes as soon as possible and egress publishes.
fn request_checkpoint(commands: &CommandClient) -> anyhow::Result<()> {
    let command = Command { kind: CommandKind::Checkpoint as u32, ..Command::zeroed() };
    let reply = commands.ask(&command, REPLY_TIMEOUT)?;
    if reply.refused != 0 {
        bail!("the daemon gives no checkpoint: {}", equipoise_bus::parse_text(&reply.text));
    }
    Ok(())
}

/// The subject's profile on disk, if any.
fn read_profile(facts: &Status) -> String {
    let state = StateDirectory::of_daemon(facts).or_else(|| StateDirectory::of_environment().ok());
    let text = state.and_then(|state| read_text(&state.profile(&facts.subject), TEXT_BYTES_MAX).ok());
    text.unwrap_or_default()
}

/// The daemon's configuration for recordings, without an identity if the subject in use was deleted.
fn recorded_config(facts: &Status) -> anyhow::Result<String> {
    let mut config = Config::parse(&facts.config_toml, "the daemon's configuration")?.for_recording();
    if facts.subject.is_empty() {
        config.subject.id = ANONYMOUS.to_owned();
    }
    Ok(config.to_toml())
}

fn unix_ns() -> u64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(0)
}

/// The file, and its state.
struct Sink {
    recorder: Recorder,
    pictures: Pictures,
    /// Newest time of the daemon's results in the file, CLOCK_MONOTONIC.
    newest_ns: u64,
    station: String,
    /// The subject whose profile is already in the file.
    subject: String,
    /// Number of the reload whose configuration was stored last; 0 for none.
    settings_number: u64,
    instance: (u32, u64),
    daemons: Daemons,
}

impl Sink {
    /// The status of a daemon that belongs in this file.
    fn status(&self) -> Option<Status> {
        let belongs = |facts: &Status| self.daemons == Daemons::All || facts.instance() == self.instance;
        status::read(&self.station).filter(belongs)
    }

    /// Writes a result of the daemon, whose clock determines the newest time in the file.
    fn write_result<M: Recorded>(&mut self, time_ns: u64, message: &M) -> anyhow::Result<()> {
        self.newest_ns = self.newest_ns.max(time_ns);
        Ok(self.recorder.write(time_ns, message)?)
    }

    /// Writes a message of an adapter, which may have another clock: its log time is at most the present.
    fn write_input<M: Recorded>(&mut self, published_ns: u64, message: &M) -> anyhow::Result<()> {
        Ok(self.recorder.write(published_ns.min(now_monotonic_ns()), message)?)
    }

    /// Stores the configuration of a reload, once, if the status still contains it: the status is written before the
    /// loop applies the reload.
    fn record_reload(&mut self, time_ns: u64, number: u64) -> anyhow::Result<()> {
        if number == 0 || number == self.settings_number {
            return Ok(());
        }
        if let Some(facts) = self.status().filter(|facts| facts.reload == number) {
            let config_toml = recorded_config(&facts)?;
            let Status { model_toml, similar_toml, .. } = facts;
            let reloaded = Reloaded { config_toml, model_toml, similar_toml };
            self.recorder.add_reload(time_ns, number, &reloaded)?;
            self.settings_number = number;
        }
        Ok(())
    }

    /// Stores the profile of a newly loaded subject, so that a search finds the recording by its pseudonym.
    fn record_subject(&mut self) -> anyhow::Result<()> {
        self.status().map_or(Ok(()), |facts| self.record_subject_of(facts))
    }

    fn record_subject_of(&mut self, facts: Status) -> anyhow::Result<()> {
        if facts.subject == self.subject {
            return Ok(());
        }
        let mut profile = if facts.subject.is_empty() { String::new() } else { read_profile(&facts) };
        self.subject = facts.subject;
        if profile.is_empty() {
            // A new subject has no profile yet, an unnamed one none at all.
            let name = if self.subject.is_empty() { ANONYMOUS } else { &self.subject };
            profile = format!("subject = {name:?}\n");
        }
        Ok(self.recorder.add_subject(self.newest_ns, &profile)?)
    }
}

#[cfg(test)]
mod tests {
    use equipoise_adapters::recording::Recording;
    use equipoise_core::message::{AdapterHealth, CycleRecord, GroundSample};

    use super::*;

    fn sink(out: &Path) -> Sink {
        let mut recorder = Recorder::create(out, &RecordingHeader::default()).unwrap();
        let pictures = Pictures::announce(&mut recorder, 0.0).unwrap();
        let (station, subject, daemons) = ("s".to_owned(), "a".to_owned(), Daemons::All);
        let (newest_ns, settings_number, instance) = (0, 0, (0, 0));
        Sink { recorder, pictures, newest_ns, station, subject, settings_number, instance, daemons }
    }

    #[test]
    fn a_stamp_in_the_future_is_no_log_time_and_does_not_date_later_messages() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.mcap");
        let (mut sink, due_ns) = (sink(&path), now_monotonic_ns());
        sink.write_result(due_ns, &CycleRecord { due_ns, ..CycleRecord::zeroed() }).unwrap();
        for published_ns in [due_ns - 1, u64::MAX / 2] {
            sink.write_input(published_ns, &GroundSample::zeroed()).unwrap();
            sink.write_input(published_ns, &AdapterHealth::zeroed()).unwrap();
        }
        assert_eq!(sink.newest_ns, due_ns);
        sink.recorder.finish().unwrap();
        let recording = Recording::open(&path).unwrap();
        let times: Vec<u64> = recording.entries().map(|timed| timed.unwrap().log_time_ns).collect();
        assert_eq!(times[..3], [due_ns, due_ns - 1, due_ns - 1]);
        assert_eq!(times.len(), 5);
        assert!(times.iter().all(|time_ns| *time_ns <= now_monotonic_ns()), "{times:?}");
    }

    #[test]
    fn every_change_of_the_subject_is_attached_also_to_one_without_a_name() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.mcap");
        let state = StateDirectory::at(directory.path());
        std::fs::create_dir_all(state.profiles()).unwrap();
        let profile = "format = 3\nsubject = \"b\"\n";
        std::fs::write(state.profile("b"), profile).unwrap();
        let mut sink = sink(&path);
        sink.write_result(1, &CycleRecord::zeroed()).unwrap();
        for subject in ["a", "b", "", "", "c"] {
            let status = serde_json::json!({
                "version": "", "process_id": 1, "station": "s", "config_toml": "", "memory_lock": "", "threads": [],
                "subject": subject, "state_directory": directory.path(),
            });
            sink.record_subject_of(serde_json::from_value(status).unwrap()).unwrap();
        }
        sink.recorder.finish().unwrap();
        let attached = Recording::open(&path).unwrap().header().later_subjects_toml.clone();
        assert_eq!(attached, [profile, "subject = \"anonymous\"\n", "subject = \"c\"\n"]);
    }
}
