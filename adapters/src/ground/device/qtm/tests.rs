use super::*;
use crate::ground::{GroundProtocol, GroundSettings};

const NS_PER_MS: u64 = 1_000_000;

fn said(kind: u32, content: &[u8]) -> Vec<u8> {
    let size = (content.len() + 8) as u32;
    [&size.to_le_bytes()[..], &kind.to_le_bytes(), content].concat()
}

/// A frame with `count` forces on plate 2: 1, 2, … N upwards at (100, 0) mm.
fn frame(timestamp_us: u64, number: u32, first: u32, count: u32) -> Vec<u8> {
    let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<_>>();
    let mut content = words(&[1, 2, count, first]);
    for index in 0..count {
        let fz = (first + index) as f32;
        let force = [0.0, 0.0, fz, 0.0, -0.1 * fz, 0.0, 100.0, 0.0, 0.0];
        content.extend(force.iter().flat_map(|number| number.to_le_bytes()));
    }
    let frame = [timestamp_us.to_le_bytes().to_vec(), words(&[number, 1]), said(4, &content)].concat();
    said(3, &frame)
}

fn plate(divisor: u32) -> Qtm {
    Qtm::new(QtmSettings { plate: 2, divisor })
}

/// Times and counters of the decoded readings.
fn times(decoded: &Decoded) -> Vec<(Tick, u32)> {
    decoded.readings().map(|reading| (reading.tick, reading.device_counter)).collect()
}

fn sent(action: Action) -> String {
    match action {
        Action::Send(bytes) => String::from_utf8(bytes[8..bytes.len() - 1].to_vec()).unwrap(),
        other => format!("{other:?}"),
    }
}

#[test]
fn the_dialogue_waits_for_its_answers() {
    let mut qtm = plate(1);
    let mut decoded = Decoded::default();
    qtm.opened(0);
    assert_eq!(sent(qtm.next_action(0)), "Version 1.25");
    qtm.take(&said(1, b"QTM RT Interface connected\0"), NS_PER_MS, &mut decoded);
    assert_eq!(qtm.next_action(2 * NS_PER_MS), Action::Nothing);
    qtm.take(&said(1, b"Version set to 1.25\0"), 3 * NS_PER_MS, &mut decoded);
    assert_eq!(sent(qtm.next_action(3 * NS_PER_MS)), "StreamFrames AllFrames Force");
    assert_eq!(qtm.next_action(4 * NS_PER_MS), Action::Nothing);
    assert_eq!(qtm.diagnostic(), None);
    // No measurement runs; when one starts, frames are requested at once.
    qtm.take(&said(4, b""), 5 * NS_PER_MS, &mut decoded);
    assert!(qtm.diagnostic().unwrap().contains("measures nothing"));
    assert_eq!(qtm.next_action(6 * NS_PER_MS), Action::Nothing);
    qtm.take(&said(6, &[3]), 7 * NS_PER_MS, &mut decoded);
    assert_eq!(sent(qtm.next_action(8 * NS_PER_MS)), "StreamFrames AllFrames Force");
    qtm.take(&frame(10, 1, 1, 1), 9 * NS_PER_MS, &mut decoded);
    assert_eq!((qtm.diagnostic(), decoded.readings().count()), (None, 1));
    // Frames are requested again after a silence.
    assert_eq!(sent(qtm.next_action(3000 * NS_PER_MS)), "StreamFrames AllFrames Force");
    assert!(qtm.diagnostic().unwrap().contains("measures nothing"));
    assert_eq!(sent(Action::Send(qtm.close_command().unwrap())), "StreamFrames Stop");
    // Every n-th frame: one force for each.
    let mut slow = plate(4);
    slow.next_action(0);
    slow.take(&said(1, b"Version set to 1.25\0"), 3 * NS_PER_MS, &mut decoded);
    assert_eq!(sent(slow.next_action(4 * NS_PER_MS)), "StreamFrames FrequencyDivisor:4 ForceSingle");
}

