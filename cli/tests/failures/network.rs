//! Bad networks for both sensors.

use std::time::Duration;

use equipoise_adapters::suit::SuitRefusal;
use equipoise_simulator::faults::Faults;

use crate::monitor::Monitor;
use crate::station::{Station, simulate};

#[test]
fn identification_works_over_networks_that_lose_reorder_repeat_and_damage() {
    let station = Station::new();
    let faults = Faults { loss: 0.05, reorder: 0.02, duplicate: 0.02, corrupt: 0.01, ..Faults::default() };
    let mut settings = station.sensors();
    settings.suit.faults = faults;
    settings.plate.faults = faults;
    let person = simulate(&settings);
    let mut daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 2);
    monitor.during(Duration::from_secs(5), |_| {});
    // A suit's sample consists of several datagrams: most often only the one with the pose is lost.
    monitor.until("lost samples to be counted", |monitor| {
        monitor.suit().lost + monitor.suit_refused(SuitRefusal::NoPose) > 0 && monitor.ground().lost > 0
    });
    monitor.until("refusals to be counted", |monitor| {
        [monitor.suit(), monitor.ground()].iter().all(|adapter| adapter.refused.iter().sum::<u64>() > 0)
    });
    monitor.until("both sensors", Monitor::both_fresh);
    let count = monitor.state.poses_used;
    monitor.until_poses(&person, count + 1);
    assert!(daemon.is_running());
    assert!(!daemon.stderr().contains("panicked"), "{}", daemon.stderr());
}
