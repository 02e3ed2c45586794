use super::*;

/// Later than every sample here.
const NOW_NS: u64 = 1 << 40;

fn take_ground(alignment: &mut Alignment, sample: &GroundSample, now_ns: u64) {
    if alignment.admits_ground(sample, now_ns) {
        alignment.push_ground(sample);
    }
}

fn take_suit(alignment: &mut Alignment, sample: &SuitSample, now_ns: u64) {
    if alignment.admits_suit(sample, now_ns) {
        alignment.push_suit(sample);
    }
}

fn ground(time_ns: u64, force: f64) -> GroundSample {
    GroundSample { sample_time_ns: time_ns, force_n: [0.0, 0.0, force], ..Zeroable::zeroed() }
}

fn suit(time_ns: u64) -> SuitSample {
    SuitSample {
        sample_time_ns: time_ns,
        orientation_wxyz: [[1.0, 0.0, 0.0, 0.0]; crate::body::SEGMENTS],
        ..Zeroable::zeroed()
    }
}

fn empty() -> Alignment {
    Zeroable::zeroed()
}

#[test]
fn the_wrench_is_interpolated_at_the_suit_s_time_in_any_order_of_arrival() {
    let mut alignment = empty();
    take_suit(&mut alignment, &suit(1_500_000), NOW_NS);
    assert!(alignment.next(2_000_000, WAIT_MAX_NS).is_none(), "the ground has not reached it");
    for millisecond in 0..3 {
        take_ground(&mut alignment, &ground(millisecond * 1_000_000, 100.0 * millisecond as f64), NOW_NS);
    }
    let aligned = alignment.next(3_000_000, WAIT_MAX_NS).unwrap();
    assert!((aligned.ground.unwrap().force_n[2] - 150.0).abs() < 1e-9);
    assert!(alignment.next(3_000_000, WAIT_MAX_NS).is_none());
}

#[test]
fn a_lag_shifts_the_time_of_the_wrench_and_waits_for_it() {
    let mut alignment = empty();
    for millisecond in 0..500 {
        take_ground(&mut alignment, &ground(millisecond * 1_000_000, millisecond as f64), NOW_NS);
    }
    let mut at = |lag_ms: i64, suit_ms: u64| {
        alignment.set_lag_ns(lag_ms * 1_000_000);
        take_suit(&mut alignment, &suit(suit_ms * 1_000_000), NOW_NS);
        let aligned = alignment.next(500_000_000, WAIT_MAX_NS + alignment.ground_late_ns())?;
        assert_eq!(aligned.suit.sample_time_ns, suit_ms * 1_000_000, "the stamp stays");
        Some(aligned.ground?.force_n[2].round())
    };
    assert_eq!(at(0, 200), Some(200.0));
    assert_eq!(at(138, 210), Some(72.0), "a late suit");
    assert_eq!(at(-138, 220), Some(358.0), "a late ground");
    // Ground samples up to 499 ms end 138 ms before the corresponding time; the sample is 80 ms old.
    assert_eq!(at(-138, 420), None);
    assert_eq!(alignment.next(500_000_000, WAIT_MAX_NS).map(|aligned| aligned.ground.is_none()), Some(true));
}

#[test]
fn a_ground_that_is_half_a_second_late_is_waited_for_at_240_hz() {
    let mut alignment = empty();
    alignment.set_lag_ns(-500_000_000);
    let mut reported = 0;
    for millisecond in 1..2000_u64 {
        let now_ns = millisecond * 1_000_000;
        take_ground(&mut alignment, &ground(now_ns, 700.0), now_ns);
        if now_ns % 4_166_667 < 1_000_000 {
            take_suit(&mut alignment, &suit(now_ns), now_ns);
        }
        while let Some(aligned) = alignment.next(now_ns, WAIT_MAX_NS + alignment.ground_late_ns()) {
            assert!(aligned.ground.is_some());
            reported += 1;
        }
    }
    assert!((357..=360).contains(&reported), "1.5 s at 240 Hz, none lost: {reported}");
}

#[test]
fn a_silent_ground_does_not_block_the_suit() {
    let mut alignment = empty();
    take_ground(&mut alignment, &ground(0, 700.0), NOW_NS);
    take_suit(&mut alignment, &suit(10_000_000), NOW_NS);
    assert!(alignment.next(20_000_000, WAIT_MAX_NS).is_none());
    assert!(alignment.next(80_000_000, WAIT_MAX_NS).unwrap().ground.is_none());
}

