//! Ground devices: stream readers are independent of the division into pieces; a dialogue with a device that does not
//! respond, corrupts data or sends nothing causes no panic and no invalid sample.

use std::collections::VecDeque;

use equipoise_adapters::ground::channels::{ForceUnit, MomentUnit};
use equipoise_adapters::ground::device::amti::{Amti, AmtiSettings, Rate as AmtiRate};
use equipoise_adapters::ground::device::bota::{Bota, BotaSettings};
use equipoise_adapters::ground::device::labamp::{LabAmp, LabAmpSettings};
use equipoise_adapters::ground::device::lsl::{Lsl, LslSettings};
use equipoise_adapters::ground::device::moticon::{Moticon, MoticonSettings, Sideways, all_fields};
use equipoise_adapters::ground::device::qtm::{Qtm, QtmSettings};
use equipoise_adapters::ground::device::tec_gihan::{TecGihan, TecGihanSettings};
use equipoise_adapters::ground::device::text::{Column, Framing, Numbered, Text, TextSettings};
use equipoise_adapters::ground::plan::Plan;
use equipoise_adapters::ground::{Action, Channels, GroundDevice, GroundProtocol, GroundSettings};
use equipoise_adapters::wire::text_line::{Decimal, Delimiter, LineForm, Unit};
use equipoise_adapters::wire::{amti, bota, labamp, lsl, tec_gihan};
use equipoise_simulator::wires;

use super::choices::Choices;
use super::ground::{assert_valid, datagrams, stream};

/// The simulated device: its answer to each received byte, and its next measurement.
struct SimulatedPeer<'a> {
    receive: Box<dyn FnMut(u8) -> Vec<u8> + 'a>,
    measure: Box<dyn FnMut() -> Vec<u8> + 'a>,
}

/// A dialogue in which the simulated device sends correct, corrupted, arbitrary or no data.
fn run_dialogue(device: Box<dyn GroundDevice>, mut peer: SimulatedPeer<'_>, bytes: &[u8]) {
    let mut protocol = GroundProtocol::new(device, GroundSettings::default());
    let mut choices = Choices::new(bytes);
    let (mut now_ns, mut samples, mut pending, mut steps) =
        (1_000_000_000_u64, Vec::new(), VecDeque::new(), 0);
    protocol.opened(now_ns);
    while !choices.is_empty() && steps < 3000 {
        steps += 1;
        now_ns += 3_000_000;
        for _ in 0..16 {
            match protocol.next_action(now_ns) {
                Action::Nothing => break,
                Action::Send(request) => pending.extend(request.into_iter().flat_map(&mut peer.receive)),
                Action::Reopen(_) => {
                    pending.clear();
                    protocol.opened(now_ns);
                }
                _ => {}
            }
        }
        let mut next = || {
            let answers: Vec<u8> = pending.drain(..).collect();
            if answers.is_empty() { (peer.measure)() } else { answers }
        };
        let bytes = match choices.byte() {
            0..=119 => next(),
            120..=179 => {
                let mut bytes = next();
                if !bytes.is_empty() {
                    let at = usize::from(choices.small()) % bytes.len();
                    bytes[at] = choices.byte();
                }
                bytes
            }
            180..=219 => {
                let length = usize::from(choices.byte());
                choices.take(length).to_vec()
            }
            long => {
                now_ns += u64::from(long - 219) * 50_000_000;
                Vec::new()
            }
        };
        protocol.receive(&bytes, now_ns, &mut samples);
        samples.drain(..).for_each(|sample| assert_valid(&sample));
        let _ = protocol.diagnostic();
    }
    let _ = protocol.close_command();
}

/// A plate with a matrix that gives finite loads for any counts.
fn amti_plate(choice: u8) -> Box<dyn GroundDevice> {
    let mut matrix = [[0.0; amti::CHANNELS]; 6];
    for (index, number) in matrix.iter_mut().flatten().enumerate() {
        *number = (index % 7) as f64 * 0.05 - 0.1;
    }
    let rate = [AmtiRate::Hz50, AmtiRate::Hz100, AmtiRate::Hz200][usize::from(choice % 3)];
    Box::new(Amti::new(AmtiSettings { rate, matrix, force_unit_n: 4.448, moment_unit_nm: 0.113 }))
}

