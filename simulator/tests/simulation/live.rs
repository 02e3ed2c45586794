//! The simulated station on real sockets. Assertions are independent of the machine's load.

use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

use bytemuck::Zeroable;
use equipoise_adapters::wire::ati_rdt::{Command, Record, Records, Request};
use equipoise_adapters::wire::mvn::{Datagram, DatagramType};
use equipoise_core::message::{GroundSample, SuitSample};
use equipoise_simulator::GRAVITY_M_PER_S2;
use equipoise_simulator::motion::Habits;
use equipoise_simulator::noise::{PlateNoise, SuitNoise};
use equipoise_simulator::player::{PlayerSettings, Recorded, play};
use equipoise_simulator::settings::SimulationSettings;
use equipoise_simulator::simulation::Simulation;

fn any() -> SocketAddr {
    "127.0.0.1:0".parse().expect("an address")
}

fn listener() -> UdpSocket {
    let socket = UdpSocket::bind(any()).expect("a free port");
    socket.set_read_timeout(Some(Duration::from_secs(90))).expect("a timeout");
    socket
}

fn ask(socket: &UdpSocket, plate: SocketAddr, command: Command, sample_count: u32) {
    socket.send_to(&Request { command, sample_count }.to_bytes(), plate).expect("sent");
}

/// Receives this many records.
fn records(socket: &UdpSocket, count: usize) -> Vec<Record> {
    let mut all = Vec::new();
    let mut bytes = [0; 2048];
    while all.len() < count {
        let length = socket.recv(&mut bytes).expect("a record");
        all.extend(Records::parse(&bytes[..length]).expect("records"));
    }
    all
}

fn settings(suit: &UdpSocket) -> SimulationSettings {
    let mut settings = SimulationSettings::default();
    settings.suit.target = suit.local_addr().expect("an address");
    settings.plate.address = any();
    settings
}

#[test]
fn the_plate_streams_whole_records_to_every_client() {
    let (suit, plate) = (listener(), listener());
    let simulation = Simulation::start(settings(&suit)).unwrap();
    ask(&plate, simulation.plate_address(), Command::StartRealTime, 50);
    let got = records(&plate, 50);
    for (index, pair) in got.windows(2).enumerate() {
        assert_eq!(pair[0].rdt_sequence, index as u32 + 1);
        assert_eq!(pair[1].ft_sequence, pair[0].ft_sequence + 1, "no sample is skipped");
    }
    let down_n = got.iter().map(|record| f64::from(record.force_counts[2]) * 1e-6).sum::<f64>() / 50.0;
    assert!((down_n + 72.0 * GRAVITY_M_PER_S2).abs() < 15.0, "{down_n}");
    // 50 were requested, and no more arrive.
    plate.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
    assert!(plate.recv(&mut [0; 64]).is_err());
    // Buffered: several in a datagram; every record contains the status word.
    simulation.set_plate_status(7);
    plate.set_read_timeout(Some(Duration::from_secs(90))).unwrap();
    ask(&plate, simulation.plate_address(), Command::StartBuffered, 0);
    assert_eq!(plate.recv(&mut [0; 2048]).unwrap(), 360);
    assert_eq!(records(&plate, 10)[0].status, 7);
    // A later client takes the stream.
    let thief = listener();
    ask(&thief, simulation.plate_address(), Command::StartRealTime, 0);
    assert_eq!(records(&thief, 1)[0].rdt_sequence, 1);
    ask(&thief, simulation.plate_address(), Command::Stop, 0);
    simulation.stop().unwrap();
}

