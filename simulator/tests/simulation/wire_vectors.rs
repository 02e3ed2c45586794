//! The simulator's encoders compared with bytes from other sources: vectors from the makers' manuals, and real MVN
//! values.

use std::path::PathBuf;

use equipoise_simulator::wires::mvn::Stamp;
use equipoise_simulator::wires::mvn::describe;
use equipoise_simulator::wires::mvn::items::{self, Tracker};
use equipoise_simulator::wires::{amti, ati_rdt, bota, labamp, moticon, tec_gihan};
use serde_json::Value;

fn vectors() -> Value {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data/plate_vectors.json");
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn unhex(text: &Value) -> Vec<u8> {
    let text = text.as_str().unwrap();
    (0..text.len() / 2).map(|i| u8::from_str_radix(&text[2 * i..2 * i + 2], 16).unwrap()).collect()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

#[test]
fn rdt_requests_are_understood_and_records_are_those_of_the_manual() {
    let vectors = vectors();
    let asked = |name: &str| ati_rdt::request(&unhex(&vectors[name]), ati_rdt::Family::NetFt);
    assert_eq!(asked("rdt_start_realtime"), Some((ati_rdt::Command::Stream, 0)));
    assert_eq!(asked("rdt_stop"), Some((ati_rdt::Command::Stop, 0)));
    assert_eq!(asked("rdt_bias"), Some((ati_rdt::Command::Bias, 0)));
    let reported = &vectors["rdt_record"];
    let counts =
        |name: &str, per_unit: &str| (number(&reported[name]) * number(&reported[per_unit])).round() as i32;
    let record = ati_rdt::Record {
        rdt_sequence: 1000,
        ft_sequence: 123_456,
        status: 0,
        force_counts: ["fx", "fy", "fz"].map(|name| counts(name, "cpf")),
        torque_counts: ["tx", "ty", "tz"].map(|name| counts(name, "cpt")),
    };
    assert_eq!(hex(&record.to_bytes()), reported["hex"].as_str().unwrap());
}

#[test]
fn a_bota_frame_has_the_vectors_bytes() {
    let frame = bota::Frame {
        status: 0,
        wrench: [1.5, -2.5, 700.25, 0.1, -0.0184, 0.034],
        timestamp_us: 123_456_789,
        temperature_c: 31.25,
    };
    let expected = unhex(&vectors()["bota_frame"]["hex"]);
    // The vector's description lacks the moments in decimals: the bytes between are taken from it.
    let moments: Vec<f32> =
        expected[15..27].chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect();
    let wrench = [1.5, -2.5, 700.25, moments[0], moments[1], moments[2]];
    assert_eq!(hex(&bota::Frame { wrench, ..frame }.to_bytes()), hex(&expected));
}

#[test]
fn an_amti_frame_has_the_vectors_bytes_with_and_without_trigger() {
    let vectors = vectors();
    let reported = &vectors["amti_rs232_frame"];
    let counts: Vec<i16> =
        reported["counts_minus_2048"].as_array().unwrap().iter().map(|count| number(count) as i16).collect();
    let counts: [i16; 12] = counts.try_into().unwrap();
    assert_eq!(hex(&amti::frame(counts, false)), reported["hex"].as_str().unwrap());
    let triggered = &vectors["amti_rs232_frame_trigger"];
    assert_eq!(hex(&amti::frame(counts, true)), triggered["hex"].as_str().unwrap());
}

#[test]
fn labamp_frames_have_the_vectors_bytes() {
    let vectors = vectors();
    let scans = [[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]].map(Vec::from);
    let data = labamp::data(7, (1_700_000_000, 250_000_000), &scans);
    assert_eq!(hex(&data), vectors["kistler_data_frame_4ch_2scans"]["hex"].as_str().unwrap());
    let overrun = labamp::event(8, 1, labamp::Event::Overrun);
    // The vector has ERROR (0), where an overrun is rather a warning: only the level differs.
    let expected = unhex(&vectors["kistler_event_overrun"]);
    assert_eq!((&overrun[..16], &overrun[17..]), (&expected[..16], &expected[17..]));
}

#[test]
fn tec_gihans_numbers_are_the_vectors() {
    let vectors = vectors();
    let reported = &vectors["tecgihan_sample"];
    let eng: Vec<f64> = reported["eng"].as_array().unwrap().iter().map(number).collect();
    let plate = tec_gihan::PlateInfo::new(106, -0.042);
    assert_eq!(reported["fs_R3K"], serde_json::json!([1500, 1500, 3000, 300, 300, 200]));
    let counts = plate.counts(0, eng.try_into().unwrap());
    assert_eq!(hex(&tec_gihan::block(&[vec![counts]])), reported["hex"].as_str().unwrap());
}

#[test]
fn a_moticon_datagram_says_the_vectors_numbers_in_the_vectors_fields() {
    let vectors = vectors();
    let expected: Vec<f64> = vectors["moticon_51"]["text"]
        .as_str()
        .unwrap()
        .split(' ')
        .map(|field| field.parse().unwrap())
        .collect();
    let insole = |from: usize| {
        let part = |at: usize, count: usize| expected[from + at..from + at + count].to_vec();
        moticon::Insole {
            acceleration_g: part(0, 3).try_into().unwrap(),
            turning_deg_per_s: part(3, 3).try_into().unwrap(),
            cop: part(6, 2).try_into().unwrap(),
            pressure: part(8, 16).try_into().unwrap(),
            force_n: expected[from + 24],
        }
    };
    let text = moticon::datagram(expected[0], &[insole(1), insole(26)], &moticon::ALL);
    let reported: Vec<f64> = text.split(' ').map(|field| field.parse().unwrap()).collect();
    assert_eq!(reported, expected);
}

fn wire_file(name: &str) -> Option<Vec<u8>> {
    let shared = std::env::var_os("EQUIPOISE_SHARED")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")), PathBuf::from);
    let path = shared.join("data/wire").join(name);
    match std::fs::read(&path) {
        Ok(bytes) => Some(bytes),
        Err(error) => {
            println!("skipped: {} cannot be read ({error}); set EQUIPOISE_SHARED", path.display());
            None
        }
    }
}

/// Reads numbers and ids of a payload, without any parser of this project.
struct Payload<'a>(&'a [u8]);

impl Payload<'_> {
    fn word(&mut self) -> u32 {
        let (word, rest) = self.0.split_first_chunk().unwrap();
        self.0 = rest;
        u32::from_be_bytes(*word)
    }

    fn floats<const N: usize>(&mut self) -> [f32; N] {
        std::array::from_fn(|_| f32::from_bits(self.word()))
    }

    fn each<Item>(mut self, mut take: impl FnMut(&mut Self) -> Item) -> Vec<Item> {
        let mut items = Vec::new();
        while !self.0.is_empty() {
            items.push(take(&mut self));
        }
        items
    }
}

