//! Kistler's LabAmp: requests over HTTP, stream over TCP, and reconnection after the stream ends.

use super::{PATIENCE, until};
use crossbeam_channel::{Receiver, Sender, bounded};
use equipoise_adapters::ground::GroundSettings;
use equipoise_adapters::ground::device::labamp::{LabAmp, LabAmpSettings};
use equipoise_adapters::ground::plan::Plan;
use equipoise_adapters::source::{GroundSource, LabAmpLine, LabAmpLineSettings};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

const CHANNELS: &str = r#"{"result": 0, "metadata": {"measurementId": 1, "signalProvider": {"name": "daq-provider",
    "samplingRate": 10000, "signals": [{"dataType": "FLOAT32", "source": "Sensor-1", "name": "Fz", "unit": "N", "offset": 0}]}}}"#;
const SCANS: u32 = 512;

/// One request: its path and body.
fn request(stream: &mut TcpStream) -> (String, String) {
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let (mut text, mut byte) = (Vec::new(), [0]);
    while !text.ends_with(b"\r\n\r\n") {
        stream.read_exact(&mut byte).unwrap();
        text.push(byte[0]);
    }
    let head = String::from_utf8(text).unwrap();
    let length =
        head.lines().find_map(|line| line.to_lowercase().strip_prefix("content-length: ")?.parse().ok());
    let mut body = vec![0; length.unwrap_or(0)];
    stream.read_exact(&mut body).unwrap();
    let path = head.split(' ').nth(1).unwrap().to_owned();
    assert!(head.starts_with("POST "), "{head}");
    (path, String::from_utf8(body).unwrap())
}

fn frame(kind: u16, sequence: u32, content: &[u8]) -> Vec<u8> {
    let size = content.len() as u32 + 16;
    [
        &1_u16.to_le_bytes()[..],
        &kind.to_le_bytes(),
        &size.to_le_bytes(),
        &sequence.to_le_bytes(),
        &[1, 0],
        &kind.to_le_bytes(),
        content,
    ]
    .concat()
}

/// Scans of -700 N, beginning at a time, ns.
fn data(sequence: u32, time_ns: u64) -> Vec<u8> {
    let stamp =
        [&(time_ns / 1_000_000_000).to_le_bytes()[..], &((time_ns % 1_000_000_000) as u32).to_le_bytes()]
            .concat();
    frame(1, sequence, &[stamp, (-700.0_f32).to_le_bytes().repeat(SCANS as usize)].concat())
}

/// Serves a stream: three frames, then the event that the measurement was stopped.
fn stream(listener: TcpListener, start: &Receiver<()>) {
    let (mut stream, _) = listener.accept().unwrap();
    start.recv_timeout(PATIENCE).unwrap();
    for index in 0..3 {
        let time_ns = 1_700_000_000_000_000_000 + u64::from(index * SCANS) * 100_000;
        stream.write_all(&data(index, time_ns)).unwrap();
    }
    stream.write_all(&frame(0, 3, &[2, 0, 4, 0])).unwrap();
    // Blocks until the client closes the connection.
    let _left = stream.read(&mut [0]);
}

