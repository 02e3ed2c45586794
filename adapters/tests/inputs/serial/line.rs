//! The line itself: open, in use, forbidden, missing, unplugged and plugged in again.

use super::pty::{Device, Socket};
use equipoise_adapters::source::{Flow, LineSettings, SerialLine, Transport};
use std::path::PathBuf;

fn line(port: PathBuf) -> SerialLine {
    SerialLine::new(LineSettings { port, baud: 57_600, flow: Flow::Free, key: "ground.serial.port" })
}

/// Reads until no more data arrive.
fn all(line: &mut SerialLine) -> Vec<u8> {
    let mut bytes = Vec::new();
    while let Some(incoming) = line.receive().unwrap() {
        assert!(incoming.admitted);
        bytes.extend_from_slice(incoming.bytes);
    }
    bytes
}

fn open(socket: &Socket) -> (Device, SerialLine) {
    let device = socket.plug();
    let mut line = line(socket.port());
    line.open().unwrap();
    (device, line)
}

#[test]
fn every_byte_comes_through_both_ways_as_it_was_sent() {
    let socket = Socket::new();
    let (device, mut line) = open(&socket);
    assert!(line.receive().unwrap().is_none(), "silence is no fault");
    let every: Vec<u8> = (0..=255).collect();
    device.say(&every);
    assert_eq!(all(&mut line), every, "no line end, no control character is meant");
    line.send(&every).unwrap();
    let mut received = Vec::new();
    while received.len() < every.len() {
        received.extend_from_slice(&device.received());
    }
    assert_eq!(received, every);
    assert!(line.receive().unwrap().is_none(), "and nothing is echoed");
}

#[test]
fn a_change_of_the_baud_rate_discards_the_received_bytes() {
    let socket = Socket::new();
    let (device, mut line) = open(&socket);
    assert_eq!(device.speed(), 57_600);
    device.say(b"noise of the other speed");
    line.set_speed(115_200).unwrap();
    assert_eq!(device.speed(), 115_200);
    device.say(b"after");
    assert_eq!(all(&mut line), b"after");
    // A non-standard speed.
    line.set_speed(250_000).unwrap();
    assert_eq!(device.speed(), 250_000);
    line.open().unwrap();
    assert_eq!(device.speed(), 57_600, "opened again, it is as configured");
}

#[test]
fn a_port_that_is_not_there_is_named_with_what_to_do_and_works_once_it_is() {
    let socket = Socket::new();
    let mut line = line(socket.port());
    let refused = line.open().unwrap_err();
    assert!(refused.may_recover());
    let said = refused.to_string();
    let port = socket.port().display().to_string();
    assert!(said.starts_with(&format!("the serial port {port} is not there: No such file")), "{said}");
    assert!(said.contains("plug it in, or set ground.serial.port: "), "{said}");
    assert!(line.send(b"x").is_err() && line.receive().is_err(), "nothing goes over a closed line");
    let device = socket.plug();
    line.open().unwrap();
    device.say(b"x");
    assert_eq!(all(&mut line), b"x");
}

#[test]
fn a_device_that_is_unplugged_is_missed_at_once_and_found_again_under_its_name() {
    let socket = Socket::new();
    let (device, mut line) = open(&socket);
    device.say(b"last");
    device.unplug();
    // Data in transit may still be read, or be lost with the device; then the line fails permanently.
    let gone = (0..100).find_map(|_| line.receive().err()).expect("that it is gone");
    assert!(gone.may_recover(), "{gone}");
    assert!(gone.to_string().contains("it was unplugged"), "{gone}");
    assert!(line.open().is_err());
    let device = socket.plug();
    line.open().unwrap();
    device.say(b"again");
    assert_eq!(all(&mut line), b"again");
}

#[test]
fn a_port_that_somebody_has_is_busy_and_free_once_they_let_go() {
    let socket = Socket::new();
    let (device, first) = open(&socket);
    let mut second = line(socket.port());
    let refused = second.open().unwrap_err();
    assert!(refused.may_recover());
    let said = refused.to_string();
    assert!(said.contains("cannot be used: this very process") && said.contains("close that"), "{said}");
    drop(first);
    second.open().unwrap();
    device.say(b"mine");
    assert_eq!(all(&mut second), b"mine");
}

#[test]
fn what_is_no_serial_port_is_refused_for_good() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("notes.txt");
    std::fs::write(&file, "").unwrap();
    for path in [file, PathBuf::from("/dev/null")] {
        let refused = line(path).open().unwrap_err();
        assert!(!refused.may_recover(), "{refused}");
        assert!(refused.to_string().contains("is no serial port; set ground.serial.port"), "{refused}");
    }
}
