//! A separate station for each test: bus, state directory, ports, configuration.

use std::cell::{Cell, RefCell};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use equipoise_daemon::stored_file::sealed;
use equipoise_simulator::ports::free_address;
use equipoise_simulator::settings::SimulationSettings;
use equipoise_simulator::simulation::{Simulation, SimulationHandle};
use tempfile::TempDir;

use crate::process::{Process, TIMEOUT, wait_for};

/// The station's name on its own bus.
pub(crate) const NAME: &str = "bench";

/// Output of a completed command.
pub(crate) struct Output {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Output {
    /// Asserts that it failed, and that its output contains each of these.
    #[track_caller]
    pub(crate) fn assert_failed(&self, code: i32, parts: &[&str]) {
        assert_eq!(self.code, Some(code), "out: {} err: {}", self.stdout, self.stderr);
        for part in parts {
            assert!(self.stderr.contains(part), "{part:?} is not in: {}", self.stderr);
        }
        assert!(!self.stderr.contains("panicked"), "{}", self.stderr);
    }

    /// Asserts that it succeeded.
    #[track_caller]
    pub(crate) fn assert_done(&self) -> &str {
        assert_eq!(self.code, Some(0), "out: {} err: {}", self.stdout, self.stderr);
        &self.stdout
    }
}

pub(crate) struct Station {
    /// The adapters' processes, of a station whose sensors are not in the daemon. Dropped before their files.
    adapters: Option<RefCell<Vec<Process>>>,
    directory: TempDir,
    pub(crate) suit: SocketAddr,
    pub(crate) plate: SocketAddr,
    processes: Cell<u32>,
}

impl Station {
    pub(crate) fn new() -> Station {
        // Short: the root of a bus has at most 46 bytes.
        let directory = tempfile::Builder::new().prefix("eq").tempdir_in("/tmp").expect("a directory");
        Station {
            adapters: None,
            directory,
            suit: free_address().expect("a free port"),
            plate: free_address().expect("a free port"),
            processes: Cell::new(0),
        }
    }

    /// A station as the shipped units run it: the daemon without sensors, each adapter in a separate process, one file.
    pub(crate) fn with_separate_adapters() -> Station {
        let mut station = Station::new();
        station.adapters = Some(RefCell::default());
        station
    }

    /// Starts a daemon with a file, and its adapters if they are separate processes.
    fn spawn_daemon(&self, path: &str, environment: &[(&str, &std::ffi::OsStr)]) -> Process {
        let Some(adapters) = &self.adapters else {
            return self.spawn_with(&["run", "--config", path], environment);
        };
        adapters.replace(Vec::new());
        let daemon = self.spawn_with(&["run", "--sensors-apart", "--config", path], environment);
        let start = |stream| self.spawn(&["adapter", stream, "--config", path]);
        adapters.replace(["suit", "ground"].map(start).into());
        daemon
    }

    /// The adapter of a station whose sensors are not in the daemon: 0 the suit's, 1 the ground's.
    pub(crate) fn with_adapter<T>(&self, index: usize, call: impl FnOnce(&mut Process) -> T) -> T {
        call(&mut self.adapters.as_ref().expect("a station apart").borrow_mut()[index])
    }

    /// Directory of the bus's files.
    pub(crate) fn root(&self) -> PathBuf {
        self.directory.path().join("bus")
    }

    pub(crate) fn state_directory(&self) -> PathBuf {
        self.directory.path().join("state")
    }

    pub(crate) fn profile(&self, subject: &str) -> PathBuf {
        self.state_directory().join("subjects").join(format!("{subject}.toml"))
    }

    /// Gives another subject a profile: this one's, modified by `change`.
    pub(crate) fn copy_profile(&self, from: &str, to: &str, change: impl FnOnce(&mut toml::Table)) {
        let text = std::fs::read_to_string(self.profile(from)).expect("a profile");
        let mut profile: toml::Table = text.parse().expect("a profile in TOML");
        profile.insert("subject".to_owned(), to.into());
        change(&mut profile);
        let text = sealed(toml::to_string(&profile).expect("TOML"));
        std::fs::write(self.profile(to), text).expect("another profile");
    }

    /// A file of the test.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, content: &str) -> PathBuf {
        let path = self.file(name);
        std::fs::write(&path, content).expect("a file of the test");
        path
    }

    /// A plain configuration. Slow, and without real time, so that many stations fit on a small machine.
    pub(crate) fn configuration(&self) -> String {
        format!(
            r#"station = "{NAME}"
[loop]
rate_hz = 200
priority = 0
lock_memory = false
[suit]
source = "mvn-udp"
listen = "{}"
[ground]
source = "ati-rdt"
address = "{}"
counts_per_newton = 1000000
counts_per_newton_metre = 1000000
[subject]
id = "anon-1"
height_m = 1.77
mass_kg = 72.0
[identification]
poses_min = 1000
"#,
            self.suit, self.plate
        )
    }

    pub(crate) fn command<Argument: AsRef<std::ffi::OsStr>>(&self, arguments: &[Argument]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_equipoise"));
        command.args(arguments).env("EQUIPOISE_BUS_ROOT", self.root());
        command.env("STATE_DIRECTORY", self.state_directory()).env("EQUIPOISE_STATION", NAME);
        for variable in ["RUST_LOG", "JOURNAL_STREAM", "NOTIFY_SOCKET", "RUNTIME_DIRECTORY"] {
            command.env_remove(variable);
        }
        command
    }

    /// Starts a command without waiting for its end.
    pub(crate) fn spawn(&self, arguments: &[&str]) -> Process {
        self.spawn_in(arguments, &self.state_directory())
    }

