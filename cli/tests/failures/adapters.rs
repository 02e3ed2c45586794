//! Adapters as separate processes, and their termination.

use equipoise_core::message::Validity;
use rustix::process::Signal;

use crate::monitor::Monitor;
use crate::process::{Process, wait_for};
use crate::shutdown::assert_nothing_left;
use crate::station::Station;

/// The same station for the daemon: both sources are external.
pub(crate) fn external(station: &Station) -> String {
    station.configuration().replace("\"mvn-udp\"", "\"external\"").replace("\"ati-rdt\"", "\"external\"")
}

pub(crate) fn adapter(station: &Station, stream: &str) -> Process {
    let path = station.write("adapters.toml", &station.configuration()).display().to_string();
    let mut process = station.spawn(&["adapter", stream, "--config", &path]);
    wait_for("the adapter to run", || {
        assert!(process.is_running(), "it ended: {}", process.stderr());
        process.stderr().contains("adapter runs").then_some(())
    });
    process
}

#[test]
fn a_killed_adapter_is_reported_as_silent_and_its_successor_is_received() {
    let station = Station::new();
    let person = station.person();
    let mut daemon = station.daemon(&external(&station));
    let mut monitor = Monitor::open(&station);
    monitor.until("cycles", |monitor| monitor.state.cycle > 10);
    assert_eq!(monitor.reasons()[..2], ["suit_stale", "ground_stale"]);

    let [mut suit, mut ground] = ["suit", "ground"].map(|stream| adapter(&station, stream));
    monitor.until_poses(&person, 1);
    let poses = monitor.state.poses_used;
    for _ in 0..2 {
        suit.kill();
        monitor.until("the suit's silence", |monitor| monitor.has(Validity::SUIT_STALE));
        suit = adapter(&station, "suit");
        monitor.until("the suit again", Monitor::both_fresh);
        ground.kill();
        monitor.until("the plate's silence", |monitor| monitor.has(Validity::GROUND_STALE));
        ground = adapter(&station, "ground");
        monitor.until("the plate again", Monitor::both_fresh);
    }
    assert!(monitor.state.poses_used >= poses);
    monitor.until_poses(&person, poses + 1);
    station.status_when("the adapters' processes", |status| {
        let of = |index: usize| &status["adapters"][index]["process_id"];
        *of(0) == suit.id() && *of(1) == ground.id()
    });

    // The daemon dies instead: the adapters continue and the next daemon receives them.
    daemon.kill();
    let mut daemon = station.daemon(&external(&station));
    let old = monitor.state.cycle;
    monitor.until("both sensors in the new daemon", |monitor| {
        monitor.state.cycle != old && monitor.both_fresh()
    });

    drop(monitor);
    for process in [&mut suit, &mut ground, &mut daemon] {
        assert_eq!(process.stop(Signal::TERM), Some(0), "{}", process.stderr());
    }
    assert_nothing_left(&station);
}

#[test]
fn an_adapter_of_an_external_source_ends_successfully_with_a_reason() {
    let station = Station::new();
    let path = station.write("daemon.toml", &external(&station)).display().to_string();
    for stream in ["suit", "ground"] {
        let ended = station.run(&["adapter", stream, "--config", &path]);
        ended.assert_done();
        let message = format!("{stream}.source is \"external\"");
        assert!(
            ended.stderr.contains(&message) && ended.stderr.contains("name the device"),
            "{}",
            ended.stderr
        );
    }
}

/// The sockets of a process other than Unix sockets.
fn network_sockets(process: u32) -> Vec<String> {
    let unix = std::fs::read_to_string("/proc/self/net/unix").expect("the kernel's table of Unix sockets");
    let entries = std::fs::read_dir(format!("/proc/{process}/fd")).expect("its descriptors");
    let links = entries.flatten().filter_map(|entry| std::fs::read_link(entry.path()).ok());
    let sockets =
        links.filter_map(|link| Some(link.to_str()?.strip_prefix("socket:[")?.strip_suffix(']')?.to_owned()));
    sockets.filter(|inode| !unix.lines().any(|line| line.split_whitespace().nth(6) == Some(inode))).collect()
}

