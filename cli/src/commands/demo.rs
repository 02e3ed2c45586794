//! `equipoise demo`: the whole path on one machine, without hardware.

use std::net::SocketAddr;
use std::time::Duration;

use anyhow::bail;

use super::{Outcome, log_to_stderr};
use crate::demo::{self, DemoSettings};

/// Show the whole path on this machine: simulated person, real daemon, page
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  equipoise demo\n  equipoise demo --headless --json --duration 180")]
pub(super) struct Arguments {
    /// End after this many seconds at the latest
    #[arg(long, default_value_t = 240, value_name = "SECONDS")]
    duration: u64,
    /// Serve no page
    #[arg(long, conflicts_with = "page")]
    headless: bool,
    /// Loopback address of the page [default: 127.0.0.1:8017, or a free port]
    #[arg(long, value_name = "ADDRESS")]
    page: Option<SocketAddr>,
    /// Print nothing but the summary, as JSON
    #[arg(long)]
    json: bool,
    /// Another seed is another person
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Name of the station
    #[arg(long, default_value = "demo")]
    station: String,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    log_to_stderr("warn");
    let page = match (arguments.headless, arguments.page) {
        (true, _) => None,
        (false, page) => Some(page.unwrap_or_else(demo::default_page)),
    };
    let settings = DemoSettings {
        seed: arguments.seed,
        station: arguments.station.clone(),
        duration: Duration::from_secs(arguments.duration),
        page,
        verbose: !arguments.json,
    };
    let stop = super::stop_on_signals()?;
    let summary = demo::run(&settings, &stop)?;
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&summary)?);
    } else {
        println!("\n{summary}");
    }
    if !summary.complete {
        bail!("the demonstration is not complete: no valid torque, or no still pose, was seen");
    }
    Ok(Outcome::Done)
}
