//! Sensor faults without a fault flag, in the bytes of a captured session with a load: no wrong load is published.
//!
//! The datagrams are altered, so the faults pass parsers, clock fits and the replay; `studies/src/faults.rs` alters the
//! samples instead.

use std::net::SocketAddr;
use std::path::Path;

use equipoise_adapters::capture::{PcapCapture, PcapWriter, UdpDatagram};
use equipoise_adapters::wire::ati_rdt::{Command, Request};
use equipoise_core::body::Segment;
use equipoise_simulator::dynamics::Wrench;
use equipoise_simulator::motion::Worker;
use equipoise_simulator::plate::Plate;
use equipoise_simulator::wire::SuitFrame;
use equipoise_studies::sensors::EPOCH_NS;

use crate::common::{describe_output, equipoise};
use crate::make::{Samples, Script};

/// Mass of the box, kg.
const BOX_KG: f64 = 11.0;
/// Duration of the work: 10 s without the box, then 10 s with it.
const WORK_S: f64 = 20.0;
/// From the time at which the box is taken to the fault, s.
const FAULT_AFTER_S: f64 = 3.0;
/// Wall-clock time of simulated time 0, ns since 1970.
const WALL_NS: u64 = 1_700_000_000_000_000_000;
/// Ports of the suit's datagrams and of the plate's records.
const SUIT: u16 = 9763;
const PLATE: u16 = 49152;
/// Bytes of MVN's header; of one item of type 02: segment id, position, quaternion; and before the quaternion.
const HEADER: usize = 24;
const ITEM: usize = 32;
const QUATERNION: usize = 16;
/// Bytes of a record before its counts, and the vertical force among these.
const COUNTS: usize = 12;
const VERTICAL: usize = 2;
/// Rail of a saturated channel, as a fraction of the vertical force at the start of the fault.
const RAIL_RATIO: f64 = 1.02;
/// A published mass is wrong beyond this, kg, and four of its σ.
const WRONG_KG: f64 = 3.0;
const WRONG_SIGMAS: f64 = 4.0;
/// Reasons that an implausible sensor or load raises.
const PLAUSIBILITY: [&str; 5] =
    ["ground_implausible", "suit_implausible", "weight_missing", "load_not_at_hands", "position_unknown"];
/// Cycles per second of the replay.
const RATE_HZ: u32 = 100;

/// An altered stream.
struct Fault {
    name: &'static str,
    /// Port of its datagrams.
    port: u16,
    lasts_s: f64,
    /// Alters the payload of a datagram; the second one is the first payload of the fault.
    alter: fn(&mut [u8], &[u8]),
}

static NO_FAULT: Fault = Fault { name: "none", port: PLATE, lasts_s: 0.0, alter: |_, _| {} };

static FAULTS: [Fault; 8] = [
    Fault {
        name: "plate doubled",
        port: PLATE,
        lasts_s: 0.02,
        alter: |record, _| each_count(record, |count| count.saturating_mul(2)),
    },
    Fault {
        name: "plate saturated",
        port: PLATE,
        lasts_s: 3.0,
        alter: |record, first| {
            // The sensor measures the force on itself, downwards.
            let rail = RAIL_RATIO * f64::from(count(first, VERTICAL));
            let saturated = count(record, VERTICAL).max(rail as i32);
            set_count(record, VERTICAL, saturated);
        },
    },
    Fault {
        name: "plate with inverted sign",
        port: PLATE,
        lasts_s: 3.0,
        alter: |record, _| each_count(record, i32::saturating_neg),
    },
    Fault {
        name: "plate with half gain",
        port: PLATE,
        lasts_s: 3.0,
        alter: |record, _| each_count(record, |count| count / 2),
    },
    Fault {
        name: "plate frozen",
        port: PLATE,
        lasts_s: 3.0,
        alter: |record, first| record[COUNTS..].copy_from_slice(&first[COUNTS..]),
    },
    Fault {
        name: "suit frozen",
        port: SUIT,
        lasts_s: 3.0,
        alter: |datagram, first| datagram[HEADER..].copy_from_slice(&first[HEADER..]),
    },
    Fault {
        name: "identity quaternions",
        port: SUIT,
        lasts_s: 3.0,
        alter: |datagram, _| Segment::ALL.into_iter().for_each(|segment| set_identity(datagram, segment)),
    },
    Fault {
        name: "identity quaternions of the arms",
        port: SUIT,
        lasts_s: 3.0,
        alter: |datagram, _| {
            let is_arm = |segment: &Segment| (Segment::RightShoulder..=Segment::LeftHand).contains(segment);
            let arms = Segment::ALL.into_iter().filter(is_arm);
            arms.for_each(|segment| set_identity(datagram, segment));
        },
    },
];

