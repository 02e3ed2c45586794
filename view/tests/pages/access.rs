//! Access control and resource limits, over real sockets.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use bytemuck::Zeroable;
use equipoise_core::message::State;
use equipoise_view::{Page, PageError, PageFrame, Token};

use crate::assert_memory_bounded;

const SECRET: &str = "0123456789abcdefghijklmnopqrstuv";
/// All paths.
const PATHS: [&str; 9] = [
    "/",
    "/events",
    "/api/state",
    "/healthz",
    "/nothing",
    "/worker.js",
    "/worker.css",
    "/libraries",
    "/icon.svg",
];

fn page(listen: &str, token: Option<Token>) -> Page {
    let mut state = State::zeroed();
    let feed = move || {
        state.cycle += 1;
        Some(PageFrame::new(state))
    };
    Page::start_for(listen.parse().unwrap(), token, feed).unwrap()
}

fn guarded() -> Page {
    // All addresses with port 0: reachable by other machines; the test connects over loopback.
    page("0.0.0.0:0", Token::new(SECRET))
}

fn connect(page: &Page) -> TcpStream {
    let stream = TcpStream::connect(SocketAddr::from(([127, 0, 0, 1], page.address().port()))).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    stream
}

/// Sends a request, which must end with an empty line, and returns the response.
fn response(page: &Page, request: &str) -> String {
    let mut stream = connect(page);
    // The server may already have closed the connection after refusing the request.
    let _ = stream.write_all(request.as_bytes());
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    String::from_utf8_lossy(&answer).into_owned()
}

fn get(page: &Page, target: &str, headers: &str) -> String {
    response(
        page,
        &format!("GET {target} HTTP/1.1\r\nHost: station-pc:8080\r\nConnection: close\r\n{headers}\r\n"),
    )
}

fn status(answer: &str) -> u16 {
    answer.split(' ').nth(1).and_then(|code| code.parse().ok()).unwrap_or(0)
}

#[test]
fn beyond_loopback_nothing_is_served_without_the_token() {
    let Err(PageError::NotLoopback { .. }) = Page::start("0.0.0.0:0".parse().unwrap(), || None) else {
        panic!("served to everybody");
    };
    let page = guarded();
    let half = &SECRET[..31];
    for target in PATHS {
        for headers in [
            String::new(),
            format!("Authorization: Bearer {half}\r\n"),
            format!("Authorization: Basic {SECRET}\r\n"),
            format!("Cookie: equipoise_page_{}={SECRET}\r\n", page.address().port()),
            format!("Cookie: equipoise_page_1={}\r\n", cookie(&page).1),
        ] {
            let answer = get(&page, target, &headers);
            assert_eq!(status(&answer), 401, "{target} {headers}: {answer}");
            assert!(answer.contains("www-authenticate: Bearer"), "{answer}");
        }
    }
    // The token in a URL is accepted for `/` only, and only complete.
    for target in [
        format!("/events?token={SECRET}"),
        format!("/api/state?token={SECRET}"),
        format!("/?token={half}"),
        "/?token=".to_owned(),
        format!("/?nottoken={SECRET}"),
    ] {
        assert_eq!(status(&get(&page, &target, "")), 401, "{target}");
    }
    for wrong in [get(&page, "/engineer?token=wrong", ""), get(&page, "/", "Authorization: Bearer wrong\r\n")]
    {
        assert!(wrong.contains("The token is wrong"), "{wrong}");
    }
    assert!(get(&page, &format!("/engineer?token={SECRET}"), "").contains("url=/engineer"));
    page.stop();
}

/// Name and value of the cookie that replaces the token.
fn cookie(page: &Page) -> (String, String) {
    let answer = get(page, &format!("/?token={SECRET}"), "");
    assert_eq!(status(&answer), 200, "{answer}");
    let line = answer.lines().find_map(|line| line.strip_prefix("set-cookie: ")).unwrap();
    assert!(line.contains("; HttpOnly") && line.contains("; SameSite=Strict"), "{line}");
    let (name, rest) = line.split_once('=').unwrap();
    (name.to_owned(), rest.split(';').next().unwrap().to_owned())
}

