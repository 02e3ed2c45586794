//! Converts a skew between suit and ground to latencies in the configuration.

use equipoise_config::{Config, GroundSourceKind, SuitSourceKind};

/// Constant latencies, ms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Latencies {
    /// `[suit] latency_ms`.
    pub suit_ms: f64,
    /// `[ground] latency_ms`; a second device keeps its difference to it.
    pub ground_ms: f64,
}

impl Latencies {
    /// Latencies that remove a skew; `suit_later_ms` is positive if suit sample times are later than ground sample
    /// times.
    ///
    /// A negative skew means that the suit's latency is too large; the ground is late only by the part that exceeds it.
    #[must_use]
    pub fn without_skew(self, suit_later_ms: f64) -> Latencies {
        let suit_ms = self.suit_ms + suit_later_ms;
        if suit_later_ms > 0.0 || suit_ms >= 0.0 {
            return Latencies { suit_ms, ..self };
        }
        Latencies { ground_ms: self.ground_ms - suit_later_ms, ..self }
    }

    /// The latency that differs from `before`, as table and value, ms.
    pub fn changed_sensor_latency(self, before: Latencies) -> Option<(&'static str, f64)> {
        if self.suit_ms != before.suit_ms {
            return Some(("suit", self.suit_ms));
        }
        (self.ground_ms != before.ground_ms).then_some(("ground", self.ground_ms))
    }
}

/// The keys to change with their new values, ms; for two ground devices both keys, so that their difference remains.
pub fn settings_to_change(config: &Config, before: Latencies, after: Latencies) -> Vec<(&'static str, f64)> {
    let Some((table, ms)) = after.changed_sensor_latency(before) else { return Vec::new() };
    match (&config.ground.second, table) {
        (_, "suit") => vec![("suit.latency_ms", ms)],
        (None, _) => vec![("ground.latency_ms", ms)],
        (Some(second), _) => vec![
            ("ground.latency_ms", ms),
            ("ground.second.latency_ms", second.latency_ms + ms - before.ground_ms),
        ],
    }
}

/// Advice if another process reads the late sensor: the adapter's latency_ms corrects timestamps; the daemon's sets the
/// expected arrival.
pub fn external_setting(config: &Config, before: Latencies, after: Latencies) -> Option<String> {
    let (table, ms) = after.changed_sensor_latency(before)?;
    let (external, increase_ms) = match table {
        "suit" => (config.suit.source == SuitSourceKind::External, ms - before.suit_ms),
        _ => (config.ground.source == GroundSourceKind::External, ms - before.ground_ms),
    };
    external.then(|| {
        format!(
            "add {increase_ms} to [{table}] latency_ms in the configurations of the {table} adapter and the daemon, \
             and restart both"
        )
    })
}

/// What to change, in one line; `None` without a change.
pub fn advice(config: &Config, before: Latencies, after: Latencies) -> Option<String> {
    after.changed_sensor_latency(before)?;
    Some(external_setting(config, before, after).unwrap_or_else(|| {
        let keys = settings_to_change(config, before, after);
        let keys = keys.iter().filter_map(|(key, ms)| {
            let (table, key) = key.rsplit_once('.')?;
            Some(format!("[{table}] {key} = {ms}"))
        });
        format!("set {}", keys.collect::<Vec<_>>().join(" and "))
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_changed_settings_remove_the_skew() {
        for suit_ms in [0.0, 20.0] {
            for ground_ms in [0.0, 1.5] {
                for later_ms in [-30.0, -12.0, 0.0, 12.0] {
                    let before = Latencies { suit_ms, ground_ms };
                    let after = before.without_skew(later_ms);
                    // Sample time = clock fit − latency.
                    let left_ms = later_ms - (after.suit_ms - suit_ms) + (after.ground_ms - ground_ms);
                    assert!(left_ms.abs() < 1e-12, "{before:?} {later_ms} → {after:?}");
                    assert!(after.suit_ms >= 0.0 && after.ground_ms >= 0.0);
                    assert_eq!(after.changed_sensor_latency(before).is_some(), later_ms != 0.0);
                }
            }
        }
    }
}
