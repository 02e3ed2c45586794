//! The tested adapters, each with its device, and checks that are not applicable.

use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;

use equipoise_simulator::devices::Device;
use equipoise_simulator::devices::amti::Amti;
use equipoise_simulator::devices::ati_rdt::AtiRdt;
use equipoise_simulator::devices::binary::Binary;
use equipoise_simulator::devices::bota::Bota;
use equipoise_simulator::devices::labamp::LabAmp;
use equipoise_simulator::devices::line::Line;
use equipoise_simulator::devices::load::{Ground, Mounting};
use equipoise_simulator::devices::lsl::Lsl;
use equipoise_simulator::devices::moticon::Moticon;
use equipoise_simulator::devices::mvn::Mvn;
use equipoise_simulator::devices::pair::Pair;
use equipoise_simulator::devices::qtm::Qtm;
use equipoise_simulator::devices::serial::SerialPort;
use equipoise_simulator::devices::tcp::{TcpOutPort, TcpPort};
use equipoise_simulator::devices::tec_gihan::TecGihan;
use equipoise_simulator::devices::text::Text;
use equipoise_simulator::devices::udp::UdpPort;
use equipoise_simulator::faults::Faults;
use equipoise_simulator::plate::Plate;
use equipoise_simulator::ports::free_address;
use equipoise_simulator::suit_sender::Streams;
use equipoise_simulator::wires::ati_rdt::Family;
use equipoise_simulator::wires::moticon::ALL;
use equipoise_simulator::wires::text::Style;

use crate::person::Person;
use crate::questions::Question;

/// A device, and its parts under the person.
pub(crate) struct Built {
    pub(crate) device: Box<dyn Device>,
    pub(crate) ground: Ground,
}

/// One tested adapter.
#[derive(Clone, Copy)]
pub(crate) struct Case {
    /// Its name in the configuration, with special conditions.
    pub(crate) name: &'static str,
    pub(crate) build: fn(&Path, &Arc<Person>) -> Built,
    pub(crate) rate_hz: f64,
    /// Maximum delay from measurement to sending, s.
    pub(crate) jitter_s: f64,
    /// Tolerances of a sample, N and m.
    pub(crate) tolerance: (f64, f64),
    /// Each foot is reported separately.
    pub(crate) feet: bool,
    /// Fraction of lost packets.
    pub(crate) loss: f64,
    /// Faults of packets in the garbage check.
    pub(crate) garbage: Faults,
    /// The refusal reasons under which they must be counted.
    pub(crate) reasons: &'static [&'static str],
    pub(crate) not_tested: &'static [(Question, &'static str)],
    /// A baud rate other than the device's, or the reason why none can be configured.
    pub(crate) wrong_baud: Result<u32, &'static str>,
}

impl Case {
    /// The reason why a check is not applicable.
    pub(crate) fn reason_not_tested(&self, question: Question) -> Option<&'static str> {
        let speed = self.wrong_baud.err().filter(|_| question == Question::Speed);
        speed.or_else(|| self.not_tested.iter().find(|(not, _)| *not == question).map(|(_, reason)| *reason))
    }
}

const NOTHING: Faults =
    Faults { loss: 0.0, reorder: 0.0, duplicate: 0.0, corrupt: 0.0, truncate: 0.0, garbage: 0.0, chop: 0.0 };

const NO_COUNT: &str = "The device sends no counter: loss is inferred from sample times.";
const HOST_POLLS: &str = "The adapter requests each block, and repeats the request without a response.";
const NO_FRAMES: &str = "Blocks have no header, counter or checksum: only a wrong length is detected.";
const MANY_DATAGRAMS: &str =
    "A sample consists of a dozen datagrams, and is assembled from those that arrive.";
const NO_LINE: &str = "There is no serial line.";
const OWN_SPEEDS: &str = "The dialogue sets the speed; none can be configured.";
const FUSED: &str = "Tested for each device alone, above.";

const CASE: Case = Case {
    name: "",
    build: rdt,
    rate_hz: 100.0,
    jitter_s: 0.002,
    tolerance: (2.0, 0.002),
    feet: false,
    loss: 0.05,
    garbage: Faults { garbage: 0.1, chop: 1.0, ..NOTHING },
    reasons: &["garbage"],
    not_tested: &[],
    wrong_baud: Err(NO_LINE),
};

