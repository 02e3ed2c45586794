//! A long recording requires no more memory than a short one.

use std::path::Path;

use equipoise_studies::hidden::long::{Long, reconcile};

/// A fifth of the usual samples, so that hours are processed in seconds. Both are longer than the kept part of a
/// recording (`docs/discrepancy.md`), which a short one does not fill.
const SHORT: Long = Long { length_s: 1500.0, simulated_s: 300.0, every: [2, 10] };
const LENGTHENED: Long = Long { length_s: 3000.0, ..SHORT };

#[test]
fn twice_the_recording_needs_no_more_memory() {
    let directory = tempfile::tempdir().unwrap();
    let of = |name: &str, long: Long| {
        let recording = directory.path().join(name).with_extension("mcap");
        long.write(&recording, 5).unwrap();
        let needed = reconcile(Path::new(env!("CARGO_BIN_EXE_equipoise")), &recording).unwrap();
        let to_s = needed.finding["spans"][0]["to_s"].as_f64().unwrap();
        println!(
            "{name}: {:.0} MB for {:.0} MB, {:.1} s; beyond noise until {to_s:.0} s",
            1e-6 * needed.peak_bytes as f64,
            1e-6 * recording.metadata().unwrap().len() as f64,
            needed.seconds
        );
        assert!(to_s > 0.9 * long.length_s, "all of it was gone through: {to_s} s");
        needed.peak_bytes as f64
    };
    let (short, lengthened) = std::thread::scope(|scope| {
        let short = scope.spawn(|| of("short", SHORT));
        let lengthened = of("lengthened", LENGTHENED);
        (short.join().unwrap(), lengthened)
    });
    assert!(short > 1e7, "it was measured: {short}");
    assert!(lengthened < 1.2 * short, "{short} {lengthened}");
}
