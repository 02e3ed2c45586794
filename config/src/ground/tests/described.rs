//! Tests that a described device matches the built-in driver of the same device: equal bytes give equal samples and
//! equal refusals.

use equipoise_adapters::counts::Counts;
use equipoise_adapters::ground::device::amti::{Amti, AmtiSettings, Rate};
use equipoise_adapters::ground::device::ati_rdt::{AtiRdt, RdtSettings};
use equipoise_adapters::ground::device::bota::{Bota, BotaSettings};
use equipoise_adapters::ground::{Action, GroundDevice, GroundProtocol};
use equipoise_adapters::wire::amti::{CHANNELS, Command, Frame as AmtiFrame, STARTED_ONE};
use equipoise_adapters::wire::ati_rdt::Record;
use equipoise_adapters::wire::bota::{Frame as BotaFrame, SPEED};
use equipoise_core::message::GroundSample;

use super::*;

const NS_PER_MS: u64 = 1_000_000;

/// Deterministic pseudo-random numbers.
struct TestRandom(u64);

impl TestRandom {
    /// A number below `sides`.
    fn next(&mut self, sides: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % sides
    }

    fn bytes(&mut self, longest: u64) -> Vec<u8> {
        // Many bytes equal the first byte of a frame.
        (0..self.next(longest)).map(|_| if self.next(4) == 0 { 0xaa } else { self.next(256) as u8 }).collect()
    }
}

/// A described device and the built-in driver of the same device.
struct AdapterPair {
    protocols: [GroundProtocol; 2],
    samples: [Vec<GroundSample>; 2],
}

impl AdapterPair {
    fn new(example: &str, own: Box<dyn GroundDevice>) -> AdapterPair {
        let config = Config::parse(example, "c.toml").unwrap().ground;
        let described = config.device().unwrap().unwrap();
        let mut protocols = [described, own].map(|device| GroundProtocol::new(device, config.settings()));
        protocols.iter_mut().for_each(|protocol| protocol.opened(0));
        AdapterPair { protocols, samples: [Vec::new(), Vec::new()] }
    }

    fn receive(&mut self, bytes: &[u8], arrival_ns: u64) {
        for (protocol, samples) in self.protocols.iter_mut().zip(&mut self.samples) {
            protocol.receive(bytes, arrival_ns, samples);
        }
    }

    /// Asserts that both produced the same; returns the number of samples and the counters.
    fn agree(&self) -> (usize, Counts) {
        let [described, own] = &self.samples;
        for (described, own) in described.iter().zip(own) {
            assert_eq!(described, own);
        }
        assert_eq!(described.len(), own.len());
        assert_eq!(self.protocols[0].counts(), self.protocols[1].counts());
        (own.len(), *self.protocols[0].counts())
    }
}

/// A stream of frames with the faults of a serial line, split into pieces of any size.
fn serial_line(
    random: &mut TestRandom,
    pair: &mut AdapterPair,
    mut frame: impl FnMut(&mut TestRandom, u32) -> Vec<u8>,
) {
    let mut index = 0;
    let mut stream = Vec::new();
    for place in 0..120 {
        index += 1;
        let mut bytes = frame(random, index);
        // Begin with a few intact frames: losses are detected relative to earlier frames.
        match if place < 8 { 99 } else { random.next(14) } {
            0 => {
                let (at, bit) = (random.next(bytes.len() as u64) as usize, random.next(8));
                bytes[at] ^= 1 << bit;
            }
            1 => bytes.truncate(random.next(bytes.len() as u64) as usize),
            2 => bytes = [random.bytes(60), bytes].concat(),
            3 => index += 1 + random.next(3) as u32,
            4 => bytes = bytes.repeat(2),
            _ => {}
        }
        stream.extend(bytes);
    }
    let mut now_ns = 10_000 * NS_PER_MS;
    let mut rest = &stream[..];
    while !rest.is_empty() {
        let (piece, left) = rest.split_at((1 + random.next(90) as usize).min(rest.len()));
        now_ns += if random.next(200) == 0 { 700 * NS_PER_MS } else { 5 * NS_PER_MS };
        pair.receive(piece, now_ns);
        rest = left;
    }
}

