//! A stream's constant latency in captures of other programs: earlier sample times by exactly that.

use std::net::SocketAddr;
use std::path::Path;

use equipoise_adapters::capture::PcapWriter;
use equipoise_config::Config;
use equipoise_core::body::{SEGMENTS, Segment};
use equipoise_recording::replay::input::Input;
use equipoise_recording::replay::samples::Sample;
use equipoise_simulator::dynamics::Wrench;
use equipoise_simulator::plate::Plate;
use equipoise_simulator::wire::SuitFrame;
use nalgebra::Vector3;

const ROWS: u32 = 40;
const SUIT_NS: u64 = 40_000_000;
const GROUND_NS: u64 = 8_500_000;

fn config(keys_of_suit: &str, keys_of_ground: &str) -> Config {
    let text = format!(
        "station = \"s\"\n[suit]\nsource = \"mvn-udp\"\n{keys_of_suit}\n[ground]\nsource = \"ati-rdt\"\n\
         counts_per_newton = 1e6\ncounts_per_newton_metre = 1e6\n{keys_of_ground}\n[subject]\nid = \"a\"\n\
         height_m = 1.77\n"
    );
    Config::parse(&text, "c.toml").unwrap()
}

/// Feet at the floor, all else above them: a body that is not refused as lying down.
fn height_m(segment: Segment) -> f64 {
    if segment > Segment::LeftHand { 0.1 } else { 1.0 }
}

fn write_csv(path: &Path) {
    let mut text = "t_s,Fx_N,Fy_N,Fz_N,Mx_Nm,My_Nm,Mz_Nm".to_owned();
    for segment in Segment::ALL {
        for part in ["px_m", "py_m", "pz_m", "qw", "qx", "qy", "qz"] {
            text += &format!(",{}_{part}", segment.name());
        }
    }
    for row in 0..ROWS {
        text += &format!("\n{},0,0,700,0,0,0", f64::from(row) * 0.01);
        for segment in Segment::ALL {
            text += &format!(",0,0,{},1,0,0,0", height_m(segment));
        }
    }
    std::fs::write(path, text + "\n").unwrap();
}

fn write_pcap(path: &Path) {
    let address = |text: &str| text.parse::<SocketAddr>().unwrap();
    let (mvn, us, plate) = (address("10.0.0.7:50123"), address("10.0.0.2:9763"), address("10.0.0.9:49152"));
    let mut writer = PcapWriter::create(path).unwrap();
    let standing = Wrench { force_n: Vector3::new(0.0, 0.0, 700.0), moment_nm: Vector3::zeros() };
    for number in 1..=ROWS {
        let at_ns = 1_700_000_000_000_000_000 + u64::from(number) * 10_000_000;
        let mut record = Plate::default().record(&Plate::default().sensor_wrench(&standing), number, 0);
        record.rdt_sequence = number;
        writer.write_udp(at_ns, plate, address("10.0.0.2:40404"), &record.to_bytes()).unwrap();
        let frame = SuitFrame {
            sample_counter: number,
            time_code_ms: 10 * number,
            avatar: 0,
            position_m: Segment::ALL.map(|segment| [0.0, 0.0, height_m(segment)]),
            orientation_wxyz: [[1.0, 0.0, 0.0, 0.0]; SEGMENTS],
            ..SuitFrame::default()
        };
        for datagram in frame.datagrams().unwrap() {
            writer.write_udp(at_ns, mvn, us, &datagram).unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn the_configured_latency_is_subtracted_from_sample_times_only() {
    let directory = tempfile::tempdir().unwrap();
    let (csv, pcap) = (directory.path().join("a.csv"), directory.path().join("a.pcap"));
    write_csv(&csv);
    write_pcap(&pcap);
    let plain = config("", "");
    let late = config("latency_ms = 40", "latency_ms = 8.5");
    for path in [csv, pcap] {
        let input = Input::open(&path).unwrap();
        let expected: Vec<Sample> = input.samples(&plain).unwrap().collect();
        let shifted: Vec<Sample> = input.samples(&late).unwrap().collect();
        assert_eq!(shifted.len(), expected.len());
        assert!(shifted.len() >= 2 * ROWS as usize - 1, "{}: {}", path.display(), shifted.len());
        for (shifted, expected) in shifted.into_iter().zip(expected) {
            match (shifted, expected) {
                (Sample::Suit(mut shifted), Sample::Suit(expected)) => {
                    shifted.sample_time_ns += SUIT_NS;
                    assert_eq!(shifted, expected);
                }
                (Sample::Ground(mut shifted), Sample::Ground(expected)) => {
                    shifted.sample_time_ns += GROUND_NS;
                    assert_eq!(shifted, expected);
                }
                pair => panic!("another order: {pair:?}"),
            }
        }
    }
}
