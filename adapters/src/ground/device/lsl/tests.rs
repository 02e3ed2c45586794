use super::*;
use crate::ground::frame::Wrench;
use crate::ground::reading::Load;
use crate::ground::{GroundProtocol, GroundSettings};

const NS_PER_MS: u64 = 1_000_000;

fn opening(rate_hz: u32, units: [&str; 2]) -> Vec<u8> {
    let [force, moment] = units;
    let channels = format!(
        "<channels><channel><label>Mx</label><unit>{moment}</unit></channel><channel><label>Fz</label><unit>{force}</unit>\
         </channel></channels>"
    );
    let xml = format!(
        "<?xml version=\"1.0\"?><info><name>Plate</name><type>Force</type><channel_count>2</channel_count>\
         <channel_format>double64</channel_format><source_id>s</source_id><nominal_srate>{rate_hz}</nominal_srate>\
         <uid>u-1</uid><session_id>default</session_id><hostname>pc</hostname><v4data_port>16572</v4data_port>\
         <desc>{channels}</desc></info>"
    );
    let head = "\0LSL/110 200 OK\r\nUID: u-1\r\nByte-Order: 1234\r\nData-Protocol-Version: 110\r\n\r\n";
    let pattern = |first: f64| sample(Some(123_456.789), 16_777_217.0 + first, -16_777_218.0 - first);
    [xml.as_bytes(), head.as_bytes(), &pattern(4.0), &pattern(2.0)].concat()
}

fn sample(time_s: Option<f64>, mx: f64, fz: f64) -> Vec<u8> {
    let stamp = time_s.map_or(vec![1], |time_s| [&[2][..], &time_s.to_le_bytes()].concat());
    [stamp, mx.to_le_bytes().to_vec(), fz.to_le_bytes().to_vec()].concat()
}

fn stream(units: [Option<&str>; 2]) -> Lsl {
    let name = |name: &str| Some(name.to_owned());
    // By label, and by number.
    let plan = Plan::Direct { force: [None, None, name("fz")], moment: [name("1"), name("Mx"), None] };
    let [force_unit, moment_unit] = units.map(|unit| unit.map(str::to_owned));
    Lsl::new(LslSettings { plan, force_unit, moment_unit })
}

fn found(decoded: &Decoded) -> Vec<(u64, f64, f64)> {
    let one = |reading: &Reading| match (reading.tick, reading.load) {
        (Tick::Time(ns), Load::Part { wrench: Wrench { force_n, moment_nm }, .. }) => {
            (ns, force_n[2], moment_nm[0])
        }
        other => panic!("{other:?}"),
    };
    decoded.readings().map(one).collect()
}

#[test]
fn times_at_the_end_of_their_range_and_rates_that_are_none_are_borne() {
    assert_eq!(time_ns(None, Some(u64::MAX), 1), Some(u64::MAX));
    assert_eq!(time_ns(None, Some(u64::MAX - 1), u64::MAX), Some(u64::MAX));
    for rate in ["1e-300", "1e300"] {
        let opening =
            String::from_utf8_lossy(&opening(1000, ["kN", "Nmm"])).replace(">1000<", &format!(">{rate}<"));
        let mut lsl = stream([None; 2]);
        lsl.take(opening.as_bytes(), NS_PER_MS, &mut Decoded::default());
        assert!(
            lsl.diagnostic().is_some_and(|said| said.contains("which none has")),
            "{rate}: {:?}",
            lsl.diagnostic()
        );
    }
}

#[test]
fn samples_come_with_the_senders_time_and_in_si_units() {
    let mut lsl = stream([None; 2]);
    let mut decoded = Decoded::default();
    lsl.opened(0);
    let sent = [sample(Some(5.0), 10.0, 0.7), sample(None, 20.0, 0.8), sample(Some(5.002), 30.0, 0.9)];
    let bytes = [opening(1000, ["kN", "Nmm"]), sent.concat()].concat();
    let mut requests = Vec::new();
    for piece in bytes.chunks(11) {
        lsl.take(piece, NS_PER_MS, &mut decoded);
        if let Action::Send(request) = lsl.next_action(NS_PER_MS) {
            requests.push(String::from_utf8(request).unwrap());
        }
    }
    let want = [(5_000_000_000, 700.0, 0.01), (5_001_000_000, 800.0, 0.02), (5_002_000_000, 900.0, 0.03)];
    assert_eq!(found(&decoded), want);
    assert!(requests.len() == 1 && requests[0].starts_with("LSL:streamfeed/110 u-1\r\n"), "{requests:?}");
    assert_eq!((lsl.diagnostic(), lsl.next_action(2 * NS_PER_MS)), (None, Action::Nothing));
    assert_eq!(lsl.next_action(4000 * NS_PER_MS), Action::Nothing);
    assert!(lsl.diagnostic().unwrap().contains("sends nothing"));
    lsl.take(&sample(None, 0.0, 0.0), 4001 * NS_PER_MS, &mut decoded);
    assert_eq!(lsl.diagnostic(), None);
}

