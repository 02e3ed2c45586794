//! A plate that reports faults, repeats itself or sends invalid data; and foreign senders in its place.

use std::net::UdpSocket;
use std::sync::{Arc, Mutex};

use equipoise_adapters::ground::GroundRefusal;
use equipoise_core::message::Validity;

use crate::eyes::Eyes;
use crate::process::wait_for;
use crate::station::Station;
use crate::streams::{self, FakePlate};

/// Number of repetitions of each bad record.
const ROUNDS: u64 = 10;

#[test]
fn a_faulty_sensor_has_no_centre_of_pressure_until_it_is_sound_again() {
    let station = Station::new();
    let person = station.person();
    let _daemon = station.daemon(&station.configuration());
    let mut eyes = Eyes::open(&station);
    let invalid = |eyes: &Eyes| eyes.has(Validity::SPOILS_COP_MEASURED);
    eyes.until("a centre of pressure", |eyes| eyes.both_fresh() && !invalid(eyes));

    person.set_plate_status(0x8000_0000);
    eyes.until("a reason against it", invalid);
    eyes.until("the fault to be counted", |eyes| eyes.ground_refused(GroundRefusal::DeviceStatus) > 0);
    let status = station.status().expect("the daemon answers");
    assert!(status["state"].get("cop_measured").is_none(), "{status}");
    assert!(!status["state"]["valid"].as_array().expect("a list").is_empty(), "{status}");
    assert!(status["adapters"][1]["refused"]["device_status"].as_u64() > Some(0), "{status}");

    person.set_plate_status(0);
    eyes.until("the centre of pressure again", |eyes| !invalid(eyes));
    let status = station.status().expect("the daemon answers");
    assert!(status["state"]["cop_measured"].is_array(), "{status}");
}

#[test]
fn what_is_no_new_record_of_the_plate_is_counted_and_not_used() {
    let station = Station::new();
    let plate = FakePlate::start(station.plate);
    let _suit = streams::suit(station.suit);
    let mut daemon = station.daemon(&station.configuration());
    let mut eyes = Eyes::open(&station);
    eyes.until("both sensors", Eyes::both_fresh);

    let old: Arc<Mutex<Vec<u8>>> = Arc::default();
    let kept = Arc::clone(&old);
    plate.stream.slip_in(move |sound| {
        kept.lock().expect("no thread panics").extend_from_slice(sound);
        Vec::new()
    });
    for _ in 0..ROUNDS {
        let replayed = Arc::clone(&old);
        plate.stream.slip_in(<[u8]>::to_vec);
        plate.stream.slip_in(move |_| replayed.lock().expect("no thread panics").clone());
        plate.stream.slip_in(|sound| sound[..35].to_vec());
        plate.stream.slip_in(|sound| [sound, &sound[..1]].concat());
        plate.stream.slip_in(|_| b"GET / HTTP/1.1\r\n\r\n".to_vec());
        plate.stream.slip_in(|_| vec![0xff; 65_500]);
        plate.stream.slip_in(|_| vec![0xff; 36]);
    }
    let counted = [(GroundRefusal::Duplicate, 1), (GroundRefusal::OutOfOrder, 2), (GroundRefusal::Length, 4)];
    for (reason, tricks) in counted {
        eyes.until(reason.name(), |eyes| {
            // A person of 72 kg stands there, whatever the bad records contain.
            let [_, _, vertical_n] = eyes.state.ground_force_n;
            assert!(vertical_n == 0.0 || (vertical_n - 706.0).abs() < 1.0, "{vertical_n} N");
            eyes.ground_refused(reason) >= tricks * ROUNDS
        });
    }

    // A foreign sender that sends to the client's port.
    let client = wait_for("a client of the plate", || plate.client());
    let stranger = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let elsewhere = UdpSocket::bind("127.0.0.2:0").expect("a socket");
    for _ in 0..ROUNDS {
        for socket in [&stranger, &elsewhere] {
            socket.send_to(&[0; 36], client).expect("a datagram");
        }
    }
    let foreign = GroundRefusal::ForeignSender;
    // The second socket cannot always reach one that is bound to 127.0.0.1, and need not.
    eyes.until("the stranger to be counted", |eyes| eyes.ground_refused(foreign) >= ROUNDS);
    let published = eyes.ground().published;
    eyes.until("more good records", |eyes| eyes.ground().published > published + 50);
    eyes.until("both sensors", Eyes::both_fresh);
    assert!(daemon.is_running());
    assert!(!daemon.stderr().contains("panicked"), "{}", daemon.stderr());
}
