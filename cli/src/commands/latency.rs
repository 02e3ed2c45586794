//! `equipoise latency`: a consumer that measures the path, stage by stage, its own pick-up and the others' included.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Context, bail};
use equipoise_bus::{Bus, BusError, Channel, Listener, Subscriber, Topic};
use equipoise_core::message::{ConsumerReceipt, CycleRecord, State};
use equipoise_daemon::realtime::now_ns;
use equipoise_files::atomic_file::write_atomically_with;
use equipoise_latency::receipt::{since_its_start, tell_apart};
use equipoise_latency::{ConsumerReceipts, ConsumerTimes, HlogWriter, PathHistograms, Report};

use super::{Outcome, StationArgument};
use crate::client;
use crate::receipt::ReceiptBuilder;

/// What this consumer is called among the others.
const OWN_NAME: &str = "self";
/// Maximum extension of the measurement until a first cycle: a busy machine delays a daemon for seconds.
const FIRST_CYCLE_TIMEOUT_S: f64 = 10.0;
/// The owner writes, the group reads, others have no access.
const MODE: u32 = 0o640;

/// Measure the path from sensor to consumer and print percentiles per stage
///
/// Stages up to the published state come from the cycles' own stamps; receipt, from_due and from_suit of every consumer
/// that reports its pick-up follow, and of this command as `self`. Consumers report once a second, so of theirs the
/// last second or less is missing. docs/realtime.md explains the figures.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: equipoise latency --for 60 --hlog path.hlog\n\nExit code 3: cycles were not seen; \
                        the last lines say how many."
)]
pub(super) struct Arguments {
    #[command(flatten)]
    station: StationArgument,
    /// For how many seconds
    #[arg(long = "for", default_value_t = 10.0, value_name = "SECONDS", value_parser = super::seconds)]
    seconds: f64,
    /// Write an interval log in the HdrHistogram format, one entry per stage
    #[arg(long, value_name = "FILE")]
    hlog: Option<PathBuf>,
    /// As JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let stop = super::stop_on_signals()?;
    // Create the file first, so that an error appears before a measurement of a minute.
    let hlog = arguments.hlog.as_deref().map(create).transpose()?;
    let bus = client::join(&arguments.station.station, "latency")?;
    client::newest_state(&bus)?;
    let mut subscriptions = Subscriptions::open(&bus)?;
    let (started, since) = (Instant::now(), SystemTime::now());
    let is_over = |path: &PathHistograms| {
        let extension_s = if path.counts().cycles == 0 { FIRST_CYCLE_TIMEOUT_S } else { 0.0 };
        started.elapsed().as_secs_f64() >= arguments.seconds + extension_s
    };
    while !is_over(&subscriptions.path) && !stop.load(Ordering::Relaxed) {
        subscriptions.update()?;
    }
    let (length, consumers) = (started.elapsed(), subscriptions.consumers());
    let report = Report::of(&subscriptions.path).with_consumers(&consumers);
    if report.cycles == 0 {
        bail!("the daemon published no cycle in {:.1} s", length.as_secs_f64());
    }
    if let (Some(path), Some(file)) = (&arguments.hlog, hlog) {
        let mut log = Vec::new();
        let mut writer = HlogWriter::new(&mut log, since)?;
        writer.write_interval(Duration::ZERO, length, &subscriptions.path)?;
        writer.write_consumers(Duration::ZERO, length, &consumers)?;
        replace(path, file, &log).with_context(|| format!("cannot write {}", path.display()))?;
    }
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&report)?);
    } else {
        print!("{report}");
    }
    Ok(if report.cycles_lost > 0 { Outcome::PartRejected } else { Outcome::Done })
}

/// Opens the log without changing an earlier one.
fn create(path: &Path) -> anyhow::Result<File> {
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(false).mode(MODE);
    options.open(path).with_context(|| format!("cannot write {}", path.display()))
}

/// Writes the log; an earlier one is kept until the new one is complete.
fn replace(path: &Path, mut file: File, log: &[u8]) -> std::io::Result<()> {
    let before = file.metadata()?;
    if !before.is_file() {
        return file.write_all(log);
    }
    // Replace the target of a link, so that the link remains.
    write_atomically_with(&path.canonicalize()?, log, |file| file.set_permissions(before.permissions()))
}

/// Everything subscribed, and what was seen.
struct Subscriptions {
    listener: Listener,
    records: Subscriber<CycleRecord>,
    states: Subscriber<State>,
    reports: Option<Subscriber<ConsumerReceipt>>,
    path: PathHistograms,
    others: ConsumerReceipts,
    own: ReceiptBuilder,
}

impl Subscriptions {
    fn open(bus: &Bus) -> anyhow::Result<Subscriptions> {
        let reports = match bus.subscriber(ConsumerReceipt::SERVICE.depth_max) {
            Ok(reports) => Some(reports),
            Err(full @ BusError::Full { .. }) => {
                eprintln!("equipoise: what consumers report is not shown: {full}");
                None
            }
            Err(error) => return Err(error.into()),
        };
        let (records, states) = (bus.subscriber(CycleRecord::SERVICE.depth_max)?, bus.subscriber(1024)?);
        let listener = bus.listener(Channel::Results)?;
        let since_ns = now_ns();
        let own = ReceiptBuilder::new(OWN_NAME, since_ns);
        let (path, others) = (PathHistograms::new(), ConsumerReceipts::new(since_ns));
        Ok(Subscriptions { listener, records, states, reports, path, others, own })
    }

    /// Sleeps until something is published and takes it in, the states first: they are what a consumer waits for.
    fn update(&mut self) -> Result<(), BusError> {
        self.listener.wait(Duration::from_millis(100))?;
        while let Some(state) = self.states.receive()? {
            self.own.record(&state, now_ns());
        }
        while let Some(record) = self.records.receive()? {
            if record.publish_start_ns >= self.own.report().since_ns {
                self.path.record(&record);
            }
        }
        if let Some(reports) = &mut self.reports {
            while reports.receive_with(|report| self.others.ingest(report))?.is_some() {}
        }
        Ok(())
    }

    /// Every consumer, this one last.
    fn consumers(&self) -> Vec<ConsumerTimes> {
        let mut all = self.others.consumers();
        all.extend((self.own.report().states > 0).then(|| since_its_start(self.own.report())));
        tell_apart(&mut all);
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::{MetadataExt, symlink};

    #[test]
    fn an_earlier_log_is_replaced_as_a_whole() {
        let folder = tempfile::tempdir().unwrap();
        let (path, link) = (folder.path().join("a.hlog"), folder.path().join("link.hlog"));
        std::fs::write(&path, "an earlier log, longer than the new one").unwrap();
        symlink("a.hlog", &link).unwrap();
        let reader = File::open(&path).unwrap();
        let file = create(&link).unwrap();
        replace(&link, file, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_ne!(reader.metadata().unwrap().ino(), std::fs::metadata(&path).unwrap().ino());
        assert_eq!(std::io::read_to_string(reader).unwrap(), "an earlier log, longer than the new one");
    }
}
