//! The page over a real socket: responses to a browser, a script and an attacker.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use equipoise_core::message::state::Phase;
use equipoise_core::message::{State, Validity};
use equipoise_view::page::{LiftResult, SimulatedHuman};
use equipoise_view::{Page, PageError, PageFrame};

use crate::assert_memory_bounded;

const ANY_PORT: ([u8; 4], u16) = ([127, 0, 0, 1], 0);
/// Long enough for a loaded machine; no test here measures speed.
const TIMEOUT: Duration = Duration::from_secs(90);

fn state(cycle: u64) -> State {
    let mut state = State::zeroed();
    state.cycle = cycle;
    state.time_ns = 33_000_000 * cycle;
    state.phase = Phase::Identifying as u32;
    state.valid = Validity::NOT_IDENTIFIED.0;
    state.suit_sample_time_ns = 1;
    // Numbers with many digits, as in practice: a frame is a few kilobytes.
    state.segment_origin_m = [[1.0 / 3.0, 2.0 / 3.0, 1.0 / 7.0]; 23];
    state
}

fn running() -> Page {
    let mut cycle = 0;
    Page::start(SocketAddr::from(ANY_PORT), move || {
        cycle += 1;
        Some(PageFrame::new(state(cycle)))
    })
    .unwrap()
}

fn ask(page: &Page, path: &str, host: &str) -> TcpStream {
    let mut stream = TcpStream::connect(page.address()).unwrap();
    stream.set_read_timeout(Some(TIMEOUT)).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
    stream
}

fn answer(page: &Page, path: &str, host: &str) -> String {
    let mut text = String::new();
    ask(page, path, host).read_to_string(&mut text).unwrap();
    text
}

/// The next event of a stream: its name and its data.
fn next_event(reader: &mut impl BufRead) -> (String, serde_json::Value) {
    let mut name = String::new();
    for line in reader.lines().map(Result::unwrap) {
        if let Some(event) = line.strip_prefix("event: ") {
            name = event.to_owned();
        } else if let Some(data) = line.strip_prefix("data: ") {
            return (name, serde_json::from_str(data).unwrap());
        }
    }
    panic!("the stream ended");
}

fn events(page: &Page) -> BufReader<TcpStream> {
    BufReader::new(ask(page, "/events", "localhost"))
}

fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    let deadline = Instant::now() + TIMEOUT;
    while !holds() {
        assert!(Instant::now() < deadline, "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn the_page_and_all_it_needs_come_from_here() {
    let page = running();
    let index = answer(&page, "/", "127.0.0.1");
    assert!(index.starts_with("HTTP/1.1 200"), "{index}");
    assert!(index.contains("content-security-policy: default-src 'none'; script-src 'self'"), "{index}");
    assert!(index.contains("Not a medical device, not a safety function"));
    assert!(!index.contains("https://"), "nothing is fetched from elsewhere");
    for path in ["/worker.js", "/worker.css", "/icon.svg", "/libraries", "/healthz"] {
        assert!(answer(&page, path, "localhost:1").starts_with("HTTP/1.1 200"), "{path}");
    }
    let nothing = answer(&page, "/nothing", "localhost");
    assert!(nothing.starts_with("HTTP/1.1 404") && nothing.contains("Worker's page: /"), "{nothing}");
    page.stop();
}

#[test]
fn files_are_compressed_and_sent_once() {
    let page = running();
    let request = |path: &str, header: &str| {
        let mut stream = TcpStream::connect(page.address()).unwrap();
        stream.set_read_timeout(Some(TIMEOUT)).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{header}\r\n")
            .unwrap();
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).unwrap();
        let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
        let body = bytes.split_off(end + 4);
        (String::from_utf8(bytes).unwrap(), body)
    };
    let (head, plain) = request("/worker.js", "");
    assert!(
        !head.contains("content-encoding") && head.contains("cache-control: private, no-cache"),
        "{head}"
    );
    let (head, packed) = request("/worker.js", "Accept-Encoding: br, gzip\r\n");
    assert!(head.contains("content-encoding: gzip") && head.contains("vary: accept-encoding"), "{head}");
    assert!(packed.starts_with(&[0x1f, 0x8b]) && 3 * packed.len() < plain.len(), "{} bytes", packed.len());
    let tag = head.lines().find_map(|line| line.strip_prefix("etag: ")).unwrap();
    let (head, body) = request("/worker.js", &format!("If-None-Match: {tag}\r\n"));
    assert!(head.starts_with("HTTP/1.1 304") && body.is_empty(), "{head}");
    let (head, _) = request("/worker.css", &format!("If-None-Match: {tag}\r\n"));
    assert!(head.starts_with("HTTP/1.1 200"), "each file has its own tag: {head}");
    assert!(request("/api/state", "").0.contains("cache-control: no-store"));
    page.stop();
}

#[test]
fn the_newest_state_is_there_for_scripts() {
    let page = running();
    let mut text = String::new();
    wait_until("a state", || {
        text = answer(&page, "/api/state", "localhost");
        text.starts_with("HTTP/1.1 200")
    });
    let (_, body) = text.split_once("\r\n\r\n").unwrap();
    let json: serde_json::Value = serde_json::from_str(body).unwrap();
    assert_eq!(json["phase"], "identifying");
    assert_eq!(json["valid"], serde_json::json!(["not_identified"]));
    page.stop();
}

