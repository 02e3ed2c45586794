//! Drives a gateway in a process of its own, with a station that publishes, dies, and returns on another bus.

#[path = "../../../clients/rust/tests/common/mod.rs"]
mod common;

use std::io::{BufRead as _, BufReader};
use std::os::unix::net::UnixDatagram;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::AtomicBool;

use common::{PATIENCE, PERIOD, Root, Station, root};
use crossbeam_channel::{Receiver, unbounded};
use equipoise_bus::root::ROOT_VARIABLE;
use equipoise_gateways::{Gateway, Latest, Tally, drive};

const RATE: &str = "EQUIPOISE_DRIVE_TEST_RATE_HZ";

/// Not a test: body of the station's process.
#[test]
fn child_publishes() {
    common::publish_until_killed();
}

/// Not a test: body of the gateway's process, until it is killed or a time-out passes.
#[test]
fn child_drives() {
    let Some(rate_hz) = std::env::var_os(RATE) else { return };
    let rate_hz = rate_hz.to_str().unwrap().parse().unwrap();
    let stop: &'static AtomicBool = Box::leak(Box::new(AtomicBool::new(false)));
    std::thread::spawn(|| {
        std::thread::sleep(3 * PATIENCE);
        stop.store(true, std::sync::atomic::Ordering::Relaxed);
    });
    drive("test", "gateway", rate_hz, &mut Printer, stop).unwrap();
}

/// Prints a line per tick.
struct Printer;

impl Gateway for Printer {
    fn send(&mut self, latest: &Latest) {
        match latest {
            Ok(reading) => println!(
                "beat {} {} {} {}",
                reading.state.cycle,
                reading.age_ns,
                u8::from(reading.is_new),
                reading.daemon_life
            ),
            Err(reason) => println!("beat {reason}"),
        }
    }

    fn tally(&self) -> Tally {
        Tally::default()
    }
}

/// Contents of a printed line.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Beat {
    cycle: u64,
    age_ns: u64,
    is_new: bool,
    daemon_life: u64,
}

/// A gateway's process, killed with SIGKILL when the test ends.
struct Outside {
    child: Child,
    beats: Receiver<Option<Beat>>,
}

impl Outside {
    fn start(root: &Root, rate_hz: f64, environment: &[(&str, &str)]) -> Outside {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "drive::child_drives", "--nocapture"]).env(RATE, rate_hz.to_string());
        command.env(ROOT_VARIABLE, root.path()).envs(environment.iter().copied()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let (to, beats) = unbounded();
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                // The first line follows output of the test harness.
                let Some((_, fields)) = line.split_once("beat ") else { continue };
                if to.send(read(fields)).is_err() {
                    return;
                }
            }
        });
        Outside { child, beats }
    }

    fn beat(&self) -> Option<Beat> {
        self.beats.recv_timeout(PATIENCE).unwrap()
    }

    fn until<T>(&self, what: &str, ready: impl Fn(Option<Beat>) -> Option<T>) -> T {
        let begun = std::time::Instant::now();
        loop {
            if let Some(value) = ready(self.beat()) {
                return value;
            }
            assert!(begun.elapsed() < PATIENCE, "waited in vain until {what}");
        }
    }
}

impl Drop for Outside {
    fn drop(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

fn read(fields: &str) -> Option<Beat> {
    let numbers: Vec<u64> = fields.split(' ').map_while(|word| word.parse().ok()).collect();
    let &[cycle, age_ns, is_new, daemon_life] = &numbers[..] else { return None };
    Some(Beat { cycle, age_ns, is_new: is_new == 1, daemon_life })
}

#[test]
fn a_bus_that_was_removed_and_made_again_is_found_by_the_gateway() {
    let root = root();
    let gateway = Outside::start(&root, 100.0, &[]);
    let first = Station::start(&root, "drive::child_publishes");
    assert_eq!(gateway.until("a state is published", |beat| beat).daemon_life, 1);
    drop(first);
    gateway.until("silence is published", |beat| beat.is_none().then_some(()));
    root.remove_the_bus();
    let _second = Station::start(&root, "drive::child_publishes");
    assert_eq!(gateway.until("the new bus is found", |beat| beat).daemon_life, 2);
}

#[test]
fn a_tick_rate_above_the_loop_rate_repeats_states_with_a_higher_age() {
    let root = root();
    let _station = Station::start(&root, "drive::child_publishes");
    let gateway = Outside::start(&root, 2.5 / PERIOD.as_secs_f64(), &[]);
    let mut last = gateway.until("a state is published", |beat| beat);
    let (mut new, mut again) = (0, 0);
    while new + again < 1000 {
        // On a busy machine a tick may lack a current state.
        let Some(beat) = gateway.beat() else { continue };
        assert_eq!(beat.is_new, beat.cycle > last.cycle, "{beat:?} after {last:?}");
        if beat.is_new {
            new += 1;
        } else {
            again += 1;
            assert!(beat.cycle == last.cycle && beat.age_ns > last.age_ns, "{beat:?} after {last:?}");
        }
        last = beat;
    }
    assert!(new > 0 && again > 0, "{new} new, {again} repeated");
}

#[test]
fn a_slow_gateway_feeds_the_watchdog_between_its_beats() {
    let root = root();
    let manager = root.path().with_file_name("manager");
    let notifications = UnixDatagram::bind(&manager).unwrap();
    notifications.set_read_timeout(Some(PATIENCE)).unwrap();
    let gateway = Outside::start(&root, 0.01, &[("NOTIFY_SOCKET", manager.to_str().unwrap())]);
    let mut watchdog = 0;
    while watchdog < 3 {
        let mut bytes = [0; 200];
        let count = notifications.recv(&mut bytes).unwrap();
        watchdog += usize::from(bytes[..count].starts_with(b"WATCHDOG=1"));
    }
    assert_eq!(gateway.beats.try_iter().count(), 1, "the next beat is 100 s away");
}
