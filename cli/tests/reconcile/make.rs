//! Small recordings of a simulated worker: poses, then work, without a network.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use equipoise_adapters::recording::{Recorder, RecordingHeader};
use equipoise_core::cycle::{Checkpoint, Memory};
use equipoise_core::message::{GroundSample, SuitSample};
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::noise::Suit;
use equipoise_simulator::repertoire::{LIFTING, REPERTOIRE};
use equipoise_studies::sensors::{EPOCH_NS, Rig, ground_sample, sample_time_ns, suit_sample};
use equipoise_studies::subject::Subject;
use serde_json::Value;

use crate::common::{describe_output, equipoise};

/// Duration of taking and holding a pose, s.
const POSE_EVERY_S: f64 = 4.0;
const POSE_WITHIN_S: f64 = 1.6;
/// Duration from one posture of work to the next, s.
const WORK_EVERY_S: f64 = 1.3;
const VARIED_EVERY_S: f64 = 2.4;

/// A load is taken this long after the work begins, s.
const LIFT_AFTER_S: f64 = 10.0;

/// Settings of a recording.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Script {
    pub(crate) subject: Subject,
    pub(crate) rig: Rig,
    pub(crate) habits: Habits,
    pub(crate) poses: usize,
    pub(crate) work_s: f64,
    /// Work with poses of all kinds, independent arms, and some static ones; otherwise a box is moved with both hands.
    pub(crate) varied: bool,
    /// Load in the hands from a time after the start of the work, kg.
    pub(crate) carried_kg: f64,
}

impl Script {
    /// Stature and mass of the paper's subject; ten poses and 30 s of work without sensor errors.
    pub(crate) fn perfect() -> Script {
        Script {
            subject: Subject::of_the_paper(5),
            rig: Rig::PERFECT,
            habits: Habits::NONE,
            poses: 10,
            work_s: 30.0,
            varied: false,
            carried_kg: 0.0,
        }
    }

    /// The same with an ordinary suit and plate, and a body that sways and breathes.
    pub(crate) fn ordinary() -> Script {
        let subject = Subject::of_the_paper(5);
        Script { rig: Rig::ORDINARY, habits: subject.habits(), ..Script::perfect() }
    }

    /// End of the poses and start of the work, s.
    pub(crate) fn poses_end_s(&self) -> f64 {
        2.0 + self.poses as f64 * POSE_EVERY_S
    }

    /// Time at which a load is taken, s.
    pub(crate) fn lift_s(&self) -> f64 {
        self.poses_end_s() + LIFT_AFTER_S
    }

    pub(crate) fn length_s(&self) -> f64 {
        self.poses_end_s() + self.work_s
    }

    /// The configuration that the recording carries.
    pub(crate) fn config(&self) -> String {
        format!(
            r#"
station = "test"
[suit]
source = "mvn-udp"
[ground]
source = "ati-rdt"
counts_per_newton = 1000000
counts_per_newton_metre = 1000000
[subject]
id = "anon-1"
height_m = {}
mass_kg = {}
sex = "male"
[identification]
poses_min = {}
"#,
            self.subject.height_m,
            self.subject.mass_kg,
            self.poses.max(6) - 1,
        )
    }

    /// The worker with all commands up to `time_s`.
    pub(crate) fn worker(&self) -> Ordered {
        let worker = Worker::with_habits(self.subject.person(), self.subject.seed, self.habits);
        Ordered { script: *self, worker, next: 0, lifted: false }
    }

    /// All samples by time of arrival.
    pub(crate) fn samples(&self) -> Samples {
        let mut ordered = self.worker();
        let suit_model = Suit::new(self.rig.suit_noise, self.subject.seed);
        let mut samples = Samples::default();
        let end_ns = EPOCH_NS + (self.length_s() * 1e9) as u64;
        let (mut suit, mut ground) = (0, 0);
        loop {
            let suit_ns = sample_time_ns(suit, self.rig.suit_hz);
            let ground_ns = sample_time_ns(ground, self.rig.plate_hz);
            if suit_ns.min(ground_ns) >= end_ns {
                return samples;
            }
            ordered.until((suit_ns.min(ground_ns) - EPOCH_NS) as f64 * 1e-9);
            if suit_ns <= ground_ns {
                let seed = self.subject.seed;
                samples.suit.push(suit_sample(&ordered.worker, &suit_model, &self.rig, seed, suit));
                suit += 1;
            } else {
                samples.ground.push(ground_sample(&ordered.worker, &self.rig, self.subject.seed, ground));
                ground += 1;
            }
        }
    }
}

/// A worker and its pending commands.
pub(crate) struct Ordered {
    script: Script,
    pub(crate) worker: Worker,
    next: usize,
    lifted: bool,
}

