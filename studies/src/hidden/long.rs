//! Long recordings, and the program's resources for them: time and peak memory.
//!
//! Of twenty hours only some minutes are simulated; their last part is repeated, from standing straight to standing
//! straight.

use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use equipoise_adapters::recording::{Recorder, RecordingHeader, WriteError};
use equipoise_core::message::{GroundSample, SuitSample};
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_simulator::intention::Intention;
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::repertoire::REPERTOIRE;
use serde_json::Value;

use super::recording::{Noise, Sample, Station, config_toml};
use super::scenario::Script;
use super::truth::Spans;
use crate::sensors::EPOCH_NS;
use crate::subject::Subject;
use crate::table::{Cell, Table};

/// Number of poses, and the interval between them, s.
const POSES: usize = 16;
const POSE_S: f64 = 4.0;
const WITHIN_S: f64 = 1.4;
/// Clean work, s.
const CLEAN_S: f64 = 120.0;
/// From one posture of the work to the next, s.
const WORK_S: f64 = 2.5;
/// Load of the right hand after that, kg.
const HIDDEN_KG: f64 = 1.5;
/// Time after the clean work at which the load hangs and the body stands straight, s.
const SETTLED_S: f64 = 5.0;
/// Sampling interval of a running program's memory.
const LOOK_EVERY: Duration = Duration::from_millis(10);

/// Length of the recording, and decimation of its samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Long {
    /// Length of the recording, s.
    pub length_s: f64,
    /// Simulated part, s; the rest is a repetition.
    pub simulated_s: f64,
    /// Decimation factors of the suit's 60 samples a second and of the plate's 250.
    pub every: [u32; 2],
}

impl Long {
    /// All samples of suit and plate, with ten minutes simulated.
    pub fn of(length_s: f64) -> Long {
        Long { length_s, simulated_s: length_s.min(600.0), every: [1; 2] }
    }

    /// Time at which the load is taken, s.
    pub fn taken_s(&self) -> f64 {
        2.0 + POSES as f64 * POSE_S + CLEAN_S
    }

    /// Writes the recording.
    ///
    /// # Errors
    /// The file exists or cannot be written.
    pub fn write(&self, path: &Path, seed: u64) -> Result<(), WriteError> {
        self.simulate(seed).write(path, self.length_s)
    }

    /// Simulates the part that recordings of any length have in common.
    pub fn simulate(&self, seed: u64) -> Simulated {
        let subject = Subject::of_the_paper(seed);
        let mut station = Station::new(&self.script(&subject), Default::default(), Noise::ORDINARY, seed);
        let (mut samples, mut seen) = (Vec::new(), [0_u32; 2]);
        let Ok(()) = station.play(|sample| {
            let (recorded, stream) = match sample {
                Sample::Suit(message) => (Recorded::Suit(message), 0),
                Sample::Ground { message, .. } => (Recorded::Ground(message), 1),
            };
            if seen[stream].is_multiple_of(self.every[stream]) {
                samples.push(recorded);
            }
            seen[stream] += 1;
            Ok::<(), Infallible>(())
        });
        Simulated { long: *self, subject, samples }
    }

    /// Poses, clean work, and the same work with a load in the right hand, all at one place.
    fn script(&self, subject: &Subject) -> Script {
        let habits = Habits { right_hand_fraction: 1.0, ..subject.habits() };
        let mut worker = Worker::with_habits(subject.person(), subject.seed, habits);
        for index in 0..POSES {
            let at_s = 2.0 + index as f64 * POSE_S;
            worker.take_pose(&LIBRARY[(1 + 3 * index) % LIBRARY.len()], at_s, WITHIN_S);
        }
        let (identified_s, taken_s) = (2.0 + POSES as f64 * POSE_S, self.taken_s());
        let mut work = |from_s: f64, to_s: f64| {
            for step in 0.. {
                let at_s = from_s + f64::from(step) * WORK_S;
                if at_s + WORK_S > to_s {
                    return;
                }
                let (_, intention) = &REPERTOIRE[(4 + 5 * step as usize) % REPERTOIRE.len()];
                worker.intend(intention, at_s, 0.5 * WORK_S);
            }
        };
        work(identified_s, taken_s - WORK_S);
        work(taken_s + SETTLED_S, self.simulated_s - SETTLED_S);
        for at_s in [taken_s - WORK_S, self.simulated_s - SETTLED_S] {
            worker.intend(&Intention::STAND, at_s, WITHIN_S);
        }
        worker.lift(HIDDEN_KG, taken_s);
        let spans = Spans {
            identify: [0.0, identified_s],
            reference: [identified_s, taken_s],
            work: [taken_s, self.length_s],
        };
        let length_s = self.simulated_s;
        Script { worker, spans, length_s, unasked_s: length_s, places: Vec::new(), turned: false }
    }
}

