//! The daemon is killed by SIGKILL; its files are damaged or cannot be written.

use equipoise_core::message::Incident;
use equipoise_daemon::realtime::now_ns;
use rustix::process::Signal;

use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::{NAME, Station};

fn poses_saved(station: &Station) -> u64 {
    let text = std::fs::read_to_string(station.profile("anon-1")).unwrap_or_default();
    let profile: toml::Table = text.parse().unwrap_or_default();
    profile.get("poses_used").and_then(toml::Value::as_integer).unwrap_or(0) as u64
}

#[test]
fn a_killed_daemon_restarts_and_restores_the_subject() {
    let station = Station::new();
    let person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 2);
    let poses = u64::from(monitor.state.poses_used);
    wait_for("the poses to be saved", || (poses_saved(&station) >= poses).then_some(()));

    for _ in 0..2 {
        let saved = poses_saved(&station);
        daemon.kill();
        let killed_ns = now_ns();
        // The same consumer continues without a restart.
        daemon = station.daemon(&station.configuration());
        let state = monitor.until("states of the new daemon", |monitor| {
            monitor.state.time_ns > killed_ns && monitor.both_fresh()
        });
        assert!(u64::from(state.poses_used) >= saved, "{} of {saved} poses", state.poses_used);
        assert!(daemon.stderr().contains("profile anon-1 is in use"), "{}", daemon.stderr());
        let status = station.current_status();
        assert_eq!(status["daemon"]["process_id"], daemon.id());
    }
    let before = monitor.state.poses_used;
    monitor.until_poses(&person, before + 1);
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
}

#[test]
fn a_broken_profile_is_reported_and_never_overwritten() {
    let station = Station::new();
    let path = station.profile("anon-1");
    std::fs::create_dir_all(path.parent().expect("a directory")).expect("a directory");
    let broken = b"format = 1\nsubject = \"anon-1\"\nposes_used = \xff\xfe twelve\n";
    std::fs::write(&path, broken).expect("a broken profile");

    let person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let message = daemon.stderr();
    assert!(message.contains("anon-1.toml") && message.contains("WARN"), "{message}");
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 1);
    let refused = station.run(&["subject", "save"]);
    refused.assert_failed(1, &["anon-1", "not overwritten"]);
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
    assert_eq!(std::fs::read(&path).expect("the profile"), broken);
    let files = std::fs::read_dir(path.parent().expect("a directory")).expect("a directory").count();
    assert_eq!(files, 1, "no other file is left");
}

#[test]
fn a_state_directory_that_cannot_be_written_is_a_warning() {
    let station = Station::new();
    let person = station.person();
    let file = station.write("state-is-a-file", "no directory");
    let mut daemon = station.daemon_with_state_in(&file);
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 1);
    wait_for("a warning", || {
        let message = daemon.stderr();
        (message.contains("WARN") && message.contains("state-is-a-file")).then_some(())
    });
    let before = monitor.state.cycle;
    monitor.until("more cycles", |monitor| monitor.state.cycle > before + 200);
    assert!(daemon.is_running());
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
    assert_eq!(std::fs::read_to_string(&file).expect("the file"), "no directory");
}

#[test]
fn a_subject_in_use_whose_profile_is_damaged_is_not_replaced_by_the_configured_one() {
    let station = Station::new();
    let person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 1);
    wait_for("a saved pose", || (poses_saved(&station) >= 1).then_some(()));
    station.copy_profile("anon-1", "anon-77", |_| {});
    station.run(&["subject", "load", "anon-77"]).assert_done();
    let file = station.state_directory().join("stations").join(format!("{NAME}.toml"));
    wait_for("the station's file", || {
        std::fs::read_to_string(&file).is_ok_and(|text| text.contains("anon-77")).then_some(())
    });
    daemon.kill();
    std::fs::write(station.profile("anon-77"), "damaged").expect("a file");
    let configured = std::fs::read(station.profile("anon-1")).expect("a profile");

    let mut daemon = station.daemon(&station.configuration());
    monitor.until("an incident", |monitor| monitor.is_active(Incident::NotSaved));
    let status = station.current_status();
    assert_eq!(status["daemon"]["subject"], "anon-77");
    let message = status["daemon"]["restored"].to_string();
    assert!(message.contains("equipoise subject load ID"), "{message}");
    monitor.until_poses(&person, 1);
    station.run(&["subject", "save"]).assert_failed(1, &["anon-77", "put its profile in order"]);
    assert!(configured == std::fs::read(station.profile("anon-1")).expect("a profile"));
    station.run(&["subject", "load", "anon-1"]).assert_done();
    monitor.until("the end of the incident", |monitor| !monitor.is_active(Incident::NotSaved));
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
    assert_eq!(std::fs::read(station.profile("anon-77")).expect("the profile"), b"damaged");
}
