//! Lab Streaming Layer: a stream is discovered on the network, described, read, and found again.

use super::{PATIENCE, until};
use equipoise_adapters::ground::GroundSettings;
use equipoise_adapters::ground::device::lsl::{Lsl, LslSettings};
use equipoise_adapters::ground::plan::Plan;
use equipoise_adapters::source::{GroundSource, LslLine, LslLineSettings};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, UdpSocket};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;

fn description(uid: &str, source_id: &str, port: u16) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n<info><name>Plate</name><type>Force</type><channel_count>1</channel_count><channel_format>\
         float32</channel_format><source_id>{source_id}</source_id><nominal_srate>100.0</nominal_srate><version>1.10</version>\
         <uid>{uid}</uid><session_id>default</session_id><hostname>here</hostname><v4data_port>{port}</v4data_port><desc>\
         <channels><channel><label>Fz</label><unit>N</unit></channel></channels></desc></info>\n"
    )
}

/// Answers this many discovery requests, for each of these streams.
fn answer_all(socket: UdpSocket, streams: Vec<String>, questions: u32) -> JoinHandle<()> {
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    std::thread::spawn(move || {
        let mut buffer = [0; 1000];
        for _ in 0..questions {
            let (length, sender) = socket.recv_from(&mut buffer).unwrap();
            let question = String::from_utf8(buffer[..length].to_vec()).unwrap();
            let lines: Vec<&str> = question.split("\r\n").collect();
            assert_eq!(lines[..2], ["LSL:shortinfo", "name='Plate'"], "{question}");
            let (port, id) = lines[2].split_once(' ').unwrap();
            for stream in &streams {
                let answer = format!("{id}\r\n{stream}");
                socket.send_to(answer.as_bytes(), (sender.ip(), port.parse().unwrap())).unwrap();
            }
        }
    })
}

/// Sends its description and one feed, then closes.
fn outlet(listener: &TcpListener, uid: &str) {
    let port = listener.local_addr().unwrap().port();
    let (mut client, _) = listener.accept().unwrap();
    client.read_exact(&mut [0; 14]).unwrap();
    client.write_all(description(uid, "plate-1", port).as_bytes()).unwrap();
    drop(client);

    let (mut client, _) = listener.accept().unwrap();
    let mut lines = BufReader::new(client.try_clone().unwrap()).lines();
    assert_eq!(lines.next().unwrap().unwrap(), format!("LSL:streamfeed/110 {uid}"));
    while lines.next().unwrap().unwrap() != "" {}
    let head = format!(
        "LSL/110 200 OK\r\nUID: {uid}\r\nByte-Order: 1234\r\nSuppress-Subnormals: 0\r\nData-Protocol-Version: 110\r\n\r\n"
    );
    let sample = |time_s: f64, fz: f32| [&[2][..], &time_s.to_le_bytes(), &fz.to_le_bytes()].concat();
    let mut bytes = [head.into_bytes(), sample(123_456.789, 4.0), sample(123_456.789, 2.0)].concat();
    bytes.extend((1..=50).flat_map(|index| sample(f64::from(index) * 0.01, -700.0)));
    for piece in bytes.chunks(100) {
        client.write_all(piece).unwrap();
    }
}

fn plan(name: &str) -> Lsl {
    let plan = Plan::Direct { force: [None, None, Some(name.to_owned())], moment: [None, None, None] };
    Lsl::new(LslSettings { plan, force_unit: None, moment_unit: None })
}

fn named(discovery: SocketAddr) -> LslLine {
    let settings = LslLineSettings { name: Some("Plate".to_owned()), ..LslLineSettings::default() };
    LslLine::asking(settings, vec![discovery])
}

#[test]
fn a_stream_is_found_by_its_name_read_and_found_again_when_its_program_was_restarted() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let discovery = UdpSocket::bind("127.0.0.1:0").unwrap();
    let line = named(discovery.local_addr().unwrap());
    let other = description("u-9", "plate-1", port).replace("<name>Plate", "<name>Other");
    // Each discovery sends two requests; the second time the outlet is another one on the same port.
    let answered = answer_all(discovery, vec![description("u-1", "plate-1", port), other], 4);
    let played = std::thread::spawn(move || ["u-1", "u-2"].map(|uid| outlet(&listener, uid)));
    let mut source =
        GroundSource::open(Box::new(line), Box::new(plan("Fz")), GroundSettings::default()).unwrap();
    let samples = until(&mut source, |_, samples| samples.len() >= 100);
    assert_eq!((samples.len(), source.counts().lost), (100, 0));
    assert!(samples.iter().all(|sample| sample.force_n == [0.0, 0.0, 700.0]));
    assert_eq!((samples[49].session, samples[50].session), (0, 1), "its clock restarts");
    played.join().unwrap();
    drop(source);
    answered.join().unwrap();
}

