use super::*;
use crate::ground::frame::GroundFrame;
use crate::ground::protocol::GroundProtocol;
use crate::ground::receiver::GroundSettings;
use equipoise_core::message::GroundSample;

const SOUND: Record =
    Record { rdt_sequence: 1, ft_sequence: 10, status: 0, force_counts: [0; 3], torque_counts: [0; 3] };

fn at(index: u32) -> Record {
    Record { rdt_sequence: index, ft_sequence: index.wrapping_mul(7), ..SOUND }
}

fn plate(settings: GroundSettings) -> GroundProtocol {
    GroundProtocol::new(Box::new(AtiRdt::new(RdtSettings::default())), settings)
}

/// Makes the device request a new stream, as after a silence.
fn request(protocol: &mut GroundProtocol) {
    assert!(matches!(protocol.next_action(u64::MAX), Action::Send(_)));
}

fn receive(receiver: &mut GroundProtocol, record: Record, arrival_ns: u64) -> Vec<GroundSample> {
    let mut samples = Vec::new();
    receiver.receive(&record.to_bytes(), arrival_ns, &mut samples);
    samples
}

#[test]
fn standing_on_the_sensor_pushes_the_person_up_where_the_feet_are() {
    // 700 N downwards on the sensor at 0.1 m along its x, on a plate rotated by 90° to the left at (1, 2, 0).
    let mut receiver = plate(GroundSettings {
        frame: GroundFrame {
            origin_m: [1.0, 2.0, -0.02],
            yaw_rad: core::f64::consts::FRAC_PI_2,
            surface_height_m: 0.05,
            ..GroundFrame::default()
        },
        ..GroundSettings::default()
    });
    let record = Record { force_counts: [0, 0, -700_000_000], torque_counts: [0, 70_000_000, 0], ..SOUND };
    let sample = receive(&mut receiver, record, 5)[0];
    assert_eq!(sample.force_n[2], 700.0);
    assert!((sample.surface_z_m - 0.03).abs() < 1e-12);
    let cop = sample.cop_m().unwrap();
    assert!((cop[0] - 1.0).abs() < 1e-9 && (cop[1] - 2.1).abs() < 1e-9, "{cop:?}");
    assert_eq!((sample.sample_time_ns, sample.sample_time_sigma_ns), (5, u64::MAX));
}

const XML: &str = "<netft><cfgcpf>2000000</cfgcpf><cfgcpt>500000</cfgcpt><scfgfu>N</scfgfu><scfgtu>N-m</scfgtu>\
    <comrdte>Enabled</comrdte><comrdtrate>1000</comrdtrate></netft>";

fn settings(counts_per_newton: Option<f64>, counts_per_newton_metre: Option<f64>) -> RdtSettings {
    RdtSettings { counts_per_newton, counts_per_newton_metre, ..RdtSettings::default() }
}

