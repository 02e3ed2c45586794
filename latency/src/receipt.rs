//! Histograms of the consumers' receipts, restricted to the observed interval.
//!
//! Reports are cumulative since the consumer's start. The difference of two reports covers the time between them; a
//! restarted consumer starts at 0 again.

use equipoise_core::message::ConsumerReceipt;
use equipoise_core::message::consumer_receipt::{BUCKETS, shortest_ns};
use hdrhistogram::Histogram;

use crate::histograms::{DIGITS, HIGHEST_NS, LOWEST_NS};

/// Names and definitions of a consumer's three histograms, in the order of `ConsumerReceipt::max_ns`.
pub const RECEIPT_STAGES: [(&str, &str); 3] = [
    ("receipt", "publish_start_ns -> consumer"),
    ("from_due", "due_ns -> consumer"),
    ("from_suit", "newest suit_sample_time_ns -> consumer"),
];

/// Values of one consumer in the observed interval.
#[derive(Debug, Clone)]
pub struct ConsumerTimes {
    /// Its name; with its process id if two consumers have the same name.
    pub name: String,
    /// Its process id.
    pub process_id: u32,
    /// States received.
    pub states: u64,
    /// States missed.
    pub states_missed: u64,
    /// Times of each of [`RECEIPT_STAGES`], ns.
    pub times_ns: [Histogram<u64>; 3],
}

/// Key of a report: process id, start time and name. Process and start distinguish two runs with one name.
type Instance = (u32, u64, [u8; 32]);

/// The baseline report of a consumer and its newest report.
#[derive(Debug)]
struct Reports {
    instance: Instance,
    before: Option<Box<ConsumerReceipt>>,
    newest: Box<ConsumerReceipt>,
}

/// Collects reports and computes the values since its construction.
#[derive(Debug)]
pub struct ConsumerReceipts {
    since_ns: u64,
    reports: Vec<Reports>,
}

/// Limit of the consumers stored, as many as a station's bus allows.
const CONSUMERS_MAX: usize = 64;

impl ConsumerReceipts {
    /// Observes from `since_ns` on, CLOCK_MONOTONIC.
    pub fn new(since_ns: u64) -> ConsumerReceipts {
        ConsumerReceipts { since_ns, reports: Vec::new() }
    }

    /// Adds one report. Ignores reports from before the start, which may refer to an earlier time.
    pub fn ingest(&mut self, report: &ConsumerReceipt) {
        if report.time_ns < self.since_ns {
            return;
        }
        let instance = (report.process_id, report.since_ns, report.consumer);
        if let Some(known) = self.reports.iter_mut().find(|known| known.instance == instance) {
            if has_grown(&known.newest, report) {
                *known.newest = *report;
            }
            return;
        }
        if self.reports.len() < CONSUMERS_MAX {
            // A consumer that started after `since_ns` was observed from its first state on and needs no baseline.
            let before = (report.since_ns < self.since_ns).then(|| Box::new(*report));
            self.reports.push(Reports { instance, before, newest: Box::new(*report) });
        }
    }

    /// Values between the first report and the newest, by consumer; consumers without new states are omitted.
    pub fn consumers(&self) -> Vec<ConsumerTimes> {
        let mut all: Vec<ConsumerTimes> = self.reports.iter().filter_map(Reports::times).collect();
        all.sort_by(|a, b| (&a.name, a.process_id).cmp(&(&b.name, b.process_id)));
        tell_apart(&mut all);
        all
    }
}

impl Reports {
    fn times(&self) -> Option<ConsumerTimes> {
        let (newest, before) = (&self.newest, self.before.as_deref());
        let (states_before, missed_before) =
            before.map_or((0, 0), |before| (before.states, before.states_missed));
        let states = newest.states.saturating_sub(states_before);
        (states > 0).then(|| ConsumerTimes {
            name: name_of(&newest.consumer),
            process_id: newest.process_id,
            states,
            states_missed: newest.states_missed.saturating_sub(missed_before),
            times_ns: core::array::from_fn(|which| histogram(newest, before, which)),
        })
    }
}