#[test]
fn the_suit_streams_poses_and_introduces_itself() {
    let suit = listener();
    let mut settings = settings(&suit);
    settings.habits = Habits::NONE;
    settings.suit.noise = SuitNoise::NONE;
    settings.suit.rate_hz = 240.0;
    let simulation = Simulation::start(settings).unwrap();
    let mut seen = Vec::new();
    let mut poses = Vec::new();
    let mut bytes = [0; 4096];
    while poses.len() < 24 {
        let length = suit.recv(&mut bytes).unwrap();
        let datagram = Datagram::parse(&bytes[..length]).unwrap();
        seen.push(datagram.header().unwrap().datagram_type);
        if let Datagram::PoseQuaternion(header, items) = datagram {
            poses.push((header, items.collect::<Vec<_>>()));
        }
    }
    for kind in [b"02", b"12", b"13", b"20", b"21", b"24"] {
        assert!(seen.contains(&DatagramType(*kind)));
    }
    // A full socket buffer behind a busy core may lose samples.
    assert!(poses.windows(2).all(|pair| pair[0].0.sample_counter < pair[1].0.sample_counter));
    for (header, pose) in &poses {
        let number = f64::from(header.sample_counter);
        assert_eq!(header.time_code_ms, (number * 1000.0 / 240.0) as u32);
        let truth = simulation.truth_at(number / 240.0);
        for (item, origin) in pose.iter().zip(truth.body.origin_m) {
            for axis in 0..3 {
                assert!((f64::from(item.position_m[axis]) - origin[axis]).abs() < 1e-5);
            }
        }
    }
}

#[test]
fn what_the_plate_says_is_the_truth() {
    let (suit, plate) = (listener(), listener());
    let mut settings = settings(&suit);
    settings.plate.noise = PlateNoise::NONE;
    let simulation = Simulation::start(settings).unwrap();
    simulation.take_pose(2).unwrap();
    assert!(simulation.take_pose(1000).is_err());
    simulation.lift(4.0);
    ask(&plate, simulation.plate_address(), Command::StartRealTime, 100);
    for record in records(&plate, 100) {
        let truth = simulation.truth_at(f64::from(record.ft_sequence) * 1e-3);
        let force = record.force_counts.map(|count| f64::from(count) * -1e-6);
        let moment = record.torque_counts.map(|count| f64::from(count) * -1e-6);
        for axis in 0..3 {
            assert!((force[axis] - truth.ground.force_n[axis]).abs() < 1e-4);
            assert!((moment[axis] - truth.ground.moment_nm[axis]).abs() < 1e-4);
        }
    }
    simulation.stop().unwrap();
}

#[test]
fn a_recording_comes_again_on_the_wires() {
    let (suit, plate) = (listener(), listener());
    let recording = (0..30_u32).flat_map(|number| {
        let ground =
            GroundSample { device_counter: number, force_n: [0.0, 0.0, 700.0], ..Zeroable::zeroed() };
        let mut body: SuitSample = Zeroable::zeroed();
        body.device_counter = number;
        body.orientation_wxyz = [[1.0, 0.0, 0.0, 0.0]; 23];
        let time_s = f64::from(number) * 0.01;
        [(time_s, Recorded::Suit(Box::new(body))), (time_s, Recorded::Ground(ground))]
    });
    let player = play(
        recording,
        PlayerSettings {
            suit_target: suit.local_addr().unwrap(),
            plate_address: any(),
            plate: Default::default(),
            speed: 10.0,
            wait_for_client: true,
            faults: Default::default(),
            seed: 1,
        },
    )
    .unwrap();
    ask(&plate, player.plate_address(), Command::StartRealTime, 0);
    let got = records(&plate, 30);
    assert_eq!(got.iter().map(|record| record.ft_sequence).collect::<Vec<_>>(), (0..30).collect::<Vec<_>>());
    assert_eq!(got[0].force_counts, [0, 0, -700_000_000]);
    assert_eq!(player.wait().unwrap(), [30, 30]);
    let mut bytes = [0; 2048];
    for number in 0..30 {
        let length = suit.recv(&mut bytes).unwrap();
        assert_eq!(Datagram::parse(&bytes[..length]).unwrap().header().unwrap().sample_counter, number);
    }
}
