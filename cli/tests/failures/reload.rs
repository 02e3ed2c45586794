//! SIGHUP: the configuration is reloaded.

use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::time::Duration;

use crossbeam_channel::Receiver;
use equipoise_core::message::Incident;
use rustix::process::Signal;

use crate::monitor::Monitor;
use crate::process::{Process, TIMEOUT, wait_for};
use crate::station::Station;

const MODEL: &str = r#"version = 1
[[effect]]
name = "plate_offset"
span_s = [0.0, 1.0]
open_ended = true
log_odds = 9.0
parameters = { dx_m = { value = 0.002, sigma = 0.001, unit = "m" } }
"#;

fn active_configuration(station: &Station) -> (toml::Table, String) {
    let status = station.current_status();
    let text = status["daemon"]["config_toml"].as_str().expect("a configuration");
    let model = status["daemon"]["model_toml"].as_str().expect("a model");
    (text.parse().expect("TOML"), model.to_owned())
}

/// Messages to a socket as systemd's, read at once: the socket holds few datagrams, and a full one blocks the daemon.
fn notifications(socket: &Path) -> Receiver<String> {
    let notified = UnixDatagram::bind(socket).expect("a socket");
    let (sender, lines) = crossbeam_channel::unbounded();
    std::thread::spawn(move || {
        let mut bytes = [0; 4096];
        while let Ok(length) = notified.recv(&mut bytes) {
            if sender.send(String::from_utf8_lossy(&bytes[..length]).into_owned()).is_err() {
                break;
            }
        }
    });
    lines
}

#[test]
fn live_settings_change_others_are_reported_and_invalid_files_change_nothing() {
    let station = Station::new();
    let socket = station.file("notify");
    let lines = notifications(&socket);
    let mut receive = || lines.recv_timeout(TIMEOUT).expect("a word of the daemon");

    let text = station.configuration();
    station.write("live.toml", &text);
    let mut daemon = station.daemon_of("live.toml", &[("NOTIFY_SOCKET", socket.as_os_str())]);
    let mut monitor = Monitor::open(&station);
    while !receive().contains("READY=1") {}
    assert_invalid_files_change_nothing(&station, &daemon, &mut monitor, &mut receive);
    assert_live_keys_are_applied(&station, &daemon, &mut monitor);

    // Only the model file changes.
    station.write("model.toml", &MODEL.replace("0.002", "0.004"));
    daemon.send(Signal::HUP);
    wait_for("the other model", || active_configuration(&station).1.contains("0.004").then_some(()));
    let cycle = monitor.state.cycle;
    monitor.until("more cycles", |monitor| monitor.state.cycle > cycle + 50);
    assert_eq!(daemon.stop(Signal::TERM), Some(0));

    // The next start reports that the model has changed.
    station.write("live.toml", &text);
    let mut daemon = station.daemon_of("live.toml", &[]);
    wait_for("a word about the model", || daemon.stderr().contains("is not in use any more").then_some(()));
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
}

/// An invalid configuration, and one whose model is missing; `receive` returns systemd's next message.
fn assert_invalid_files_change_nothing(
    station: &Station,
    daemon: &Process,
    monitor: &mut Monitor,
    mut receive: impl FnMut() -> String,
) {
    let (text, before) = (station.configuration(), active_configuration(station));
    station.write("live.toml", &text.replace("rate_hz = 200", "rate_hz = 200\nrate_herz = 1"));
    daemon.send(Signal::HUP);
    monitor.until("the refusal", |monitor| monitor.is_active(Incident::ReloadRefused));
    wait_for("the journal's line", || {
        let message = daemon.stderr();
        (message.contains("reload_refused") && message.contains("rate_herz")).then_some(())
    });
    let line =
        std::iter::repeat_with(&mut receive).find(|line| line.contains("RELOADING=1")).expect("a word");
    let stamp = line.lines().find_map(|line| line.strip_prefix("MONOTONIC_USEC=")).expect("a stamp");
    assert!(stamp.parse::<u64>().expect("a number") > 0);
    assert!(
        std::iter::repeat_with(&mut receive)
            .find(|line| !line.contains("WATCHDOG"))
            .expect("a word")
            .contains("READY=1")
    );
    station.write("live.toml", &format!("{text}[model]\nfile = \"model.toml\"\n"));
    daemon.send(Signal::HUP);
    wait_for("that the model is missed", || daemon.stderr().matches("is read again").nth(1).map(drop));
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(active_configuration(station), before);
    assert!(monitor.is_active(Incident::ReloadRefused));
}

/// A valid configuration with keys of both kinds.
fn assert_live_keys_are_applied(station: &Station, daemon: &Process, monitor: &mut Monitor) {
    station.write("model.toml", MODEL);
    let changed = station.configuration().replace("rate_hz = 200", "rate_hz = 500");
    let changed = format!(
        "{changed}[overload]\nthreshold_n = 25.0\n[static_pose]\n[model]\nfile = \"model.toml\"\n\
            [gateways.udp]\nto = [\"127.0.0.1:9\"]\n"
    );
    station.write("live.toml", &changed);
    daemon.send(Signal::HUP);
    monitor.until("the end of the refusal", |monitor| !monitor.is_active(Incident::ReloadRefused));
    wait_for("what is not live", || {
        daemon.stderr().contains("loop.rate_hz changed: takes effect at the next restart").then_some(())
    });
    let message = daemon.stderr();
    assert!(
        message.contains("overload.threshold_n changed: in force now") && message.contains("plate_offset"),
        "{message}"
    );
    assert!(!message.contains("overload.threshold_n changed: takes effect"), "{message}");
    assert!(message.contains("changed: in force once its gateway is restarted"), "{message}");
    let (config, model) = active_configuration(station);
    assert_eq!(config["overload"]["threshold_n"].as_float(), Some(25.0));
    assert_eq!(config["loop"]["rate_hz"].as_integer(), Some(200));
    assert_eq!(model, MODEL);
}