/// Encodes the same datagram from its numbers.
fn again(bytes: &[u8]) -> Vec<u8> {
    let word = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
    let stamp = Stamp {
        segments: bytes[17..20].try_into().unwrap(),
        ..Stamp::of_a_body(word(6), word(12), bytes[16])
    };
    let payload = Payload(&bytes[24..]);
    match &bytes[4..6] {
        b"01" => items::pose_euler(&stamp, &payload.each(|p| (p.word(), p.floats(), p.floats()))),
        b"02" => items::pose_quaternion(&stamp, &payload.each(|p| (p.word(), p.floats(), p.floats()))),
        b"20" => items::joint_angles(&stamp, &payload.each(|p| ([p.word(), p.word()], p.floats()))),
        b"21" => {
            let segment = |p: &mut Payload<'_>| (p.word(), [p.floats(), p.floats(), p.floats()]);
            items::linear_kinematics(&stamp, &payload.each(segment))
        }
        b"22" => {
            let segment = |p: &mut Payload<'_>| (p.word(), p.floats(), [p.floats(), p.floats()]);
            items::angular_kinematics(&stamp, &payload.each(segment))
        }
        b"23" => items::trackers(
            &stamp,
            &payload.each(|p| Tracker {
                segment_id: p.word(),
                orientation_wxyz: p.floats(),
                free_acceleration: p.floats(),
                measured: Some([p.floats(), p.floats()]),
                magnetic: p.floats(),
            }),
        ),
        b"24" => items::centre_of_mass(&stamp, payload.each(Payload::floats)[0], None),
        b"25" => {
            let part = |at: usize, count: usize| {
                std::str::from_utf8(&bytes[28 + at..28 + at + count]).unwrap().parse::<u32>().unwrap()
            };
            let at_ms = ((part(0, 2) * 60 + part(3, 2)) * 60 + part(6, 2)) * 1000 + part(9, 3);
            describe::time_of_day(&stamp, at_ms, true)
        }
        kind => panic!("{kind:?}"),
    }
    .unwrap()
}

#[test]
fn a_recordings_datagrams_are_made_again_byte_for_byte() {
    let Some(file) = wire_file("meri020.mxtp.bin") else { return };
    let (mut rest, mut count) = (&file[..], 0);
    while let Some((length, behind)) = rest.split_first_chunk::<4>() {
        let (datagram, behind) = behind.split_at(u32::from_be_bytes(*length) as usize);
        assert_eq!(hex(&again(datagram)), hex(datagram));
        (rest, count) = (behind, count + 1);
    }
    assert_eq!(count, 28);
}

#[test]
fn real_datagrams_are_made_again_byte_for_byte() {
    let (Some(euler), Some(quaternion)) = (wire_file("mxtp01.bin"), wire_file("mxtp02.bin")) else { return };
    assert_eq!(hex(&again(&euler)), hex(&euler));
    assert_eq!(hex(&again(&quaternion)), hex(&quaternion));
    let Some(meta) = wire_file("mxtp12.bin") else { return };
    let tags = [("color", "e96417"), ("count", "1"), ("name", "Factory"), ("timeOffset", "-3600000")];
    assert_eq!(hex(&describe::meta(&Stamp::of_a_body(0, 0, 0), &tags).unwrap()), hex(&meta));
}

#[test]
fn a_real_null_poses_segments_are_made_again_byte_for_byte() {
    let Some(real) = wire_file("mxtp13.bin") else { return };
    let mut payload = Payload(&real[24..]);
    let segments: Vec<(String, [f32; 3])> = (0..payload.word())
        .map(|_| {
            let length = payload.word() as usize;
            let (name, rest) = payload.0.split_at(length);
            payload.0 = rest;
            (String::from_utf8(name.into()).unwrap(), payload.floats())
        })
        .collect();
    let named: Vec<(&str, [f32; 3])> = segments.iter().map(|(name, at)| (name.as_str(), *at)).collect();
    let ours = describe::null_pose(&Stamp::of_a_body(9, 9, 0), &named, &[]).unwrap();
    assert_eq!(hex(&ours[0]), hex(&real));
}
