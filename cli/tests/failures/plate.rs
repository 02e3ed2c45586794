//! A plate that reports faults, repeats itself or sends invalid data; and foreign senders in its place.

use std::net::UdpSocket;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use equipoise_adapters::ground::GroundRefusal;
use equipoise_core::message::Validity;

use crate::malformed_datagrams::assert_memory_bounded;
use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::Station;
use crate::streams::{self, FakePlate, Stream};

/// Number of repetitions of each bad record.
const ROUNDS: u64 = 10;
/// Wait for the counters before all bad records are sent again; all of them take less than a second.
const REPEAT_AFTER: Duration = Duration::from_secs(15);

#[test]
fn a_faulty_sensor_has_no_centre_of_pressure_until_it_recovers() {
    let station = Station::new();
    let person = station.person();
    let _daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    let invalid = |monitor: &Monitor| monitor.has(Validity::INVALIDATES_COP_MEASURED);
    monitor.until("a centre of pressure", |monitor| monitor.both_fresh() && !invalid(monitor));

    person.set_plate_status(0x8000_0000);
    monitor.until("a reason against it", invalid);
    monitor
        .until("the fault to be counted", |monitor| monitor.ground_refused(GroundRefusal::DeviceStatus) > 0);
    let status = station.status_when("the fault in the status", |status| {
        status["adapters"][1]["refused"]["device_status"].as_u64() > Some(0)
    });
    assert!(status["state"].get("cop_measured").is_none(), "{status}");
    assert!(!status["state"]["valid"].as_array().expect("a list").is_empty(), "{status}");

    person.set_plate_status(0);
    monitor.until("the centre of pressure again", |monitor| !invalid(monitor));
    station.status_when("it in the status", |status| status["state"]["cop_measured"].is_array());
}

#[test]
fn records_that_are_not_new_are_counted_and_not_used() {
    let station = Station::new();
    let plate = FakePlate::start(station.plate);
    let _suit = streams::suit(station.suit);
    let mut daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until("both sensors", Monitor::both_fresh);

    let old: Arc<Mutex<Vec<u8>>> = Arc::default();
    let shared = Arc::clone(&old);
    plate.stream.slip_in(move |valid| {
        shared.lock().expect("no thread panics").extend_from_slice(valid);
        Vec::new()
    });
    play_all(&plate.stream, &old);
    let mut sent = Instant::now();
    let counted = [(GroundRefusal::Duplicate, 1), (GroundRefusal::OutOfOrder, 2), (GroundRefusal::Length, 4)];
    for (reason, faults) in counted {
        monitor.until(reason.name(), |monitor| {
            // A person of 72 kg stands there, whatever the bad records contain.
            let [_, _, vertical_n] = monitor.state.ground_force_n;
            assert!(vertical_n == 0.0 || (vertical_n - 706.0).abs() < 1.0, "{vertical_n} N");
            // A datagram may be lost also on loopback: a full socket buffer behind a busy core.
            if sent.elapsed() > REPEAT_AFTER {
                play_all(&plate.stream, &old);
                sent = Instant::now();
            }
            monitor.ground_refused(reason) >= faults * ROUNDS
        });
    }

    // A foreign sender that sends to the client's port.
    let client = wait_for("a client of the plate", || plate.client());
    let other_port = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let other_address = UdpSocket::bind("127.0.0.2:0").expect("a socket");
    for _ in 0..ROUNDS {
        for socket in [&other_port, &other_address] {
            socket.send_to(&[0; 36], client).expect("a datagram");
        }
    }
    let foreign = GroundRefusal::ForeignSender;
    // The second socket cannot always reach one that is bound to 127.0.0.1, and need not.
    monitor.until("the foreign datagrams to be counted", |monitor| monitor.ground_refused(foreign) >= ROUNDS);
    let published = monitor.ground().published;
    monitor.until("more good records", |monitor| monitor.ground().published > published + 50);
    monitor.until("both sensors", Monitor::both_fresh);
    assert!(daemon.is_running());
    assert_memory_bounded(&daemon);
    assert!(!daemon.stderr().contains("panicked"), "{}", daemon.stderr());
}

/// Inserts every kind of bad record [`ROUNDS`] times; `old` is an earlier record.
fn play_all(plate: &Stream, old: &Arc<Mutex<Vec<u8>>>) {
    for _ in 0..ROUNDS {
        let replayed = Arc::clone(old);
        plate.slip_in(<[u8]>::to_vec);
        plate.slip_in(move |_| replayed.lock().expect("no thread panics").clone());
        plate.slip_in(|valid| valid[..35].to_vec());
        plate.slip_in(|valid| [valid, &valid[..1]].concat());
        plate.slip_in(|_| b"GET / HTTP/1.1\r\n\r\n".to_vec());
        plate.slip_in(|_| vec![0xff; 65_500]);
        plate.slip_in(|_| vec![0xff; 36]);
    }
}