pub(crate) const CASES: &[Case] = &[
    Case {
        name: "mvn-udp",
        build: mvn_udp,
        rate_hz: 60.0,
        garbage: Faults { garbage: 0.1, truncate: 0.1, duplicate: 0.1, ..NOTHING },
        reasons: &["not_mvn", "length", "duplicate"],
        ..CASE
    },
    Case { name: "mvn-tcp", build: mvn_tcp, rate_hz: 60.0, reasons: &["out_of_step"], ..CASE },
    Case {
        name: "mvn-udp, all types, gloves and a prop",
        build: mvn_everything,
        rate_hz: 60.0,
        garbage: Faults { garbage: 0.1, truncate: 0.1, duplicate: 0.1, ..NOTHING },
        reasons: &["not_mvn", "length", "duplicate"],
        not_tested: &[(Question::Loss, MANY_DATAGRAMS)],
        ..CASE
    },
    Case {
        name: "mvn-tcp, Euler angles only",
        build: mvn_euler,
        rate_hz: 60.0,
        reasons: &["out_of_step"],
        ..CASE
    },
    Case {
        name: "mvn-udp, Unity only",
        build: mvn_unity,
        rate_hz: 60.0,
        garbage: Faults { garbage: 0.1, truncate: 0.1, duplicate: 0.1, ..NOTHING },
        reasons: &["not_mvn", "length", "duplicate"],
        ..CASE
    },
    Case {
        name: "ati-rdt, Net F/T",
        build: rdt,
        rate_hz: 1000.0,
        garbage: Faults { garbage: 0.1, truncate: 0.1, duplicate: 0.1, reorder: 0.1, ..NOTHING },
        reasons: &["length", "duplicate", "out_of_order"],
        ..CASE
    },
    Case {
        name: "ati-rdt, Axia, pounds, scale of its page",
        build: axia,
        rate_hz: 1000.0,
        garbage: Faults { garbage: 0.1, truncate: 0.1, duplicate: 0.1, reorder: 0.1, ..NOTHING },
        reasons: &["length", "duplicate", "out_of_order"],
        ..CASE
    },
    Case {
        name: "amti-serial",
        build: amti,
        rate_hz: 100.0,
        // A count of a vertical gauge is 0.4 N, at a lever of 18 cm.
        tolerance: (3.0, 0.003),
        reasons: &["garbage"],
        not_tested: &[(Question::Loss, NO_COUNT)],
        wrong_baud: Err(OWN_SPEEDS),
        ..CASE
    },
    Case {
        name: "bota-serial",
        build: bota,
        wrong_baud: Ok(115_200),
        rate_hz: 200.0,
        garbage: Faults { garbage: 0.1, corrupt: 0.1, truncate: 0.1, chop: 1.0, ..NOTHING },
        reasons: &["garbage", "checksum"],
        ..CASE
    },
    Case {
        name: "ati-rdt and ati-rdt, a foot on each",
        build: two_rdt,
        feet: true,
        rate_hz: 500.0,
        not_tested: &[(Question::Loss, FUSED), (Question::Garbage, FUSED), (Question::Reasons, FUSED)],
        ..CASE
    },
    Case { name: "qtm", build: qtm, rate_hz: 1000.0, reasons: &["garbage"], ..CASE },
    Case {
        name: "kistler-labamp",
        build: labamp,
        rate_hz: 1000.0,
        loss: 0.2,
        garbage: Faults { garbage: 0.5, chop: 1.0, ..NOTHING },
        reasons: &["garbage or version"],
        ..CASE
    },
    Case {
        name: "tec-gihan",
        build: tec_gihan,
        wrong_baud: Ok(115_200),
        rate_hz: 2500.0,
        // Resolution: a tenth of a newton, and a hundredth of a newton metre.
        not_tested: &[
            (Question::Loss, HOST_POLLS),
            (Question::Garbage, NO_FRAMES),
            (Question::Reasons, NO_FRAMES),
        ],
        ..CASE
    },
    Case {
        name: "moticon-udp",
        build: moticon,
        feet: true,
        rate_hz: 100.0,
        // Resolution: a tenth of a newton, a ten-thousandth of the insole.
        garbage: Faults { garbage: 0.1, truncate: 0.1, duplicate: 0.1, ..NOTHING },
        reasons: &["fields"],
        ..CASE
    },
    Case {
        name: "text, serial",
        build: text_serial,
        wrong_baud: Ok(57_600),
        rate_hz: 100.0,
        reasons: &["fields"],
        ..CASE
    },
    Case {
        name: "text, TCP",
        build: text_tcp,
        rate_hz: 100.0,
        // Lines without their prefix are ignored; a truncated one is refused.
        garbage: Faults { garbage: 0.1, truncate: 0.1, chop: 1.0, ..NOTHING },
        reasons: &["fields"],
        ..CASE
    },
    Case {
        name: "text, UDP",
        build: text_udp,
        rate_hz: 100.0,
        garbage: Faults { garbage: 0.1, truncate: 0.1, duplicate: 0.1, ..NOTHING },
        reasons: &["fields", "duplicate"],
        ..CASE
    },
    Case {
        name: "lsl, found by its name",
        build: lsl_found,
        rate_hz: 100.0,
        not_tested: &[(Question::Loss, NO_COUNT)],
        ..CASE
    },
    Case { name: "lsl", build: lsl, rate_hz: 100.0, not_tested: &[(Question::Loss, NO_COUNT)], ..CASE },
    Case {
        name: "binary, serial",
        build: binary_serial,
        wrong_baud: Ok(57_600),
        rate_hz: 200.0,
        garbage: Faults { garbage: 0.1, corrupt: 0.1, truncate: 0.1, chop: 1.0, ..NOTHING },
        reasons: &["garbage", "checksum"],
        ..CASE
    },
    Case {
        name: "binary, TCP",
        build: binary_tcp,
        rate_hz: 200.0,
        garbage: Faults { garbage: 0.1, corrupt: 0.1, truncate: 0.1, chop: 1.0, ..NOTHING },
        reasons: &["garbage", "checksum"],
        ..CASE
    },
    Case {
        name: "ati-rdt and moticon-udp",
        build: plate_and_insoles,
        feet: true,
        rate_hz: 100.0,
        not_tested: &[(Question::Loss, FUSED), (Question::Garbage, FUSED), (Question::Reasons, FUSED)],
        ..CASE
    },
];

