//! A consumer with a publishing process: counts, death and restart of the daemon, and the consumer's report.
#![expect(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use bytemuck::Zeroable;
use common::{PERIOD, Root, Station, root, until};
use equipoise_bus::{BusError, Channel, Event, Topic};
use equipoise_client::clock::now_ns;
use equipoise_client::{Consumer, ConsumerSettings, NoReading, Reading};
use equipoise_core::message::consumer_receipt::BUCKETS;
use equipoise_core::message::{ConsumerReceipt, EarlyState, State};
use std::thread::sleep;
use std::time::Duration;

const SHORT: Duration = Duration::from_millis(20);

/// Not a test: body of the child process, until it is killed or a time-out passes.
#[test]
fn child_publishes() {
    common::publish_until_killed();
}

fn station(root: &Root) -> Station {
    Station::start(root, "child_publishes")
}

fn next(consumer: &mut Consumer) -> Reading {
    until("a state is read", || consumer.next(SHORT).ok())
}

fn entries(histogram: &[u64; BUCKETS]) -> u64 {
    histogram.iter().sum()
}

#[test]
fn states_and_missed_add_up_to_the_cycles() {
    let root = root();
    let _station = station(&root);
    let mut consumer = root.consumer("slow");
    let first = next(&mut consumer);
    let (mut readings, mut missed, mut last) = (1, 0, first);
    for round in 0..200 {
        if round % 40 == 39 {
            sleep(40 * PERIOD); // longer than the queue
        }
        let reading = next(&mut consumer);
        assert!(reading.is_new && !reading.restarted);
        assert!(reading.state.time_ns > last.state.time_ns);
        assert_eq!(reading.state.cycle, last.state.cycle + 1 + reading.missed);
        (readings, missed, last) = (readings + 1, missed + reading.missed, reading);
    }
    let cycles = last.state.cycle - first.state.cycle + 1;
    assert_eq!(readings + missed, cycles);
    assert!(missed > 0, "the pauses were not long enough to lose anything");
    let report = consumer.receipt_report();
    // States that were too old may precede the first returned one.
    assert!(report.states + report.states_missed >= cycles);
    assert_eq!(entries(&report.published_to_consumer), report.states);
    assert_eq!(entries(&report.due_to_consumer), report.states);
    assert!((1..=report.states).contains(&entries(&report.suit_to_consumer)));
}

#[test]
fn nothing_is_handed_out_past_its_age() {
    let root = root();
    let _station = station(&root);
    // Deep enough for states to become too old in the queue.
    let settings = ConsumerSettings { depth: 64, ..root.settings("aged") };
    let mut consumer = Consumer::join_with(settings.clone()).unwrap();
    for round in 0..100 {
        if round % 20 == 19 {
            sleep(2 * settings.stale_after);
        }
        let reading = next(&mut consumer);
        assert!(Duration::from_nanos(reading.age_ns) <= settings.stale_after);
        assert_eq!(reading.age_ns, reading.received_ns - reading.state.time_ns);
        assert_eq!(reading.sample_age_ns, Some(reading.age_ns + 70_000_000));
        if let Ok(latest) = consumer.latest() {
            assert!(Duration::from_nanos(latest.age_ns) <= settings.stale_after);
            assert!(latest.state.time_ns >= reading.state.time_ns);
            assert_eq!(latest.is_new, latest.state.time_ns > reading.state.time_ns);
        }
    }
}

#[test]
fn a_dead_daemon_is_silence_and_the_next_one_is_found() {
    let root = root();
    let mut consumer = root.consumer("patient");
    let mut latest_ns = 0;
    for start in 0..3 {
        assert!(matches!(consumer.next(Duration::ZERO), Err(NoReading::Silent { .. })));
        let station = station(&root);
        let first = next(&mut consumer);
        assert!(first.state.time_ns > latest_ns, "an old state as new");
        assert_eq!((first.restarted, first.daemon_life), (start > 0, start + 1));
        if start > 0 {
            assert!(first.missed >= first.state.cycle - 1, "the new daemon's first states are missed");
        }
        for _ in 0..20 {
            let reading = next(&mut consumer);
            assert_eq!((reading.restarted, reading.daemon_life), (false, first.daemon_life));
            latest_ns = reading.state.time_ns;
        }
        drop(station);
        // States in transit when it died may still arrive; none twice, and then none at all.
        until("it is silent", || match consumer.next(SHORT) {
            Ok(reading) => {
                assert!(reading.state.time_ns > latest_ns, "an old state as new");
                latest_ns = reading.state.time_ns;
                None
            }
            Err(_) => Some(()),
        });
        sleep(ConsumerSettings::new("any", "any").stale_after);
        for _ in 0..10 {
            assert!(consumer.next(Duration::from_millis(1)).is_err());
            assert!(matches!(consumer.latest(), Err(NoReading::Silent { .. })));
        }
    }
}