#[test]
fn with_separate_adapters_the_daemon_has_no_network_socket() {
    let station = Station::with_separate_adapters();
    let person = station.person();
    let address = equipoise_simulator::ports::free_address().expect("a free port");
    let text = format!("{}[metrics]\nlisten = \"{address}\"\n", station.configuration());
    let path = station.write("all.toml", &text).display().to_string();
    let mut daemon = station.daemon_of("all.toml", &[]);
    let mut monitor = Monitor::open(&station);
    monitor.until("both sensors", Monitor::both_fresh);
    monitor.until_poses(&person, 1);
    assert_eq!(network_sockets(daemon.id()), Vec::<String>::new());
    assert!(
        !network_sockets(station.with_adapter(0, |suit| suit.id())).is_empty(),
        "the test sees none at all"
    );
    let mut metrics = station.spawn(&["metrics", "--config", &path]);
    wait_for("the metrics", || std::net::TcpStream::connect(address).ok());
    assert_eq!(metrics.stop(Signal::TERM), Some(0), "{}", metrics.stderr());
    drop(monitor);
    for place in [0, 1] {
        station.with_adapter(place, |adapter| {
            assert_eq!(adapter.stop(Signal::TERM), Some(0), "{}", adapter.stderr());
        });
    }
    assert_eq!(daemon.stop(Signal::TERM), Some(0), "{}", daemon.stderr());
    assert_nothing_left(&station);
}

/// Message of an active incident.
fn incident(station: &Station, name: &str) -> Option<String> {
    let status = station.status()?;
    status["daemon"]["incidents"][name].as_str().map(str::to_owned)
}

/// The ground adapter reads its file again.
fn reload_ground(station: &Station) {
    station.with_adapter(1, |ground| {
        let times = ground.stderr().matches("is read again").count();
        ground.send(Signal::HUP);
        wait_for("the configuration to be read again", || {
            (ground.stderr().matches("is read again").count() > times).then_some(())
        });
    });
}

#[test]
fn a_separate_adapter_reloads_its_file_and_its_fault_is_an_incident_of_the_daemon() {
    let station = Station::with_separate_adapters();
    let _person = station.person();
    let text = station.configuration();
    station.write("live.toml", &text);
    let daemon = station.daemon_of("live.toml", &[]);
    let mut monitor = Monitor::open(&station);
    monitor.until("both sensors", Monitor::both_fresh);

    // A refused configuration changes nothing.
    station.write("live.toml", &text.replace("measures", "measure").replace("[subject]", "[subjects]"));
    reload_ground(&station);
    monitor.until("both sensors", Monitor::both_fresh);
    station.with_adapter(1, |ground| {
        wait_for("the refusal", || ground.stderr().contains("stays in force").then_some(()));
    });
    assert_device_of_the_daemon_is_kept(&station, &mut monitor, &text);
    drop(daemon);
    let daemon = assert_absent_device_is_an_incident(&station, &mut monitor, &text);
    assert_ended_adapter_is_an_incident(&station);
    let path = station.file("live.toml").display().to_string();
    let mut suit = station.spawn(&["adapter", "suit", "--config", &path]);
    monitor.until("both sensors", Monitor::both_fresh);
    wait_for("the end of the fault", || incident(&station, "suit_adapter_down").is_none().then_some(()));
    // A change of sensor keys that the daemon uses too is reported with both units.
    station.write("live.toml", &text.replace("[ground]", "latency_ms = 10.0\n[ground]"));
    daemon.send(Signal::HUP);
    wait_for("what needs a restart", || {
        let message = "suit.latency_ms changed: takes effect at the next restart of equipoise and equipoise-adapter@suit";
        daemon.stderr().contains(message).then_some(())
    });
    assert_eq!(suit.stop(Signal::TERM), Some(0), "{}", suit.stderr());
}

/// The file names another device: its tare and latency are not those of the daemon's.
fn assert_device_of_the_daemon_is_kept(station: &Station, monitor: &mut Monitor, text: &str) {
    let (head, rest) = text.split_once("[ground]").expect("a plate");
    let (_, subject) = rest.split_once("[subject]").expect("a subject");
    let missing = "source = \"bota-serial\"\n[ground.serial]\nport = \"/dev/serial/by-id/missing\"\n";
    station.write("live.toml", &format!("{head}[ground]\n{missing}[subject]{subject}"));
    reload_ground(station);
    station.with_adapter(1, |ground| {
        wait_for("the refusal", || ground.stderr().contains("once equipoise is restarted").then_some(()));
    });
    monitor.until("both sensors", Monitor::both_fresh);
    // Nor does an adapter that starts with another file publish.
    let path = station.file("live.toml").display().to_string();
    station.with_adapter(1, |ground| {
        ground.kill();
        *ground = station.spawn(&["adapter", "ground", "--config", &path]);
    });
    let fault = wait_for("the adapter's fault", || {
        incident(station, "ground_adapter_down")
            .filter(|fault| fault.contains("differs from that of the running daemon"))
    });
    monitor.until("no plate", |monitor| monitor.has(Validity::GROUND_STALE));
    assert!(fault.contains("[ground]"), "{fault}");
}

