//! Qualisys Track Manager: commands, frames, and reconnection.

use super::{PATIENCE, until};
use equipoise_adapters::ground::device::qtm::{Qtm, QtmSettings};
use equipoise_adapters::ground::{GroundSettings, SensorAxes};
use equipoise_adapters::source::{GroundSource, TcpLine};
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

fn packet(kind: u32, content: &[u8]) -> Vec<u8> {
    [&(content.len() as u32 + 8).to_le_bytes()[..], &kind.to_le_bytes(), content].concat()
}

/// A frame of a plate with ten times the cameras' rate; 700 N downwards.
fn frame(number: u32) -> Vec<u8> {
    let force = [0.0_f32, 0.0, 700.0, 0.0, -70.0, 0.0, 100.0, 0.0, 0.0].map(f32::to_le_bytes).concat();
    let plate = [1_u32, 10, number * 10].map(u32::to_le_bytes).concat();
    let component = packet(4, &[1_u32.to_le_bytes().to_vec(), plate, force.repeat(10)].concat());
    let head =
        [u64::from(number * 10_000).to_le_bytes().to_vec(), [number, 1].map(u32::to_le_bytes).concat()]
            .concat();
    packet(3, &[head, component].concat())
}

/// One received command; `None` after the end of the connection.
fn received(stream: &mut TcpStream) -> Option<String> {
    let mut head = [0; 8];
    stream.read_exact(&mut head).ok()?;
    let mut text = vec![0; u32::from_le_bytes(head[..4].try_into().unwrap()) as usize - 8];
    stream.read_exact(&mut text).unwrap();
    assert_eq!((head[4], text.pop()), (1, Some(0)));
    Some(String::from_utf8(text).unwrap())
}

/// Serves one client with this many frames, divided into pieces; returns the received commands.
fn serve(listener: &TcpListener, frames: u32) -> Vec<String> {
    let (mut stream, _) = listener.accept().unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.write_all(&packet(1, b"QTM RT Interface connected\0")).unwrap();
    let mut words = vec![received(&mut stream).unwrap()];
    stream.write_all(&packet(1, b"Version set to 1.25\0")).unwrap();
    words.push(received(&mut stream).unwrap());
    let bytes: Vec<u8> = (1..=frames).flat_map(frame).collect();
    for piece in bytes.chunks(997) {
        stream.write_all(piece).unwrap();
    }
    // The last command of a client that closes the connection; after a disconnection by the server there is none.
    stream.set_read_timeout(Some(Duration::from_millis(200))).unwrap();
    let mut rest = [0; 8];
    match stream.peek(&mut rest) {
        Ok(1..) => words.extend(received(&mut stream)),
        Ok(0) => {}
        Err(error) => assert!(matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut), "{error}"),
    }
    words
}

#[test]
fn frames_become_samples_and_a_track_manager_that_was_closed_is_found_again() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let line = TcpLine::to(listener.local_addr().unwrap(), "Qualisys' track manager", "ground.address");
    let played = std::thread::spawn(move || {
        let first = serve(&listener, 20);
        // The server hung up; its port stays open for the next connection.
        (first, serve(&listener, 30))
    });
    let mut settings = GroundSettings::default();
    settings.frame.axes = SensorAxes::ZDown;
    let device = Box::new(Qtm::new(QtmSettings { plate: 1, divisor: 1 }));
    let mut source = GroundSource::open(Box::new(line), device, settings).unwrap();
    let samples = until(&mut source, |_, samples| samples.len() >= 200);
    assert_eq!((samples.len(), source.counts().lost), (200, 0));
    for (index, sample) in samples.iter().enumerate() {
        // Load at (0.1, 0) m: the moment about y of the force on the person is -70 N m in axes with z up.
        assert_eq!((sample.force_n, sample.moment_nm), ([0.0, 0.0, 700.0], [0.0, -70.0, 0.0]));
        assert_eq!((sample.device_counter, sample.session), (10 + index as u32, 0));
        assert!(sample.sample_time_ns <= sample.arrival_ns);
    }
    assert_eq!(source.health().block_latency_ns, 10_000_000);
    until(&mut source, |source, _| {
        source.diagnostic().is_some_and(|why| why.contains("closed the connection"))
    });
    let samples = until(&mut source, |_, samples| samples.len() >= 300);
    assert_eq!((samples.last().unwrap().session, source.diagnostic()), (1, None), "its time restarted");
    drop(source);
    let (first, second) = played.join().unwrap();
    assert_eq!(first, ["Version 1.25", "StreamFrames AllFrames Force"]);
    assert_eq!(second, ["Version 1.25", "StreamFrames AllFrames Force", "StreamFrames Stop"]);
}

#[test]
fn an_address_without_a_device_is_reported_and_tried_again() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let line = TcpLine::to(listener.local_addr().unwrap(), "Qualisys' track manager", "ground.address");
    drop(listener);
    let device = Box::new(Qtm::new(QtmSettings { plate: 1, divisor: 1 }));
    let mut source = GroundSource::open(Box::new(line), device, GroundSettings::default()).unwrap();
    assert!(source.diagnostic().unwrap().contains("correct ground.address"));
    assert_eq!(source.receive(&mut Vec::new()).unwrap(), 0);
}
