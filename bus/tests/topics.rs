//! Messages arrive, also at late and blocked readers.
#![expect(clippy::unwrap_used, reason = "a test may panic, and so may its helpers")]

mod common;

use bytemuck::Zeroable;
use common::{join, root};
use equipoise_bus::root::shared_memory_prefix;
use equipoise_bus::service::{STATION_MEMORY_MAX, TABLE, Table, station_memory_bytes};
use equipoise_bus::{BusError, Topic};
use equipoise_core::message::{
    AdapterHealth, ConsumerReceipt, CycleRecord, EarlyState, GroundSample, Incidents, State, SuitBody,
    SuitSample,
};

/// A message in which the value of each byte depends on its position.
fn patterned<M: Topic>(salt: u8) -> M {
    let bytes: Vec<u8> = (0..size_of::<M>()).map(|index| (index as u8).wrapping_mul(31) ^ salt).collect();
    bytemuck::pod_read_unaligned(&bytes)
}

fn comes_through<M: Topic>() {
    let root = root();
    let (writer, reader) = (join(root.path(), "writer"), join(root.path(), "reader"));
    let publisher = writer.publisher::<M>().unwrap();
    let mut subscriber = reader.subscriber::<M>(4).unwrap();
    assert_eq!(subscriber.receive().unwrap().map(|_| ()), None);
    for salt in 0..3 {
        assert_eq!(publisher.send(&patterned(salt)).unwrap(), 1);
    }
    for salt in 0..3 {
        let sent: M = patterned(salt);
        let same =
            subscriber.receive_with(|got| bytemuck::bytes_of(got) == bytemuck::bytes_of(&sent)).unwrap();
        assert_eq!(same, Some(true), "{}", M::TYPE_NAME);
    }
    assert_eq!((publisher.subscriber_count(), subscriber.publisher_count()), (1, 1));
}

#[test]
fn every_message_comes_through_unchanged() {
    comes_through::<SuitSample>();
    comes_through::<GroundSample>();
    comes_through::<SuitBody>();
    comes_through::<State>();
    comes_through::<EarlyState>();
    comes_through::<CycleRecord>();
    comes_through::<AdapterHealth>();
    comes_through::<Incidents>();
    comes_through::<ConsumerReceipt>();
}

fn cycle(number: u64) -> CycleRecord {
    CycleRecord { cycle: number, ..CycleRecord::zeroed() }
}

#[test]
fn a_late_reader_gets_the_newest_message_at_once() {
    let root = root();
    let bus = join(root.path(), "both");
    let publisher = bus.publisher::<CycleRecord>().unwrap();
    for number in 1..=5 {
        publisher.send(&cycle(number)).unwrap();
    }
    let mut late = bus.subscriber::<CycleRecord>(8).unwrap();
    // With its next message the publisher connects the reader and sends it the history.
    publisher.send(&cycle(6)).unwrap();
    let got: Vec<u64> = std::iter::from_fn(|| late.receive().unwrap()).map(|record| record.cycle).collect();
    assert_eq!(got, [5, 6]);
}

#[test]
fn a_silent_writer_can_still_serve_a_late_reader() {
    let root = root();
    let bus = join(root.path(), "both");
    let publisher = bus.publisher::<CycleRecord>().unwrap();
    publisher.send(&cycle(1)).unwrap();
    let mut late = bus.subscriber::<CycleRecord>(8).unwrap();
    publisher.update_connections().unwrap();
    assert_eq!(late.receive().unwrap().unwrap().cycle, 1);
}