#[test]
fn what_a_dead_daemon_left_in_the_buffer_is_not_current() {
    let root = root();
    // Long, because the machine may be busy between the two calls below.
    let stale_after = Duration::from_millis(500);
    let mut consumer =
        Consumer::join_with(ConsumerSettings { stale_after, ..root.settings("late") }).unwrap();
    let station = station(&root);
    let first = next(&mut consumer).state.cycle;
    // More than the queue holds.
    let mut second = root.consumer("current");
    until("20 more cycles", || second.next(SHORT).ok().filter(|reading| reading.state.cycle > first + 20));
    drop(station);
    sleep(3 * stale_after);
    // The consumer did not read meanwhile, so the queue is full of old states.
    assert!(matches!(consumer.next(SHORT), Err(NoReading::Stale { .. })));
    // Calls between two states repeat the same reason instead of alternating.
    assert!(matches!(consumer.latest(), Err(NoReading::Stale { .. })));
    sleep(2 * stale_after);
    assert!(matches!(consumer.next(SHORT), Err(NoReading::Silent { .. })));
    assert!(matches!(consumer.latest(), Err(NoReading::Silent { .. })));
    // Old states were received, so they count in the report.
    let report = consumer.receipt_report();
    assert!(report.states > State::SERVICE.depth as u64, "{}", report.states);
}

#[test]
fn a_daemon_with_another_clock_is_refused_with_the_reason() {
    let root = root();
    let bus = root.bus("daemon");
    let patient = ConsumerSettings { stale_after: common::PATIENCE, ..root.settings("elsewhere") };
    let mut consumer = Consumer::join_with(patient).unwrap();
    let publisher = bus.publisher::<State>().unwrap();
    let events = bus.notifier(Channel::Results).unwrap();
    let time_ns = now_ns() + 3_600_000_000_000;
    publisher.send(&State { cycle: 1, time_ns, ..State::zeroed() }).unwrap();
    events.notify(Event::NewState).unwrap();
    let error = consumer.next(SHORT).unwrap_err();
    assert!(matches!(error, NoReading::OtherClock { .. }), "{error}");
    assert!(matches!(consumer.latest(), Err(NoReading::OtherClock { .. })));
    // A state from the future must not make later correct states count as old.
    for cycle in 2..5 {
        let correct = State { cycle, time_ns: now_ns(), ..State::zeroed() };
        publisher.send(&correct).unwrap();
        let reading = if cycle % 2 == 0 { consumer.next(SHORT) } else { consumer.latest() };
        assert_eq!(reading.map(|reading| reading.state.cycle), Ok(cycle));
    }
    assert_eq!(consumer.receipt_report().states, 3, "what has another clock is not counted among the delays");
}

#[test]
fn who_asks_seldom_is_given_the_newest() {
    let root = root();
    let _station = station(&root);
    // Long, because the machine may be busy, but shorter than the sleep below.
    let patient = ConsumerSettings { stale_after: Duration::from_millis(2500), ..root.settings("seldom") };
    let mut consumer = Consumer::join_with(patient).unwrap();
    next(&mut consumer);
    // Longer than the silence after which a consumer rejoins.
    sleep(Duration::from_secs(3));
    let reading = consumer.latest().unwrap();
    assert!(reading.is_new && reading.missed > 0);
}

#[test]
fn a_bus_that_was_removed_and_recreated_is_rejoined() {
    rejoins(|consumer| consumer.next(Duration::from_millis(200)));
}

#[test]
fn a_polling_consumer_rejoins() {
    rejoins(|consumer| consumer.next(Duration::ZERO));
}

#[test]
fn a_consumer_of_the_newest_state_rejoins() {
    rejoins(Consumer::latest);
}

fn rejoins(wait: impl Fn(&mut Consumer) -> Result<Reading, NoReading>) {
    let root = root();
    let mut consumer = root.consumer("stayer");
    let first = station(&root);
    next(&mut consumer);
    let before = consumer.receipt_report().states;
    drop(first);
    root.remove_the_bus();
    let _second = station(&root);
    let found = until("the new bus is found", || {
        sleep(PERIOD);
        // States of the first daemon may still be returned.
        wait(&mut consumer).ok().filter(|reading| reading.daemon_life > 1)
    });
    assert!(found.restarted);
    assert!(consumer.receipt_report().states > before, "the report goes on");
}

