use super::*;
use crate::ground::channels::{Direct, ForceUnit, MomentUnit};
use crate::ground::protocol::GroundProtocol;
use crate::ground::receiver::GroundSettings;
use crate::wire::checksum::Checksum;
use crate::wire::frame::{ChecksumField, Endian};
use equipoise_core::message::GroundSample;
use proptest::prelude::*;

const NS_PER_MS: u64 = 1_000_000;

/// `5A count:u8 time:u16 ms fz:i24 sum`, big-endian, force in tenths of a newton.
fn settings() -> BinarySettings {
    let place = |at, number| NumberPosition::new(at, number, Endian::Big);
    let direct = Direct { force: [None, None, Some(0)], ..Direct::default() };
    BinarySettings {
        form: FrameForm {
            sync: vec![0x5a],
            length: Length::Fixed(8),
            tags: vec![],
            kind: None,
            checksum: Some(ChecksumField {
                checksum: Checksum::named("SUM-8").unwrap(),
                from: 0,
                to: 7,
                at: 7,
                endian: Endian::Big,
            }),
        },
        datagrams: false,
        fields: vec![Field { place: place(4, Number::I24), scale: 1.0, per: 10.0, offset: 0.0 }],
        channels: Channels::direct(1, direct, ForceUnit::Newton, MomentUnit::NewtonMetre).unwrap(),
        scans: Scans { count: 1, bytes: 0 },
        sequence: Some(Count { place: place(1, Number::U8), modulus: 256 }),
        counter: None,
        time: None,
        rate_hz: None,
        status: None,
        trigger: None,
        request: None,
        close_command: None,
    }
}

fn frame(index: u32) -> Vec<u8> {
    let mut bytes = vec![0x5a, index as u8];
    bytes.extend_from_slice(&((10 * index) as u16).to_be_bytes());
    bytes.extend_from_slice(&(-7005i32).to_be_bytes()[1..]);
    bytes.push(bytes.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte)));
    bytes
}

fn run(settings: BinarySettings, pieces: &[&[u8]]) -> (Vec<GroundSample>, GroundProtocol) {
    let mut protocol = GroundProtocol::new(Box::new(Binary::new(settings)), GroundSettings::default());
    protocol.opened(0);
    let mut samples = Vec::new();
    for (index, piece) in pieces.iter().enumerate() {
        protocol.receive(piece, 1000 * NS_PER_MS + index as u64 * 10 * NS_PER_MS, &mut samples);
    }
    (samples, protocol)
}

fn refused(protocol: &GroundProtocol, refusal: GroundRefusal) -> u64 {
    protocol.counts().refused[refusal.index()]
}

fn with_time(settings: BinarySettings) -> BinarySettings {
    let time = Time { place: NumberPosition::new(2, Number::U16, Endian::Big), unit_ns: NS_PER_MS };
    BinarySettings { sequence: None, time: Some(time), ..settings }
}

#[test]
fn a_damaged_datagram_is_lost_and_takes_its_time_where_nothing_counts() {
    let settings = BinarySettings { sequence: None, datagrams: true, ..settings() };
    let mut sent: Vec<Vec<u8>> = (0..60).map(frame).collect();
    for index in [40, 41, 45] {
        sent[index][4] ^= 0x10;
    }
    let pieces: Vec<&[u8]> = sent.iter().map(Vec::as_slice).collect();
    let (samples, protocol) = run(settings, &pieces);
    assert_eq!(
        (samples.len(), protocol.counts().lost, refused(&protocol, GroundRefusal::Checksum)),
        (57, 3, 3)
    );
    assert!(samples.iter().all(|sample| sample.sample_time_ns.abs_diff(sample.arrival_ns) < NS_PER_MS));
}

#[test]
fn a_coarse_clock_stands_still_between_counted_frames() {
    // `5A count:u8 time:u32 ms fz:i24 sum` at 2 kHz: every second frame has the time of the one before.
    let mut settings = settings();
    settings.form.length = Length::Fixed(10);
    settings.form.checksum = settings.form.checksum.map(|summed| ChecksumField { to: 9, at: 9, ..summed });
    settings.fields[0].place = NumberPosition::new(6, Number::I24, Endian::Big);
    settings.time =
        Some(Time { place: NumberPosition::new(2, Number::U32, Endian::Big), unit_ns: NS_PER_MS });
    let mut protocol = GroundProtocol::new(Box::new(Binary::new(settings)), GroundSettings::default());
    protocol.opened(0);
    let mut samples = Vec::new();
    for index in 0..2000_u32 {
        let mut bytes = vec![0x5a, index as u8];
        bytes.extend_from_slice(&(index / 2).wrapping_sub(500).to_be_bytes());
        bytes.extend_from_slice(&(-7005i32).to_be_bytes()[1..]);
        bytes.push(bytes.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte)));
        protocol.receive(&bytes, 1000 * NS_PER_MS + u64::from(index) * NS_PER_MS / 2, &mut samples);
    }
    assert_eq!((samples.len(), protocol.counts().lost), (2000, 0));
    assert!(samples.iter().all(|sample| sample.session == samples[0].session));
    let last = samples[1999];
    assert!(
        last.sample_time_ns.abs_diff(last.arrival_ns) < NS_PER_MS && last.sample_time_sigma_ns < NS_PER_MS,
        "{last:?}"
    );
}

