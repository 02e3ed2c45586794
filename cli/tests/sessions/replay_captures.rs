//! Captures: valid data become samples; invalid data are counted and reported by the exit code.

use std::net::SocketAddr;
use std::path::Path;
use std::process::Output;

use equipoise_adapters::capture::{CsvCapture, PcapWriter};
use equipoise_adapters::recording::{Entry, Recording};
use equipoise_adapters::wire::ati_rdt::{Command, Request};
use equipoise_core::body::Segment;
use equipoise_core::message::{GroundSample, SuitSample};
use equipoise_simulator::dynamics::Wrench;
use equipoise_simulator::plate::Plate;
use equipoise_simulator::wire::SuitFrame;

use crate::common::{describe_output, equipoise, human_motion};

fn run(arguments: &[&dyn AsRef<std::ffi::OsStr>]) -> Output {
    equipoise().args(arguments.iter().map(AsRef::as_ref)).output().unwrap()
}

fn samples(recording: &Path) -> (Vec<SuitSample>, Vec<GroundSample>) {
    let (mut suit, mut ground) = (Vec::new(), Vec::new());
    for timed in Recording::open(recording).unwrap().entries() {
        match timed.unwrap().entry {
            Entry::Suit(sample) => suit.push(*sample),
            Entry::Ground(sample) => ground.push(*sample),
            other => panic!("{other:?}"),
        }
    }
    (suit, ground)
}

/// The rows as datagrams of suit and plate, as they would be captured next to a browser and a broken sender.
fn capture(rows: &[(SuitSample, GroundSample)], path: &Path, broken: bool) {
    let address = |text: &str| text.parse::<SocketAddr>().unwrap();
    let (mvn, us, plate) = (address("10.0.0.7:50123"), address("10.0.0.2:9763"), address("10.0.0.9:49152"));
    let client = address("10.0.0.2:40404");
    let mut writer = PcapWriter::create(path).unwrap();
    let wall_ns = |sample_time_ns: u64| 1_700_000_000_000_000_000 + sample_time_ns;
    let request = Request { command: Command::StartRealTime, sample_count: 0 };
    writer.write_udp(wall_ns(rows[0].0.sample_time_ns), client, plate, &request.to_bytes()).unwrap();
    writer.write_udp(wall_ns(0), client, address("10.0.0.1:53"), b"a question").unwrap();
    for (number, (suit, ground)) in (1_u32..).zip(rows) {
        let at_ns = wall_ns(suit.sample_time_ns);
        let on_person = Wrench { force_n: ground.force_n.into(), moment_nm: ground.moment_nm.into() };
        let standard = Plate::default();
        let mut record = standard.record(&standard.sensor_wrench(&on_person), number, 0);
        record.rdt_sequence = number;
        writer.write_udp(at_ns, plate, client, &record.to_bytes()).unwrap();
        let frame = SuitFrame {
            sample_counter: number,
            time_code_ms: suit.device_time_ms,
            avatar: 0,
            position_m: suit.position_m,
            orientation_wxyz: suit.orientation_wxyz,
            ..SuitFrame::default()
        };
        for datagram in frame.datagrams().unwrap() {
            writer.write_udp(at_ns, mvn, us, &datagram).unwrap();
        }
        if broken && number % 50 == 0 {
            writer.write_udp(at_ns, mvn, us, b"MXTP02 and then nothing").unwrap();
            writer.write_udp(at_ns, plate, client, b"not a record").unwrap();
            // Suit and plate of another station, of the same make.
            writer.write_udp(at_ns, address("10.0.0.8:49152"), client, &record.to_bytes()).unwrap();
            for datagram in frame.datagrams().unwrap() {
                writer.write_udp(at_ns, address("10.0.0.6:50123"), us, &datagram).unwrap();
            }
        }
    }
    writer.finish().unwrap();
}

