//! Plates and sensors on a line that is unplugged, truncated, noisy, silent or at a wrong speed, through the engine.

use super::plate::{FRAME, Plate};
use super::pty::Socket;
use equipoise_adapters::ground::device::amti::{Amti, AmtiSettings, Rate};
use equipoise_adapters::ground::device::bota::{Bota, BotaSettings};
use equipoise_adapters::ground::{GroundDevice, GroundRefusal, GroundSettings};
use equipoise_adapters::source::{Flow, GroundSource, LineSettings, SerialLine};
use equipoise_core::message::GroundSample;
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_secs(90);

fn open(socket: &Socket, baud: u32, device: impl GroundDevice + 'static) -> GroundSource {
    let settings = LineSettings { port: socket.port(), baud, flow: Flow::Free, key: "ground.serial.port" };
    GroundSource::open(Box::new(SerialLine::new(settings)), Box::new(device), GroundSettings::default())
        .unwrap()
}

fn amti(rate: Rate) -> Amti {
    let mut matrix = [[0.0; 12]; 6];
    for (row, factors) in matrix.iter_mut().enumerate() {
        factors[row] = -0.5;
    }
    Amti::new(AmtiSettings { rate, matrix, force_unit_n: 1.0, moment_unit_nm: 1.0 })
}

/// Receives until a condition is met.
fn until(
    source: &mut GroundSource,
    what: &str,
    mut so: impl FnMut(&GroundSource, &[GroundSample]) -> bool,
) -> Vec<GroundSample> {
    let begun = Instant::now();
    let mut samples = Vec::new();
    loop {
        source.receive(&mut samples).unwrap();
        if so(source, &samples) {
            return samples;
        }
        assert!(
            begun.elapsed() < PATIENCE,
            "waited in vain for {what}: {:?} {:?}",
            source.diagnostic(),
            source.counts()
        );
    }
}

fn said(source: &GroundSource, words: &str) -> bool {
    source.diagnostic().is_some_and(|diagnostic| diagnostic.contains(words))
}

#[test]
fn a_plate_is_started_at_its_speed_and_found_again_after_it_was_pulled_out() {
    let socket = Socket::new();
    // The port does not exist at the start.
    let mut source = open(&socket, 57_600, amti(Rate::Hz200));
    assert!(said(&source, "is not there"), "{:?}", source.diagnostic());
    for _ in 0..2 {
        let plate = Plate::plug(&socket, Box::new(|_| FRAME.to_vec()));
        let samples = until(&mut source, "samples", |_, samples| samples.len() > 50);
        assert_eq!(source.diagnostic(), None);
        // -0.5 per count; the force on the person has the opposite sign.
        assert_eq!(samples[7].force_n, [0.0, 5.0, 10.0]);
        // A busy machine may read so late that another session begins, with a clock of its own.
        let is_ordered = |pair: &[GroundSample]| {
            pair[0].session != pair[1].session || pair[0].sample_time_ns <= pair[1].sample_time_ns
        };
        assert!(samples.windows(2).all(is_ordered));
        assert!(plate.received().ends_with(&[0x52, 0x76, 0x51]), "{:x?}", plate.received());
        plate.unplug();
        until(&mut source, "the loss of the port", |source, _| said(source, "is not there"));
    }
}

#[test]
fn a_plate_is_stopped_when_its_reader_ends() {
    let socket = Socket::new();
    let mut source = open(&socket, 57_600, amti(Rate::Hz50));
    let plate = Plate::plug(&socket, Box::new(|_| FRAME.to_vec()));
    until(&mut source, "samples", |_, samples| samples.len() > 5);
    drop(source);
    let begun = Instant::now();
    while !plate.received().ends_with(&[0x51, 0x52]) {
        assert!(begun.elapsed() < PATIENCE, "{:x?}", plate.received());
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn frames_come_through_pieces_noise_and_damage() {
    let socket = Socket::new();
    let mut source = open(&socket, 57_600, amti(Rate::Hz100));
    let _plate = Plate::plug(
        &socket,
        Box::new(|number| match number % 10 {
            // Noise before a frame, a damaged one, a truncated one, two at once.
            3 => [&[0x00, 0xff, 0x13], FRAME.as_slice()].concat(),
            5 => [&FRAME[..9], &[0xee], &FRAME[10..]].concat(),
            7 => FRAME[..20].to_vec(),
            9 => [FRAME, FRAME].concat(),
            _ => FRAME.to_vec(),
        }),
    );
    let samples = until(&mut source, "samples", |_, samples| samples.len() > 200);
    assert!(samples.iter().all(|sample| sample.force_n == [0.0, 5.0, 10.0]), "what is damaged is not used");
    let counts = source.counts();
    let garbage = counts.refused[GroundRefusal::Garbage.index()];
    // Ten transmissions contain three that are damaged, with two frames lost, and one double frame: nine frames arrive.
    let tens = counts.published / 9;
    // The plate has no counter: the loss follows from the elapsed time, and a simulated plate that was not scheduled
    // for some time did lose samples.
    assert!(garbage.abs_diff(3 * tens) <= 3 && counts.lost + 2 >= 2 * tens, "{counts:?}");
    assert_eq!(source.diagnostic(), None);
}

const BOTA: [u8; 37] = [
    0xaa, 0x00, 0x00, 0x00, 0x00, 0xc0, 0x3f, 0x00, 0x00, 0x20, 0xc0, 0x00, 0x10, 0x2f, 0x44, 0xcd, 0xcc,
    0x4c, 0xbc, 0x96, 0x43, 0x0b, 0x3d, 0x00, 0x00, 0x00, 0x3f, 0x15, 0xcd, 0x5b, 0x07, 0x00, 0x00, 0xfa,
    0x41, 0x01, 0x81,
];

#[test]
fn a_sensor_at_another_speed_is_named_until_its_frames_come() {
    let socket = Socket::new();
    let device = socket.plug();
    let mut source = open(&socket, 115_200, Bota::new(BotaSettings { baud: 115_200, sinc: None }));
    until(&mut source, "word of the silence", |source, _| said(source, "nothing comes from the Bota sensor"));
    // A stream of frames received at a wrong speed: bytes without a valid frame.
    let noise: Vec<u8> = BOTA.iter().map(|byte| byte.rotate_left(3) ^ 0x5a).collect();
    until(&mut source, "word of the speed", |source, _| {
        device.say(&noise);
        said(source, "none of the last 740 make a frame of a Bota sensor")
    });
    assert!(said(&source, "It is 115200 baud, a Bota sensor usually has 460800"));
    device.say(&BOTA);
    let samples = until(&mut source, "a sample", |_, samples| !samples.is_empty());
    assert_eq!(samples[0].force_n, [-1.5, 2.5, -700.25]);
    assert_eq!((samples[0].device_counter, source.diagnostic()), (123_456_789, None));
}
