//! Prints every consumer report of a station, together with the station's current cycle; `.ci/clients` evaluates the
//! output.
//!
//! ```sh
//! cargo run --release -p equipoise-client --example receipts -- station-1
//! ```
use equipoise_bus::{Bus, BusSettings, Channel};
use equipoise_core::message::consumer_receipt::{BUCKETS, shortest_ns};
use equipoise_core::message::{ConsumerReceipt, State};
use std::error::Error;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The bucket that contains the median, by the same rank (count - 1) / 2 as in a sorted list.
fn p50_bucket(histogram: &[u64; BUCKETS]) -> usize {
    let count: u64 = histogram.iter().sum();
    let mut below = 0;
    histogram
        .iter()
        .position(|entries| {
            below += entries;
            below > count.saturating_sub(1) / 2
        })
        .unwrap_or(0)
}

fn line(report: &ConsumerReceipt, cycle: u64) -> String {
    let end = report.consumer.iter().position(|byte| *byte == 0).unwrap_or(report.consumer.len());
    let entries = |histogram: &[u64; BUCKETS]| histogram.iter().sum::<u64>();
    let p50 = p50_bucket(&report.published_to_consumer);
    format!(
        "consumer={} pid={} at_ns={} since_ns={} states={} missed={} published_entries={} due_entries={} \
         suit_entries={} p50_from_ns={} p50_to_ns={} max_ns={} cycle={cycle}",
        String::from_utf8_lossy(&report.consumer[..end]),
        report.process_id,
        report.time_ns,
        report.since_ns,
        report.states,
        report.states_missed,
        entries(&report.published_to_consumer),
        entries(&report.due_to_consumer),
        entries(&report.suit_to_consumer),
        shortest_ns(p50),
        shortest_ns((p50 + 1).min(BUCKETS - 1)),
        report.max_ns[0],
    )
}

fn main() -> Result<(), Box<dyn Error>> {
    let station = std::env::args().nth(1).ok_or("usage: receipts STATION")?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    let bus = Bus::join(&BusSettings::new(&station, "receipts"))?;
    let (mut reports, mut states) = (bus.subscriber::<ConsumerReceipt>(32)?, bus.subscriber::<State>(1)?);
    let listener = bus.listener(Channel::Results)?;
    let mut cycle = 0;
    // Read once more after the signal, to include the final reports of consumers that have ended.
    let mut last_round = false;
    while !last_round {
        last_round = stop.load(Ordering::Relaxed);
        listener.wait(Duration::from_millis(100))?;
        cycle = states.latest()?.map_or(cycle, |state| state.cycle);
        while let Some(text) = reports.receive_with(|report| line(report, cycle))? {
            println!("{text}");
        }
    }
    Ok(())
}