fn serial(folder: &Path, seed: u64) -> Line {
    // The device itself sets its baud rate.
    Line::new(Box::new(SerialPort::new(&folder.join("plate"), 9600).unwrap()), seed)
}

fn tcp(seed: u64) -> Line {
    Line::new(Box::new(TcpPort::bind(loopback()).unwrap()), seed)
}

fn udp(seed: u64) -> Line {
    Line::new(Box::new(UdpPort::to(free_address().unwrap()).unwrap()), seed)
}

fn amti(folder: &Path, _: &Arc<Person>) -> Built {
    one(Amti::new(serial(folder, 5), 1, Z_DOWN()), Z_DOWN())
}

fn bota(folder: &Path, _: &Arc<Person>) -> Built {
    one(Bota::new(serial(folder, 6), Z_UP()), Z_UP())
}

fn labamp(_: &Path, _: &Arc<Person>) -> Built {
    one(LabAmp::bind(loopback(), Z_DOWN(), 1000.0, 7).unwrap(), Z_DOWN())
}

fn tec_gihan(folder: &Path, _: &Arc<Person>) -> Built {
    one(TecGihan::new(serial(folder, 8), 1, Z_DOWN()), Z_DOWN())
}

fn moticon(_: &Path, person: &Arc<Person>) -> Built {
    one(Moticon::new(udp(9), &ALL, 100.0, person.sole_size_m()), Z_UP())
}

fn text_serial(folder: &Path, _: &Arc<Person>) -> Built {
    one(Text::new(serial(folder, 10), Style::default(), 100.0, Z_UP()), Z_UP())
}

fn text_tcp(_: &Path, _: &Arc<Person>) -> Built {
    let style = Style { delimiter: ';', decimal: ',', prefix: "F:".into(), end: "\r\n".into(), decimals: 4 };
    one(Text::new(tcp(11), style, 100.0, Z_UP()), Z_UP())
}

fn text_udp(_: &Path, _: &Arc<Person>) -> Built {
    let style = Style { delimiter: '\t', end: String::new(), ..Style::default() };
    let reaction = Mounting { reaction: true, ..Z_UP() };
    one(Text::new(udp(12), style, 100.0, reaction), reaction)
}

fn binary_serial(folder: &Path, _: &Arc<Person>) -> Built {
    one(Binary::new(serial(folder, 13), 200.0, Z_UP()), Z_UP())
}

fn binary_tcp(_: &Path, _: &Arc<Person>) -> Built {
    one(Binary::new(tcp(17), 200.0, Z_DOWN()), Z_DOWN())
}

