//! The sources over real sockets on loopback, against a simulated suit and device.

use equipoise_adapters::ground::GroundSettings;
use equipoise_adapters::ground::device::ati_rdt::{AtiRdt, RdtSettings};
use equipoise_adapters::source::udp::Senders;
use equipoise_adapters::source::{GroundSource, MvnSettings, SuitSource, Transport, UdpLine};
use equipoise_adapters::suit::{SuitRefusal, TypeSet};
use equipoise_adapters::wire::ati_rdt::{Command, Record, Request};
use equipoise_adapters::wire::mvn::{Header, SegmentPose, pose_quaternion};
use std::net::UdpSocket;
use std::time::{Duration, Instant};

use super::{assert_memory_bounded, repeat_after_stall};

/// Long enough for a loaded machine; no test here measures speed.
const PATIENCE: Duration = Duration::from_secs(90);

#[test]
fn a_suit_on_the_wire_becomes_samples() {
    let mut source =
        SuitSource::open(&MvnSettings { listen: "127.0.0.1:0".parse().unwrap(), ..MvnSettings::default() })
            .unwrap();
    let suit = UdpSocket::bind("127.0.0.1:0").unwrap();
    let poses: Vec<_> = (1..=23)
        .map(|segment_id| SegmentPose {
            segment_id,
            position_m: [0.0, 0.0, if segment_id == 7 { 1.6 } else { 0.1 }],
            orientation_wxyz: [1.0, 0.0, 0.0, 0.0],
        })
        .collect();
    let mut bytes = Vec::new();
    let mut counters = Vec::new();
    for counter in 0..20 {
        pose_quaternion::encode(&Header::new(counter, counter * 4, 0), &poses, &mut bytes).unwrap();
        suit.send_to(&bytes, source.local_address()).unwrap();
        suit.send_to(b"noise", source.local_address()).unwrap();
        while counters.len() < counter as usize {
            let Some(sample) = source.receive().unwrap() else { break };
            assert!(sample.sample_time_ns <= sample.arrival_ns && sample.arrival_ns > 0);
            counters.push(sample.device_counter);
        }
    }
    while let Some(sample) = source.receive().unwrap() {
        counters.push(sample.device_counter);
    }
    assert_eq!(counters, (0..20).collect::<Vec<_>>());
    let health = source.health();
    assert_eq!((health.stream, health.received, health.published, health.lost), (1, 40, 20, 0));
    assert_eq!(health.refused[0], 20, "noise is too short");
}

#[test]
fn a_stray_byte_from_elsewhere_does_not_lock_the_suit_out() {
    repeat_after_stall(assert_stray_byte_is_refused);
}

fn assert_stray_byte_is_refused() {
    let mut settings = MvnSettings { listen: "127.0.0.1:0".parse().unwrap(), ..MvnSettings::default() };
    settings.suit.required = Some(TypeSet::POSE_QUATERNION);
    let mut source = SuitSource::open(&settings).unwrap();
    let [suit, stray] = ["127.0.0.1:0", "127.0.0.2:0"].map(|address| UdpSocket::bind(address).unwrap());
    let poses: Vec<_> = (1..=23)
        .map(|segment_id| SegmentPose {
            segment_id,
            position_m: [0.0, 0.0, if segment_id == 7 { 1.6 } else { 0.1 }],
            orientation_wxyz: [1.0, 0.0, 0.0, 0.0],
        })
        .collect();
    let (mut bytes, mut counters, begun) = (Vec::new(), Vec::new(), Instant::now());
    for counter in 0..10 {
        stray.send_to(b"x", source.local_address()).unwrap();
        pose_quaternion::encode(&Header::new(counter, counter * 4, 0), &poses, &mut bytes).unwrap();
        suit.send_to(&bytes, source.local_address()).unwrap();
        while counters.len() <= counter as usize && begun.elapsed() < PATIENCE {
            counters.extend(source.receive().unwrap().map(|sample| sample.device_counter));
        }
    }
    assert_eq!(counters, (0..10).collect::<Vec<_>>());
    let refused = |refusal: SuitRefusal| source.counts().refused[refusal.index()];
    assert_eq!(
        (refused(SuitRefusal::ForeignSender), source.counts().refused[0]),
        (9, 1),
        "the first was read"
    );
    assert_memory_bounded();
}

