//! cyclictest and stress-ng: external programs, run for one turn; their output is parsed.

use std::process::{Child, Command, Stdio};
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};

/// Lateness above this is only counted, µs.
const HIGHEST_US: usize = 50_000;

/// The scheduler of a turn's threads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Policy {
    Fifo,
    Other,
}

impl Policy {
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Policy::Fifo => "FIFO 80",
            Policy::Other => "OTHER",
        }
    }

    pub(crate) const fn priority(self) -> u32 {
        match self {
            Policy::Fifo => 80,
            Policy::Other => 0,
        }
    }
}

/// Whether a program can be started; prints what to install if not.
pub(crate) fn is_there(program: &str, package: &str) -> bool {
    let there =
        Command::new(program).arg("--help").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok();
    if !there {
        println!("{program} is not here: install the Debian package {package}");
    }
    there
}

/// A running cyclictest with one thread and a period of 1 ms.
pub(crate) struct Cyclictest(Child);

impl Cyclictest {
    pub(crate) fn start(policy: Policy, cpu: usize, length: Duration) -> Cyclictest {
        let priority = policy.priority().to_string();
        let mut command = Command::new("cyclictest");
        command.args(["--quiet", "--mlockall", "--threads=1", "--interval=1000", "--histogram"]);
        command.arg(HIGHEST_US.to_string()).arg("--affinity").arg(cpu.to_string());
        command.arg("--loops").arg(length.as_millis().to_string());
        match policy {
            // With a histogram it would select FIFO by itself.
            Policy::Other => command.args(["--policy", "other"]),
            Policy::Fifo => command.args(["--policy", "fifo", "--priority", &priority]),
        };
        let child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        Cyclictest(child.expect("cyclictest was there a moment ago"))
    }

    /// The actual scheduler of its measuring thread, from the kernel.
    pub(crate) fn has_policy(&self) -> Option<Policy> {
        let tasks = std::fs::read_dir(format!("/proc/{}/task", self.0.id())).ok()?;
        let fifo = tasks.flatten().any(|task| {
            let stat = std::fs::read_to_string(task.path().join("stat")).unwrap_or_default();
            // proc(5): `policy` is field 41, the 39th after the name in brackets; SCHED_FIFO is 1.
            let after_name = stat.rsplit_once(')').map(|(_, rest)| rest).unwrap_or_default();
            after_name.split_whitespace().nth(38) == Some("1")
        });
        Some(if fifo { Policy::Fifo } else { Policy::Other })
    }

    /// Waits for its end; returns the lateness of each cycle, whole µs, sorted.
    pub(crate) fn finish(self) -> Vec<f64> {
        let output = self.0.wait_with_output().expect("cyclictest is our child");
        let text = String::from_utf8_lossy(&output.stdout);
        let mut lateness_us = Vec::new();
        for line in text.lines() {
            if let Some(most) = line.strip_prefix("# Histogram Overflows:") {
                let over = most.trim().parse().unwrap_or(0);
                lateness_us.extend(std::iter::repeat_n(HIGHEST_US as f64, over));
            }
            let mut words = line.split_whitespace();
            if let (Some(Ok(us)), Some(Ok(count))) =
                (words.next().map(str::parse::<f64>), words.next().map(str::parse::<usize>))
            {
                lateness_us.extend(std::iter::repeat_n(us, count));
            }
        }
        lateness_us.sort_by(f64::total_cmp);
        lateness_us
    }
}

/// stress-ng, until it is dropped.
pub(crate) struct Stress(Child);

impl Stress {
    pub(crate) fn start(workers: usize) -> Stress {
        let child = Command::new("stress-ng")
            .args(["--quiet", "--cpu", &workers.to_string()])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        let stress = Stress(child.expect("stress-ng was there a moment ago"));
        // Wait until its workers run.
        std::thread::sleep(Duration::from_millis(500));
        stress
    }
}

impl Drop for Stress {
    /// Its workers end with it only if it can end regularly.
    fn drop(&mut self) {
        if let Some(process) = Pid::from_raw(self.0.id() as i32) {
            let _ = kill_process(process, Signal::TERM);
        }
        let _ = self.0.wait();
    }
}