#[test]
fn the_token_opens_everything_as_a_header_or_once_in_the_address() {
    let page = guarded();
    let bearer = format!("Authorization: Bearer {SECRET}\r\n");
    let (name, value) = cookie(&page);
    assert!(!value.contains(SECRET), "the browser keeps something else than the token");
    let cookies = format!("Cookie: other=1; {name}={value}\r\n");
    for headers in [&bearer, &cookies] {
        for target in ["/", "/worker.js", "/healthz"] {
            assert_eq!(status(&get(&page, target, headers)), 200, "{target} {headers}");
        }
        let mut stream = connect(&page);
        write!(stream, "GET /events HTTP/1.1\r\nHost: x\r\n{headers}\r\n").unwrap();
        let mut first = [0; 15];
        stream.read_exact(&mut first).unwrap();
        assert_eq!(&first, b"HTTP/1.1 200 OK");
    }
    page.stop();
}

#[test]
fn on_loopback_the_token_and_the_host_must_both_be_right() {
    let page = page("127.0.0.1:0", Token::new(SECRET));
    let bearer = format!("Authorization: Bearer {SECRET}\r\n");
    let ask = |host: &str, headers: &str| {
        status(&response(
            &page,
            &format!("GET / HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{headers}\r\n"),
        ))
    };
    assert_eq!(ask("localhost", &bearer), 200);
    assert_eq!(ask("localhost", ""), 401);
    assert_eq!(ask("evil.example", &bearer), 403);
    page.stop();
}

#[test]
fn what_is_too_long_too_many_or_has_a_body_is_refused() {
    let page = page("127.0.0.1:0", None);
    let ask = |target: &str, headers: &str, body: &str| {
        status(&response(
            &page,
            &format!("GET {target} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{headers}\r\n{body}"),
        ))
    };
    assert_eq!(ask("/healthz", "", ""), 200);
    assert_eq!(ask(&format!("/healthz?{}", "a".repeat(2000)), "", ""), 414);
    assert_eq!(ask("/healthz", "Content-Length: 5\r\n", "12345"), 413);
    assert_eq!(ask("/healthz", "Transfer-Encoding: chunked\r\n", "5\r\n12345\r\n0\r\n\r\n"), 413);
    assert_eq!(ask("/healthz", &"X-Many: 1\r\n".repeat(60), ""), 200);
    assert_eq!(ask("/healthz", &"X-Many: 1\r\n".repeat(80), ""), 431);
    let long = format!("X-Long: {}\r\n", "a".repeat(40_000));
    assert_eq!(ask("/healthz", &long, ""), 431);
    assert_memory_bounded();
    page.stop();
}

#[test]
fn no_more_connections_are_held_than_there_are_places() {
    let page = page("127.0.0.1:0", None);
    let healthz = "GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n";
    let ask = |stream: &mut TcpStream| {
        stream.write_all(healthz.as_bytes()).unwrap();
        let mut first = [0; 12];
        stream.read_exact(&mut first).map(|()| String::from_utf8_lossy(&first).into_owned())
    };
    // Each connection is served, so it occupies a place.
    let mut held: Vec<TcpStream> = (0..64).map(|_| connect(&page)).collect();
    for stream in &mut held {
        assert_eq!(ask(stream).unwrap(), "HTTP/1.1 200");
    }
    let mut refused = connect(&page);
    let mut answer = String::new();
    refused.read_to_string(&mut answer).unwrap();
    assert_eq!(status(&answer), 503, "{answer}");
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    assert!(head.contains(&format!("Content-Length: {}", body.len())), "{answer}");
    // Closing one frees its place for another.
    drop(held.pop());
    let taken = (0..200).any(|_| {
        std::thread::sleep(Duration::from_millis(20));
        // A refused connection may be closed before the request is sent.
        let (mut next, mut first) = (connect(&page), [0; 12]);
        let asked = next.write_all(healthz.as_bytes()).and_then(|()| next.read_exact(&mut first));
        asked.is_ok() && &first == b"HTTP/1.1 200"
    });
    assert!(taken);
    assert_memory_bounded();
    page.stop();
}

#[test]
fn a_connection_that_asks_for_nothing_is_closed() {
    let page = page("127.0.0.1:0", None);
    let mut silent = connect(&page);
    let mut slow = connect(&page);
    slow.write_all(b"GET /healthz HTTP/1.1\r\nHost: local").unwrap();
    // A connection that was served once and then stays idle.
    let mut idle = connect(&page);
    idle.write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    for stream in [&mut silent, &mut slow, &mut idle] {
        let mut rest = Vec::new();
        // The server closes the stream well before the test's read time-out.
        stream.read_to_end(&mut rest).unwrap();
    }
    assert_memory_bounded();
    page.stop();
}
