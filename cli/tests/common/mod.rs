//! A separate station for each test, with its own bus, state directory and ports.
#![allow(
    dead_code,
    clippy::allow_attributes,
    clippy::unwrap_used,
    reason = "each test file uses a part of it; helpers of tests fail as tests do"
)]

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output};
use std::time::{Duration, Instant};

use equipoise_simulator::ports::free_address;
use equipoise_simulator::settings::SimulationSettings;
use equipoise_simulator::simulation::{Simulation, SimulationHandle};

/// The program under test.
pub(crate) fn equipoise() -> Command {
    Command::new(env!("CARGO_BIN_EXE_equipoise"))
}

/// A file of the reference data; `None`, with a message, if they are absent.
pub(crate) fn shared(path: &str) -> Option<PathBuf> {
    let shared = std::env::var_os("EQUIPOISE_SHARED")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")), PathBuf::from);
    let path = shared.join(path);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: {} is not there; set EQUIPOISE_SHARED to the reference data", path.display());
    None
}

/// The CSV of a real person.
pub(crate) fn human_motion() -> Option<PathBuf> {
    shared("data/human_motion/figaroh_30hz.csv")
}

/// The example configuration for it.
pub(crate) fn human_motion_config() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/human-motion.toml"))
}

/// Output of a program, for messages.
pub(crate) fn describe_output(output: &Output) -> String {
    format!(
        "{:?}\n{}{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

/// A simulated person on separate ports, and the configuration of a daemon that receives them. It ends within
/// `[subject]`.
pub(crate) fn person() -> (SimulationHandle, String) {
    let suit = free_address().unwrap();
    let mut settings = SimulationSettings::default();
    settings.suit.target = suit;
    settings.plate.address = "127.0.0.1:0".parse().unwrap();
    let simulation = Simulation::start(settings).unwrap();
    let plate = simulation.plate_address();
    let config = format!(
        r#"
station = "test"
[loop]
lock_memory = false
[suit]
source = "mvn-udp"
listen = "{suit}"
[ground]
source = "ati-rdt"
address = "{plate}"
counts_per_newton = 1000000
counts_per_newton_metre = 1000000
[subject]
id = "anon-1"
height_m = 1.77
"#
    );
    (simulation, config)
}

/// A daemon on its own bus. Dropping it ends it.
pub(crate) struct Station {
    /// Bus, state and files; removed at the end.
    pub(crate) directory: tempfile::TempDir,
    daemon: Child,
}

const NAME: &str = "test";

impl Station {
    /// Starts the daemon with a configuration whose station is `test`, and waits until it reports that it runs.
    pub(crate) fn start(config: &str) -> Station {
        Station::start_with(config, &[], |_| {})
    }

    /// The same with more options of `run`, and a state directory prepared by `prepare`.
    pub(crate) fn start_with(config: &str, options: &[&str], prepare: impl FnOnce(&Path)) -> Station {
        // It contains sockets: the path must be short.
        let directory = tempfile::Builder::new().prefix("eq").tempdir_in("/tmp").unwrap();
        let file = directory.path().join("config.toml");
        std::fs::write(&file, config).unwrap();
        prepare(&directory.path().join("state"));
        let mut command = command_in(directory.path());
        let daemon = command.arg("run").arg("--config").arg(&file).args(options).spawn().unwrap();
        let mut station = Station { directory, daemon };
        station.wait_for_status();
        station
    }

    fn wait_for_status(&mut self) {
        let status = self.directory.path().join("bus").join(format!("equipoise-{NAME}.json"));
        let started = Instant::now();
        while !status.exists() {
            assert!(self.daemon.try_wait().unwrap().is_none(), "the daemon ended by itself");
            assert!(started.elapsed() < Duration::from_secs(60), "the daemon does not start");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Ends the daemon, does `between` with the bus's directory, and starts another daemon with this configuration.
    pub(crate) fn restart(&mut self, config: &str, between: impl FnOnce(&Path)) {
        let id = rustix::process::Pid::from_child(&self.daemon);
        rustix::process::kill_process(id, rustix::process::Signal::TERM).unwrap();
        self.daemon.wait().unwrap();
        between(&self.directory.path().join("bus"));
        let file = self.file("config.toml");
        std::fs::write(&file, config).unwrap();
        let mut command = command_in(self.directory.path());
        self.daemon = command.arg("run").arg("--config").arg(&file).spawn().unwrap();
        self.wait_for_status();
    }

    /// The program on this station's bus.
    pub(crate) fn command(&self, name: &str) -> Command {
        let mut command = command_in(self.directory.path());
        command.arg(name).env("EQUIPOISE_STATION", NAME);
        command
    }

    /// Reloads the daemon with another configuration, and waits until it is active.
    pub(crate) fn reload(&self, config: &str) {
        let status = self.directory.path().join("bus").join(format!("equipoise-{NAME}.json"));
        // The file's other facts change every second.
        let active = || {
            let status = serde_json::from_str::<serde_json::Value>(&std::fs::read_to_string(&status).ok()?);
            status.ok()?["config_toml"].as_str().map(str::to_owned)
        };
        let before = active().unwrap();
        std::fs::write(self.file("config.toml"), config).unwrap();
        let id = rustix::process::Pid::from_child(&self.daemon);
        rustix::process::kill_process(id, rustix::process::Signal::HUP).unwrap();
        let started = Instant::now();
        while active().is_none_or(|active| active == before) {
            assert!(started.elapsed() < Duration::from_secs(60), "the configuration is not taken up");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// A file of this station.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }
}

fn command_in(directory: &Path) -> Command {
    let mut command = equipoise();
    command.env("EQUIPOISE_BUS_ROOT", directory.join("bus")).env("STATE_DIRECTORY", directory.join("state"));
    command
}

impl Drop for Station {
    fn drop(&mut self) {
        let id = rustix::process::Pid::from_child(&self.daemon);
        let _ = rustix::process::kill_process(id, rustix::process::Signal::TERM);
        let _ = self.daemon.wait();
        remove_shared_memory(&self.directory.path().join("bus"));
    }
}

/// iceoryx2 leaves 16 bytes behind for each root of a bus, outside the temporary directory; killed processes leave
/// more.
pub(crate) fn remove_shared_memory(root: &Path) {
    let prefix = equipoise_bus::root::shared_memory_prefix(root);
    for file in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
        if file.file_name().to_string_lossy().starts_with(&prefix) {
            let _absent = std::fs::remove_file(file.path());
        }
    }
}
