//! The page as a separate process: it outlives daemons, cannot harm one, and shows data to authorised clients only.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::time::{Duration, Instant};

use rustix::process::Signal;

use equipoise_simulator::ports::free_address;

use crate::process::{Process, TIMEOUT, wait_for};
use crate::shutdown::assert_nothing_left;
use crate::station::{NAME, Station};

const SECRET: &str = "0123456789abcdefghijklmnopqrstuv";

/// The page's process of a station, once it listens.
fn view(station: &Station, page: &str) -> Process {
    let mut view = try_view(station, page);
    wait_for("the page", || {
        assert!(view.is_running(), "it ended: {}", view.stderr());
        view.stderr().contains("page at").then_some(())
    });
    view
}

fn try_view(station: &Station, page: &str) -> Process {
    let path = station.write("view.toml", &format!("{}[page]\n{page}", station.configuration()));
    station.spawn(&["view", "--config", &path.to_string_lossy()])
}

/// Status and body of an answer; `None` if there is none.
fn get(address: SocketAddr, target: &str, headers: &str) -> Option<(u16, String)> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(TIMEOUT)).expect("a timeout");
    write!(stream, "GET {target} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{headers}\r\n").ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    let (head, body) = answer.split_once("\r\n\r\n")?;
    Some((head.split(' ').nth(1)?.parse().ok()?, body.to_owned()))
}

/// The next event of the engineer's page about the daemon and its sensors.
fn station_facts(address: SocketAddr) -> Option<serde_json::Value> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(TIMEOUT)).expect("a timeout");
    write!(stream, "GET /events/station HTTP/1.1\r\nHost: localhost\r\n\r\n").ok()?;
    let lines = BufReader::new(stream).lines();
    // The page sends `{}` until the data are gathered.
    lines.map_while(Result::ok).find_map(|line| {
        let facts: serde_json::Value = serde_json::from_str(line.strip_prefix("data: ")?).ok()?;
        facts.get("station").is_some().then_some(facts)
    })
}

/// Waits until the page shows a state, and returns its cycle.
fn until_live(address: SocketAddr) -> u64 {
    wait_for("a state on the page", || {
        let (status, body) = get(address, "/api/state", "")?;
        let state: serde_json::Value = serde_json::from_str(&body).ok()?;
        (status == 200).then(|| state["cycle"].as_u64()).flatten()
    })
}

fn until_silent(address: SocketAddr) {
    wait_for("the page to say that the service is silent", || {
        (get(address, "/api/state", "")?.0 == 503).then_some(())
    });
}

#[test]
fn it_waits_for_a_daemon_and_continues_without_it() {
    let station = Station::new();
    let address = free_address().expect("a free port");
    let mut view = view(&station, &format!("listen = \"{address}\"\n"));
    until_silent(address);
    assert_eq!(get(address, "/healthz", "").expect("the page").0, 200);

    let mut daemon = station.daemon(&station.configuration());
    until_live(address);
    let status = station.current_status();
    assert_eq!(status["page"]["url"], format!("http://{address}/"));
    assert_eq!(status["page"]["process_id"], view.id());
    assert!(station.run(&["status"]).assert_done().contains(&format!("page http://{address}/")));

    let all_is_known = |facts: &serde_json::Value| {
        facts["incidents"].is_array()
            && facts["daemon"].is_object()
            && facts["adapters"][0].is_object()
            && facts["latency"]["cycles"].as_u64() > Some(0)
            && facts["latency_span_s"].as_f64() > Some(0.0)
    };
    wait_for("the station's facts", || station_facts(address).filter(all_is_known));

    daemon.kill();
    until_silent(address);
    // The last data of a dead daemon must not be shown as current.
    wait_for("nothing to be known of it", || {
        let facts = station_facts(address)?;
        (facts["incidents"].is_null() && facts["daemon"].is_null()).then_some(())
    });
    let mut daemon = station.daemon(&station.configuration());
    until_live(address);
    // An open connection does not delay its end, and the daemon is unaffected.
    let _browser = TcpStream::connect(address).expect("the page");
    assert_eq!(view.stop(Signal::TERM), Some(0), "{}", view.stderr());
    assert!(station.current_status()["page"].is_null());
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
    assert_nothing_left(&station);
}