#[test]
fn stamps_that_overlap_stay_in_order_and_a_clock_that_was_set_is_another_session() {
    let mut protocol = GroundProtocol::new(Box::new(stream([None; 2])), GroundSettings::default());
    let mut samples = Vec::new();
    let stamps = [Some(5.0), None, None, Some(5.001), Some(5.003), Some(0.5), None];
    let sent: Vec<u8> = stamps.iter().flat_map(|stamp| sample(*stamp, 0.0, 1.0)).collect();
    protocol.receive(&[opening(1000, ["N", "Nm"]), sent].concat(), NS_PER_MS, &mut samples);
    let sessions: Vec<u32> = samples.iter().map(|sample| sample.session).collect();
    assert_eq!(sessions, [0, 0, 0, 0, 0, 1, 1]);
    // Invalid times are refused.
    for stamp in [f64::NAN, -1.0, f64::INFINITY, 0.0] {
        protocol.receive(&sample(Some(stamp), 0.0, 1.0), NS_PER_MS, &mut samples);
    }
    assert_eq!((samples.len(), protocol.counts().refused[GroundRefusal::Number.index()]), (7, 4));
    protocol.receive(&sample(None, 0.0, f64::NAN), NS_PER_MS, &mut samples);
    assert_eq!((samples.len(), protocol.counts().refused[GroundRefusal::NotFinite.index()]), (7, 1));
}

#[test]
fn a_unit_comes_from_the_stream_or_the_configuration_only() {
    for (announced, declared, want) in [
        (["", ""], [None; 2], Some("has no unit")),
        (["", "Nm"], [Some("kN"), None], None),
        (["V", "Nm"], [Some("N"), None], Some(r#"is in "V", which is no unit of force"#)),
        (["N", "N"], [None; 2], Some("no unit of moment")),
    ] {
        let mut lsl = stream(declared);
        let mut decoded = Decoded::default();
        lsl.take(&[opening(1000, announced), sample(Some(1.0), 0.0, 1.0)].concat(), 0, &mut decoded);
        match (want, lsl.next_action(0)) {
            (Some(want), Action::Reopen(why)) => {
                assert!(why.contains(want) && why.contains("ground.lsl.force_unit"), "{why}");
                assert_eq!((lsl.diagnostic(), decoded.readings().count()), (Some(why), 0));
            }
            (None, Action::Send(_)) => assert_eq!(found(&decoded), [(1_000_000_000, 1000.0, 0.0)]),
            other => panic!("{other:?}"),
        }
    }
    let plan = Plan::Direct { force: [None, None, Some("3".to_owned())], moment: [None, None, None] };
    let mut lsl = Lsl::new(LslSettings { plan, force_unit: None, moment_unit: None });
    lsl.take(&opening(1000, ["N", "Nm"]), 0, &mut Decoded::default());
    assert!(lsl.diagnostic().unwrap().contains("no channel 3 but 1 (Mx), 2 (Fz)"), "{:?}", lsl.diagnostic());
}

#[test]
fn a_broken_feed_is_opened_again() {
    let mut lsl = stream([None; 2]);
    let mut decoded = Decoded::default();
    lsl.take(&[opening(1000, ["N", "Nm"]), vec![7]].concat(), 0, &mut decoded);
    assert_eq!(decoded.refusals().collect::<Vec<_>>(), [GroundRefusal::Garbage]);
    assert!(matches!(lsl.next_action(0), Action::Reopen(why) if why.contains("0x07")));
    lsl.opened(NS_PER_MS);
    lsl.take(
        &[opening(1000, ["N", "Nm"]), sample(Some(1.0), 0.0, 1.0)].concat(),
        2 * NS_PER_MS,
        &mut decoded,
    );
    assert_eq!((found(&decoded).len(), lsl.diagnostic()), (1, None));
}

proptest::proptest! {
    #[test]
    fn anything_may_come(
        pieces in proptest::collection::vec(proptest::collection::vec(proptest::num::u8::ANY, 0..200), 0..20), opened: bool,
    ) {
        let mut protocol = GroundProtocol::new(Box::new(stream([None; 2])), GroundSettings::default());
        let mut samples = Vec::new();
        if opened {
            protocol.receive(&opening(0, ["N", "Nm"]), 0, &mut samples);
        }
        for piece in &pieces {
            protocol.receive(piece, NS_PER_MS, &mut samples);
            protocol.next_action(NS_PER_MS);
        }
        proptest::prop_assert!(samples.iter().all(|sample| sample.force_n[2].is_finite()));
    }
}
