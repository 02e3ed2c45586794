//! A sensor on a serial line that is absent, appears, is disconnected, is opened by another process, or has another
//! baud rate.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use equipoise_core::message::{Incident, Validity};
use equipoise_simulator::devices::Device as _;
use equipoise_simulator::devices::bota::Bota;
use equipoise_simulator::devices::line::Line;
use equipoise_simulator::devices::load::{Ground, Mounting, OnFeet};
use equipoise_simulator::devices::running::{Pace, Running};
use equipoise_simulator::devices::serial::SerialPort;
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::person::Person;
use nalgebra::Vector2;

use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::Station;
use crate::streams;

/// Baud rate of the simulated sensor.
const SPEED: u32 = 460_800;

/// A station whose ground device is a sensor on a line.
fn configuration(station: &Station, port: &Path, baud: u32) -> String {
    let udp = format!(
        "source = \"ati-rdt\"\naddress = \"{}\"\ncounts_per_newton = 1000000\ncounts_per_newton_metre = 1000000\n",
        station.plate
    );
    let line = format!("source = \"bota-serial\"\n[ground.serial]\nport = {port:?}\nbaud = {baud}\n");
    let text = station.configuration();
    assert!(text.contains(&udp), "{text}");
    text.replace(&udp, &line)
}

/// Connects a sensor under this name, with a person standing on it.
fn plugged(port: &Path) -> Running {
    let worker = Worker::with_habits(Person::new(7, 1.77, 72.0), 7, Habits::ORDINARY);
    // A person without any motion would be detected as a frozen plate.
    let standing = move |time_s: f64| OnFeet::of(&worker, time_s, [Vector2::new(0.05, 0.0); 2]);
    let line = Line::new(Box::new(SerialPort::new(port, SPEED).expect("a pseudo terminal")), 1);
    let device = Bota::new(line, Mounting::default());
    assert!(device.config().contains("bota-serial"));
    let pace = Pace { start_ns: equipoise_simulator::clock::monotonic_ns(), ..Pace::default() };
    let ground = Ground::One(Mounting::default());
    Running::start(Box::new(device), ground, Arc::new(standing), pace).expect("a thread")
}

fn port(station: &Station) -> PathBuf {
    station.file("plate")
}

#[test]
fn a_daemon_runs_without_its_sensor_and_uses_it_once_plugged_in() {
    let station = Station::new();
    let port = port(&station);
    let _suit = streams::suit(station.suit);
    let daemon = station.daemon(&configuration(&station, &port, SPEED));
    let mut monitor = Monitor::open(&station);
    monitor.until("cycles", |monitor| monitor.state.cycle > 10);
    monitor.until("word of the missing port", |monitor| monitor.is_active(Incident::GroundAdapterDown));
    let message = format!("the serial port {} is not there", port.display());
    wait_for("the journal's line", || daemon.stderr().contains(&message).then_some(()));
    let status = station.run_until(&message, &["status"], |ended| ended.stdout.contains(&message));
    let remedy = "plug it in, or set ground.serial.port";
    assert!(status.assert_done().contains(remedy), "{}", status.stdout);

    let sensor = plugged(&port);
    for _ in 0..2 {
        monitor.until("both sensors", |monitor| {
            monitor.both_fresh() && !monitor.is_active(Incident::GroundAdapterDown)
        });
        monitor.until("a centre of pressure", |monitor| !monitor.has(Validity::INVALIDATES_COP_MEASURED));
        sensor.plug(false);
        monitor.until("its absence", |monitor| {
            monitor.has(Validity::GROUND_STALE) && monitor.is_active(Incident::GroundAdapterDown)
        });
        sensor.plug(true);
    }
    monitor.until("both sensors", Monitor::both_fresh);
    assert!(monitor.count(Incident::GroundAdapterDown) >= 3, "{}", daemon.stderr());
    assert!(daemon.stderr().contains("it was unplugged"), "{}", daemon.stderr());
}

#[test]
fn a_wrong_speed_is_reported_by_all_interfaces_without_stopping() {
    let station = Station::new();
    let port = port(&station);
    let _sensor = plugged(&port);
    let mut daemon = station.daemon(&configuration(&station, &port, 115_200));
    let mut monitor = Monitor::open(&station);
    monitor.until("word of the speed", |monitor| monitor.is_active(Incident::GroundAdapterDown));
    let message =
        "none of the last 740 make a frame of a Bota sensor: is the line's speed right? It is 115200 baud";
    wait_for("word of the speed", || daemon.stderr().contains(message).then_some(()));
    wait_for("the remedy in the status", || {
        let status = station.run(&["status"]).assert_done().to_owned();
        status.contains("usually has 460800 ([ground.serial] baud)").then_some(())
    });
    assert!(daemon.is_running() && monitor.has(Validity::GROUND_STALE));
}

#[test]
fn a_port_of_another_program_is_reported_and_used_once_free() {
    let station = Station::new();
    let port = port(&station);
    let _sensor = plugged(&port);
    // Without a child process: the program that holds the port is the one started here.
    let other = Command::new("flock").arg("--no-fork").arg(&port).args(["sleep", "600"]).spawn();
    let other = OtherProgram(other.expect("flock of util-linux"));
    let real = std::fs::canonicalize(&port).expect("a terminal");
    wait_for("the other program to have it", || {
        let links = std::fs::read_dir(format!("/proc/{}/fd", other.0.id())).ok()?;
        links.flatten().any(|link| std::fs::read_link(link.path()).is_ok_and(|to| to == real)).then_some(())
    });
    let daemon = station.daemon(&configuration(&station, &port, SPEED));
    let mut monitor = Monitor::open(&station);
    monitor.until("word of the other program", |monitor| monitor.is_active(Incident::GroundAdapterDown));
    let message = format!("cannot be used: process {}", other.0.id());
    wait_for("the journal's line", || daemon.stderr().contains(&message).then_some(()));
    drop(other);
    monitor.until("the port", |monitor| !monitor.is_active(Incident::GroundAdapterDown));
    monitor.until("samples", |monitor| !monitor.has(Validity::GROUND_STALE));
}

/// Another program, ended with the test.
struct OtherProgram(std::process::Child);

impl Drop for OtherProgram {
    fn drop(&mut self) {
        let ended = self.0.kill().and_then(|()| self.0.wait());
        assert!(ended.is_ok() || std::thread::panicking(), "{ended:?}");
    }
}
