//! The demonstration: what it publishes for each load against the simulator's truth, its viewer, and its end.

use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::time::Duration;

use equipoise_simulator::ports::free_address;
use rustix::process::Signal;
use serde_json::Value;

use crate::process::wait_for;
use crate::station::Station;

/// Boxes of the demonstration, kg.
const BOXES_KG: [f64; 3] = [4.0, 10.0, 16.0];
/// Stature, m, and body mass, kg, of the first human.
const BUILD: [f64; 2] = [1.77, 72.0];
/// Upper bounds of the levels over the torque limit (Table I).
const BOUNDS: [(&str, f64); 4] =
    [("green", 0.3), ("orange", 0.6), ("red", 1.0), ("above_max", f64::INFINITY)];

fn number(of: &Value, key: &str) -> f64 {
    of[key].as_f64().unwrap_or_else(|| panic!("no number {key} in {of}"))
}

#[test]
fn each_load_agrees_with_the_truth() {
    let station = Station::new();
    let mut demo = station.spawn(&["demo", "--once", "--headless", "--json", "--duration", "600"]);
    // It has a limit of its own.
    while demo.is_running() {
        std::thread::sleep(Duration::from_millis(100));
    }
    assert_eq!(demo.wait().code(), Some(0), "{}", demo.stderr());
    let summary: Value = serde_json::from_str(&demo.stdout()).expect("a summary");
    assert_eq!([number(&summary, "height_m"), number(&summary, "mass_kg")], BUILD);
    assert_eq!(summary["complete"], true, "{summary}");
    let lifts = summary["lifts"].as_array().expect("lifts");
    assert_eq!(lifts.len(), BOXES_KG.len());
    for (lift, box_kg) in lifts.iter().zip(BOXES_KG) {
        assert_lift_agrees(lift, box_kg);
    }
}

/// Mass, force, torques and level of a lift against the simulator's truth.
fn assert_lift_agrees(lift: &Value, box_kg: f64) {
    // Of the simulated human's hands, not of the script.
    assert!((number(lift, "mass_kg") - box_kg).abs() < 0.01, "{lift}");
    let (kg, sigma_kg) = (number(lift, "lifted_mass_kg"), number(lift, "lifted_mass_sigma_kg"));
    assert!(
        (kg - box_kg).abs() < 3.0 * sigma_kg && (kg - box_kg).abs() < 0.1 * box_kg,
        "{kg} ± {sigma_kg} kg: {lift}"
    );
    let [force_n, sigma_n, true_n] =
        ["delta_f_n", "delta_f_sigma_n", "delta_f_true_n"].map(|key| number(lift, key));
    let off_n = (force_n - true_n).abs();
    assert!(off_n < 3.0 * sigma_n && off_n < 0.1 * true_n, "{off_n} N off: {lift}");
    for joint in lift["joints"].as_array().expect("joints") {
        let [error_nm, sigma_nm, true_nm] =
            ["error_nm", "sigma_nm", "true_max_nm"].map(|key| number(joint, key));
        assert!(error_nm < 3.0 * sigma_nm && sigma_nm < 0.75 * true_nm, "{joint}");
        // The sum of both sides, whose σ is small.
        assert!(joint["name"] != "L5S1" || error_nm < 0.15 * true_nm, "{joint}");
    }
    // Absent if all levels were undecided, as they are with the larger σ of a busy machine.
    let Some(peak) = lift.get("peak") else { return };
    let [torque_nm, sigma_nm, true_nm, limit_nm] =
        ["torque_nm", "sigma_nm", "true_nm", "limit_nm"].map(|key| number(peak, key));
    assert!((torque_nm - true_nm).abs() < 4.0 * sigma_nm, "{peak}");
    // Hysteresis keeps a level above its bound, never below.
    let table = BOUNDS.iter().position(|(_, bound)| torque_nm <= bound * limit_nm).expect("a level");
    let published = BOUNDS.iter().position(|(level, _)| peak["level"] == *level).expect("a decided level");
    assert!(published == table || published == table + 1, "{peak}");
}

#[test]
fn it_waits_for_a_viewer_and_leaves_the_results_on_the_page() {
    let station = Station::new();
    // A browser's opener that writes down what it is given.
    let (opened, opener) = (station.file("opened"), station.file("xdg-open"));
    std::fs::write(&opener, format!("#!/bin/sh\necho \"$@\" >{}\n", opened.display())).expect("an opener");
    std::fs::set_permissions(&opener, PermissionsExt::from_mode(0o755)).expect("an opener");
    let address = free_address().expect("a free port");
    let page = address.to_string();
    let path = format!("{}:{}", station.file("").display(), std::env::var("PATH").unwrap_or_default());
    let mut demo = station
        .spawn_with(&["demo", "--page", &page], &[("PATH", path.as_ref()), ("DISPLAY", ":99".as_ref())]);
    let url =
        wait_for("the browser", || std::fs::read_to_string(&opened).ok().filter(|url| url.ends_with('\n')));
    assert_eq!(url.trim(), format!("http://{address}/"));
    // Without a viewer the simulated human stands, which is at most one pose, and its motion would be others.
    let poses = || state(address)?["poses_used"].as_u64().filter(|poses| *poses > 0);
    wait_for("the first pose", poses);
    std::thread::sleep(Duration::from_secs(5));
    assert_eq!(wait_for("a state", poses), 1);
    let mut events = Events::of(address);
    let frame = events.until("frame", |frame| number(&frame["state"], "poses_used") > 1.0);
    let human = &frame["simulated"];
    assert_eq!([number(human, "height_m"), number(human, "mass_kg")], BUILD);
    assert!(demo.stdout().contains("1.77 m, 72 kg: identifying"), "{}", demo.stdout());
    demo.send(Signal::INT);
    let last = events.until("ended", |_| true);
    assert_eq!(last["results"], serde_json::json!([]), "no box was lifted");
    assert_eq!(demo.wait().code(), Some(0), "{}", demo.stderr());
}

/// The newest state by the page's interface for scripts, which is no viewer.
fn state(address: SocketAddr) -> Option<Value> {
    let lines = request(address, "/api/state")?.lines();
    lines.map_while(Result::ok).find_map(|line| serde_json::from_str(&line).ok())
}

fn request(address: SocketAddr, target: &str) -> Option<BufReader<TcpStream>> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(Duration::from_secs(30))).ok()?;
    write!(stream, "GET {target} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").ok()?;
    Some(BufReader::new(stream))
}

/// The event stream of a viewer.
struct Events(BufReader<TcpStream>);

impl Events {
    fn of(address: SocketAddr) -> Events {
        Events(request(address, "/events?hz=10").expect("the page"))
    }

    /// The data of the next event of that name for which `holds`.
    fn until(&mut self, name: &str, holds: impl Fn(&Value) -> bool) -> Value {
        let mut event = String::new();
        for line in (&mut self.0).lines() {
            let line = line.expect("an event");
            if let Some(next) = line.strip_prefix("event: ") {
                event = next.to_owned();
            } else if let Some(data) = line.strip_prefix("data: ").filter(|_| event == name) {
                let data = serde_json::from_str(data).expect("JSON");
                if holds(&data) {
                    return data;
                }
            }
        }
        panic!("the stream ended without the event {name}");
    }
}
