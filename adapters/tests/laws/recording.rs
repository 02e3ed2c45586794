//! Recordings: whatever the file, it is read to some end, twice alike.

use equipoise_adapters::recording::Recording;

/// A recording that opens is gone through to an end, and the second time is as the first.
pub(crate) fn recording(bytes: &[u8]) {
    let Ok(recording) = Recording::from_bytes(bytes.to_vec()) else { return };
    let passes: [Vec<(u64, bool)>; 2] = std::array::from_fn(|_| {
        let entries = recording.entries().take(100_000);
        entries.map(|entry| entry.map_or((0, false), |timed| (timed.log_time_ns, true))).collect()
    });
    assert_eq!(passes[0], passes[1]);
    let _ = (recording.truncated(), recording.header().config_toml.len());
}
