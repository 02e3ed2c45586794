use rtrb::PushError;

use super::*;

fn outcome(cycle: u64) -> Outcome {
    Outcome { state: State { cycle, ..State::zeroed() }, record: CycleRecord::zeroed() }
}

#[test]
fn order_is_preserved_and_a_full_ring_rejects_values() {
    let (mut producer, mut consumer) = prefaulted(2, 0);
    assert!(consumer.is_empty() && !producer.is_full());
    assert_eq!(
        (producer.push(1), producer.push(2), producer.push(3)),
        (Ok(()), Ok(()), Err(PushError::Full(3)))
    );
    assert!(producer.is_full());
    assert_eq!(consumer.slots(), 2);
    assert_eq!((consumer.pop().ok(), consumer.pop().ok(), consumer.pop().ok()), (Some(1), Some(2), None));
}

/// The other threads hold their ends and do not use them, as if preempted or stopped.
#[test]
fn a_stopped_thread_blocks_no_other() {
    let Rings { control, mut loop_ends, mut ingress, egress, commands, .. } = Rings::new().unwrap();
    for sequence in 0..SUIT_RING as u64 + 3 {
        ingress.push_suit(SuitSample { sequence, ..SuitSample::zeroed() }, 0);
    }
    assert_eq!(control.input_dropped(), 3, "the loop is stopped");
    let taken = std::iter::from_fn(|| loop_ends.suit.pop().ok()).map(|suit| suit.sample.sequence);
    assert!(taken.eq(0..SUIT_RING as u64), "the oldest remain, in their order");
    assert!(loop_ends.command.pop().is_err() && loop_ends.settings.pop().is_err());
    for cycle in 1..=OUTCOME_RING as u64 + 5 {
        loop_ends.push_outcome(outcome(cycle));
    }
    assert_eq!(loop_ends.output_dropped(), 5, "egress is stopped");
    assert_eq!((control.last_cycle(), egress.outcome.slots()), (OUTCOME_RING as u64 + 5, OUTCOME_RING));
    drop(commands);
}

#[test]
fn the_loop_continues_after_the_end_of_every_other_thread() {
    let Rings { control, mut loop_ends, ingress, egress, saving, commands, settings } = Rings::new().unwrap();
    drop((ingress, egress, saving, commands, settings));
    for cycle in 1..=2 * OUTCOME_RING as u64 {
        assert!(loop_ends.suit.pop().is_err() && loop_ends.command.pop().is_err());
        loop_ends.push_outcome(outcome(cycle));
    }
    assert_eq!(loop_ends.output_dropped(), OUTCOME_RING as u64);
    assert_eq!(control.last_cycle(), 2 * OUTCOME_RING as u64);
    let blank = (loop_ends.free_copies.slots(), loop_ends.free_checkpoints.slots());
    assert_eq!(blank, (STORED_COPIES, CHECKPOINTS), "boxes in a ring remain in it");
}

#[test]
fn everything_arrives_between_two_threads() {
    const COUNT: u64 = 200_000;
    let (mut producer, mut consumer) = prefaulted(64, 0);
    let sender = std::thread::spawn(move || {
        for value in 1..=COUNT {
            while producer.push(value).is_err() {
                std::thread::yield_now();
            }
        }
    });
    let mut last = 0;
    while last < COUNT {
        match consumer.pop() {
            Ok(value) => {
                assert_eq!(value, last + 1);
                last = value;
            }
            Err(_) => std::thread::yield_now(),
        }
    }
    sender.join().unwrap();
}

#[test]
fn no_wakeup_is_lost_and_an_awake_egress_gets_none() {
    let Rings { mut loop_ends, mut egress, .. } = Rings::new().unwrap();
    loop_ends.push_outcome(outcome(1));
    assert!(!egress.wake_up.wait(Duration::ZERO), "egress was awake");
    assert!(egress.outcome.pop().is_ok());

    const CYCLES: u64 = 20_000;
    let egress = std::thread::spawn(move || {
        let mut received = 0;
        while received < CYCLES {
            // A lost wake-up would make this sleep last for an hour.
            egress.await_outcome(WaitStrategy::Sleeping, Duration::from_secs(3600));
            while egress.outcome.pop().is_ok() {
                received += 1;
            }
        }
    });
    for cycle in 1..=CYCLES {
        while loop_ends.outcome.is_full() {
            std::thread::yield_now();
        }
        loop_ends.push_outcome(outcome(cycle));
        if cycle % 7 == 0 {
            std::thread::yield_now();
        }
    }
    egress.join().unwrap();
    assert_eq!(loop_ends.output_dropped(), 0);
}

#[test]
fn a_polling_egress_receives_every_outcome_without_wakeups() {
    const CYCLES: u64 = 2_000;
    let Rings { mut loop_ends, mut egress, .. } = Rings::new().unwrap();
    let egress = std::thread::spawn(move || {
        let mut received = 0;
        while received < CYCLES {
            egress.await_outcome(WaitStrategy::Polling, Duration::from_millis(50));
            received += std::iter::from_fn(|| egress.outcome.pop().ok()).count() as u64;
        }
    });
    for cycle in 1..=CYCLES {
        while loop_ends.outcome.is_full() {
            std::thread::yield_now();
        }
        loop_ends.push_outcome(outcome(cycle));
    }
    egress.join().unwrap();
    assert!(!loop_ends.wake_up.wait(Duration::ZERO), "an unnecessary wake-up");
}