fn plate_and_insoles(_: &Path, person: &Arc<Person>) -> Built {
    let plate = AtiRdt::bind(loopback(), loopback(), Z_UP(), Family::NetFt, 100.0, 19).unwrap();
    let insoles = Moticon::new(udp(20), &ALL, 100.0, person.sole_size_m());
    one(Pair::with_insoles(Box::new(plate), Box::new(insoles)), Z_UP())
}

fn lsl(_: &Path, _: &Arc<Person>) -> Built {
    one(Lsl::bind("Plate", loopback(), Z_UP(), 100.0, false, 14).unwrap(), Z_UP())
}

fn lsl_found(_: &Path, _: &Arc<Person>) -> Built {
    // A unique name: other tests may run at the same time.
    let name = format!("Plate of process {}", std::process::id());
    one(Lsl::bind(&name, loopback(), Z_UP(), 100.0, true, 16).unwrap(), Z_UP())
}

fn two_rdt(_: &Path, _: &Arc<Person>) -> Built {
    let at = |y_m: f64| Mounting { plate: Plate { origin_m: [0.1, y_m, -0.04], ..plate() }, ..Z_UP() };
    let mountings = [at(0.2), at(-0.2)];
    let [left, right] = mountings.map(|mounting| {
        Box::new(AtiRdt::bind(loopback(), loopback(), mounting, Family::NetFt, 500.0, 15).unwrap())
    });
    Built { device: Box::new(Pair::new(left, right)), ground: Ground::Two(mountings) }
}

fn loopback() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 0))
}

/// A plate displaced and rotated, its sensor below its surface.
fn plate() -> Plate {
    Plate { origin_m: [0.15, -0.08, -0.04], yaw_rad: 0.35, surface_height_m: 0.04, ..Plate::default() }
}

const Z_UP: fn() -> Mounting = || Mounting { plate: plate(), ..Mounting::default() };
const Z_DOWN: fn() -> Mounting = || Mounting { plate: plate(), z_down: true, reaction: false };

fn one(device: impl Device + 'static, mounting: Mounting) -> Built {
    Built { device: Box::new(device), ground: Ground::One(mounting) }
}

fn axia(_: &Path, _: &Arc<Person>) -> Built {
    // A count scale other than the configuration's default.
    let counted = Plate { counts_per_unit: [5e5, 2e6], ..plate() };
    let mounting = || Mounting { plate: counted, ..Mounting::default() };
    let device = AtiRdt::bind(loopback(), loopback(), mounting(), Family::Axia, 1000.0, 9).unwrap();
    one(device.in_pounds(), mounting())
}

fn rdt(_: &Path, _: &Arc<Person>) -> Built {
    let device = AtiRdt::bind(loopback(), loopback(), Z_UP(), Family::NetFt, 1000.0, 1).unwrap();
    one(device, Z_UP())
}

fn qtm(_: &Path, _: &Arc<Person>) -> Built {
    let line = Line::new(Box::new(TcpPort::bind(loopback()).unwrap()), 2);
    one(Qtm::new(line, 1, Z_DOWN()), Z_DOWN())
}

fn mvn(line: Line, streams: Streams, person: &Arc<Person>) -> Built {
    let source = Arc::clone(person);
    let frame_source =
        Box::new(move |time_s, counter, device_ms| source.suit_frame(streams, time_s, counter, device_ms));
    one(Mvn::new(line, 60.0, frame_source, person.introduction()), Z_UP())
}

fn mvn_udp(_: &Path, person: &Arc<Person>) -> Built {
    mvn(udp(3), Streams::NONE, person)
}

fn mvn_tcp(_: &Path, person: &Arc<Person>) -> Built {
    mvn(Line::new(Box::new(TcpOutPort::to(free_address().unwrap())), 4), Streams::NONE, person)
}

fn mvn_everything(_: &Path, person: &Arc<Person>) -> Built {
    let streams = Streams { fingers: true, props: 1, ..Streams::ALL };
    mvn(udp(21), streams, person)
}

fn mvn_euler(_: &Path, person: &Arc<Person>) -> Built {
    let streams = Streams { without_quaternions: true, euler: true, ..Streams::NONE };
    mvn(Line::new(Box::new(TcpOutPort::to(free_address().unwrap())), 22), streams, person)
}

fn mvn_unity(_: &Path, person: &Arc<Person>) -> Built {
    let streams = Streams { without_quaternions: true, unity: true, ..Streams::NONE };
    mvn(udp(23), streams, person)
}