/// Result of 1 000 000 counts of force and torque with this page, or why there is none.
fn with_page(settings: RdtSettings, page: Result<&str, &str>) -> Result<[f64; 2], String> {
    let mut device = AtiRdt::new(settings);
    let mut decoded = Decoded::default();
    device.opened(0);
    device.take(&Page::to_bytes(page), 0, &mut decoded);
    let record = Record { force_counts: [1_000_000; 3], torque_counts: [1_000_000; 3], ..SOUND };
    device.take(&record.to_bytes(), 1, &mut decoded);
    let reading = decoded.readings().next().copied();
    match (reading.map(|reading| reading.load), device.diagnostic()) {
        (Some(Load::Wrench(wrench)), None) => Ok([wrench.force_n[2], wrench.moment_nm[2]]),
        (None, Some(why)) => Err(why),
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_page_gives_the_scale_of_counts_in_every_unit() {
    let nothing = settings(None, None);
    assert_eq!(with_page(nothing, Ok(XML)), Ok([0.5, 2.0]));
    assert_eq!(with_page(settings(Some(2e6), None), Ok(XML)), Ok([0.5, 2.0]));
    let pounds = XML.replace(">N<", ">lbf<").replace(">N-m<", ">lbf-in<");
    let [force_n, moment_nm] = with_page(nothing, Ok(&pounds)).unwrap();
    assert!((force_n - 0.5 * 4.448_221_615_260_5).abs() < 1e-12);
    assert!((moment_nm - 2.0 * 0.112_984_829_027_616_7).abs() < 1e-12);
}

#[test]
fn what_the_page_does_not_say_is_not_guessed() {
    let nothing = settings(None, None);
    let refused = |xml: &str| with_page(nothing, Ok(xml)).unwrap_err();
    assert!(refused(&XML.replace(">N<", ">oz<")).contains("an unsupported unit, \"oz\" (scfgfu"));
    assert!(refused(&XML.replace("scfgtu", "other")).contains("lacks cfgcpt or scfgtu"));
    assert!(
        refused(&XML.replace("Enabled", "Disabled"))
            .contains("RDT is switched off in the ATI device: on its web")
    );
    assert!(refused("<html>it works</html>").contains("is ground.address an ATI Net F/T or Axia?"));
    assert!(with_page(nothing, Err("not there")).unwrap_err().contains("are not both set"));
    assert_eq!(with_page(settings(None, Some(5e5)), Ok(&XML.replace("scfgtu", "other"))), Ok([0.5, 2.0]));
}

#[test]
fn counts_that_contradict_the_page_are_refused_and_without_a_page_they_are_taken() {
    let said = with_page(settings(Some(1e6), None), Ok(XML)).unwrap_err();
    let want = "ground.counts_per_newton = 1000000 contradicts the device: its settings page contains 2000000 (cfgcpf = 2000000 \
                per N); remove the key, or correct it";
    assert_eq!(said, want);
    assert!(
        with_page(settings(None, Some(1e6)), Ok(XML))
            .unwrap_err()
            .starts_with("ground.counts_per_newton_metre = 1000000")
    );
    assert_eq!(with_page(settings(Some(1e6), Some(1e6)), Err("not there")), Ok([1.0, 1.0]));
}

#[test]
fn the_source_of_each_setting_is_reported() {
    let mut device = AtiRdt::new(settings(Some(2e6), Some(5e5)));
    let mut decoded = Decoded::default();
    assert_eq!(device.note(), None);
    device.take(&Page::to_bytes(Ok(XML)), 0, &mut decoded);
    let note = device.note().unwrap();
    assert!(
        note.contains("2000000 counts per newton, 500000 per newton metre, and sends 1000 records a second"),
        "{note}"
    );
    device.opened(1);
    device.take(&Page::to_bytes(Err("connection refused")), 1, &mut decoded);
    assert!(device.note().unwrap().starts_with("connection refused; the configured scale is used"));
}

#[test]
fn a_device_whose_page_is_refused_is_stopped_and_its_page_read_again() {
    const S: u64 = 1_000_000_000;
    let mut device = AtiRdt::new(settings(Some(1e6), Some(1e6)));
    let mut decoded = Decoded::default();
    let stop = Action::Send(vec![0x12, 0x34, 0, 0, 0, 0, 0, 0]);
    device.opened(S);
    assert_eq!(
        device.next_action(S),
        Action::Send(vec![0x12, 0x34, 0, 2, 0, 0, 0, 0]),
        "counts are configured: it may start"
    );
    device.take(&Page::to_bytes(Ok(XML)), S, &mut decoded);
    assert_eq!(device.next_action(S), stop);
    assert_eq!(device.next_action(2 * S), Action::Nothing);
    device.take(&SOUND.to_bytes(), 2 * S, &mut decoded);
    assert_eq!(decoded.readings().count(), 0);
    assert_eq!(device.next_action(2 * S), stop, "it did not hear");
    assert!(
        matches!(device.next_action(6 * S), Action::Reopen(why) if Some(&why) == device.diagnostic().as_ref())
    );
    device.opened(7 * S);
    let agreed = XML.replace("2000000", "1000000").replace("500000", "1000000");
    device.take(&Page::to_bytes(Ok(&agreed)), 7 * S, &mut decoded);
    assert_eq!(device.diagnostic(), None);
    assert!(matches!(device.next_action(7 * S), Action::Send(_)));
}

#[test]
fn a_device_that_was_restarted_may_say_something_else() {
    let mut device = AtiRdt::new(settings(None, None));
    let mut decoded = Decoded::default();
    device.take(&Page::to_bytes(Ok(XML)), 0, &mut decoded);
    let counted = |count: u32| Record { ft_sequence: count, ..SOUND }.to_bytes();
    for count in [50_000, 50_007, 49_990] {
        device.take(&counted(count), 1, &mut decoded);
    }
    assert!(!matches!(device.next_action(2), Action::Reopen(_)), "records overtake each other");
    device.take(&counted(3), 3, &mut decoded);
    assert!(matches!(device.next_action(4), Action::Reopen(_)));
}

#[test]
fn loss_repetition_and_disorder_are_counted_over_the_wrap() {
    let mut receiver = plate(GroundSettings::default());
    let sent = [u32::MAX - 1, u32::MAX, u32::MAX, 2, 0, 3];
    let decoded: Vec<usize> =
        sent.iter().map(|&index| receive(&mut receiver, at(index), 1000).len()).collect();
    assert_eq!(decoded, [1, 1, 0, 1, 0, 1]);
    let counts = receiver.counts();
    assert_eq!((counts.received, counts.published, counts.lost), (6, 4, 2));
    assert_eq!(counts.refused[GroundRefusal::Duplicate.index()], 1);
    assert_eq!(counts.refused[GroundRefusal::OutOfOrder.index()], 1);
}

#[test]
fn a_faulty_sample_is_flagged_and_a_cut_off_one_dropped() {
    let mut receiver = plate(GroundSettings::default());
    let sample = receive(&mut receiver, Record { status: 0x8000_0000, ..SOUND }, 1)[0];
    assert_eq!(sample.device_status, 0x8000_0000);
    assert_eq!(receiver.counts().refused[GroundRefusal::DeviceStatus.index()], 1);
    receiver.receive(&SOUND.to_bytes()[..35], 2, &mut Vec::new());
    assert_eq!(receiver.counts().refused[GroundRefusal::Length.index()], 1);
}

#[test]
fn the_records_of_one_datagram_are_stamped_apart() {
    let mut receiver = plate(GroundSettings::default());
    let mut samples = Vec::new();
    for batch in 0..100u32 {
        let bytes: Vec<u8> = (0..10).flat_map(|index| at(batch * 10 + index).to_bytes()).collect();
        samples.clear();
        receiver.receive(&bytes, 1_000_000_000 + u64::from(batch) * 10_000_000, &mut samples);
    }
    for pair in samples.windows(2) {
        let step = pair[1].sample_time_ns - pair[0].sample_time_ns;
        assert!(step.abs_diff(1_000_000) < 1000, "{step}");
    }
}

#[test]
fn a_device_that_restarts_is_a_new_session_and_a_new_request_is_not() {
    let mut receiver = plate(GroundSettings::default());
    receive(&mut receiver, Record { rdt_sequence: 900_000, ft_sequence: 5000, ..SOUND }, 1);
    request(&mut receiver);
    let again = receive(&mut receiver, Record { rdt_sequence: 1, ft_sequence: 6000, ..SOUND }, 2);
    assert_eq!(again[0].session, 0);
    request(&mut receiver);
    let rebooted = receive(&mut receiver, Record { rdt_sequence: 1, ft_sequence: 3, ..SOUND }, 3);
    assert_eq!(rebooted[0].session, 1);
}

#[test]
fn a_constant_latency_is_taken_off_every_sample_time_and_off_nothing_else() {
    const LATENCY_NS: u64 = 12_500_000;
    let mut plain = plate(GroundSettings::default());
    let mut late = plate(GroundSettings { latency_ns: LATENCY_NS, ..GroundSettings::default() });
    for index in 0..100 {
        let arrival_ns = 1_000_000_000 + u64::from(index) * 1_000_000;
        let expected = receive(&mut plain, at(index), arrival_ns)[0];
        let mut late_sample = receive(&mut late, at(index), arrival_ns)[0];
        assert_eq!(late_sample.sample_time_ns, expected.sample_time_ns - LATENCY_NS);
        late_sample.sample_time_ns += LATENCY_NS;
        assert_eq!(late_sample, expected);
    }
}