fn count(record: &[u8], channel: usize) -> i32 {
    let at = COUNTS + 4 * channel;
    i32::from_be_bytes(record[at..at + 4].try_into().unwrap())
}

fn set_count(record: &mut [u8], channel: usize, count: i32) {
    let at = COUNTS + 4 * channel;
    record[at..at + 4].copy_from_slice(&count.to_be_bytes());
}

fn each_count(record: &mut [u8], change: impl Fn(i32) -> i32) {
    for channel in 0..6 {
        set_count(record, channel, change(count(record, channel)));
    }
}

fn set_identity(datagram: &mut [u8], segment: Segment) {
    let at = HEADER + ITEM * segment.index() + QUATERNION;
    let identity = [1.0_f32, 0.0, 0.0, 0.0].map(f32::to_be_bytes);
    datagram[at..at + 16].copy_from_slice(identity.as_flattened());
}

/// Writes the samples as the datagrams of suit and plate on the network.
fn capture(samples: &Samples, path: &Path) {
    let address = |text: &str| text.parse::<SocketAddr>().unwrap();
    let (suit, station) = (address("10.0.0.7:50123"), address("10.0.0.2:9763"));
    let (plate, client) = (address("10.0.0.9:49152"), address("10.0.0.2:40404"));
    let wall_ns = |time_ns: u64| WALL_NS + (time_ns - EPOCH_NS);
    let mut writer = PcapWriter::create(path).unwrap();
    let request = Request { command: Command::StartRealTime, sample_count: 0 };
    writer.write_udp(WALL_NS, client, plate, &request.to_bytes()).unwrap();
    let standard = Plate::default();
    let mut poses = samples.suit.iter().peekable();
    for (number, ground) in (1_u32..).zip(&samples.ground) {
        while let Some(sample) = poses.next_if(|sample| sample.published_ns <= ground.published_ns) {
            let frame = SuitFrame {
                sample_counter: sample.device_counter,
                time_code_ms: sample.device_time_ms,
                position_m: sample.position_m,
                orientation_wxyz: sample.orientation_wxyz,
                ..SuitFrame::default()
            };
            for datagram in frame.datagrams().unwrap() {
                writer.write_udp(wall_ns(sample.published_ns), suit, station, &datagram).unwrap();
            }
        }
        let on_person = Wrench { force_n: ground.force_n.into(), moment_nm: ground.moment_nm.into() };
        let mut record = standard.record(&standard.sensor_wrench(&on_person), number, 0);
        record.rdt_sequence = number;
        writer.write_udp(wall_ns(ground.published_ns), plate, client, &record.to_bytes()).unwrap();
    }
    writer.finish().unwrap();
}

impl Fault {
    /// Writes the capture with this fault from a simulated time on, s.
    fn write(&self, datagrams: &[UdpDatagram], begins_s: f64, path: &Path) {
        let span_s = begins_s..begins_s + self.lasts_s;
        let mut writer = PcapWriter::create(path).unwrap();
        let mut first = None;
        for datagram in datagrams {
            let mut payload = datagram.payload.clone();
            let time_s = (datagram.time_ns - WALL_NS) as f64 * 1e-9;
            let ports = [datagram.source.port(), datagram.destination.port()];
            if ports.contains(&self.port) && span_s.contains(&time_s) {
                let first = first.get_or_insert_with(|| payload.clone());
                (self.alter)(&mut payload, first);
            }
            writer.write_udp(datagram.time_ns, datagram.source, datagram.destination, &payload).unwrap();
        }
        writer.finish().unwrap();
    }

    /// Replays the capture with this fault; returns the result as a table.
    fn replay(&self, datagrams: &[UdpDatagram], begins_s: f64, config: &Path) -> String {
        let file = |ending: &str| config.with_file_name(format!("{}.{ending}", self.name));
        let (pcap, table) = (file("pcap"), file("csv"));
        self.write(datagrams, begins_s, &pcap);
        let mut command = equipoise();
        command.arg("replay").arg(&pcap).arg("--config").arg(config).arg("--out").arg(&table);
        let output = command.output().unwrap();
        // An adapter may refuse altered data.
        let code = output.status.code();
        assert!(matches!(code, Some(0 | 3)), "{}: {}", self.name, describe_output(&output));
        std::fs::read_to_string(&table).unwrap()
    }
}

