//! Killed at any instant, the daemon loses at most a second of data, and leaves no unreadable file.
//!
//! `EQUIPOISE_KILLS` is the number of kills, `EQUIPOISE_SEED` determines their times; `.ci/run survive` uses thirty.

use std::collections::HashMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use equipoise_core::message::{Incident, Validity};
use equipoise_daemon::profile::Profile;
use equipoise_daemon::realtime::now_ns;
use equipoise_daemon::station_file::StationFile;
use equipoise_files::atomic_file::write_atomically;
use equipoise_simulator::simulation::SimulationHandle;
use rustix::process::Signal;

use crate::monitor::Monitor;
use crate::process::{Process, wait_for};
use crate::station::{Station, simulate};

/// Maximum loss by a kill, with a disk that writes at once.
const LOSS: Duration = Duration::from_secs(1);
/// Pause after each write of [`Disk`].
const PROBE_INTERVAL: Duration = Duration::from_millis(50);
/// Files that the daemon may write one after another before the newest state is stored.
const WRITES: u32 = 3;
/// From the request of a subject to its states, at most.
const SUBJECT_CHANGE: Duration = Duration::from_millis(300);
/// This much of a light body counts as the empty plate's offset, kg.
const OFFSET_KG: f64 = 5.0;
const WORKER_KG: f64 = 72.0;
const G: f64 = 9.81;

/// Numbers of a seed (splitmix64).
struct Random(u64);

impl Random {
    fn below(&mut self, bound: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed ^ (mixed >> 31)) % bound
    }
}

fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok().map(|text| text.parse().expect("a number"))
}

fn person(station: &Station, mass_kg: f64) -> SimulationHandle {
    let mut settings = station.sensors();
    settings.mass_kg = mass_kg;
    simulate(&settings)
}

/// Numbers of poses published for each subject, and when each was first received.
#[derive(Default)]
struct PoseLog(HashMap<String, Vec<(Instant, u32)>>);

impl PoseLog {
    fn record(&mut self, subject: &str, poses: u32) {
        let all = self.0.entry(subject.to_owned()).or_default();
        if all.last().is_none_or(|(_, last)| poses > *last) {
            all.push((Instant::now(), poses));
        }
    }

    /// The largest number received before an instant.
    fn before(&self, subject: &str, instant: Instant) -> u32 {
        let all = self.0.get(subject).map_or(&[][..], Vec::as_slice);
        all.iter().take_while(|(at, _)| *at < instant).map(|(_, poses)| *poses).last().unwrap_or(0)
    }
}

/// Checks that every file is readable; leftovers of an interrupted write end in `.new` and are ignored.
fn read_all_files(folder: &Path) -> usize {
    let mut read = 0;
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            read += read_all_files(&path);
        } else if path.extension().is_some_and(|extension| extension == "toml") {
            let parent = path.parent().and_then(Path::file_name).expect("a folder");
            if parent == "stations" {
                StationFile::read(&path).expect("a whole file").expect("a file");
            } else {
                Profile::read(&path).expect("a whole file").expect("a file");
            }
            read += 1;
        } else if path.extension().is_some_and(|extension| extension == "mcap") {
            // A flight record: on a busy machine deadlines are missed occasionally.
            let recording = equipoise_adapters::recording::Recording::open(&path).expect("a whole record");
            assert!(!recording.truncated(), "{}", path.display());
        } else {
            // A file that was being written, or the lock of a killed daemon.
            let is_leftover =
                path.extension().is_some_and(|extension| extension == "new" || extension == "lock");
            assert!(is_leftover, "{}", path.display());
        }
    }
    read
}

fn active_subject(station: &Station) -> String {
    let status = station.current_status();
    status["daemon"]["subject"].as_str().expect("a subject").to_owned()
}

/// Begin and, once the next iteration begins, end of each write.
type Writes = Arc<Mutex<Vec<(Instant, Option<Instant>)>>>;

/// Writes a small file durably again and again, next to those of the daemon, and keeps the time that each iteration took:
/// the disk's delay, and that of a thread that waits for a core.
struct Disk {
    writes: Writes,
    ends: Arc<AtomicBool>,
}

impl Disk {
    fn of(directory: &Path) -> Disk {
        let disk = Disk { writes: Arc::default(), ends: Arc::default() };
        let (writes, ends, path) =
            (Arc::clone(&disk.writes), Arc::clone(&disk.ends), directory.join("probe"));
        std::thread::spawn(move || {
            while !ends.load(Ordering::Relaxed) {
                writes.lock().expect("no panic").push((Instant::now(), None));
                if write_atomically(&path, b"probe").is_err() {
                    break;
                }
                std::thread::sleep(PROBE_INTERVAL);
                if let Some((_, end)) = writes.lock().expect("no panic").last_mut() {
                    *end = Some(Instant::now());
                }
            }
        });
        disk
    }

