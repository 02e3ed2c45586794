//! Kernel data of this process and its threads (proc_pid_stat(5), proc_pid_status(5)).

use std::fs;

use serde::{Deserialize, Serialize};

/// One thread of `/proc/self/task`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TaskFacts {
    /// Thread id.
    pub id: i32,
    /// Name, at most 15 bytes.
    pub name: String,
    /// Number of the scheduling policy.
    pub policy: i32,
    /// Real-time priority, 0 for none.
    pub priority: u32,
    /// Cores it may run on.
    pub cpus: Vec<usize>,
    /// Page faults that needed no disk.
    pub minor_faults: u64,
    /// Page faults that waited for a disk.
    pub major_faults: u64,
    /// Number of preemptions.
    pub involuntary_switches: u64,
}

impl TaskFacts {
    /// All threads of this process, except those that end meanwhile.
    pub fn read_all() -> Vec<TaskFacts> {
        let tasks = fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
        tasks.filter_map(|task| task.file_name().to_str()?.parse().ok()).filter_map(TaskFacts::read).collect()
    }

    /// One thread of this process; `None` if it does not exist.
    pub fn read(id: i32) -> Option<TaskFacts> {
        let read = |file: &str| fs::read_to_string(format!("/proc/self/task/{id}/{file}")).ok();
        TaskFacts::parse(id, &read("stat")?, &read("status")?)
    }

    fn parse(id: i32, stat: &str, status: &str) -> Option<TaskFacts> {
        // The name may contain anything, including parentheses and spaces: it ends at the last parenthesis. Field 3
        // follows.
        let (name, rest) = stat.split_once('(')?.1.rsplit_once(')')?;
        let fields: Vec<&str> = rest.split_ascii_whitespace().collect();
        let number = |field: usize| fields.get(field - 3)?.parse::<u64>().ok();
        Some(TaskFacts {
            id,
            name: name.to_owned(),
            policy: number(41)? as i32,
            priority: number(40)? as u32,
            cpus: cores(line(status, "Cpus_allowed_list")?),
            minor_faults: number(10)?,
            major_faults: number(12)?,
            involuntary_switches: line(status, "nonvoluntary_ctxt_switches")?.parse().ok()?,
        })
    }
}

/// Memory of this process, KiB.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MemoryUse {
    /// Locked: `VmLck`.
    pub locked_kib: u64,
    /// Resident: `VmRSS`.
    pub resident_kib: u64,
    /// Total address space: `VmSize`.
    pub total_kib: u64,
}

/// Uncertainty of the resident size: the kernel counts pages per core in batches (64 pages per thread).
const RESIDENT_SLACK_KIB: u64 = 4096;

impl MemoryUse {
    /// Current values; zero if they cannot be read.
    pub fn read() -> MemoryUse {
        MemoryUse::parse(&fs::read_to_string("/proc/self/status").unwrap_or_default())
    }

    fn parse(status: &str) -> MemoryUse {
        let kib = |key: &str| {
            let number = line(status, key).and_then(|text| text.split_ascii_whitespace().next());
            number.and_then(|number| number.parse().ok()).unwrap_or(0)
        };
        MemoryUse { locked_kib: kib("VmLck"), resident_kib: kib("VmRSS"), total_kib: kib("VmSize") }
    }

    /// Whether all resident memory is locked.
    pub fn is_locked(self) -> bool {
        self.locked_kib > 0 && self.locked_kib + RESIDENT_SLACK_KIB >= self.resident_kib
    }
}

fn line<'a>(status: &'a str, key: &str) -> Option<&'a str> {
    status.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':')).map(str::trim)
}

/// Parses a core list such as `0-2,5`.
fn cores(list: &str) -> Vec<usize> {
    let ends = |part: &str| {
        let (from, to) = part.split_once('-').unwrap_or((part, part));
        Some(from.trim().parse().ok()?..=to.trim().parse().ok()?)
    };
    list.split(',').filter_map(ends).flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_with_an_odd_name_is_read() {
        let mut stat = "77 (a ) b) S".to_owned();
        // Field 3 is the state; each field from 4 on contains its own number.
        (4..=44).for_each(|field| stat += &format!(" {field}"));
        let status = "Name:\ta ) b\nCpus_allowed_list:\t0-2,5\nnonvoluntary_ctxt_switches:\t9\n";
        let facts = TaskFacts::parse(77, &stat, status).unwrap();
        assert_eq!((facts.minor_faults, facts.major_faults), (10, 12));
        assert_eq!((facts.priority, facts.policy), (40, 41));
        assert_eq!((facts.cpus, facts.involuntary_switches), (vec![0, 1, 2, 5], 9));
        assert_eq!(facts.name, "a ) b");
        assert_eq!(TaskFacts::parse(77, "77 (a", status), None);
    }

    #[test]
    fn memory_is_locked_if_what_is_there_is() {
        let of = |locked: u64, resident: u64| {
            MemoryUse::parse(&format!("VmSize:\t 900000 kB\nVmLck:\t {locked} kB\nVmRSS:\t {resident} kB\n"))
        };
        assert!(of(300_000, 250_000).is_locked());
        assert!(!of(0, 250_000).is_locked() && !of(20_000, 250_000).is_locked());
        assert!(!MemoryUse::default().is_locked());
        assert!(MemoryUse::read().resident_kib > 0);
    }
}