#[test]
fn workers_that_cannot_be_listed_are_an_error_with_the_reason() {
    let station = Station::new();
    let token = station.write("command.token", SECRET);
    std::fs::set_permissions(&token, std::fs::Permissions::from_mode(0o600)).expect("a secret");
    let address = free_address().expect("a free port");
    let page = format!("listen = \"{address}\"\ncommand_token_file = \"command.token\"\n");
    let mut view = view(&station, &page);
    let subjects = || {
        let header = format!("X-Equipoise-Command: {SECRET}\r\n");
        get(address, "/api/subjects", &header).expect("an answer")
    };
    assert_eq!(subjects(), (200, "[]".to_owned()));
    let folder = station.state_directory().join("subjects");
    std::fs::create_dir_all(station.state_directory()).expect("a folder");
    std::fs::write(&folder, "a file where a folder should be").expect("a file");
    let (status, reason) = subjects();
    let names_folder = reason.contains(&folder.display().to_string());
    assert!(status == 500 && names_folder && reason.contains("Not a directory"), "{status}: {reason}");
    assert_eq!(view.stop(Signal::TERM), Some(0));
}

#[test]
fn it_reports_the_latency_of_its_states() {
    let station = Station::new();
    let address = free_address().expect("a free port");
    let _daemon = station.daemon(&station.configuration());
    let _view = view(&station, &format!("listen = \"{address}\"\n"));
    until_live(address);
    wait_for("the page among the consumers, which looks 60 times a second", || {
        let ended = station.run(&["latency", "--station", NAME, "--for", "3", "--json"]);
        let report: serde_json::Value = serde_json::from_str(&ended.stdout).ok()?;
        let consumers = report["consumers"].as_array()?;
        let page = consumers.iter().find(|one| one["consumer"] == "view")?;
        (page["states"].as_u64() > Some(10) && page["states_missed"].as_u64() > Some(10)).then_some(())
    });
}

#[test]
fn a_killed_page_is_not_in_the_status() {
    let station = Station::new();
    let address = free_address().expect("a free port");
    let _daemon = station.daemon(&station.configuration());
    let mut view = view(&station, &format!("listen = \"{address}\"\n"));
    wait_for("the page in the status", || station.status().filter(|status| status["page"].is_object()));
    view.kill();
    assert!(station.current_status()["page"].is_null());
}

#[test]
fn a_bus_that_was_removed_and_created_again_is_joined() {
    let station = Station::new();
    let address = free_address().expect("a free port");
    let mut daemon = station.daemon(&station.configuration());
    let mut view = view(&station, &format!("listen = \"{address}\"\n"));
    wait_for("some cycles", || Some(until_live(address)).filter(|cycle| *cycle > 300));
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
    let stopped = Instant::now();
    std::fs::remove_dir_all(station.root()).expect("the bus");
    let _daemon = station.daemon(&station.configuration());
    // The page shows data of the last second only, so what is live after two belongs to the new daemon. Its cycles do not
    // tell: on a busy machine it may have more than the old one had before the page joins it.
    wait_for("a state of the new daemon", || {
        let is_of_new = stopped.elapsed() > Duration::from_secs(2);
        until_live(address);
        is_of_new.then_some(())
    });
    assert_eq!(view.stop(Signal::TERM), Some(0), "{}", view.stderr());
}

#[test]
fn the_daemon_itself_listens_on_no_page() {
    let station = Station::new();
    let address = free_address().expect("a free port");
    let daemon = station.daemon(&format!("{}[page]\nlisten = \"{address}\"\n", station.configuration()));
    let _ours = TcpListener::bind(address).expect("a free port");
    assert!(!daemon.stderr().contains(&address.to_string()));
}

#[test]
fn configuration_errors_are_reported_with_their_key() {
    let station = Station::new();
    let occupied = TcpListener::bind(free_address().expect("a free port")).expect("the port");
    let address = occupied.local_addr().expect("its address").to_string();
    let refused = |page: &str, parts: &[&str]| {
        let mut view = try_view(&station, page);
        assert_eq!(view.wait().code(), Some(1));
        let message = view.stderr();
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
        assert!(!message.contains("panicked") && !message.contains(SECRET), "{message}");
    };
    refused(&format!("listen = \"{address}\"\n"), &["page.listen", &address, "taken"]);
    // `check` refuses the same tokens, before any process is started.
    let checked = |page: &str| {
        let text = format!("{}[page]\n{page}", station.configuration());
        let path = station.write("checked.toml", &text).display().to_string();
        station.run(&["check", &path])
    };
    let refused = |page: &str, parts: &[&str]| {
        refused(page, parts);
        let check = checked(page);
        check.assert_failed(1, parts);
        assert!(!check.stderr.contains(SECRET), "{}", check.stderr);
    };
    refused("listen = \"127.0.0.1:0\"\ntoken_file = \"no.token\"\n", &["page.token_file", "no.token"]);
    let token = station.write("page.token", SECRET);
    let guarded = "listen = \"127.0.0.1:0\"\ntoken_file = \"page.token\"\n";
    std::fs::set_permissions(&token, PermissionsExt::from_mode(0o644)).expect("permissions");
    refused(guarded, &["page.token", "mode 0644", "chmod 0640"]);
    std::fs::set_permissions(&token, PermissionsExt::from_mode(0o640)).expect("permissions");
    refused(
        &format!("{guarded}command_token_file = \"page.token\"\n"),
        &["page.command_token_file", "another"],
    );
    checked(guarded).assert_done();
    std::os::unix::fs::symlink(&token, station.file("link.token")).expect("a link");
    refused(&guarded.replace("page.token", "link.token"), &["link.token", "a symbolic link"]);
    std::fs::write(&token, &SECRET[..31]).expect("a token");
    refused(guarded, &["page.token", "32 to 256"]);

    let path = station.write("none.toml", &station.configuration()).display().to_string();
    station.run(&["view", "--config", &path]).assert_failed(1, &["none.toml has no [page]"]);
}