    /// Longest iteration, less its pause, that was in progress during the `length` before an instant; unfinished ones
    /// count until it.
    fn slowest(&self, before: Instant, length: Duration) -> Duration {
        let writes = self.writes.lock().expect("no panic");
        let ended = |end: &Option<Instant>| end.map_or(before, |end| end.min(before));
        let recent = writes.iter().filter(|(start, end)| *start < before && ended(end) + length > before);
        let slowest = recent.map(|(start, end)| ended(end) - *start).max().unwrap_or_default();
        slowest.saturating_sub(PROBE_INTERVAL)
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
    }
}

struct Fixture<'a> {
    station: &'a Station,
    person: SimulationHandle,
    disk: Disk,
    monitor: Monitor,
    random: Random,
    poses_seen: PoseLog,
    in_use: String,
    /// Previous subject, and time of the change.
    before: Option<(String, Instant)>,
    pose: usize,
    posed: Instant,
}

impl Fixture<'_> {
    /// The worker moves from pose to pose, while the daemon receives commands, until a random instant.
    fn work(&mut self) {
        let until = Instant::now() + Duration::from_millis(200 + self.random.below(2300));
        let mut command = Instant::now() + Duration::from_millis(self.random.below(1500));
        while Instant::now() < until {
            let poses = self.monitor.update().poses_used;
            let since_load = self.before.as_ref().is_none_or(|(_, at)| at.elapsed() > SUBJECT_CHANGE);
            if since_load && self.monitor.both_fresh() {
                let had = self.poses_seen.before(&self.in_use, Instant::now());
                self.poses_seen.record(&self.in_use, poses);
                if poses > had || self.posed.elapsed() > Duration::from_secs(4) {
                    self.pose += 1;
                    self.posed = Instant::now();
                    self.person.take_pose(self.pose % 12).expect("a pose of the library");
                }
            }
            if Instant::now() > command {
                command = until;
                self.command();
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Works until one more pose was used and is on disk.
    fn take_a_pose(&mut self) {
        // The first states after a change of the subject are those of the previous one.
        std::thread::sleep(SUBJECT_CHANGE);
        let poses = self.monitor.until("both sensors", Monitor::both_fresh).poses_used;
        self.monitor.until_poses(&self.person, poses + 1);
        self.poses_seen.record(&self.in_use, self.monitor.state.poses_used);
        let path = self.station.profile(&self.in_use);
        let saved = || Profile::read(&path).expect("a profile");
        wait_for("the pose on disk", || saved().filter(|profile| profile.poses_used > u64::from(poses)));
    }

    fn command(&mut self) {
        match self.random.below(3) {
            0 => drop(self.station.run(&["subject", "save"])),
            // A person stands there, or the plate is silent for a short time on a busy machine.
            1 => self.station.run(&["tare"]).assert_failed(1, &["refused"]),
            _ => {
                let other = if self.in_use == "anon-1" { "anon-2" } else { "anon-1" };
                let requested = Instant::now();
                self.station.run(&["subject", "load", other]).assert_done();
                self.before = Some((std::mem::replace(&mut self.in_use, other.to_owned()), requested));
            }
        }
    }

    /// Compares the state of a restarted daemon with the states received before.
    fn compare(&mut self, killed: Instant, killed_ns: u64) {
        let found = active_subject(self.station);
        let slowest = self.disk.slowest(killed, 3 * LOSS);
        println!("slowest write before the kill: {slowest:?}");
        let loss = LOSS + WRITES * slowest;
        if found != self.in_use {
            let (before, requested) = self.before.take().expect("no other subject was in use");
            assert!(found == before && killed - requested < loss, "{found} in place of {}", self.in_use);
            self.in_use = found;
        }
        self.before = None;
        let bound = self.poses_seen.before(&self.in_use, killed - loss);
        // A force that may not be used is published as zero, which says nothing about the tare.
        let state = self.monitor.until("states of the new daemon", |monitor| {
            let measured = monitor.both_fresh() && !monitor.has(Validity::INVALIDATES_GROUND_FORCE);
            monitor.state.time_ns > killed_ns && measured
        });
        assert!(state.poses_used >= bound, "{} of {bound} poses of {}", state.poses_used, self.in_use);
        let faults = self.monitor.count(Incident::GroundImplausible);
        assert_eq!(faults, 0, "the first samples after the start count as a fault of the plate");
        let offset_n = state.ground_force_n[2] - WORKER_KG * G;
        assert!(offset_n.abs() < 0.5 * OFFSET_KG * G, "the tare is lost: {offset_n} N");
        // Reference for the following comparisons.
        self.poses_seen.0.insert(self.in_use.clone(), vec![(Instant::now(), state.poses_used)]);
    }
}

fn tared(station: &Station) -> Process {
    let daemon = station.daemon(&station.configuration());
    let light = person(station, OFFSET_KG);
    let mut monitor = Monitor::open(station);
    monitor.until("the plate", |monitor| {
        monitor.both_fresh() && monitor.state.ground_force_n[2] > 0.5 * OFFSET_KG * G
    });
    monitor.until_tared(station, 0.2 * OFFSET_KG * G);
    light.stop().expect("an orderly end");
    daemon
}

#[test]
fn a_kill_at_any_instant_loses_at_most_a_second() {
    let seed = number("EQUIPOISE_SEED").unwrap_or_else(|| u64::from(std::process::id()));
    let kills = number("EQUIPOISE_KILLS").unwrap_or(6);
    println!("EQUIPOISE_SEED={seed} EQUIPOISE_KILLS={kills}");
    let station = Station::new();
    let mut daemon = tared(&station);
    let person = person(&station, WORKER_KG + OFFSET_KG);
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 1);
    let saved = |subject: &str| Profile::read(&station.profile(subject)).expect("a profile");
    wait_for("a profile", || saved("anon-1").filter(|profile| profile.poses_used > 0));
    station.copy_profile("anon-1", "anon-2", |_| {});

    let mut fixture = Fixture {
        station: &station,
        person,
        disk: Disk::of(&station.file("probes")),
        monitor,
        random: Random(seed),
        poses_seen: PoseLog::default(),
        in_use: "anon-1".to_owned(),
        before: None,
        pose: 1,
        posed: Instant::now(),
    };
    for kill in 0..kills {
        if kill == kills / 2 {
            // On a busy machine masked states interrupt the holds: without waiting, no kill may follow a new pose.
            fixture.take_a_pose();
        }
        fixture.work();
        let killed = Instant::now();
        daemon.kill();
        let killed_ns = now_ns();
        // Receives pending messages of the bus.
        fixture.monitor.update();
        assert!(read_all_files(&station.state_directory()) >= 3);
        daemon = station.daemon(&station.configuration());
        fixture.compare(killed, killed_ns);
        let message = daemon.stderr();
        for part in
            ["is in use: ", "the shift goes on", "the tare of", "the position of the suit's world is "]
        {
            assert!(message.contains(part), "{part:?} is not in {message}");
        }
        // Not restored if a busy machine has kept the worker out of sight for too long.
        let restored = message.contains("the position of the suit's world is restored");
        assert!(restored || message.contains("the worker was last seen"), "{message}");
        println!("kill {kill}: {} has {} poses", fixture.in_use, fixture.monitor.state.poses_used);
    }
    // Operation continues, with the shift, from pose to pose.
    let Fixture { mut monitor, person, .. } = fixture;
    let before = monitor.state.poses_used;
    monitor.until_poses(&person, before + 1);
    let poses = ["anon-1", "anon-2"].iter().filter_map(|subject| Some(saved(subject)?.poses_used)).max();
    assert!(poses >= Some(2), "hardly a pose was taken between the kills");
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
    assert!(read_all_files(&station.state_directory()) >= 3);
}

#[test]
fn a_pipe_instead_of_the_station_file_does_not_block_the_start() {
    let station = Station::new();
    let path = station.state_directory().join("stations").join("bench.toml");
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
    assert!(std::process::Command::new("mkfifo").arg(&path).status().expect("mkfifo").success());
    let _person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    Monitor::open(&station).until("cycles", |monitor| monitor.state.cycle > 100);
    let message = daemon.stderr();
    assert!(message.contains("bench.toml") && message.contains("no regular file"), "{message}");
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
}

#[test]
fn a_station_file_of_400_mb_is_reported_and_left_unchanged() {
    let station = Station::new();
    let path = station.state_directory().join("stations").join("bench.toml");
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
    // Without data, so that it takes no space on the disk.
    let file = std::fs::File::create(&path).expect("a file");
    file.set_len(400_000_000).expect("a sparse file");
    let _person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    Monitor::open(&station).until("cycles", |monitor| monitor.state.cycle > 100);
    let message = daemon.stderr();
    assert!(message.contains("bench.toml") && message.contains("longer than 1048576 bytes"), "{message}");
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
    assert_eq!(file.metadata().expect("the file").len(), 400_000_000);
    assert!(path.exists());
}

#[test]
fn a_station_s_file_of_a_later_version_is_reported_and_left_unchanged() {
    let station = Station::new();
    let path = station.state_directory().join("stations").join("bench.toml");
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
    let later = "format = 99\nsomething = \"new\"\n";
    std::fs::write(&path, later).expect("a file");
    let person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let message = daemon.stderr();
    assert!(
        message.contains("bench.toml") && message.contains("its format is 99") && message.contains("WARN"),
        "{message}"
    );
    // Which subject was in use is unknown: the configured one is not assumed.
    assert!(message.contains("so the subject in use is unknown"), "{message}");
    Monitor::open(&station).until_poses(&person, 1);
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
    assert!(!station.profile("anon-1").exists());
    assert_eq!(std::fs::read_to_string(&path).expect("the file"), later);
}