#[test]
fn a_port_that_is_listened_to_is_held_by_what_was_accepted() {
    repeat_after_stall(assert_port_is_held);
}

fn assert_port_is_held() {
    let mut line = UdpLine::listening("127.0.0.1:0".parse().unwrap(), Senders::Loopback, "ground.listen");
    line.open().unwrap();
    let address = line.local_address().unwrap();
    let [device, stray] = ["127.0.0.1:0", "127.0.0.2:0"].map(|address| UdpSocket::bind(address).unwrap());
    let mut sent = |socket: &UdpSocket, is_sample: bool| {
        socket.send_to(b"x", address).unwrap();
        let begun = Instant::now();
        while begun.elapsed() < PATIENCE {
            if let Some(incoming) = line.receive().unwrap() {
                let admitted = incoming.admitted;
                if is_sample {
                    line.accepted();
                }
                return admitted;
            }
        }
        panic!("nothing came");
    };
    assert!(sent(&stray, false) && sent(&device, false), "no sender holds it yet");
    assert!(sent(&device, true) && !sent(&stray, true) && sent(&device, false));
    assert_memory_bounded();
}

/// A device that answers only the second request, streams, and ends at the stop request.
fn device(socket: &UdpSocket) -> Vec<Command> {
    let mut commands = Vec::new();
    let mut client = None;
    let mut record = Record {
        rdt_sequence: 0,
        ft_sequence: 500,
        status: 0,
        force_counts: [0, 0, -700_000_000],
        torque_counts: [0; 3],
    };
    let mut bytes = [0; 64];
    socket.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
    let began = Instant::now();
    while began.elapsed() < PATIENCE {
        if let Ok((length, sender)) = socket.recv_from(&mut bytes) {
            let request = Request::parse(&bytes[..length]).unwrap();
            commands.push(request.command);
            match request.command {
                Command::Stop => return commands,
                // The first request is lost in transit.
                _ if commands.len() > 1 => client = Some(sender),
                _ => {}
            }
        }
        if let Some(client) = client {
            record.rdt_sequence += 1;
            record.ft_sequence += 1;
            socket.send_to(&record.to_bytes(), client).unwrap();
        }
    }
    commands
}

#[test]
fn a_plate_is_requested_until_it_streams_and_then_stopped() {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = socket.local_addr().unwrap();
    let played = std::thread::spawn(move || device(&socket));
    let device = Box::new(AtiRdt::new(RdtSettings::default()));
    let line = Box::new(UdpLine::to(address, "ground.address"));
    let mut source = GroundSource::open(line, device, GroundSettings::default()).unwrap();
    let mut samples = Vec::new();
    let began = Instant::now();
    while samples.len() < 50 && began.elapsed() < PATIENCE {
        source.receive(&mut samples).unwrap();
    }
    assert!(samples.len() >= 50, "{:?}", source.counts());
    // A full socket buffer behind a busy core may lose records.
    assert!(samples.windows(2).all(|pair| pair[0].device_counter < pair[1].device_counter), "{samples:?}");
    for sample in &samples {
        assert_eq!(sample.force_n, [0.0, 0.0, 700.0]);
        assert!(sample.device_counter > 500);
        assert!(sample.sample_time_ns <= sample.arrival_ns);
    }
    assert_eq!(source.health().stream, 2);
    drop(source);
    let commands = played.join().unwrap();
    assert!(commands.len() >= 3, "{commands:?}");
    assert_eq!(commands.first(), Some(&Command::StartRealTime));
    assert_eq!(commands.last(), Some(&Command::Stop));
}
