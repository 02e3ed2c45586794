//! The daemon's threads: what each asked for and has, what all of them hold locked, and what each suffered.
//!
//! Each thread asks for itself as it begins ([`ThreadRegistry::ask`]). Everything else is read from `/proc` by housekeeping, once a
//! second, so that no thread that keeps time ever makes a system call for it.

mod proc;

use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use crate::realtime::{self, RequestedScheduling, ThreadReport};

pub use proc::{MemoryUse, TaskFacts};

/// Who runs in this process, and on what terms.
#[derive(Debug, Default)]
pub struct ThreadRegistry(Mutex<Vec<ThreadReport>>);

impl ThreadRegistry {
    /// Asks for the calling thread, reads back, and remembers both. One role has one thread: a successor takes its place.
    pub fn request(&self, thread: &'static str, asked: RequestedScheduling) -> ThreadReport {
        let report = realtime::request(thread, asked);
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|other| other.thread != thread);
        all.push(report.clone());
        report
    }

    /// Everybody who has asked so far.
    pub fn reports(&self) -> Vec<ThreadReport> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// What of all that was asked was not granted, one sentence a thread; the loop's first.
    pub fn missing(&self) -> Vec<String> {
        let mut reports = self.reports();
        reports.sort_by_key(|report| report.thread != "loop");
        reports.iter().filter_map(ThreadReport::missing).collect()
    }

    /// Every thread that the process has now, those that never asked included.
    pub fn threads(&self) -> Vec<ThreadStatus> {
        let reports = self.reports();
        let mut threads: Vec<ThreadStatus> = TaskFacts::read_all()
            .into_iter()
            .map(|facts| ThreadStatus::new(reports.iter().find(|report| report.id == facts.id), facts))
            .collect();
        // In the order of their start, which is that of the data flow; other threads last.
        let place = |thread: &ThreadStatus| reports.iter().position(|report| report.id == thread.id);
        threads.sort_by_key(|thread| place(thread).unwrap_or(usize::MAX));
        threads
    }
}

/// What one thread asked for, has, and suffered.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ThreadStatus {
    /// Role; of a thread that never asked, the name that the kernel has of it.
    pub thread: String,
    /// The kernel's number for it.
    #[serde(default)]
    pub id: i32,
    /// Whether it has asked for anything itself.
    #[serde(default)]
    pub has_asked: bool,
    /// SCHED_FIFO priority asked for; 0 for none.
    pub asked_fifo: u32,
    /// Core asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asked_cpu: Option<usize>,
    /// Name of the scheduling policy it has now.
    #[serde(default)]
    pub policy: String,
    /// SCHED_FIFO priority it has now.
    pub granted_fifo: u32,
    /// Cores it may run on now.
    pub cpus: Vec<usize>,
    /// Timer slack as it was read back, ns; nothing for a thread that never asked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timer_slack_ns: Option<u64>,
    /// Page faults that needed no disk, since its start.
    #[serde(default)]
    pub minor_faults: u64,
    /// Page faults that waited for a disk, since its start.
    #[serde(default)]
    pub major_faults: u64,
    /// How often another thread was given its core while it had work to do, since its start.
    #[serde(default)]
    pub involuntary_switches: u64,
}

impl ThreadStatus {
    fn new(report: Option<&ThreadReport>, facts: TaskFacts) -> ThreadStatus {
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
}

/// Watches the loop's page faults from the end of its warm-up on: a steady loop has none.
#[derive(Debug, Clone, Copy, Default)]
pub struct FaultWatch {
    /// The loop's faults when its warm-up was over.
    warm: Option<[u64; 2]>,
    /// Minor and major faults since then.
    since: [u64; 2],
}

/// Cycles after which everything that the loop does every day was done once. Rates differ; five seconds at 1 kHz.
pub const WARM_CYCLES: u64 = 5000;

impl FaultWatch {
    /// Takes in how the threads fare while the loop is at `cycle`; the loop's minor and major faults since its warm-up,
    /// `None` before it is over. To be asked about once a second.
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
        let (sender, receiver) = std::sync::mpsc::channel::<()>();
        let stranger =
            std::thread::Builder::new().name("stranger".into()).spawn(move || receiver.recv()).unwrap();
        let named = |name: &str| -> Vec<ThreadStatus> {
            thread_registry.threads().into_iter().filter(|thread| thread.thread == name).collect()
        };
        // The thread's name is set only once it runs.
        while named("stranger").is_empty() {
            std::thread::yield_now();
        }
        let [the_loop] = &named("loop")[..] else { panic!("{:?}", thread_registry.threads()) };
        assert!(the_loop.has_asked && the_loop.timer_slack_ns.is_some());
        let [unregistered_listed] = &named("stranger")[..] else { panic!("{:?}", thread_registry.threads()) };
        assert!(
            !unregistered_listed.has_asked && unregistered_listed.policy == "other",
            "{unregistered_listed:?}"
        );
        assert_eq!(thread_registry.missing(), Vec::<String>::new());
        drop(sender);
        assert!(stranger.join().unwrap().is_err());
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
