//! Files of a suit and a plate, of one session with two clocks: joined by clock, by stomps, by a given offset, or
//! refused with a reason.

use std::ffi::OsStr;
use std::fmt::Write;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Output;

use bytemuck::Zeroable;
use equipoise_adapters::capture::PcapWriter;
use equipoise_adapters::recording::{Entry, Recorder, Recording, RecordingHeader};
use equipoise_core::body::{Segment, Skeleton};
use equipoise_core::message::{GroundSample, SuitSample};

use crate::common::{describe_output, equipoise};

const SUIT_HZ: f64 = 240.0;
const PLATE_HZ: f64 = 1000.0;
/// Times of the foot's impacts on the plate, on the plate's clock, s: an irregular beat.
const STOMPS_S: [f64; 3] = [3.0, 4.3, 6.1];
/// Duration of the foot's deceleration, and its initial speed.
const STOP_S: f64 = 0.016;
const SPEED_M_PER_S: f64 = 1.5;
const MASS_KG: f64 = 5.0;
/// Time of the suit's first frame, ms since 1970.
const SUIT_UNIX_MS: u64 = 1_795_256_100_000;

const CONFIG: &str = r#"
station = "station-1"
[suit]
source = "mvn-udp"
[ground]
source = "external"
[ground.frame]
axes = "z-down"
surface_height_m = 0.048
[subject]
id = "anon-1"
height_m = 1.75
mass_kg = 71.0
"#;

/// The foot's upward velocity and the plate's vertical force at a time of the plate's clock.
fn stomp(time_s: f64) -> (f64, f64) {
    for hit_s in STOMPS_S {
        let since_s = time_s - hit_s;
        if (-0.15..0.0).contains(&since_s) {
            return (-SPEED_M_PER_S * (since_s + 0.15) / 0.15, 700.0);
        }
        if (0.0..STOP_S).contains(&since_s) {
            let phase = std::f64::consts::PI * since_s / STOP_S;
            let force_n = 0.5 * MASS_KG * SPEED_M_PER_S * std::f64::consts::PI / STOP_S * phase.sin();
            return (-0.5 * SPEED_M_PER_S * (1.0 + phase.cos()), 700.0 + force_n);
        }
    }
    (0.0, 700.0)
}

/// Eight seconds of a person in the T-pose whose left foot stamps; the first frame is at `begin_s` on the plate's
/// clock.
fn mvnx(path: &Path, begin_s: f64, head: &str) {
    let labels: Vec<&str> = Segment::ALL.into_iter().map(Segment::name).collect();
    let segments: String = labels.iter().map(|label| format!("<segment label=\"{label}\"/>")).collect();
    let turn = "1 0 0 0 ".repeat(labels.len());
    let place: String = Skeleton::nominal(1.75)
        .t_pose_m()
        .iter()
        .map(|[x, y, z]| format!("{x:.6} {y:.6} {:.6} ", z + 0.95))
        .collect();
    let pose = format!("<orientation>{turn}</orientation><position>{place}</position>");
    let mut text = format!(
        "<mvnx version=\"4\"><subject label=\"anon-1\" frameRate=\"{SUIT_HZ}\" {head}><segments>{segments}</segments>\
         <frames><frame type=\"identity\">{pose}</frame>\n"
    );
    for index in 0..(8.0 * SUIT_HZ) as usize {
        let time_s = index as f64 / SUIT_HZ;
        let ms = (time_s * 1e3).round() as u64;
        let mut velocity = vec![0.0; 3 * labels.len()];
        velocity[3 * Segment::LeftFoot.index() + 2] = stomp(begin_s + time_s).0;
        let velocity = velocity.iter().map(|number| format!("{number:.4} ")).collect::<String>();
        let still = "0 ".repeat(3 * labels.len());
        writeln!(
            text,
            "<frame time=\"{ms}\" index=\"{index}\" ms=\"{}\" type=\"normal\">{pose}<velocity>{velocity}</velocity>\
             <acceleration>{still}</acceleration></frame>",
            SUIT_UNIX_MS + ms
        )
        .unwrap();
    }
    text += "</frames></subject></mvnx>\n";
    std::fs::write(path, text).unwrap();
}

/// Ten seconds of the plate, in BioWare's format; its clock starts at `zero_s`.
fn plate(path: &Path, zero_s: f64, sign: f64, units: &str) {
    let mut text = format!("BioWare\n\nabs time\tFx\tFy\tFz\tMx\tMy\tMz\n{units}\n");
    for index in 0..(10.0 * PLATE_HZ) as usize {
        let time_s = index as f64 / PLATE_HZ;
        let force_n = sign * stomp(time_s).1;
        writeln!(text, "{:.4}\t0\t0\t{force_n:.3}\t0\t{:.3}\t0", zero_s + time_s, -0.05 * force_n).unwrap();
    }
    std::fs::write(path, text).unwrap();
}

