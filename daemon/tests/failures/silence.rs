//! A sensor stops sending for a second and resumes.

use std::time::Duration;

use equipoise_core::message::Validity;

use crate::eyes::Eyes;
use crate::station::Station;

/// Duration of a sensor's silence.
const SILENCE: Duration = Duration::from_secs(1);

#[test]
fn silence_is_flagged_and_identification_goes_on_where_it_was() {
    let station = Station::new();
    let person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let mut eyes = Eyes::open(&station);
    eyes.until_poses(&person, 2);
    let learnt = eyes.state.poses_used;

    for (name, reason) in [("ground_stale", Validity::GROUND_STALE), ("suit_stale", Validity::SUIT_STALE)] {
        let silence = |silent| match reason {
            Validity::GROUND_STALE => person.silence_plate(silent),
            _ => person.silence_suit(silent),
        };
        silence(true);
        let state = eyes.until(name, |eyes| eyes.has(reason));
        assert!(state.validity().names().any(|raised| raised == name));
        assert_eq!(state.phase_name(), "degraded");
        assert!(state.torque_nm.iter().flatten().all(|torque| *torque == 0.0), "nothing is held over");
        if reason == Validity::GROUND_STALE {
            assert_eq!(state.cop_measured_m, [0.0; 2]);
        } else {
            assert_eq!((state.cop_estimated_m, state.com_m), ([0.0; 2], [0.0; 3]));
        }
        eyes.during(SILENCE, |eyes| {
            assert!(eyes.has(reason), "{name} ended before the silence did");
            assert!(eyes.state.poses_used >= learnt, "poses were forgotten");
        });
        silence(false);
        let state = eyes.until("both sensors again", |eyes| {
            assert!(eyes.state.poses_used >= learnt, "poses were forgotten");
            eyes.both_fresh()
        });
        assert_eq!(state.phase_name(), "identifying");
    }
    eyes.until_poses(&person, learnt + 1);
    assert!(daemon.is_running());
}