/// AMTI's frames round-trip; its stream can be divided at any byte; its dialogue can fail at any step.
pub(crate) fn amti(bytes: &[u8]) {
    if let Some(first) = bytes.first_chunk::<{ amti::FRAME_SIZE }>()
        && let Some(frame) = amti::Frame::parse(first)
    {
        assert_eq!(frame.to_bytes(), *first);
    }
    stream(|| amti_plate(0), bytes);
    let mut dialogue = wires::amti::Dialogue::new(1);
    let (mut count, dialogue) = (0_i16, &mut dialogue);
    let dialogue = std::cell::RefCell::new(dialogue);
    let peer = SimulatedPeer {
        receive: Box::new(|byte| dialogue.borrow_mut().receive(byte).into_iter().collect()),
        measure: Box::new(|| {
            count = count.wrapping_add(1);
            let counts = core::array::from_fn(|index| (count + index as i16) % 2000);
            if dialogue.borrow().streaming { wires::amti::frame(counts, false).to_vec() } else { Vec::new() }
        }),
    };
    run_dialogue(amti_plate(bytes.first().copied().unwrap_or_default()), peer, bytes);
}

/// Bota's frames round-trip; its stream can be divided at any byte; its set-up can fail at any step.
pub(crate) fn bota(bytes: &[u8]) {
    if let Some(first) = bytes.first_chunk::<{ bota::FRAME_SIZE }>()
        && let Some(frame) = bota::Frame::parse(first)
    {
        assert_eq!(frame.to_bytes(), *first);
    }
    let sensor = |sinc| Box::new(Bota::new(BotaSettings { baud: 460_800, sinc })) as Box<dyn GroundDevice>;
    stream(|| sensor(None), bytes);
    let dialogue = std::cell::RefCell::new(wires::bota::Dialogue::new(512));
    let mut timestamp_us = 0_u32;
    let peer = SimulatedPeer {
        receive: Box::new(|byte| dialogue.borrow_mut().receive(byte).unwrap_or_default().into_bytes()),
        measure: Box::new(|| {
            timestamp_us = timestamp_us.wrapping_add(10_000);
            let frame =
                wires::bota::Frame { timestamp_us, wrench: [1.0; 6], ..wires::bota::Frame::default() };
            if dialogue.borrow().running { frame.to_bytes().to_vec() } else { Vec::new() }
        }),
    };
    run_dialogue(sensor(Some(256)), peer, bytes);
}

/// The names of a plate's six channels.
fn direct() -> Plan {
    Plan::Direct {
        force: ["Fx", "Fy", "Fz"].map(|name| Some(name.to_owned())),
        moment: ["Mx", "My", "Mz"].map(|name| Some(name.to_owned())),
    }
}

/// LabAmp's answers and stream.
pub(crate) fn labamp(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let _ = (labamp::talk::done(&text), labamp::talk::client(&text), labamp::talk::stream(&text));
    if let Ok(metadata) = labamp::talk::Metadata::parse(&text) {
        assert!(metadata.rate_hz.is_finite());
    }
    stream(|| Box::new(LabAmp::new(LabAmpSettings { plan: direct(), decimate: Some(2) })), bytes);
}

/// QTM's packets, divided at any byte, and a dialogue.
pub(crate) fn qtm(bytes: &[u8]) {
    let qtm_device = || Box::new(Qtm::new(QtmSettings { plate: 1, divisor: 1 })) as Box<dyn GroundDevice>;
    stream(qtm_device, bytes);
    let (mut received, mut frame) = (Vec::new(), 0_u32);
    let peer = SimulatedPeer {
        receive: Box::new(|byte| {
            received.push(byte);
            let Some((_, command)) = wires::qtm::take_packet(&mut received) else { return Vec::new() };
            let answer = if command.starts_with("Version") { "Version set to 1.25" } else { "OK" };
            wires::qtm::text_packet(wires::qtm::Kind::Command, answer)
        }),
        measure: Box::new(|| {
            frame += 1;
            let plate = wires::qtm::Plate { id: 1, force_number: frame as i32, forces: vec![[1.0; 9]; 3] };
            wires::qtm::data(i64::from(frame) * 10_000, frame, &[wires::qtm::force_component(&[plate])])
        }),
    };
    run_dialogue(qtm_device(), peer, bytes);
}

/// Lab Streaming Layer: descriptions, and a stream divided at any byte.
pub(crate) fn lsl(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    if let Ok(info) = lsl::StreamInfo::parse(&text) {
        assert!(info.rate_hz.is_finite() && info.channels.len() < 100_000);
        let _ = lsl::feed_request(&info);
    }
    let _ = lsl::short_info_answer(bytes, 7);
    let settings =
        LslSettings { plan: direct(), force_unit: Some("N".into()), moment_unit: Some("Nm".into()) };
    stream(|| Box::new(Lsl::new(settings.clone())), bytes);
}

