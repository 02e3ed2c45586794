//! Recordings: bit-exact round trip, files truncated anywhere, foreign and newer files.

use std::collections::BTreeMap;
use std::io::Cursor;

use bytemuck::Zeroable;
use equipoise_adapters::recording::{
    Entry, ReadError, Recorded, Recorder, Recording, RecordingHeader, Reloaded, TimedEntry,
};
use equipoise_core::body::SEGMENTS;
use equipoise_core::cycle::Checkpoint;
use equipoise_core::message::layout::Primitive;
use equipoise_core::message::{CycleRecord, GroundSample, Message, State, SuitSample};
use proptest::prelude::*;

const NS_PER_MS: u64 = 1_000_000;

fn header() -> RecordingHeader {
    RecordingHeader {
        software_version: "0.1.0".to_owned(),
        started_unix_ns: 1_700_000_000_000_000_000,
        started_monotonic_ns: 5_000 * NS_PER_MS,
        config_toml: "station = \"station-1\"\n".to_owned(),
        subject_toml: "id = \"anon-1\"\n".to_owned(),
        similar_toml: "likeness = 0.7\n".to_owned(),
        ..RecordingHeader::default()
    }
}

/// A message of arbitrary bits, all numbers finite.
fn arbitrary<M: Message>() -> impl Strategy<Value = M> {
    proptest::collection::vec(any::<u8>(), size_of::<M>()).prop_map(|mut bytes| {
        for field in M::FIELDS.iter().filter(|field| field.primitive == Primitive::F64) {
            for number in bytes[field.offset..field.offset + 8 * field.count].chunks_exact_mut(8) {
                // An exponent of all ones would be infinite or NaN.
                number[7] &= 0b1011_1111;
            }
        }
        bytemuck::pod_read_unaligned(&bytes)
    })
}

fn read(bytes: &[u8]) -> Vec<TimedEntry> {
    let recording = Recording::from_bytes(bytes.to_vec()).unwrap();
    assert!(!recording.truncated());
    recording.entries().map(Result::unwrap).collect()
}

#[test]
fn a_recording_made_in_memory_has_the_bytes_of_one_on_disk() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.mcap");
    let mut on_disk = Recorder::create(&path, &header()).unwrap();
    let mut in_memory = Recorder::in_memory(&path, &header()).unwrap();
    for cycle in 1..=1000 {
        let record = CycleRecord { cycle, ..Zeroable::zeroed() };
        on_disk.write(cycle * 10 * NS_PER_MS, &record).unwrap();
        in_memory.write(cycle * 10 * NS_PER_MS, &record).unwrap();
    }
    on_disk.finish().unwrap();
    let bytes = in_memory.into_bytes().unwrap();
    assert!(bytes == std::fs::read(path).unwrap());
    assert_eq!(read(&bytes).len(), 1000);
}

