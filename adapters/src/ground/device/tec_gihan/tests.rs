use super::*;
use crate::ground::{GroundProtocol, GroundSettings, Measures, SensorAxes};

const NS_PER_MS: u64 = 1_000_000;

/// Simulated controller with two plates of serial numbers 106 and 107, written from the protocol document.
#[derive(Default)]
struct Controller {
    received: Vec<String>,
    asleep: bool,
    measuring: bool,
    blocks: u32,
}

impl Controller {
    fn receive(&mut self, bytes: &[u8]) -> Vec<u8> {
        let line = String::from_utf8(bytes.to_vec()).unwrap().trim_end_matches('\n').to_owned();
        assert_eq!(bytes.last(), Some(&b'\n'));
        self.received.push(line.clone());
        let text = match line.as_str() {
            "STATE" if self.asleep => "SLEEP\n",
            "STATE" => "IDLE\n",
            "WAKE" => {
                self.asleep = false;
                ""
            }
            "SPS_1K" => "SPS_OK\n",
            "FPCOUNT" => "FPCOUNT_2\n",
            "FPSERIAL_1" => "FPSERIAL_1_107\n",
            "FP_0107_GET_AZ0" => "AZ0_-0.037\n",
            "FP_0107_GETFS" => {
                "FS_1500,1500,3000,300,300,200,3000,3000,6000,600,600,400,5000,5000,10000,1000,1000,600\n"
            }
            "STOP" => {
                self.measuring = false;
                ""
            }
            "START" => {
                self.measuring = true;
                return self.block();
            }
            "DT" if self.measuring => return self.block(),
            _ => "",
        };
        text.as_bytes().to_vec()
    }

    /// Fz of each sample of plate 2 is its index from the start; plate 1 sends full-scale values.
    fn block(&mut self) -> Vec<u8> {
        let first = self.blocks * 100;
        let samples = (first..first + 100).map(|number| number as i16);
        self.blocks += 1;
        let loud = [i16::MAX; 600].to_vec();
        let quiet: Vec<i16> = samples.flat_map(|number| [0, 0, number, 0, 0, 0]).collect();
        [loud, quiet].concat().iter().flat_map(|count| count.to_le_bytes()).collect()
    }
}

fn plate() -> TecGihan {
    TecGihan::new(TecGihanSettings {
        plate: 2,
        rate: Rate::of_hz(1000).unwrap(),
        range: Range::Kn3,
        surface_height_m: 0.037,
    })
}

/// Exchanges data for `ms` milliseconds; the answers arrive in pieces, and `harm` may modify them.
fn talk(
    protocol: &mut GroundProtocol,
    controller: &mut Controller,
    ms: core::ops::Range<u64>,
    harm: fn(u32, &mut Vec<u8>),
) -> Vec<f64> {
    let (mut samples, mut under_way) = (Vec::new(), Vec::new());
    for ms in ms {
        while let Action::Send(bytes) = protocol.next_action(ms * NS_PER_MS) {
            let mut answer = controller.receive(&bytes);
            harm(controller.blocks, &mut answer);
            // A block takes its duration before it is sent.
            under_way.push((if answer.len() > 1000 { ms + 99 } else { ms }, answer));
        }
        for (_, answer) in under_way.extract_if(.., |(due_ms, _)| *due_ms <= ms) {
            for piece in answer.chunks(1000) {
                protocol.receive(piece, ms * NS_PER_MS, &mut samples);
            }
        }
    }
    // One count of vertical force is 0.1 N.
    samples.iter().map(|sample| (sample.force_n[2] * 10.0).round()).collect()
}

fn protocol() -> GroundProtocol {
    let mut settings = GroundSettings { measures: Measures::Action, ..GroundSettings::default() };
    settings.frame.axes = SensorAxes::ZDown;
    let mut protocol = GroundProtocol::new(Box::new(plate()), settings);
    protocol.opened(0);
    protocol
}

#[test]
fn the_dialogue_is_the_makers_and_each_block_is_asked_for() {
    let (mut protocol, mut controller) = (protocol(), Controller::default());
    let forces = talk(&mut protocol, &mut controller, 0..1500, |_, _| {});
    let want = [
        "STOP",
        "STATE",
        "SPS_1K",
        "RANGE_3kN",
        "FPCOUNT",
        "FPSERIAL_1",
        "FP_0107_GET_AZ0",
        "FP_0107_GETFS",
        "START",
        "DT",
    ];
    assert_eq!(controller.received[..want.len()], want);
    assert!(controller.received[want.len()..].iter().all(|line| line == "DT"));
    assert!(forces.len() > 500);
    for (index, force) in forces.iter().enumerate() {
        assert_eq!(*force, index as f64);
    }
    assert_eq!(
        (protocol.block_latency_ns(), protocol.counts().lost, protocol.diagnostic()),
        (100 * NS_PER_MS, 0, None)
    );
    assert_eq!(protocol.close_command(), Some(b"STOP\n".to_vec()));
}