/// The device: answers all requests until its second client leaves, and returns the requests.
fn device(listener: TcpListener, refusals: usize) -> Vec<String> {
    let (mut asked, mut streams, mut refusals) = (Vec::new(), 0, refusals);
    let mut start: Option<Sender<()>> = None;
    let mut serving = Vec::new();
    while let Ok((mut client, _)) = listener.accept() {
        let (path, body) = request(&mut client);
        let path = path.strip_prefix("/api/").unwrap().to_owned();
        let answer = match path.as_str() {
            "daq/measurement/metadata/get" => CHANNELS.to_owned(),
            "daq/stream/register" if refusals > 0 => {
                refusals -= 1;
                r#"{"result": 4, "error": {"message": "too many clients"}}"#.to_owned()
            }
            "daq/stream/register" => format!(r#"{{"result": 0, "clientId": "client-{streams}"}}"#),
            "daq/stream/open" => {
                assert!(body.contains(&format!("client-{streams}")), "{body}");
                let data = TcpListener::bind("127.0.0.1:0").unwrap();
                let port = data.local_addr().unwrap().port();
                let (begin, begun) = bounded(1);
                start = Some(begin);
                serving.push(std::thread::spawn(move || stream(data, &begun)));
                streams += 1;
                format!(r#"{{"result": 0, "port": {port}, "streamId": {streams}}}"#)
            }
            "daq/measurement/start" => {
                start.take().unwrap().send(()).unwrap();
                r#"{"result": 0}"#.to_owned()
            }
            _ => r#"{"result": 0}"#.to_owned(),
        };
        let head = format!(
            "HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
            answer.len()
        );
        client.write_all((head + &answer).as_bytes()).unwrap();
        let last = path == "daq/stream/unregister" && streams == 2;
        asked.push(path);
        if last {
            break;
        }
    }
    for stream in serving {
        stream.join().unwrap();
    }
    asked
}

#[test]
fn a_stream_is_asked_for_read_and_asked_for_again_when_somebody_stops_it() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let played = std::thread::spawn(move || device(listener, 1));
    let line = LabAmpLine::new(LabAmpLineSettings { address, rate_hz: Some(10_000), scans_per_frame: None });
    let plan = Plan::Direct { force: [None, None, Some("Fz".to_owned())], moment: [None, None, None] };
    let device = LabAmp::new(LabAmpSettings { plan, decimate: Some(16) });
    let mut source = GroundSource::open(Box::new(line), Box::new(device), GroundSettings::default()).unwrap();
    assert!(source.diagnostic().unwrap().contains("too many clients"), "{:?}", source.diagnostic());
    // Two streams of three frames of 32 means each.
    let samples = until(&mut source, |_, samples| samples.len() >= 192);
    assert_eq!((samples.len(), source.counts().lost), (192, 0));
    assert!(samples.iter().all(|sample| sample.force_n == [0.0, 0.0, 700.0] && sample.not_measured != 0));
    assert_eq!(
        (samples[95].session, samples[96].session),
        (0, 1),
        "the played clock restarts with the stream"
    );
    assert_eq!(source.health().block_latency_ns, 51_200_000);
    drop(source);
    let asked = played.join().unwrap();
    let opening = [
        "daq/measurement/enabled/set",
        "param/set",
        "daq/measurement/configuration/set",
        "daq/measurement/metadata/get",
        "daq/stream/register",
    ];
    let rest = ["daq/stream/open", "daq/measurement/start", "daq/stream/close", "daq/stream/unregister"];
    let want: Vec<&str> = [&opening[..], &opening, &rest, &opening, &rest].concat();
    assert_eq!(asked, want);
}

#[test]
fn a_device_that_is_off_or_another_one_is_said() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let settings = LabAmpLineSettings { address, rate_hz: None, scans_per_frame: None };
    let open = || {
        let plan = Plan::Direct { force: [None, None, Some("Fz".to_owned())], moment: [None, None, None] };
        let device = LabAmp::new(LabAmpSettings { plan, decimate: None });
        GroundSource::open(Box::new(LabAmpLine::new(settings)), Box::new(device), GroundSettings::default())
            .unwrap()
    };
    let printer = std::thread::spawn(move || {
        let (mut client, _) = listener.accept().unwrap();
        request(&mut client);
        client.write_all(b"HTTP/1.1 404 Not Found\r\nContent-Length: 14\r\n\r\n<html>?</html>").unwrap();
        std::thread::sleep(Duration::from_millis(1));
    });
    assert!(open().diagnostic().unwrap().contains("another device's web page"));
    printer.join().unwrap();
    assert!(open().diagnostic().unwrap().contains("is ground.address right?"));
}