/// The adapter's own message reaches the daemon. Returns a daemon with the original file.
fn assert_absent_device_is_an_incident(station: &Station, monitor: &mut Monitor, text: &str) -> Process {
    let path = station.file("live.toml").display().to_string();
    let restart = || station.spawn(&["run", "--sensors-apart", "--config", &path]);
    let daemon = restart();
    let fault = wait_for("the adapter's fault", || {
        incident(station, "ground_adapter_down").filter(|fault| fault.contains("/dev/serial/by-id/missing"))
    });
    assert!(!fault.contains("differs"), "{fault}");
    // An adapter follows a restarted daemon.
    station.write("live.toml", text);
    drop(daemon);
    let daemon = restart();
    monitor.until("both sensors", Monitor::both_fresh);
    wait_for("the end of the fault", || incident(station, "ground_adapter_down").is_none().then_some(()));
    daemon
}

/// The suit adapter's process ends: the incident names the unit, and the reason.
fn assert_ended_adapter_is_an_incident(station: &Station) {
    station.with_adapter(0, Process::kill);
    let occupied = std::net::UdpSocket::bind(station.suit).expect("the suit's port");
    let path = station.file("live.toml").display().to_string();
    station.run(&["adapter", "suit", "--config", &path]).assert_failed(1, &[&station.suit.to_string()]);
    // The reason is in the incident's text a second after its begin, at the latest.
    let address = station.suit.to_string();
    wait_for("a suit without adapter", || {
        let fault = incident(station, "suit_adapter_down")?;
        let is_whole = fault.contains("journalctl -u equipoise-adapter@suit") && fault.contains(&address);
        is_whole.then_some(())
    });
    drop(occupied);
}

#[test]
fn processes_that_do_not_use_the_model_start_without_access_to_it() {
    let station = Station::new();
    let free = || equipoise_simulator::ports::free_address().expect("a free port");
    let text = format!(
        "{}[model]\nfile = \"none/model.toml\"\n[page]\nlisten = \"{}\"\n[metrics]\nlisten = \
         \"{}\"\n[gateways.udp]\nto = [\"{}\"]\n",
        station.configuration(),
        free(),
        free(),
        free()
    );
    let path = station.write("model.toml", &text).display().to_string();
    station.run(&["check", &path]).assert_failed(1, &["[model] file: cannot read the model"]);
    for (arguments, runs) in [
        (&["adapter", "suit"][..], "the suit adapter runs"),
        (&["view"], "page at "),
        (&["metrics"], "metrics at "),
        (&["gateway", "udp"], "station "),
    ] {
        let mut process = station.spawn(&[arguments, &["--config", &path]].concat());
        wait_for(runs, || {
            assert!(process.is_running(), "{arguments:?}: {}", process.stderr());
            process.stderr().contains(runs).then_some(())
        });
        assert_eq!(process.stop(Signal::TERM), Some(0), "{arguments:?}: {}", process.stderr());
    }
}

#[test]
fn an_adapter_that_waits_for_the_daemon_warns_of_an_old_key_once() {
    let station = Station::new();
    let text = station.configuration();
    let _daemon = station.daemon(&text);
    let other = text.replace("[suit]", "[suit]\nwander_deg = 0.4\navatar = 3");
    let path = station.write("other.toml", &other).display().to_string();
    let mut adapter = station.spawn(&["adapter", "suit", "--config", &path]);
    wait_for("the difference", || {
        adapter.stderr().contains("differs from that of the running").then_some(())
    });
    // It reads the file twice a second.
    std::thread::sleep(std::time::Duration::from_secs(3));
    assert_eq!(
        adapter.stderr().matches("`suit.wander_deg` is now called").count(),
        1,
        "{}",
        adapter.stderr()
    );
    assert_eq!(adapter.stop(Signal::TERM), Some(0), "{}", adapter.stderr());
}
