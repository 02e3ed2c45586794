//! Sources over real sockets on loopback, against simulated devices.

mod described_over_sockets;
mod labamp;
mod lsl;
mod qtm;
mod sources;
mod suit_tcp;

use equipoise_adapters::source::GroundSource;
use equipoise_core::message::GroundSample;
use std::panic::{RefUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

/// Long enough for a loaded machine; no test here measures speed.
const PATIENCE: Duration = Duration::from_secs(90);

/// Number of runs of a test that a stall of the machine may disturb: a sender that is silent for a second no longer holds
/// the port. One run must pass; a defect is in each.
const ATTEMPTS: usize = 3;

fn repeat_after_stall(test: impl Fn() + RefUnwindSafe) {
    let passes = || catch_unwind(&test).is_ok();
    assert!((0..ATTEMPTS).any(|_| passes()), "in none of {ATTEMPTS} runs, see above");
}

/// Runs a source until a condition is met; returns the samples received meanwhile.
fn until(
    source: &mut GroundSource,
    so: impl Fn(&GroundSource, &[GroundSample]) -> bool,
) -> Vec<GroundSample> {
    let (began, mut samples) = (Instant::now(), Vec::new());
    while !so(source, &samples) {
        assert!(began.elapsed() < PATIENCE, "{:?} {:?}", source.counts(), source.diagnostic());
        source.receive(&mut samples).unwrap();
    }
    samples
}

/// Asserts that the resident memory of this process, in which the source runs, has never exceeded 1 GiB.
#[track_caller]
fn assert_memory_bounded() {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    let kib: u64 = peak.trim().trim_end_matches(" kB").parse().unwrap();
    assert!(kib < 1 << 20, "{kib} KiB");
}
