use super::*;
use crate::wire::bota::Frame as BotaFrame;
use proptest::prelude::*;

/// The frame of the can-can-group's plate (`common_frame.h`), as its radio forwards it.
fn declared() -> FrameForm {
    let place = |at, number| NumberPosition::new(at, number, Endian::Little);
    FrameForm {
        sync: vec![0x6b, 0xb6],
        length: Length::InHead { place: place(4, Number::U16), plus: 6, most: 200 },
        tags: vec![],
        kind: Some(Tag { place: place(8, Number::U8), values: vec![7] }),
        checksum: Some(ChecksumField {
            checksum: Checksum::named("CRC-16/CCITT-FALSE").unwrap(),
            from: 6,
            to: -2,
            at: -2,
            endian: Endian::Little,
        }),
    }
}

fn frame(kind: u8, body: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0x6b, 0xb6, 1, 0];
    bytes.extend_from_slice(&(body.len() as u16 + 5).to_le_bytes());
    bytes.extend_from_slice(&[0xa5, 0x5a, kind]);
    bytes.extend_from_slice(body);
    let sum = Checksum::named("CRC-16/CCITT-FALSE").unwrap().of(&bytes[6..]) as u16;
    bytes.extend_from_slice(&sum.to_le_bytes());
    bytes
}

fn all(form: &FrameForm, pieces: &[&[u8]]) -> Vec<String> {
    let mut frames = Frames::new(form.clone());
    let mut got = Vec::new();
    let mut skipped = 0;
    for piece in pieces {
        frames.push(piece);
        while let Some(element) = frames.advance() {
            match element {
                StreamElement::Skipped { bytes, .. } => skipped += bytes,
                other => got.push(format!("{} {other:?}", core::mem::take(&mut skipped))),
            }
        }
        assert!(frames.kept() < form.most());
    }
    got.push(skipped.to_string());
    got
}

#[test]
fn numbers_of_every_kind_are_read_in_both_orders() {
    let bytes = [0xfe, 0xff, 0xff, 0x80, 0, 0, 0, 1];
    let read = |number, endian| NumberPosition::new(0, number, endian).value(&bytes).unwrap();
    use Endian::{Big, Little};
    use Number::*;
    assert_eq!((read(U8, Big), read(I8, Big)), (254.0, -2.0));
    assert_eq!((read(U16, Big), read(I16, Big), read(I16, Little)), (65279.0, -257.0, -2.0));
    assert_eq!((read(I24, Little), read(U24, Little), read(I24, Big)), (-2.0, 16_777_214.0, -65_537.0));
    assert_eq!((read(U32, Big), read(I32, Big)), (4_278_189_952.0, -16_777_344.0));
    assert_eq!(read(I64, Big), i64::from_be_bytes(bytes) as f64);
    let float = NumberPosition::new(-4, F32, Big).value(&[&[9][..], &1.5f32.to_be_bytes()].concat());
    assert_eq!(float, Some(1.5));
    assert_eq!(NumberPosition::new(0, F64, Little).value(&(-0.1f64).to_le_bytes()), Some(-0.1));
    let nibble = NumberPosition { mask: 0xf000, ..NumberPosition::new(0, U16, Big) };
    assert_eq!((nibble.masked(&bytes), nibble.count(&bytes)), (Some(0xf000), Some(15)));
    assert_eq!(NumberPosition::new(7, U16, Big).raw(&bytes), None);
    assert_eq!(NumberPosition::new(-9, U8, Big).raw(&bytes), None);
}

#[test]
fn forms_that_describe_no_frame_are_refused() {
    let form = declared();
    assert_eq!(form.check(true), Ok(()));
    let fixed = FrameForm { length: Length::Fixed(10), kind: None, ..form.clone() };
    assert_eq!(fixed.check(true), Ok(()));
    let refused = [
        (FrameForm { length: Length::Fixed(0), ..fixed.clone() }, FormFault::Length),
        (FrameForm { length: Length::Fixed(1), ..fixed.clone() }, FormFault::Length),
        (FrameForm { length: Length::Fixed(FRAME_BYTES_MAX + 1), ..fixed.clone() }, FormFault::Length),
        (FrameForm { sync: vec![], checksum: None, ..fixed.clone() }, FormFault::Unmarked),
        (
            FrameForm {
                kind: Some(Tag { place: NumberPosition::new(10, Number::U8, Endian::Big), values: vec![1] }),
                ..fixed.clone()
            },
            FormFault::Beyond(10),
        ),
        (
            FrameForm {
                checksum: fixed.checksum.clone().map(|summed| ChecksumField { to: 0, ..summed }),
                ..fixed.clone()
            },
            FormFault::Checksum,
        ),
        (
            FrameForm {
                checksum: fixed.checksum.clone().map(|summed| ChecksumField { from: 8, ..summed }),
                ..fixed.clone()
            },
            FormFault::Checksum,
        ),
        (
            FrameForm {
                checksum: fixed.checksum.clone().map(|summed| ChecksumField { at: 7, ..summed }),
                ..fixed.clone()
            },
            FormFault::Checksum,
        ),
    ];
    for (form, fault) in refused {
        assert_eq!(form.check(true), Err(fault), "{form:?}");
    }
    assert_eq!(FrameForm { sync: vec![], checksum: None, ..fixed }.check(false), Ok(()));
}

