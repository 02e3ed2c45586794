//! The daemon is killed by SIGKILL; its files are damaged or cannot be written.

use equipoise_daemon::realtime::now_ns;
use rustix::process::Signal;

use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::Station;

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