#[test]
fn figaroh_captured_on_the_network_is_the_same_motion_as_its_csv() {
    let Some(csv) = human_motion() else { return };
    let rows: Vec<_> = CsvCapture::open(&csv).unwrap().take(600).collect();
    let directory = tempfile::tempdir().unwrap();
    let (pcap, mcap) = (directory.path().join("a.pcap"), directory.path().join("a.mcap"));
    capture(&rows, &pcap, false);
    let output = run(&[&"import", &pcap, &"-o", &mcap]);
    assert_eq!(output.status.code(), Some(0), "{}", describe_output(&output));
    assert!(
        describe_output(&output).contains("passed over: 1 datagrams of neither port"),
        "{}",
        describe_output(&output)
    );

    let (suit, ground) = samples(&mcap);
    // Until the assembler has determined which datagrams make a sample, one ends with the next; the file has no next.
    assert_eq!((suit.len(), ground.len()), (600, 600));
    for ((suit, ground), (suit_row, ground_row)) in suit.iter().zip(&ground).zip(&rows) {
        // Rows are 33.3 ms apart with jitter; the clock fit smooths them.
        assert!(suit.sample_time_ns.abs_diff(suit_row.sample_time_ns) < 1_000_000, "{suit:?}");
        assert!(ground.sample_time_ns.abs_diff(ground_row.sample_time_ns) < 1_000_000);
        let pelvis = Segment::Pelvis.index();
        assert!((suit.position_m[pelvis][2] - suit_row.position_m[pelvis][2]).abs() < 1e-6);
        assert!((ground.force_n[2] - ground_row.force_n[2]).abs() < 1e-6);
        assert!((ground.moment_nm[0] - ground_row.moment_nm[0]).abs() < 1e-6);
    }

    let lines = directory.path().join("a.csv");
    let output = run(&[&"replay", &mcap, &"--out", &lines]);
    assert_eq!(output.status.code(), Some(0), "{}", describe_output(&output));
    let direct = directory.path().join("b.csv");
    let output = run(&[&"replay", &pcap, &"--out", &direct]);
    assert_eq!(output.status.code(), Some(0), "{}", describe_output(&output));
    assert!(std::fs::read(lines).unwrap() == std::fs::read(direct).unwrap(), "import and capture differ");
}

#[test]
fn figaroh_broken_datagrams_are_counted_by_reason() {
    let Some(csv) = human_motion() else { return };
    let rows: Vec<_> = CsvCapture::open(&csv).unwrap().take(200).collect();
    let directory = tempfile::tempdir().unwrap();
    let pcap = directory.path().join("a.pcap");
    capture(&rows, &pcap, true);
    let output = run(&[&"import", &pcap, &"-o", &directory.path().join("a.mcap")]);
    assert_eq!(output.status.code(), Some(3), "{}", describe_output(&output));
    assert!(describe_output(&output).contains("4 suit datagrams too_short"), "{}", describe_output(&output));
    assert!(describe_output(&output).contains("4 ground records length"), "{}", describe_output(&output));
    assert!(
        describe_output(&output).contains("4 ground records foreign_sender"),
        "{}",
        describe_output(&output)
    );
    assert!(
        describe_output(&output).contains("suit datagrams foreign_sender"),
        "{}",
        describe_output(&output)
    );

    // Truncated within a packet: the part before is read.
    let bytes = std::fs::read(&pcap).unwrap();
    std::fs::write(&pcap, &bytes[..bytes.len() / 2]).unwrap();
    let output = run(&[&"replay", &pcap]);
    assert_eq!(output.status.code(), Some(3), "{}", describe_output(&output));
    assert!(
        describe_output(&output).contains("the capture ends within the record"),
        "{}",
        describe_output(&output)
    );
}

#[test]
fn figaroh_rows_that_cannot_be_used_are_counted_and_the_others_are_replayed() {
    let Some(csv) = human_motion() else { return };
    let text = std::fs::read_to_string(csv).unwrap();
    let mut lines: Vec<String> = text.lines().take(300).map(str::to_owned).collect();
    lines[100] = lines[100].replacen("0.", "NaN", 1);
    lines[200].truncate(400);
    let directory = tempfile::tempdir().unwrap();
    let (damaged, mcap) = (directory.path().join("a.csv"), directory.path().join("a.mcap"));
    std::fs::write(&damaged, lines.join("\n")).unwrap();
    for arguments in [&[&"import" as &dyn AsRef<_>, &damaged, &"-o", &mcap][..], &[&"replay", &damaged]] {
        let output = run(arguments);
        assert_eq!(output.status.code(), Some(3), "{}", describe_output(&output));
        assert!(describe_output(&output).contains("rejected: rows left out"), "{}", describe_output(&output));
    }
    // The recording itself contains valid samples only.
    assert_eq!(run(&[&"replay", &mcap]).status.code(), Some(0));
    assert_eq!(samples(&mcap).0.len(), 297);
}

#[test]
fn read_errors_are_one_sentence() {
    let directory = tempfile::tempdir().unwrap();
    let file = |name: &str, content: &str| {
        let path = directory.path().join(name);
        std::fs::write(&path, content).unwrap();
        path
    };
    let out = directory.path().join("out.mcap");
    for (path, expected) in [
        (file("a.csv", "t_s,Fz_N\n0,1\n"), "no column Pelvis_px_m"),
        (file("a.pcap", "nonsense"), "not a capture"),
        (file("a.mcap", "nonsense"), "not a recording"),
        (file("a.txt", "nonsense"), "give a file that ends in"),
        (directory.path().join("missing.csv"), "cannot read"),
    ] {
        let output = run(&[&"replay", &path]);
        assert_eq!(output.status.code(), Some(1), "{}", describe_output(&output));
        assert!(
            describe_output(&output).contains(expected),
            "{}: {}",
            path.display(),
            describe_output(&output)
        );
        assert_eq!(run(&[&"import", &path, &"-o", &out]).status.code(), Some(1));
        assert!(!out.exists(), "nothing is made of {}", path.display());
    }
}
