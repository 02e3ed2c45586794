//! The engineer's routes over a real socket: facts for viewers, commands for token holders.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytemuck::Zeroable;
use equipoise_core::message::State;
use equipoise_view::page::{Engineer, Page, PageCommand, PageFrame, Station, Token};

const VIEWING: &str = "viewing-0123456789abcdefghijklmn";
const COMMANDING: &str = "commanding-0123456789abcdefghijk";

/// A station that counts calls and records commands.
#[derive(Default)]
struct MockStation {
    asked_for_facts: AtomicU32,
    commands: Mutex<Vec<PageCommand>>,
    /// Current and maximum number of concurrent reads of the report.
    reading: AtomicU32,
    reading_max: AtomicU32,
    /// Why the profiles cannot be listed.
    unlisted: Mutex<Option<String>>,
}

impl Station for MockStation {
    fn facts(&self) -> String {
        format!("{{\"asked\":{}}}", self.asked_for_facts.fetch_add(1, Ordering::SeqCst))
    }

    fn history(&self) -> String {
        "{\"t\":[]}".to_owned()
    }

    fn report(&self) -> Option<String> {
        let reading = 1 + self.reading.fetch_add(1, Ordering::SeqCst);
        self.reading_max.fetch_max(reading, Ordering::SeqCst);
        std::thread::sleep(Duration::from_millis(50));
        self.reading.fetch_sub(1, Ordering::SeqCst);
        Some("<style>p{}</style><p>what the model lacks".to_owned())
    }

    fn subjects(&self) -> Result<Vec<String>, String> {
        match &*self.unlisted.lock().unwrap() {
            Some(reason) => Err(reason.clone()),
            None => Ok(vec!["anon-1".to_owned(), "anon-2".to_owned()]),
        }
    }

    fn command(&self, command: &PageCommand) -> Result<String, String> {
        self.commands.lock().unwrap().push(command.clone());
        match command {
            PageCommand::Tare => Err("somebody stands on the plate".to_owned()),
            _ => Ok("done as asked".to_owned()),
        }
    }
}

fn page(viewing: Option<&str>, commanding: Option<&str>) -> (Page, Arc<MockStation>) {
    let station = Arc::new(MockStation::default());
    let command_token = commanding.map(|text| Token::new(text).unwrap());
    let engineer = Engineer { station: Arc::clone(&station) as _, command_token };
    let token = viewing.map(|text| Token::new(text).unwrap());
    let feed = || Some(PageFrame::new(State::zeroed()));
    (Page::start_with("127.0.0.1:0".parse().unwrap(), token, feed, Some(engineer)).unwrap(), station)
}

fn connect(page: &Page, request: &str) -> TcpStream {
    let mut stream = TcpStream::connect(page.address()).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(90))).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    stream
}

fn response_to(page: &Page, method: &str, target: &str, headers: &str) -> (u16, String) {
    let host = page.address();
    let request = format!("{method} {target} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{headers}\r\n");
    let mut answer = String::new();
    connect(page, &request).read_to_string(&mut answer).unwrap();
    (answer.split(' ').nth(1).unwrap().parse().unwrap(), answer)
}

fn with(token: &str) -> String {
    format!("X-Equipoise-Command: {token}\r\nContent-Length: 0\r\n")
}

#[test]
fn a_command_reaches_the_daemon_and_its_sentence_comes_back() {
    let (page, station) = page(None, Some(COMMANDING));
    let (status, answer) = response_to(&page, "POST", "/api/command/identify-start", &with(COMMANDING));
    assert!(status == 200 && answer.ends_with("done as asked"), "{answer}");
    let (status, answer) = response_to(&page, "POST", "/api/command/tare", &with(COMMANDING));
    assert!(status == 409 && answer.ends_with("somebody stands on the plate"), "{answer}");
    let (status, _) = response_to(&page, "POST", "/api/command/subject-load/anon-7", &with(COMMANDING));
    assert_eq!(status, 200);
    let asked = station.commands.lock().unwrap().clone();
    let load = PageCommand::SubjectLoad("anon-7".to_owned());
    assert_eq!(asked, [PageCommand::IdentifyStart, PageCommand::Tare, load]);
    page.stop();
}

#[test]
fn a_viewer_may_not_command() {
    let (page, station) = page(Some(VIEWING), Some(COMMANDING));
    let bearer = format!("Authorization: Bearer {VIEWING}\r\n");
    let target = "/api/command/identify-reset";
    for headers in [
        bearer.clone(),
        format!("{bearer}{}", with(VIEWING)),
        format!("{bearer}{}", with(&COMMANDING[..31])),
        format!("{bearer}{}", with("")),
        // The command token alone does not open the page, and counts in its own header only.
        with(COMMANDING),
        format!("Authorization: Bearer {COMMANDING}\r\n"),
    ] {
        let (status, answer) = response_to(&page, "POST", target, &headers);
        assert_eq!(status, 401, "{headers}: {answer}");
    }
    assert!(station.commands.lock().unwrap().is_empty());
    let (_, answer) = response_to(&page, "POST", target, &format!("{bearer}{}", with(VIEWING)));
    assert!(answer.ends_with("The command token is wrong.\n"), "{answer}");
    let (status, _) = response_to(&page, "POST", target, &format!("{bearer}{}", with(COMMANDING)));
    assert_eq!((status, station.commands.lock().unwrap().len()), (200, 1));
    page.stop();
}