#[test]
fn a_short_counter_gives_losses_across_its_wrap() {
    let sent: Vec<Vec<u8>> = [250, 251, 255, 257, 257, 256, 300].into_iter().map(frame).collect();
    let pieces: Vec<&[u8]> = sent.iter().map(Vec::as_slice).collect();
    let (samples, protocol) = run(settings(), &pieces);
    assert_eq!((samples.len(), protocol.counts().lost), (5, 3 + 1 + 42));
    assert_eq!(
        (refused(&protocol, GroundRefusal::Duplicate), refused(&protocol, GroundRefusal::OutOfOrder)),
        (1, 1)
    );
    assert_eq!(samples[0].force_n, [0.0, 0.0, 700.5]);
    assert_eq!(samples[4].device_counter, 300);
}

#[test]
fn a_short_time_gives_losses_too_and_a_step_back_is_a_restart() {
    let sent: Vec<Vec<u8>> =
        [6550, 6551, 6552, 6553, 6554, 6557, 6557, 6558].into_iter().map(frame).collect();
    let pieces: Vec<&[u8]> = sent.iter().map(Vec::as_slice).collect();
    let (mut samples, mut protocol) = run(with_time(settings()), &pieces);
    assert_eq!(
        (samples.len(), protocol.counts().lost, refused(&protocol, GroundRefusal::Duplicate)),
        (7, 2, 1)
    );
    assert!(samples.iter().all(|sample| sample.session == 0), "65 536 ms are a wrap and no restart");
    protocol.receive(&frame(6000), 2000 * NS_PER_MS, &mut samples);
    assert_eq!(samples.last().map(|sample| sample.session), Some(1));
}

#[test]
fn losses_without_a_counter_are_found_from_the_gap_in_time() {
    let silent = BinarySettings { sequence: None, ..settings() };
    let mut stream: Vec<u8> = (0..5).flat_map(frame).collect();
    stream[8..24].fill(0);
    let (samples, protocol) = run(silent.clone(), &[&stream]);
    assert_eq!(
        (samples.len(), protocol.counts().lost, refused(&protocol, GroundRefusal::Garbage)),
        (3, 2, 1)
    );
    // After a silence the loss cannot be counted.
    let mut protocol = GroundProtocol::new(Box::new(Binary::new(silent)), GroundSettings::default());
    let mut samples = Vec::new();
    protocol.receive(&frame(0), 1000 * NS_PER_MS, &mut samples);
    protocol.receive(&frame(1), 2000 * NS_PER_MS, &mut samples);
    assert_eq!(samples.iter().map(|sample| sample.session).collect::<Vec<_>>(), [0, 1]);
}

#[test]
fn a_datagram_is_whole_frames_or_nothing() {
    let datagrams = BinarySettings { datagrams: true, ..settings() };
    let two: Vec<u8> = [frame(1), frame(2)].concat();
    let mut damaged = [frame(3), frame(4)].concat();
    damaged[6] ^= 1;
    let mut foreign = frame(5);
    foreign[0] = 0;
    let (samples, protocol) = run(datagrams, &[&two, &damaged, &two[..12], &[], &foreign]);
    assert_eq!(samples.iter().map(|sample| sample.device_counter).collect::<Vec<_>>(), [1, 2, 4]);
    use GroundRefusal::{Checksum, Garbage, Length};
    assert_eq!([Checksum, Length, Garbage].map(|refusal| refused(&protocol, refusal)), [1, 2, 1]);
}

#[test]
fn scans_of_a_frame_are_readings_of_their_own() {
    let place = |at, number| NumberPosition::new(at, number, Endian::Big);
    let scans = BinarySettings {
        form: FrameForm { checksum: None, length: Length::Fixed(8), ..settings().form },
        fields: vec![Field { place: place(2, Number::U16), scale: 2.0, per: 1.0, offset: 1.0 }],
        scans: Scans { count: 3, bytes: 2 },
        datagrams: true,
        ..settings()
    };
    let (samples, protocol) = run(
        scans,
        &[&[0x5a, 255, 0, 1, 0, 2, 0, 3], &[0x5a, 0, 0, 4, 0, 5, 0, 6], &[0x5a, 2, 0, 7, 0, 8, 0, 9]],
    );
    let forces: Vec<f64> = samples.iter().map(|sample| -sample.force_n[2]).collect();
    assert_eq!(forces, [3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0, 17.0, 19.0]);
    assert_eq!(protocol.counts().lost, 3, "a frame is three readings");
}

