use super::*;
use crate::ground::channels::{Direct, ForceUnit, MomentUnit};
use crate::ground::protocol::GroundProtocol;
use crate::ground::reading::Load;
use crate::ground::receiver::GroundSettings;
use crate::wire::text_line::{Decimal, Delimiter};
use equipoise_core::message::{Component, GroundSample};
use proptest::prelude::*;

/// `time;count;fz;mx;my`, kN and N mm.
fn settings(framing: Framing) -> TextSettings {
    let direct = Direct { force: [None, None, Some(0)], moment: [Some(1), Some(2), None] };
    let column = |field| Column { field, scale: 1.0, offset: 0.0 };
    TextSettings {
        form: LineForm {
            delimiter: Delimiter::Semicolon,
            decimal: Decimal::Comma,
            comment: Some(b'#'),
            prefix: Vec::new(),
            fields: 5,
        },
        framing,
        header_lines: 0,
        longest: 200,
        columns: vec![column(2), column(3), column(4)],
        channels: Channels::direct(3, direct, ForceUnit::Kilonewton, MomentUnit::NewtonMillimetre).unwrap(),
        time: Some((0, Unit::NanosecondInSeconds)),
        sequence: Some(Numbered { field: 1, modulus: 100 }),
    }
}

fn samples_of(settings: TextSettings, pieces: &[&[u8]]) -> (Vec<GroundSample>, GroundProtocol) {
    let mut protocol = GroundProtocol::new(Box::new(Text::new(settings)), GroundSettings::default());
    protocol.opened(0);
    let mut samples = Vec::new();
    for (index, piece) in pieces.iter().enumerate() {
        protocol.receive(piece, 1_000_000_000 + index as u64 * 10_000_000, &mut samples);
    }
    (samples, protocol)
}

fn refused(protocol: &GroundProtocol, refusal: GroundRefusal) -> u64 {
    protocol.counts().refused[refusal.index()]
}

#[test]
fn lines_become_samples_and_what_they_lack_is_said() {
    let lines: &[&[u8]] =
        &[b"# kN, Nmm\n", b"0,00;98;-0,7;7000,5;-1500\r\n", b"0,01;99;-0,71;0;0\n", b"0,02;0;-0,72;0;0"];
    let (samples, protocol) = samples_of(settings(Framing::Datagrams), lines);
    assert_eq!(samples.len(), 3);
    assert_eq!((samples[0].force_n, samples[0].moment_nm), ([0.0, 0.0, 700.0], [-7.0005, 1.5, 0.0]));
    assert_eq!(samples[0].not_measured, Component::Shear as u32 | Component::FreeMoment as u32);
    assert_eq!(protocol.counts().lost, 0, "99 and 0 are neighbours at a modulus of 100");
}

#[test]
fn loss_repetition_disorder_and_lines_of_another_form_are_counted() {
    let line = |count: u32| format!("{},{:02};{};-0,7;0;0\n", count / 100, count % 100, count % 100);
    let sent: Vec<String> = [95, 96, 99, 99, 98, 100, 103].map(line).to_vec();
    let mut pieces: Vec<&[u8]> = sent.iter().map(String::as_bytes).collect();
    // An unreadable line is lost; a readable line whose value is not finite is not.
    pieces.extend([&b"1,04;4;-0,7;0\n"[..], b"1,05;5;x;0;0\n", b"1,06;6;NaN;0;0\n", b"1,07;7;-0,7;0;0\n"]);
    let (samples, protocol) = samples_of(settings(Framing::Datagrams), &pieces);
    assert_eq!(samples.len(), 6);
    assert_eq!(protocol.counts().lost, 4 + 2);
    use GroundRefusal::{Duplicate, Fields, NotFinite, Number, OutOfOrder};
    for refusal in [Duplicate, OutOfOrder, Fields, Number, NotFinite] {
        assert_eq!(refused(&protocol, refusal), 1, "{refusal:?}");
    }
}

#[test]
fn without_a_count_the_times_tell_what_is_lost() {
    let settings = TextSettings { sequence: None, ..settings(Framing::Datagrams) };
    let line = |stamp: u32| format!("{},{:02};-;-0,7;0;0\n", stamp / 100, stamp % 100);
    let sent: Vec<String> = [0, 1, 2, 3, 4, 7, 7, 6, 8].map(line).to_vec();
    let pieces: Vec<&[u8]> = sent.iter().map(String::as_bytes).collect();
    let (samples, protocol) = samples_of(settings, &pieces);
    assert_eq!((samples.len(), protocol.counts().lost), (7, 2));
    assert_eq!(
        (refused(&protocol, GroundRefusal::Duplicate), refused(&protocol, GroundRefusal::OutOfOrder)),
        (1, 1)
    );
    assert!(samples.iter().all(|sample| sample.session == 0));
}

/// Lines without a counter, at 100 Hz, some of them unreadable.
#[test]
fn lines_that_cannot_be_read_are_lost_and_take_their_time_where_nothing_counts() {
    let settings = TextSettings { sequence: None, time: None, ..settings(Framing::Stream) };
    let too_long = "7".repeat(300) + "\n";
    let sent: Vec<&str> = (0..200)
        .map(|index| match index % 40 {
            30 => "-;-;0;0;0;0\n",
            31 => "-;-;x;0;0\n",
            32 => &too_long,
            33 => "-;-;nan;0;0\n",
            _ => "-;-;-0,7;0;0\n",
        })
        .collect();
    let pieces: Vec<&[u8]> = sent.iter().map(|line| line.as_bytes()).collect();
    let (samples, protocol) = samples_of(settings, &pieces);
    assert_eq!(
        (samples.len(), protocol.counts().lost),
        (180, 15),
        "one that is no number was read and is not lost"
    );
    for sample in &samples {
        let off_ns = sample.sample_time_ns.abs_diff(sample.arrival_ns);
        assert!(off_ns < 1_000_000, "{off_ns} ns off at {}", sample.arrival_ns);
    }
}

