use super::*;
use crate::ground::protocol::GroundProtocol;
use crate::ground::receiver::GroundSettings;
use crate::wire::amti::{STARTED_ONE, STARTED_TWO};

const NS_PER_MS: u64 = 1_000_000;

fn settings() -> AmtiSettings {
    let mut matrix = [[0.0; CHANNELS]; 6];
    for (row, factors) in matrix.iter_mut().enumerate() {
        factors[row] = 1.0;
        factors[row + 6] = 0.5;
    }
    AmtiSettings { rate: Rate::Hz200, matrix, force_unit_n: 1.0, moment_unit_nm: 1.0 }
}

/// Simulated plate that follows the protocol, with a simulated clock.
struct Bench {
    device: Amti,
    decoded: Decoded,
    now_ns: u64,
    line_baud: u32,
    /// Line speed of the plate.
    plate_baud: u32,
    /// Bytes received at the plate's own speed.
    received: Vec<u8>,
    deaf: bool,
    started: u8,
}

impl Bench {
    fn new(settings: AmtiSettings) -> Bench {
        let mut bench = Bench {
            device: Amti::new(settings),
            decoded: Decoded::default(),
            now_ns: 1_000 * NS_PER_MS,
            line_baud: SPEED_SLOW,
            plate_baud: SPEED_SLOW,
            received: Vec::new(),
            deaf: false,
            started: STARTED_ONE,
        };
        bench.device.opened(bench.now_ns);
        bench
    }

    fn say(&mut self, bytes: &[u8]) {
        if self.line_baud == self.plate_baud {
            self.device.take(bytes, self.now_ns, &mut self.decoded);
        }
    }

    fn plate_hears(&mut self, command: u8) {
        self.received.push(command);
        match command {
            0x72 => self.say(&[0x72]),
            0x66 | 0x76 => {
                self.say(&[command]);
                self.plate_baud = SPEED_FAST;
            }
            0x52 => self.plate_baud = SPEED_SLOW,
            0x51 => self.say(&[self.started]),
            _ => panic!("{command:#x} is no command"),
        }
    }

    /// Steps until the plate streams, with a bound.
    fn link(&mut self) {
        for _ in 0..1000 {
            if self.device.dialogue.is_streaming() {
                return;
            }
            self.run(20);
        }
        panic!("it never streams; received: {:x?}", self.received);
    }

    fn run(&mut self, ms: u64) {
        for _ in 0..ms / 20 {
            self.now_ns += 20 * NS_PER_MS;
            loop {
                match self.device.next_action(self.now_ns) {
                    Action::Nothing => break,
                    Action::Speed(baud) => self.line_baud = baud,
                    Action::Send(bytes) if self.line_baud == self.plate_baud && !self.deaf => {
                        bytes.into_iter().for_each(|byte| self.plate_hears(byte));
                    }
                    Action::Send(_) => {}
                    Action::Reopen(why) => panic!("{why}"),
                }
            }
        }
    }

    fn loads(&self) -> Vec<Wrench> {
        let load = |reading: &Reading| match reading.load {
            Load::Wrench(wrench) => wrench,
            Load::Part { .. } | Load::Insoles(_) => panic!("a plate of six channels feels all"),
        };
        self.decoded.readings().map(load).collect()
    }
}

fn frame(counts: [i16; CHANNELS]) -> [u8; FRAME_SIZE] {
    Frame { counts, trigger: false }.to_bytes()
}

#[test]
fn a_plate_is_stopped_set_to_its_rate_and_started_and_its_counts_become_forces() {
    let mut bench = Bench::new(AmtiSettings { force_unit_n: 4.0, moment_unit_nm: 0.5, ..settings() });
    bench.link();
    assert_eq!(bench.received, [0x52, 0x76, 0x51]);
    assert_eq!(bench.line_baud, SPEED_FAST);
    bench.say(&frame([1, 2, 3, 4, 5, 6, 10, 20, 30, 40, 50, 60]));
    let want = Wrench { force_n: [24.0, 48.0, 72.0], moment_nm: [12.0, 15.0, 18.0] };
    assert_eq!(bench.loads(), [want]);
    assert_eq!(bench.device.diagnostic(), None);
}

#[test]
fn a_plate_that_was_left_streaming_is_stopped_at_its_own_speed() {
    let mut bench = Bench::new(settings());
    bench.plate_baud = SPEED_FAST;
    bench.link();
    assert_eq!(bench.received, [0x52, 0x52, 0x76, 0x51]);
}

