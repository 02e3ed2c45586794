//! The daemon's threads: requested and granted scheduling, locked memory, page faults and preemptions.
//!
//! Each thread requests its own scheduling when it starts ([`ThreadRegistry::request`]). Housekeeping reads the rest
//! from `/proc` once per second, so that real-time threads make no system calls for it.

use std::sync::{Mutex, PoisonError};

use equipoise_station::proc::TaskFacts;
use equipoise_station::status::ThreadStatus;

use crate::realtime::{self, RequestedScheduling, ThreadReport};

/// The threads of this process, with requested and granted scheduling.
#[derive(Debug, Default)]
pub struct ThreadRegistry(Mutex<Vec<ThreadReport>>);

impl ThreadRegistry {
    /// Requests scheduling for the calling thread, reads it back and stores both. Each role has one thread: a restarted
    /// one replaces the previous entry.
    pub fn request(&self, thread: &'static str, asked: RequestedScheduling) -> ThreadReport {
        let report = realtime::request(thread, asked);
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|other| other.thread != thread);
        all.push(report.clone());
        report
    }

    /// Reports of all threads that have requested scheduling.
    pub fn reports(&self) -> Vec<ThreadReport> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Requests that were not granted, one message per thread; the loop's first.
    pub fn missing(&self) -> Vec<String> {
        let mut reports = self.reports();
        reports.sort_by_key(|report| report.thread != "loop");
        reports.iter().filter_map(ThreadReport::missing).collect()
    }

    /// All current threads of the process, including those without a request.
    pub fn threads(&self) -> Vec<ThreadStatus> {
        let reports = self.reports();
        let mut threads: Vec<ThreadStatus> = TaskFacts::read_all()
            .into_iter()
            .map(|facts| status_of(reports.iter().find(|report| report.id == facts.id), facts))
            .collect();
        // In the order of their start, which is that of the data flow; other threads last.
        let place = |thread: &ThreadStatus| reports.iter().position(|report| report.id == thread.id);
        threads.sort_by_key(|thread| place(thread).unwrap_or(usize::MAX));
        threads
    }
}

fn status_of(report: Option<&ThreadReport>, facts: TaskFacts) -> ThreadStatus {
    ThreadStatus {
        thread: report.map_or(facts.name, |report| report.thread.to_owned()),
        id: facts.id,
        has_asked: report.is_some(),
        asked_fifo: report.map_or(0, |report| report.asked.fifo_priority),
        asked_cpu: report.and_then(|report| report.asked.cpu),
        policy: realtime::policy_name(facts.policy).to_owned(),
        granted_fifo: if facts.policy == libc::SCHED_FIFO { facts.priority } else { 0 },
        cpus: facts.cpus,
        timer_slack_ns: report.map(|report| report.granted.timer_slack_ns),
        minor_faults: facts.minor_faults,
        major_faults: facts.major_faults,
        involuntary_switches: facts.involuntary_switches,
    }
}

/// Counts the loop's page faults from the end of its warm-up on: a steady loop has none.
#[derive(Debug, Clone, Copy, Default)]
pub struct FaultWatch {
    /// The loop's faults at the end of its warm-up.
    warm: Option<[u64; 2]>,
    /// Minor and major faults since then.
    since: [u64; 2],
}

/// Cycles after which all regular code of the loop has run once: five seconds at 1 kHz.
pub const WARM_CYCLES: u64 = 5000;

impl FaultWatch {
    /// Updates from the threads' counters at `cycle`; returns the loop's minor and major faults since its warm-up,
    /// `None` before its end. For calls about once per second.
    pub fn update(&mut self, cycle: u64, threads: &[ThreadStatus]) -> Option<[u64; 2]> {
        let the_loop = threads.iter().find(|thread| thread.thread == "loop")?;
        if cycle < WARM_CYCLES {
            return None;
        }
        let now = [the_loop.minor_faults, the_loop.major_faults];
        let warm = *self.warm.get_or_insert(now);
        self.since = [0, 1].map(|kind| now[kind].saturating_sub(warm[kind]));
        Some(self.since)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_are_listed_once_with_and_without_a_request() {
        let thread_registry = ThreadRegistry::default();
        thread_registry.request("loop", RequestedScheduling::default());
        thread_registry.request("loop", RequestedScheduling::default());
        let (sender, receiver) = crossbeam_channel::bounded::<()>(0);
        let unregistered =
            std::thread::Builder::new().name("unregistered".into()).spawn(move || receiver.recv()).unwrap();
        let named = |name: &str| -> Vec<ThreadStatus> {
            thread_registry.threads().into_iter().filter(|thread| thread.thread == name).collect()
        };
        // The thread's name is set only once it runs.
        while named("unregistered").is_empty() {
            std::thread::yield_now();
        }
        let [the_loop] = &named("loop")[..] else { panic!("{:?}", thread_registry.threads()) };
        assert!(the_loop.has_asked && the_loop.timer_slack_ns.is_some());
        let [unregistered_listed] = &named("unregistered")[..] else {
            panic!("{:?}", thread_registry.threads())
        };
        assert!(
            !unregistered_listed.has_asked && unregistered_listed.policy == "other",
            "{unregistered_listed:?}"
        );
        assert_eq!(thread_registry.missing(), Vec::<String>::new());
        drop(sender);
        assert!(unregistered.join().unwrap().is_err());
    }

    #[test]
    fn faults_count_from_the_end_of_the_warm_up() {
        let with = |minor_faults, major_faults| {
            [ThreadStatus {
                thread: "loop".to_owned(),
                minor_faults,
                major_faults,
                ..ThreadStatus::default()
            }]
        };
        let mut watch = FaultWatch::default();
        assert_eq!(watch.update(WARM_CYCLES - 1, &with(100, 1)), None);
        assert_eq!(watch.update(WARM_CYCLES, &with(120, 2)), Some([0, 0]));
        assert_eq!(watch.update(WARM_CYCLES + 1000, &with(123, 2)), Some([3, 0]));
        assert_eq!(watch.update(WARM_CYCLES + 1000, &[]), None, "there is no loop");
    }
}