#[test]
fn a_header_stands_at_the_start_of_every_connection_and_not_elsewhere() {
    let with_header = TextSettings { header_lines: 2, ..settings(Framing::Stream) };
    let (mut samples, mut protocol) =
        samples_of(with_header, &[b"Plate 7\r\n\r\nt;n;Fz;Mx;My\r\n0,0;1;-0,7;0;0\r\n"]);
    assert_eq!(samples.len(), 1);
    protocol.opened(0);
    protocol.receive(b"Plate 7\nt;n;Fz;Mx;My\n0,5;7;-0,7;0;0\n", 2_000_000_000, &mut samples);
    assert_eq!((samples.len(), protocol.counts().refused.iter().sum::<u64>()), (2, 0));
}

#[test]
fn lines_that_never_fit_are_reported_in_words() {
    let mut text = Text::new(settings(Framing::Datagrams));
    let mut decoded = Decoded::default();
    for _ in 0..REPORTED_AFTER_LINES {
        assert_eq!(text.diagnostic(), None);
        text.take(b"1,0;2;3\n", 0, &mut decoded);
    }
    assert!(text.diagnostic().is_some_and(|said| said.contains("3 fields, and 5 are expected")));
    text.take(b"1,0;2;3;4;5\n", 0, &mut decoded);
    assert_eq!(text.diagnostic(), None);
}

#[test]
fn times_of_another_unit_are_reported_in_words() {
    let settings = TextSettings { sequence: None, ..settings(Framing::Datagrams) };
    let mut protocol = GroundProtocol::new(Box::new(Text::new(settings)), GroundSettings::default());
    let mut samples = Vec::new();
    // Milliseconds where seconds are configured.
    for index in 0..=u64::from(REPORTED_AFTER_LINES) {
        assert_eq!(protocol.diagnostic(), None);
        let line = format!("{};0;-0,7;0;0\n", 1_000_000 + 10 * index);
        protocol.receive(line.as_bytes(), (100 + index) * 10_000_000, &mut samples);
    }
    assert!(protocol.diagnostic().is_some_and(|said| said.contains("unit")), "{:?}", protocol.diagnostic());
    assert_eq!(
        (samples.len(), refused(&protocol, GroundRefusal::OutOfOrder)),
        (1, u64::from(REPORTED_AFTER_LINES))
    );
}

/// A line with the eight voltages of a real plate and an unused field between them.
#[test]
fn channels_may_be_scaled_and_stand_in_any_order() {
    let direct = Direct { force: [Some(2), Some(1), Some(0)], ..Direct::default() };
    let settings = TextSettings {
        form: LineForm {
            delimiter: Delimiter::Spaces,
            decimal: Decimal::Point,
            fields: 4,
            ..settings(Framing::Stream).form
        },
        columns: vec![
            Column { field: 3, scale: 2.0, offset: 0.0 },
            Column { field: 0, scale: 1.0, offset: 10.0 },
            Column { field: 3, scale: -1.0, offset: 0.5 },
        ],
        channels: Channels::direct(3, direct, ForceUnit::Newton, MomentUnit::NewtonMetre).unwrap(),
        time: None,
        sequence: None,
        ..settings(Framing::Stream)
    };
    let mut decoded = Decoded::default();
    Text::new(settings).take(b"1 n/a n/a 300\n", 0, &mut decoded);
    let reading = decoded.readings().next().unwrap();
    assert_eq!(reading.tick, Tick::Uncounted);
    assert!(matches!(reading.load, Load::Part { wrench, .. } if wrench.force_n == [-299.5, 11.0, 600.0]));
}

proptest! {
    #[test]
    fn any_pieces_make_the_same_readings(
        counts in proptest::collection::vec((1u32..4, 0u8..20), 1..40), cuts in proptest::collection::vec(any::<u16>(), 0..12),
    ) {
        let mut stream = Vec::new();
        let mut count = 0;
        for (step, fault) in counts {
            count += step;
            let line = match fault {
                0 => "###garbage\n".to_owned(),
                1 => format!("{count};1;2\n"),
                2 => "x".repeat(300) + "\n",
                _ => format!("{},{:02};{};-0,{count:03};0;0\r\n", count / 100, count % 100, count % 100),
            };
            stream.extend_from_slice(line.as_bytes());
        }
        let read = |pieces: &[&[u8]]| {
            let mut text = Text::new(settings(Framing::Stream));
            let mut decoded = Decoded::default();
            for piece in pieces {
                text.take(piece, 0, &mut decoded);
            }
            decoded
        };
        let mut cuts: Vec<usize> =
            cuts.into_iter().map(|cut| usize::from(cut) % (stream.len() + 1)).chain([0, stream.len()]).collect();
        cuts.sort_unstable();
        let pieces: Vec<&[u8]> = cuts.windows(2).map(|pair| &stream[pair[0]..pair[1]]).collect();
        prop_assert_eq!(read(&pieces), read(&[&stream]));
    }

    #[test]
    fn garbage_never_panics_and_takes_no_room(pieces in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..400), 0..10)) {
        for framing in [Framing::Datagrams, Framing::Stream, Framing::Joined] {
            let mut text = Text::new(settings(framing));
            let mut decoded = Decoded::default();
            for piece in &pieces {
                text.take(piece, 0, &mut decoded);
            }
        }
    }
}
