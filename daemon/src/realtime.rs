//! Real-time settings of a thread: requested, then read back; the granted values are reported.
//!
//! The only unsafe code of the daemon: neither rustix nor nix has the scheduler call.

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{
    CapabilitySet, CpuSet, capabilities, current_timer_slack, sched_getaffinity, sched_setaffinity,
    set_current_timer_slack,
};
use serde::Serialize;

/// Timer slack that every thread requests, ns: by default, ordinary threads are woken up to 50 µs late.
pub const TIMER_SLACK_NS: u64 = 1;

/// Scheduling that a thread requests in addition to [`TIMER_SLACK_NS`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct RequestedScheduling {
    /// SCHED_FIFO priority, 1 to 99; 0 for the ordinary scheduler.
    pub fifo_priority: u32,
    /// The core to run on.
    pub cpu: Option<usize>,
}

/// Granted scheduling of a thread.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Granted {
    /// Name of the scheduling policy: `other`, `fifo`, …
    pub policy: &'static str,
    /// SCHED_FIFO priority; 0 under another scheduler.
    pub fifo_priority: u32,
    /// The cores on which it may run.
    pub cpus: Vec<usize>,
    /// Timer slack, ns; 0 for real-time threads of newer kernels, which have none.
    pub timer_slack_ns: u64,
}

/// Requested and granted scheduling of one thread.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ThreadReport {
    /// The thread's role.
    pub thread: &'static str,
    /// Thread id.
    pub id: i32,
    /// Requested scheduling.
    pub asked: RequestedScheduling,
    /// Granted scheduling.
    pub granted: Granted,
}

impl ThreadReport {
    /// Message on what was not granted; `None` if everything was.
    pub fn missing(&self) -> Option<String> {
        let (thread, granted) = (self.thread, &self.granted);
        if granted.fifo_priority < self.asked.fifo_priority {
            return Some(format!(
                "thread {thread} asked for SCHED_FIFO {} and has {}; run as root or with CAP_SYS_NICE (systemd: \
                 AmbientCapabilities=CAP_SYS_NICE, LimitRTPRIO=)",
                self.asked.fifo_priority, granted.fifo_priority
            ));
        }
        if granted.fifo_priority > self.asked.fifo_priority {
            return Some(format!(
                "thread {thread} asked for SCHED_FIFO {} and has {}; only the daemon should set it",
                self.asked.fifo_priority, granted.fifo_priority
            ));
        }
        if granted.timer_slack_ns > TIMER_SLACK_NS {
            return Some(format!(
                "thread {thread} asked for a timer slack of {TIMER_SLACK_NS} ns and has {} ns",
                granted.timer_slack_ns
            ));
        }
        match self.asked.cpu {
            Some(cpu) if granted.cpus != [cpu] => Some(format!(
                "thread {thread} asked for core {cpu} and may run on {:?}; set loop.cpu to a core of this machine",
                granted.cpus
            )),
            _ => None,
        }
    }
}

/// Requests scheduling for the calling thread and reads it back. Never fails: the report contains a refusal.
pub fn request(thread: &'static str, asked: RequestedScheduling) -> ThreadReport {
    if let Some(cpu) = asked.cpu {
        let mut set = CpuSet::new();
        if cpu < CpuSet::MAX_CPU {
            set.set(cpu);
            // A refusal shows when the settings are read back below.
            let _ = sched_setaffinity(None, &set);
        }
    }
    // Threads inherit the policy of the thread that starts them: reset it if no real-time priority is requested.
    if asked.fifo_priority > 0 || policy() == libc::SCHED_FIFO || policy() == libc::SCHED_RR {
        set_fifo(asked.fifo_priority);
    }
    let _ = set_current_timer_slack(core::num::NonZeroU64::new(TIMER_SLACK_NS));
    ThreadReport { thread, id: rustix::thread::gettid().as_raw_nonzero().get(), asked, granted: granted() }
}

fn granted() -> Granted {
    let cpus = sched_getaffinity(None)
        .map(|set| (0..CpuSet::MAX_CPU).filter(|cpu| set.is_set(*cpu)).collect())
        .unwrap_or_default();
    Granted {
        policy: policy_name(policy()),
        fifo_priority: fifo_priority(),
        cpus,
        timer_slack_ns: current_timer_slack().unwrap_or(u64::MAX),
    }
}

/// The kernel's scheduling policies by their numbers (sched(7)).
pub fn policy_name(policy: i32) -> &'static str {
    match policy & !libc::SCHED_RESET_ON_FORK {
        libc::SCHED_OTHER => "other",
        libc::SCHED_FIFO => "fifo",
        libc::SCHED_RR => "rr",
        libc::SCHED_BATCH => "batch",
        libc::SCHED_IDLE => "idle",
        libc::SCHED_DEADLINE => "deadline",
        _ => "unknown",
    }
}

