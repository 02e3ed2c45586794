//! Streams with a constant latency arrive late and are not treated as silent.

use super::*;

const MS_NS: u64 = 1_000_000;

fn late(suit_ms: u64, ground_ms: u64) -> Bench {
    Bench::new(|settings| {
        (settings.suit_latency_ns, settings.ground_latency_ns) = (suit_ms * MS_NS, ground_ms * MS_NS);
    })
}

#[test]
fn a_stream_that_is_late_by_what_it_should_be_is_not_stale() {
    let person = Person::real();
    for (suit_ms, ground_ms) in [(0, 0), (200, 0), (500, 0), (0, 50), (0, 138), (0, 500), (700, 600)] {
        let mut bench = late(suit_ms, ground_ms);
        bench.identify(&person);
        // The simulated person leaps from pose to pose; the plate is suspect meanwhile.
        bench.hold(&person, &postures()[0], None, 1500);
        let state = bench.state();
        assert!(!state.validity().any_of(Validity::SUIT_STALE.and(Validity::GROUND_STALE)), "{suit_ms}");
        let works = matches!(bench.phase(), Phase::Identifying | Phase::Monitoring);
        assert!(works, "{:?} with {suit_ms} and {ground_ms} ms", bench.phase());
        assert!(state.suit_age_ns >= suit_ms * MS_NS, "the age includes the latency");
        assert_ne!(state.cop_measured_m, [0.0; 2], "the wrench at the suit's own time is still there");
    }
}

#[test]
fn silence_is_reported_as_soon_after_the_latency_as_without_one() {
    let (person, posture) = (Person::real(), postures()[0]);
    let milliseconds_to_stale = |suit_ms| {
        let mut bench = late(suit_ms, 0);
        bench.hold(&person, &posture, None, 1500);
        bench.suit_silent = true;
        (1..500).find(|_| {
            bench.hold(&person, &posture, None, 1);
            bench.state().validity().any_of(Validity::SUIT_STALE)
        })
    };
    assert!(milliseconds_to_stale(0).is_some());
    assert_eq!(milliseconds_to_stale(0), milliseconds_to_stale(150));
}