#[test]
fn bota_described_is_bota() {
    let (mut samples, mut lost, mut damaged, mut garbage) = (0, 0, 0, 0);
    for seed in 0..60 {
        let own = Box::new(Bota::new(BotaSettings { baud: SPEED, sinc: None }));
        let (mut pair, mut random) = (AdapterPair::new(BOTA, own), TestRandom(seed));
        let begins_us = if seed % 3 == 0 { u32::MAX - 300_000 } else { 7_000_000 };
        serial_line(&mut random, &mut pair, |random, index| {
            let force_n = [1.5, -2.5, -(random.next(900_000) as f32) / 997.0];
            let status = if random.next(9) == 0 { random.next(16) as u16 } else { 0 };
            let timestamp_us = begins_us.wrapping_add(index * 10_000);
            BotaFrame { status, force_n, torque_nm: [0.1, -0.2, 0.3], timestamp_us, temperature_c: 30.0 }
                .to_bytes()
                .to_vec()
        });
        let (count, counts) = pair.agree();
        samples += count;
        lost += counts.lost;
        damaged += counts.refused[ground::GroundRefusal::Checksum.index()];
        garbage += counts.refused[ground::GroundRefusal::Garbage.index()];
    }
    assert!(
        samples > 4000 && lost > 500 && damaged > 100 && garbage > 50,
        "{samples} {lost} {damaged} {garbage}"
    );
}

#[test]
fn bota_described_reads_a_restarting_sensor_and_the_reference_frame() {
    let vector = "aa00000000c03f000020c000102f44cdcc4cbc96430b3d0000003f15cd5b070000fa410181";
    let mut pair = AdapterPair::new(BOTA, Box::new(Bota::new(BotaSettings { baud: SPEED, sinc: None })));
    pair.receive(&bytes_of(vector), 1000 * NS_PER_MS);
    let frame = |timestamp_us| BotaFrame {
        status: 0,
        force_n: [0.0; 3],
        torque_nm: [0.0; 3],
        timestamp_us,
        temperature_c: 0.0,
    };
    for (index, time) in [1000, 2000, 3000, 3000, 4000, 8000, 100, 1100].into_iter().enumerate() {
        pair.receive(&frame(time).to_bytes(), 1010 * NS_PER_MS + 10 * NS_PER_MS * index as u64);
    }
    let (samples, _) = pair.agree();
    assert_eq!(samples, 8);
    assert!((pair.samples[0][0].force_n[2] + 700.25).abs() < 1e-9);
    assert_eq!(pair.samples[0].last().unwrap().session, 2);
}

/// Starts streaming as the built-in driver requires; the described device is assumed to be streaming already.
fn start(plate: &mut GroundProtocol) {
    let mut now_ns = 0;
    while now_ns < 5000 * NS_PER_MS {
        now_ns += 20 * NS_PER_MS;
        let answer = match plate.next_action(now_ns) {
            Action::Send(message) if message == [Command::Rate50 as u8] => message,
            Action::Send(message) if message == [Command::Start as u8] => vec![STARTED_ONE],
            _ => continue,
        };
        let is_started = answer == [STARTED_ONE];
        plate.receive(&answer, now_ns, &mut Vec::new());
        if is_started {
            return;
        }
    }
    panic!("the plate was not started");
}

fn amti() -> AdapterPair {
    let config = Config::parse(AMTI, "c.toml").unwrap().ground;
    let Some(channels::ChannelsConfig::Matrix(sheet)) = &config.channels else { panic!("no matrix") };
    let settings = AmtiSettings {
        rate: Rate::Hz50,
        matrix: sheet.rows.each_ref().map(|row| row[..].try_into().unwrap()),
        force_unit_n: sheet.force.newtons(),
        moment_unit_nm: sheet.moment.newton_metres(),
    };
    let mut pair = AdapterPair::new(AMTI, Box::new(Amti::new(settings)));
    start(&mut pair.protocols[1]);
    pair
}

#[test]
fn amti_described_is_amti() {
    let (mut samples, mut lost, mut garbage, mut sessions) = (0, 0, 0, 0);
    for seed in 0..60 {
        let (mut pair, mut random) = (amti(), TestRandom(seed));
        serial_line(&mut random, &mut pair, |random, _| {
            let counts: [i16; CHANNELS] = core::array::from_fn(|_| random.next(4096) as i16 - 2048);
            AmtiFrame { counts, trigger: random.next(8) == 0 }.to_bytes().to_vec()
        });
        let (count, counts) = pair.agree();
        samples += count;
        lost += counts.lost;
        garbage += counts.refused[ground::GroundRefusal::Garbage.index()];
        sessions += pair.samples[0].last().map_or(0, |sample| sample.session);
    }
    assert!(
        samples > 5000 && lost > 200 && garbage > 200 && sessions > 5,
        "{samples} {lost} {garbage} {sessions}"
    );
}

#[test]
fn amti_described_reads_the_reference_frames() {
    let mut pair = amti();
    for (index, vector) in [
        "00080a1814281e38284832583c68467850885a9864a86eb8",
        "00f80a1814281e38284832583c68467850885a9864a86eb8",
    ]
    .into_iter()
    .enumerate()
    {
        pair.receive(&bytes_of(vector), 6000 * NS_PER_MS + 20 * NS_PER_MS * index as u64);
    }
    assert_eq!(pair.agree().0, 2);
    assert_eq!(pair.samples[0][1].device_counter >> 31, 1);
}