/// Tec Gihan's dialogue and blocks.
pub(crate) fn tec_gihan(bytes: &[u8]) {
    let choice = bytes.first().copied().unwrap_or_default();
    let settings = TecGihanSettings {
        plate: 1 + u32::from(choice % 3),
        rate: tec_gihan::Rate::of_hz(if choice & 0x80 == 0 { 1000 } else { 240 }).unwrap(),
        range: tec_gihan::Range::Kn3,
        surface_height_m: 0.04,
    };
    let plates =
        vec![wires::tec_gihan::PlateInfo::new(106, 0.04), wires::tec_gihan::PlateInfo::new(107, 0.05)];
    let dialogue = std::cell::RefCell::new(wires::tec_gihan::Dialogue::new(plates));
    let peer = SimulatedPeer {
        receive: Box::new(|byte| dialogue.borrow_mut().receive(byte).unwrap_or_default().into_bytes()),
        measure: Box::new(|| {
            let mut dialogue = dialogue.borrow_mut();
            if dialogue.owed == 0 {
                return Vec::new();
            }
            dialogue.owed -= 1;
            let plate = vec![[100, -200, 3000, 4, 5, 6]; dialogue.samples_of_a_block()];
            wires::tec_gihan::block(&[plate.clone(), plate])
        }),
    };
    run_dialogue(Box::new(TecGihan::new(settings)), peer, bytes);
}

/// Moticon's datagrams.
pub(crate) fn moticon(bytes: &[u8]) {
    let settings = MoticonSettings {
        fields: all_fields(),
        length_m: 0.25,
        width_m: 0.09,
        x_to_tip: true,
        y: Sideways::Left,
        swapped: false,
        time: Unit::NanosecondInSeconds,
    };
    datagrams(|| Box::new(Moticon::new(&settings).unwrap()), bytes);
}

/// Lines of text in several formats, divided at any byte; the ninth byte selects the format.
pub(crate) fn text(bytes: &[u8]) {
    let choice = bytes.get(8).copied().unwrap_or_default();
    let delimiters = [Delimiter::Spaces, Delimiter::Tab, Delimiter::Comma, Delimiter::Semicolon];
    let delimiter = delimiters[usize::from(choice % 4)];
    let decimal =
        if choice & 4 == 0 || delimiter == Delimiter::Comma { Decimal::Point } else { Decimal::Comma };
    let direct = equipoise_adapters::ground::channels::Direct {
        force: [Some(0), Some(1), Some(2)],
        moment: [Some(3), Some(4), Some(5)],
    };
    let settings = TextSettings {
        form: LineForm { delimiter, decimal, comment: Some(b'#'), prefix: Vec::new(), fields: 8 },
        framing: if choice & 8 == 0 { Framing::Stream } else { Framing::Joined },
        header_lines: u32::from(choice >> 6),
        longest: 200,
        columns: (0..6).map(|field| Column { field: field + 2, scale: 2.0, offset: -1.0 }).collect(),
        channels: Channels::direct(6, direct, ForceUnit::Newton, MomentUnit::NewtonMetre).unwrap(),
        time: None,
        sequence: (choice & 16 != 0).then_some(Numbered { field: 0, modulus: 1000 }),
    };
    stream(|| Box::new(Text::new(settings.clone())), bytes);
}

/// Valid streams of every device, each after the eight bytes that select the pieces.
pub(crate) mod seeds {
    use super::{all_fields, wires};

    fn prefixed(prefix: &[u8], stream: &[u8]) -> Vec<u8> {
        [prefix, stream].concat()
    }

    const PIECES: [u8; 8] = [3, 40, 0, 7, 120, 1, 1, 60];

    pub(crate) fn amti() -> Vec<Vec<u8>> {
        let frame = |index: i16| wires::amti::frame([index; 12], index % 7 == 0);
        let frames: Vec<u8> = (0..20).flat_map(frame).collect();
        vec![frames[..24].to_vec(), prefixed(&PIECES, &frames), vec![0; 60]]
    }

    pub(crate) fn bota() -> Vec<Vec<u8>> {
        let frame = |index: u32| {
            let wrench = [index as f32, 1.0, -700.0, 0.1, 0.2, 0.3];
            wires::bota::Frame { status: 0, wrench, timestamp_us: index * 10_000, temperature_c: 30.0 }
                .to_bytes()
        };
        let frames: Vec<u8> = (0..12).flat_map(frame).collect();
        vec![frames[..37].to_vec(), prefixed(&PIECES, &frames), vec![0; 60]]
    }

