//! What consumers report of their pick-up, as histograms of the time that we looked.
//!
//! Reports are cumulative since the consumer's start. The difference of two is what happened between them, and a
//! consumer that starts anew begins afresh.

use equipoise_core::message::PickUp;
use equipoise_core::message::pick_up::{BUCKETS, shortest_ns};
use hdrhistogram::Histogram;

use crate::histograms::{DIGITS, HIGHEST_NS, LOWEST_NS};

/// What a consumer's three histograms are called and mean, in the order of `PickUp::max_ns`.
pub const PICK_UP_STAGES: [(&str, &str); 3] = [
    ("pick_up", "publish_start_ns -> consumer"),
    ("from_due", "due_ns -> consumer"),
    ("from_suit", "newest suit_sample_time_ns -> consumer"),
];

/// What one consumer saw while we looked.
#[derive(Debug, Clone)]
pub struct ConsumerTimes {
    /// Its name; with its process where two have the same.
    pub name: String,
    /// Its process.
    pub process_id: u32,
    /// States picked up.
    pub states: u64,
    /// States that it never saw.
    pub states_missed: u64,
    /// Times of each of [`PICK_UP_STAGES`], ns.
    pub times_ns: [Histogram<u64>; 3],
}

/// Who reports: process and start tell two lives of one name apart.
type Life = (u32, u64, [u8; 32]);

/// The first report of each consumer that counts, and the newest.
#[derive(Debug)]
struct Reports {
    life: Life,
    before: Option<Box<PickUp>>,
    newest: Box<PickUp>,
}

/// Takes reports in and says what they tell of the time since it was made.
#[derive(Debug)]
pub struct PickUps {
    since_ns: u64,
    reports: Vec<Reports>,
}

/// More consumers than a station has places for are not kept.
const CONSUMERS_MAX: usize = 64;

impl PickUps {
    /// Looks at what happens from `since_ns` on, CLOCK_MONOTONIC.
    pub fn new(since_ns: u64) -> PickUps {
        PickUps { since_ns, reports: Vec::new() }
    }

    /// Takes one report in. One from before the beginning is passed over: it may tell of a time long ago.
    pub fn see(&mut self, report: &PickUp) {
        if report.time_ns < self.since_ns {
            return;
        }
        let life = (report.process_id, report.since_ns, report.consumer);
        if let Some(known) = self.reports.iter_mut().find(|known| known.life == life) {
            if has_grown(&known.newest, report) {
                *known.newest = *report;
            }
            return;
        }
        if self.reports.len() < CONSUMERS_MAX {
            // What began after us happened under our eyes from its first state on.
            let before = (report.since_ns < self.since_ns).then(|| Box::new(*report));
            self.reports.push(Reports { life, before, newest: Box::new(*report) });
        }
    }

    /// What happened between the first report and the newest, by consumer; a consumer without two is left out.
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

/// What a consumer reported of itself since its own start.
pub fn since_its_start(report: &PickUp) -> ConsumerTimes {
    ConsumerTimes {
        name: name_of(&report.consumer),
        process_id: report.process_id,
        states: report.states,
        states_missed: report.states_missed,
        times_ns: core::array::from_fn(|which| histogram(report, None, which)),
    }
}

/// Whether every count of `later` is at least that of `earlier`: what shrinks is no report of the same life.
fn has_grown(earlier: &PickUp, later: &PickUp) -> bool {
    let grown = |which: usize| {
        let pairs = buckets(later, which).iter().zip(buckets(earlier, which));
        pairs.into_iter().all(|(later, earlier)| later >= earlier)
    };
    later.states >= earlier.states && (0..PICK_UP_STAGES.len()).all(grown)
}

fn buckets(report: &PickUp, which: usize) -> &[u64; BUCKETS] {
    [&report.published_to_consumer, &report.due_to_consumer, &report.suit_to_consumer][which]
}

/// The times between two reports. Each stands in the middle of its bucket, so is off by 3.2 % at the most; the longest
/// stands where it was if it is known, or else at its bucket's end.
fn histogram(newest: &PickUp, before: Option<&PickUp>, which: usize) -> Histogram<u64> {
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
    // Entering a value zero times would still make it the maximum.
    if count_of(last) > 1 {
        times_ns.saturating_record_n(middle_ns(last).min(max_ns), count_of(last) - 1);
    }
    times_ns.saturating_record(max_ns);
    times_ns
}

/// The longest time of a bucket; the last one's has no end.
fn end_ns(bucket: usize) -> u64 {
    if bucket + 1 < BUCKETS { shortest_ns(bucket + 1) - 1 } else { u64::MAX }
}

fn middle_ns(bucket: usize) -> u64 {
    let shortest = shortest_ns(bucket);
    if bucket + 1 < BUCKETS { shortest + (shortest_ns(bucket + 1) - shortest) / 2 } else { shortest }
}

/// The name as a tag of an interval log may have it: what else a consumer wrote there is left out.
fn name_of(name: &[u8; 32]) -> String {
    let name: String = name
        .iter()
        .take_while(|byte| **byte != 0)
        .filter(|byte| byte.is_ascii_alphanumeric() || [b'-', b'_'].contains(byte))
        .map(|byte| char::from(*byte))
        .collect();
    if name.is_empty() { "unnamed".to_owned() } else { name }
}

/// Consumers of one name get their process, and lives of one process a number, put behind it.
pub fn tell_apart(consumers: &mut [ConsumerTimes]) {
    let names: Vec<(String, u32)> = consumers.iter().map(|one| (one.name.clone(), one.process_id)).collect();
    for (index, (name, process_id)) in names.iter().enumerate() {
        if names.iter().filter(|(other, _)| other == name).count() > 1 {
            let lives = names[..index].iter().filter(|one| **one == (name.clone(), *process_id)).count();
            let life = if lives > 0 { format!("-{}", lives + 1) } else { String::new() };
            consumers[index].name = format!("{name}-{process_id}{life}");
        }
    }
}

#[cfg(test)]
mod tests;
