//! A short session of a simulated worker: ten poses, then two lifts of known mass.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use equipoise_adapters::recording::{Recorder, RecordingHeader};
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::noise::Suit;
use equipoise_simulator::repertoire::{LIFTING, REPERTOIRE};
use equipoise_studies::sensors::{EPOCH_NS, Rig, ground_sample, suit_sample};
use equipoise_studies::subject::{Subject, map_in_parallel};
use tempfile::TempDir;

/// Masses of the lifts, and when each is in the hands, s.
pub(crate) const LIFTS: [(f64, [f64; 2]); 2] = [(5.0, [46.0, 54.0]), (8.0, [58.0, 66.0])];
const LENGTH_S: f64 = 68.0;
/// Slow, so that a replay's JSON is small.
pub(crate) const RATE_HZ: f64 = 100.0;

/// Files used by all tests: samples only, states of a replay, and its JSON lines.
pub(crate) struct Session {
    directory: TempDir,
    pub(crate) samples: PathBuf,
    pub(crate) states: PathBuf,
    pub(crate) lines: Vec<serde_json::Value>,
}

/// Made once for all tests of this program, on all processors: they wait for it.
pub(crate) fn session() -> &'static Session {
    static SESSION: OnceLock<Session> = OnceLock::new();
    SESSION.get_or_init(|| {
        let directory = tempfile::tempdir().unwrap();
        let file = |name: &str| directory.path().join(name);
        let (samples, states, json) = (file("samples.mcap"), file("states.mcap"), file("states.jsonl"));
        write(&samples);
        std::thread::scope(|scope| {
            for out in [&states, &json] {
                let replay = ["replay", text(&samples), "--out", text(out)];
                scope.spawn(move || {
                    let ended = equipoise(&replay);
                    assert!(ended.status.success(), "{ended:?}");
                });
            }
        });
        let written = std::fs::read_to_string(&json).unwrap();
        let lines = written.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        Session { directory, samples, states, lines }
    })
}

impl Session {
    /// Path of a file next to the others.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    /// The lines that contain a key, with their times, s.
    pub(crate) fn values_of<'a>(
        &'a self,
        key: &'a str,
    ) -> impl Iterator<Item = (f64, &'a serde_json::Value)> {
        self.lines.iter().filter_map(move |line| Some((line["t"].as_f64()?, line.get(key)?)))
    }
}

pub(crate) fn equipoise(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_equipoise")).args(arguments).output().unwrap()
}

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

pub(crate) fn config(subject: &Subject) -> String {
    format!(
        r#"
station = "bench-1"
[loop]
rate_hz = {RATE_HZ}
[suit]
source = "mvn-udp"
[ground]
source = "ati-rdt"
counts_per_newton = 1000000
counts_per_newton_metre = 1000000
[subject]
id = "anon-7"
height_m = {}
mass_kg = {}
sex = "male"
[identification]
poses_min = 9
"#,
        subject.height_m, subject.mass_kg
    )
}

fn write(path: &Path) {
    let subject = Subject::of_the_paper(5);
    let (worker, rig, suit) =
        (worker(&subject), Rig::PERFECT, Suit::new(Rig::PERFECT.suit_noise, subject.seed));
    let header = RecordingHeader {
        software_version: "0.0.9".to_owned(),
        started_unix_ns: 1_790_000_000_000_000_000,
        started_monotonic_ns: EPOCH_NS,
        config_toml: config(&subject),
        ..RecordingHeader::default()
    };
    let mut recorder = Recorder::create(path, &header).unwrap();
    let numbers = |rate_hz: u32| -> Vec<u32> { (0..(LENGTH_S * f64::from(rate_hz)) as u32).collect() };
    let seed = subject.seed;
    let suits =
        map_in_parallel(&numbers(rig.suit_hz), |number| suit_sample(&worker, &suit, &rig, seed, *number));
    let grounds =
        map_in_parallel(&numbers(rig.plate_hz), |number| ground_sample(&worker, &rig, seed, *number));
    let mut grounds = grounds.iter().peekable();
    for suit in &suits {
        while let Some(ground) = grounds.next_if(|ground| ground.published_ns < suit.published_ns) {
            recorder.write(ground.published_ns, ground).unwrap();
        }
        recorder.write(suit.published_ns, suit).unwrap();
    }
    for ground in grounds {
        recorder.write(ground.published_ns, ground).unwrap();
    }
    recorder.finish().unwrap();
}

fn worker(subject: &Subject) -> Worker {
    let mut worker = Worker::with_habits(subject.person(), subject.seed, Habits::NONE);
    for pose in 0..10 {
        let (_, intention) = &REPERTOIRE[(1 + 7 * pose) % REPERTOIRE.len()];
        worker.intend(intention, 2.0 + 4.0 * pose as f64, 1.6);
    }
    for (mass_kg, [from_s, to_s]) in LIFTS {
        for (part, at_s) in [(0, from_s - 2.0), (1, from_s + 1.0), (2, from_s + 4.0), (4, to_s - 2.0)] {
            worker.intend(&LIFTING[part], at_s, 1.6);
        }
        worker.lift(mass_kg, from_s);
        worker.put_down(to_s);
        worker.intend(&REPERTOIRE[0].1, to_s + 0.5, 1.2);
    }
    worker
}
