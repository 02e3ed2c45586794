use super::*;
use crate::ground::frame::Wrench;
use crate::ground::reading::Load;
use crate::ground::{GroundProtocol, GroundSettings};

const NS_PER_MS: u64 = 1_000_000;
const T0_NS: u64 = 1_700_000_000_000_000_000;

fn metadata(rate_hz: u32, units: &[&str]) -> Vec<u8> {
    let signals: Vec<String> = units
        .iter()
        .enumerate()
        .map(|(index, unit)| {
            let number = index + 1;
            format!(
                r#"{{"dataType":"FLOAT32","source":"Sensor-{number}","name":"Plate {number}","unit":"{unit}","offset":{}}}"#,
                4 * index
            )
        })
        .collect();
    let signals = signals.join(",");
    format!(
        r#"{{"result":0,"metadata":{{"signalProvider":{{"samplingRate":{rate_hz},"signals":[{signals}]}}}}}}"#
    )
    .into_bytes()
}

fn opening(rate_hz: u32, units: &[&str]) -> Vec<u8> {
    [metadata(rate_hz, units), b"\n".to_vec()].concat()
}

fn head(kind: u16, size: usize, sequence: u32) -> Vec<u8> {
    let subtype = kind;
    [
        &1_u16.to_le_bytes()[..],
        &kind.to_le_bytes(),
        &(size as u32).to_le_bytes(),
        &sequence.to_le_bytes(),
        &1_u16.to_le_bytes(),
        &subtype.to_le_bytes(),
    ]
    .concat()
}

fn data(sequence: u32, time_ns: u64, numbers: &[f32]) -> Vec<u8> {
    let mut bytes = head(1, 28 + 4 * numbers.len(), sequence);
    bytes.extend((time_ns / 1_000_000_000).to_le_bytes());
    bytes.extend(((time_ns % 1_000_000_000) as u32).to_le_bytes());
    bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    bytes
}

fn event(sequence: u32, code: u16) -> Vec<u8> {
    [head(0, 20, sequence), vec![2, 0], code.to_le_bytes().to_vec()].concat()
}

fn direct(names: [&str; 2], decimate: Option<u32>) -> LabAmp {
    let [fz, mx] = names.map(|name| Some(name.to_owned()));
    let plan = Plan::Direct { force: [None, None, fz], moment: [mx.clone(), mx, None] };
    LabAmp::new(LabAmpSettings { plan, decimate })
}

fn vertical(decoded: &Decoded) -> Vec<(u64, f64)> {
    let one = |reading: &Reading| match (reading.tick, reading.load) {
        (Tick::Time(ns), Load::Wrench(wrench) | Load::Part { wrench, .. }) => (ns - T0_NS, wrench.force_n[2]),
        other => panic!("{other:?}"),
    };
    decoded.readings().map(one).collect()
}

#[test]
fn scans_become_means_with_the_time_of_their_middle() {
    let mut amp = direct(["Sensor-2", "plate 1"], Some(4));
    let mut decoded = Decoded::default();
    amp.opened(0);
    // 1 kHz, frames of three scans, means of four: a mean may span frames.
    let frame = |index: u32| {
        let first = index * 3;
        let numbers: Vec<f32> = (first..first + 3).flat_map(|scan| [0.5, scan as f32]).collect();
        data(index, T0_NS + u64::from(first) * NS_PER_MS, &numbers)
    };
    let bytes = [opening(1000, &["Nm", "kN"]), frame(0), frame(1), frame(2), frame(3)].concat();
    for piece in bytes.chunks(7) {
        amp.take(piece, NS_PER_MS, &mut decoded);
    }
    assert_eq!(vertical(&decoded), [(1_500_000, 1500.0), (5_500_000, 5500.0), (9_500_000, 9500.0)]);
    let Load::Part { wrench: Wrench { moment_nm, .. }, .. } = decoded.readings().next().unwrap().load else {
        panic!()
    };
    assert_eq!(moment_nm, [0.5, 0.5, 0.0]);
    assert_eq!(decoded.block_latency_ns, Some(3 * NS_PER_MS));
    assert_eq!(
        (decoded.refusals().count(), amp.diagnostic(), amp.next_action(2 * NS_PER_MS)),
        (0, None, Action::Nothing)
    );
}

#[test]
fn by_default_about_a_thousand_readings_a_second_are_used() {
    let mut amp = direct(["Sensor-2", "Sensor-1"], None);
    let mut decoded = Decoded::default();
    amp.take(&opening(62_500, &["Nm", "N"]), 0, &mut decoded);
    amp.take(&data(0, T0_NS, &[0.0; 2 * 625]), 0, &mut decoded);
    assert_eq!(vertical(&decoded).len(), 625 / 63);
}

