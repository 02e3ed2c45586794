//! Activity around a daemon other than its consumers: sensors, the page, recorders, commands.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use bytemuck::Zeroable;
use equipoise_bus::{Bus, BusSettings};
use equipoise_core::message::{Command, CommandKind};
use equipoise_simulator::settings::SimulationSettings;
use equipoise_simulator::simulation::{Simulation, SimulationHandle};
use rustix::process::Signal;

use crate::consumers::{must_have_found_no_place, start};
use crate::process::wait_for;

/// Counts of each activity.
#[derive(Debug, Default)]
pub(crate) struct Churn {
    pub(crate) sensor_drops: AtomicU64,
    pub(crate) sensor_restarts: AtomicU64,
    pub(crate) page_loads: AtomicU64,
    /// Recorders that were started; those that recorded; those that found every place occupied by killed processes.
    pub(crate) recorders: AtomicU64,
    pub(crate) recordings: AtomicU64,
    pub(crate) recorders_without_place: AtomicU64,
    pub(crate) commands: AtomicU64,
}

/// A pseudo-random number derived from another.
pub(crate) fn pseudo_random(number: u64) -> u64 {
    let mixed = (number ^ (number >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb) >> 20
}

/// Sleeps, but not past the end.
fn pass(time: Duration, stop: &AtomicBool) {
    let steps = time.as_millis() / 20;
    for _ in 0..steps {
        if stop.load(Ordering::Relaxed) {
            return;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

impl Churn {
    /// Poses, lifts, silences, disconnections.
    pub(crate) fn sensors(&self, suit: SocketAddr, plate: SocketAddr, stop: &AtomicBool) {
        let start = || {
            let mut settings = SimulationSettings::default();
            (settings.suit.target, settings.plate.address) = (suit, plate);
            // The previous plate may still hold the port for a short time.
            wait_for("the simulated person", || Simulation::start(settings.clone()).ok())
        };
        let mut person: SimulationHandle = start();
        for round in 0.. {
            if stop.load(Ordering::Relaxed) {
                break;
            }
            match round % 8 {
                0..=3 => person.take_pose(pseudo_random(round) as usize % 50).expect("a pose of the library"),
                4 => person.lift_and_show(8.0),
                5 => {
                    person.silence_suit(true);
                    pass(Duration::from_millis(400), stop);
                    person.silence_suit(false);
                    self.sensor_drops.fetch_add(1, Ordering::Relaxed);
                }
                6 => {
                    person.silence_plate(true);
                    pass(Duration::from_millis(400), stop);
                    person.silence_plate(false);
                    self.sensor_drops.fetch_add(1, Ordering::Relaxed);
                }
                _ => {
                    person.stop().expect("an orderly end of the simulation");
                    pass(Duration::from_millis(300), stop);
                    person = start();
                    self.sensor_restarts.fetch_add(1, Ordering::Relaxed);
                }
            }
            pass(Duration::from_millis(1800), stop);
        }
        person.stop().expect("an orderly end of the simulation");
    }

    /// Loads the page and its resources, and disconnects during its event stream.
    pub(crate) fn page(&self, page: &SocketAddr, stop: &AtomicBool) {
        let mut bytes = [0; 4096];
        while !stop.load(Ordering::Relaxed) {
            for path in ["/", "/api/state", "/events"] {
                let Ok(mut browser) = TcpStream::connect(page) else { continue };
                let request = format!("GET {path} HTTP/1.1\r\nHost: {page}\r\nConnection: close\r\n\r\n");
                browser.set_read_timeout(Some(Duration::from_secs(5))).expect("a socket");
                if browser.write_all(request.as_bytes()).is_ok()
                    && browser.read(&mut bytes).is_ok_and(|n| n > 0)
                {
                    // 503: after the machine was suspended, the page reports that it receives no data.
                    let answered =
                        [b"HTTP/1.1 200", b"HTTP/1.1 503"].iter().any(|head| bytes.starts_with(*head));
                    assert!(answered, "{}", String::from_utf8_lossy(&bytes));
                    self.page_loads.fetch_add(1, Ordering::Relaxed);
                }
            }
            pass(Duration::from_millis(200), stop);
        }
    }

    /// Records briefly, repeatedly.
    pub(crate) fn recorder(&self, directory: &Path, stop: &AtomicBool) {
        let out = directory.join("recording.mcap");
        let path = out.to_string_lossy();
        while !stop.load(Ordering::Relaxed) {
            let mut recorder = start(directory, "recorder", &["record", &path]);
            wait_for("the recorder", || {
                (recorder.stderr().contains("recording") || !recorder.is_running()).then_some(())
            });
            self.recorders.fetch_add(1, Ordering::Relaxed);
            pass(Duration::from_millis(1000), stop);
            if recorder.is_running() {
                let code = recorder.stop(Signal::TERM);
                // 3: the recorder could not keep up, and reports it.
                assert!(matches!(code, Some(0 | 3)), "{code:?} {}", recorder.stderr());
                self.recordings.fetch_add(1, Ordering::Relaxed);
            } else {
                must_have_found_no_place(&mut recorder);
                self.recorders_without_place.fetch_add(1, Ordering::Relaxed);
            }
            let _ = std::fs::remove_file(&out);
            pass(Duration::from_millis(500), stop);
        }
    }

    /// Requests checkpoints, and at intervals a new identification.
    pub(crate) fn commands(&self, station: &str, stop: &AtomicBool) {
        let bus = Bus::join(&BusSettings::new(station, "commander")).expect("the bus");
        let client = bus.command_client().expect("a client");
        for round in 0_u64.. {
            if stop.load(Ordering::Relaxed) {
                return;
            }
            let kind = match round % 20 {
                19 => CommandKind::IdentifyReset,
                9 => CommandKind::IdentifyStop,
                _ => CommandKind::Checkpoint,
            };
            let command = Command { kind: kind as u32, ..Command::zeroed() };
            client.ask(&command, Duration::from_secs(5)).expect("an answer");
            self.commands.fetch_add(1, Ordering::Relaxed);
            pass(Duration::from_millis(1100), stop);
        }
    }
}
