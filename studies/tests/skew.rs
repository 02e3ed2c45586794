//! A suit that stamps its samples too late is found out by the motion.

use equipoise_studies::sensors::Rig;
use equipoise_studies::session::Session;
use equipoise_studies::subject::{Subject, ask_all};

#[test]
fn the_skew_of_a_late_suit_is_found_and_none_where_there_is_none() {
    let questions: Vec<(u64, u64)> =
        [0, 12, 30].into_iter().flat_map(|late_ms| [3, 4].map(|seed| (late_ms, seed))).collect();
    let told = ask_all(&questions, |(late_ms, seed)| {
        let subject = Subject::somebody(*seed);
        let rig = Rig { suit_late_ns: late_ms * 1_000_000, ..Rig::ORDINARY };
        let mut session = Session::with(&subject, subject.settings(), rig, subject.habits());
        session.identify(10);
        session.work_unloaded(|_| {});
        session.work_unloaded(|_| {});
        [session.state().suit_skew_s, session.state().suit_skew_sigma_s].map(|s| 1e3 * s)
    });
    for ((late_ms, seed), [skew_ms, sigma_ms]) in questions.iter().zip(told) {
        println!("subject {seed}: stamped {late_ms} ms late, told {skew_ms:.1} ± {sigma_ms:.1} ms");
        assert!(sigma_ms > 0.0, "{late_ms} ms late: nothing is told");
        let error_ms = skew_ms - *late_ms as f64;
        assert!(error_ms.abs() < 3.0 * sigma_ms, "{late_ms} ms late, told {skew_ms} ± {sigma_ms} ms");
    }
}
