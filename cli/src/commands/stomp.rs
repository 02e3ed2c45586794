//! `equipoise stomp`: how much later the suit is than the plate, from a foot that is stamped down.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::bail;
use equipoise_adapters::calibration::stomp::{
    Force, StompOffset, StompRefusal, StompSettings, estimate, feet_of_heights,
};
use equipoise_config::Config;
use equipoise_core::body::Side;
use equipoise_core::message::{GroundSample, SuitSample};

use super::{Outcome, StationArgument};
use crate::calibration::config_file::{self, Calibrated, Change};
use crate::calibration::latency::{self, Latencies};
use crate::client;
use crate::client::StreamTimeout;

/// Fewer stomps are no measurement: one of them may have been a step.
const STOMPS_MIN: usize = 3;
/// How often it is looked whether there are enough.
const REPORT_INTERVAL: Duration = Duration::from_millis(500);
/// How long the streams are awake before anybody stamps, and go on after the last stomp.
const PAUSE: Duration = Duration::from_millis(5);

/// Find the constant delay between suit and plate: the worker stamps a foot down
///
/// Stand on the plate with the weight on one foot, raise the other and stamp it down, five times at an irregular beat. The
/// foot stops at the moment at which the plate is hit; what lies between both is the delay that `latency_ms` is for.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: equipoise stomp --write /etc/equipoise/station-1.toml\n\nRestart the daemon to apply the result. \
                  Exit code 1: no delay could be determined; the message says why."
)]
pub(super) struct Arguments {
    #[command(flatten)]
    station: StationArgument,
    /// Watch for so long at most
    #[arg(long = "for", value_name = "SECONDS", value_parser = super::seconds, default_value = "30")]
    seconds: f64,
    /// End once so many stomps were seen
    #[arg(long, value_name = "COUNT", default_value_t = 5)]
    stomps: usize,
    /// Set `latency_ms` in this configuration file
    #[arg(long, value_name = "CONFIG")]
    write: Option<PathBuf>,
    /// As JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let station = &arguments.station.station;
    let config = client::active_configuration_of(station)?;
    if arguments.stomps < STOMPS_MIN {
        bail!("--stomps {}: {STOMPS_MIN} at least", arguments.stomps);
    }
    if let Some(path) = &arguments.write {
        // Check the file before the worker stomps.
        config_file::check(path, &config, Calibrated::Latencies)?;
    }
    eprintln!(
        "stand on the plate with the weight on one foot; raise the other and stamp it down, {} times, now sooner, now later",
        arguments.stomps
    );
    let offset = watch(arguments)?;
    let suit_later_ms = -(offset.offset_ns as f64) * 1e-6;
    let sigma_ms = offset.sigma_ns as f64 * 1e-6;
    let before = Latencies { suit_ms: config.suit.latency_ms, ground_ms: config.ground.latency_ms };
    let is_shown = suit_later_ms.abs() > 2.0 * sigma_ms;
    let after = if is_shown { before.without_skew(suit_later_ms.round()) } else { before };
    if arguments.json {
        let text = serde_json::json!({
            "suit_later_ms": suit_later_ms,
            "sigma_ms": sigma_ms,
            "residual_ms": offset.residual_ns as f64 * 1e-6,
            "stomps": offset.stomps,
            "plate_hits": offset.plate_hits,
            "foot_stops": offset.foot_stops,
            "in_force": { "suit_latency_ms": before.suit_ms, "ground_latency_ms": before.ground_ms },
            "set": latency::settings_to_change(&config, before, after).into_iter().collect::<BTreeMap<_, _>>(),
            "elsewhere": latency::external_setting(&config, before, after),
        });
        println!("{}", serde_json::to_string_pretty(&text)?);
    } else {
        let [stomps, hits, stops] = [offset.stomps, offset.plate_hits, offset.foot_stops];
        println!(
            "{stomps} stomps measured by both (plate: {hits}, suit: {stops}), {:.1} ms apart from each other",
            offset.residual_ns as f64 * 1e-6
        );
        let relation = if suit_later_ms > 0.0 { "later" } else { "earlier" };
        println!("the suit is {:.1} ± {sigma_ms:.1} ms {relation} than the ground", suit_later_ms.abs());
        match latency::advice(&config, before, after) {
            Some(line) => println!("{line}"),
            None => println!("that is less than twice its σ: leave latency_ms as it is"),
        }
    }
    if let Some(path) = &arguments.write {
        write_latencies(path, &config, before, after)?;
    }
    Ok(Outcome::Done)
}

