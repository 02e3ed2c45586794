//! `simulate`: a recorded motion from a CSV, and arguments out of range.

use std::fmt::Write;

use equipoise_core::body::Segment;
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::noise::{Suit, SuitNoise};
use equipoise_simulator::person::Person;
use equipoise_simulator::suit_sender::{Streams, SuitWorld, frame};

use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::Station;

const RATE_HZ: f64 = 60.0;
/// Rows of a motion that is still played when a busy machine looks for it: 15 s.
const ROWS: u32 = 900;

/// CSV rows of a standing person, in the accepted layout; every row in `broken` has no number for Fz.
fn csv(rows: u32, broken: &[u32]) -> String {
    let worker = Worker::with_habits(Person::nominal(1.77, 72.0), 1, Habits::NONE);
    let suit = Suit::new(SuitNoise::ORDINARY, 1);
    let streams = Streams::NONE;
    let mut text = String::from("t_s");
    for segment in Segment::ALL {
        for column in ["px_m", "py_m", "pz_m", "qw", "qx", "qy", "qz"] {
            write!(text, ",{}_{column}", segment.name()).expect("text");
        }
    }
    text.push_str(",Fx_N,Fy_N,Fz_N,Mx_Nm,My_Nm,Mz_Nm\n");
    for number in 0..rows {
        let frame = frame(&worker, &suit, SuitWorld::default(), streams, 0, (number, RATE_HZ));
        write!(text, "{}", f64::from(number) / RATE_HZ).expect("text");
        for (position, orientation) in frame.position_m.iter().zip(&frame.orientation_wxyz) {
            for value in position.iter().chain(orientation) {
                write!(text, ",{value}").expect("text");
            }
        }
        let fz = if broken.contains(&number) { "heavy" } else { "706.3" };
        writeln!(text, ",0,0,{fz},0,0,0").expect("text");
    }
    text
}

#[test]
fn a_recorded_motion_is_played_to_a_daemon() {
    let station = Station::new();
    let _daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    let path = station.write("motion.csv", &csv(ROWS, &[])).display().to_string();
    let (suit, plate) = (station.suit.to_string(), station.plate.to_string());
    let mut player = station.spawn(&["simulate", "--play", &path, "--suit", &suit, "--plate", &plate]);
    monitor.until("both sensors", Monitor::both_fresh);
    monitor.until("the recorded weight", |monitor| (monitor.state.ground_force_n[2] - 706.3).abs() < 0.01);
    assert_eq!(player.wait().code(), Some(0), "{}", player.stderr());
    let message = player.stdout();
    let played = format!("played {ROWS} suit samples and {ROWS} plate samples; 0 rows were rejected");
    assert!(message.contains(&played), "{message}");
    monitor.until("silence after the end", |monitor| !monitor.both_fresh());
}

#[test]
fn rejected_rows_are_counted_and_set_the_exit_code() {
    let station = Station::new();
    let _daemon = station.daemon(&station.configuration());
    let path = station.write("motion.csv", &csv(30, &[7, 11])).display().to_string();
    let (suit, plate) = (station.suit.to_string(), station.plate.to_string());
    let ended = station.run(&["simulate", "--play", &path, "--suit", &suit, "--plate", &plate]);
    assert_eq!(ended.code, Some(3), "{}{}", ended.stdout, ended.stderr);
    assert!(ended.stdout.contains("2 rows were rejected"), "{}", ended.stdout);
}

#[test]
fn invalid_simulations_and_recordings_are_refused() {
    let station = Station::new();
    for (option, value, range) in [
        ("--height-m", "3", "--height-m 3 is not between 1.2 and 2.2"),
        ("--mass-kg", "1e9", "is not between 30 and 200"),
        ("--mass-kg", "NaN", "is not between 30 and 200"),
        ("--suit-rate-hz", "0", "is not between 10 and 1000"),
    ] {
        let argument = format!("{option}={value}");
        station.run(&["simulate", &argument]).assert_failed(1, &[range]);
    }
    for seconds in ["-1", "0", "NaN", "inf"] {
        for command in ["simulate", "watch", "latency"] {
            let ended = station.run(&[command, &format!("--for={seconds}")]);
            ended.assert_failed(2, &["--for", "a number of seconds above 0"]);
        }
    }
    station.run(&["simulate", "--play", "/nowhere.csv"]).assert_failed(1, &["cannot read /nowhere.csv"]);
    let path = station.write("other.csv", &csv(3, &[]).replace("Head_qw", "head_qw")).display().to_string();
    station.run(&["simulate", "--play", &path]).assert_failed(1, &["no column Head_qw", "head_qw"]);
    let path = station.write("empty.csv", &csv(0, &[])).display().to_string();
    station.run(&["simulate", "--play", &path]).assert_failed(1, &["empty.csv", "no rows"]);

    // Another process holds the plate's port, for example the simulation of another station.
    let occupied = std::net::UdpSocket::bind(station.plate).expect("the port");
    let plate = occupied.local_addr().expect("its address").to_string();
    let path = station.write("motion.csv", &csv(30, &[])).display().to_string();
    for arguments in [&["simulate", "--plate", &plate][..], &["simulate", "--plate", &plate, "--play", &path]]
    {
        station.run(arguments).assert_failed(1, &[&format!("the plate at {plate}"), "in use"]);
    }
}

#[test]
fn a_simulation_ends_after_its_time_and_on_a_signal() {
    let station = Station::new();
    let (suit, plate) = (station.suit.to_string(), station.plate.to_string());
    station.run(&["simulate", "--suit", &suit, "--plate", &plate, "--for", "1"]).assert_done();
    let mut endless = station.spawn(&["simulate", "--suit", &suit, "--plate", &plate]);
    wait_for("it to begin", || endless.stdout().contains("Ctrl-C ends").then_some(()));
    assert_eq!(endless.stop(rustix::process::Signal::INT), Some(0), "{}", endless.stderr());
}
