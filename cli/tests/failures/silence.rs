//! A sensor stops sending for a second and resumes.

use std::time::{Duration, Instant};

use equipoise_core::message::Validity;

use crate::monitor::Monitor;
use crate::station::Station;

/// Duration of a sensor's silence.
const SILENCE: Duration = Duration::from_secs(1);
/// Time for which a flag must be raised without a break before it counts as that of the silence.
const SETTLED: Duration = Duration::from_millis(300);

#[test]
fn silence_is_flagged_and_identification_continues() {
    let station = Station::new();
    let person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 2);
    let poses = monitor.state.poses_used;

    for (name, reason) in [("ground_stale", Validity::GROUND_STALE), ("suit_stale", Validity::SUIT_STALE)] {
        let silence = |silent| match reason {
            Validity::GROUND_STALE => person.silence_plate(silent),
            _ => person.silence_suit(silent),
        };
        silence(true);
        // A stall around the begin of the silence raises the flag before the last samples arrive.
        let mut since = None;
        let state = monitor.until(name, |monitor| {
            let begin = monitor.has(reason).then(|| since.unwrap_or_else(Instant::now));
            since = begin;
            begin.is_some_and(|begin| begin.elapsed() > SETTLED)
        });
        assert!(state.validity().names().any(|raised| raised == name));
        assert_eq!(state.phase_name(), "degraded");
        assert!(state.torque_nm.iter().flatten().all(|torque| *torque == 0.0), "nothing is held over");
        if reason == Validity::GROUND_STALE {
            assert_eq!(state.cop_measured_m, [0.0; 2]);
        } else {
            assert_eq!((state.cop_estimated_m, state.com_m), ([0.0; 2], [0.0; 3]));
        }
        monitor.during(SILENCE, |monitor| {
            assert!(monitor.has(reason), "{name} ended before the silence did");
            assert!(monitor.state.poses_used >= poses, "poses were forgotten");
        });
        silence(false);
        let state = monitor.until("both sensors again", |monitor| {
            assert!(monitor.state.poses_used >= poses, "poses were forgotten");
            monitor.both_fresh()
        });
        assert_eq!(state.phase_name(), "identifying");
    }
    monitor.until_poses(&person, poses + 1);
    assert!(daemon.is_running());
}
