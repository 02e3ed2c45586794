//! Records a station: one more consumer of the bus, that keeps all that a replay needs.
//!
//! Inputs, results, cycle records and checkpoints go into one file as they were published. A recorder that is too
//! slow loses messages and says so; the loop never waits for it. After a loss it asks for a new checkpoint, so that
//! the rest can be replayed exactly again.

pub mod authenticity;
pub mod keeping;
mod pictures;
pub mod service;
pub mod signature;
pub mod summary;

use std::cell::Cell;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use bytemuck::Zeroable;
use equipoise_adapters::recording::{Predecessor, Recorded, Recorder, RecordingHeader, Reloaded};
use equipoise_bus::{Bus, BusError, BusSettings, CommandClient, Subscriber, Topic};
use equipoise_core::cycle::Checkpoint;
use equipoise_core::message::{
    AdapterHealth, Command, CommandKind, CycleRecord, GroundSample, State, SuitBody, SuitSample,
};
use equipoise_files::{TEXT_BYTES_MAX, read_text};

pub use summary::RecordSummary;

use pictures::Pictures;

use crate::config::Config;
use crate::joined::Joined;
use crate::realtime::now_ns;
use crate::state_directory::StateDirectory;
use crate::status::{self, Status};

/// How often messages are fetched: well within the buffers, a quarter of a second at the highest rates.
const LOOK_EVERY: Duration = Duration::from_millis(10);
/// A crash loses at most so much.
const FLUSH_EVERY: Duration = Duration::from_secs(1);
/// How long a running daemon may take to answer.
const ANSWER_WITHIN: Duration = Duration::from_secs(2);
/// Samples that the loop took in just before we joined are in its memory by then.
const SETTLE: Duration = Duration::from_millis(300);
/// How often it is looked whether the file is still where it was made.
const PLACE_EVERY: Duration = Duration::from_secs(1);
/// Whose a recording is of a worker without a name.
const NOBODY: &str = "nobody";
/// At most so often is a new checkpoint asked for after losses.
const CHECKPOINT_PAUSE: Duration = Duration::from_secs(2);

/// Records `station` into a new file until `stopping` says so, with `pictures_hz` pictures a second; 0 leaves them out.
///
/// `started` is called once messages are being written. Returns what was recorded, and the SHA-256 of the file.
///
/// # Errors
/// A sentence: no daemon runs, the file exists or cannot be written (what was written stays readable), the bus breaks.
pub fn record(
    station: &str,
    out: &Path,
    pictures_hz: f64,
    stopping: &dyn Fn() -> bool,
    started: impl FnOnce(),
) -> anyhow::Result<(RecordSummary, String)> {
    let mut tap = Tap::open(station)?;
    let (looked, gone) = (Cell::new(Instant::now()), Cell::new(false));
    let ending = |progress: &Progress<'_>| {
        if looked.get().elapsed() >= PLACE_EVERY {
            looked.set(Instant::now());
            gone.set(progress.recorder.bytes_in_place().is_none());
        }
        gone.get() || stopping()
    };
    let sha256 = tap.record(out, None, pictures_hz, &ending, started)?;
    if gone.get() {
        bail!(
            "{} was removed or replaced while it was written: recording ends, and what it held is gone",
            out.display()
        );
    }
    Ok((tap.summary, sha256))
}

/// How a file fares that is being written.
struct Progress<'a> {
    recorder: &'a Recorder,
    summary: &'a RecordSummary,
    /// Process of the daemon whose configuration stands in the file's head.
    process_id: u32,
    joined: &'a Joined,
}