#[test]
fn the_stored_workers_are_listed_for_the_command_token_only() {
    let (page, station) = page(None, Some(COMMANDING));
    let (status, answer) = response_to(&page, "GET", "/api/subjects", &with(COMMANDING));
    assert!(status == 200 && answer.ends_with(r#"["anon-1","anon-2"]"#), "{answer}");
    *station.unlisted.lock().unwrap() = Some("cannot read the profiles".to_owned());
    let (status, answer) = response_to(&page, "GET", "/api/subjects", &with(COMMANDING));
    assert!(status == 500 && answer.ends_with("cannot read the profiles"), "{answer}");
    assert_eq!(response_to(&page, "GET", "/api/subjects", &with(VIEWING)).0, 401);
    assert_eq!(response_to(&page, "GET", "/api/subjects", "").0, 401);
    page.stop();
}

#[test]
fn no_other_site_commands_even_with_the_token() {
    let (page, station) = page(None, Some(COMMANDING));
    let (own, target) = (page.address(), "/api/command/identify-start");
    for headers in [
        "Origin: http://evil.example\r\n".to_owned(),
        "Origin: null\r\n".to_owned(),
        format!("Origin: http://localhost:{}\r\n", own.port() + 1),
        "Sec-Fetch-Site: cross-site\r\n".to_owned(),
        "Sec-Fetch-Site: same-site\r\n".to_owned(),
    ] {
        let (status, answer) = response_to(&page, "POST", target, &format!("{headers}{}", with(COMMANDING)));
        assert_eq!(status, 403, "{headers}: {answer}");
    }
    // Preflight request of a browser before a custom header: nothing is permitted.
    let asks = "Origin: http://evil.example\r\nAccess-Control-Request-Method: POST\r\n\
                Access-Control-Request-Headers: x-equipoise-command\r\n";
    let (status, answer) = response_to(&page, "OPTIONS", target, asks);
    assert!(status == 405 && !answer.to_lowercase().contains("access-control-allow"), "{answer}");
    // Links and images use GET, forms send a body.
    assert_eq!(response_to(&page, "GET", target, &with(COMMANDING)).0, 405);
    let form = format!("X-Equipoise-Command: {COMMANDING}\r\nContent-Length: 3\r\n\r\na=1");
    assert_eq!(response_to(&page, "POST", target, &form).0, 413);
    assert!(station.commands.lock().unwrap().is_empty());
    let own_origin = format!("Origin: http://{own}\r\nSec-Fetch-Site: same-origin\r\n{}", with(COMMANDING));
    assert_eq!(response_to(&page, "POST", target, &own_origin).0, 200);
    page.stop();
}

#[test]
fn without_a_command_token_nothing_is_commanded_and_unknown_commands_are_not_there() {
    let (deaf, station) = page(None, None);
    assert_eq!(response_to(&deaf, "POST", "/api/command/identify-start", &with(COMMANDING)).0, 403);
    assert!(station.commands.lock().unwrap().is_empty());
    deaf.stop();
    let (page, station) = page(None, Some(COMMANDING));
    for target in ["subject-delete/anon-1", "reload", "subject-load", "subject-load/a.b", "tare/now"] {
        let (status, _) = response_to(&page, "POST", &format!("/api/command/{target}"), &with(COMMANDING));
        assert_eq!(status, 404, "{target}");
    }
    assert!(station.commands.lock().unwrap().is_empty());
    page.stop();
}

#[test]
fn facts_are_gathered_only_while_somebody_looks_and_a_late_joiner_gets_them_at_once() {
    let (page, station) = page(None, None);
    std::thread::sleep(Duration::from_millis(600));
    assert_eq!(station.asked_for_facts.load(Ordering::SeqCst), 0, "no viewer");
    let look = || {
        let request = format!("GET /events/station HTTP/1.1\r\nHost: {}\r\n\r\n", page.address());
        BufReader::new(connect(&page, &request))
            .lines()
            .map(Result::unwrap)
            .find(|line| line.starts_with("data: {\"asked\""))
            .unwrap()
    };
    assert_eq!(look(), "data: {\"asked\":0}");
    look();
    page.stop();
}

#[test]
fn the_page_its_history_and_the_report_are_served_under_rules_that_run_nothing() {
    let (page, _) = page(None, None);
    let (status, index) = response_to(&page, "GET", "/engineer", "");
    assert!(status == 200 && !index.contains("https://"), "{index}");
    assert!(response_to(&page, "GET", "/api/history", "").1.ends_with("{\"t\":[]}"));
    let (status, report) = response_to(&page, "GET", "/report", "");
    assert!(status == 200 && report.contains("what the model lacks"), "{report}");
    let policy = report.lines().find(|line| line.starts_with("content-security-policy")).unwrap();
    assert!(policy.contains("sandbox") && policy.contains("default-src 'none'"), "{policy}");
    assert!(!policy.contains("script-src"), "{policy}");
    page.stop();
}

#[test]
fn reads_of_the_report_are_not_concurrent() {
    let (page, station) = page(None, None);
    std::thread::scope(|scope| {
        let requests: Vec<_> =
            (0..8).map(|_| scope.spawn(|| response_to(&page, "GET", "/report", ""))).collect();
        for request in requests {
            let (status, report) = request.join().unwrap();
            assert!(status == 200 && report.contains("what the model lacks"), "{report}");
        }
    });
    assert_eq!(station.reading_max.load(Ordering::SeqCst), 1);
    page.stop();
}
