//! A separate bus for each test, and a process that publishes on it like the daemon and can be killed.
#![allow(
    dead_code,
    clippy::allow_attributes,
    reason = "each test binary uses its own part, so nothing can be expected"
)]

use bytemuck::Zeroable;
use equipoise_bus::root::shared_memory_prefix;
use equipoise_bus::{Bus, BusSettings, Channel, Event};
use equipoise_client::clock::now_ns;
use equipoise_client::{Consumer, ConsumerSettings};
use equipoise_core::message::State;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Test time-out, far above the expected duration; not a measurement.
pub(crate) const PATIENCE: Duration = Duration::from_secs(90);
/// Publishing period of the station's process.
pub(crate) const PERIOD: Duration = Duration::from_millis(2);
const STATION: &str = "test";
const CHILD_ROOT: &str = "EQUIPOISE_CLIENT_TEST_CHILD";

/// Root of a bus; dropping it also removes the bus's shared memory.
pub(crate) struct Root(TempDir);

pub(crate) fn root() -> Root {
    Root(tempfile::Builder::new().prefix("eqc").tempdir_in("/tmp").unwrap())
}

impl Root {
    pub(crate) fn path(&self) -> PathBuf {
        self.0.path().join("bus")
    }

    pub(crate) fn settings(&self, name: &str) -> ConsumerSettings {
        let settings = ConsumerSettings::new(STATION, name);
        ConsumerSettings { bus: BusSettings { root: self.path(), ..settings.bus }, ..settings }
    }

    pub(crate) fn consumer(&self, name: &str) -> Consumer {
        Consumer::join_with(self.settings(name)).unwrap()
    }

    pub(crate) fn bus(&self, role: &str) -> Bus {
        Bus::join(&self.settings(role).bus).unwrap()
    }

    /// Removes all files of the bus.
    pub(crate) fn remove_the_bus(&self) {
        let _already_gone = std::fs::remove_dir_all(self.path());
        let prefix = shared_memory_prefix(&self.path());
        for file in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if file.file_name().to_string_lossy().starts_with(&prefix) {
                let _already_gone = std::fs::remove_file(file.path());
            }
        }
    }
}

impl Drop for Root {
    fn drop(&mut self) {
        self.remove_the_bus();
    }
}

/// A process that publishes states, killed with SIGKILL when the test ends.
pub(crate) struct Station(Child);

impl Station {
    /// `child` is the test of this binary that calls [`publish_until_killed`].
    pub(crate) fn start(root: &Root, child: &str) -> Station {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", child]).env(CHILD_ROOT, root.path()).stdout(Stdio::null());
        Station(command.spawn().unwrap())
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

/// Body of the station's process, until it is killed or a time-out passes; does nothing in a normal test run.
pub(crate) fn publish_until_killed() {
    let Some(root) = std::env::var_os(CHILD_ROOT) else { return };
    let settings = BusSettings { root: Path::new(&root).to_owned(), ..BusSettings::new(STATION, "daemon") };
    let bus = Bus::join(&settings).unwrap();
    let (states, events) = (bus.publisher::<State>().unwrap(), bus.notifier(Channel::Results).unwrap());
    let begun = Instant::now();
    for cycle in 1.. {
        let time_ns = now_ns();
        // Every fifth cycle has a new suit sample, 1 ms old.
        let suit_age_ns = 1_000_000 + (cycle % 5) * PERIOD.as_nanos() as u64;
        let suit_sample_time_ns = time_ns - 70_000_000;
        let state = State {
            cycle,
            time_ns,
            suit_age_ns,
            suit_sample_time_ns,
            published_ns: now_ns(),
            ..State::zeroed()
        };
        states.send(&state).unwrap();
        events.notify(Event::NewState).unwrap();
        if begun.elapsed() > PATIENCE {
            return;
        }
        std::thread::sleep(PERIOD);
    }
}

/// Polls until `ready` returns a value; panics after the time-out.
pub(crate) fn until<T>(what: &str, mut ready: impl FnMut() -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(value) = ready() {
            return value;
        }
        assert!(begun.elapsed() < PATIENCE, "waited in vain until {what}");
    }
}