#[test]
fn a_refused_or_unanswered_version_is_reported_and_tried_again() {
    let mut qtm = plate(1);
    qtm.next_action(0);
    qtm.take(&said(0, b"Version NOT supported\0"), NS_PER_MS, &mut Decoded::default());
    assert!(qtm.diagnostic().unwrap().contains("Version NOT supported"));
    let Action::Reopen(why) = qtm.next_action(4000 * NS_PER_MS) else { panic!() };
    assert!(why.contains("Version NOT supported") && why.contains("ground.address"), "{why}");
    qtm.opened(5000 * NS_PER_MS);
    assert_eq!(sent(qtm.next_action(5000 * NS_PER_MS)), "Version 1.25");
    let Action::Reopen(why) = qtm.next_action(9000 * NS_PER_MS) else { panic!() };
    assert!(why.contains("does not answer"), "{why}");
}

#[test]
fn forces_of_a_frame_are_spread_over_its_time() {
    let mut qtm = plate(1);
    let mut decoded = Decoded::default();
    qtm.take(&frame(10_000, 1, 100, 4), NS_PER_MS, &mut decoded);
    assert_eq!(times(&decoded), [], "how long a frame lasts is not known yet");
    qtm.take(&frame(20_000, 2, 104, 4), 2 * NS_PER_MS, &mut decoded);
    let want: Vec<_> = (0..8)
        .map(|index| (Tick::Time(10 * NS_PER_MS + index * 5 * NS_PER_MS / 2), 100 + index as u32))
        .collect();
    assert_eq!(times(&decoded), want);
    assert_eq!(decoded.block_latency_ns, Some(10 * NS_PER_MS));
    let Load::Wrench(wrench) = decoded.readings().next().unwrap().load else { panic!() };
    assert_eq!((wrench.force_n, wrench.moment_nm[1] as f32), ([0.0, 0.0, 100.0], -10.0));
}

#[test]
fn missing_frames_are_lost_forces_and_a_frame_twice_is_one() {
    let mut protocol = GroundProtocol::new(Box::new(plate(1)), GroundSettings::default());
    let mut samples = Vec::new();
    for (timestamp_us, number) in [(10_000, 1), (20_000, 2), (50_000, 5), (50_000, 5), (60_000, 6)] {
        protocol.receive(&frame(timestamp_us, number, number * 2, 2), timestamp_us * 1000, &mut samples);
    }
    assert_eq!((samples.len(), protocol.counts().lost), (8, 4));
    assert_eq!(protocol.counts().refused[GroundRefusal::Duplicate.index()], 1);
    assert!(samples.iter().all(|sample| sample.session == 0));
    // Another measurement: its time restarts.
    protocol.receive(&frame(10_000, 1, 2, 2), 70 * NS_PER_MS, &mut samples);
    protocol.receive(&frame(20_000, 2, 4, 2), 80 * NS_PER_MS, &mut samples);
    assert_eq!((samples.len(), protocol.counts().lost, samples.last().unwrap().session), (12, 4, 1));
}

#[test]
fn a_long_pause_dates_nothing_into_the_future() {
    let mut qtm = plate(1);
    let mut decoded = Decoded::default();
    // 100 frames a second, 4 forces each; then QTM pauses for 200 s, and for 300 s before the interval is available.
    for (timestamp_us, number) in [(10_000, 1), (20_000, 2), (200_020_000, 20_002), (200_030_000, 20_003)] {
        qtm.take(&frame(timestamp_us, number, number * 4, 4), NS_PER_MS, &mut decoded);
    }
    let want = |stamp_ms: u64, number: u32| {
        (0..4).map(move |index| {
            (Tick::Time(stamp_ms * NS_PER_MS + u64::from(index) * 5 * NS_PER_MS / 2), number * 4 + index)
        })
    };
    let all: Vec<_> =
        want(10, 1).chain(want(20, 2)).chain(want(200_020, 20_002)).chain(want(200_030, 20_003)).collect();
    assert_eq!(times(&decoded), all);
    let mut protocol = GroundProtocol::new(Box::new(plate(1)), GroundSettings::default());
    let mut samples = Vec::new();
    for (timestamp_us, number) in [(10_000, 1), (300_010_000, 30_001), (300_020_000, 30_002)] {
        protocol.receive(&frame(timestamp_us, number, number % 100 * 4, 4), NS_PER_MS, &mut samples);
    }
    assert_eq!((samples.len(), protocol.counts().lost), (8, 4), "the first frame's length was never known");
}