#[test]
fn the_report_is_published_and_the_last_word_too() {
    let root = root();
    let bus = root.bus("latency");
    let mut reports = bus.subscriber::<ConsumerReceipt>(16).unwrap();
    let _station = station(&root);
    let mut consumer = root.consumer("reporter");
    let first: ConsumerReceipt = until("a report comes", || {
        let _ = consumer.next(SHORT);
        reports.receive().unwrap()
    });
    assert_eq!(&first.consumer[..9], b"reporter\0");
    assert_eq!(first.process_id, std::process::id());
    assert!(first.time_ns >= first.since_ns && first.states > 0);
    next(&mut consumer);
    let mut counted = *consumer.receipt_report();
    drop(consumer);
    let last = until("the last report comes", || reports.latest().unwrap());
    counted.time_ns = last.time_ns;
    assert!(last == counted, "{} states reported, {} counted", last.states, counted.states);

    let silent = ConsumerSettings { report: false, ..root.settings("modest") };
    let mut consumer = Consumer::join_with(silent).unwrap();
    next(&mut consumer);
    drop(consumer);
    assert!(reports.receive().unwrap().is_none(), "it was asked not to report");
}

// A state is always queued, so `next` never sleeps.
#[test]
fn who_is_slower_than_the_loop_reports_too() {
    let root = root();
    let mut reports = root.bus("latency").subscriber::<ConsumerReceipt>(16).unwrap();
    let _station = station(&root);
    let mut consumer = root.consumer("beats");
    let settled = now_ns();
    let report = until("a report comes", || {
        sleep(10 * PERIOD);
        next(&mut consumer);
        reports.receive().unwrap()
    });
    assert!(report.time_ns > settled && report.states > 0);
}

#[test]
fn who_finds_no_place_for_its_report_reads_all_the_same() {
    let root = root();
    let _station = station(&root);
    let places = ConsumerReceipt::SERVICE.publishers_max();
    let reporting: Vec<Consumer> =
        (0..places).map(|index| root.consumer(&format!("consumer-{index}"))).collect();
    assert!(reporting.iter().all(|consumer| consumer.report_refusal().is_none()));
    let mut one_more = root.consumer("one-more");
    assert_eq!(
        one_more.report_refusal().unwrap(),
        &BusError::Full { service: "equipoise/test/receipt".to_owned(), what: "publisher", most: places }
    );
    let reading = next(&mut one_more);
    assert!(next(&mut one_more).state.cycle > reading.state.cycle);
    assert!(one_more.receipt_report().states >= 2, "it counts for itself");
}

#[test]
fn a_name_or_depth_that_cannot_be_is_refused() {
    let root = root();
    let error = Consumer::join_with(root.settings("a b")).unwrap_err();
    assert!(matches!(error, BusError::Name { what: "role", .. }), "{error}");
    let error = Consumer::join_with(ConsumerSettings { depth: 0, ..root.settings("deep") }).unwrap_err();
    assert!(matches!(error, BusError::Depth { asked: 0, .. }), "{error}");
}

#[test]
fn an_early_state_is_new_once_and_not_returned_past_its_deadline() {
    let root = root();
    let bus = root.bus("daemon");
    let publisher = bus.publisher::<EarlyState>().unwrap();
    let mut consumer = root.consumer("early");
    assert!(matches!(consumer.early(), Err(NoReading::Silent { .. })), "it subscribes");
    let send = |time_ns: u64| {
        let early = EarlyState { time_ns, sample_time_ns: time_ns - 2_000_000, ..EarlyState::zeroed() };
        publisher.send(&early).unwrap();
    };
    let deadline = EarlyState::SERVICE.deadline.unwrap();
    // On a busy machine the deadline may pass between these calls; they are repeated with another state.
    until("all calls within the deadline", || {
        let first_ns = now_ns();
        send(first_ns);
        let (reading, again) = (consumer.early(), consumer.early());
        // Left over from an earlier daemon.
        send(first_ns - 1);
        let after = consumer.early();
        if Duration::from_nanos(now_ns() - first_ns) > deadline {
            return None;
        }
        let reading = reading.unwrap();
        assert!(reading.is_new && reading.early.time_ns == first_ns);
        assert_eq!(reading.sample_age_ns, reading.age_ns + 2_000_000);
        for again in [again, after] {
            assert!(
                again.as_ref().is_ok_and(|again| !again.is_new && again.early == reading.early),
                "{again:?}"
            );
        }
        Some(())
    });
    sleep(deadline + SHORT);
    assert!(matches!(consumer.early(), Err(NoReading::Stale { .. })));
}