/// The simulated part of a recording.
pub struct Simulated {
    long: Long,
    subject: Subject,
    /// In order of time.
    samples: Vec<Recorded>,
}

impl Simulated {
    /// Writes a recording of this length, s: the simulated part, then repetitions of its work.
    ///
    /// # Errors
    /// The file exists or cannot be written.
    pub fn write(&self, path: &Path, length_s: f64) -> Result<(), WriteError> {
        let Simulated { long, subject, samples } = self;
        let header = RecordingHeader {
            software_version: env!("CARGO_PKG_VERSION").to_owned(),
            started_monotonic_ns: EPOCH_NS,
            config_toml: config_toml(subject, "long", POSES - 2, false),
            ..RecordingHeader::default()
        };
        let mut writer = Writer { recorder: Recorder::create(path, &header)?, written: [0; 2] };
        for recorded in samples {
            writer.write(recorded, 0)?;
        }
        let again_ns = EPOCH_NS + ((long.taken_s() + SETTLED_S) * 1e9) as u64;
        let span_ns = EPOCH_NS + (long.simulated_s * 1e9) as u64 - again_ns;
        let end_ns = EPOCH_NS + (length_s * 1e9) as u64;
        let repeats = length_s > long.simulated_s;
        let again = || samples.iter().filter(move |recorded| repeats && recorded.time_ns() >= again_ns);
        for time in 1.. {
            for recorded in again() {
                if recorded.time_ns() + time * span_ns >= end_ns {
                    break;
                }
                writer.write(recorded, time * span_ns)?;
            }
            if !repeats || again_ns + (time + 1) * span_ns >= end_ns {
                break;
            }
        }
        writer.recorder.finish()?;
        Ok(())
    }
}

/// One sample.
enum Recorded {
    Suit(Box<SuitSample>),
    Ground(Box<GroundSample>),
}

impl Recorded {
    fn time_ns(&self) -> u64 {
        match self {
            Recorded::Suit(sample) => sample.sample_time_ns,
            Recorded::Ground(sample) => sample.sample_time_ns,
        }
    }
}

struct Writer {
    recorder: Recorder,
    /// Samples of suit and plate so far.
    written: [u32; 2],
}

impl Writer {
    /// Writes a sample with its time shifted.
    fn write(&mut self, recorded: &Recorded, later_ns: u64) -> Result<(), WriteError> {
        let stream = usize::from(matches!(recorded, Recorded::Ground(_)));
        let number = self.written[stream];
        self.written[stream] += 1;
        let time_ns = recorded.time_ns() + later_ns;
        match recorded {
            Recorded::Suit(sample) => {
                let mut sample = sample.clone();
                (sample.sample_time_ns, sample.arrival_ns, sample.published_ns) = (time_ns, time_ns, time_ns);
                (sample.sequence, sample.device_counter) = (u64::from(number) + 1, number);
                self.recorder.write(time_ns, &*sample)
            }
            Recorded::Ground(sample) => {
                let mut sample = sample.clone();
                (sample.sample_time_ns, sample.arrival_ns, sample.published_ns) = (time_ns, time_ns, time_ns);
                (sample.sequence, sample.device_counter) = (u64::from(number) + 1, number);
                self.recorder.write(time_ns, &*sample)
            }
        }
    }
}

/// Resources that a program used for a recording.
#[derive(Debug, Clone)]
pub struct Needed {
    /// Wall-clock time, s.
    pub seconds: f64,
    /// Resident memory at its highest, bytes.
    pub peak_bytes: u64,
    /// Its output, `reconcile --json`.
    pub finding: Value,
}