#[test]
fn a_sleeping_controller_is_woken() {
    let (mut protocol, mut controller) = (protocol(), Controller { asleep: true, ..Controller::default() });
    let forces = talk(&mut protocol, &mut controller, 0..2000, |_, _| {});
    assert!(controller.received.contains(&"WAKE".to_owned()) && !forces.is_empty());
}

#[test]
fn a_short_or_noisy_block_is_detected_and_restarted() {
    for harm in [
        (|blocks, answer: &mut Vec<u8>| {
            if blocks == 3 && answer.len() > 100 {
                answer.pop();
            }
        }) as fn(u32, &mut Vec<u8>),
        |blocks, answer| {
            if blocks == 3 && answer.len() > 100 {
                answer.push(0);
            }
        },
    ] {
        let (mut protocol, mut controller) = (protocol(), Controller::default());
        let forces = talk(&mut protocol, &mut controller, 0..4000, harm);
        assert_eq!(
            controller.received.iter().filter(|line| *line == "START").count(),
            2,
            "{:?}",
            protocol.diagnostic()
        );
        // Blocks 0 and 1 are valid, 2 is lost, and no number of it is used in another place.
        assert_eq!((forces[199], forces[200]), (199.0, 300.0));
        let counts = protocol.counts();
        assert_eq!((counts.lost, counts.refused[GroundRefusal::Incomplete.index()]), (100, 1));
        assert_eq!(protocol.diagnostic(), None, "all is well again");
    }
}

#[test]
fn silence_and_wrong_answers_are_said() {
    let mut device = plate();
    let (mut now, mut asked) = (0, 0);
    let why = loop {
        now += 10 * NS_PER_MS;
        match device.next_action(now) {
            Action::Reopen(why) => break why,
            Action::Send(bytes) => {
                asked += u32::from(bytes == b"STATE\n");
                device.take(b"\xff\xfe?\n", now, &mut Decoded::default());
            }
            _ => {}
        }
    };
    assert_eq!(asked, 3);
    assert!(why.contains("does not answer STATE") && why.contains("ground.serial.port"), "{why}");
    assert_eq!(device.diagnostic(), Some(why));

    let mut decoded = Decoded::default();
    let mut device = plate();
    while !matches!(device.next_action(now), Action::Send(bytes) if bytes == b"STATE\n") {
        now += 10 * NS_PER_MS;
    }
    device.take(&[b'a'; 10_000], now, &mut decoded);
    device.take(b"\nERR_2\n", now, &mut decoded);
    assert_eq!(decoded.refusals().collect::<Vec<_>>(), [GroundRefusal::TooLong]);
    let Action::Reopen(why) = device.next_action(now) else { panic!() };
    assert!(why.contains("error of its own"), "{why}");
}

#[test]
fn a_surface_the_plate_knows_better_is_said() {
    let mut device = TecGihan::new(TecGihanSettings { surface_height_m: 0.0, ..plate().settings });
    let mut controller = Controller::default();
    for ms in 0..1000 {
        while let Action::Send(bytes) = device.next_action(ms * NS_PER_MS) {
            let answer = controller.receive(&bytes);
            device.take(&answer, ms * NS_PER_MS, &mut Decoded::default());
            if device.diagnostic().is_some() {
                break;
            }
        }
    }
    let why = device.diagnostic().unwrap();
    assert!(why.contains("set ground.frame.surface_height_m to 0.0370"), "{why}");
}

proptest::proptest! {
    #[test]
    fn anything_may_come_at_any_time(pieces in proptest::collection::vec(proptest::collection::vec(proptest::num::u8::ANY, 0..300), 0..60)) {
        let mut protocol = protocol();
        let mut samples = Vec::new();
        for (index, piece) in pieces.iter().enumerate() {
            let now = index as u64 * 100 * NS_PER_MS;
            for _ in 0..8 {
                if protocol.next_action(now) == Action::Nothing { break; }
            }
            protocol.receive(piece, now, &mut samples);
        }
        proptest::prop_assert!(samples.is_empty());
    }
}