/// Values of a consumer since its own start.
pub fn since_its_start(report: &ConsumerReceipt) -> ConsumerTimes {
    ConsumerTimes {
        name: name_of(&report.consumer),
        process_id: report.process_id,
        states: report.states,
        states_missed: report.states_missed,
        times_ns: core::array::from_fn(|which| histogram(report, None, which)),
    }
}

/// Whether every count of `later` is at least that of `earlier`: a decrease means another run.
fn has_grown(earlier: &ConsumerReceipt, later: &ConsumerReceipt) -> bool {
    let grown = |which: usize| {
        let pairs = buckets(later, which).iter().zip(buckets(earlier, which));
        pairs.into_iter().all(|(later, earlier)| later >= earlier)
    };
    later.states >= earlier.states && (0..RECEIPT_STAGES.len()).all(grown)
}

fn buckets(report: &ConsumerReceipt, which: usize) -> &[u64; BUCKETS] {
    [&report.published_to_consumer, &report.due_to_consumer, &report.suit_to_consumer][which]
}

/// The times between two reports. Each is placed at the middle of its bucket, an error of at most 3.2 %; the longest is
/// exact if available, or else at its bucket's upper end.
fn histogram(newest: &ConsumerReceipt, before: Option<&ConsumerReceipt>, which: usize) -> Histogram<u64> {
    let mut times_ns = Histogram::new_with_bounds(LOWEST_NS, HIGHEST_NS, DIGITS)
        .expect("the bounds are constants that hdrhistogram accepts");
    let count_of = |bucket: usize| {
        let earlier = before.map_or(0, |before| buckets(before, which)[bucket]);
        buckets(newest, which)[bucket].saturating_sub(earlier)
    };
    let Some(last) = (0..BUCKETS).rev().find(|bucket| count_of(*bucket) > 0) else { return times_ns };
    for (bucket, count) in (0..last).map(|bucket| (bucket, count_of(bucket))).filter(|(_, count)| *count > 0)
    {
        times_ns.saturating_record_n(middle_ns(bucket), count);
    }
    let known = newest.max_ns[which] > before.map_or(0, |before| before.max_ns[which]);
    let max_ns = if known { newest.max_ns[which] } else { end_ns(last).min(newest.max_ns[which]) };
    // Recording a value zero times would still make it the maximum.
    if count_of(last) > 1 {
        times_ns.saturating_record_n(middle_ns(last).min(max_ns), count_of(last) - 1);
    }
    times_ns.saturating_record(max_ns);
    times_ns
}

/// The longest time of a bucket; the last bucket is unbounded.
fn end_ns(bucket: usize) -> u64 {
    if bucket + 1 < BUCKETS { shortest_ns(bucket + 1) - 1 } else { u64::MAX }
}

fn middle_ns(bucket: usize) -> u64 {
    let shortest = shortest_ns(bucket);
    if bucket + 1 < BUCKETS { shortest + (shortest_ns(bucket + 1) - shortest) / 2 } else { shortest }
}

/// The name restricted to characters that are valid in a tag of an interval log.
fn name_of(name: &[u8; 32]) -> String {
    let name: String = name
        .iter()
        .take_while(|byte| **byte != 0)
        .filter(|byte| byte.is_ascii_alphanumeric() || [b'-', b'_'].contains(byte))
        .map(|byte| char::from(*byte))
        .collect();
    if name.is_empty() { "unnamed".to_owned() } else { name }
}

/// Makes names unique: appends the process id to equal names, and a number to several runs of one process.
pub fn tell_apart(consumers: &mut [ConsumerTimes]) {
    let names: Vec<(String, u32)> = consumers.iter().map(|one| (one.name.clone(), one.process_id)).collect();
    for (index, (name, process_id)) in names.iter().enumerate() {
        if names.iter().filter(|(other, _)| other == name).count() > 1 {
            let earlier_runs =
                names[..index].iter().filter(|one| **one == (name.clone(), *process_id)).count();
            let suffix = if earlier_runs > 0 { format!("-{}", earlier_runs + 1) } else { String::new() };
            consumers[index].name = format!("{name}-{process_id}{suffix}");
        }
    }
}

#[cfg(test)]
mod tests;
