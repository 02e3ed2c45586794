//! Commands to a running daemon, without a daemon, and refused ones.

use std::time::{Duration, Instant};

use equipoise_bus::{Bus, BusSettings};
use equipoise_core::body::{Joint, Sex};
use equipoise_core::message::{AdapterHealth, Incidents};
use equipoise_core::overload::TorqueLimits;
use rustix::process::Signal;

use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::{NAME, Output, Station};

#[test]
fn without_a_daemon_every_command_fails_with_a_message() {
    let station = Station::new();
    let no_daemon = |arguments: &[&str]| {
        station.run(arguments).assert_failed(1, &["no daemon", "equipoise run"]);
    };
    for arguments in [
        &["status"][..],
        &["status", "--json"],
        &["watch"],
        &["latency"],
        &["tare"],
        &["identify", "start"],
        &["identify", "stop"],
        &["identify", "reset"],
        &["subject", "load", "anon-1"],
        &["subject", "save"],
        &["subject", "undo-lift"],
    ] {
        no_daemon(arguments);
    }
    // A stopped daemon is waited for 2 s, an absent one is not. A busy machine may delay an attempt.
    wait_for("a status that fails without that wait", || {
        let started = Instant::now();
        no_daemon(&["status"]);
        (started.elapsed() < Duration::from_secs(2)).then_some(())
    });
    assert!(station.run(&["subject", "list"]).assert_done().contains("no profiles in"));
    station.run(&["subject", "delete", "anon-1"]).assert_failed(1, &["there is no profile anon-1"]);
    station.run(&["status", "--station", "a/b"]).assert_failed(1, &["is no name for a station"]);
}

#[test]
fn identification_and_profiles_are_controlled_and_invalid_commands_refused() {
    let station = Station::new();
    let person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 2);

    station.run(&["identify", "stop"]).assert_done();
    monitor.until("the end of the identification", |monitor| monitor.state.phase_name() == "monitoring");
    station.run(&["subject", "save"]).assert_done();
    wait_for("a profile", || station.profile("anon-1").exists().then_some(()));
    assert!(station.run(&["subject", "list"]).assert_done().contains("anon-1"));

    station.run(&["identify", "reset"]).assert_done();
    // The present pose may already have been used again.
    monitor.until("all poses to be forgotten", |monitor| monitor.state.poses_used < 2);
    station.run(&["identify", "start"]).assert_done();
    monitor.until("learning", |monitor| monitor.state.phase_name() == "identifying");

    // A person stands on the plate.
    let refusal = "stand on the plate";
    let tare = station.run_until(refusal, &["tare"], |ended| ended.stderr.contains(refusal));
    tare.assert_failed(1, &["refused", refusal, "step off"]);

    let characters = "made of letters, digits, '-' and '_'";
    station.run(&["subject", "load", "anon-9"]).assert_failed(1, &["there is no profile anon-9"]);
    for fault in ["../../etc/passwd", "/etc/passwd", "..", "", "a b", "anon-1.toml", "ä"] {
        station.run(&["subject", "load", fault]).assert_failed(1, &[characters]);
        station.run(&["subject", "delete", fault]).assert_failed(1, &[characters]);
    }
    let long = "x".repeat(65);
    station.run(&["subject", "load", &long]).assert_failed(1, &["at most"]);
    station.run(&["subject", "load", &long[..64]]).assert_failed(1, &["subject"]);
    assert!(std::fs::exists("/etc/passwd").expect("a file"));
    assert!(daemon.is_running());
    assert!(!daemon.stderr().contains("panicked"), "{}", daemon.stderr());
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
    station.run(&["subject", "delete", "anon-1"]).assert_done();
    assert!(!station.profile("anon-1").exists());
}

#[test]
fn status_fits_on_a_screen_and_all_adds_the_details() {
    let station = Station::new();
    let _person = station.person();
    let _daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until("both sensors", Monitor::both_fresh);
    let parts = ["  overload  ", "  body  ", "  suit  ", "  ground  "];
    let has_all = |ended: &Output, parts: &[&str]| parts.iter().all(|part| ended.stdout.contains(part));
    let status = station.run_until("all lines", &["status"], |ended| has_all(ended, &parts));
    let status = status.assert_done();
    // A busy machine may cause incidents, which take further lines.
    let lines: Vec<&str> = status.lines().filter(|line| !line.starts_with("  INCIDENT")).collect();
    // The shell's prompt takes the last of 24 lines.
    assert!(lines.len() < 24, "{status}");
    assert!(lines.iter().all(|line| line.chars().count() <= 80), "{status}");
    let details = ["  thread loop", "  memory  ", " received, ", "  feet    on plate"];
    let all = station.run_until("all details", &["status", "--all"], |ended| has_all(ended, &details));
    all.assert_done();
    for detail in details {
        assert!(!status.contains(detail), "{detail}: {status}");
    }
}

