use super::*;
use crate::ground::protocol::GroundProtocol;
use crate::ground::receiver::GroundSettings;
use crate::wire::bota::SPEED;

const PERIOD_US: u32 = 10_000;

fn frame(timestamp_us: u32) -> Frame {
    Frame {
        status: 0,
        force_n: [1.0, 2.0, -700.0],
        torque_nm: [0.1, 0.2, 0.3],
        timestamp_us,
        temperature_c: 31.0,
    }
}

fn listening() -> Bota {
    Bota::new(BotaSettings { baud: SPEED, sinc: None })
}

fn protocol(device: Bota) -> GroundProtocol {
    let mut protocol = GroundProtocol::new(Box::new(device), GroundSettings::default());
    protocol.opened(0);
    protocol
}

fn at(index: u32) -> [u8; FRAME_SIZE] {
    frame(index.wrapping_mul(PERIOD_US)).to_bytes()
}

#[test]
fn a_frame_is_a_reading_with_the_sensors_own_time() {
    let (mut device, mut decoded) = (listening(), Decoded::default());
    device.opened(0);
    device.take(&frame(1234).to_bytes(), 5, &mut decoded);
    let reading = *decoded.readings().next().unwrap();
    let Load::Wrench(wrench) = reading.load else { panic!("{reading:?}") };
    assert_eq!(wrench.force_n, [1.0, 2.0, -700.0]);
    assert!((wrench.moment_nm[2] - 0.3).abs() < 1e-7);
    assert_eq!((reading.tick, reading.device_counter), (Tick::Counter(1234), 1234));
    assert_eq!(device.next_action(0), Action::Nothing, "it is only listened to");
}

#[test]
fn only_what_forbids_to_use_a_sample_is_its_status() {
    let (mut device, mut decoded) = (listening(), Decoded::default());
    for (index, bits) in
        [status::LATE, status::OVERRANGE, status::INVALID | 0xFF00, status::RAW].into_iter().enumerate()
    {
        let bytes = Frame { status: bits, ..frame(index as u32 * PERIOD_US) }.to_bytes();
        device.take(&bytes, 0, &mut decoded);
    }
    let statuses: Vec<u32> = decoded.readings().map(|reading| reading.status).collect();
    assert_eq!(statuses, [0, 2, 4, 8]);
    assert!(device.diagnostic().unwrap().contains("no forces: set it to calibrated values"));
    device.take(&at(4), 0, &mut decoded);
    assert_eq!(device.diagnostic(), None);
}

#[test]
fn damage_costs_its_frame_and_loss_shows_in_the_sensors_clock_over_its_wrap() {
    let mut protocol = protocol(listening());
    let start = u32::MAX / PERIOD_US - 8;
    let mut samples = Vec::new();
    let mut feed =
        |protocol: &mut GroundProtocol, bytes: &[u8]| protocol.receive(bytes, 1_000_000_000, &mut samples);
    for index in 0..8 {
        feed(&mut protocol, &at(start + index));
    }
    let mut damaged = at(start + 8);
    damaged[20] ^= 4;
    feed(&mut protocol, &damaged);
    // Three more frames after the wrap, of which one is missing and one is truncated.
    feed(&mut protocol, &frame(at_us(start, 9)).to_bytes());
    feed(&mut protocol, &frame(at_us(start, 11)).to_bytes());
    feed(&mut protocol, &frame(at_us(start, 12)).to_bytes()[..30]);
    feed(&mut protocol, &frame(at_us(start, 13)).to_bytes());
    let counts = *protocol.counts();
    assert_eq!((counts.published, counts.lost), (11, 3));
    assert_eq!(counts.refused[GroundRefusal::Checksum.index()], 2);
    assert_eq!(counts.refused[GroundRefusal::Garbage.index()], 0);
    assert!(samples.iter().all(|sample| sample.session == 0), "a clock that wraps was not restarted");
}

fn at_us(start: u32, index: u32) -> u32 {
    (start * PERIOD_US).wrapping_add(index * PERIOD_US)
}

#[test]
fn a_sensor_that_was_switched_off_and_on_is_a_new_session() {
    let mut protocol = protocol(listening());
    let mut samples = Vec::new();
    for index in [100, 101, 102, 0, 1, 2] {
        protocol.receive(&at(index), 1, &mut samples);
    }
    let sessions: Vec<u32> = samples.iter().map(|sample| sample.session).collect();
    assert_eq!(sessions, [0, 0, 0, 1, 1, 1]);
    assert_eq!(protocol.counts().lost, 0);
}

