//! Bad datagrams between good ones on the suit's port.

use std::time::{Duration, Instant};

use equipoise_adapters::suit::SuitRefusal;

use crate::monitor::Monitor;
use crate::process::Process;
use crate::station::Station;
use crate::streams::{self, FakePlate, Stream};

/// Number of repetitions of each bad datagram.
const ROUNDS: u64 = 8;
/// Wait for the counters before all bad datagrams are sent again; all of them take 4 s at 60 Hz.
const REPEAT_AFTER: Duration = Duration::from_secs(15);
/// Bytes of a header and of one item of type 02.
const HEADER: usize = 24;
const ITEM: usize = 32;

/// A valid datagram of type 02, corrupted.
fn corrupted(valid: &[u8], corrupt: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut bad = valid.to_vec();
    corrupt(&mut bad);
    bad
}

fn write_bytes(bytes: &mut [u8], at: usize, what: &[u8]) {
    bytes[at..at + what.len()].copy_from_slice(what);
}

/// Sets a header's payload size and number of items according to the length.
fn announce(bytes: &mut [u8], items: u8) {
    let payload = (bytes.len() - HEADER) as u16;
    bytes[11] = items;
    write_bytes(bytes, 22, &payload.to_be_bytes());
}

fn counter(bytes: &[u8]) -> u32 {
    u32::from_be_bytes(bytes[6..10].try_into().expect("four bytes"))
}

fn with_counter(valid: &[u8], steps: i32) -> Vec<u8> {
    let counter = counter(valid).wrapping_add_signed(steps);
    corrupted(valid, |bad| write_bytes(bad, 6, &counter.to_be_bytes()))
}

/// Replaces a float of an item, by its index in the item (0 is the segment's id).
fn with_float(valid: &[u8], item: usize, field: usize, value: f32) -> Vec<u8> {
    corrupted(valid, |bad| write_bytes(bad, HEADER + item * ITEM + field * 4, &value.to_be_bytes()))
}

type Make = fn(&[u8]) -> Vec<u8>;

/// Defect, refusal reason, and construction.
const FAULTS: &[(&str, SuitRefusal, Make)] = &[
    ("empty", SuitRefusal::TooShort, |_| Vec::new()),
    ("one byte", SuitRefusal::TooShort, |_| vec![b'M']),
    ("23 bytes", SuitRefusal::TooShort, |valid| valid[..23].to_vec()),
    ("a header alone", SuitRefusal::Length, |valid| valid[..HEADER].to_vec()),
    ("truncated", SuitRefusal::Length, |valid| valid[..valid.len() - 1].to_vec()),
    ("larger than any", SuitRefusal::Length, |valid| corrupted(valid, |bad| bad.resize(2041, 0))),
    ("65 kB", SuitRefusal::Length, |valid| corrupted(valid, |bad| bad.resize(65_507, 0))),
    ("a payload size of 0", SuitRefusal::Length, |valid| {
        corrupted(valid, |bad| write_bytes(bad, 22, &[0, 0]))
    }),
    ("a payload size too small", SuitRefusal::Length, |valid| {
        corrupted(valid, |bad| write_bytes(bad, 22, &[0, 1]))
    }),
    ("more items than bytes", SuitRefusal::Items, |valid| corrupted(valid, |bad| bad[11] = 63)),
    ("no items", SuitRefusal::Items, |valid| corrupted(valid, |bad| bad[11] = 0)),
    ("a position that is NaN", SuitRefusal::NotFinite, |valid| with_float(valid, 3, 1, f32::NAN)),
    ("an infinite position", SuitRefusal::NotFinite, |valid| with_float(valid, 22, 3, f32::INFINITY)),
    ("a hand 4 m off", SuitRefusal::Implausible, |valid| with_float(valid, 14, 2, 4.0)),
    ("everybody far away", SuitRefusal::Implausible, |valid| with_float(valid, 0, 1, -1e30)),
    ("a quaternion of norm 2", SuitRefusal::NotUnitQuaternion, |valid| with_float(valid, 0, 4, 2.0)),
    ("a quaternion of zeros", SuitRefusal::NotUnitQuaternion, |valid| {
        corrupted(valid, |bad| bad[HEADER + 16..HEADER + 32].fill(0))
    }),
    ("one segment twice", SuitRefusal::DuplicateSegment, |valid| {
        corrupted(valid, |bad| write_bytes(bad, HEADER + ITEM, &1_u32.to_be_bytes()))
    }),
    ("22 segments", SuitRefusal::MissingSegment, |valid| {
        corrupted(valid, |bad| {
            bad.truncate(HEADER + 22 * ITEM);
            announce(bad, 22);
        })
    }),
    ("a segment that is none", SuitRefusal::MissingSegment, |valid| {
        corrupted(valid, |bad| write_bytes(bad, HEADER + 5 * ITEM, &u32::MAX.to_be_bytes()))
    }),
    ("another avatar", SuitRefusal::OtherAvatar, |valid| corrupted(valid, |bad| bad[16] = 3)),
    ("the same counter again", SuitRefusal::Duplicate, <[u8]>::to_vec),
    ("overtaken", SuitRefusal::OutOfOrder, |valid| with_counter(valid, -2)),
    ("of long ago", SuitRefusal::OutOfOrder, |valid| with_counter(valid, -900)),
    ("a wild counter", SuitRefusal::OutOfOrder, |valid| with_counter(valid, i32::MAX)),
    ("another protocol", SuitRefusal::NotMvn, |valid| corrupted(valid, |bad| write_bytes(bad, 0, b"MXTQ"))),
    ("type 99", SuitRefusal::UnknownType, |valid| corrupted(valid, |bad| write_bytes(bad, 4, b"99"))),
    ("upside down", SuitRefusal::UpsideDown, |valid| {
        corrupted(valid, |bad| {
            for item in 0..23 {
                // The sign of z.
                bad[HEADER + item * ITEM + 12] ^= 0x80;
            }
        })
    }),
];