/// A recording of `cycles` cycles, one every 250 ms, therefore four in a chunk.
fn recorded(cycles: u64) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.mcap");
    let mut recorder = Recorder::create(&path, &header()).unwrap();
    for cycle in 1..=cycles {
        let time_ns = cycle * 250 * NS_PER_MS;
        let ground = GroundSample { sequence: cycle, sample_time_ns: time_ns, ..Zeroable::zeroed() };
        recorder.write(time_ns, &ground).unwrap();
        recorder.write(time_ns, &CycleRecord { cycle, ..Zeroable::zeroed() }).unwrap();
    }
    recorder.finish().unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn a_reloaded_configuration_is_found_by_its_cycle_number() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.mcap");
    let mut recorder = Recorder::create(&path, &header()).unwrap();
    let reloaded = |number: u64| Reloaded {
        config_toml: format!("station = \"s\" # {number}\n"),
        model_toml: if number == 7 { "version = 1\n".to_owned() } else { String::new() },
        similar_toml: if number == 7 { String::new() } else { "likeness = 0.5\n".to_owned() },
    };
    for number in [7, 123_456_789_012] {
        recorder.write(number, &CycleRecord::zeroed()).unwrap();
        recorder.add_reload(number, number, &reloaded(number)).unwrap();
        recorder.add_subject(number, &format!("subject = \"of-{number}\"\n")).unwrap();
    }
    recorder.write(9, &CycleRecord::zeroed()).unwrap();
    recorder.finish().unwrap();
    let recording = Recording::open(&path).unwrap();
    let found = recording.header();
    assert_eq!(found.reloads, [7, 123_456_789_012].map(|number| (number, reloaded(number))).into());
    assert_eq!(found.later_subjects_toml, ["subject = \"of-7\"\n", "subject = \"of-123456789012\"\n"]);
    assert_eq!(found.later_subjects_ns, [7, 123_456_789_012]);
    let (first, later) = (header(), RecordingHeader { reloads: BTreeMap::new(), ..found.clone() });
    let without = RecordingHeader { later_subjects_toml: Vec::new(), later_subjects_ns: Vec::new(), ..later };
    assert_eq!(without, first);
    assert_eq!(recording.entries().filter(Result::is_ok).count(), 3);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    #[test]
    fn what_was_written_is_read_bit_for_bit(
        mut suit in arbitrary::<SuitSample>(),
        ground in arbitrary::<GroundSample>(),
        state in arbitrary::<State>(),
        cycle in arbitrary::<CycleRecord>(),
        time_ns in 0..u64::MAX / 2,
    ) {
        // Invalid rotations are not read.
        suit.orientation_wxyz = [[0.36, 0.48, -0.8, 0.0]; SEGMENTS];
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.mcap");
        let mut recorder = Recorder::create(&path, &header()).unwrap();
        recorder.write(time_ns, &suit).unwrap();
        recorder.write(time_ns + 1, &ground).unwrap();
        recorder.write(time_ns + 2_000 * NS_PER_MS, &state).unwrap();
        recorder.write(time_ns + 2, &cycle).unwrap();
        recorder.finish().unwrap();

        let recording = Recording::open(&path).unwrap();
        prop_assert_eq!(recording.header(), &header());
        let entries: Vec<_> = recording.entries().map(Result::unwrap).collect();
        let times: Vec<_> = entries.iter().map(|entry| entry.log_time_ns - time_ns).collect();
        prop_assert_eq!(times, [0, 1, 2_000 * NS_PER_MS, 2]);
        let [Entry::Suit(s), Entry::Ground(g), Entry::State(t), Entry::Cycle(c)] =
            [0, 1, 2, 3].map(|index| entries[index].entry.clone()) else { panic!("{entries:?}") };
        prop_assert_eq!(bytemuck::bytes_of(&*s), bytemuck::bytes_of(&suit));
        prop_assert_eq!(bytemuck::bytes_of(&*g), bytemuck::bytes_of(&ground));
        prop_assert_eq!(bytemuck::bytes_of(&*t), bytemuck::bytes_of(&state));
        prop_assert_eq!(bytemuck::bytes_of(&*c), bytemuck::bytes_of(&cycle));
    }
}

#[test]
fn a_flipped_byte_anywhere_neither_panics_nor_invents_messages() {
    let whole = recorded(12);
    let expected = read(&whole);
    for at in 0..whole.len() {
        for flip in [0x01, 0x80, 0xff] {
            let mut bytes = whole.clone();
            bytes[at] ^= flip;
            let Ok(recording) = Recording::from_bytes(bytes) else { continue };
            let entries: Vec<_> = recording.entries().map_while(Result::ok).collect();
            // A chunk whose opcode or frame is damaged may be skipped; all entries read were written.
            assert!(entries.iter().all(|entry| expected.contains(entry)), "byte {at} ^ {flip:#x}");
        }
    }
}

