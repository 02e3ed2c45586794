//! `equipoise import`: a capture becomes a recording.

use std::path::PathBuf;

use super::Outcome;
use crate::import::import;

/// Turn a capture (.csv, .pcap, .pcapng) into a recording
///
/// CSV: one row per instant with t_s, each segment's origin and quaternion in MVN's names, and the ground reaction.
/// pcap, pcapng: the datagrams of suit and plate as Wireshark or tcpdump captured them; the configuration says on
/// which ports, with which scale, and where the plate stands.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: equipoise import morning.pcapng -o morning.mcap --config equipoise.toml\n\nA file is \
                        never overwritten. Exit code 3: part of the capture was rejected; the summary says what."
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
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let summary = import(&arguments.file, &arguments.out, arguments.config.as_deref())?;
    print!("{}: {summary}", arguments.out.display());
    Ok(if summary.left_out.rejected.is_empty() { Outcome::Done } else { Outcome::PartRejected })
}