/// Datagrams that are ignored without being counted: the remote control shares the port.
const JSON: &[u8] = br#"{"type":"transport","value":"record"}"#;

#[test]
fn malformed_datagrams_are_counted_by_reason_only() {
    let station = Station::new();
    let _plate = FakePlate::start(station.plate);
    let mut daemon = station.daemon(&station.configuration());
    let suit = streams::suit(station.suit);
    let mut monitor = Monitor::open(&station);
    monitor.until("both sensors", Monitor::both_fresh);
    monitor.until("the bones", |monitor| monitor.state.phase_name() == "identifying");

    let before = monitor.until("a word of the suit", |monitor| monitor.suit().published > 0);
    let published = monitor.suit().published;
    play_all(&suit);
    // Random bytes, whatever the reason of their refusal.
    let mut noise = Noise(0x5eed);
    for _ in 0..ROUNDS {
        let length = noise.next() as usize % 1500;
        let random: Vec<u8> = (0..length).map(|_| noise.next() as u8).collect();
        suit.slip_in(move |_| random.clone());
        let header = random_after_header(&mut noise);
        suit.slip_in(move |_| header.clone());
        suit.slip_in(|_| JSON.to_vec());
    }

    let mut sent = Instant::now();
    for reason in SuitRefusal::ALL {
        let expected = ROUNDS * FAULTS.iter().filter(|(_, refusal, _)| refusal == reason).count() as u64;
        monitor.until(reason.name(), |monitor| {
            // A datagram may be lost also on loopback: a full socket buffer behind a busy core.
            if sent.elapsed() > REPEAT_AFTER {
                play_all(&suit);
                sent = Instant::now();
            }
            monitor.suit_refused(*reason) >= expected
        });
    }
    assert!(monitor.suit().published > published + 100, "good samples went missing");
    monitor.until("the suit's rate", |monitor| monitor.suit().rate_hz > 5.0);
    monitor.until("both sensors and the identification after the storm", |monitor| {
        monitor.both_fresh() && monitor.state.phase_name() == "identifying"
    });
    assert!(monitor.state.cycle > before.cycle);

    // Whether there is an estimate depends on the machine: a suit that was silent for long is located again only once it
    // moves, and this one stands.
    let status =
        station.status_when("the suit's counts", |status| status["adapters"][0]["refused"].is_object());
    let refused = &status["adapters"][0]["refused"];
    for (what, reason, _) in FAULTS {
        assert!(refused[reason.name()].as_u64() >= Some(ROUNDS), "{what}: {refused}");
    }
    assert!(!status["state"].to_string().contains("null"), "{status}");
    assert!(daemon.is_running());
    assert_memory_bounded(&daemon);
    assert!(!daemon.stderr().contains("panicked"), "{}", daemon.stderr());
}

fn play_all(suit: &Stream) {
    for _ in 0..ROUNDS {
        for (_, _, make) in FAULTS {
            suit.slip_in(make);
        }
    }
}

/// `MXTP` and a matching length before random bytes: it passes the first checks.
fn random_after_header(noise: &mut Noise) -> Vec<u8> {
    let types = [b"01", b"02", b"12", b"13", b"20", b"21", b"22", b"23", b"24", b"25"];
    let length = HEADER + noise.next() as usize % 900;
    let mut bytes: Vec<u8> = (0..length.max(HEADER + 1)).map(|_| noise.next() as u8).collect();
    write_bytes(&mut bytes, 0, b"MXTP");
    write_bytes(&mut bytes, 4, types[noise.next() as usize % types.len()]);
    bytes[16] = 0;
    let items = bytes[11];
    announce(&mut bytes, items);
    bytes
}

#[test]
fn an_implausibly_distant_segment_does_not_reach_the_state() {
    let station = Station::new();
    let _plate = FakePlate::start(station.plate);
    let _daemon = station.daemon(&station.configuration());
    let suit = streams::suit(station.suit);
    let mut monitor = Monitor::open(&station);
    monitor.until("the bones", |monitor| monitor.state.phase_name() == "identifying");
    // Finite, of the next sample, and an impossible position: one flipped bit of an exponent is enough.
    for _ in 0..ROUNDS {
        suit.slip_in(|valid| with_float(&with_counter(valid, 1), 4, 2, 1e30));
    }
    let published = monitor.suit().published;
    monitor.until("many samples more", |monitor| {
        let controller = monitor.state.segment_origin_m.iter().flatten().any(|metres| metres.abs() > 100.0);
        assert!(!controller, "{:?}", monitor.state.segment_origin_m);
        monitor.suit().published > published + 60
    });
}

/// Pseudo-random numbers from a seed (xorshift).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 16) as u32
    }
}

/// Asserts that the resident memory of a running process has never exceeded 1 GiB.
#[track_caller]
pub(crate) fn assert_memory_bounded(process: &Process) {
    const MAX_KIB: u64 = 1 << 20;
    let path = format!("/proc/{}/status", process.id());
    let status = std::fs::read_to_string(path).expect("a running process");
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("VmHWM");
    let kib: u64 = peak.trim().trim_end_matches(" kB").parse().expect("a number");
    assert!(kib < MAX_KIB, "{kib} KiB");
}