/// `status` needs all three, which are published once a second.
#[test]
fn counts_and_incidents_reach_a_new_subscriber_before_the_next_are_published() {
    let station = Station::new();
    let _person = station.person();
    let _daemon = station.daemon(&station.configuration());
    let bus = |role: &str| {
        let settings = BusSettings { station: NAME.to_owned(), role: role.to_owned(), root: station.root() };
        Bus::join(&settings).expect("the bus")
    };
    let (before, after) = (bus("before"), bus("after"));
    let mut earlier_health = before.subscriber::<AdapterHealth>(16).expect("a subscriber");
    let mut earlier_board = before.subscriber::<Incidents>(8).expect("a subscriber");
    // Publication times of the newest messages: suit, ground, incidents.
    let mut newest_ns = [0; 3];
    let mut update = move || {
        while let Some(health) = earlier_health.receive().expect("the bus") {
            newest_ns[health.stream as usize - 1] = health.time_ns;
        }
        while let Some(board) = earlier_board.receive().expect("the bus") {
            newest_ns[2] = board.time_ns;
        }
        newest_ns
    };
    wait_for("the first messages", || (!update().contains(&0)).then_some(()));
    // Repeated if a message is published meanwhile.
    wait_for("the same messages at a new subscriber", || {
        let expected_ns = update();
        let mut health = after.subscriber::<AdapterHealth>(16).expect("a subscriber");
        let mut board = after.subscriber::<Incidents>(8).expect("a subscriber");
        let mut received_ns = [0; 3];
        while received_ns != expected_ns && update() == expected_ns {
            while let Some(health) = health.receive().expect("the bus") {
                received_ns[health.stream as usize - 1] = health.time_ns;
            }
            while let Some(board) = board.receive().expect("the bus") {
                received_ns[2] = board.time_ns;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        (received_ns == expected_ns).then_some(())
    });
}

/// In a profile's `[shift]`.
const TWO_LIFTS: &str = "damage = 5e-5
lifts = 2
ended = 2
[[lift]]
number = 1
carried_s = 2.5
mass_kg = [8.0, 0.5]
distance_m = 0.35
damage = 1e-5
undone = false
[[lift]]
number = 2
carried_s = 3.0
mass_kg = [12.0, 0.5]
distance_m = 0.4
damage = 4e-5
undone = false
";

#[test]
fn loading_another_subject_leaves_the_first_profile_unchanged() {
    let station = Station::new();
    let person = station.person();
    let configuration = station.configuration() + "[subject.tau_max_nm]\nL5S1 = 123.0\n";
    let mut daemon = station.daemon(&configuration);
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 1);
    station.run(&["identify", "stop"]).assert_done();
    // All poses used until then must be in the file before the comparisons below.
    let poses = monitor.until("monitoring", |monitor| monitor.state.phase_name() == "monitoring").poses_used;
    let saved = |subject: &str| std::fs::read_to_string(station.profile(subject)).unwrap_or_default();
    let whole = ["identified = true\n", "learning = false\n", &format!("poses_used = {poses}\n")];
    wait_for("the first one's profile", || {
        let saved = saved("anon-1");
        whole.iter().all(|line| saved.contains(line)).then_some(())
    });

    station.run(&["subject", "undo-lift"]).assert_failed(1, &["no lift of this shift counts"]);

    // Another subject, with other poses in the profile, and two lifts.
    station.copy_profile("anon-1", "anon-2", |second| {
        let shift = second["shift"].as_table_mut().expect("a shift");
        shift.extend(TWO_LIFTS.parse::<toml::Table>().expect("a shift"));
        second.insert("poses_used".to_owned(), 77.into());
        second.insert("height_m".to_owned(), 1.62.into());
        second.insert("sex".to_owned(), "female".into());
    });

    assert_eq!(monitor.state.torque_limit_nm[Joint::named("L5S1").expect("a joint").index()], 123.0);
    let message = station.run(&["subject", "load", "anon-2"]);
    assert!(message.assert_done().contains("anon-2 is in use: 77 poses"), "{}", message.stdout);
    monitor.until("the second worker", |monitor| monitor.state.poses_used == 77);
    // Neither limits nor mass of the configured subject apply to the second one.
    let is_hers = |monitor: &Monitor| {
        monitor.state.torque_limit_nm == *TorqueLimits::of(Sex::Female).without_torque_nm()
    };
    monitor.until("the second one's limits", is_hers);
    let status = station.current_status();
    let in_force: toml::Table =
        status["daemon"]["config_toml"].as_str().expect("a text").parse().expect("TOML");
    let expected: toml::Table =
        "id = 'anon-2'\nheight_m = 1.62\nsex = 'female'\nsave_profile = true".parse().expect("TOML");
    assert_eq!(in_force["subject"].as_table(), Some(&expected), "{in_force}");

    assert!(
        station.run(&["subject", "undo-lift"]).assert_done().contains("the last of 2 lifts is taken back")
    );
    monitor.until("one lift", |monitor| monitor.state.lifts == 1);
    assert!((monitor.state.dose_damage - 1e-5).abs() < 1e-12, "{}", monitor.state.dose_damage);
    let list = station.profile("anon-2").with_extension("lifts.csv");
    wait_for("the lift in the list", || {
        let list = std::fs::read_to_string(&list).ok()?;
        list.contains(",undone,2,3.00,12.00,0.50,0.400,4e-5\n").then_some(())
    });
    wait_for("a profile without it", || saved("anon-2").contains("lifts = 1\n").then_some(()));

    assert!(station.run(&["subject", "save"]).assert_done().contains("anon-2"));
    // Until now the file's date was updated; from here on the file must not change.
    let first = saved("anon-1");
    assert!(whole.iter().all(|line| first.contains(line)) && first.contains("\"anon-1\""), "{first}");
    station.run(&["identify", "start"]).assert_done();
    monitor.until_poses(&person, 78);
    wait_for("the second one's new pose", || saved("anon-2").contains("poses_used = 78").then_some(()));
    assert_eq!(saved("anon-1"), first, "the first worker's profile was overwritten");
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
    assert_eq!(saved("anon-1"), first, "the first worker's profile was overwritten");

    let _daemon = station.daemon(&configuration);
    monitor.until("the second one after a restart", |monitor| monitor.state.poses_used == 78);
    monitor.until("the second one's limits after a restart", is_hers);
}