/// Runs the program's reconciliation of a recording and monitors its memory.
///
/// # Errors
/// A message: it cannot be run, or it failed.
pub fn reconcile(program: &Path, recording: &Path) -> Result<Needed, String> {
    let failed = |error: &dyn std::fmt::Display| format!("{}: {error}", program.display());
    let out = recording.with_extension("json");
    let file = std::fs::File::create(&out).map_err(|error| failed(&error))?;
    let started = Instant::now();
    let mut command = Command::new(program);
    command.arg("reconcile").arg(recording).arg("--json").stdin(Stdio::null()).stdout(file);
    let mut child = command.spawn().map_err(|error| failed(&error))?;
    let status_file = PathBuf::from(format!("/proc/{}/status", child.id()));
    let mut peak_bytes = 0;
    let status = loop {
        // The value only grows, so the last reading is close to the final one.
        peak_bytes = high_water_bytes(&status_file).unwrap_or(peak_bytes);
        if let Some(status) = child.try_wait().map_err(|error| failed(&error))? {
            break status;
        }
        std::thread::sleep(LOOK_EVERY);
    };
    let seconds = started.elapsed().as_secs_f64();
    let text = std::fs::read_to_string(&out).map_err(|error| failed(&error))?;
    // The file was required only for the output.
    let _ = std::fs::remove_file(&out);
    if !status.success() {
        return Err(failed(&status));
    }
    let finding = serde_json::from_str(&text).map_err(|error| failed(&error))?;
    Ok(Needed { seconds, peak_bytes, finding })
}

/// `VmHWM` of a process; `None` of one that has ended.
fn high_water_bytes(status: &Path) -> Option<u64> {
    let text = std::fs::read_to_string(status).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(1024 * kibibytes)
}

/// Makes a recording of each length in turn, runs the program's reconciliation, and deletes it; lengths in hours.
///
/// # Errors
/// A message: a file cannot be written, or the program failed.
pub fn table(program: &Path, folder: &Path, hours: &[f64]) -> Result<Table, String> {
    std::fs::create_dir_all(folder).map_err(|error| format!("cannot make {}: {error}", folder.display()))?;
    let mut table = Table::new(
        "Run time and peak memory of reconcile (suit 60 Hz, plate 250 Hz)",
        &["hours", "file MB", "run time s", "peak MB", "verdict", "named"],
    );
    for (index, hours) in hours.iter().enumerate() {
        let recording = folder.join(format!("long-{index}.mcap"));
        Long::of(3600.0 * hours)
            .write(&recording, 5)
            .map_err(|error| format!("{}: {error}", recording.display()))?;
        let needed = reconcile(program, &recording);
        let file_bytes = std::fs::metadata(&recording).map_or(0, |metadata| metadata.len());
        // A file that cannot be deleted does no harm.
        let _ = std::fs::remove_file(&recording);
        let Needed { seconds, peak_bytes, finding } = needed?;
        let named: Vec<&str> = finding["effects"]
            .as_array()
            .map(|effects| effects.iter().filter_map(|effect| effect["name"].as_str()).collect())
            .unwrap_or_default();
        table.push(vec![
            Cell::Number(*hours),
            Cell::Number(1e-6 * file_bytes as f64),
            Cell::Number(seconds),
            Cell::Number(1e-6 * peak_bytes as f64),
            finding["verdict"].as_str().unwrap_or("-").into(),
            named.join(" + ").as_str().into(),
        ]);
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;
    use equipoise_adapters::recording::{Entry, Recording};

    #[test]
    fn what_comes_again_goes_on_in_time_to_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long.mcap");
        let long = Long { length_s: 420.0, simulated_s: 240.0, every: [4, 10] };
        long.write(&path, 5).unwrap();
        let (mut suit, mut ground) = (Vec::new(), Vec::new());
        for timed in Recording::open(&path).unwrap().entries() {
            match timed.unwrap().entry {
                Entry::Suit(sample) => suit.push((sample.sequence, sample.sample_time_ns)),
                Entry::Ground(sample) => ground.push((sample.sequence, sample.sample_time_ns)),
                _ => {}
            }
        }
        for (samples, rate_hz) in [(suit, 15.0), (ground, 25.0)] {
            let gaps: Vec<f64> = samples
                .windows(2)
                .map(|pair| (pair[1].1 as f64 - pair[0].1 as f64) * 1e-9 * rate_hz)
                .collect();
            assert!(gaps.iter().all(|gap| (0.2..1.8).contains(gap)), "{gaps:?}");
            assert!(samples.windows(2).all(|pair| pair[1].0 == pair[0].0 + 1));
            let length_s = (samples.last().unwrap().1 - EPOCH_NS) as f64 * 1e-9;
            assert!((length_s - 420.0).abs() < 0.2, "{length_s}");
        }
    }
}
