//! The suit over TCP, on real sockets: portions, damage, text, reconnects, and admission of senders.

use equipoise_adapters::source::{MvnSettings, MvnTransport, SuitSource};
use equipoise_adapters::suit::{SuitRefusal, SuitSettings, TypeSet};
use equipoise_adapters::wire::mvn::{Header, SegmentPose, pose_quaternion};
use equipoise_core::message::SuitSample;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use super::{assert_memory_bounded, repeat_after_stall};

/// Long enough for a loaded machine; no test here measures speed.
const PATIENCE: Duration = Duration::from_secs(90);

fn datagram(counter: u32, avatar: u8) -> Vec<u8> {
    let poses: Vec<_> = (1..=23)
        .map(|segment_id| SegmentPose {
            segment_id,
            position_m: [0.0, 0.0, if segment_id == 7 { 1.6 } else { 0.1 }],
            orientation_wxyz: [1.0, 0.0, 0.0, 0.0],
        })
        .collect();
    let mut bytes = Vec::new();
    pose_quaternion::encode(&Header::new(counter, counter * 4, avatar), &poses, &mut bytes).unwrap();
    bytes
}

fn source(others: &[u8]) -> SuitSource {
    SuitSource::open(&MvnSettings {
        transport: MvnTransport::Tcp,
        listen: "127.0.0.1:0".parse().unwrap(),
        timeout: Duration::from_millis(20),
        // Each datagram is a complete sample, so that datagrams can be counted.
        suit: SuitSettings { required: Some(TypeSet::POSE_QUATERNION), ..SuitSettings::default() },
        others: others.to_vec(),
        ..MvnSettings::default()
    })
    .unwrap()
}

fn connect(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_nodelay(true).unwrap();
    stream
}

/// Receives this many samples.
fn samples(source: &mut SuitSource, count: usize) -> Vec<SuitSample> {
    let (mut samples, begun) = (Vec::new(), Instant::now());
    while samples.len() < count && begun.elapsed() < PATIENCE {
        samples.extend(source.receive().unwrap());
    }
    assert_eq!(samples.len(), count, "{:?}", source.counts());
    samples
}

fn counters(samples: &[SuitSample]) -> Vec<u32> {
    samples.iter().map(|sample| sample.device_counter).collect()
}

fn refused(source: &SuitSource, refusal: SuitRefusal) -> u64 {
    source.counts().refused[refusal.index()]
}

/// Reads until a count is reached; samples are not expected.
fn until(source: &mut SuitSource, what: &str, reached: impl Fn(&SuitSource) -> bool) {
    let begun = Instant::now();
    while !reached(source) {
        assert!(begun.elapsed() < PATIENCE, "{what}: {:?}", source.counts());
        assert!(source.receive().unwrap().is_none(), "{what}");
    }
}