#[expect(unsafe_code, reason = "no safe wrapper has sched_setscheduler")]
fn set_fifo(priority: u32) {
    let policy = if priority > 0 { libc::SCHED_FIFO } else { libc::SCHED_OTHER };
    let parameter = libc::sched_param { sched_priority: priority.min(99) as i32 };
    // SAFETY: the pointer is to a live sched_param, and 0 is the calling thread. A refusal shows when read back.
    unsafe { libc::sched_setscheduler(0, policy, &raw const parameter) };
}

#[expect(unsafe_code, reason = "no safe wrapper has sched_getscheduler")]
fn policy() -> i32 {
    // SAFETY: takes no pointer; 0 is the calling thread.
    unsafe { libc::sched_getscheduler(0) }
}

#[expect(unsafe_code, reason = "no safe wrapper has sched_getparam")]
fn fifo_priority() -> u32 {
    let mut parameter = libc::sched_param { sched_priority: 0 };
    // SAFETY: the pointer is to a live sched_param, and 0 is the calling thread.
    let read = unsafe { libc::sched_getparam(0, &raw mut parameter) };
    if policy() == libc::SCHED_FIFO && read == 0 { parameter.sched_priority as u32 } else { 0 }
}

/// Locks all memory, now and later, so that the loop takes no page fault.
///
/// # Errors
/// The reason. With a limit on locked memory it is not tried: later allocations would fail, and the process would
/// abort. The limit does not apply to processes with CAP_IPC_LOCK: mlock(2).
pub fn lock_memory() -> Result<(), String> {
    let limited = getrlimit(Resource::Memlock).current.is_some();
    let exempt = capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK));
    if limited && !exempt {
        return Err("locked memory is limited (ulimit -l); run as root, or under systemd with \
                    AmbientCapabilities=CAP_IPC_LOCK or LimitMEMLOCK=infinity"
            .to_owned());
    }
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(|error| format!("mlockall: {error}"))
}

/// Touches the stack that the loop will use, so that its first cycles take no page fault.
#[inline(never)]
pub fn prefault_stack() {
    let mut stack = [0_u8; 256 * 1024];
    for page in stack.iter_mut().step_by(4096) {
        *page = 1;
    }
    std::hint::black_box(&mut stack);
}

/// Writes to every page of newly allocated memory, so that no later access takes a page fault.
pub fn prefault<T: bytemuck::Pod>(value: &mut T) {
    for page in bytemuck::bytes_of_mut(value).chunks_mut(4096) {
        if let Some(byte) = page.first_mut() {
            *byte = std::hint::black_box(*byte);
        }
    }
}

/// CLOCK_MONOTONIC, read without a system call where the kernel allows it.
pub fn now_ns() -> u64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    time.tv_sec as u64 * equipoise_core::time::NS_PER_S + time.tv_nsec as u64
}

/// Sleeps until an absolute time of CLOCK_MONOTONIC; a signal does not end it.
pub fn sleep_until(due_ns: u64) {
    let due = rustix::time::Timespec {
        tv_sec: (due_ns / equipoise_core::time::NS_PER_S) as i64,
        tv_nsec: (due_ns % equipoise_core::time::NS_PER_S) as i64,
    };
    while rustix::thread::clock_nanosleep_absolute(rustix::thread::ClockId::Monotonic, &due)
        == Err(rustix::io::Errno::INTR)
    {}
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(fifo_priority: u32, cpus: &[usize], timer_slack_ns: u64) -> ThreadReport {
        ThreadReport {
            thread: "loop",
            id: 1,
            asked: RequestedScheduling { fifo_priority: 80, cpu: Some(3) },
            granted: Granted { policy: "fifo", fifo_priority, cpus: cpus.to_vec(), timer_slack_ns },
        }
    }

    #[test]
    fn missing_privileges_are_reported() {
        assert_eq!(report(80, &[3], 0).missing(), None);
        assert!(report(0, &[3], 0).missing().unwrap().contains("CAP_SYS_NICE"));
        assert!(report(90, &[3], 0).missing().unwrap().contains("has 90"));
        assert!(report(80, &[3, 4], 0).missing().unwrap().contains("asked for core 3"));
        assert!(report(80, &[3], 50_000).missing().unwrap().contains("50000 ns"));
    }

    #[test]
    fn no_request_means_nothing_missing() {
        let report = request("test", RequestedScheduling::default());
        assert_eq!(report.missing(), None, "{report:?}");
        assert_eq!(report.granted.fifo_priority, 0);
        assert!(!report.granted.cpus.is_empty());
    }

    #[test]
    fn a_core_that_no_machine_has_is_missing() {
        let asked = RequestedScheduling { cpu: Some(4095), ..RequestedScheduling::default() };
        assert!(request("test", asked).missing().unwrap().contains("core 4095"));
    }

    #[test]
    fn sleep_ends_at_or_after_the_requested_time() {
        let due_ns = now_ns() + 2_000_000;
        sleep_until(due_ns);
        assert!(now_ns() >= due_ns);
        sleep_until(0);
    }
}