    fn spawn_in(&self, arguments: &[&str], state_directory: &Path) -> Process {
        let number = self.processes.replace(self.processes.get() + 1);
        let mut command = self.command(arguments);
        command.env("STATE_DIRECTORY", state_directory);
        Process::start(command, self.file(&format!("{number}.out")), self.file(&format!("{number}.err")))
    }

    /// Runs a command to its end.
    pub(crate) fn run(&self, arguments: &[&str]) -> Output {
        let started = Instant::now();
        loop {
            let mut process = self.spawn(arguments);
            let code = process.wait().code();
            let output = Output { code, stdout: process.stdout(), stderr: process.stderr() };
            // The daemon loads no subject before the data of the previous one are on the disk, which may be busy, and
            // waits half a second only for a loop that has no core.
            let early = ["the disk is slow", "not on the disk yet", "the loop does not run"];
            let is_early = early.iter().any(|reason| output.stderr.contains(reason));
            if !is_early || started.elapsed() > TIMEOUT {
                return output;
            }
        }
    }

    /// Starts a daemon with this configuration.
    pub(crate) fn try_daemon(&self, configuration: &str) -> Process {
        let path = self.write(&format!("{}.toml", self.processes.get()), configuration);
        self.spawn_daemon(&path.to_string_lossy(), &[])
    }

    /// A daemon with running cycles.
    pub(crate) fn daemon(&self, configuration: &str) -> Process {
        ready(self.try_daemon(configuration))
    }

    /// A daemon with the configuration in this file of the test, and additional environment variables.
    pub(crate) fn daemon_of(&self, name: &str, environment: &[(&str, &std::ffi::OsStr)]) -> Process {
        let path = self.file(name).to_string_lossy().into_owned();
        ready(self.spawn_daemon(&path, environment))
    }

    /// Starts a command with additional environment variables.
    pub(crate) fn spawn_with(&self, arguments: &[&str], environment: &[(&str, &std::ffi::OsStr)]) -> Process {
        let number = self.processes.replace(self.processes.get() + 1);
        let mut command = self.command(arguments);
        command.envs(environment.iter().copied());
        Process::start(command, self.file(&format!("{number}.out")), self.file(&format!("{number}.err")))
    }

    /// A daemon with another state directory.
    pub(crate) fn daemon_with_state_in(&self, state_directory: &Path) -> Process {
        let path = self.write("elsewhere.toml", &self.configuration());
        ready(self.spawn_in(&["run", "--config", &path.to_string_lossy()], state_directory))
    }

    /// Settings of the simulated sensors of this station.
    pub(crate) fn sensors(&self) -> SimulationSettings {
        let mut settings = SimulationSettings::default();
        settings.suit.target = self.suit;
        settings.plate.address = self.plate;
        // Sufficient for every test, with low load on the machine.
        settings.plate.rate_hz = 250.0;
        settings
    }

    /// A simulated person in suit and on plate.
    pub(crate) fn person(&self) -> SimulationHandle {
        simulate(&self.sensors())
    }

    /// `equipoise status --json`; `None` while no daemon publishes.
    pub(crate) fn status(&self) -> Option<serde_json::Value> {
        let ended = self.run(&["status", "--json"]);
        (ended.code == Some(0)).then(|| serde_json::from_str(&ended.stdout).expect("JSON"))
    }

    /// The next answer of `status --json`.
    pub(crate) fn current_status(&self) -> serde_json::Value {
        self.status_when("the daemon's status", |_| true)
    }

    /// The next answer that meets a condition: at one instant, a sender that waits for a core is stale, which is no fault.
    pub(crate) fn status_when(
        &self,
        what: &str,
        condition: impl Fn(&serde_json::Value) -> bool,
    ) -> serde_json::Value {
        wait_for(what, || self.status().filter(&condition))
    }

    /// The output of a command, once it meets a condition: on a busy machine a sensor is late now and then, and counts and
    /// incidents, which are published once a second, may be missing.
    pub(crate) fn run_until(
        &self,
        what: &str,
        arguments: &[&str],
        condition: impl Fn(&Output) -> bool,
    ) -> Output {
        wait_for(what, || Some(self.run(arguments)).filter(&condition))
    }

    /// Every file below the root of the bus, and its shared memory.
    pub(crate) fn files_of_the_bus(&self) -> Vec<PathBuf> {
        let mut files = Vec::new();
        collect(&self.root(), &mut files);
        files.extend(self.shared_memory());
        files
    }

    fn shared_memory(&self) -> Vec<PathBuf> {
        let prefix = equipoise_bus::root::shared_memory_prefix(&self.root());
        let mut files = Vec::new();
        collect(Path::new("/dev/shm"), &mut files);
        files.retain(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&prefix)));
        files
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        // Leftovers of a killed process are outside the temporary directory.
        for path in self.shared_memory() {
            let _ = std::fs::remove_file(path);
        }
    }
}

/// A simulated person with sensors on these ports; a process that seeks a free port binds them for an instant.
pub(crate) fn simulate(settings: &SimulationSettings) -> SimulationHandle {
    wait_for("a simulated person", || Simulation::start(settings.clone()).ok())
}

/// Waits until a daemon reports that it runs.
#[track_caller]
pub(crate) fn ready(mut daemon: Process) -> Process {
    wait_for("the daemon to run", || {
        assert!(daemon.is_running(), "it ended: {}", daemon.stderr());
        daemon.stderr().contains("cycles a second").then_some(())
    });
    daemon
}

fn collect(directory: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(directory).into_iter().flatten().flatten() {
        if entry.path().is_dir() {
            collect(&entry.path(), files);
        } else {
            files.push(entry.path());
        }
    }
}
