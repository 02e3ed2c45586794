use super::*;
use proptest::prelude::*;

/// Plates by number, each with the number of its first force and its forces.
type Plates = Vec<(u32, u32, Vec<[f32; NUMBERS]>)>;

fn component(kind: u32, content: &[u8]) -> Vec<u8> {
    packet_like(kind, content)
}

/// Components and packets have the same head.
fn packet_like(kind: u32, content: &[u8]) -> Vec<u8> {
    let size = (content.len() + 8) as u32;
    [&size.to_le_bytes()[..], &kind.to_le_bytes(), content].concat()
}

fn numbers(force: &[f32; NUMBERS]) -> Vec<u8> {
    force.iter().flat_map(|number| number.to_le_bytes()).collect()
}

fn frame(timestamp_us: i64, number: u32, components: &[Vec<u8>]) -> Vec<u8> {
    let mut content = timestamp_us.to_le_bytes().to_vec();
    content.extend(number.to_le_bytes());
    content.extend((components.len() as u32).to_le_bytes());
    content.extend(components.concat());
    packet_like(3, &content)
}

fn forces(plates: &Plates) -> Vec<u8> {
    let mut content = (plates.len() as u32).to_le_bytes().to_vec();
    for (plate, first, forces) in plates {
        for word in [*plate, forces.len() as u32, *first] {
            content.extend(word.to_le_bytes());
        }
        content.extend(forces.iter().flat_map(numbers));
    }
    component(4, &content)
}

/// The elements that a deframer returns for pieces of a stream, as text.
fn found(pieces: &[&[u8]]) -> Vec<String> {
    let mut deframer = Deframer::default();
    let mut found = Vec::new();
    for piece in pieces {
        deframer.push(piece);
        while let Some(packet) = deframer.next_packet() {
            found.push(format!("{packet:?}"));
        }
    }
    found
}

#[test]
fn a_frame_written_by_hand_is_read() {
    #[rustfmt::skip]
    let bytes = [
        88, 0, 0, 0, 3, 0, 0, 0,
        0x40, 0x42, 0x0f, 0, 0, 0, 0, 0, 7, 0, 0, 0, 1, 0, 0, 0,
        64, 0, 0, 0, 4, 0, 0, 0, 1, 0, 0, 0,
        2, 0, 0, 0, 1, 0, 0, 0, 70, 0, 0, 0,
        0, 0, 0x80, 0x3f, 0, 0, 0, 0xc0, 0, 0, 0x2f, 0x44, // 1, -2, 700 N
        0, 0, 0, 0, 0, 0, 0x80, 0xbf, 0, 0, 0, 0, // 0, -1, 0 N m
        0, 0, 0x20, 0x41, 0, 0, 0, 0, 0, 0, 0, 0, // 10, 0, 0 mm
        0, 0, 0, 0,
    ];
    let mut deframer = Deframer::default();
    deframer.push(&bytes);
    // Four excess bytes in the frame: its lengths are checked to the last byte.
    let Some(Ok(Packet::Frame(frame))) = deframer.next_packet() else { panic!() };
    assert_eq!(frame.plate(2), Err(Malformed::Frame { number: 7 }));

    let mut bytes = bytes[..84].to_vec();
    bytes[0] = 84;
    bytes[24] = 60;
    deframer.push(&bytes);
    let Some(Ok(Packet::Frame(frame))) = deframer.next_packet() else { panic!() };
    assert_eq!((frame.timestamp_us, frame.number, frame.plates()), (1_000_000, 7, vec![2]));
    assert_eq!(frame.plate(1), Ok(None));
    let forces = frame.plate(2).unwrap().unwrap();
    assert_eq!((forces.first, forces.count()), (Some(70), 1));
    let force =
        PlateForce { force_n: [1.0, -2.0, 700.0], moment_nm: [0.0, -1.0, 0.0], point_mm: [10.0, 0.0, 0.0] };
    assert_eq!(forces.forces().collect::<Vec<_>>(), [force]);
    assert!(deframer.next_packet().is_none());
}

