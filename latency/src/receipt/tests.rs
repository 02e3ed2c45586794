//! Tests of the consumer receipts: quantiles against raw times, restarts, invalid reports, and output.

use bytemuck::Zeroable;
use equipoise_core::message::State;

use super::*;

const S: u64 = 1_000_000_000;

/// A report of a consumer that started at `since_ns`.
fn report(name: &str, process_id: u32, since_ns: u64) -> ConsumerReceipt {
    let mut report = ConsumerReceipt { process_id, since_ns, time_ns: since_ns, ..ConsumerReceipt::zeroed() };
    report.consumer[..name.len()].copy_from_slice(name.as_bytes());
    report
}

/// Adds states that were received this many ns after they were published.
fn enter(report: &mut ConsumerReceipt, times_ns: &[u64]) {
    for time_ns in times_ns {
        let state = State { published_ns: S, time_ns: S / 2, ..State::zeroed() };
        report.enter(S + time_ns, &state, 0, None);
    }
}

/// Deterministic pseudo-random times over nine decades.
fn times(count: usize, mut seed: u64) -> Vec<u64> {
    let mut next = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..count).map(|_| 10_f64.powf(9.9 * next()) as u64).collect()
}

fn within_a_bucket(quantile_ns: u64, true_ns: u64) -> bool {
    quantile_ns.abs_diff(true_ns) as f64 <= 0.0625 * true_ns as f64
}

#[test]
fn percentiles_are_those_of_the_raw_times_to_a_bucket() {
    for (count, seed) in [(1, 1), (2, 2), (17, 3), (1000, 4), (50_000, 5)] {
        let mut raw = times(count, seed);
        let mut consumer = report("a", 1, 1);
        enter(&mut consumer, &raw);
        raw.sort_unstable();
        let histogram = &since_its_start(&consumer).times_ns[0];
        assert_eq!(histogram.len(), count as u64);
        for quantile in [0.0, 0.01, 0.25, 0.5, 0.9, 0.99, 0.999, 0.9999, 1.0] {
            let rank = ((quantile * count as f64).ceil() as usize).clamp(1, count) - 1;
            let quantile_ns = histogram.value_at_quantile(quantile);
            assert!(within_a_bucket(quantile_ns, raw[rank]), "{quantile}: {quantile_ns} for {}", raw[rank]);
        }
        // The maximum is transmitted separately, so only hdrhistogram's own 0.1 % is lost.
        let max_ns = raw[count - 1];
        assert!(histogram.max().abs_diff(max_ns) * 1000 <= max_ns, "{} for {max_ns}", histogram.max());
    }
}

#[test]
fn only_times_since_the_start_are_reported() {
    let mut consumer = report("a", 1, 5 * S);
    enter(&mut consumer, &[4 * S; 100]);
    consumer.states_missed = 7;
    let mut receipts = ConsumerReceipts::new(100 * S);
    // The last report before the start, which a late subscriber receives from the history.
    consumer.time_ns = 100 * S - 1;
    receipts.ingest(&consumer);
    assert!(receipts.reports.is_empty());
    for second in 100..110 {
        consumer.time_ns = second * S;
        receipts.ingest(&consumer);
        enter(&mut consumer, &[1_000, 2_000]);
        consumer.states_missed += 1;
    }
    let consumers = receipts.consumers();
    let [consumer] = &consumers[..] else { panic!("{consumers:?}") };
    assert_eq!((consumer.name.as_str(), consumer.states, consumer.states_missed), ("a", 18, 9));
    let histogram = &consumer.times_ns[0];
    assert_eq!(histogram.len(), 18);
    // The longest time of the run lies before the interval; the longest within it is resolved to a bucket.
    assert!(within_a_bucket(histogram.max(), 2_000), "{}", histogram.max());
}

#[test]
fn a_restarted_consumer_begins_with_empty_statistics() {
    let mut receipts = ConsumerReceipts::new(100 * S);
    let mut first = report("a", 1, 5 * S);
    enter(&mut first, &[50; 10]);
    first.time_ns = 101 * S;
    receipts.ingest(&first);
    enter(&mut first, &[50; 10]);
    first.time_ns = 102 * S;
    receipts.ingest(&first);
    // Restarted: fewer states than before, all within the interval.
    let mut second = report("a", 2, 103 * S);
    enter(&mut second, &[70; 3]);
    second.time_ns = 104 * S;
    receipts.ingest(&second);
    let states: Vec<_> = receipts.consumers().iter().map(|one| (one.name.clone(), one.states)).collect();
    assert_eq!(states, [("a-1".to_owned(), 10), ("a-2".to_owned(), 3)]);
}

#[test]
fn decreasing_counts_are_ignored_and_names_are_sanitised() {
    let mut receipts = ConsumerReceipts::new(1);
    let mut strange = report("a,b c\n", 9, 2);
    enter(&mut strange, &[40; 4]);
    strange.time_ns = 10;
    receipts.ingest(&strange);
    let mut shrunk = strange;
    shrunk.published_to_consumer = [0; BUCKETS];
    shrunk.time_ns = 11;
    receipts.ingest(&shrunk);
    let consumers = receipts.consumers();
    assert_eq!((consumers[0].name.as_str(), consumers[0].times_ns[0].len()), ("abc", 4));
    assert_eq!(name_of(&[0xff; 32]), "unnamed");
}

#[test]
fn a_time_beyond_the_last_bucket_is_counted_in_the_last_bucket() {
    let mut consumer = report("a", 1, 1);
    enter(&mut consumer, &[40 * S, 18 * S]);
    let histogram = &since_its_start(&consumer).times_ns[0];
    assert_eq!(histogram.len(), 2);
    assert!(histogram.max() >= HIGHEST_NS && histogram.min() > HIGHEST_NS / 1000 * 999);
}

#[test]
fn report_and_log_contain_consumers_by_name() {
    let mut consumer = report("controller-1", 7, 1);
    enter(&mut consumer, &[1_000; 100]);
    consumer.states_missed = 3;
    let consumers = [since_its_start(&consumer)];
    let report = crate::Report::of(&crate::PathHistograms::new()).with_consumers(&consumers);
    let rows = &report.consumers[0].stages;
    assert_eq!((rows[0].stage.as_ref(), rows[0].count), ("controller-1.receipt", 100));
    let table = report.to_string();
    assert!(table.contains("controller-1.from_due") && !table.contains("from_suit"), "{table}");
    assert!(table.contains("controller-1 (process 7): 100 states picked up, 3 missed"), "{table}");

    let mut log = crate::HlogWriter::new(Vec::new(), std::time::SystemTime::UNIX_EPOCH).unwrap();
    log.write_consumers(Default::default(), std::time::Duration::from_secs(1), &consumers).unwrap();
    let text = String::from_utf8(log.into_inner()).unwrap();
    let lines: Vec<_> = text.lines().filter(|line| line.starts_with("Tag=")).collect();
    assert_eq!(lines.len(), 2, "{text}");
    assert!(lines[0].starts_with("Tag=controller-1.receipt,0.000,1.000,"), "{text}");
}
