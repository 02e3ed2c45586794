//! Whether a daemon grows: its memory second by second, its descriptors.

use std::time::Instant;

/// Growth of a run that is no leak: pages of threads and of the allocator that are touched late, KiB.
const GROWTH_AT_MOST_KIB: f64 = 3072.0;
/// In a shorter run the first flight record, which is packed in memory, would be taken for a slope, s.
const JUDGED_FROM_S: f64 = 60.0;

/// What a process used over time.
pub(crate) struct Resources {
    process: u32,
    started: Instant,
    resident: Vec<(f64, f64)>,
}

impl Resources {
    pub(crate) fn of(process: u32) -> Resources {
        Resources { process, started: Instant::now(), resident: Vec::new() }
    }

    /// Once a second is enough; more often does nothing.
    pub(crate) fn look(&mut self) {
        let now_s = self.started.elapsed().as_secs_f64();
        if self.resident.last().is_some_and(|(last_s, _)| now_s - last_s < 1.0) {
            return;
        }
        let status =
            std::fs::read_to_string(format!("/proc/{}/status", self.process)).expect("a living daemon");
        // Its own memory. Shared memory has its size from the start (`bus/src/service.rs`); only which pages of it were ever
        // touched grows for a while.
        let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:")).expect("RssAnon");
        let kib: f64 = line.trim().trim_end_matches(" kB").parse().expect("a number");
        self.resident.push((now_s, kib));
    }

    pub(crate) fn descriptors(&self) -> usize {
        std::fs::read_dir(format!("/proc/{}/fd", self.process)).expect("a living daemon").count()
    }

    /// The line through the second half, so that the beginning does not count; asserts that it is flat.
    pub(crate) fn judge_growth(&self) -> String {
        let late = &self.resident[self.resident.len() / 2..];
        let count = late.len() as f64;
        let mean = |of: fn(&(f64, f64)) -> f64| late.iter().map(of).sum::<f64>() / count;
        let (middle_s, middle_kib) = (mean(|point| point.0), mean(|point| point.1));
        let over: f64 = late.iter().map(|(s, kib)| (s - middle_s) * (kib - middle_kib)).sum();
        let spread: f64 = late.iter().map(|(s, _)| (s - middle_s).powi(2)).sum();
        let slope_kib_per_s = if spread > 0.0 { over / spread } else { 0.0 };
        let grown_kib = slope_kib_per_s * 2.0 * (late[late.len() - 1].0 - late[0].0);
        assert!(
            grown_kib < GROWTH_AT_MOST_KIB || late[late.len() - 1].0 < JUDGED_FROM_S,
            "memory grows by {slope_kib_per_s:.1} KiB/s: {:?}",
            self.resident
        );
        format!("{middle_kib:.0} KiB in memory, growing by {:.1} KiB a minute", 60.0 * slope_kib_per_s)
    }
}
