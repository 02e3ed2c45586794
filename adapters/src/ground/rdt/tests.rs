use super::*;

const SOUND: Record =
    Record { rdt_sequence: 1, ft_sequence: 10, status: 0, force_counts: [0; 3], torque_counts: [0; 3] };

fn at(index: u32) -> Record {
    Record { rdt_sequence: index, ft_sequence: index.wrapping_mul(7), ..SOUND }
}

fn receive(receiver: &mut RdtReceiver, record: Record, arrival_ns: u64) -> Vec<GroundSample> {
    let mut samples = Vec::new();
    receiver.receive(&record.to_bytes(), arrival_ns, &mut samples);
    samples
}

#[test]
fn standing_on_the_sensor_pushes_the_person_up_where_the_feet_are() {
    // 700 N downwards on the sensor at 0.1 m to its x, seen by a plate turned a quarter to the left at (1, 2, 0).
    let mut receiver = RdtReceiver::new(RdtSettings {
        frame: GroundFrame {
            origin_m: [1.0, 2.0, -0.02],
            yaw_rad: core::f64::consts::FRAC_PI_2,
            surface_height_m: 0.05,
        },
        ..RdtSettings::default()
    });
    let record = Record { force_counts: [0, 0, -700_000_000], torque_counts: [0, 70_000_000, 0], ..SOUND };
    let sample = receive(&mut receiver, record, 5)[0];
    assert_eq!(sample.force_n[2], 700.0);
    assert!((sample.surface_z_m - 0.03).abs() < 1e-12);
    let cop = sample.cop_m().unwrap();
    assert!((cop[0] - 1.0).abs() < 1e-9 && (cop[1] - 2.1).abs() < 1e-9, "{cop:?}");
    assert_eq!((sample.sample_time_ns, sample.sample_time_sigma_ns), (5, u64::MAX));
}

#[test]
fn loss_repetition_and_disorder_are_counted_over_the_wrap() {
    let mut receiver = RdtReceiver::new(RdtSettings::default());
    let sent = [u32::MAX - 1, u32::MAX, u32::MAX, 2, 0, 3];
    let taken: Vec<usize> = sent.iter().map(|&index| receive(&mut receiver, at(index), 1000).len()).collect();
    assert_eq!(taken, [1, 1, 0, 1, 0, 1]);
    let counts = receiver.counts();
    assert_eq!((counts.received, counts.published, counts.lost), (6, 4, 2));
    assert_eq!(counts.refused[RdtRefusal::Duplicate.index()], 1);
    assert_eq!(counts.refused[RdtRefusal::OutOfOrder.index()], 1);
}

#[test]
fn a_faulty_sample_is_flagged_and_a_cut_off_one_dropped() {
    let mut receiver = RdtReceiver::new(RdtSettings::default());
    let sample = receive(&mut receiver, Record { status: 0x8000_0000, ..SOUND }, 1)[0];
    assert_eq!(sample.device_status, 0x8000_0000);
    assert_eq!(receiver.counts().refused[RdtRefusal::DeviceStatus.index()], 1);
    receiver.receive(&SOUND.to_bytes()[..35], 2, &mut Vec::new());
    assert_eq!(receiver.counts().refused[RdtRefusal::Length.index()], 1);
}

#[test]
fn the_records_of_one_datagram_are_stamped_apart() {
    let mut receiver = RdtReceiver::new(RdtSettings::default());
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
    let mut receiver = RdtReceiver::new(RdtSettings::default());
    receive(&mut receiver, Record { rdt_sequence: 900_000, ft_sequence: 5000, ..SOUND }, 1);
    receiver.stream_restarted();
    let again = receive(&mut receiver, Record { rdt_sequence: 1, ft_sequence: 6000, ..SOUND }, 2);
    assert_eq!(again[0].session, 0);
    receiver.stream_restarted();
    let rebooted = receive(&mut receiver, Record { rdt_sequence: 1, ft_sequence: 3, ..SOUND }, 3);
    assert_eq!(rebooted[0].session, 1);
}

#[test]
fn a_constant_latency_is_taken_off_every_sample_time_and_off_nothing_else() {
    const LATENCY_NS: u64 = 12_500_000;
    let mut plain = RdtReceiver::new(RdtSettings::default());
    let mut late = RdtReceiver::new(RdtSettings { latency_ns: LATENCY_NS, ..RdtSettings::default() });
    for index in 0..100 {
        let arrival_ns = 1_000_000_000 + u64::from(index) * 1_000_000;
        let expected = receive(&mut plain, at(index), arrival_ns)[0];
        let mut told = receive(&mut late, at(index), arrival_ns)[0];
        assert_eq!(told.sample_time_ns, expected.sample_time_ns - LATENCY_NS);
        told.sample_time_ns += LATENCY_NS;
        assert_eq!(told, expected);
    }
}
