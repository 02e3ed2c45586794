//! SIGHUP: the configuration is reloaded.

use std::os::unix::net::UnixDatagram;
use std::time::Duration;

use equipoise_core::message::Incident;
use rustix::process::Signal;

use crate::eyes::Eyes;
use crate::process::{PATIENCE, wait_for};
use crate::station::Station;

const MODEL: &str = r#"version = 1
[[effect]]
name = "plate_offset"
span_s = [0.0, 1.0]
open_ended = true
log_odds = 9.0
parameters = { dx_m = { value = 0.002, sigma = 0.001, unit = "m" } }
"#;

fn in_force(station: &Station) -> (toml::Table, String) {
    let status = wait_for("the status", || station.status());
    let text = status["daemon"]["config_toml"].as_str().expect("a configuration");
    let model = status["daemon"]["model_toml"].as_str().expect("a model");
    (text.parse().expect("TOML"), model.to_owned())
}

#[test]
fn what_can_change_live_changes_what_cannot_is_named_and_nonsense_changes_nothing() {
    let station = Station::new();
    let socket = station.file("notify");
    let notified = UnixDatagram::bind(&socket).expect("a socket");
    // Read at once, as systemd does: the socket holds few datagrams, and a full one blocks the daemon.
    let (sender, words) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let mut bytes = [0; 4096];
        while let Ok(length) = notified.recv(&mut bytes) {
            if sender.send(String::from_utf8_lossy(&bytes[..length]).into_owned()).is_err() {
                break;
            }
        }
    });
    let mut hear = || words.recv_timeout(PATIENCE).expect("a word of the daemon");

    let text = station.configuration();
    station.write("live.toml", &text);
    let mut daemon = station.daemon_of("live.toml", &[("NOTIFY_SOCKET", socket.as_os_str())]);
    let mut eyes = Eyes::open(&station);
    while !hear().contains("READY=1") {}
    let before = in_force(&station);

    // An invalid configuration.
    station.write("live.toml", &text.replace("rate_hz = 200", "rate_hz = 200\nrate_herz = 1"));
    daemon.send(Signal::HUP);
    eyes.until("the refusal", |eyes| eyes.goes_on(Incident::ReloadRefused));
    let said = daemon.stderr();
    assert!(said.contains("reload_refused") && said.contains("rate_herz"), "{said}");
    let word = std::iter::repeat_with(&mut hear).find(|word| word.contains("RELOADING=1")).expect("a word");
    let stamp = word.lines().find_map(|line| line.strip_prefix("MONOTONIC_USEC=")).expect("a stamp");
    assert!(stamp.parse::<u64>().expect("a number") > 0);
    assert!(
        std::iter::repeat_with(&mut hear)
            .find(|word| !word.contains("WATCHDOG"))
            .expect("a word")
            .contains("READY=1")
    );
    station.write("live.toml", &format!("{text}[model]\nfile = \"model.toml\"\n"));
    daemon.send(Signal::HUP);
    wait_for("that the model is missed", || daemon.stderr().matches("is read again").nth(1).map(drop));
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(in_force(&station), before);
    assert!(eyes.goes_on(Incident::ReloadRefused));

    // A valid one.
    station.write("model.toml", MODEL);
    let wanted = text.replace("rate_hz = 200", "rate_hz = 500");
    let wanted = format!(
        "{wanted}[overload]\nthreshold_n = 25.0\n[static_pose]\n[model]\nfile = \"model.toml\"\n\
            [outlets.udp]\nto = [\"127.0.0.1:9\"]\n"
    );
    station.write("live.toml", &wanted);
    daemon.send(Signal::HUP);
    eyes.until("the end of the refusal", |eyes| !eyes.goes_on(Incident::ReloadRefused));
    wait_for("what is not live", || {
        daemon.stderr().contains("loop.rate_hz changed: takes effect at the next restart").then_some(())
    });
    let said = daemon.stderr();
    assert!(
        said.contains("overload.threshold_n changed: in force now") && said.contains("plate_offset"),
        "{said}"
    );
    assert!(!said.contains("overload.threshold_n changed: takes effect"), "{said}");
    assert!(said.contains("changed: in force once its outlet is restarted"), "{said}");
    let (config, model) = in_force(&station);
    assert_eq!(config["overload"]["threshold_n"].as_float(), Some(25.0));
    assert_eq!(config["loop"]["rate_hz"].as_integer(), Some(200));
    assert_eq!(model, MODEL);

    // Only the model file changes.
    station.write("model.toml", &MODEL.replace("0.002", "0.004"));
    daemon.send(Signal::HUP);
    wait_for("the other model", || in_force(&station).1.contains("0.004").then_some(()));
    let cycle = eyes.state.cycle;
    eyes.until("more cycles", |eyes| eyes.state.cycle > cycle + 50);
    assert_eq!(daemon.stop(Signal::TERM), Some(0));

    // The next start reports that the model has changed.
    station.write("live.toml", &text);
    let mut daemon = station.daemon_of("live.toml", &[]);
    wait_for("a word about the model", || daemon.stderr().contains("is not in use any more").then_some(()));
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
}
