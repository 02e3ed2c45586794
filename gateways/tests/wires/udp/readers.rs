//! The reference readers accept the gateway's datagrams, and reject everything else with the right reason.

use std::collections::HashMap;
use std::io::{BufRead as _, BufReader};
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use equipoise_client::{NoReading, Reading};
use equipoise_core::message::Validity;
use equipoise_gateways::gateway::Latest;
use equipoise_gateways::udp::encode::{CRC, Datagram, encode};

use crate::states::{reading, state};

const CLIENTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../clients");

/// A program that receives and prints a line for each datagram; killed when the test ends.
struct Reader {
    child: Child,
    lines: BufReader<ChildStdout>,
    port: u16,
}

impl Drop for Reader {
    fn drop(&mut self) {
        let _already_gone = self.child.kill();
        let _already_gone = self.child.wait();
    }
}

impl Reader {
    /// With "each" it prints a line per datagram, otherwise a line per second.
    fn start(program: &mut Command, each: &[&str]) -> Reader {
        program.args(["0", "cell-7", "60"]).args(each).stdout(Stdio::piped());
        let mut child = program.spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap());
        let mut reader = Reader { child, lines, port: 0 };
        let line = reader.line();
        reader.port = line.strip_prefix("listening on ").expect(&line).parse().unwrap();
        reader
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.lines.read_line(&mut line).unwrap();
        line.trim_end().to_owned()
    }

    /// Suspends the reader, as if it were busy, or resumes it.
    fn signal(&self, signal: &str) {
        let sent = Command::new("kill").args([signal, &self.child.id().to_string()]).status().unwrap();
        assert!(sent.success());
    }

    /// The first line whose cycle is at least `cycle`.
    fn line_from(&mut self, cycle: u64) -> HashMap<String, i64> {
        loop {
            let line = self.line();
            assert!(line.starts_with("state="), "{line}");
            let pairs = line.split(' ').filter_map(|pair| pair.split_once('='));
            let fields: HashMap<_, _> =
                pairs.filter_map(|(name, value)| Some((name.to_owned(), value.parse().ok()?))).collect();
            if fields["cycle"] >= cycle as i64 {
                return fields;
            }
        }
    }

    /// The reader's line for a datagram.
    fn said(&mut self, bytes: &[u8]) -> String {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.send_to(bytes, ("127.0.0.1", self.port)).unwrap();
        self.line()
    }
}

fn datagram(session_ns: u64, sequence: u64, latest: &Latest) -> Vec<u8> {
    encode(&Datagram::new("cell-7", session_ns, sequence, 1, latest)).to_vec()
}

/// A modified datagram with a correct checksum.
fn changed(bytes: &[u8], change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut bytes = bytes[..bytes.len() - 4].to_vec();
    change(&mut bytes);
    let crc = CRC.checksum(&bytes);
    bytes.extend(crc.to_le_bytes());
    bytes
}

/// Expected output of a reader for a datagram with all values valid.
fn taken(sequence: u64) -> String {
    let state = state();
    format!(
        "taken station=cell-7 sequence={sequence} status=0 cycle={} age_ns=1234567 valid=0 usable={} worst_joint=21 \
         level_21={} torque_21_z={:.3} reach={:.3} dose={:.3}",
        state.cycle,
        (1 << Validity::FLAG_SETS.len()) - 1,
        state.joint_level[21],
        state.torque_nm[21][2],
        state.reach_m,
        state.dose_probability
    )
}

fn ask(reader: &mut Reader) {
    let current = Ok(reading(state()));
    let later = 1_700_000_001_000_000_000;
    let good = |sequence| datagram(later, sequence, &current);
    assert_eq!(reader.said(&good(5)), taken(5));
    for (what, bytes, why) in [
        ("the same again", good(5), "old"),
        ("an earlier one", good(4), "old"),
        ("one of an earlier session", datagram(later - 1, 99, &current), "old"),
        ("nothing", Vec::new(), "length"),
        ("a few bytes", b"EQPU\x02\0".to_vec(), "length"),
        ("one cut short", good(6)[..900].to_vec(), "length"),
        ("one with more behind it", [good(6), vec![0]].concat(), "length"),
        ("one that says another length", changed(&good(6), |bytes| bytes[6] ^= 1), "length"),
        ("somebody else's", changed(&good(6), |bytes| bytes[0] = b'X'), "magic"),
        ("another version's", changed(&good(6), |bytes| bytes[4] += 1), "version"),
        ("another station's", changed(&good(6), |bytes| bytes[8] = b'b'), "station"),
    ] {
        assert_eq!(reader.said(&bytes), format!("refused={why}"), "{what}");
    }
    for bit in (8..good(6).len() * 8).step_by(1117) {
        let mut bytes = good(6);
        bytes[bit / 8] ^= 1 << (bit % 8);
        let said = reader.said(&bytes);
        assert!(
            ["magic", "version", "length", "crc"].map(|why| format!("refused={why}")).contains(&said),
            "{said}"
        );
    }
    assert_eq!(reader.said(&good(6)), taken(6), "what was refused has changed nothing");
    let silent = Err(NoReading::Silent { silent: Duration::from_millis(40) });
    let all = u64::MAX;
    assert_eq!(
        reader.said(&datagram(later, 7, &silent)),
        format!(
            "taken station=cell-7 sequence=7 status=1 cycle=0 age_ns={all} valid={all} usable=0 worst_joint={} \
             level_21=0 torque_21_z=0.000 reach=0.000 dose=0.000",
            u32::MAX
        )
    );
    assert_eq!(
        reader.said(&datagram(later + 1, 1, &current)),
        taken(1),
        "a later session counts from one again"
    );
}

