//! Consumers that join, leave, are killed while they read, and are killed while they join: all real processes.

use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use crate::process::{Process, wait_for};

/// Number at once: a topic has 16 places, and a killed process keeps its own until it is cleared away.
const AT_ONCE: u64 = 6;

/// Counts of consumers by outcome.
#[derive(Debug, Default)]
pub(crate) struct Storm {
    /// Received a state: those that left and those that were killed afterwards.
    pub(crate) joined: AtomicU64,
    left: AtomicU64,
    killed: AtomicU64,
    killed_joining: AtomicU64,
    /// Found all places occupied, by processes that were killed and not cleared away yet.
    pub(crate) turned_away: AtomicU64,
}

impl Storm {
    /// Starts consumers until `stop` is set. Their output goes to files in `directory`.
    pub(crate) fn run(&self, directory: &Path, stop: &AtomicBool) {
        std::thread::scope(|scope| {
            for lane in 0..AT_ONCE {
                scope.spawn(move || {
                    for round in 0.. {
                        if stop.load(Ordering::Relaxed) {
                            break;
                        }
                        self.one(directory, lane, round);
                    }
                });
            }
        });
    }

    fn turned_away(&self, consumer: &mut Process) {
        must_have_found_no_place(consumer);
        self.turned_away.fetch_add(1, Ordering::Relaxed);
    }

    fn one(&self, directory: &Path, lane: u64, round: u64) {
        let random = crate::churn::pseudo_random(lane * 1_000_003 + round);
        let mut consumer = start(directory, &format!("consumer-{lane}"), &["watch", "--for", "0.2"]);
        match (lane + round) % 3 {
            0 => {
                if consumer.wait().success() && !consumer.stdout().is_empty() {
                    self.joined.fetch_add(1, Ordering::Relaxed);
                    self.left.fetch_add(1, Ordering::Relaxed);
                } else {
                    self.turned_away(&mut consumer);
                }
            }
            1 => {
                let joined = wait_for("a consumer's first line", || match consumer.stdout().is_empty() {
                    false => Some(true),
                    true => (!consumer.is_running()).then(|| !consumer.stdout().is_empty()),
                });
                if joined {
                    consumer.kill();
                    self.joined.fetch_add(1, Ordering::Relaxed);
                    self.killed.fetch_add(1, Ordering::Relaxed);
                } else {
                    self.turned_away(&mut consumer);
                }
            }
            _ => {
                std::thread::sleep(Duration::from_micros(random % 60_000));
                consumer.kill();
                self.killed_joining.fetch_add(1, Ordering::Relaxed);
            }
        }
        std::thread::sleep(Duration::from_millis(random % 300));
    }
}

/// Checks that it ended early for lack of a place, and for no other reason.
pub(crate) fn must_have_found_no_place(process: &mut Process) {
    let (code, message) = (process.wait().code(), process.stderr());
    let full = message.contains("all its ") && message.contains(" are taken");
    assert!(code == Some(1) && full, "it ended with {code:?} and wrote: {message}");
}

/// Starts the program on the station given by the environment.
pub(crate) fn start(directory: &Path, name: &str, arguments: &[&str]) -> Process {
    let mut command = Command::new(env!("CARGO_BIN_EXE_equipoise"));
    command.args(arguments);
    Process::start(command, directory.join(format!("{name}.out")), directory.join(format!("{name}.err")))
}