    fn names() -> [(&'static str, &'static str); 6] {
        [("Fx", "N"), ("Fy", "N"), ("Fz", "N"), ("Mx", "Nm"), ("My", "Nm"), ("Mz", "Nm")]
    }

    pub(crate) fn labamp() -> Vec<Vec<u8>> {
        let signals: Vec<_> = names()
            .map(|(name, unit)| wires::labamp::Signal { name: name.into(), unit: unit.into() })
            .to_vec();
        let paths = ["/api/daq/measurement/metadata/get", "/api/daq/stream/register", "/api/daq/stream/open"];
        let mut seeds: Vec<Vec<u8>> = paths
            .iter()
            .filter_map(|path| wires::labamp::answer(path, "{}", &signals, 1000.0))
            .map(|(answer, _)| answer.into_bytes())
            .collect();
        let scans = vec![vec![1.0, 2.0, 700.0, 3.0, 4.0, 5.0]; 10];
        let mut stream = seeds[0].iter().copied().filter(|byte| *byte != b'\n').collect::<Vec<u8>>();
        stream.push(b'\n');
        for sequence in 0..4 {
            stream.extend(wires::labamp::data(sequence, (1_700_000_000, sequence * 10_000_000), &scans));
        }
        stream.extend(wires::labamp::event(4, 1, wires::labamp::Event::Overrun));
        seeds.push(prefixed(&PIECES, &stream));
        seeds
    }

    pub(crate) fn qtm() -> Vec<Vec<u8>> {
        let plate = wires::qtm::Plate { id: 1, force_number: 5, forces: vec![[1.0; 9]; 3] };
        let plates = [plate.clone(), wires::qtm::Plate { id: 2, ..plate }];
        let all = wires::qtm::data(1000, 1, &[wires::qtm::force_component(&plates)]);
        let last = wires::qtm::data(2000, 2, &[wires::qtm::force_single_component(&plates)]);
        let text = wires::qtm::text_packet(wires::qtm::Kind::Command, "QTM RT Interface connected");
        vec![prefixed(&PIECES, &[text, all, last].concat()), vec![0; 60]]
    }

    pub(crate) fn lsl() -> Vec<Vec<u8>> {
        let info = wires::lsl::Info {
            name: "plate".into(),
            kind: "Force".into(),
            channels: names().map(|(name, unit)| (name.to_owned(), unit.to_owned())).to_vec(),
            rate_hz: 100.0,
            uid: "abc".into(),
            ports: [16_573, 16_572],
        };
        let mut stream = info.to_xml(true).into_bytes();
        stream.extend(wires::lsl::feed_header(&info));
        for index in 0..5 {
            stream.extend(wires::lsl::sample(f64::from(index) * 0.01, &[1.0, 2.0, 700.0, 3.0, 4.0, 5.0]));
        }
        vec![info.to_xml(true).into_bytes(), wires::lsl::short_info("7", &info), prefixed(&PIECES, &stream)]
    }

    pub(crate) fn tec_gihan() -> Vec<Vec<u8>> {
        vec![vec![1; 80], vec![0x82; 80]]
    }

    pub(crate) fn moticon() -> Vec<Vec<u8>> {
        let foot = wires::moticon::Insole { force_n: 350.0, cop: [0.1, -0.1], ..Default::default() };
        assert_eq!(all_fields().len(), 51);
        let datagrams = (0..5).flat_map(|index| {
            let text = wires::moticon::datagram(f64::from(index) * 0.01, &[foot, foot], &wires::moticon::ALL);
            let length = (text.len() as u16).to_le_bytes();
            [&length[..], &[100], text.as_bytes()].concat()
        });
        vec![datagrams.collect()]
    }

    pub(crate) fn text() -> Vec<Vec<u8>> {
        let forms = [(0_u8, " ", "."), (0x11, "\t", "."), (0x0a, ",", "."), (0x47, ";", ",")];
        forms
            .map(|(form, delimiter, decimal)| {
                let line = |index: u32| {
                    let fields = [f64::from(index), 0.5, 1.5, 2.5, 700.25, 3.0, 4.0, 5.0];
                    fields.map(|field| format!("{field:.3}").replace('.', decimal)).join(delimiter) + "\r\n"
                };
                let lines: String = (0..6).map(line).collect();
                // The stream's first byte selects the format, and is then part of its first line.
                prefixed(&PIECES, &[&[form, b'\n'][..], b"# comment\n", lines.as_bytes()].concat())
            })
            .to_vec()
    }
}