#[test]
fn a_file_cut_anywhere_gives_back_its_whole_chunks() {
    let whole = recorded(40);
    let expected = read(&whole);
    assert_eq!(expected.len(), 80);
    let mut most = 0;
    for length in (0..whole.len()).step_by(7).chain(whole.len() - 40..whole.len()) {
        let recording = match Recording::from_bytes(whole[..length].to_vec()) {
            Ok(recording) => recording,
            Err(ReadError::NotMcap { .. }) if length < 8 => continue,
            Err(error) => panic!("cut at {length}: {error}"),
        };
        let entries: Vec<_> = recording.entries().map(Result::unwrap).collect();
        assert!(expected.starts_with(&entries), "cut at {length}");
        assert!(recording.truncated() || entries.len() == expected.len());
        assert!(entries.len() >= most.min(entries.len()) && entries.len() % 2 == 0);
        most = most.max(entries.len());
    }
    assert_eq!(most, 80);
}

#[test]
fn a_crash_costs_at_most_the_last_second() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.mcap");
    let mut recorder = Recorder::create(&path, &header()).unwrap();
    for cycle in 0..=3_500 {
        recorder.write(cycle * NS_PER_MS, &CycleRecord { cycle, ..Zeroable::zeroed() }).unwrap();
    }
    // The recorder still runs, so only its own limits have closed a chunk.
    let recording = Recording::open(&path).unwrap();
    assert!(recording.truncated());
    let last = recording.entries().map(Result::unwrap).last().unwrap();
    assert!(last.log_time_ns >= 2_500 * NS_PER_MS, "{last:?}");
    assert_eq!(recording.header().config_toml, header().config_toml);
}

#[test]
fn a_recording_is_never_overwritten() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.mcap");
    Recorder::create(&path, &header()).unwrap().finish().unwrap();
    let error = Recorder::create(&path, &header()).err().unwrap().to_string();
    assert!(error.contains("a.mcap") && error.contains("choose a new name"), "{error}");
}

fn foreign(topic: &str, schema: &str, metadata: &BTreeMap<String, String>) -> Vec<u8> {
    let mut writer = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
    let schema = writer.add_schema(schema, "ros1msg", b"uint64 x\n").unwrap();
    let channel_id = writer.add_channel(schema, topic, "ros1", metadata).unwrap();
    let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: 1, publish_time: 1 };
    writer.write_to_known_channel(&header, &[0; 8]).unwrap();
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

fn refusal(bytes: &[u8]) -> String {
    Recording::from_bytes(bytes.to_vec()).unwrap_err().to_string()
}

#[test]
fn foreign_and_newer_files_are_named() {
    let none = BTreeMap::new();
    let other = refusal(&foreign("/camera/image", "sensor_msgs/Image", &none));
    assert!(other.contains("not of Equipoise") && other.contains("/camera/image"), "{other}");

    let newer = refusal(&foreign(State::TOPIC, "equipoise/State_6", &none));
    assert!(newer.contains("equipoise/State_6") && newer.contains("equipoise/State/5"), "{newer}");

    let mut metadata = BTreeMap::new();
    metadata.insert("equipoise.type_name".to_owned(), State::TYPE_NAME.to_owned());
    metadata.insert("equipoise.schema_hash".to_owned(), "00000000deadbeef".to_owned());
    let fields = refusal(&foreign(State::TOPIC, "equipoise/State_5", &metadata));
    assert!(fields.contains("deadbeef") && fields.contains("other fields"), "{fields}");

    // The previous names of the same fields.
    for (topic, type_name, hash) in [
        (State::TOPIC, State::TYPE_NAME, "e041a28860c29831"),
        (SuitSample::TOPIC, SuitSample::TYPE_NAME, "76d8648fb222b493"),
        (GroundSample::TOPIC, GroundSample::TYPE_NAME, "cbd959d3fdd1fbea"),
    ] {
        metadata.insert("equipoise.type_name".to_owned(), type_name.to_owned());
        metadata.insert("equipoise.schema_hash".to_owned(), hash.to_owned());
        let renamed = Recording::from_bytes(foreign(topic, &type_name.replacen("/5", "_5", 1), &metadata));
        assert!(
            renamed.map_or_else(|error| !error.to_string().contains("other fields"), |_| true),
            "{type_name}"
        );
    }

    let pcap = refusal(&[0xd4, 0xc3, 0xb2, 0xa1, 2, 0, 4, 0]);
    assert!(pcap.contains(".pcap"), "{pcap}");
    assert!(refusal(b"").contains("empty"));
}

