//! `equipoise import`: captures become a recording.

use std::path::PathBuf;

use anyhow::bail;
use equipoise_adapters::capture::Units;
use equipoise_core::time::NS_PER_S;
use equipoise_recording::import::{Join, PlateOptions, With, import, unix_time};
use equipoise_recording::replay::input::Input;

use super::{Outcome, seconds};
use crate::progress_bar::Bar;

/// Turn a capture (.csv, .mvnx, .pcap, .pcapng), or a suit's and a plate's together, into a recording
///
/// CSV: one row per instant with t_s, each segment's origin and quaternion in MVN's names, and the ground reaction.
/// pcap, pcapng: the datagrams of suit and plate as Wireshark or tcpdump captured them; the configuration defines
/// their ports, the scale, and the position of the plate. mvnx: motion as MVN exports it, versions 3 and 4. With
/// --with the suit's samples come from FILE and the ground's from the other: a plate's text export (BioWare and
/// alike: .txt, .tsv, .csv), a capture (.pcap, .pcapng) or a recording; --join selects how their clocks are aligned.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  equipoise import morning.pcapng -o morning.mcap --config equipoise.toml\n  equipoise \
                  import take.mvnx --with plate.txt --join stomp -o take.mcap --config lab.toml\n\nA file is never \
                  overwritten. Exit code 3: part of the captures was rejected; the summary lists the reasons."
)]
pub(super) struct Arguments {
    /// Capture to read
    file: PathBuf,
    /// Recording to create
    #[arg(short, long, value_name = "OUT.mcap")]
    out: PathBuf,
    /// Configuration to read it with and to keep in the recording; defaults without it
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// The plate's file, in addition to the suit's
    #[arg(long, value_name = "PLATE", requires = "join")]
    with: Option<PathBuf>,
    /// How the clocks of both files are aligned: clock (both contain the time of day), stomp (by stomps of a foot in
    /// both), offset=SECONDS (plate time minus suit time, each counted from its first sample, a recording's from its start)
    #[arg(long, requires = "with")]
    join: Option<Join>,
    /// Search range of the stomp's clock difference, s; by default one day
    #[arg(long, value_name = "S", value_parser = seconds, requires = "with")]
    within: Option<f64>,
    /// Units of the plate's file where it contains none, such as s,N,N.m,m
    #[arg(long, value_name = "UNITS", value_parser = Units::parse, requires = "with")]
    with_units: Option<Units>,
    /// Which of the plates in the plate's file, from 1
    #[arg(long, value_name = "N", requires = "with")]
    with_plate: Option<usize>,
    /// Distances of the four sensors from the plate's middle, m, for files with eight channels, such as 0.12,0.2
    #[arg(long, value_name = "A,B", value_parser = offsets, requires = "with")]
    with_sensors: Option<[f64; 2]>,
    /// When the first row of the plate's file was measured, such as 2026-11-21T10:15:00.250Z
    #[arg(long, value_name = "TIME", value_parser = unix_time::parse, requires = "with")]
    with_start: Option<u64>,
}

fn offsets(text: &str) -> Result<[f64; 2], String> {
    let mut numbers = text.split(',').map(|number| number.trim().parse::<f64>());
    match (numbers.next(), numbers.next(), numbers.next()) {
        (Some(Ok(a)), Some(Ok(b)), None) if (0.0..2.0).contains(&a) && (0.0..2.0).contains(&b) => Ok([a, b]),
        _ => Err("give two distances in metres, such as 0.12,0.2".to_owned()),
    }
}

impl Arguments {
    fn with(&self) -> anyhow::Result<Option<With<'_>>> {
        let (Some(plate), Some(join)) = (&self.with, self.join) else { return Ok(None) };
        let join = match (join, self.within) {
            (Join::Stomp { .. }, Some(seconds)) => {
                Join::Stomp { within_ns: (seconds * NS_PER_S as f64) as u64 }
            }
            (_, Some(_)) => bail!("--within is for --join stomp"),
            (join, None) => join,
        };
        let options = PlateOptions {
            units: self.with_units.unwrap_or_default(),
            plate: self.with_plate,
            sensor_offsets_m: self.with_sensors,
            start_unix_ns: self.with_start,
        };
        Ok(Some(With { plate, options, join }))
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let Arguments { file, out, config, .. } = arguments;
    let with = arguments.with()?;
    let input = Input::open(file)?;
    let bar = Bar::new(false);
    let summary =
        bar.follow("importing", &input, || import(&input, file, with.as_ref(), out, config.as_deref()))?;
    bar.clear();
    print!("{}: {summary}", out.display());
    Ok(if summary.skipped.rejected.is_empty() { Outcome::Done } else { Outcome::PartRejected })
}
