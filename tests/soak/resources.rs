//! Growth of a daemon: memory per second, descriptors.

use std::time::Instant;

/// An idle daemon settles at 29 MiB within nine minutes, in steps of 1 MiB as threads and allocator touch their pages
/// for the first time; the limit is a quarter higher. A leak of 64 bytes a cycle at 1 kHz exceeds it within two
/// minutes.
const PLATEAU_KIB: f64 = 36.0 * 1024.0;
/// Afterwards memory is constant: from here on the slope is compared with [`SETTLED_SLOPE_KIB_PER_S`].
const SETTLED_AFTER_S: f64 = 600.0;
/// One page a second.
const SETTLED_SLOPE_KIB_PER_S: f64 = 4.0;

/// Resource usage of a process over time.
pub(crate) struct Resources {
    process: u32,
    started: Instant,
    resident: Vec<(f64, f64)>,
}

impl Resources {
    pub(crate) fn of(process: u32) -> Resources {
        Resources { process, started: Instant::now(), resident: Vec::new() }
    }

    /// Samples at most once a second.
    pub(crate) fn sample(&mut self) {
        let now_s = self.started.elapsed().as_secs_f64();
        if self.resident.last().is_some_and(|(last_s, _)| now_s - last_s < 1.0) {
            return;
        }
        let status =
            std::fs::read_to_string(format!("/proc/{}/status", self.process)).expect("a running daemon");
        // Anonymous memory only. Shared memory has a fixed size (`bus/src/service.rs`); only its number of touched
        // pages grows for a while.
        let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:")).expect("RssAnon");
        let kib: f64 = line.trim().trim_end_matches(" kB").parse().expect("a number");
        self.resident.push((now_s, kib));
    }

    pub(crate) fn descriptors(&self) -> usize {
        std::fs::read_dir(format!("/proc/{}/fd", self.process)).expect("a running daemon").count()
    }

    /// Reports memory usage and its growth after the first half; an error if that is too much.
    pub(crate) fn check_growth(&self) -> Result<String, String> {
        let late = &self.resident[self.resident.len() / 2..];
        let slope_kib_per_s = slope(late);
        let most_kib = late.iter().fold(0.0, |most: f64, (_, kib)| most.max(*kib));
        let settled = late.first().is_some_and(|(since_s, _)| *since_s > SETTLED_AFTER_S);
        let usage =
            format!("{most_kib:.0} KiB in memory, growing by {:.1} KiB a minute", 60.0 * slope_kib_per_s);
        if most_kib > PLATEAU_KIB || (settled && slope_kib_per_s > SETTLED_SLOPE_KIB_PER_S) {
            return Err(format!("{usage}: {:?}", self.resident));
        }
        Ok(usage)
    }
}

/// Slope of the least-squares line through (s, KiB).
fn slope(points: &[(f64, f64)]) -> f64 {
    let count = points.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / count;
    let (middle_s, middle_kib) = (mean(|point| point.0), mean(|point| point.1));
    let over: f64 = points.iter().map(|(s, kib)| (s - middle_s) * (kib - middle_kib)).sum();
    let spread: f64 = points.iter().map(|(s, _)| (s - middle_s).powi(2)).sum();
    if spread > 0.0 { over / spread } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resources(resident: Vec<(f64, f64)>) -> Resources {
        Resources { process: 0, started: Instant::now(), resident }
    }

    #[test]
    fn steps_of_the_first_minutes_are_no_leak_and_a_leak_is_one() {
        let steps: Vec<_> = (0..160).map(|s| (f64::from(s), 23e3 + 1e3 * f64::from(s / 40))).collect();
        assert!(resources(steps).check_growth().is_ok());
        let leak = |kib_per_s: f64, seconds: i32| {
            resources((0..seconds).map(|s| (f64::from(s), 23e3 + kib_per_s * f64::from(s))).collect())
        };
        assert!(leak(100.0, 160).check_growth().is_err());
        assert!(leak(5.0, 1600).check_growth().is_err());
        assert!(leak(1.0, 1600).check_growth().is_ok());
    }
}