const UNITS: &str = "s\tN\tN\tN\tN.m\tN.m\tN.m";

/// A folder with a configuration and both files; the suit's starts 1.25 s after the plate's.
struct Session {
    folder: tempfile::TempDir,
}

const LATER_S: f64 = 1.25;

impl Session {
    fn new() -> Session {
        let session = Session { folder: tempfile::tempdir().unwrap() };
        std::fs::write(session.file("lab.toml"), CONFIG).unwrap();
        mvnx(&session.file("take.mvnx"), LATER_S, "");
        plate(&session.file("plate.txt"), 0.0, 1.0, UNITS);
        session
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// `equipoise import FILE --with PLATE -o OUT --config lab.toml …`
    fn join(&self, out: &str, more: &[&str]) -> Output {
        self.join_files("take.mvnx", "plate.txt", out, more)
    }

    fn join_files(&self, suit: &str, plate: &str, out: &str, more: &[&str]) -> Output {
        let mut command = equipoise();
        command.arg("import").arg(self.file(suit)).arg("--with").arg(self.file(plate));
        command.arg("-o").arg(self.file(out)).arg("--config").arg(self.file("lab.toml"));
        command.args(more).output().unwrap()
    }

    /// The error message of a failed join; no output may remain.
    fn refused(&self, output: &Output) -> String {
        assert_eq!(output.status.code(), Some(1), "{}", describe_output(output));
        assert!(!self.file("no.mcap").exists());
        String::from_utf8_lossy(&output.stderr).into_owned()
    }

    fn samples(&self, out: &str) -> (Vec<SuitSample>, Vec<GroundSample>) {
        let (mut suit, mut ground) = (Vec::new(), Vec::new());
        let (recording, mut last_ns) = (Recording::open(self.file(out)).unwrap(), 0);
        for timed in recording.entries() {
            let timed = timed.unwrap();
            assert!(timed.log_time_ns >= last_ns, "in order of time");
            last_ns = timed.log_time_ns;
            match timed.entry {
                Entry::Suit(sample) => suit.push(*sample),
                Entry::Ground(sample) => ground.push(*sample),
                Entry::Body(body) => assert!(body.is_plausible()),
                other => panic!("{other:?}"),
            }
        }
        (suit, ground)
    }

    /// Time from the impact to the foot's maximum speed, on the recording's clock, s.
    fn offset_s(&self, out: &str) -> f64 {
        let (suit, ground) = self.samples(out);
        let foot = Segment::LeftFoot.index();
        let fall = |sample: &&SuitSample| sample.velocity_m_per_s[foot][2] < -0.97 * SPEED_M_PER_S;
        let fastest = suit.iter().find(fall).unwrap().sample_time_ns;
        let hit = ground.iter().find(|sample| sample.force_n[2] > 720.0).unwrap().sample_time_ns;
        (hit as f64 - fastest as f64) / 1e9
    }
}

#[test]
fn stomps_join_two_clocks() {
    let session = Session::new();
    let output = session.join("a.mcap", &["--join", "stomp"]);
    assert!(output.status.success(), "{}", describe_output(&output));
    let output_text = String::from_utf8_lossy(&output.stdout);
    assert!(output_text.contains("1920 suit and 10000 ground samples"), "{output_text}");
    assert!(
        output_text.contains("joined by 3 stomps (of 3 hits of the plate and 3 stops of a foot)"),
        "{output_text}"
    );
    assert!(output_text.contains("1-sigma"), "{output_text}");
    let found_s: f64 =
        output_text.split("suit + ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    // The contact here is a half sine: both instants are in its middle, to half a millisecond.
    assert!((found_s - LATER_S).abs() < 0.003, "{output_text}");
    assert!(session.offset_s("a.mcap").abs() < 0.010, "{}", session.offset_s("a.mcap"));
    let (suit, ground) = session.samples("a.mcap");
    assert_eq!((suit.len(), ground.len()), (1920, 10_000));
    assert!(ground.iter().all(|sample| sample.force_n[2] > 699.0));
    assert!((ground[0].cop_m().unwrap()[0] - 0.05).abs() < 1e-6, "about the sensor, z down");
    // The recording can be replayed.
    let output = equipoise().arg("replay").arg(session.file("a.mcap")).output().unwrap();
    assert!(output.status.success(), "{}", describe_output(&output));
}

#[test]
fn the_start_offset_of_suit_and_plate_is_preserved() {
    let session = Session::new();
    for begin_s in [-0.75, 0.5] {
        mvnx(&session.file("take.mvnx"), begin_s, "");
        let out = format!("{begin_s}.mcap");
        let output = session.join(&out, &["--join", &format!("offset={begin_s}")]);
        assert!(output.status.success(), "{}", describe_output(&output));
        assert!(session.offset_s(&out).abs() < 0.010, "{begin_s}: {}", session.offset_s(&out));
    }
    // A wrong offset is detected: the test can fail.
    let output = session.join("wrong.mcap", &["--join", "offset=0"]);
    assert!(output.status.success(), "{}", describe_output(&output));
    assert!((session.offset_s("wrong.mcap") - 0.5).abs() < 0.010);
}

#[test]
fn wall_clocks_join_two_files_that_have_one() {
    let session = Session::new();
    // The plate started 1.25 s before the suit.
    let output = session.join("a.mcap", &["--join", "clock", "--with-start", "2026-11-21T10:14:58.75Z"]);
    assert!(output.status.success(), "{}", describe_output(&output));
    assert!(String::from_utf8_lossy(&output.stdout).contains("joined by clock: suit + 1.2500 s = plate"));
    assert!(session.offset_s("a.mcap").abs() < 0.010);
    // The same with times since 1970, in a capture and in a text file.
    let zero_s = SUIT_UNIX_MS as f64 / 1e3 - LATER_S;
    plate(&session.file("unix.txt"), zero_s, 1.0, UNITS);
    let output = session.join_files("take.mvnx", "unix.txt", "b.mcap", &["--join", "clock"]);
    assert!(output.status.success(), "{}", describe_output(&output));
    assert!(session.offset_s("b.mcap").abs() < 0.010);

    let output_text = session.refused(&session.join("no.mcap", &["--join", "clock"]));
    assert!(
        output_text.contains("the plate's file does not say when it was; add --with-start"),
        "{output_text}"
    );
    let yesterday = ["--join", "clock", "--with-start", "2026-11-21T10:10:00Z"];
    let output_text = session.refused(&session.join("no.mcap", &yesterday));
    assert!(output_text.contains("no moment in common"), "{output_text}");
    let output_text = session
        .refused(&session.join("no.mcap", &["--join", "clock", "--with-start", "2020-01-01T00:00:00Z"]));
    assert!(output_text.contains("days apart; they are not of one session"), "{output_text}");
}

/// The plate's ten seconds as a recording, whose clock started long before.
fn plate_recording(path: &Path) {
    let started_ns = 86_400 * 1_000_000_000;
    let header = RecordingHeader {
        started_monotonic_ns: started_ns,
        started_unix_ns: SUIT_UNIX_MS * 1_000_000 - (LATER_S * 1e9) as u64,
        ..RecordingHeader::default()
    };
    let mut recorder = Recorder::create(path, &header).unwrap();
    for index in 0..(10.0 * PLATE_HZ) as u64 {
        let time_s = index as f64 / PLATE_HZ;
        let time_ns = started_ns + index * (1e9 / PLATE_HZ) as u64;
        let sample = GroundSample {
            sequence: index,
            sample_time_ns: time_ns,
            arrival_ns: time_ns,
            published_ns: time_ns,
            force_n: [0.0, 0.0, stomp(time_s).1],
            ..Zeroable::zeroed()
        };
        recorder.write(time_ns, &sample).unwrap();
    }
    recorder.finish().unwrap();
}

#[test]
fn a_suit_file_is_joined_with_a_recording_of_the_plate() {
    let session = Session::new();
    plate_recording(&session.file("plate.mcap"));
    for (index, join) in ["stomp", "clock", "offset=1.25"].into_iter().enumerate() {
        let out = format!("{index}.mcap");
        let output = session.join_files("take.mvnx", "plate.mcap", &out, &["--join", join]);
        assert!(output.status.success(), "{join}: {}", describe_output(&output));
        let output_text = String::from_utf8_lossy(&output.stdout);
        assert!(
            output_text.contains("s = plate") && output_text.contains("; 7.996 s in common"),
            "{output_text}"
        );
        assert!(session.offset_s(&out).abs() < 0.010, "{join}: {}", session.offset_s(&out));
        let (suit, ground) = session.samples(&out);
        assert_eq!((suit.len(), ground.len()), (1920, 10_000));
        // Ordered by delivery, in one time base.
        assert!(ground[0].arrival_ns < 2_000_000_000, "{join}: {}", ground[0].arrival_ns);
        let output = equipoise().arg("replay").arg(session.file(&out)).output().unwrap();
        assert!(output.status.success(), "{join}: {}", describe_output(&output));
    }
}

#[test]
fn a_file_without_a_usable_sample_is_refused_with_the_counted_reasons() {
    let session = Session::new();
    let join = ["--join", "offset=0"];
    let [suit, station] = ["10.0.0.7:50123", "10.0.0.2:9763"].map(|text| text.parse::<SocketAddr>().unwrap());
    let mut writer = PcapWriter::create(session.file("damaged.pcap")).unwrap();
    for index in 0..7 {
        writer.write_udp(SUIT_UNIX_MS * 1_000_000 + index, suit, station, b"MXTP02").unwrap();
    }
    writer.finish().unwrap();
    let output_text = session.refused(&session.join_files("damaged.pcap", "plate.txt", "no.mcap", &join));
    assert!(output_text.contains("the first file has no sample of the suit"), "{output_text}");
    assert!(output_text.contains("rejected: 7 suit datagrams too_short"), "{output_text}");

    let mut recorder = Recorder::create(session.file("damaged.mcap"), &RecordingHeader::default()).unwrap();
    for time_ns in 1..6 {
        let sample =
            GroundSample { sample_time_ns: time_ns, force_n: [0.0, 0.0, f64::NAN], ..Zeroable::zeroed() };
        recorder.write(time_ns, &sample).unwrap();
    }
    recorder.finish().unwrap();
    let output_text = session.refused(&session.join_files("take.mvnx", "damaged.mcap", "no.mcap", &join));
    assert!(output_text.contains("the file given with --with has no sample of the plate"), "{output_text}");
    assert!(output_text.contains("rejected: 5 messages hold numbers that are not finite"), "{output_text}");
}

#[test]
fn a_suit_capture_is_joined_with_a_text_file_of_the_plate() {
    use equipoise_adapters::wire::mvn::{Header, SegmentPose, pose_quaternion};
    let session = Session::new();
    let address = |text: &str| text.parse::<SocketAddr>().unwrap();
    let mut writer = PcapWriter::create(session.file("take.pcap")).unwrap();
    let begin_ns = SUIT_UNIX_MS * 1_000_000;
    let origins = Skeleton::nominal(1.75).t_pose_m();
    for counter in 0..480_u32 {
        let poses: Vec<_> = (1_u32..)
            .zip(origins)
            .map(|(segment_id, [x, y, z])| SegmentPose {
                segment_id,
                position_m: [x as f32, y as f32, z as f32 + 0.95],
                orientation_wxyz: [1.0, 0.0, 0.0, 0.0],
            })
            .collect();
        let mut datagram = Vec::new();
        pose_quaternion::encode(&Header::new(counter, 0, 0), &poses, &mut datagram).unwrap();
        let at_ns = begin_ns + u64::from(counter) * 4_166_667;
        writer.write_udp(at_ns, address("10.0.0.7:50123"), address("10.0.0.2:9763"), &datagram).unwrap();
    }
    writer.finish().unwrap();
    plate(&session.file("unix.txt"), SUIT_UNIX_MS as f64 / 1e3 - LATER_S, 1.0, UNITS);
    let output = session.join_files("take.pcap", "unix.txt", "a.mcap", &["--join", "clock"]);
    assert!(output.status.success(), "{}", describe_output(&output));
    assert!(
        String::from_utf8_lossy(&output.stdout).contains("joined by clock: suit + 1.2500 s = plate"),
        "{}",
        describe_output(&output)
    );
    assert_eq!(session.samples("a.mcap").1.len(), 10_000);
    // It contains no stomp.
    let output_text =
        session.refused(&session.join_files("take.pcap", "plate.txt", "no.mcap", &["--join", "stomp"]));
    assert!(output_text.contains("the suit measured no stomp"), "{output_text}");
}

#[test]
fn a_ground_of_any_kind_that_sends_datagrams_is_read_from_a_capture() {
    let session = Session::new();
    let config = CONFIG
        .replace("source = \"external\"", "source = \"moticon-udp\"\nlisten = \"127.0.0.1:8888\"")
        .replace(
            "[ground.frame]",
            "[ground.moticon]\nlength_m = 0.25\nwidth_m = 0.09\ny_to = \"medial\"\n[ground.frame]",
        );
    std::fs::write(session.file("lab.toml"), config).unwrap();
    let address = |text: &str| text.parse::<SocketAddr>().unwrap();
    let mut writer = PcapWriter::create(session.file("soles.pcap")).unwrap();
    for index in 0..100_u32 {
        let foot = "0 0 0 0 0 0 0.1 -0.1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 350.0";
        let line = format!("{:.2} {foot} {foot}", f64::from(index) * 0.01);
        let at_ns = SUIT_UNIX_MS * 1_000_000 + u64::from(index) * 10_000_000;
        writer
            .write_udp(at_ns, address("10.0.0.7:50123"), address("10.0.0.2:8888"), line.as_bytes())
            .unwrap();
    }
    writer.finish().unwrap();
    let mut command = equipoise();
    command.arg("import").arg(session.file("soles.pcap")).arg("-o").arg(session.file("a.mcap"));
    let output = command.arg("--config").arg(session.file("lab.toml")).output().unwrap();
    assert!(output.status.success(), "{}", describe_output(&output));
    let ground = session.samples("a.mcap").1;
    assert_eq!(ground.len(), 100);
    assert!(ground.iter().all(|sample| sample.per_foot == 1 && sample.force_n == [0.0, 0.0, 700.0]));
}

#[test]
fn incompatible_files_are_refused_with_a_reason() {
    let session = Session::new();
    let output_text = session.refused(&session.join("no.mcap", &["--join", "stomp", "--within", "0.5"]));
    assert!(output_text.contains("--within S bounds the offset"), "{output_text}");
    plate(&session.file("bare.txt"), 0.0, 1.0, "");
    let output_text =
        session.refused(&session.join_files("take.mvnx", "bare.txt", "no.mcap", &["--join", "stomp"]));
    assert!(output_text.contains("has no unit of time; declare the units"), "{output_text}");
    let declared = ["--join", "stomp", "--with-units", "s,N,N.m"];
    let output = session.join_files("take.mvnx", "bare.txt", "declared.mcap", &declared);
    assert!(output.status.success(), "{}", describe_output(&output));
    mvnx(&session.file("half.mvnx"), LATER_S, "configuration=\"UpperBody\"");
    let output_text =
        session.refused(&session.join_files("half.mvnx", "plate.txt", "no.mcap", &["--join", "stomp"]));
    assert!(output_text.contains("worn as UpperBody"), "{output_text}");

    // The plate's pose is not assumed.
    let arguments: [&OsStr; 5] =
        ["--with".as_ref(), "x.txt".as_ref(), "--join".as_ref(), "stomp".as_ref(), "-o".as_ref()];
    let mut command = equipoise();
    command.arg("import").arg(session.file("take.mvnx")).args(arguments).arg(session.file("no.mcap"));
    let output_text = session.refused(&command.output().unwrap());
    assert!(output_text.contains("--with needs --config"), "{output_text}");
    // Invalid usage: one option without the other, an unknown method.
    for more in [&["--join", "hope"][..], &[], &["--join", "clock", "--with-units", "stone"]] {
        assert_eq!(session.join("no.mcap", more).status.code(), Some(2), "{more:?}");
    }
    // A plate with a pulling person: imported, with a warning.
    plate(&session.file("pulls.txt"), 0.0, -1.0, UNITS);
    let output = session.join_files("take.mvnx", "pulls.txt", "pulls.mcap", &["--join", "offset=1.25"]);
    assert_eq!(output.status.code(), Some(3), "{}", describe_output(&output));
    assert!(
        String::from_utf8_lossy(&output.stdout).contains("the person pulls the plate up"),
        "{}",
        describe_output(&output)
    );
}

#[test]
fn a_suit_alone_is_imported_too_and_a_cut_file_is_reported() {
    let session = Session::new();
    let import = |name: &str, out: &str| {
        equipoise().arg("import").arg(session.file(name)).arg("-o").arg(session.file(out)).output().unwrap()
    };
    let output = import("take.mvnx", "a.mcap");
    assert!(output.status.success(), "{}", describe_output(&output));
    assert!(String::from_utf8_lossy(&output.stdout).contains("1920 suit and 0 ground samples over 7.996 s"));
    let text = std::fs::read_to_string(session.file("take.mvnx")).unwrap();
    std::fs::write(session.file("cut.mvnx"), &text[..text.len() / 2]).unwrap();
    let output = import("cut.mvnx", "b.mcap");
    assert_eq!(output.status.code(), Some(3), "{}", describe_output(&output));
    let output_text = String::from_utf8_lossy(&output.stdout);
    assert!(
        output_text.contains("rejected: line ") && output_text.contains("the frames before it were read"),
        "{output_text}"
    );
    std::fs::write(session.file("none.mvnx"), "<html></html>").unwrap();
    assert_eq!(import("none.mvnx", "c.mcap").status.code(), Some(1));
}
