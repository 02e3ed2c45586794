//! Tests with pages of stations on this machine.

use std::os::unix::fs::PermissionsExt as _;

use super::*;
use bytemuck::Zeroable;
use equipoise_core::message::State;
use equipoise_view::Token;
use equipoise_view::page::{Engineer, PageCommand, PageFrame, Station};

const TOKEN: &str = "of-the-test-0123456789abcdefghij";

struct Facts;

impl Station for Facts {
    fn facts(&self) -> String {
        json!({ "station": "press-1", "incidents": [{ "name": "suit_silent", "active": true }] }).to_string()
    }

    fn history(&self) -> String {
        "{}".to_owned()
    }

    fn report(&self) -> Option<String> {
        None
    }

    fn subjects(&self) -> Result<Vec<String>, String> {
        Ok(Vec::new())
    }

    fn command(&self, _: &PageCommand) -> Result<String, String> {
        Err("none".to_owned())
    }
}

fn station(live: bool) -> Page {
    let mut state = State { worst_joint: 0, lifted_mass_kg: 8.0, ..State::zeroed() };
    (state.torque_nm[0], state.torque_limit_nm[0]) = ([0.0, 30.0, 40.0], 100.0);
    let feed = move || {
        (state.cycle, state.time_ns) = (state.cycle + 1, state.time_ns + 1);
        live.then(|| PageFrame::new(state))
    };
    let engineer = Engineer { station: Arc::new(Facts), command_token: None };
    Page::start_with("127.0.0.1:0".parse().unwrap(), Token::new(TOKEN), feed, Some(engineer)).unwrap()
}

fn file(text: &str) -> anyhow::Result<StationsFile> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stations.toml");
    std::fs::write(&path, text).unwrap();
    StationsFile::read(&path)
}

#[test]
fn a_tile_is_live_silent_or_lost() {
    let folder = tempfile::tempdir().unwrap();
    let token = folder.path().join("token");
    std::fs::write(&token, TOKEN).unwrap();
    std::fs::set_permissions(&token, std::fs::Permissions::from_mode(0o600)).unwrap();
    let pages = [station(true), station(false)];
    let mut text = "[page]\nlisten = \"127.0.0.1:0\"\n".to_owned();
    for page in &pages {
        text += &format!("[[station]]\nurl = \"{}\"\ntoken_file = \"token\"\n", page.url());
    }
    // Without the token, and an address that nothing serves.
    text +=
        &format!("[[station]]\nurl = \"{}\"\n[[station]]\nurl = \"http://127.0.0.1:1/\"\n", pages[0].url());
    let served = ServedStations::start(file(&text).unwrap(), folder.path()).unwrap();
    let client = HttpClient::new();
    let stations = || -> Value {
        serde_json::from_str(&client.get(&format!("{}api/stations", served.url())).unwrap().text).unwrap()
    };
    let begun = Instant::now();
    let is = |all: &Value| {
        ["live", "silent", "lost", "lost"]
            .iter()
            .zip(all.as_array().unwrap())
            .all(|(one, tile)| tile["connection"] == *one)
    };
    while !is(&stations()) {
        assert!(begun.elapsed() < Duration::from_secs(30), "{}", stations());
        std::thread::sleep(Duration::from_millis(50));
    }
    let all = stations();
    assert_eq!((&all[0]["station"], &all[0]["state"]["worst_joint"]), (&json!("press-1"), &json!("L5S1")));
    assert_eq!(
        (&all[0]["state"]["joint"]["limit_nm"], &all[0]["state"]["lifted_mass_kg"]),
        (&json!(100.0), &json!(8.0))
    );
    assert_eq!(all[0]["incidents"][0]["name"], "suit_silent");
    assert!(all[0]["state"].get("joints").is_none() && all[1]["state"].is_null(), "{all}");
    assert!(all[2]["error"].as_str().unwrap().starts_with("401: This page needs its token"), "{all}");
    assert!(all[3]["error"].is_string() && served.is_running());
}

#[test]
fn an_invalid_stations_file_is_refused_with_a_remedy() {
    let page = "[page]\nlisten = \"127.0.0.1:0\"\n";
    for (text, expected) in [
        (page.to_owned() + "station = []", "unknown field"),
        (format!("station = []\n{page}"), "no [[station]]"),
        (format!("{page}[[station]]\nurl = \"press-1:8080\""), "http://HOST:PORT/"),
        (format!("{page}[[station]]\nurl = \"http://a/?token=b\""), "token_file"),
        (format!("{page}[[station]]\nurl = \"http://press 1:8080/\""), "http://HOST:PORT/"),
    ] {
        let error = format!("{:#}", file(&text).unwrap_err());
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn the_address_of_a_page_has_a_host_and_may_have_a_port() {
    for url in [
        "http://press-1",
        "http://press-1:8080/",
        "http://10.0.0.7:80/a",
        "http://[::1]:8080/",
        "http://[::1]",
    ] {
        assert!(is_page_address(url), "{url}");
    }
    for url in [
        "http://",
        "http:///a",
        "http://:80/",
        "http://a:99999/",
        "http://a:/",
        "http://a b/",
        "http://u@a/",
        "http://[a]/",
        "https://a/",
    ] {
        assert!(!is_page_address(url), "{url}");
    }
}

#[test]
fn a_failed_request_withholds_the_state_immediately() {
    let answered = Some(Instant::now());
    let state = Some(json!({ "phase": "monitoring" }));
    let tile =
        Tile { state, facts: Some(json!({ "station": "press-1", "incidents": [] })), error: None, answered };
    assert_eq!(tile.to_json("http://a/")["connection"], "live");
    let failed = Tile { error: Some("no route".to_owned()), ..tile }.to_json("http://a/");
    assert_eq!((&failed["connection"], &failed["station"]), (&json!("waiting"), &json!("press-1")));
    assert!(failed["state"].is_null() && failed["incidents"].is_null(), "{failed}");
}

#[test]
fn a_tile_displays_the_joint_of_the_headline_with_its_certain_level() {
    let joint = |torque_nm: f64, sigma_nm: f64, level: &str| json!({ "torque_nm": [0.0, torque_nm, 0.0], "sigma_nm": sigma_nm, "level": level, "limit_nm": 100.0 });
    let shown = |back: Value, knee: Value| {
        let joints = json!({ "L5S1": back, "LeftHip": joint(20.0, 12.0, "undecided"), "LeftKnee": knee });
        let shown = displayed(&json!({ "worst_joint": "L5S1", "joints": joints }));
        [&shown["worst_joint"], &shown["joint"]["level"]].map(|text| text.as_str().unwrap().to_owned())
    };
    let undecided = joint(25.0, 8.0, "undecided");
    assert_eq!(shown(joint(28.0, 1.0, "green"), undecided.clone()), ["LeftKnee", "undecided"]);
    assert_eq!(shown(joint(28.0, 1.0, "orange"), undecided.clone()), ["L5S1", "orange"]);
    assert_eq!(shown(joint(105.0, 8.0, "undecided"), undecided), ["L5S1", "red"]);
    assert_eq!(shown(joint(80.0, 30.0, "undecided"), joint(79.0, 1.0, "red")), ["LeftKnee", "red"]);
    // Without σ and limit nothing is certain.
    let unbounded = json!({ "torque_nm": [0.0, 80.0, 0.0], "level": "undecided" });
    assert_eq!(shown(unbounded, joint(10.0, 1.0, "green"))[1], "undecided");
}
