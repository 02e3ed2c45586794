use super::*;
use proptest::prelude::*;

const FORMATS: [(&str, Format); 6] = [
    ("float32", Format::Float32),
    ("double64", Format::Double64),
    ("int8", Format::Int8),
    ("int16", Format::Int16),
    ("int32", Format::Int32),
    ("int64", Format::Int64),
];

fn xml(format: &str, count: usize, channels: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n<info>\n\t<name>Plate &amp; more</name>\n\t<type>Force</type>\n\t<channel_count>{count}\
         </channel_count>\n\t<channel_format>{format}</channel_format>\n\t<source_id>amti-1</source_id>\n\t<nominal_srate>\
         1000</nominal_srate>\n\t<version>1.1</version>\n\t<created_at>1</created_at>\n\t<uid>aa-bb</uid>\n\t<session_id>\
         default</session_id>\n\t<hostname>pc</hostname>\n\t<v4address />\n\t<v4data_port>16573</v4data_port>\n\t\
         <v4service_port>16573</v4service_port>\n\t<v6address />\n\t<v6data_port>0</v6data_port>\n\t<desc>{channels}\
         <name>not this</name></desc>\n</info>\n"
    )
}

/// A number encoded in a format.
fn number(format: Format, value: f64, big_endian: bool) -> Vec<u8> {
    let mut bytes = match format {
        Format::Float32 => (value as f32).to_le_bytes().to_vec(),
        Format::Double64 => value.to_le_bytes().to_vec(),
        Format::Int8 => (value as i8).to_le_bytes().to_vec(),
        Format::Int16 => (value as i16).to_le_bytes().to_vec(),
        Format::Int32 => (value as i32).to_le_bytes().to_vec(),
        Format::Int64 => (value as i64).to_le_bytes().to_vec(),
    };
    if big_endian {
        bytes.reverse();
    }
    bytes
}

fn sample(format: Format, time_s: Option<f64>, values: &[f64], big_endian: bool) -> Vec<u8> {
    let mut bytes = vec![if time_s.is_some() { 2 } else { 1 }];
    bytes.extend(time_s.map(|time_s| number(Format::Double64, time_s, big_endian)).unwrap_or_default());
    bytes.extend(values.iter().flat_map(|value| number(format, *value, big_endian)));
    bytes
}

/// Header and pattern for three channels, as liblsl sends them.
fn opening(format: Format, big_endian: bool) -> Vec<u8> {
    let order = if big_endian { 4321 } else { 1234 };
    let head = format!(
        "LSL/110 200 OK\r\nUID: aa-bb\r\nByte-Order: {order}; so\r\nSuppress-Subnormals: 0\r\nData-Protocol-Version: 110\r\n\r\n"
    );
    let base = match format {
        Format::Float32 => 0.0,
        Format::Double64 => 16_777_217.0,
        Format::Int8 => 1.0,
        Format::Int16 => 257.0,
        Format::Int32 => 65_537.0,
        Format::Int64 => 2_147_483_649.0,
    };
    let pattern = |first: f64| {
        let values = [base + first, -(base + first + 1.0), base + first + 2.0];
        sample(format, Some(123_456.789), &values, big_endian)
    };
    [head.into_bytes(), pattern(4.0), pattern(2.0)].concat()
}

#[test]
fn a_description_is_read_with_its_channels() {
    let channels = "<channels><channel><label>Fx</label><unit>N</unit><type>Force</type></channel>\
                    <channel><unit>N&#183;m</unit><label>M&lt;x</label></channel><channel/></channels>";
    let info = StreamInfo::parse(&xml("float32", 4, channels)).unwrap();
    assert_eq!(
        (info.name.as_str(), info.kind.as_str(), info.source_id.as_str()),
        ("Plate & more", "Force", "amti-1")
    );
    assert_eq!(
        (info.format, info.rate_hz, info.data_port, info.uid.as_str()),
        (Format::Float32, 1000.0, 16_573, "aa-bb")
    );
    let channel = |label: &str, unit: &str| Channel { label: label.to_owned(), unit: unit.to_owned() };
    assert_eq!(info.channels, [channel("Fx", "N"), channel("M<x", "N·m"), channel("", ""), channel("", "")]);
    assert_eq!(
        StreamInfo::parse(&xml("float32", 2, "")).unwrap().channels,
        [channel("", ""), channel("", "")]
    );
}

#[test]
fn a_description_that_cannot_be_used_says_which_part() {
    let sound = xml("float32", 2, "");
    for (from, to, field) in [
        ("float32", "string", "channel_format"),
        ("<channel_count>2", "<channel_count>0", "channel_count"),
        ("<channel_count>2", "<channel_count>999999999", "channel_count"),
        ("16573</v4data_port>", "99999</v4data_port>", "v4data_port"),
        ("<nominal_srate>1000", "<nominal_srate>inf", "nominal_srate"),
        ("aa-bb", "aa\r\nX: y", "uid"),
    ] {
        assert_eq!(StreamInfo::parse(&sound.replace(from, to)), Err(InfoFault::Field { field }), "{to}");
    }
    assert!(matches!(StreamInfo::parse(&sound[..200]), Err(InfoFault::Xml { .. })));
    assert!(StreamInfo::parse(&"<a>".repeat(100)).is_err());
}