#[test]
fn a_late_joiner_gets_a_frame_and_then_newer_ones() {
    let page = running();
    wait_until("a state", || answer(&page, "/api/state", "localhost").starts_with("HTTP/1.1 200"));
    let mut events = events(&page);
    let (name, first) = next_event(&mut events);
    assert_eq!((name.as_str(), &first["phase"]), ("frame", &"Calibration".into()));
    assert_eq!(first["segment_origin_m"].as_array().map(Vec::len), Some(23));
    let (_, second) = next_event(&mut events);
    assert!(second["state"]["cycle"].as_u64() > first["state"]["cycle"].as_u64());
    page.stop();
}

#[test]
fn the_last_event_of_a_demonstration_has_its_results() {
    let mut page = running();
    assert_eq!(page.streams_opened(), 0);
    let mut viewers = [events(&page), BufReader::new(ask(&page, "/events?hz=2", "localhost"))];
    for viewer in &mut viewers {
        next_event(viewer);
    }
    assert_eq!(page.streams_opened(), 2);
    let human = SimulatedHuman { height_m: 1.77, mass_kg: 72.0, box_kg: Some(4.0) };
    page.end(&[LiftResult {
        human,
        load_kg: 4.25,
        load_sigma_kg: 0.5,
        joint: "LeftElbow",
        level: "green",
        torque_nm: 6.0,
        torque_sigma_nm: 1.0,
    }]);
    for mut viewer in viewers {
        let (mut name, mut data) = next_event(&mut viewer);
        while name != "ended" {
            (name, data) = next_event(&mut viewer);
        }
        let result = &data["results"][0];
        assert_eq!((&result["load_kg"], &result["human"]["box_kg"]), (&4.25.into(), &4.0.into()), "{data}");
        let mut rest = String::new();
        viewer.read_to_string(&mut rest).unwrap();
        assert!(!rest.contains("event:"), "{rest}");
    }
}

#[test]
fn a_state_that_does_not_change_any_more_is_not_shown_any_more() {
    let page = Page::start(SocketAddr::from(ANY_PORT), || Some(PageFrame::new(state(1)))).unwrap();
    let mut events = events(&page);
    let mut names = Vec::new();
    while names.last().map(String::as_str) != Some("silent") || !names.iter().any(|name| name == "frame") {
        names.push(next_event(&mut events).0);
    }
    assert!(answer(&page, "/api/state", "localhost").starts_with("HTTP/1.1 503"));
    page.stop();
}

#[test]
fn a_client_that_stops_reading_misses_frames_instead_of_falling_behind() {
    let page = running();
    let socket = socket2::Socket::new(socket2::Domain::IPV4, socket2::Type::STREAM, None).unwrap();
    // With a small receive window, three seconds of frames do not fit between server and client.
    socket.set_recv_buffer_size(4096).unwrap();
    socket.connect(&page.address().into()).unwrap();
    let mut stream = TcpStream::from(socket);
    stream.set_read_timeout(Some(TIMEOUT)).unwrap();
    write!(stream, "GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    std::thread::sleep(Duration::from_secs(4));
    let mut slow = BufReader::new(stream);
    let (mut last, mut widest_gap) = (None, 0);
    for _ in 0..60 {
        let (name, event) = next_event(&mut slow);
        if name == "frame" {
            let cycle = event["state"]["cycle"].as_u64().unwrap();
            widest_gap = widest_gap.max(last.map_or(0, |last| cycle - last));
            last = Some(cycle);
        }
    }
    assert!(widest_gap > 20, "{widest_gap} frames were missed at once");
    assert_memory_bounded();
    page.stop();
}

#[test]
fn a_foreign_host_is_refused_everywhere() {
    let page = running();
    for path in ["/", "/events", "/api/state", "/healthz", "/nothing"] {
        for host in ["evil.example", "127.0.0.1.evil.example", "192.168.1.2:8017"] {
            let text = answer(&page, path, host);
            assert!(text.starts_with("HTTP/1.1 403"), "{path} {host}: {text}");
        }
    }
    page.stop();
}

#[test]
fn nothing_can_be_written_to_it() {
    let page = running();
    let mut stream = TcpStream::connect(page.address()).unwrap();
    write!(
        stream,
        "POST /api/state HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
    )
    .unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    assert!(text.starts_with("HTTP/1.1 405"), "{text}");
    page.stop();
}

#[test]
fn a_taken_port_is_said_in_one_sentence() {
    let page = running();
    let error = Page::start(page.address(), || None).unwrap_err();
    assert!(matches!(error, PageError::PortTaken { .. }));
    let sentence = error.to_string();
    assert!(sentence.contains(&page.address().to_string()) && sentence.contains("taken"), "{sentence}");
    page.stop();
}

#[test]
fn other_machines_are_refused() {
    for listen in ["0.0.0.0:0", "192.168.1.5:8017", "[::]:0"] {
        let error = Page::start(listen.parse().unwrap(), || None).unwrap_err();
        assert!(matches!(error, PageError::NotLoopback { .. }), "{listen}");
    }
}

#[test]
fn stopping_ends_open_streams_and_frees_the_port() {
    let page = running();
    let address = page.address();
    let mut events = events(&page);
    next_event(&mut events);
    assert!(page.is_running());
    page.stop();
    let mut rest = Vec::new();
    events.read_to_end(&mut rest).unwrap();
    Page::start(address, || None).unwrap().stop();
}

#[test]
fn a_panic_of_the_feed_ends_the_page() {
    let any_port = SocketAddr::from(ANY_PORT);
    let station = Page::start(any_port, || panic!("of the test")).unwrap();
    let mut calls = 0;
    let feed = move || {
        calls += 1;
        assert!(calls < 3, "of the test");
        "[]".to_owned()
    };
    let stations = Page::start_overview(any_port, None, feed).unwrap();
    wait_until("the page of a station ends", || !station.is_running());
    wait_until("the page of several stations ends", || !stations.is_running());
}
