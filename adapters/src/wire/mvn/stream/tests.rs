//! Properties of the stream parser: the result is independent of portions, and damage affects only the damaged
//! datagrams.

use super::*;
use crate::wire::mvn::{
    Datagram, JointAngle, LinearKinematics, SegmentPose, joint_angles, linear_kinematics, meta,
    pose_quaternion,
};
use proptest::prelude::*;

/// A datagram of one of the types, different for every counter.
fn datagram(kind: usize, counter: u32) -> Vec<u8> {
    let header = Header::new(counter, counter * 4, 0);
    let number = counter as f32 * 0.37;
    let mut bytes = Vec::new();
    match kind % 4 {
        0 => {
            let pose = SegmentPose { segment_id: 1, position_m: [number; 3], orientation_wxyz: [0.5; 4] };
            pose_quaternion::encode(&header, &[pose; 23], &mut bytes).unwrap();
        }
        1 => {
            let angle = JointAngle { parent_point: 0x0102, child_point: 0x0201, angle_deg: [number; 3] };
            joint_angles::encode(&header, &[angle; 22], &mut bytes).unwrap();
        }
        2 => {
            let item = LinearKinematics {
                segment_id: 1,
                position_m: [number; 3],
                velocity_m_per_s: [0.0; 3],
                acceleration_m_per_s2: [-number; 3],
            };
            linear_kinematics::encode(&header, &[item; 23], &mut bytes).unwrap();
        }
        _ => meta::encode(&header, &[("name", &format!("worker {counter}"))], &mut bytes).unwrap(),
    }
    bytes
}

/// All elements of a stream that arrives in portions; `None` is a loss of synchronisation.
fn cuts<'a>(portions: impl IntoIterator<Item = &'a [u8]>) -> (Vec<Option<Vec<u8>>>, u64) {
    let mut cutter = StreamCutter::new();
    let mut cuts = Vec::new();
    for portion in portions {
        cutter.push(portion);
        while let Some(cut) = cutter.advance() {
            cuts.push((cut == Cut::Datagram).then(|| cutter.datagram().to_vec()));
        }
        assert!(cutter.buffer.len() <= 70_000 + portion.len(), "the buffer is bounded");
    }
    (cuts, cutter.skipped_bytes())
}

fn in_portions<'a>(stream: &'a [u8], ends: &[usize]) -> Vec<&'a [u8]> {
    let mut ends: Vec<usize> = ends.iter().map(|end| end % (stream.len() + 1)).collect();
    ends.push(stream.len());
    ends.sort_unstable();
    let mut begin = 0;
    ends.into_iter().map(|end| &stream[core::mem::replace(&mut begin, end)..end]).collect()
}

#[derive(Debug, Clone)]
enum Damage {
    None,
    /// Bytes inserted before it.
    Before(Vec<u8>),
    /// Some of its bytes overwritten.
    Overwritten(usize, Vec<u8>),
    /// Some of its bytes removed.
    Gone(usize, usize),
    /// Bytes inserted within it.
    Within(usize, Vec<u8>),
}

/// Noise, some of it similar to valid data.
fn noise() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        proptest::collection::vec(any::<u8>(), 1..80),
        proptest::collection::vec(any::<u8>(), 0..40).prop_map(|tail| [b"{\"a\"", &tail[..]].concat()),
        proptest::collection::vec(any::<u8>(), 0..60).prop_map(|tail| [b"MXTP12", &tail[..]].concat()),
        Just(b"MXT".to_vec()),
        Just(b"M".to_vec()),
    ]
}

fn damage() -> impl Strategy<Value = Damage> {
    prop_oneof![
        4 => Just(Damage::None),
        1 => noise().prop_map(Damage::Before),
        1 => (any::<usize>(), noise()).prop_map(|(at, bytes)| Damage::Overwritten(at, bytes)),
        1 => (any::<usize>(), 1..2000usize).prop_map(|(at, count)| Damage::Gone(at, count)),
        1 => (any::<usize>(), noise()).prop_map(|(at, bytes)| Damage::Within(at, bytes)),
        // The last few bytes, and the sizes in the header, are the most critical.
        1 => (1..4usize).prop_map(|count| Damage::Gone(usize::MAX, count)),
        1 => any::<[u8; 2]>().prop_map(|size| Damage::Overwritten(22, size.to_vec())),
    ]
}