#[test]
fn eight_channels_follow_kistlers_formula() {
    let names = core::array::from_fn(|index| format!("Sensor-{}", index + 1));
    let plan = Plan::Eight { names, a_m: 0.12, b_m: 0.2 };
    let mut amp = LabAmp::new(LabAmpSettings { plan, decimate: Some(1) });
    let mut decoded = Decoded::default();
    amp.take(&opening(1000, &["N"; 8]), 0, &mut decoded);
    amp.take(&data(0, T0_NS, &[1.0, 2.0, 3.0, 4.0, 100.0, 200.0, 300.0, 400.0]), 0, &mut decoded);
    let Load::Wrench(Wrench { force_n, moment_nm }) = decoded.readings().next().unwrap().load else {
        panic!()
    };
    let near =
        |got: [f64; 3], want: [f64; 3]| got.iter().zip(want).all(|(got, want)| (got - want).abs() < 1e-9);
    assert!(near(force_n, [3.0, 7.0, 1000.0]), "{force_n:?}");
    let want = [
        0.2 * (300.0 - 700.0),
        0.12 * (-100.0 + 200.0 + 300.0 - 400.0),
        0.2 * (2.0 - 1.0) + 0.12 * (3.0 - 4.0),
    ];
    assert!(near(moment_nm, want), "{moment_nm:?} {want:?}");
}