#[test]
fn messages_with_impossible_numbers_are_left_out_and_counted_at_the_end() {
    let mut recorder = Recorder::in_memory("a.mcap", &header()).unwrap();
    let mut state = State::zeroed();
    recorder.write(1, &state).unwrap();
    state.torque_nm[3][1] = f64::NAN;
    recorder.write(2, &state).unwrap();
    let mut ground = GroundSample::zeroed();
    recorder.write(3, &ground).unwrap();
    ground.force_n[2] = 1e9;
    recorder.write(4, &ground).unwrap();
    // Not a body: its rotations are invalid.
    recorder.write(5, &SuitSample::zeroed()).unwrap();
    let recording = Recording::from_bytes(recorder.into_bytes().unwrap()).unwrap();
    let mut entries = recording.entries();
    let times = entries.by_ref().take(2).map(|entry| entry.unwrap().log_time_ns);
    assert_eq!(times.collect::<Vec<_>>(), [1, 3]);
    let reported = entries.next().unwrap().unwrap_err();
    assert!(matches!(reported, ReadError::Impossible { count: 3, .. }), "{reported}");
    assert!(entries.next().is_none());
}

#[test]
fn unknown_topics_come_through_as_they_are() {
    let mut writer = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
    for topic in ["/equipoise/novelty", Checkpoint::TOPIC, GroundSample::TOPIC] {
        let (name, text) = match topic {
            // The checkpoint of another release.
            Checkpoint::TOPIC => ("equipoise/Checkpoint_1", "uint8[192] memory\n".to_owned()),
            GroundSample::TOPIC => {
                ("equipoise/Ground_3", equipoise_adapters::recording::topic::schema_text::<GroundSample>())
            }
            _ => ("equipoise/Novelty_1", "uint8[192] x\n".to_owned()),
        };
        let schema = writer.add_schema(name, "ros1msg", text.as_bytes()).unwrap();
        // Without Equipoise's metadata, as after processing by another tool.
        let channel_id = writer.add_channel(schema, topic, "ros1", &BTreeMap::new()).unwrap();
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: 1, publish_time: 1 };
        writer.write_to_known_channel(&header, &[0; size_of::<GroundSample>()]).unwrap();
    }
    writer.finish().unwrap();
    let entries = read(&writer.into_inner().into_inner());
    assert!(matches!(&entries[0].entry, Entry::Other { topic, .. } if **topic == *"/equipoise/novelty"));
    assert!(matches!(&entries[1].entry, Entry::Other { topic, .. } if **topic == *Checkpoint::TOPIC));
    assert!(matches!(&entries[2].entry, Entry::Ground(_)));
}

#[test]
fn a_record_that_claims_gigabytes_costs_no_memory() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("vast.mcap");
    let claimed = 3_u64 << 30;
    // Magic, then the frame of a metadata record; the rest of the file is sparse.
    let head = [b"\x89MCAP0\r\n".as_slice(), &[0x0c], &claimed.to_le_bytes()].concat();
    std::fs::write(&path, head).unwrap();
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(claimed + 100).unwrap();
    let said = Recording::open(&path).unwrap_err().to_string();
    assert!(said.contains("vast.mcap") && said.contains("a record of 3221225472 bytes"), "{said}");
}