fn compiled(scratch: &Path) -> PathBuf {
    let program = scratch.join("udp_controller");
    let mut compiler = Command::new(std::env::var_os("CC").unwrap_or("cc".into()));
    compiler.args(["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1", "-I"]);
    compiler.args([&format!("{CLIENTS}/c"), &format!("{CLIENTS}/c/udp_controller.c")]);
    compiler.arg(format!("{CLIENTS}/c/udp_reader.c")).arg("-o").arg(&program);
    let ended = compiler.output().expect("a C compiler: a permitted requirement of this workspace");
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    program
}

/// A simulated sender with one clock.
struct Sender {
    socket: UdpSocket,
    begun: Instant,
    sequence: u64,
}

impl Sender {
    fn new() -> Sender {
        Sender { socket: UdpSocket::bind("127.0.0.1:0").unwrap(), begun: Instant::now(), sequence: 0 }
    }

    /// Sends current states, 2 ms apart. The cycle equals the sequence number.
    fn send(&mut self, to: &Reader, datagrams: u64) {
        for _ in 0..datagrams {
            sleep(Duration::from_millis(2));
            self.sequence += 1;
            let mut state = state();
            state.cycle = self.sequence;
            state.time_ns = 3_600_000_000_000 + self.begun.elapsed().as_nanos() as u64;
            let latest = Ok(Reading { age_ns: 0, ..reading(state) });
            let bytes = datagram(1_700_000_001_000_000_000, self.sequence, &latest);
            self.socket.send_to(&bytes, ("127.0.0.1", to.port)).unwrap();
        }
    }
}

/// Both cases, at the same time: they wait most of the time.
fn busy(start: impl Fn() -> Reader + Sync) {
    std::thread::scope(|scope| {
        for before in [0, 20] {
            let start = &start;
            scope.spawn(move || busy_after(before, start()));
        }
    });
}

/// 50 datagrams wait for a second in the socket of a suspended reader, which has read `before` datagrams: it must output
/// the newest one, with its age.
fn busy_after(before: u64, mut reader: Reader) {
    let mut sender = Sender::new();
    sender.send(&reader, before);
    if before > 0 {
        let fields = reader.line_from(before);
        assert!(fields["age_ms"] >= 0 && fields["missed"] == 0, "{fields:?}");
    }
    reader.signal("-STOP");
    sender.send(&reader, 50);
    sleep(Duration::from_secs(1));
    reader.signal("-CONT");
    let fields = reader.line_from(before + 1);
    let all = before as i64 + 50;
    assert_eq!((fields["cycle"], fields["taken"], fields["missed"]), (all, all, 0), "{fields:?}");
    assert!(fields["age_ms"] >= 1000 && fields["speed_percent"] == 0, "{fields:?}");
    // Datagrams that then arrive without delay must not count as late.
    sender.send(&reader, 3);
    sleep(Duration::from_millis(50));
    let until = Instant::now();
    sender.send(&reader, 1);
    let fields = reader.line_from(before + 54);
    let since_ms = until.elapsed().as_millis() as i64;
    assert!(fields["age_ms"] <= since_ms + 500, "{fields:?}, sent {since_ms} ms ago at most");
}

#[test]
fn the_c_reader_says_how_long_a_datagram_has_waited() {
    let scratch = tempfile::tempdir().unwrap();
    let program = compiled(scratch.path());
    busy(|| Reader::start(&mut Command::new(&program), &[]));
}

#[test]
fn the_python_reader_says_how_long_a_datagram_has_waited() {
    if has_python() {
        busy(|| Reader::start(&mut python(), &[]));
    }
}

#[test]
fn the_c_reader_takes_and_refuses() {
    let scratch = tempfile::tempdir().unwrap();
    ask(&mut Reader::start(&mut Command::new(compiled(scratch.path())), &["each"]));
}

#[test]
fn the_python_reader_takes_and_refuses() {
    if has_python() {
        ask(&mut Reader::start(&mut python(), &["each"]));
    }
}

/// Python is optional for a local build, but required if `CI` is set.
fn has_python() -> bool {
    let is_there = Command::new("python3").arg("--version").output().is_ok();
    assert!(is_there || std::env::var_os("CI").is_none(), "no python3, and CI is set: install it");
    if !is_there {
        println!("skipped: no python3 here; .ci/run clients installs one");
    }
    is_there
}

fn python() -> Command {
    let mut program = Command::new("python3");
    program.arg(format!("{CLIENTS}/python/udp_controller.py")).env("PYTHONPATH", format!("{CLIENTS}/python"));
    program.env("PYTHONDONTWRITEBYTECODE", "1");
    program
}