#[test]
fn a_plate_that_does_not_answer_is_named_and_asked_until_it_does() {
    let mut bench = Bench::new(settings());
    bench.deaf = true;
    bench.run(1500);
    assert_eq!(bench.device.diagnostic(), None, "linking may fail once");
    bench.run(3000);
    assert!(bench.device.diagnostic().unwrap().contains("does not answer to the command that sets its rate"));
    bench.deaf = false;
    bench.link();
    assert_eq!(bench.device.diagnostic(), None);
    bench.say(&frame([0; CHANNELS]));
    assert_eq!(bench.loads().len(), 1);
}

#[test]
fn two_plates_on_one_line_are_refused_with_what_to_do() {
    let mut bench = Bench::new(settings());
    bench.started = STARTED_TWO;
    bench.run(1000);
    assert!(bench.device.diagnostic().unwrap().contains("switch the adapter from A+B to A"));
    bench.say(&frame([0; CHANNELS]));
    assert!(bench.loads().is_empty());
    bench.started = STARTED_ONE;
    bench.link();
    assert_eq!(bench.device.diagnostic(), None);
}

#[test]
fn a_plate_that_falls_silent_is_brought_back() {
    let mut bench = Bench::new(settings());
    bench.link();
    bench.received.clear();
    bench.plate_baud = SPEED_SLOW;
    bench.run(540);
    bench.link();
    assert_eq!(bench.received, [0x52, 0x76, 0x51]);
}

#[test]
fn noise_costs_what_it_hit_and_is_counted() {
    let mut bench = Bench::new(settings());
    bench.link();
    let sound = frame([0; CHANNELS]);
    let mut hit = sound;
    hit[5] ^= 0xF0;
    // Valid, damaged, valid, five bytes of noise, valid, one byte short, valid.
    let pieces: [&[u8]; 7] = [&sound, &hit, &sound, &[0x55; 5], &sound, &sound[..23], &sound];
    for piece in pieces.concat().chunks(7) {
        bench.say(piece);
    }
    assert_eq!(bench.loads().len(), 4);
    assert_eq!(bench.decoded.refusals().collect::<Vec<_>>(), [GroundRefusal::Garbage; 3]);
}

#[test]
fn missing_samples_are_found_from_the_gap_in_time() {
    let mut protocol = GroundProtocol::new(Box::new(Amti::new(settings())), GroundSettings::default());
    let mut samples = Vec::new();
    let mut now_ns = 1_000 * NS_PER_MS;
    protocol.opened(now_ns);
    // Executes and answers every request at once.
    for _ in 0..100 {
        now_ns += 20 * NS_PER_MS;
        if let Action::Send(bytes) = protocol.next_action(now_ns) {
            let answer = if bytes == [0x51] { vec![STARTED_ONE] } else { bytes };
            protocol.receive(&answer, now_ns, &mut samples);
            if answer == [STARTED_ONE] {
                break;
            }
        }
    }
    let sound = frame([0; CHANNELS]);
    let mut feed = |protocol: &mut GroundProtocol, bytes: &[u8], after_ms: u64| {
        now_ns += after_ms * NS_PER_MS;
        protocol.receive(bytes, now_ns, &mut samples);
        protocol.counts().lost
    };
    assert_eq!(feed(&mut protocol, &sound, 5), 0);
    // One byte missing, then a few in excess: one frame is lost, then none.
    assert_eq!(feed(&mut protocol, &sound[1..], 5), 0);
    assert_eq!(feed(&mut protocol, &sound, 5), 1);
    assert_eq!(feed(&mut protocol, &[0x55; 3], 1), 1);
    assert_eq!(feed(&mut protocol, &sound, 5), 1);
    // A gap of 0.1 s, of which the line kept half a frame.
    assert_eq!(feed(&mut protocol, &sound[10..], 100), 1);
    assert_eq!(feed(&mut protocol, &sound, 5), 21);
}

#[test]
fn the_trigger_is_seen_and_is_no_fault() {
    let mut bench = Bench::new(settings());
    bench.link();
    bench.say(&Frame { counts: [0; CHANNELS], trigger: true }.to_bytes());
    bench.say(&frame([0; CHANNELS]));
    let seen: Vec<_> =
        bench.decoded.readings().map(|reading| (reading.device_counter, reading.status)).collect();
    assert_eq!(seen, [(1 | TRIGGER, 0), (2, 0)]);
}

#[test]
fn a_wrong_speed_is_named_and_asked_about_again() {
    let mut bench = Bench::new(settings());
    bench.link();
    bench.received.clear();
    for _ in 0..40 {
        bench.say(&[0xE6; FRAME_SIZE]);
    }
    assert!(
        bench.device.diagnostic().unwrap().contains("none of the last 512 make a frame of an AMTI plate")
    );
    bench.run(20);
    bench.link();
    assert_eq!(bench.received, [0x52, 0x52, 0x76, 0x51], "it is brought to its speed again");
    bench.say(&frame([0; CHANNELS]));
    assert_eq!(bench.device.diagnostic(), None);
}
