//! A long recording requires no more memory than a short one. The longest test of this program: it starts first, since
//! tests start in the order of their names.

use std::path::Path;

use equipoise_studies::hidden::long::{Long, reconcile};

/// A fifth of the usual samples, so that hours are processed in seconds. Both are longer than the kept part of a
/// recording (`docs/discrepancy.md`), which a short one does not fill.
const SHORT: Long = Long { length_s: 1500.0, simulated_s: 300.0, every: [2, 10] };
const LENGTHENED_S: f64 = 3000.0;

#[test]
fn twice_the_recording_needs_no_more_memory() {
    let directory = tempfile::tempdir().unwrap();
    let simulated = SHORT.simulate(5);
    let of = |name: &str, length_s: f64| {
        let recording = directory.path().join(name).with_extension("mcap");
        simulated.write(&recording, length_s).unwrap();
        let needed = reconcile(Path::new(env!("CARGO_BIN_EXE_equipoise")), &recording).unwrap();
        let to_s = needed.finding["spans"][0]["to_s"].as_f64().unwrap();
        println!(
            "{name}: {:.0} MB for {:.0} MB, {:.1} s; beyond noise until {to_s:.0} s",
            1e-6 * needed.peak_bytes as f64,
            1e-6 * recording.metadata().unwrap().len() as f64,
            needed.seconds
        );
        assert!(to_s > 0.9 * length_s, "all of it was gone through: {to_s} s");
        needed.peak_bytes as f64
    };
    let (short, lengthened) = std::thread::scope(|scope| {
        let short = scope.spawn(|| of("short", SHORT.length_s));
        let lengthened = of("lengthened", LENGTHENED_S);
        (short.join().unwrap(), lengthened)
    });
    assert!(short > 1e7, "it was measured: {short}");
    assert!(lengthened < 1.2 * short, "{short} {lengthened}");
}
