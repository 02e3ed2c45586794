//! Devices with a configured layout over real sockets: lines and frames become samples, only admitted senders are read,
//! and requests are sent.

use std::io::{ErrorKind, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::time::{Duration, Instant};

use equipoise_adapters::ground::channels::{Direct, ForceUnit, MomentUnit};
use equipoise_adapters::ground::device::binary::{Binary, BinarySettings, Count, Field, Scans};
use equipoise_adapters::ground::device::moticon::{Moticon, MoticonSettings, Sideways, all_fields};
use equipoise_adapters::ground::device::text::{Column, Framing, Text, TextSettings};
use equipoise_adapters::ground::{Channels, GroundDevice, GroundSettings};
use equipoise_adapters::source::udp::Senders;
use equipoise_adapters::source::{GroundSource, TcpLine, Transport, UdpLine};
use equipoise_adapters::wire::frame::{Endian, FrameForm, Length, Number, NumberPosition};
use equipoise_adapters::wire::text_line::{Decimal, Delimiter, LineForm, Unit};
use equipoise_core::message::GroundSample;
use equipoise_simulator::ports::free_address;

const PATIENCE: Duration = Duration::from_secs(90);

fn vertical() -> Channels {
    let direct = Direct { force: [None, None, Some(0)], ..Direct::default() };
    Channels::direct(1, direct, ForceUnit::Newton, MomentUnit::NewtonMetre).unwrap()
}

/// `count seconds newtons`
fn text(framing: Framing) -> Text {
    Text::new(TextSettings {
        form: LineForm {
            delimiter: Delimiter::Spaces,
            decimal: Decimal::Point,
            comment: Some(b'#'),
            prefix: Vec::new(),
            fields: 3,
        },
        framing,
        header_lines: 0,
        longest: 100,
        columns: vec![Column { field: 2, scale: -1.0, offset: 0.0 }],
        channels: vertical(),
        time: Some((1, Unit::NanosecondInSeconds)),
        sequence: None,
    })
}

fn line(index: u32) -> String {
    format!("{index} {:.2} {}\n", f64::from(index) / 100.0, 600 + index)
}

fn open(transport: impl Transport + 'static, device: impl GroundDevice + 'static) -> GroundSource {
    GroundSource::open(Box::new(transport), Box::new(device), GroundSettings::default()).unwrap()
}

fn until(source: &mut GroundSource, count: usize, samples: &mut Vec<GroundSample>) {
    let begun = Instant::now();
    while samples.len() < count && begun.elapsed() < PATIENCE {
        source.receive(samples).unwrap();
    }
    assert_eq!(samples.len(), count, "{:?} {:?}", source.counts(), source.diagnostic());
}

#[test]
fn lines_over_udp_are_samples() {
    let address = free_address().unwrap();
    let mut source =
        open(UdpLine::listening(address, Senders::Loopback, "ground.listen"), text(Framing::Datagrams));
    let device = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut samples = Vec::new();
    for index in 0..20 {
        // One is lost, one is duplicated, and one datagram contains two.
        let datagram = match index {
            7 => continue,
            9 => line(9) + &line(9),
            _ => line(index),
        };
        device.send_to(datagram.as_bytes(), address).unwrap();
    }
    until(&mut source, 19, &mut samples);
    assert_eq!(source.counts().lost, 1);
    assert!(samples.windows(2).all(|pair| pair[0].force_n[2] < pair[1].force_n[2]));
}

/// Waits for the source's connection, which it opens when it runs.
fn accept(listener: &TcpListener, source: &mut GroundSource, samples: &mut Vec<GroundSample>) -> TcpStream {
    listener.set_nonblocking(true).unwrap();
    let begun = Instant::now();
    while begun.elapsed() < PATIENCE {
        match listener.accept() {
            Ok((stream, _)) => {
                stream.set_nonblocking(false).unwrap();
                return stream;
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => _ = source.receive(samples).unwrap(),
            Err(error) => panic!("{error}"),
        }
    }
    panic!("it did not call");
}

#[test]
fn lines_over_tcp_are_samples_and_a_connection_that_breaks_is_made_again() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let mut source =
        open(TcpLine::to(address, "the device of ground.text", "ground.address"), text(Framing::Stream));
    let mut samples = Vec::new();
    for round in 0..2 {
        let mut device = accept(&listener, &mut source, &mut samples);
        let lines: String = (0..10).map(|index| line(100 * round + index)).collect();
        // The end of a line is in the next piece; the last line never ends.
        for piece in (lines + "9 9.9").as_bytes().chunks(7) {
            device.write_all(piece).unwrap();
        }
        until(&mut source, 10 * (round as usize + 1), &mut samples);
        // The source detects the closed connection and reconnects.
    }
    assert_eq!(source.counts().refused.iter().sum::<u64>(), 0);
}

#[test]
fn a_described_device_gets_its_start_and_stop_commands() {
    let device = UdpSocket::bind("127.0.0.1:0").unwrap();
    device.set_read_timeout(Some(PATIENCE)).unwrap();
    let place = |at, number| NumberPosition::new(at, number, Endian::Big);
    let settings = BinarySettings {
        form: FrameForm { sync: vec![], length: Length::Fixed(6), tags: vec![], kind: None, checksum: None },
        datagrams: true,
        fields: vec![Field { place: place(2, Number::I32), scale: 1.0, per: -1000.0, offset: 0.0 }],
        channels: vertical(),
        scans: Scans { count: 1, bytes: 0 },
        sequence: Some(Count { place: place(0, Number::U16), modulus: 1 << 16 }),
        counter: None,
        time: None,
        rate_hz: None,
        status: None,
        trigger: None,
        request: Some(b"begin".to_vec()),
        close_command: Some(b"end".to_vec()),
    };
    let mut source = open(UdpLine::to(device.local_addr().unwrap(), "ground.address"), Binary::new(settings));
    let mut buffer = [0; 100];
    let (length, host) = device.recv_from(&mut buffer).unwrap();
    assert_eq!(&buffer[..length], b"begin");
    for index in 0u16..8 {
        let frame = [&index.to_be_bytes()[..], &700_000i32.to_be_bytes()].concat();
        device.send_to(&frame, host).unwrap();
    }
    let mut samples = Vec::new();
    until(&mut source, 8, &mut samples);
    assert_eq!(samples[7].force_n[2], 700.0);
    drop(source);
    loop {
        let (length, _) = device.recv_from(&mut buffer).unwrap();
        if &buffer[..length] == b"end" {
            break;
        }
        // The source may have repeated the request meanwhile.
        assert_eq!(&buffer[..length], b"begin");
    }
}

#[test]
fn insoles_over_udp_are_two_feet() {
    let address = free_address().unwrap();
    let settings = MoticonSettings {
        fields: all_fields(),
        length_m: 0.25,
        width_m: 0.09,
        x_to_tip: true,
        y: Sideways::Lateral,
        swapped: false,
        time: Unit::NanosecondInSeconds,
    };
    let device = Moticon::new(&settings).unwrap();
    let mut source = open(UdpLine::listening(address, Senders::Loopback, "ground.listen"), device);
    let insoles = UdpSocket::bind("127.0.0.1:0").unwrap();
    for index in 0..10 {
        let mut fields = vec![0.0; 51];
        (fields[0], fields[7], fields[25], fields[32], fields[50]) =
            (5.0 + f64::from(index) / 50.0, 0.2, 300.0, -0.2, 400.0);
        fields[9..25].fill(1.0);
        fields[34..50].fill(1.0);
        let line: Vec<String> = fields.iter().map(f64::to_string).collect();
        insoles.send_to(line.join(" ").as_bytes(), address).unwrap();
    }
    let mut samples = Vec::new();
    until(&mut source, 10, &mut samples);
    assert_eq!((samples[9].foot_vertical_n, samples[9].per_foot), ([300.0, 400.0], 1));
    assert!((samples[9].foot_cop_m[0][0] - 0.05).abs() < 1e-12);
}
