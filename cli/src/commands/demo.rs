//! `equipoise demo`: the whole path on one machine, without hardware.

use std::net::SocketAddr;
use std::time::Duration;

use super::{Outcome, log_to_stderr};
use crate::demo::{self, DemoSettings};

/// Show the whole path on this machine, until Ctrl-C: simulated humans, real daemon, page
///
/// Two simulated humans of different build take turns: each is identified pose by pose, then lifts boxes of 4, 10 and 16 kg.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  equipoise demo\n  equipoise demo --once --headless --json\n  equipoise demo --cobot"
)]
pub(super) struct Arguments {
    /// One pass with one simulated human, without waiting for a viewer
    #[arg(long)]
    once: bool,
    /// Instead of the boxes a simulated UR10e hands over a part of 6 kg: at a fixed place, then where the daemon plans it
    #[arg(long)]
    cobot: bool,
    /// End after this many seconds at the latest [default with --once: 240]
    #[arg(long, value_name = "SECONDS")]
    duration: Option<u64>,
    /// Serve no page
    #[arg(long, conflicts_with = "page")]
    headless: bool,
    /// Loopback address of the page [default: 127.0.0.1:8017, or a free port]
    #[arg(long, value_name = "ADDRESS")]
    page: Option<SocketAddr>,
    /// Print nothing but the summary of each pass, as JSON; without waiting for a viewer
    #[arg(long)]
    json: bool,
    /// Another seed is another person; odd and even ones differ in build
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
        once: arguments.once,
        cobot: arguments.cobot,
        duration: arguments.duration.map(Duration::from_secs),
        page,
        for_viewer: page.is_some() && !arguments.once && !arguments.json,
        verbose: !arguments.json,
    };
    let stop = super::stop_on_signals()?;
    let passes = demo::run(&settings, &stop, |summary| {
        if arguments.json {
            println!("{}", serde_json::to_string_pretty(summary)?);
        } else {
            println!("\n{summary}\n");
        }
        Ok(())
    })?;
    if passes == 0 && !arguments.json {
        println!("ended before a pass was complete; nothing to summarise");
    }
    Ok(Outcome::Done)
}
