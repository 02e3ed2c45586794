//! Recordings: every file is read to an end, with the same result twice.

use equipoise_adapters::recording::Recording;

/// Iterates over an opened recording twice; both iterations end and are equal.
pub(crate) fn recording(bytes: &[u8]) {
    let Ok(recording) = Recording::from_bytes(bytes.to_vec()) else { return };
    let passes: [Vec<(u64, bool)>; 2] = std::array::from_fn(|_| {
        let entries = recording.entries().take(100_000);
        entries.map(|entry| entry.map_or((0, false), |timed| (timed.log_time_ns, true))).collect()
    });
    assert_eq!(passes[0], passes[1]);
    let _ = (recording.truncated(), recording.header().config_toml.len());
}