/// Writes what is to change.
fn write_latencies(
    path: &std::path::Path,
    config: &Config,
    before: Latencies,
    after: Latencies,
) -> anyhow::Result<()> {
    if let Some(external_setting) = latency::external_setting(config, before, after) {
        bail!("{}: left as it is: {external_setting}", path.display());
    }
    let settings_to_change = latency::settings_to_change(config, before, after);
    if settings_to_change.is_empty() {
        eprintln!("{}: nothing to change", path.display());
        return Ok(());
    }
    let changes: Vec<Change> = settings_to_change
        .into_iter()
        .map(|(key, ms)| (key.to_owned(), config_file::number(ms, 1)))
        .collect();
    config_file::write(path, &changes)?;
    eprintln!(
        "{}: written; restart the daemon and, if the sensor's adapter is a process of its own, that too (systemd: \
         `systemctl restart equipoise 'equipoise-adapter@*'`)",
        path.display()
    );
    Ok(())
}

/// Watches both streams until there are enough stomps, or the time is over.
fn watch(arguments: &Arguments) -> anyhow::Result<StompOffset> {
    let stop = super::stop_on_signals()?;
    let station = &arguments.station.station;
    let bus = client::join(station, "stomp")?;
    let mut suits = bus.subscriber::<SuitSample>(128)?;
    let mut grounds = bus.subscriber::<GroundSample>(1024)?;
    let [mut suit, mut ground] = ["the suit", "the ground"].map(|what| StreamTimeout::new(what, station));
    let (mut heights, mut forces) = (Vec::new(), Vec::new());
    let (started, mut reported) = (Instant::now(), Instant::now());
    let mut printed = 0;
    let (mut found, mut since) = (None, Instant::now());
    while started.elapsed().as_secs_f64() < arguments.seconds && !stop.load(Ordering::Relaxed) {
        while let Some(sample) = suits.receive()? {
            suit.reset();
            heights.push((
                sample.sample_time_ns,
                Side::BOTH.map(|side| sample.position_m[side.foot().index()][2]),
            ));
        }
        while let Some(sample) = grounds.receive()? {
            ground.reset();
            if sample.device_status == 0 {
                forces.push(Force { time_ns: sample.sample_time_ns, vertical_n: sample.force_n[2] });
            }
        }
        suit.check()?;
        ground.check()?;
        if reported.elapsed() >= REPORT_INTERVAL {
            reported = Instant::now();
            found = Some(estimate(&forces, &feet_of_heights(&heights), &StompSettings::default()));
            let stomps = found.as_ref().map_or(0, |found| found.as_ref().map_or(0, |offset| offset.stomps));
            if stomps > printed {
                eprintln!("stomp {stomps} of {}", arguments.stomps);
                (printed, since) = (stomps, Instant::now());
            }
            // The end of the last stomp may still be pending.
            if stomps >= arguments.stomps && since.elapsed() > 2 * REPORT_INTERVAL {
                break;
            }
        }
        std::thread::sleep(PAUSE);
    }
    require_stomps(found.unwrap_or(Err(StompRefusal::NoHit { largest_n: 0.0, needed_n: 0.0 }))?)
}

fn require_stomps(offset: StompOffset) -> anyhow::Result<StompOffset> {
    if offset.stomps < STOMPS_MIN {
        bail!(
            "{} of the {STOMPS_MIN} stomps that are needed at least were measured by both suit and plate (plate: {}, the \
             suit: {}); stamp harder, or watch longer with --for",
            offset.stomps,
            offset.plate_hits,
            offset.foot_stops
        );
    }
    Ok(offset)
}