#[test]
fn channels_that_are_not_there_or_in_no_unit_of_theirs_are_said_and_asked_for_again() {
    for (units, said) in [
        (&["Nm"][..], "no channel Sensor-2 but Sensor-1 (Plate 1)"),
        (&["Nm", "g"], r#"is in "g", which is no unit of force"#),
        (&["N", "N"], r#"is in "N", which is no unit of moment"#),
    ] {
        let mut amp = direct(["Sensor-2", "Sensor-1"], None);
        let mut decoded = Decoded::default();
        amp.take(&[opening(1000, units), data(0, T0_NS, &[1.0, 2.0])].concat(), 0, &mut decoded);
        let Action::Reopen(why) = amp.next_action(NS_PER_MS) else { panic!() };
        assert!(why.contains(said), "{why}");
        assert_eq!((amp.diagnostic(), decoded.readings().count()), (Some(why), 0));
        assert_eq!(decoded.refusals().collect::<Vec<_>>(), [GroundRefusal::UnknownKind]);
    }
    let mut amp = direct(["Sensor-2", "Sensor-1"], None);
    amp.take(b"{\"result\": 3}\n", 0, &mut Decoded::default());
    assert!(amp.diagnostic().unwrap().contains("result 3"));
    // Remaining bytes of an abandoned stream are not the first line of another.
    let good = [opening(1000, &["Nm", "N"]), data(0, T0_NS, &[1.0, 2.0])].concat();
    let mut decoded = Decoded::default();
    amp.take(&good, 0, &mut decoded);
    assert!(amp.diagnostic().is_some() && decoded.readings().count() == 0);
    assert!(matches!(amp.next_action(NS_PER_MS), Action::Reopen(_)));
    amp.opened(NS_PER_MS);
    amp.take(&good, NS_PER_MS, &mut decoded);
    assert_eq!((amp.diagnostic(), decoded.refusals().count()), (None, 1));
}

#[test]
fn events_are_counted_or_end_the_stream() {
    let mut protocol =
        GroundProtocol::new(Box::new(direct(["Sensor-2", "Sensor-1"], Some(1))), GroundSettings::default());
    let mut samples = Vec::new();
    protocol.opened(0);
    let frame = |sequence, ms: u64| data(sequence, T0_NS + ms * NS_PER_MS, &[0.0, 1.0, 0.0, 1.0]);
    protocol.receive(
        &[opening(1000, &["Nm", "N"]), frame(0, 0), event(1, 1), frame(2, 2)].concat(),
        0,
        &mut samples,
    );
    // Frames 3 and 4 are missing: four scans are lost.
    protocol.receive(&[frame(5, 8), event(6, 9)].concat(), 0, &mut samples);
    let counts = *protocol.counts();
    assert_eq!((samples.len(), counts.lost, counts.refused[GroundRefusal::Overrun.index()]), (6, 4, 1));
    assert_eq!(counts.refused[GroundRefusal::UnknownKind.index()], 1);
    // The clock is set one hour ahead: no loss, and the session continues.
    protocol.receive(&[event(7, 2), frame(8, 3_600_010)].concat(), 0, &mut samples);
    assert_eq!((protocol.counts().lost, samples.last().unwrap().session), (4, 0));
    assert_eq!(protocol.counts().refused[GroundRefusal::DeviceStatus.index()], 1);
    // A step back begins another session.
    protocol.receive(&frame(9, 20), 0, &mut samples);
    assert_eq!((protocol.counts().lost, samples.last().unwrap().session), (4, 1));
    for code in [0, 3, 4] {
        protocol.receive(&event(10 + u32::from(code), code), 0, &mut samples);
        assert!(matches!(protocol.next_action(0), Action::Reopen(_)), "{code}");
    }
    assert_eq!(protocol.next_action(0), Action::Nothing);
    assert!(matches!(protocol.next_action(4000 * NS_PER_MS), Action::Reopen(why) if why.contains("silent")));
}

#[test]
fn what_the_buffer_of_the_device_lost_is_lost_though_no_frame_is_missing() {
    let mut protocol =
        GroundProtocol::new(Box::new(direct(["Sensor-2", "Sensor-1"], Some(2))), GroundSettings::default());
    let mut samples = Vec::new();
    protocol.opened(0);
    let frame = |sequence, ms: u64| data(sequence, T0_NS + ms * NS_PER_MS, &[0.0, 1.0].repeat(4));
    let sent = [opening(1000, &["Nm", "N"]), frame(0, 0), event(1, 1), frame(2, 54), frame(3, 58)];
    protocol.receive(&sent.concat(), 0, &mut samples);
    assert_eq!(
        (samples.len(), protocol.counts().lost),
        (6, 25),
        "50 ms of 1000 scans a second, two a reading"
    );
    assert!(samples.iter().all(|sample| sample.session == 0));
}

#[test]
fn times_at_the_end_of_their_range_and_rates_that_are_none_are_borne() {
    for (rate_hz, decimate) in [(1, 1), (1, 100), (1000, 2)] {
        let mut amp = direct(["Sensor-2", "Sensor-1"], Some(decimate));
        let mut decoded = Decoded::default();
        let numbers = [0.0, 1.0].repeat(200);
        let sent = [opening(rate_hz, &["Nm", "N"]), data(0, 18_446_744_073_000_000_000, &numbers)];
        amp.take(&sent.concat(), 0, &mut decoded);
        assert_eq!(decoded.readings().count(), 200 / decimate as usize);
    }
    for rate in ["1e-300", "1e300"] {
        let mut amp = direct(["Sensor-2", "Sensor-1"], None);
        let opening = String::from_utf8(opening(1000, &["Nm", "N"])).unwrap();
        let opening = opening.replace("\"samplingRate\":1000", &format!("\"samplingRate\":{rate}"));
        amp.take(opening.as_bytes(), 0, &mut Decoded::default());
        assert!(
            amp.diagnostic().is_some_and(|said| said.contains("which none does")),
            "{rate}: {:?}",
            amp.diagnostic()
        );
    }
}

#[test]
fn frames_that_do_not_fit_are_reasons() {
    let mut amp = direct(["Sensor-2", "Sensor-1"], Some(1));
    let mut decoded = Decoded::default();
    amp.take(&opening(1000, &["Nm", "N"]), 0, &mut decoded);
    amp.take(&data(0, T0_NS, &[1.0; 3]), 0, &mut decoded);
    amp.take(&data(1, T0_NS, &[]), 0, &mut decoded);
    amp.take(&[2, 0, 1, 0, 16, 0, 0, 0], 0, &mut decoded);
    assert_eq!(
        decoded.refusals().collect::<Vec<_>>(),
        [GroundRefusal::Length, GroundRefusal::Length, GroundRefusal::Version]
    );
    assert!(matches!(amp.next_action(0), Action::Reopen(why) if why.contains("version 1")));
    let (mut amp, mut decoded) = (direct(["Sensor-2", "Sensor-1"], Some(1)), Decoded::default());
    amp.take(&[opening(1000, &["Nm", "N"]), b"HTTP/1.1".to_vec()].concat(), 0, &mut decoded);
    assert_eq!(decoded.refusals().collect::<Vec<_>>(), [GroundRefusal::Garbage]);
    assert!(matches!(amp.next_action(0), Action::Reopen(_)));
    // A field that is not a number is reported, too, and not permanently.
    let mut protocol =
        GroundProtocol::new(Box::new(direct(["Sensor-2", "Sensor-1"], Some(2))), GroundSettings::default());
    let mut samples = Vec::new();
    let numbers = [0.0, f32::NAN, 0.0, 1.0, 0.0, 1.0, 0.0, 3.0];
    protocol.receive(&[opening(1000, &["Nm", "N"]), data(0, T0_NS, &numbers)].concat(), 0, &mut samples);
    assert_eq!((samples.len(), protocol.counts().refused[GroundRefusal::NotFinite.index()]), (1, 1));
    assert_eq!(samples[0].force_n[2], -2.0);
}

proptest::proptest! {
    #[test]
    fn anything_may_come(
        pieces in proptest::collection::vec(proptest::collection::vec(proptest::num::u8::ANY, 0..100), 0..20),
        opened: bool,
    ) {
        let mut amp = direct(["Sensor-2", "Sensor-1"], None);
        let mut decoded = Decoded::default();
        if opened {
            amp.take(&opening(1000, &["Nm", "N"]), 0, &mut decoded);
        }
        for piece in &pieces {
            amp.take(piece, NS_PER_MS, &mut decoded);
            amp.next_action(NS_PER_MS);
        }
        proptest::prop_assert_eq!(decoded.readings().count(), 0);
    }
}
