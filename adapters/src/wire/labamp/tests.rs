//! Tests of the LabAmp decoder: reference frames in both byte orders, segmented, damaged and arbitrary streams, and the
//! JSON of requests and responses against the examples of Kistler's API documentation.

use super::talk::{Metadata, Refused, Request, Signal, client, done, least_scans_per_frame, stream};
use super::*;
use proptest::prelude::*;

const VECTORS: &str = include_str!("../../../../tests/data/plate_vectors.json");

/// The bytes of a reference frame, by its JSON pointer in [`VECTORS`].
fn vector(path: &str) -> Vec<u8> {
    let vectors: serde_json::Value = serde_json::from_str(VECTORS).unwrap();
    let hex = vectors.pointer(path).unwrap().as_str().unwrap();
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

/// The frame in the other byte order: the bytes of every number are reversed.
fn in_other_byte_order(frame: &[u8]) -> Vec<u8> {
    let widths: &[usize] = if frame[2] == 0 { &[2, 2, 4, 4, 2, 2, 1, 1, 2] } else { &[2, 2, 4, 4, 2, 2, 8] };
    let (mut rest, mut out) = (frame, Vec::new());
    for width in widths.iter().chain([4; 100].iter()) {
        let (number, after) = rest.split_at((*width).min(rest.len()));
        out.extend(number.iter().rev());
        rest = after;
    }
    out
}

#[test]
fn reference_frames_are_decoded_in_both_byte_orders() {
    let (data, event) = (vector("/kistler_data_frame_4ch_2scans/hex"), vector("/kistler_event_overrun"));
    for frames in [[data.clone(), event.clone()], [in_other_byte_order(&data), in_other_byte_order(&event)]] {
        let mut deframer = Deframer::default();
        deframer.push(&frames.concat());
        let Frame { sequence, measurement, content: Content::Data(data) } =
            deframer.next_frame().unwrap().unwrap()
        else {
            panic!()
        };
        assert_eq!((sequence, measurement, data.time_ns), (7, 1, 1_700_000_000_250_000_000));
        assert_eq!(
            (data.count(), data.numbers().collect::<Vec<_>>()),
            (8, (1..=8).map(|n| n as f32).collect())
        );
        let event = Frame { sequence: 8, measurement: 1, content: Content::Event(Event::Overrun) };
        assert_eq!(deframer.next_frame(), Some(Ok(event)));
        assert_eq!(deframer.next_frame(), None);
    }
}

#[test]
fn invalid_frames_are_rejected_with_a_reason() {
    let mut deframer = Deframer::default();
    deframer.push(b"HTTP/1.1 400 Bad Request");
    let error = deframer.next_frame().unwrap().unwrap_err();
    assert_eq!(error, Malformed::Front { front: *b"HTTP/1.1" });
    deframer.clear();
    // A truncated event and an undefined kind between two valid frames.
    let valid = vector("/kistler_event_overrun");
    let mut truncated = valid[..16].to_vec();
    truncated[4] = 16;
    let mut undefined = valid.clone();
    undefined[2] = 9;
    deframer.push(&[valid.clone(), truncated, undefined, valid].concat());
    let found: Vec<_> = core::iter::from_fn(|| {
        deframer.next_frame().map(|frame| frame.map(|frame| frame.content == Content::Other))
    })
    .collect();
    assert_eq!(found, [Ok(false), Err(Malformed::Length { length: 16 }), Ok(true), Ok(false)]);
}

#[test]
fn requests_match_the_documentation() {
    let body =
        |request: Request| (request.path, serde_json::from_str::<serde_json::Value>(&request.body).unwrap());
    let json = |text: &str| serde_json::from_str::<serde_json::Value>(text).unwrap();
    assert_eq!(
        body(Request::open("c82667ec", Some(2048))),
        (
            "/api/daq/stream/open",
            json(
                r#"{"measurements": [{"measurementId": 1, "scansPerFrame": 2048}], "clientId": "c82667ec"}"#
            )
        )
    );
    assert_eq!(
        body(Request::open("c", None)),
        ("/api/daq/stream/open", json(r#"{"measurements": [{"measurementId": 1}], "clientId": "c"}"#))
    );
    assert_eq!(
        body(Request::set_rate(62_500)),
        ("/api/param/set", json(r#"{"params": [{"name": "/daq/samplingRate", "value": "62500"}]}"#))
    );
    assert_eq!(
        body(Request::close("c", 3)),
        ("/api/daq/stream/close", json(r#"{"clientId": "c", "streamId": 3}"#))
    );
    assert_eq!([10, 100, 1000, 2500, 6250, 62_500].map(least_scans_per_frame), [1, 10, 100, 250, 512, 512]);
}

#[test]
fn responses_are_parsed_and_errors_contain_the_text_of_the_device() {
    assert_eq!(stream(r#"{"result": 0, "port": 2386, "streamId": 9}"#), Ok((2386, 9)));
    assert_eq!(
        stream(r#"{"result": 0, "port": 70000, "streamId": 9}"#),
        Err(Refused::Field { field: "port" })
    );
    assert_eq!(client(r#"{"result": 0, "clientId": "97b9"}"#), Ok("97b9".to_owned()));
    assert_eq!(done("<html>"), Err(Refused::NotJson));
    assert_eq!(done("{}"), Err(Refused::Field { field: "result" }));
    let refused = done(r#"{"result": 5, "error": {"text": "already_waiting"}}"#).unwrap_err();
    assert!(refused.to_string().contains("already_waiting"));
}

#[test]
fn channels_are_parsed_in_both_documented_forms() {
    let signals = r#"[{"dataType": "FLOAT32", "source": "Sensor-4", "name": "b", "unit": "g", "offset": 4},
                      {"dataType": "FLOAT32", "source": "Sensor-3", "name": "a", "unit": "N", "offset": 0}]"#;
    let provider = format!(r#"{{"name": "daq-provider", "samplingRate": 2500.0, "signals": {signals}}}"#);
    let flat =
        format!(r#"{{"result": 0, "metadata": {{"measurementId": 1, "signalProvider": {provider}}}}}"#);
    let nested =
        format!(r#"{{"result": 0, "metadata": {{"measurement": {{"signalProvider": {provider}}}}}}}"#);
    for answer in [flat.clone(), nested] {
        let metadata = Metadata::parse(&answer).unwrap();
        assert_eq!(metadata.rate_hz, 2500.0);
        let signal = |source: &str, name: &str, unit: &str| Signal {
            source: source.to_owned(),
            name: name.to_owned(),
            unit: unit.to_owned(),
        };
        assert_eq!(metadata.signals, [signal("Sensor-3", "a", "N"), signal("Sensor-4", "b", "g")]);
    }
    for (valid, invalid, field) in [
        ("\"offset\": 4", "\"offset\": 8", "offset"),
        ("FLOAT32", "INT16", "dataType"),
        ("2500.0", "0", "samplingRate"),
        ("\"unit\"", "\"einheit\"", "unit"),
    ] {
        assert_eq!(Metadata::parse(&flat.replace(valid, invalid)), Err(Refused::Field { field }));
    }
}

proptest! {
    #[test]
    fn frames_are_found_for_any_segmentation_of_the_stream(cuts in proptest::collection::vec(1_usize..50, 1..40)) {
        let bytes: Vec<u8> =
            [vector("/kistler_data_frame_4ch_2scans/hex"), vector("/kistler_event_overrun")].concat().repeat(4);
        let (mut deframer, mut rest, mut found) = (Deframer::default(), &bytes[..], 0);
        for cut in cuts.iter().cycle() {
            let (piece, after) = rest.split_at((*cut).min(rest.len()));
            deframer.push(piece);
            while let Some(frame) = deframer.next_frame() {
                frame.unwrap();
                found += 1;
            }
            rest = after;
            if rest.is_empty() { break; }
        }
        prop_assert_eq!(found, 8);
    }

    #[test]
    fn arbitrary_input_never_panics(pieces in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..100), 0..20), at in 0_usize..60, value: u8, text: String) {
        let mut damaged = vector("/kistler_data_frame_4ch_2scans/hex");
        damaged[at] = value;
        let mut deframer = Deframer::default();
        for piece in pieces.iter().chain([&damaged]) {
            deframer.push(piece);
            while let Some(frame) = deframer.next_frame() {
                if let Ok(Frame { content: Content::Data(data), .. }) = frame {
                    prop_assert_eq!(data.numbers().count(), data.count());
                }
            }
        }
        let _ = (Metadata::parse(&text), stream(&text));
    }
}
