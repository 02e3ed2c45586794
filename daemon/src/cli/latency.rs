//! `equipoise latency`: a consumer that measures the path, stage by stage.

use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Context, bail};
use equipoise_bus::Channel;
use equipoise_core::message::CycleRecord;
use equipoise_latency::{HlogWriter, PathHistograms, Report};

use super::{Outcome, StationArgument, client};

/// Measure the path from sensor to published state and print percentiles per stage
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: equipoise latency --for 60 --hlog path.hlog")]
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
    let stop = super::run::stop_on_signals()?;
    let bus = client::join(&arguments.station.station, "latency")?;
    client::newest_state(&bus)?;
    let mut records = bus.subscriber::<CycleRecord>(1024)?;
    let listener = bus.listener(Channel::Results)?;
    let (mut histograms, started, since) = (PathHistograms::new(), Instant::now(), SystemTime::now());
    while started.elapsed().as_secs_f64() < arguments.seconds && !stop.load(Ordering::Relaxed) {
        listener.wait(Duration::from_millis(100))?;
        while let Some(record) = records.receive()? {
            histograms.record(&record);
        }
    }
    let report = Report::of(&histograms);
    if report.cycles == 0 {
        bail!("the daemon published no cycle in {:.1} s", started.elapsed().as_secs_f64());
    }
    if let Some(path) = &arguments.hlog {
        let file = File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
        HlogWriter::new(BufWriter::new(file), since)?.write_interval(
            Duration::ZERO,
            started.elapsed(),
            &histograms,
        )?;
    }
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&report)?);
    } else {
        print!("{report}");
    }
    Ok(if report.cycles_lost > 0 { Outcome::PartRejected } else { Outcome::Done })
}