#[test]
fn questions_are_as_liblsl_reads_them() {
    let asked = short_info_request(&[("session_id", "default"), ("name", "Plate")], 4242, 77);
    assert_eq!(asked, b"LSL:shortinfo\r\nsession_id='default' and name='Plate'\r\n4242 77\r\n");
    let answer = format!("77\r\n{}", xml("int16", 3, ""));
    assert_eq!(short_info_answer(answer.as_bytes(), 77).unwrap().format, Format::Int16);
    assert_eq!(short_info_answer(answer.as_bytes(), 78), None);
    let request = String::from_utf8(feed_request(&StreamInfo::parse(&xml("int16", 3, "")).unwrap())).unwrap();
    assert!(request.starts_with("LSL:streamfeed/110 aa-bb\r\nNative-Byte-Order: 1234\r\n"), "{request}");
    assert!(
        request.contains("\r\nValue-Size: 2\r\n") && request.contains("\r\nMax-Buffer-Length: 10000\r\n"),
        "{request}"
    );
    assert!(request.ends_with("\r\nSession-Id: default\r\n\r\n"), "{request}");
}

#[test]
fn every_format_is_read_in_both_orders_of_bytes() {
    for (name, format) in FORMATS {
        assert_eq!(Format::named(name), Some(format));
        for big_endian in [false, true] {
            let mut feed = Feed::new("aa-bb", format, 3);
            feed.push(&opening(format, big_endian));
            assert_eq!(feed.next_item(), Some(Ok(Item::Agreed)), "{name}");
            feed.push(&sample(format, Some(7.25), &[1.0, -2.0, 100.0], big_endian));
            feed.push(&sample(format, None, &[1.0, -2.0, 101.0], big_endian));
            let values = [1.0, -2.0, 100.0];
            assert_eq!(feed.next_item(), Some(Ok(Item::Sample { time_s: Some(7.25), values: &values })));
            let values = [1.0, -2.0, 101.0];
            assert_eq!(feed.next_item(), Some(Ok(Item::Sample { time_s: None, values: &values })));
            assert_eq!(feed.next_item(), None);
        }
    }
}

#[test]
fn a_feed_that_is_not_what_was_asked_for_is_a_reason() {
    let sound = opening(Format::Float32, false);
    let with = |from: &str, to: &str| {
        let at = sound.windows(from.len()).position(|part| part == from.as_bytes()).unwrap();
        [&sound[..at], to.as_bytes(), &sound[at + from.len()..]].concat()
    };
    let mut wrong = sound.clone();
    *wrong.last_mut().unwrap() ^= 1;
    let refused = Malformed::Refused { status: "LSL/110 505 Version not supported".to_owned() };
    for (bytes, want) in [
        (with("LSL/110 200 OK", "HTTP/1.1 200 OK"), Malformed::NotLsl),
        (with("200 OK", "404 Not found"), Malformed::Gone),
        (with("aa-bb", "cc-dd"), Malformed::Gone),
        (with("200 OK", "505 Version not supported"), refused),
        (with("1234", "2143"), Malformed::ByteOrder),
        (with("Version: 110", "Version: 100"), Malformed::Version { version: "100".to_owned() }),
        (wrong, Malformed::Pattern),
        (vec![b'x'; 20_000], Malformed::NotLsl),
    ] {
        let mut feed = Feed::new("aa-bb", Format::Float32, 3);
        feed.push(&bytes);
        assert_eq!(feed.next_item(), Some(Err(want)));
        feed.push(&sound);
        assert_eq!(feed.next_item(), None);
    }
    let mut feed = Feed::new("aa-bb", Format::Float32, 3);
    feed.push(&[sound, vec![9]].concat());
    assert_eq!(feed.next_item(), Some(Ok(Item::Agreed)));
    assert_eq!(feed.next_item(), Some(Err(Malformed::Tag { tag: 9 })));
}

proptest! {
    #[test]
    fn samples_are_found_however_the_stream_is_divided(
        cuts in proptest::collection::vec(1_usize..30, 1..30),
        sent in proptest::collection::vec((any::<bool>(), proptest::array::uniform3(-1e6_f32..1e6)), 0..20),
    ) {
        let mut bytes = opening(Format::Float32, false);
        for (index, (stamped, values)) in sent.iter().enumerate() {
            let time_s = stamped.then_some(index as f64);
            bytes.extend(sample(Format::Float32, time_s, &values.map(f64::from), false));
        }
        let (mut feed, mut rest, mut got) = (Feed::new("aa-bb", Format::Float32, 3), &bytes[..], Vec::new());
        for cut in cuts.iter().cycle() {
            let (piece, after) = rest.split_at((*cut).min(rest.len()));
            feed.push(piece);
            while let Some(item) = feed.next_item() {
                if let Item::Sample { time_s, values } = item.unwrap() {
                    got.push((time_s.is_some(), [values[0] as f32, values[1] as f32, values[2] as f32]));
                }
            }
            rest = after;
            if rest.is_empty() { break; }
        }
        prop_assert_eq!(got, sent);
    }

    #[test]
    fn anything_may_come(pieces in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..200), 0..10), opened: bool, text: String) {
        let mut feed = Feed::new("aa-bb", Format::Int16, 3);
        if opened { feed.push(&opening(Format::Int16, true)); }
        for piece in &pieces {
            feed.push(piece);
            while feed.next_item().is_some() {}
        }
        let _ = (StreamInfo::parse(&text), StreamInfo::parse(&format!("<info>{text}</info>")));
        let _ = short_info_answer(text.as_bytes(), 1);
    }
}