#[test]
fn frames_that_tell_their_length_are_found_and_those_of_another_kind_passed() {
    let (one, other) = (frame(7, b"abc"), frame(8, b""));
    let damaged = {
        let mut damaged = one.clone();
        damaged[9] ^= 1;
        damaged
    };
    let stream = [&b"\x6b\xb6"[..], &one, &other, &damaged, &one].concat();
    let got = all(&declared(), &[&stream]);
    assert_eq!(got[0], format!("2 Frame({one:?})"));
    assert_eq!(got[1], "0 Other");
    assert_eq!(got[2], format!("{} Frame({one:?})", damaged.len()));
    // An impossible length is rejected without waiting for its bytes.
    let huge = [&[0x6b, 0xb6, 0, 0, 0xff, 0xff][..], &one].concat();
    assert_eq!(all(&declared(), &[&huge])[0], format!("6 Frame({one:?})"));
}

#[test]
fn damage_is_classified_by_the_start_of_the_skipped_bytes() {
    let mut frames = Frames::new(declared());
    let one = frame(7, b"abc");
    frames.push(&[&[0x6b, 0xb6, 1, 0, 8, 0, 1][..], &[0; 16], &one].concat());
    assert_eq!(frames.advance(), Some(StreamElement::Skipped { bytes: 23, damaged: true }));
    frames.clear();
    frames.push(&[&[0; 16], &one[..]].concat());
    assert_eq!(frames.advance(), Some(StreamElement::Skipped { bytes: 16, damaged: false }));
    assert_eq!(frames.advance(), Some(StreamElement::Frame(&one)));
    assert_eq!(frames.advance(), None);
}

proptest! {
    #[test]
    fn pieces_make_no_difference(
        parts in proptest::collection::vec((0u8..6, proptest::collection::vec(any::<u8>(), 0..12)), 0..20),
        cuts in proptest::collection::vec(any::<u16>(), 0..10),
    ) {
        let mut stream = Vec::new();
        for (what, bytes) in &parts {
            match what {
                0 => stream.extend_from_slice(bytes),
                1 => stream.extend_from_slice(&[0x6b, 0xb6]),
                2 => stream.extend(frame(9, bytes)),
                _ => stream.extend(frame(7, bytes)),
            }
        }
        let mut cuts: Vec<usize> = cuts.iter().map(|cut| usize::from(*cut) % (stream.len() + 1)).chain([0, stream.len()]).collect();
        cuts.sort_unstable();
        let pieces: Vec<&[u8]> = cuts.windows(2).map(|pair| &stream[pair[0]..pair[1]]).collect();
        prop_assert_eq!(all(&declared(), &pieces), all(&declared(), &[&stream]));
    }

    #[test]
    fn a_described_frame_of_a_known_device_reads_what_its_own_parser_reads(
        bytes in proptest::collection::vec(any::<u8>(), 37), sound: bool, status: u16, force in any::<f32>(),
    ) {
        let bota = FrameForm {
            sync: vec![0xaa],
            length: Length::Fixed(37),
            tags: vec![],
            kind: None,
            checksum: Some(ChecksumField {
                checksum: Checksum::named("CRC-16/IBM-SDLC").unwrap(), from: 1, to: 35, at: 35, endian: Endian::Little,
            }),
        };
        let known = BotaFrame { status, force_n: [force; 3], torque_nm: [1.0; 3], timestamp_us: 7, temperature_c: 1.0 };
        let bytes = if sound { known.to_bytes().to_vec() } else { bytes };
        let own = BotaFrame::parse(bytes.first_chunk().unwrap());
        let matched = bota.match_start(&bytes);
        prop_assert_eq!(matches!(matched, FrameMatch::Frame(_)), own.is_some());
        if let (FrameMatch::Frame(frame), Some(own)) = (matched, own) {
            let read = NumberPosition::new(3, Number::F32, Endian::Little).value(frame).unwrap();
            prop_assert_eq!(read.to_bits(), f64::from(own.force_n[0]).to_bits());
        }
    }

    #[test]
    fn any_form_and_any_bytes_are_looked_at(
        sync in proptest::collection::vec(0u8..3, 0..3), length in 0usize..12, at in -12i32..12, from in -12i32..12, to in -12i32..12,
        declared: bool, bytes in proptest::collection::vec(0u8..6, 0..40),
    ) {
        let place = NumberPosition::new(at, Number::U8, Endian::Little);
        let form = FrameForm {
            sync,
            length: if declared { Length::InHead { place, plus: length, most: 20 } } else { Length::Fixed(length) },
            tags: vec![Tag { place, values: vec![0, 1, 2] }],
            kind: Some(Tag { place, values: vec![0, 1] }),
            checksum: Some(ChecksumField { checksum: Checksum::named("SUM-8").unwrap(), from, to, at, endian: Endian::Big }),
        };
        if form.check(true).is_ok() {
            let mut frames = Frames::new(form);
            frames.push(&bytes);
            while let Some(element) = frames.advance() {
                if let StreamElement::Frame(frame) = element {
                    prop_assert!(!frame.is_empty());
                }
            }
        }
    }
}