#[test]
fn several_streams_of_one_name_and_none_are_said() {
    let discovery = UdpSocket::bind("127.0.0.1:0").unwrap();
    let line = named(discovery.local_addr().unwrap());
    let streams = vec![description("u-1", "plate-1", 1), description("u-2", "plate-2", 2)];
    let answered = answer_all(discovery, streams, 2);
    let open =
        |line| GroundSource::open(Box::new(line), Box::new(plan("Fz")), GroundSettings::default()).unwrap();
    let why = open(line).diagnostic().unwrap();
    assert!(
        why.contains("there are 2") && why.contains("plate-2") && why.contains("ground.lsl.source_id"),
        "{why}"
    );
    answered.join().unwrap();

    let silent = UdpSocket::bind("127.0.0.1:0").unwrap();
    let why = open(named(silent.local_addr().unwrap())).diagnostic().unwrap();
    assert!(why.contains("a stream with name \"Plate\"") && why.contains("no answer"), "{why}");
}

#[test]
fn another_stream_at_the_address_is_said() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = Some(listener.local_addr().unwrap());
    let played = std::thread::spawn(move || {
        let (mut client, _) = listener.accept().unwrap();
        client.read_exact(&mut [0; 14]).unwrap();
        client.write_all(description("u-1", "plate-1", 1).as_bytes()).unwrap();
    });
    let settings =
        LslLineSettings { address, source_id: Some("plate-2".to_owned()), ..LslLineSettings::default() };
    let line = Box::new(LslLine::new(settings));
    let source = GroundSource::open(line, Box::new(plan("Fz")), GroundSettings::default()).unwrap();
    let why = source.diagnostic().unwrap();
    assert!(why.contains("source \"plate-1\"") && why.contains("[ground.lsl]"), "{why}");
    played.join().unwrap();
}

/// A process that is terminated with the test.
struct Guard(Child);

impl Drop for Guard {
    fn drop(&mut self) {
        let _ended_already = self.0.kill();
        let _ended_already = self.0.wait();
    }
}

/// With an outlet of liblsl itself, through Python; `.ci/lsl` installs it and sets its path.
#[test]
#[ignore = "needs pylsl, which .ci/lsl installs"]
fn an_outlet_of_liblsl_itself_is_found_and_read_in_every_format() {
    let python = std::env::var("LSL_PYTHON").unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../.ci/lsl.py");
    for format in ["float32", "double64", "int16", "int32", "int64", "int8"] {
        let mut outlet = Command::new(&python);
        outlet.arg(&script).arg(format).stdout(Stdio::piped());
        let mut outlet = Guard(outlet.spawn().unwrap());
        let mut line = String::new();
        BufReader::new(outlet.0.stdout.take().unwrap()).read_line(&mut line).unwrap();
        assert_eq!(line.trim(), "ready");
        let settings =
            LslLineSettings { source_id: Some(format!("plate-{format}")), ..LslLineSettings::default() };
        let [fx, fy, fz, mx, my, mz] = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"].map(|name| Some(name.to_owned()));
        let plan = Plan::Direct { force: [fx, fy, fz], moment: [mx, my, mz] };
        let device = Lsl::new(LslSettings { plan, force_unit: None, moment_unit: None });
        let line = Box::new(LslLine::new(settings));
        let mut source = GroundSource::open(line, Box::new(device), GroundSettings::default()).unwrap();
        let samples = until(&mut source, |_, samples| samples.len() >= 500);
        assert_eq!(source.counts().refused.iter().sum::<u64>(), 0, "{:?}", source.counts());
        for pair in samples.windows(2) {
            // Fx counts the samples modulo 100; the measured force on the sensor is the negative of the ground's.
            assert_eq!(-pair[1].force_n[0], (-pair[0].force_n[0] + 1.0) % 100.0);
            // Samples before the first clock fit have their arrival as time, marked by their σ: the first fitted time
            // may be earlier.
            let is_dated = pair[0].sample_time_sigma_ns < u64::MAX;
            assert!(!is_dated || pair[1].sample_time_ns >= pair[0].sample_time_ns, "{pair:?}");
        }
        let last = samples.last().unwrap();
        assert_eq!((last.force_n[1], last.force_n[2]), (2.0, -120.0), "{format}");
        let want = [-0.004, 0.005, -0.006];
        assert!(
            last.moment_nm.iter().zip(want).all(|(got, want)| (got - want).abs() < 1e-12),
            "{:?}",
            last.moment_nm
        );
        println!("{format}: {} samples, sigma {} ns", samples.len(), last.sample_time_sigma_ns);
        // The outlet disappears, and returns as another outlet of the same device.
        drop(outlet);
        until(&mut source, |source, _| source.diagnostic().is_some());
    }
}