#[test]
fn words_are_written_as_qtm_reads_them_and_read_as_it_writes_them() {
    let bytes = command("Version 1.25");
    assert_eq!(&bytes[..8], [21, 0, 0, 0, 1, 0, 0, 0]);
    assert_eq!(&bytes[8..], b"Version 1.25\0");
    assert_eq!(found(&[&bytes]), [r#"Ok(Text("Version 1.25"))"#]);
    let said = [
        packet_like(0, b"Parse error\0"),
        packet_like(4, b""),
        packet_like(6, &[3]),
        packet_like(5, &[9; 40]),
    ];
    assert_eq!(
        found(&[&said.concat()]),
        [r#"Ok(Error("Parse error"))"#, "Ok(NoMoreData)", "Ok(Event(Started))", "Ok(Other(5))"]
    );
    assert_eq!(found(&[&packet_like(6, b"")]), ["Err(EmptyEvent)"]);
    assert_eq!(found(&[&packet_like(1, &[0xff, 0])]), ["Err(NotText)"]);
}

#[test]
fn the_other_byte_order_is_named() {
    let mut deframer = Deframer::default();
    deframer.push(&[0, 0, 0, 21, 0, 0, 0, 1, b'V']);
    let error = deframer.next_packet().unwrap().unwrap_err();
    assert!(error.to_string().contains("22223"), "{error}");
    // Such a stream cannot be resynchronised, and its data are not buffered.
    deframer.push(&command("Version 1.25"));
    assert!(deframer.next_packet().is_none() && deframer.0.held() == 0);
    deframer.clear();
    deframer.push(&command("Version 1.25"));
    assert!(deframer.next_packet().unwrap().is_ok());
}

#[test]
fn a_packet_too_large_to_keep_is_passed_over() {
    let large = packet_like(8, &vec![1; KEPT_MAX + 5]);
    let bytes = [large, command("yes")].concat();
    let pieces: Vec<&[u8]> = bytes.chunks(50_000).collect();
    assert_eq!(found(&pieces), ["Ok(Other(8))", r#"Ok(Text("yes"))"#]);
}

proptest! {
    #[test]
    fn what_is_sent_is_found_however_it_is_divided(
        plates in proptest::collection::vec(
            (1_u32..4, any::<u32>(), proptest::collection::vec(proptest::array::uniform9(-1e4_f32..1e4), 0..5)), 0..4),
        timestamp_us in 0_i64..i64::MAX, number: u32, cuts in proptest::collection::vec(1_usize..40, 1..60),
    ) {
        let other = component(1, &[7; 12]);
        let bytes = [command("hello"), frame(timestamp_us, number, &[other, forces(&plates)]), command("bye")].concat();
        let mut deframer = Deframer::default();
        let (mut rest, mut frames, mut words) = (&bytes[..], 0, 0);
        for cut in cuts.iter().cycle() {
            let (piece, after) = rest.split_at((*cut).min(rest.len()));
            deframer.push(piece);
            rest = after;
            while let Some(packet) = deframer.next_packet() {
                match packet.unwrap() {
                    Packet::Text(_) => words += 1,
                    Packet::Frame(frame) => {
                        frames += 1;
                        prop_assert_eq!((frame.timestamp_us, frame.number), (timestamp_us as u64, number));
                        prop_assert_eq!(frame.plates(), plates.iter().map(|plate| plate.0).collect::<Vec<_>>());
                        for (plate, first, forces) in plates.iter().take(1) {
                            let got = frame.plate(*plate).unwrap().unwrap();
                            prop_assert_eq!((got.first, got.count()), (Some(*first), forces.len()));
                            for (got, want) in got.forces().zip(forces) {
                                prop_assert_eq!([got.force_n, got.moment_nm, got.point_mm].concat(), want.to_vec());
                            }
                        }
                    }
                    packet => prop_assert!(false, "{packet:?}"),
                }
            }
            if rest.is_empty() { break; }
        }
        prop_assert_eq!((frames, words), (1, 2));
    }

    #[test]
    fn anything_may_come(pieces in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..200), 0..20)) {
        let mut deframer = Deframer::default();
        for piece in &pieces {
            deframer.push(piece);
            while let Some(packet) = deframer.next_packet() {
                if let Ok(Packet::Frame(frame)) = packet {
                    let _ = (frame.plates(), frame.plate(1).map(|plate| plate.map(|plate| plate.forces().count())));
                }
            }
        }
    }

    #[test]
    fn a_damaged_frame_does_not_affect_the_next(at in 0_usize..120, value: u8) {
        let plates = vec![(1, 3, vec![[1.0; NUMBERS]; 2])];
        let mut bytes = frame(5, 6, &[forces(&plates)]);
        let length = bytes.len();
        bytes[at % length] = value;
        let _ = found(&[&bytes]);
        let mut deframer = Deframer::default();
        deframer.push(&bytes);
        if let Some(Ok(Packet::Frame(frame))) = deframer.next_packet() {
            let _ = (frame.plate(1), frame.plates());
        }
    }
}