#[test]
fn rdt_described_is_rdt() {
    let (mut samples, mut lost, mut refused) = (0, 0, 0);
    for seed in 0..60 {
        let own = Box::new(AtiRdt::new(RdtSettings::default()));
        let (mut pair, mut random) = (AdapterPair::new(RDT, own), TestRandom(seed));
        let (mut sequence, mut measured) = (if seed % 4 == 0 { u32::MAX - 40 } else { 1 }, 5_000_000u32);
        let mut now_ns = 1000 * NS_PER_MS;
        for _ in 0..200 {
            now_ns += if random.next(60) == 0 { 900 * NS_PER_MS } else { 10 * NS_PER_MS };
            // A polled device that is polled again after a silence restarts its counter.
            let actions = pair.protocols.each_mut().map(|protocol| protocol.next_action(now_ns));
            assert_eq!(actions[0], actions[1]);
            if matches!(actions[0], Action::Send(_)) && random.next(2) == 0 {
                sequence = 1;
            }
            let mut datagram = Vec::new();
            for _ in 0..random.next(4) {
                let skipped = if random.next(9) == 0 { random.next(5) as u32 } else { 0 };
                sequence = sequence.wrapping_add(1 + skipped);
                measured = measured.wrapping_add(7 * (1 + skipped));
                let force = random.next(1_400_000_000) as i32 - 700_000_000;
                let status = if random.next(11) == 0 { 0x8000_0001 } else { 0 };
                let record = Record {
                    rdt_sequence: sequence,
                    ft_sequence: measured,
                    status,
                    force_counts: [1_500_000, -2_500_000, force],
                    torque_counts: [-12_500, 34_000, -1],
                };
                datagram.extend(record.to_bytes());
            }
            match random.next(15) {
                0 => datagram.truncate(random.next(80) as usize),
                1 => pair.receive(&datagram.clone(), now_ns),
                2 => datagram = random.bytes(80),
                _ => {}
            }
            pair.receive(&datagram, now_ns);
        }
        let (count, counts) = pair.agree();
        let close_commands = pair.protocols.each_mut().map(GroundProtocol::close_command);
        assert!(close_commands[0].is_some() && close_commands[0] == close_commands[1]);
        samples += count;
        lost += counts.lost;
        refused += counts.refused.iter().sum::<u64>();
    }
    assert!(samples > 8000 && lost > 1000 && refused > 1000, "{samples} {lost} {refused}");
}

#[test]
fn ten_readings_of_four_cells_in_a_datagram_are_ten_samples() {
    let config = Config::parse(SCANS, "c.toml").unwrap().ground;
    let mut protocol = GroundProtocol::new(config.device().unwrap().unwrap(), config.settings());
    let frame = |index: u16, plate: u8| {
        let mut inner = vec![0xa5, 0x5a, plate, 1];
        inner.extend(index.to_le_bytes());
        inner.extend([0; 4]);
        for reading in 0..10 {
            // The load moves from the first cell to the last; unloaded cells read below zero.
            for counts in [(10 - reading) * 100_000, -1, 0, reading * 100_000] {
                inner.extend(&i32::to_le_bytes(counts)[..3]);
            }
        }
        let sum =
            equipoise_adapters::wire::checksum::Checksum::named("CRC-16/CCITT-FALSE").unwrap().of(&inner);
        inner.extend((sum as u16).to_le_bytes());
        inner.extend([0; 12]);
        [&[0x6b, 0xb6, 9, 0, 144, 0][..], &inner].concat()
    };
    let mut samples = Vec::new();
    let mut damaged = frame(3, 1);
    damaged[40] ^= 8;
    for (place, datagram) in
        [frame(0xffff, 1), frame(0, 1), frame(1, 2), damaged, frame(4, 1)].iter().enumerate()
    {
        protocol.receive(datagram, 1000 * NS_PER_MS + 10 * NS_PER_MS * place as u64, &mut samples);
    }
    assert_eq!(samples.len(), 30);
    let counts = protocol.counts();
    assert_eq!(counts.lost, 30, "the other plate's, the damaged and the missing one");
    assert_eq!(counts.refused[ground::GroundRefusal::UnknownKind.index()], 1);
    assert_eq!(counts.refused[ground::GroundRefusal::Checksum.index()], 1);
    // 0.42 mN per count: 420 N minus the readings of the unloaded cells.
    let zero = -12.1 - 9.7 + 3.3 - 0.4;
    assert!((samples[0].force_n[2] - (420.0 - 0.00041 + zero)).abs() < 1e-9, "{}", samples[0].force_n[2]);
    assert!(samples[0].cop_m().unwrap()[0] > 0.2 && samples[9].cop_m().unwrap()[0] < -0.1);
    assert!(!samples[0].measures(equipoise_core::message::Component::Shear));
}

fn bytes_of(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}