#[test]
fn a_device_that_is_asked_is_asked_again_when_it_falls_silent() {
    let asked =
        BinarySettings { request: Some(b"go".to_vec()), close_command: Some(b"halt".to_vec()), ..settings() };
    let mut protocol = GroundProtocol::new(Box::new(Binary::new(asked)), GroundSettings::default());
    let go = Action::Send(b"go".to_vec());
    protocol.opened(0);
    assert_eq!(
        (
            protocol.next_action(0),
            protocol.next_action(50 * NS_PER_MS),
            protocol.next_action(100 * NS_PER_MS)
        ),
        (go.clone(), Action::Nothing, go.clone())
    );
    protocol.receive(&frame(200), 110 * NS_PER_MS, &mut Vec::new());
    assert_eq!(
        (protocol.next_action(600 * NS_PER_MS), protocol.next_action(611 * NS_PER_MS)),
        (Action::Nothing, go)
    );
    // The sequence restarts from zero; this is not a loss.
    protocol.receive(&frame(0), 700 * NS_PER_MS, &mut Vec::new());
    assert_eq!((protocol.counts().lost, protocol.counts().published), (0, 2));
    assert_eq!(protocol.close_command(), Some(b"halt".to_vec()));
}

#[test]
fn bytes_without_any_frame_are_reported_in_words() {
    let (_, mut protocol) = run(settings(), &[&[7; 600]]);
    assert!(protocol.diagnostic().is_some_and(|said| said.contains("none of the last 593 make a frame")));
    protocol.receive(&frame(1), 5000 * NS_PER_MS, &mut Vec::new());
    assert_eq!(protocol.diagnostic(), None);
}

#[test]
fn status_and_trigger_are_bits_where_they_stand() {
    let place = NumberPosition { mask: 0xf000, ..NumberPosition::new(2, Number::U16, Endian::Big) };
    let bits = BinarySettings {
        status: Some(NumberPosition { mask: 0x0006, ..place }),
        trigger: Some(Tag { place, values: vec![0xf000] }),
        form: FrameForm { checksum: None, ..settings().form },
        ..settings()
    };
    let (samples, _) = run(bits, &[&[0x5a, 1, 0xf0, 0x03, 0, 0, 0, 0], &[0x5a, 2, 0x10, 0x01, 0, 0, 0, 0]]);
    assert_eq!(samples.iter().map(|sample| sample.device_status).collect::<Vec<_>>(), [2, 0]);
    assert_eq!(samples.iter().map(|sample| sample.device_counter).collect::<Vec<_>>(), [TRIGGER | 1, 2]);
}

proptest! {
    #[test]
    fn any_pieces_make_the_same_readings_and_garbage_never_panics(
        parts in proptest::collection::vec((1u32..4, 0u8..8, proptest::collection::vec(any::<u8>(), 0..20)), 1..40),
        cuts in proptest::collection::vec(any::<u16>(), 0..12), timed: bool,
    ) {
        let mut stream = Vec::new();
        let mut index = 0;
        for (step, fault, bytes) in parts {
            index += step;
            let mut frame = frame(index);
            match fault {
                0 => frame[5] ^= 0x10,
                1 => stream.extend_from_slice(&bytes),
                2 => frame.truncate(5),
                _ => {}
            }
            stream.extend(frame);
        }
        let settings = if timed { with_time(settings()) } else { settings() };
        let read = |pieces: &[&[u8]]| {
            let mut device = Binary::new(settings.clone());
            let mut decoded = Decoded::default();
            for piece in pieces {
                device.take(piece, 0, &mut decoded);
            }
            decoded
        };
        let mut cuts: Vec<usize> = cuts.into_iter().map(|cut| usize::from(cut) % (stream.len() + 1)).chain([0, stream.len()]).collect();
        cuts.sort_unstable();
        let pieces: Vec<&[u8]> = cuts.windows(2).map(|pair| &stream[pair[0]..pair[1]]).collect();
        prop_assert_eq!(read(&pieces), read(&[&stream]));
        let mut datagrams = Binary::new(BinarySettings { datagrams: true, ..settings.clone() });
        for piece in pieces {
            datagrams.take(piece, 0, &mut Decoded::default());
        }
    }
}
