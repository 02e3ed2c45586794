//! Real-time settings of a thread: asked for, then read back. What was granted is what is reported.
//!
//! The only unsafe code of the daemon: neither rustix nor nix has the scheduler call.

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{
    CapabilitySet, CpuSet, capabilities, sched_getaffinity, sched_setaffinity, set_current_timer_slack,
};
use serde::Serialize;

/// What a thread asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Asked {
    /// SCHED_FIFO priority, 1 to 99; 0 for the ordinary scheduler.
    pub fifo_priority: u32,
    /// The core to run on.
    pub cpu: Option<usize>,
}

/// What a thread has.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Granted {
    /// SCHED_FIFO priority; 0 under the ordinary scheduler.
    pub fifo_priority: u32,
    /// The cores it may run on.
    pub cpus: Vec<usize>,
}

/// Both, for one thread.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ThreadReport {
    /// The thread's role.
    pub thread: &'static str,
    /// What it asked for.
    pub asked: Asked,
    /// What it has.
    pub granted: Granted,
}

impl ThreadReport {
    /// What is missing, in words; `None` if all was granted.
    pub fn missing(&self) -> Option<String> {
        if self.granted.fifo_priority < self.asked.fifo_priority {
            return Some(format!(
                "thread {} asked for SCHED_FIFO {} and has {}; run as root or with CAP_SYS_NICE (systemd: \
                 AmbientCapabilities=CAP_SYS_NICE, LimitRTPRIO=)",
                self.thread, self.asked.fifo_priority, self.granted.fifo_priority
            ));
        }
        match self.asked.cpu {
            Some(cpu) if self.granted.cpus != [cpu] => Some(format!(
                "thread {} asked for core {cpu} and may run on {:?}",
                self.thread, self.granted.cpus
            )),
            _ => None,
        }
    }
}

/// Asks for the calling thread and reads back. Never fails: a refusal shows in the report.
pub fn ask(thread: &'static str, asked: Asked) -> ThreadReport {
    if let Some(cpu) = asked.cpu {
        let mut set = CpuSet::new();
        if cpu < CpuSet::MAX_CPU {
            set.set(cpu);
            // A refusal shows below.
            let _ = sched_setaffinity(None, &set);
        }
    }
    if asked.fifo_priority > 0 {
        set_fifo(asked.fifo_priority);
    }
    // Ordinary threads are woken up to 50 µs late by default.
    let _ = set_current_timer_slack(core::num::NonZeroU64::new(1));
    ThreadReport { thread, asked, granted: granted() }
}

fn granted() -> Granted {
    let cpus = sched_getaffinity(None)
        .map(|set| (0..CpuSet::MAX_CPU).filter(|cpu| set.is_set(*cpu)).collect())
        .unwrap_or_default();
    Granted { fifo_priority: fifo_priority(), cpus }
}

#[expect(unsafe_code, reason = "no safe wrapper has sched_setscheduler")]
fn set_fifo(priority: u32) {
    let parameter = libc::sched_param { sched_priority: priority.min(99) as i32 };
    // SAFETY: the pointer is to a live sched_param, and 0 is the calling thread. A refusal shows when read back.
    unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameter) };
}

#[expect(unsafe_code, reason = "no safe wrapper has sched_getscheduler")]
fn fifo_priority() -> u32 {
    let mut parameter = libc::sched_param { sched_priority: 0 };
    // SAFETY: the pointer is to a live sched_param, and 0 is the calling thread.
    let (policy, read) =
        unsafe { (libc::sched_getscheduler(0), libc::sched_getparam(0, &raw mut parameter)) };
    if policy == libc::SCHED_FIFO && read == 0 { parameter.sched_priority as u32 } else { 0 }
}

/// Locks all memory, now and later, so that the loop takes no page fault.
///
/// # Errors
/// Why it was not done. With a limit on locked memory it is not even tried: memory asked for later would then be
/// refused, and the process would die of it. The limit does not hold for whoever has CAP_IPC_LOCK: mlock(2).
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

    #[test]
    fn what_was_not_granted_is_said() {
        let report = ThreadReport {
            thread: "loop",
            asked: Asked { fifo_priority: 80, cpu: Some(3) },
            granted: Granted { fifo_priority: 0, cpus: vec![0, 1] },
        };
        assert!(report.missing().unwrap().contains("CAP_SYS_NICE"));
    }

    #[test]
    fn nothing_asked_nothing_missing() {
        assert_eq!(ask("test", Asked { fifo_priority: 0, cpu: None }).missing(), None);
    }

    #[test]
    fn sleep_ends_at_or_after_the_time_it_was_told() {
        let due_ns = now_ns() + 2_000_000;
        sleep_until(due_ns);
        assert!(now_ns() >= due_ns);
        sleep_until(0);
    }
}