/// After more than 36 minutes, zero is ahead of the last clock value, modulo 2³².
#[test]
fn a_sensor_that_ran_for_long_and_was_switched_off_and_on_lost_nothing_anybody_could_count() {
    let mut protocol = protocol(listening());
    let mut samples = Vec::new();
    let start = 3_000_000_000 / PERIOD_US;
    for (place, index) in [start, start + 1, start + 2, start + 3, start + 4, 0, 1, 2].into_iter().enumerate()
    {
        let off_ns = if index < start { 5000 * NS_PER_MS } else { 0 };
        protocol.receive(&at(index), 1000 * NS_PER_MS + off_ns + place as u64 * 10 * NS_PER_MS, &mut samples);
    }
    let sessions: Vec<u32> = samples.iter().map(|sample| sample.session).collect();
    assert_eq!(sessions, [0, 0, 0, 0, 0, 1, 1, 1]);
    assert_eq!(protocol.counts().lost, 0);
}

#[test]
fn a_clock_that_stands_is_named_and_dates_nothing() {
    let mut protocol = protocol(listening());
    let mut samples = Vec::new();
    for _ in 0..=STANDS {
        protocol.receive(&at(7), 1, &mut samples);
    }
    assert_eq!(samples.len(), 1);
    assert!(protocol.diagnostic().unwrap().contains("clock of the Bota sensor stands still"));
}

#[test]
fn silence_and_a_wrong_speed_are_named_and_end_by_themselves() {
    let mut protocol = protocol(listening());
    let mut samples = Vec::new();
    assert_eq!(protocol.next_action(1000 * NS_PER_MS), Action::Nothing);
    assert_eq!(protocol.diagnostic(), None);
    protocol.next_action(2100 * NS_PER_MS);
    assert!(protocol.diagnostic().unwrap().contains("nothing comes from the Bota sensor"));
    protocol.receive(&[0x5A; 800], 2200 * NS_PER_MS, &mut samples);
    let said = protocol.diagnostic().unwrap();
    assert!(
        said.contains("none of the last 740 make a frame of a Bota sensor") && said.contains("460800"),
        "{said}"
    );
    protocol.receive(&at(1), 2300 * NS_PER_MS, &mut samples);
    assert_eq!((protocol.diagnostic(), samples.len()), (None, 1));
}

#[test]
fn a_sensor_is_set_up_among_its_frames_and_asked_again_from_the_start() {
    let mut protocol = protocol(Bota::new(BotaSettings { baud: SPEED, sinc: Some(256) }));
    let mut samples = Vec::new();
    let say = |said: &str| Action::Send(said.as_bytes().to_vec());
    assert_eq!(protocol.next_action(0), say("C"));
    assert_eq!(protocol.next_action(10 * NS_PER_MS), Action::Nothing);
    protocol.receive(&at(1), 20 * NS_PER_MS, &mut samples);
    protocol.receive(b"r,0,", 30 * NS_PER_MS, &mut samples);
    protocol.receive(b"C,0", 30 * NS_PER_MS, &mut samples);
    assert_eq!(protocol.next_action(40 * NS_PER_MS), say("c,0,1,0,4"));
    // Without an answer, the set-up restarts.
    assert_eq!(protocol.next_action(1100 * NS_PER_MS), say("C"));
    for (answer, next) in [("r,0,C,0", "c,0,1,0,4"), ("r,0,c,0", "f,256,0,0,1"), ("r,0,f,0", "R")] {
        protocol.receive(answer.as_bytes(), 1200 * NS_PER_MS, &mut samples);
        assert_eq!(protocol.next_action(1300 * NS_PER_MS), say(next));
    }
    assert!(samples.is_empty(), "frames of the old filter are not used");
    protocol.receive(&[b"r,0,R,0".as_slice(), &at(5)].concat(), 1400 * NS_PER_MS, &mut samples);
    assert_eq!(
        (samples.len(), protocol.next_action(1500 * NS_PER_MS), protocol.diagnostic()),
        (1, Action::Nothing, None)
    );
}

#[test]
fn a_sensor_that_does_not_answer_is_named() {
    let mut protocol = protocol(Bota::new(BotaSettings { baud: 115_200, sinc: Some(512) }));
    for second in 0..3 {
        assert!(matches!(protocol.next_action(second * 1100 * NS_PER_MS), Action::Send(_)));
    }
    let said = protocol.diagnostic().unwrap();
    assert!(
        said.contains("does not answer when it is to be set up") && said.contains("115200 baud"),
        "{said}"
    );
}
