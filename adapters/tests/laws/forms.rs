//! Frames of any configured layout, streams of datagrams, and a device's settings page: the result is independent of
//! the division into pieces.

use equipoise_adapters::ground::channels::{Direct, ForceUnit, MomentUnit};
use equipoise_adapters::ground::device::binary::{Binary, BinarySettings, Count, Field, Scans, Time};
use equipoise_adapters::ground::{Channels, GroundDevice};
use equipoise_adapters::wire::checksum::Checksum;
use equipoise_adapters::wire::frame::{
    ChecksumField, Endian, FrameForm, FrameMatch, Frames, Length, Number, NumberPosition, StreamElement, Tag,
};
use equipoise_adapters::wire::mvn::{Cut, HEADER_SIZE, Header, StreamCutter};
use equipoise_adapters::wire::netft_xml::NetFtPage;
use equipoise_simulator::wires;

use super::choices::{Choices, pieces};
use super::ground::{datagrams, stream};
use super::seeds::{Part, part};

const NUMBERS: [Number; 12] = [
    Number::U8,
    Number::I8,
    Number::U16,
    Number::I16,
    Number::U24,
    Number::I24,
    Number::U32,
    Number::I32,
    Number::U64,
    Number::I64,
    Number::F32,
    Number::F64,
];
const CHECKSUMS: [&str; 6] = ["SUM-8", "SUM-16", "XOR-8", "CRC-8/SMBUS", "CRC-16/CCITT-FALSE", "CRC-16/X-25"];
/// Count of an input's bytes that define the frames.
const FORM_BYTES: usize = 64;

/// The simulator's self-built plate if all choices are zero; otherwise an arbitrary layout.
fn form(choices: &mut Choices<'_>) -> FrameForm {
    if choices.byte() == 0 {
        let checksum = Checksum::named("CRC-16/CCITT-FALSE").unwrap();
        let summed = ChecksumField { checksum, from: 0, to: 32, at: 32, endian: Endian::Little };
        return FrameForm {
            sync: wires::binary::SYNC.to_vec(),
            length: Length::Fixed(wires::binary::FRAME_LEN),
            tags: Vec::new(),
            kind: None,
            checksum: Some(summed),
        };
    }
    let sync = choices.byte() % 4;
    let sync = choices.take(usize::from(sync)).to_vec();
    let length = match choices.byte() {
        fixed @ 0..=127 => Length::Fixed(usize::from(fixed)),
        declared => Length::InHead {
            place: place(choices),
            plus: usize::from(declared & 0x1f),
            most: usize::from(choices.small() % 300),
        },
    };
    let tags = (0..choices.byte() % 3).map(|_| tag(choices)).collect();
    let kind = (choices.byte() & 1 == 1).then(|| tag(choices));
    let checksum = CHECKSUMS.get(usize::from(choices.byte() % 9)).and_then(|name| Checksum::named(name));
    let checksum = checksum.map(|checksum| {
        let [from, to, at] =
            [choices.byte(), choices.byte(), choices.byte()].map(|at| i32::from(at.cast_signed()));
        ChecksumField { checksum, from, to, at, endian: endian(choices) }
    });
    FrameForm { sync, length, tags, kind, checksum }
}

fn endian(choices: &mut Choices<'_>) -> Endian {
    if choices.byte() & 1 == 0 { Endian::Little } else { Endian::Big }
}

fn place(choices: &mut Choices<'_>) -> NumberPosition {
    let number = NUMBERS[usize::from(choices.byte()) % NUMBERS.len()];
    let place = NumberPosition::new(i32::from(choices.byte().cast_signed()), number, endian(choices));
    // Masks apply only to unsigned integers.
    if number.is_unsigned() && choices.byte() & 1 == 1 {
        NumberPosition { mask: 0x0ff0, ..place }
    } else {
        place
    }
}

fn tag(choices: &mut Choices<'_>) -> Tag {
    let mut place = place(choices);
    if !place.number.is_unsigned() {
        place.number = Number::U8;
    }
    Tag { place, values: vec![u64::from(choices.byte()), u64::from(choices.small())] }
}