/// A station's bus, tapped: one file after the other can be recorded, and between them nothing is lost.
struct Tap {
    station: String,
    summary: RecordSummary,
    ports: Ports,
    commands: CommandClient,
    // Outlives its ports.
    _bus: Bus,
    joined: Joined,
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
        // Also shows that the daemon of the status file lives, before a file is made.
        ask_for_checkpoint(&commands)?;
        let joined = Joined::now(&settings.root);
        let (station, summary) = (station.to_owned(), RecordSummary::default());
        Ok(Tap { station, summary, ports, commands, _bus: bus, joined })
    }

    /// Whether the bus's directory is another one by now: whoever joins anew is not heard here.
    fn is_cut_off(&self) -> bool {
        self.joined.is_cut_off()
    }

    /// Makes a file with its head.
    fn begin(&self, out: &Path, previous: Option<Predecessor>, pictures_hz: f64) -> anyhow::Result<Sink> {
        let Some(facts) = status::read(&self.station) else {
            bail!("the daemon of station {} has ended", self.station);
        };
        let header = RecordingHeader {
            subject_toml: profile_of(&facts),
            config_toml: recorded_config(&facts)?,
            software_version: facts.version,
            started_unix_ns: unix_ns(),
            started_monotonic_ns: now_ns(),
            model_toml: facts.model_toml,
            previous,
            ..RecordingHeader::default()
        };
        let mut recorder = Recorder::create(out, &header)?;
        let pictures = Pictures::announce(&mut recorder, pictures_hz)?;
        let (newest_ns, station) = (header.started_monotonic_ns, self.station.clone());
        let (subject, process_id) = (facts.subject, facts.process_id);
        Ok(Sink { recorder, pictures, newest_ns, station, subject, process_id })
    }

    /// Records into a new file, which follows `previous`, until `ending` says so; returns its SHA-256.
    fn record(
        &mut self,
        out: &Path,
        previous: Option<Predecessor>,
        pictures_hz: f64,
        ending: &dyn Fn(&Progress<'_>) -> bool,
        started: impl FnOnce(),
    ) -> anyhow::Result<String> {
        let mut sink = self.begin(out, previous, pictures_hz)?;
        started();
        let (ports, summary) = (&mut self.ports, &mut self.summary);
        let joined = &self.joined;
        let mut checkpoint_due = Some(Instant::now() + SETTLE);
        let (mut flushed, mut lost) = (Instant::now(), summary.lost());
        loop {
            let (recorder, process_id) = (&sink.recorder, sink.process_id);
            if ending(&Progress { recorder, summary, process_id, joined }) {
                break;
            }
            std::thread::sleep(LOOK_EVERY);
            ports.fetch(&mut sink, summary)?;
            if summary.lost() > lost {
                lost = summary.lost();
                checkpoint_due.get_or_insert(Instant::now() + CHECKPOINT_PAUSE);
            }
            if checkpoint_due.is_some_and(|due| Instant::now() >= due) {
                checkpoint_due = None;
                // A daemon that has ended may come back, and then sends a checkpoint by itself.
                let _ = ask_for_checkpoint(&self.commands);
            }
            if flushed.elapsed() >= FLUSH_EVERY {
                flushed = Instant::now();
                sink.note_subject()?;
                sink.recorder.flush()?;
            }
        }
        ports.fetch(&mut sink, summary)?;
        sink.note_subject()?;
        Ok(sink.recorder.finish()?)
    }
}

/// The daemon publishes its whole memory as soon as it comes to it; egress hands it on.
fn ask_for_checkpoint(commands: &CommandClient) -> anyhow::Result<()> {
    let command = Command { kind: CommandKind::Checkpoint as u32, ..Command::zeroed() };
    let reply = commands.ask(&command, ANSWER_WITHIN)?;
    if reply.refused != 0 {
        bail!("the daemon gives no checkpoint: {}", crate::commands::text_of(&reply.text));
    }
    Ok(())
}

/// The worker's profile as it stands on disk, if there is one.
fn profile_of(facts: &Status) -> String {
    let state = StateDirectory::of_daemon(facts).or_else(|| StateDirectory::of_environment().ok());
    let text = state.and_then(|state| read_text(&state.profile(&facts.subject), TEXT_BYTES_MAX).ok());
    text.unwrap_or_default()
}

/// The daemon's configuration for recordings, without a subject's identity once the configured subject was deleted.
fn recorded_config(facts: &Status) -> anyhow::Result<String> {
    let mut config = Config::parse(&facts.config_toml, "the daemon's configuration")?.without_paths();
    if facts.subject.is_empty() {
        config.subject.id = NOBODY.to_owned();
    }
    Ok(config.to_toml())
}

fn unix_ns() -> u64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(0)
}

/// The file, and the newest time in it.
struct Sink {
    recorder: Recorder,
    pictures: Pictures,
    newest_ns: u64,
    station: String,
    /// Whose profile is in the file already.
    subject: String,
    process_id: u32,
}