/// Cycles of a replay.
#[derive(Debug, Default)]
struct Cycles {
    /// All values are valid.
    valid: usize,
    /// Only reasons of plausibility are raised.
    implausible: usize,
    /// A wrong mass is published.
    wrong: usize,
    first_wrong: Option<String>,
}

impl Cycles {
    fn of(table: &str, worker: &Worker) -> Cycles {
        let mut lines = table.lines();
        let head: Vec<&str> = lines.next().unwrap().split(',').collect();
        let column = |name: &str| head.iter().position(|column| *column == name).unwrap();
        let valid = column("valid");
        let numbers = ["suit_sample_t_s", "lifted_mass_kg", "lifted_mass_sigma_kg"].map(column);
        let mut cycles = Cycles::default();
        for line in lines {
            let cells: Vec<&str> = line.split(',').collect();
            let mut reasons = cells[valid].split(' ').filter(|reason| !reason.is_empty()).peekable();
            let is_valid = reasons.peek().is_none();
            let only_plausibility = reasons.all(|reason| PLAUSIBILITY.contains(&reason));
            cycles.valid += usize::from(is_valid);
            cycles.implausible += usize::from(!is_valid && only_plausibility);
            let [_, mass, _] = numbers;
            if cells[mass].is_empty() {
                continue;
            }
            let [time_s, mass_kg, sigma_kg] = numbers.map(|at| cells[at].parse::<f64>().unwrap());
            let load_kg = worker.sample(time_s).load_kg;
            let off_kg = (mass_kg - load_kg).abs();
            if off_kg.is_nan() || off_kg > WRONG_KG.max(WRONG_SIGMAS * sigma_kg) {
                cycles.wrong += 1;
                cycles.first_wrong.get_or_insert_with(|| {
                    format!("t = {time_s} s: {mass_kg} ± {sigma_kg} kg, in truth {load_kg} kg")
                });
            }
        }
        cycles
    }
}

#[test]
fn no_fault_in_the_bytes_of_a_capture_gives_a_wrong_load() {
    let mut script = Script { poses: 6, work_s: WORK_S, carried_kg: BOX_KG, ..Script::ordinary() };
    script.rig.plate_hz = 500;
    let mut ordered = script.worker();
    ordered.until(script.length_s());
    let (worker, begins_s) = (&ordered.worker, script.lift_s() + FAULT_AFTER_S);
    let directory = tempfile::tempdir().unwrap();
    let [config, pcap] = ["station.toml", "session.pcap"].map(|name| directory.path().join(name));
    // The identification ends with the poses, of which there are few.
    let bound = "[identification]\nstop_cop_sigma_mm = 20.0";
    let text = script.config().replace("[identification]", bound);
    std::fs::write(&config, format!("{text}[loop]\nrate_hz = {RATE_HZ}\n")).unwrap();
    capture(&script.samples(), &pcap);
    let datagrams: Vec<UdpDatagram> = PcapCapture::open(&pcap).unwrap().collect();

    let (datagrams, config) = (&datagrams[..], config.as_path());
    let (unaltered, altered) = std::thread::scope(|scope| {
        let start = |fault: &'static Fault| {
            scope.spawn(move || {
                let table = fault.replay(datagrams, begins_s, config);
                let cycles = Cycles::of(&table, worker);
                (table, cycles)
            })
        };
        let unaltered = start(&NO_FAULT);
        let altered: Vec<_> = FAULTS.iter().map(|fault| (fault.name, start(fault))).collect();
        let altered: Vec<_> =
            altered.into_iter().map(|(name, thread)| (name, thread.join().unwrap())).collect();
        (unaltered.join().unwrap(), altered)
    });
    let (table, cycles) = unaltered;
    // Most of the 10 s with the box.
    assert!(cycles.valid > 5 * RATE_HZ as usize, "{cycles:?}");
    assert_eq!(cycles.wrong, 0, "{cycles:?}");
    assert!(100 * cycles.implausible < cycles.valid, "{cycles:?}");
    for (name, (altered_table, cycles)) in altered {
        println!("{name}: {cycles:?}");
        assert!(altered_table != table, "{name}: the fault has no effect");
        assert_eq!(cycles.wrong, 0, "{name}: {cycles:?}");
    }
}