/// Frames of any layout: frames found match the layout, no byte is reported twice, and the result of a device that
/// reads them is independent of the division into pieces.
pub(crate) fn binary(bytes: &[u8]) {
    let (described, rest) = bytes.split_at(bytes.len().min(FORM_BYTES));
    let mut choices = Choices::new(described);
    let form = form(&mut choices);
    let places: [NumberPosition; 6] = match form.sync[..] == wires::binary::SYNC {
        true => core::array::from_fn(|index| {
            NumberPosition::new(8 + 4 * index as i32, Number::F32, Endian::Little)
        }),
        false => core::array::from_fn(|_| place(&mut choices)),
    };
    let count =
        (choices.byte() & 1 == 1).then(|| place(&mut choices)).filter(|place| place.number.is_unsigned());
    let time =
        (choices.byte() & 1 == 1).then(|| place(&mut choices)).filter(|place| place.number.is_unsigned());
    let all = places.iter().chain(&count).chain(&time);
    if form.check(true).is_err() || all.into_iter().any(|place| form.check_place(*place).is_err()) {
        return;
    }
    let (mut frames, mut declared) = (Frames::new(form.clone()), 0);
    frames.push(rest);
    while let Some(element) = frames.advance() {
        match element {
            StreamElement::Frame(frame) => {
                assert!(matches!(form.match_start(frame), FrameMatch::Frame(whole) if whole == frame));
                assert!((form.least()..=form.most()).contains(&frame.len()));
                declared += frame.len();
            }
            StreamElement::Other => {}
            StreamElement::Skipped { bytes, .. } => declared += bytes,
        }
    }
    assert!(declared + frames.kept() <= rest.len());
    let direct = Direct { force: [Some(0), Some(1), Some(2)], moment: [Some(3), Some(4), Some(5)] };
    let settings = BinarySettings {
        form,
        datagrams: false,
        fields: places.map(|place| Field { place, scale: 1.0, per: 1.0, offset: 0.0 }).to_vec(),
        channels: Channels::direct(6, direct, ForceUnit::Newton, MomentUnit::NewtonMetre).unwrap(),
        scans: Scans { count: 1, bytes: 0 },
        rate_hz: None,
        sequence: count.map(|place| Count { place, modulus: 256 }),
        counter: None,
        time: time.map(|place| Time { place, unit_ns: 1000 }),
        status: None,
        trigger: None,
        request: None,
        close_command: None,
    };
    let device = |datagrams| {
        let settings = BinarySettings { datagrams, ..settings.clone() };
        Box::new(Binary::new(settings)) as Box<dyn GroundDevice>
    };
    stream(|| device(false), rest);
    datagrams(|| device(true), rest);
}

/// Result of a stream parser for these pieces: datagrams, losses of synchronisation, bytes skipped.
fn cuts<'a>(pieces: impl Iterator<Item = &'a [u8]>) -> (Vec<Option<Vec<u8>>>, u64) {
    let (mut cutter, mut cuts) = (StreamCutter::new(), Vec::new());
    for piece in pieces {
        cutter.push(piece);
        while let Some(cut) = cutter.advance() {
            cuts.push(match cut {
                Cut::Datagram => Some(cutter.datagram().to_vec()),
                Cut::LostStep => None,
            });
        }
    }
    (cuts, cutter.skipped_bytes())
}

/// Datagrams over TCP are independent of the division into pieces, and each has the length in its header.
pub(crate) fn mvn_stream(bytes: &[u8]) {
    let (lengths, stream) = bytes.split_at(bytes.len().min(8));
    let (whole, skipped) = cuts(std::iter::once(stream));
    for datagram in whole.iter().flatten() {
        let header = Header::parse(datagram).unwrap();
        assert_eq!(datagram.len(), HEADER_SIZE + usize::from(header.payload_size));
    }
    // A truncated datagram may include the first letters of the next.
    let length: usize = whole.iter().flatten().map(|datagram| datagram.len() - 3).sum();
    assert!(length + skipped as usize <= stream.len());
    let (parts, _) = cuts(pieces(stream, lengths));
    assert_eq!(whole, parts);
}

/// A Net F/T's settings page: positive numbers, or a short reason.
pub(crate) fn netft_xml(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    match NetFtPage::parse(text) {
        Ok(page) => {
            let counts = [page.counts_per_force, page.counts_per_torque];
            assert!(counts.into_iter().flatten().all(|counts| counts > 0.0 && counts.is_finite()));
        }
        Err(fault) => assert!(!fault.to_string().is_empty()),
    }
}

/// Valid inputs.
pub(crate) mod seeds {
    use super::{FORM_BYTES, Part, part, wires};

    pub(crate) fn binary() -> Vec<Vec<u8>> {
        let frame = |index: u16| wires::binary::Frame {
            sequence: index,
            time_us: u32::from(index) * 10_000,
            wrench: [1.0, 2.0, 700.0, 3.0, 4.0, 5.0],
        };
        let frames: Vec<u8> = (0..8).flat_map(|index| frame(index).to_bytes()).collect();
        // A sync byte, a length field, and a checksum: `A5 05 x y s`.
        let mut declared = vec![1, 1, 0xa5, 200, 0, 1, 0, 0, 40, 0, 0, 0];
        declared.resize(FORM_BYTES, 0);
        declared.extend([0xa5, 9, 1, 2, 3, 4, 5, 6, 7].repeat(6));
        vec![[&[0; FORM_BYTES][..], &[3, 40, 0, 7, 120, 1, 1, 60], &frames].concat(), declared]
    }

    pub(crate) fn mvn_stream() -> Vec<Vec<u8>> {
        let sample = |counter: u32| Part::ALL.into_iter().flat_map(move |kind| part(kind, counter, 0.1));
        let stream: Vec<u8> = (0..3).flat_map(sample).collect();
        let damaged = [&stream[..2000], b"MXTP02", &stream[1500..]].concat();
        let json = [b"{\"type\":\"transport\"}", &stream[..3000]].concat();
        [stream, damaged, json].map(|stream| [&[3, 40, 0, 7, 120, 1, 1, 60], &stream[..]].concat()).to_vec()
    }

    pub(crate) fn netft_xml() -> Vec<Vec<u8>> {
        let page = wires::ati_rdt::Page {
            counts_per_unit: [1e6, 1e6],
            units: ["N".into(), "Nm".into()],
            rdt_enabled: true,
            rate_hz: 7000,
            block: 1,
        };
        vec![page.to_xml().into_bytes()]
    }
}