#[test]
fn a_stream_in_any_portions_becomes_samples_and_damage_is_counted_once() {
    let mut source = source(&[]);
    let mut suit = connect(source.local_address());
    let mut stream: Vec<u8> = (0..10).flat_map(|counter| datagram(counter, 0)).collect();
    // One datagram is damaged in the middle, then text of the remote control, then noise.
    let damaged_at = stream.len() + 300;
    stream.extend((10..20).flat_map(|counter| datagram(counter, 0)));
    stream.splice(damaged_at..damaged_at, [0xee; 33]);
    stream.extend_from_slice(br#"{"type":"transport","value":"record"}"#);
    stream.extend((20..30).flat_map(|counter| datagram(counter, 0)));
    stream.extend_from_slice(&[0; 70]);
    stream.extend((30..40).flat_map(|counter| datagram(counter, 0)));
    let mut got = Vec::new();
    for (index, portion) in stream.chunks(1009).enumerate() {
        suit.write_all(portion).unwrap();
        if index % 3 == 0 {
            got.extend(source.receive().unwrap());
        }
    }
    got.extend(samples(&mut source, 39 - got.len()));
    assert_eq!(counters(&got), (0..40).filter(|counter| *counter != 10).collect::<Vec<_>>());
    assert_eq!(refused(&source, SuitRefusal::OutOfStep), 2, "{:?}", source.counts());
    assert_eq!(source.counts().lost, 1);
    let mut arrivals = got.iter().map(|sample| sample.arrival_ns);
    assert!(arrivals.next().unwrap() > 0);
    assert!(got.windows(2).all(|pair| pair[0].arrival_ns <= pair[1].arrival_ns));
    assert_memory_bounded();
}

#[test]
fn a_suit_that_comes_again_goes_on_and_half_a_datagram_is_forgotten() {
    let mut source = source(&[]);
    let mut first = connect(source.local_address());
    for counter in 0..5 {
        first.write_all(&datagram(counter, 0)).unwrap();
    }
    first.write_all(&datagram(5, 0)[..500]).unwrap();
    assert_eq!(counters(&samples(&mut source, 5)), [0, 1, 2, 3, 4]);
    drop(first);
    let mut second = connect(source.local_address());
    for counter in 6..9 {
        second.write_all(&datagram(counter, 0)).unwrap();
    }
    assert_eq!(counters(&samples(&mut source, 3)), [6, 7, 8]);
    assert_eq!(source.counts().refused.iter().sum::<u64>(), 0, "a connection that ends is no damage");
}

#[test]
fn a_second_client_is_turned_away_while_the_first_streams_and_takes_over_when_it_is_silent() {
    repeat_after_stall(assert_second_client_waits);
}

fn assert_second_client_waits() {
    let mut source = source(&[]);
    let mut first = connect(source.local_address());
    first.write_all(&datagram(0, 0)).unwrap();
    samples(&mut source, 1);
    let mut second = connect(source.local_address());
    until(&mut source, "turned away", |source| refused(source, SuitRefusal::ForeignSender) == 1);
    second.set_read_timeout(Some(PATIENCE)).unwrap();
    assert_eq!(second.read(&mut [0; 1]).unwrap(), 0, "its connection was closed");
    first.write_all(&datagram(1, 0)).unwrap();
    let last = samples(&mut source, 1);
    assert_eq!(counters(&last), [1]);

    // The first stays connected without data, like a client whose cable was pulled.
    let begun = Instant::now();
    let mut third = loop {
        assert!(begun.elapsed() < PATIENCE, "never taken over");
        let before = refused(&source, SuitRefusal::ForeignSender);
        let mut third = connect(source.local_address());
        // The write of a client that is turned away may fail.
        let _ = third.write_all(&datagram(2, 0));
        let taken = loop {
            let sample = source.receive().unwrap();
            if sample.is_some() || refused(&source, SuitRefusal::ForeignSender) > before {
                break sample;
            }
        };
        if let Some(taken) = taken {
            assert!(taken.arrival_ns - last[0].arrival_ns >= 1_000_000_000, "only after a silence");
            break third;
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    third.write_all(&datagram(3, 0)).unwrap();
    assert_eq!(counters(&samples(&mut source, 1)), [3]);
}

#[test]
fn idle_and_invalid_connections_do_not_block_the_suit() {
    let mut source = source(&[]);
    let address = source.local_address();
    let idle: Vec<_> = (0..3).map(|_| connect(address)).collect();
    let mut invalid = connect(address);
    // A valid datagram of a character that is not configured.
    invalid.write_all(&[datagram(1, 7), b"GET / HTTP/1.1\r\n\r\n".repeat(50)].concat()).unwrap();
    until(&mut source, "the datagram of another character", |source| {
        refused(source, SuitRefusal::OtherAvatar) == 1
    });
    // No client has been silent for a second yet, and the suit need not wait for that.
    let mut suit = connect(address);
    for counter in 0..5 {
        suit.write_all(&datagram(counter, 0)).unwrap();
    }
    assert_eq!(counters(&samples(&mut source, 5)), [0, 1, 2, 3, 4]);
    assert_eq!(refused(&source, SuitRefusal::ForeignSender), 0, "the suit was not turned away");
    for mut rejected in idle.into_iter().chain([invalid]) {
        rejected.set_read_timeout(Some(PATIENCE)).unwrap();
        // A connection that is closed with unread bytes is reset.
        assert!(rejected.read(&mut [0; 1]).is_ok_and(|count| count == 0) || rejected.peek(&mut [0]).is_err());
    }
    // With any number of clients, the newest is read, and the oldest is closed.
    drop(suit);
    let clients: Vec<_> = (0..20).map(|_| connect(address)).collect();
    until(&mut source, "most to be turned away", |source| refused(source, SuitRefusal::ForeignSender) >= 12);
    let mut suit = connect(address);
    suit.write_all(&datagram(5, 0)).unwrap();
    assert_eq!(counters(&samples(&mut source, 1)), [5]);
    drop(clients);
    assert_memory_bounded();
}

#[test]
fn several_workers_share_a_connection() {
    let mut source = source(&[1]);
    let mut suit = connect(source.local_address());
    for counter in 0..5 {
        suit.write_all(&[datagram(counter, 0), datagram(100 + counter, 1), datagram(counter, 2)].concat())
            .unwrap();
    }
    let samples = samples(&mut source, 10);
    for (avatar, first) in [(0, 0), (1, 100)] {
        let of_it: Vec<_> = samples.iter().filter(|sample| sample.avatar == avatar).copied().collect();
        assert_eq!(counters(&of_it), (first..first + 5).collect::<Vec<_>>());
    }
    until(&mut source, "the fifth of another", |source| refused(source, SuitRefusal::OtherAvatar) == 5);
    let health = source.health_of(1).unwrap();
    assert_eq!((health.stream, health.received, health.published), (1, 5, 5));
    assert_eq!(source.health().published, 5);
    assert!(source.health_of(2).is_none());
}

#[test]
fn a_taken_port_is_named() {
    let taken = source(&[]);
    let settings =
        MvnSettings { transport: MvnTransport::Tcp, listen: taken.local_address(), ..MvnSettings::default() };
    let error = SuitSource::open(&settings).unwrap_err().to_string();
    assert!(error.contains(&format!("port {} is taken", taken.local_address().port())), "{error}");
}