#[test]
fn a_page_for_the_whole_network_needs_a_token() {
    let station = Station::new();
    for everybody in ["0.0.0.0:8017", "[::]:8017", "192.168.1.2:8017"] {
        let text = format!("{}[page]\nlisten = \"{everybody}\"\n", station.configuration());
        let line = text.lines().count();
        let path = station.write("page.toml", &text).display().to_string();
        let place = format!("{path}, line {line}: page.listen");
        for command in
            [&["check", path.as_str()][..], &["run", "--config", &path], &["view", "--config", &path]]
        {
            station.run(command).assert_failed(1, &[&place, "loopback only", "SSH tunnel", "token_file"]);
        }
    }
}

#[test]
fn the_token_opens_the_page_and_is_not_published() {
    let station = Station::new();
    let token = station.file("page.token");
    let made = station.run(&["token", "--out", &token.display().to_string()]);
    assert!(made.assert_done().contains("page.token holds a new token"));
    let mode = std::fs::metadata(&token).expect("the token").permissions().mode() & 0o777;
    assert_eq!(mode & !0o640, 0, "{mode:o}");
    let secret = std::fs::read_to_string(&token).expect("the token").trim().to_owned();
    assert_eq!(secret.len(), 64);
    station
        .run(&["token", "--out", &token.display().to_string()])
        .assert_failed(1, &["page.token", "exists"]);
    assert_ne!(station.run(&["token"]).assert_done(), station.run(&["token"]).assert_done());

    let port = free_address().expect("a free port").port();
    let page = format!("listen = \"0.0.0.0:{port}\"\ntoken_file = \"page.token\"\n");
    let mut daemon = station.daemon(&format!("{}[page]\n{page}", station.configuration()));
    let mut view = view(&station, &page);
    wait_for("the word about it", || {
        view.stderr().contains("reachable from other machines; every request needs the token").then_some(())
    });
    let address = SocketAddr::from(([127, 0, 0, 1], port));
    assert_eq!(get(address, "/", "").expect("an answer").0, 401);
    assert_eq!(get(address, &format!("/?token={secret}"), "").expect("an answer").0, 200);
    let bearer = format!("Authorization: Bearer {secret}\r\n");
    assert_eq!(get(address, "/healthz", &bearer).expect("an answer").0, 200);

    // The page listens before it has joined the bus, which is where the status looks for it.
    let status = station.run_until("the page in the status", &["status", "--json"], |ended| {
        ended.stdout.contains("\"needs_token\": true")
    });
    let status = status.assert_done().to_owned();
    assert!(status.contains("page.token"), "{status}");
    let recording = station.file("a.mcap");
    let recorded = station.run(&["record", &recording.display().to_string(), "--for", "3"]);
    assert!(matches!(recorded.code, Some(0 | 3)), "{}", recorded.stderr);
    let reader_screen =
        station.run(&["check", &station.file("view.toml").display().to_string()]).assert_done().to_owned();
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
    assert_eq!(view.stop(Signal::TERM), Some(0));
    let recorded = std::fs::read(&recording).expect("the recording");
    for (place, facts) in [
        ("status", status.as_bytes()),
        ("check", reader_screen.as_bytes()),
        ("the daemon's journal", daemon.stderr().as_bytes()),
        ("the page's journal", view.stderr().as_bytes()),
        ("a recording", &recorded),
    ] {
        let found = facts.windows(secret.len()).any(|window| window == secret.as_bytes());
        assert!(!found, "{place} holds the token");
    }
}