/// The damaged bytes, and whether the datagram itself is still intact.
fn damaged(datagram: &[u8], damage: &Damage) -> (Vec<u8>, bool) {
    let mut bytes = datagram.to_vec();
    match damage {
        Damage::None => {}
        Damage::Before(noise) => bytes.splice(0..0, noise.iter().copied()).for_each(drop),
        Damage::Overwritten(at, noise) => {
            let at = at % bytes.len();
            let end = (at + noise.len()).min(bytes.len());
            bytes[at..end].copy_from_slice(&noise[..end - at]);
        }
        Damage::Gone(at, count) => {
            let count = *count.min(&bytes.len());
            let at = if *at == usize::MAX { bytes.len() - count } else { at % (bytes.len() - count + 1) };
            drop(bytes.drain(at..at + count));
        }
        Damage::Within(at, noise) => {
            let at = 1 + at % (bytes.len() - 1);
            bytes.splice(at..at, noise.iter().copied()).for_each(drop);
        }
    }
    let whole = matches!(damage, Damage::None | Damage::Before(_));
    (bytes, whole)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn a_sound_stream_gives_its_datagrams_in_any_portions(
        kinds in proptest::collection::vec(0..4usize, 1..12), ends in proptest::collection::vec(any::<usize>(), 0..30)
    ) {
        let sent: Vec<Vec<u8>> = kinds.iter().enumerate().map(|(index, kind)| datagram(*kind, index as u32)).collect();
        let stream = sent.concat();
        let (cut, skipped_bytes) = cuts(in_portions(&stream, &ends));
        prop_assert_eq!(cut, sent.into_iter().map(Some).collect::<Vec<_>>());
        prop_assert_eq!(skipped_bytes, 0);
    }

    #[test]
    fn damage_costs_the_damaged_datagram_and_no_other_in_any_portions(
        parts in proptest::collection::vec((0..4usize, damage()), 1..12),
        ends in proptest::collection::vec(any::<usize>(), 0..30),
    ) {
        let mut stream = Vec::new();
        let mut whole = Vec::new();
        for (index, (kind, damage)) in parts.iter().enumerate() {
            let sent = datagram(*kind, index as u32);
            let (bytes, is_whole) = damaged(&sent, damage);
            stream.extend(bytes);
            if is_whole {
                whole.push(sent);
            }
        }
        let (cut, skipped_bytes) = cuts([&stream[..]]);
        let got: Vec<&Vec<u8>> = cut.iter().flatten().collect();
        let mut left = got.iter();
        for sent in &whole {
            prop_assert!(left.any(|got| *got == sent), "a whole datagram was lost");
        }
        // All parsed datagrams were sent, intact or damaged.
        prop_assert!(got.len() <= 2 * parts.len());
        prop_assert_eq!(cuts(in_portions(&stream, &ends)), (cut, skipped_bytes));
    }

    #[test]
    fn whatever_comes_nothing_panics_and_nothing_grows(bytes in proptest::collection::vec(any::<u8>(), 0..4000)) {
        let (cut, skipped_bytes) = cuts(bytes.chunks(700));
        let all = cut.iter().flatten().map(Vec::len).sum::<usize>() as u64 + skipped_bytes;
        prop_assert!(all <= bytes.len() as u64);
    }
}

#[test]
fn text_between_datagrams_is_stepped_over_and_is_no_damage() {
    let (first, second) = (datagram(0, 1), datagram(3, 2));
    let text = br#"{"type":"transport","value":{"note":"a } and a \" and a {"}}"#;
    let stream = [&first[..], text, b"\r\n", text, &second].concat();
    let (cut, skipped_bytes) = cuts([&stream[..]]);
    assert_eq!(cut, [Some(first), Some(second)]);
    assert_eq!(skipped_bytes, 0);
}

#[test]
fn each_loss_of_synchronisation_is_reported_once_with_its_bytes() {
    let (first, second) = (datagram(0, 1), datagram(1, 2));
    let stream = [&first[..], &[7; 100], &second, b"oops", &first].concat();
    for portions in [vec![&stream[..]], stream.chunks(9).collect(), stream.chunks(1).collect()] {
        let (cut, skipped_bytes) = cuts(portions);
        assert_eq!(cut, [Some(first.clone()), None, Some(second.clone()), None, Some(first.clone())]);
        assert_eq!(skipped_bytes, 104);
    }
}

#[test]
fn a_packet_without_payload_size_is_refused_by_the_parser() {
    let mut old = datagram(0, 1);
    old[22..24].copy_from_slice(&[0, 0]);
    let stream = [&old[..], &datagram(0, 2)].concat();
    let (cut, _) = cuts([&stream[..]]);
    let [Some(header), None, Some(_)] = &cut[..] else { panic!("{cut:?}") };
    assert!(Datagram::parse(header).unwrap_err().to_string().contains("older than MVN 2018"));
}