#[test]
fn a_stuck_reader_does_not_block_the_writer_and_then_receives_the_newest() {
    let root = root();
    let bus = join(root.path(), "both");
    let publisher = bus.publisher::<CycleRecord>().unwrap();
    let mut deep = bus.subscriber::<CycleRecord>(3).unwrap();
    let mut newest_only = bus.subscriber::<CycleRecord>(1).unwrap();
    for number in 1..=10_000 {
        assert_eq!(publisher.send(&cycle(number)).unwrap(), 2);
    }
    assert_eq!(deep.receive().unwrap().unwrap().cycle, 9_998);
    assert_eq!(deep.latest().unwrap().unwrap().cycle, 10_000);
    assert!(deep.latest().unwrap().is_none());
    assert_eq!(newest_only.latest().unwrap().unwrap().cycle, 10_000);
}

#[test]
fn impossible_depths_are_refused() {
    let root = root();
    let bus = join(root.path(), "reader");
    for asked in [0, 1_000_000] {
        let error = bus.subscriber::<State>(asked).unwrap_err();
        assert!(matches!(error, BusError::Depth { .. }), "{error}");
    }
    assert_eq!(
        bus.subscriber::<State>(0).unwrap_err().to_string(),
        "cannot buffer 0 messages of equipoise/test/state: choose 1 to 1024"
    );
}

#[test]
fn a_third_writer_is_refused_by_name() {
    let root = root();
    let bus = join(root.path(), "writer");
    let _two = [bus.publisher::<State>().unwrap(), bus.publisher::<State>().unwrap()];
    let error = bus.publisher::<State>().unwrap_err();
    assert_eq!(
        error,
        BusError::Full { service: "equipoise/test/state".to_owned(), what: "publisher", most: 2 }
    );
}

#[test]
fn a_sensor_s_stream_has_one_writer_and_no_second_while_it_lives() {
    let root = root();
    let bus = join(root.path(), "writer");
    let first = bus.publisher::<SuitSample>().unwrap();
    let other = join(root.path(), "other");
    let error = other.publisher::<SuitSample>().unwrap_err();
    assert!(matches!(error, BusError::Full { most: 1, .. }), "{error}");
    drop(first);
    other.publisher::<SuitSample>().unwrap();
}

#[test]
fn the_table_lists_every_service_and_fits_into_memory() {
    let text = Table.to_string();
    for row in TABLE {
        assert!(text.contains(&format!("`{}`", row.suffix)), "{text}");
        assert!(row.depth <= row.depth_max && row.history <= row.depth);
    }
    assert!(station_memory_bytes() < STATION_MEMORY_MAX);
}

#[test]
fn the_table_does_not_understate_the_memory() {
    let root = root();
    let bus = join(root.path(), "daemon");
    let _states = bus.publisher::<State>().unwrap();
    let prefix = shared_memory_prefix(root.path());
    let segments = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let ours = segments.filter(|file| file.file_name().to_string_lossy().starts_with(&prefix));
    let largest = ours.map(|file| file.metadata().unwrap().len()).max().unwrap() as usize;
    let reported = State::SERVICE.memory_bytes();
    assert!(largest <= reported && largest > reported * 9 / 10, "{largest} of {reported} bytes");
}

#[test]
fn every_service_has_one_slot_more_than_writers_and_names_the_writer() {
    let root = root();
    let bus = join(root.path(), "both");
    let mut reader = bus.subscriber::<ConsumerReceipt>(32).unwrap();
    assert_eq!(reader.writer(), 0);
    let most = ConsumerReceipt::SERVICE.publishers_max();
    assert_eq!(most, ConsumerReceipt::SERVICE.writers + 1);
    let writers: Vec<_> = (0..most).map(|_| bus.publisher::<ConsumerReceipt>().unwrap()).collect();
    let error = bus.publisher::<ConsumerReceipt>().unwrap_err();
    assert_eq!(
        error,
        BusError::Full { service: "equipoise/test/receipt".to_owned(), what: "publisher", most }
    );
    let mut reported = std::collections::BTreeSet::new();
    for writer in &writers {
        writer.send(&patterned(1)).unwrap();
        reader.receive().unwrap().unwrap();
        reported.insert(reader.writer());
    }
    assert_eq!(reported.len(), most);
}