impl Ordered {
    /// Gives every command due before a time, s.
    pub(crate) fn until(&mut self, time_s: f64) {
        let script = &self.script;
        let lift_s = script.lift_s();
        if script.carried_kg > 0.0 && !self.lifted && lift_s <= time_s + 0.05 {
            self.worker.lift(script.carried_kg, lift_s);
            self.lifted = true;
        }
        loop {
            let pose = self.next < script.poses;
            let every_s = if script.varied { VARIED_EVERY_S } else { WORK_EVERY_S };
            let at_s = if pose {
                2.0 + self.next as f64 * POSE_EVERY_S
            } else {
                script.poses_end_s() + (self.next - script.poses) as f64 * every_s
            };
            if at_s > time_s + 0.05 {
                return;
            }
            if pose {
                let (_, intention) = &REPERTOIRE[(1 + 7 * self.next) % REPERTOIRE.len()];
                self.worker.intend(intention, at_s, POSE_WITHIN_S);
            } else if script.varied {
                let (_, intention) = &REPERTOIRE[(4 + 5 * self.next) % REPERTOIRE.len()];
                self.worker.intend(intention, at_s, 0.5 * every_s);
            } else {
                self.worker.intend(&LIFTING[self.next % LIFTING.len()], at_s, 0.9 * every_s);
            }
            self.next += 1;
        }
    }
}

/// The samples of suit and plate.
#[derive(Debug, Clone, Default)]
pub(crate) struct Samples {
    pub(crate) suit: Vec<SuitSample>,
    pub(crate) ground: Vec<GroundSample>,
    /// Time of a change of the subject, ns, and its pseudonym.
    pub(crate) later_subject: Option<(u64, &'static str)>,
}

impl Samples {
    /// Writes a recording.
    pub(crate) fn write(&self, path: &Path, config: &str) {
        self.write_from(path, config, EPOCH_NS, None);
    }

    /// Writes the part from a time on, after the loop's memory at that time.
    pub(crate) fn write_from(&self, path: &Path, config: &str, from_ns: u64, memory: Option<&Memory>) {
        let header = RecordingHeader {
            software_version: "test".to_owned(),
            started_monotonic_ns: from_ns,
            config_toml: config.to_owned(),
            ..RecordingHeader::default()
        };
        let mut recorder = Recorder::create(path, &header).unwrap();
        if let Some((at_ns, id)) = self.later_subject {
            recorder.add_subject(at_ns, &format!("subject = \"{id}\"\n")).unwrap();
        }
        if let Some(memory) = memory {
            let mut checkpoint: Box<Checkpoint> = bytemuck::zeroed_box();
            checkpoint.take(1, memory);
            recorder.write(from_ns, &*checkpoint).unwrap();
        }
        let mut suit = self.suit.iter().filter(|sample| sample.sample_time_ns >= from_ns).peekable();
        let mut ground = self.ground.iter().filter(|sample| sample.sample_time_ns >= from_ns).peekable();
        loop {
            let next_ground_ns = ground.peek().map_or(u64::MAX, |sample| sample.published_ns);
            if let Some(sample) = suit.next_if(|sample| sample.published_ns <= next_ground_ns) {
                recorder.write(sample.published_ns, sample).unwrap();
            } else if let Some(sample) = ground.next() {
                recorder.write(sample.published_ns, sample).unwrap();
            } else {
                break;
            }
        }
        recorder.finish().unwrap();
    }
}

pub(crate) fn reconciled(recording: &Path, options: &[&str]) -> Value {
    let output = equipoise().arg("reconcile").arg(recording).arg("--json").args(options).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", describe_output(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Load of the right hand in the work, kg.
pub(crate) const HIDDEN_KG: f64 = 2.0;

/// A session with a hidden load, reconciled once for all tests.
pub(crate) struct Session {
    _directory: tempfile::TempDir,
    pub(crate) script: Script,
    pub(crate) recording: PathBuf,
    pub(crate) out: PathBuf,
    pub(crate) finding: Value,
}

impl Session {
    pub(crate) fn model(&self) -> PathBuf {
        self.out.join("model.toml")
    }
}

/// A worker who takes an object into the right hand ten seconds after the start of the work.
pub(crate) fn session() -> &'static Session {
    static SESSION: OnceLock<Session> = OnceLock::new();
    SESSION.get_or_init(|| {
        let mut script = Script { carried_kg: HIDDEN_KG, work_s: 60.0, varied: true, ..Script::ordinary() };
        script.rig.plate_hz = 200;
        script.habits = Habits { right_hand_fraction: 1.0, ..script.habits };
        let directory = tempfile::tempdir().unwrap();
        let (recording, out) = (directory.path().join("shift.mcap"), directory.path().join("out"));
        script.samples().write(&recording, &script.config());
        let finding = reconciled(&recording, &["--out", out.to_str().unwrap()]);
        Session { _directory: directory, script, recording, out, finding }
    })
}