#[test]
fn a_preview_that_does_not_count_its_frames_is_timed_all_the_same() {
    let mut qtm = plate(1);
    let mut decoded = Decoded::default();
    for timestamp_us in [10_000, 20_000, 30_000, 60_000, 70_000] {
        qtm.take(&frame(timestamp_us, 1, 1, 1), NS_PER_MS, &mut decoded);
    }
    let want: Vec<_> = [10, 20, 30, 60, 70].map(|ms| (Tick::Time(ms * NS_PER_MS), 1)).into();
    assert_eq!(times(&decoded), want);
    let mut protocol = GroundProtocol::new(Box::new(plate(4)), GroundSettings::default());
    for (timestamp_us, number) in [(40_000, 4), (80_000, 8), (160_000, 16)] {
        protocol.receive(&frame(timestamp_us, number, 1, 1), NS_PER_MS, &mut Vec::new());
    }
    assert_eq!(protocol.counts().lost, 1, "of every fourth frame");
}

#[test]
fn a_plate_that_is_not_there_and_forces_without_a_number_are_reasons() {
    let mut qtm = Qtm::new(QtmSettings { plate: 1, divisor: 1 });
    let mut decoded = Decoded::default();
    qtm.take(&frame(10, 1, 1, 1), NS_PER_MS, &mut decoded);
    assert_eq!(decoded.refusals().collect::<Vec<_>>(), [GroundRefusal::UnknownKind]);
    assert!(qtm.diagnostic().unwrap().contains("no force plate 1 but 2: set ground.qtm.plate"));

    let mut protocol = GroundProtocol::new(Box::new(plate(1)), GroundSettings::default());
    let mut bytes = frame(10, 1, 1, 1);
    let fz = bytes.len() - 36 + 8;
    bytes[fz..fz + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let mut samples = Vec::new();
    protocol.receive(&bytes, NS_PER_MS, &mut samples);
    assert_eq!((samples.len(), protocol.counts().refused[GroundRefusal::NotFinite.index()]), (0, 1));
}

#[test]
fn moment_and_point_that_contradict_each_other_are_said() {
    let mut qtm = plate(1);
    for number in 200..400 {
        qtm.take(&frame(u64::from(number) * 1000, number, number, 1), NS_PER_MS, &mut Decoded::default());
    }
    assert_eq!(qtm.diagnostic(), None);
    for number in 400..600 {
        let mut bytes = frame(u64::from(number) * 1000, number, number, 1);
        let my = bytes.len() - 36 + 16;
        bytes[my..my + 4].copy_from_slice(&3.0_f32.to_le_bytes());
        qtm.take(&bytes, NS_PER_MS, &mut Decoded::default());
    }
    assert!(qtm.diagnostic().unwrap().contains("different origins"));
}

#[test]
fn a_stream_of_the_wrong_byte_order_ends_the_connection_with_a_hint() {
    let mut qtm = plate(1);
    let mut decoded = Decoded::default();
    qtm.take(&[0, 0, 0, 35, 0, 0, 0, 1, b'Q'], NS_PER_MS, &mut decoded);
    assert_eq!(decoded.refusals().collect::<Vec<_>>(), [GroundRefusal::Garbage]);
    let Action::Reopen(why) = qtm.next_action(NS_PER_MS) else { panic!() };
    assert!(why.contains("22223"), "{why}");
}
