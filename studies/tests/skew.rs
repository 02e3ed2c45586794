//! Skew and drift between the clocks of suit and plate are estimated from the motion and corrected.

use equipoise_core::message::Validity;
use equipoise_studies::clocks::{lift_round, read};
use equipoise_studies::sensors::Rig;
use equipoise_studies::session::Session;
use equipoise_studies::subject::{Subject, map_in_parallel};

#[test]
fn the_skew_of_a_late_suit_is_found_and_none_where_there_is_none() {
    let questions: Vec<(u64, u64)> =
        [0, 12, 30].into_iter().flat_map(|late_ms| [3, 4].map(|seed| (late_ms, seed))).collect();
    let published = map_in_parallel(&questions, |(late_ms, seed)| {
        let subject = Subject::random(*seed);
        let rig = Rig { suit_late_ns: late_ms * 1_000_000, ..Rig::ORDINARY };
        let mut session = Session::with(&subject, subject.settings(), rig, subject.habits());
        session.identify(10);
        session.work_unloaded(|_| {});
        session.work_unloaded(|_| {});
        [session.state().suit_skew_s, session.state().suit_skew_sigma_s].map(|s| 1e3 * s)
    });
    for ((late_ms, seed), [skew_ms, sigma_ms]) in questions.iter().zip(published) {
        println!("subject {seed}: stamped {late_ms} ms late, published {skew_ms:.1} ± {sigma_ms:.1} ms");
        assert!(sigma_ms > 0.0, "{late_ms} ms late: nothing is published");
        let error_ms = skew_ms - *late_ms as f64;
        assert!(error_ms.abs() < 3.0 * sigma_ms, "{late_ms} ms late, published {skew_ms} ± {sigma_ms} ms");
    }
}

#[test]
fn a_late_plate_with_another_clock_is_found_in_a_minute_of_lifting_and_a_changed_delay_masks() {
    const CHANGE: (f64, f64) = (75.0, 0.3);
    let subject = Subject::random(5);
    let rig = Rig {
        suit_hz: 100,
        ground_late_s: 0.138,
        ground_drift_ppm: -400.0,
        ground_delay_step: Some(CHANGE),
        suit_rate_ppm: 1000.0,
        ..Rig::ORDINARY
    };
    let mut session = Session::with(&subject, subject.settings(), rig, subject.habits());
    let round = |session: &mut Session, index: u32| {
        // While the delay is 300 ms off: samples masked as unsynchronised, and unmasked ones.
        let mut samples = [0_u32; 2];
        lift_round(session, index % 2 == 1, 0.5, |snapshot, lag_s| {
            let is_wrong = (lag_s - rig.skew_at_s(snapshot.time_s)).abs() > 0.2;
            let is_masked = snapshot.state.validity().any_of(Validity::CLOCK_UNSYNCHRONISED);
            samples[usize::from(is_masked)] += u32::from(is_wrong && snapshot.time_s > CHANGE.0);
        });
        samples
    };
    let mut index = 0;
    while session.now_s() < 60.0 {
        round(&mut session, index);
        index += 1;
    }
    let reading = read(&session, &rig).expect("a minute of lifting");
    println!("after 60 s: {reading:?}");
    assert!(reading.error_s.abs() < 0.010 && reading.sigma_s < 0.005, "{reading:?}");
    assert!(reading.drift_error.abs() < 200e-6, "{reading:?}");
    assert!(!session.state().validity().any_of(Validity::CLOCK_UNSYNCHRONISED), "aligned");
    assert!((session.memory().skew().lag_s() - rig.skew_at_s(session.now_s())).abs() < 0.010, "corrected");

    let mut samples = [0; 2];
    while session.now_s() < 120.0 {
        let more = round(&mut session, index);
        samples = [samples[0] + more[0], samples[1] + more[1]];
        index += 1;
    }
    let [shown, masked] = samples.map(|samples| f64::from(samples) / 100.0);
    println!("after the change: {shown} s not masked, {masked} s masked");
    // Two windows of 2.56 s without a common sample, a block of 1.28 s, and the filter's reach of 0.66 s on each side.
    assert!(shown < 7.8 && masked > 1.0, "{shown} s not masked, {masked} s masked");
    let reading = read(&session, &rig).expect("estimated again");
    assert!(reading.error_s.abs() < 0.010, "{reading:?}");
    assert!(!session.state().validity().any_of(Validity::CLOCK_UNSYNCHRONISED), "aligned again");
}