impl Sink {
    fn write<M: Recorded>(&mut self, time_ns: u64, message: &M) -> anyhow::Result<()> {
        self.newest_ns = self.newest_ns.max(time_ns);
        Ok(self.recorder.write(time_ns, message)?)
    }

    /// Keeps the configuration that a reload brought, if the daemon still tells it: it does before the loop has it.
    fn note_reload(&mut self, record: &CycleRecord) -> anyhow::Result<()> {
        if record.command != CommandKind::Reload as u32 {
            return Ok(());
        }
        let number = record.command_argument[0] as u64;
        if let Some(facts) = status::read(&self.station).filter(|facts| facts.reload == number && number > 0)
        {
            let reloaded = Reloaded { config_toml: recorded_config(&facts)?, model_toml: facts.model_toml };
            self.recorder.add_reload(record.due_ns, number, &reloaded)?;
        }
        Ok(())
    }

    /// Keeps the profile of whoever has come into use: whose data are in here must be found again.
    fn note_subject(&mut self) -> anyhow::Result<()> {
        let Some(facts) = status::read(&self.station).filter(|facts| facts.subject != self.subject) else {
            return Ok(());
        };
        let profile = profile_of(&facts);
        self.subject = facts.subject;
        if !profile.is_empty() {
            self.recorder.add_subject(self.newest_ns, &profile)?;
        }
        Ok(())
    }
}

/// Everything subscribed, with the deepest buffers there are.
struct Ports {
    cycle: Subscriber<CycleRecord>,
    state: Subscriber<State>,
    checkpoint: Subscriber<Checkpoint>,
    suit: Subscriber<SuitSample>,
    ground: Subscriber<GroundSample>,
    body: Subscriber<SuitBody>,
    health: Subscriber<AdapterHealth>,
}

impl Ports {
    fn open(bus: &Bus) -> Result<Ports, BusError> {
        Ok(Ports {
            cycle: bus.subscriber(CycleRecord::SERVICE.depth_max)?,
            state: bus.subscriber(State::SERVICE.depth_max)?,
            checkpoint: bus.subscriber(Checkpoint::SERVICE.depth_max)?,
            suit: bus.subscriber(SuitSample::SERVICE.depth_max)?,
            ground: bus.subscriber(GroundSample::SERVICE.depth_max)?,
            body: bus.subscriber(SuitBody::SERVICE.depth_max)?,
            health: bus.subscriber(AdapterHealth::SERVICE.depth_max)?,
        })
    }

    /// Writes all that waits. A message is fetched after what was published later, so that a recording that ends
    /// here has the state and the samples of every cycle record in it.
    fn fetch(&mut self, sink: &mut Sink, summary: &mut RecordSummary) -> anyhow::Result<()> {
        take(&mut self.cycle, |record| {
            summary.cycles.see(record.cycle);
            sink.note_reload(record)?;
            sink.write(record.due_ns, record)
        })?;
        take(&mut self.state, |state| {
            summary.states.see(state.cycle);
            sink.write(state.time_ns, state)?;
            sink.pictures.add(&mut sink.recorder, state)
        })?;
        take(&mut self.checkpoint, |checkpoint| {
            summary.checkpoints += 1;
            // It has no time of its own.
            sink.write(sink.newest_ns, checkpoint)
        })?;
        take(&mut self.suit, |sample| {
            summary.suit.see(sample.sequence);
            sink.write(sample.published_ns, sample)
        })?;
        take(&mut self.ground, |sample| {
            summary.ground.see(sample.sequence);
            sink.write(sample.published_ns, sample)
        })?;
        take(&mut self.body, |body| sink.write(body.published_ns, body))?;
        take(&mut self.health, |health| {
            summary.health += 1;
            sink.write(health.time_ns, health)
        })
    }
}

/// Reads every waiting message where it lies: a checkpoint is too large for the stack.
fn take<M: Topic>(
    port: &mut Subscriber<M>,
    mut write: impl FnMut(&M) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    // At most one buffer's worth, so that a fast publisher cannot keep us here.
    for _ in 0..M::SERVICE.depth_max {
        match port.receive_with(&mut write)? {
            Some(written) => written.with_context(|| "the recording has ended")?,
            None => break,
        }
    }
    Ok(())
}