#[test]
fn components_that_one_of_two_samples_lacks_are_not_interpolated() {
    use crate::message::{Component, GroundDevice};
    let mut alignment = empty();
    let insoles = GroundDevice::Insoles as u32;
    let without = Component::Shear as u32;
    let blind = GroundSample { not_measured: without, devices: insoles, ..ground(0, 700.0) };
    take_ground(&mut alignment, &blind, NOW_NS);
    take_ground(&mut alignment, &GroundSample { devices: 1, ..ground(1_000_000, 700.0) }, NOW_NS);
    take_suit(&mut alignment, &suit(500_000), NOW_NS);
    let between = alignment.next(2_000_000, WAIT_MAX_NS).unwrap().ground.unwrap();
    assert!(!between.measures(Component::Shear));
    assert_eq!(between.devices, 1 | insoles);
}

#[test]
fn nothing_is_interpolated_over_a_gap() {
    let mut alignment = empty();
    take_ground(&mut alignment, &ground(0, 700.0), NOW_NS);
    take_ground(&mut alignment, &ground(200_000_000, 700.0), NOW_NS);
    take_suit(&mut alignment, &suit(100_000_000), NOW_NS);
    assert!(alignment.next(200_000_000, WAIT_MAX_NS).unwrap().ground.is_none());
}

#[test]
fn time_that_does_not_advance_is_rejected() {
    let mut alignment = empty();
    take_ground(&mut alignment, &ground(5, 1.0), NOW_NS);
    take_ground(&mut alignment, &ground(5, 2.0), NOW_NS);
    take_ground(&mut alignment, &ground(4, 3.0), NOW_NS);
    take_suit(&mut alignment, &suit(9), NOW_NS);
    take_suit(&mut alignment, &suit(9), NOW_NS);
    assert_eq!(alignment.refused(), 3);
    assert_eq!(alignment.newest_ground().unwrap().force_n[2], 1.0);
}

#[test]
fn a_tare_averages_the_last_samples_of_an_empty_plate_and_applies_once() {
    let mut alignment = empty();
    for millisecond in 0..500 {
        let force = if millisecond < 100 { 706.0 } else { 30.0 };
        take_ground(&mut alignment, &ground(millisecond * 1_000_000, force), NOW_NS);
    }
    let tare = alignment.tare(150.0).unwrap();
    assert!((tare.force_n[2] - 30.0).abs() < 1e-9, "{tare:?}");
    assert!(alignment.tare(150.0).unwrap().force_n[2].abs() < 1e-9, "the second tare finds nothing left");
    take_ground(&mut alignment, &ground(500 * 1_000_000, 400.0), NOW_NS);
    assert!(alignment.tare(150.0).is_none(), "somebody steps on");
}

#[test]
fn a_full_queue_drops_its_oldest() {
    let mut alignment = empty();
    for index in 1..=SUIT_QUEUE as u64 + 3 {
        take_suit(&mut alignment, &suit(index), NOW_NS);
    }
    assert_eq!(alignment.next(u64::MAX, WAIT_MAX_NS).unwrap().suit.sample_time_ns, 4);
    assert!(alignment.is_sound());
}

#[test]
fn the_period_is_estimated_and_a_gap_is_not_a_period() {
    let mut alignment = empty();
    let mut time_ns = 0;
    for _ in 0..20 {
        time_ns += 4_166_667;
        take_suit(&mut alignment, &suit(time_ns), NOW_NS);
    }
    take_suit(&mut alignment, &suit(time_ns + 500_000_000), NOW_NS);
    assert!(alignment.suit_period_ns() < 5_000_000);
}

#[test]
fn lost_samples_do_not_shift_the_mean_of_the_wrench() {
    let at_ns = 200_000_000;
    let mean = |is_kept: fn(u64) -> bool| {
        let mut alignment = empty();
        for millisecond in (0..500).filter(|millisecond| is_kept(*millisecond)) {
            take_ground(&mut alignment, &ground(millisecond * 1_000_000, millisecond as f64), NOW_NS);
        }
        alignment.ground_around(at_ns, 70_000_000).unwrap().force_n[2]
    };
    assert!((mean(|_| true) - 200.0).abs() < 1e-9);
    let sparse_after = |millisecond: u64| millisecond <= 200 || millisecond.is_multiple_of(5);
    assert!((mean(sparse_after) - 200.0).abs() < 0.05, "{}", mean(sparse_after));
    let with_a_gap = |millisecond: u64| !(181..200).contains(&millisecond);
    assert!((mean(with_a_gap) - 200.0).abs() < 0.5, "{}", mean(with_a_gap));
}
