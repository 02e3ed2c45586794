//! What a station is like now: who holds its ports, what its suit and plate bring.

use std::collections::BTreeSet;
use std::io;
use std::net::{SocketAddr, TcpListener, UdpSocket};
use std::time::{Duration, Instant};

use equipoise_adapters::suit::SuitRefusal;
use equipoise_adapters::wire::mvn::{Datagram, DatagramType, Header};
use equipoise_bus::{Bus, BusError, BusSettings, Participant};
use equipoise_core::message::suit::SuitBlocks;
use equipoise_core::message::{AdapterHealth, State, SuitSample, Validity};

use crate::config::{Config, SuitSourceKind};
use crate::page_feed::PAGE_ROLE;
use crate::pipeline::DAEMON_ROLE;
use crate::sensors::SUIT_ROLE;

/// How long sensors are listened to. Long enough for a word of both adapters, which comes once a second.
const LISTEN: Duration = Duration::from_millis(2500);
/// A reason is told once it has cost so many of all datagrams; a few come with every start.
const REFUSED_SHARE_MIN: f64 = 0.01;
/// The largest datagram there is.
const DATAGRAM_MAX: usize = 65_536;

/// The station, as far as it could be seen.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StationFacts {
    /// Process of the running daemon.
    pub daemon: Option<u32>,
    /// Whether the suit's port can be had.
    pub suit_port: Port,
    /// The same for the page's, if there is to be one.
    pub page_port: Option<Port>,
    /// The same for the metrics'.
    pub metrics_port: Option<Port>,
    /// What the suit sends; `None` if nothing was heard.
    pub streamed: Option<Streamed>,
    /// Vertical force on the plate, N; `None` if it is not known.
    pub plate_shows_n: Option<f64>,
}

/// Whether a port can be had.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Port {
    /// Nobody has it.
    #[default]
    Free,
    /// A process of this station has it.
    Ours,
    /// Somebody else has it.
    Taken,
    /// Its address is not of this computer.
    NotOurs,
}

/// What was heard of the suit.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Streamed {
    /// Samples a second.
    pub rate_hz: f64,
    /// Poses come as quaternions (type 02).
    pub quaternions: bool,
    /// Poses come as Euler angles (type 01).
    pub euler: bool,
    /// What else comes, in words.
    pub others: Vec<String>,
    /// Characters seen; empty if only the configured one can be.
    pub avatars: Vec<u8>,
    /// What the adapter refused since its start, by reason.
    pub refused: Vec<(String, u64)>,
}

impl StationFacts {
    /// Looks at a configuration's station: asks the running daemon, or else listens on the suit's port itself.
    ///
    /// # Errors
    /// The bus cannot be joined.
    pub fn gather(config: &Config) -> Result<StationFacts, BusError> {
        let bus = Bus::join(&BusSettings::new(&config.station, "doctor"))?;
        let participants = bus.participants()?;
        let of_role = |role: &str| participants.iter().find(|one| one.role == role).map(|one| one.process_id);
        // Each port by whoever is to have it: a page's is not the station's because the suit's adapter took it.
        let of = |bound: io::Result<()>, roles: &[&str], tables, address| match port_of(bound) {
            Port::Taken if holds(&processes_of(&participants, roles), &sockets_at(tables, address)) => {
                Port::Ours
            }
            found => found,
        };
        let tcp = |roles, address| of(TcpListener::bind(address).map(drop), roles, TCP, address);
        let suit = config.suit.listen;
        let mut facts = StationFacts {
            daemon: of_role(DAEMON_ROLE),
            suit_port: of(UdpSocket::bind(suit).map(drop), &[DAEMON_ROLE, SUIT_ROLE], UDP, suit),
            page_port: config.page.as_ref().map(|page| tcp(&[PAGE_ROLE], page.listen)),
            metrics_port: config.metrics.as_ref().map(|metrics| tcp(&[DAEMON_ROLE], metrics.listen)),
            ..StationFacts::default()
        };
        if facts.daemon.is_some() {
            facts.ask(&bus)?;
        } else if config.suit.source == SuitSourceKind::MvnUdp && facts.suit_port == Port::Free {
            facts.streamed = UdpSocket::bind(config.suit.listen).ok().and_then(|socket| listen(&socket));
        }
        Ok(facts)
    }

    /// What a running daemon's station shows on the bus.
    fn ask(&mut self, bus: &Bus) -> Result<(), BusError> {
        let mut states = bus.subscriber::<State>(1)?;
        let mut suit = bus.subscriber::<SuitSample>(64)?;
        let mut health = bus.subscriber::<AdapterHealth>(8)?;
        let (mut blocks, mut told, begun) = (None::<u32>, None, Instant::now());
        while begun.elapsed() < LISTEN {
            while let Some(sample) = suit.receive()? {
                blocks = Some(blocks.unwrap_or(0) | sample.blocks);
            }
            while let Some(adapter) = health.receive()? {
                told = Some(adapter).filter(|adapter| adapter.stream == 1).or(told);
            }
            if let Some(state) = states.latest()? {
                let known = state.unless(Validity::SPOILS_GROUND_FORCE, state.ground_force_n[2]);
                self.plate_shows_n = known.or(self.plate_shows_n);
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let Some(told) = told.filter(|told| told.received > 0) else { return Ok(()) };
        let sent = |block: SuitBlocks| blocks.unwrap_or(0) & block as u32 != 0;
        let others = [
            (SuitBlocks::JointAngles, "joint angles (20)"),
            (SuitBlocks::LinearKinematics, "linear kinematics (21)"),
            (SuitBlocks::AngularKinematics, "angular kinematics (22)"),
            (SuitBlocks::CentreOfMass, "centre of mass (24)"),
        ];
        let is_much = |count: u64| count as f64 > REFUSED_SHARE_MIN * told.received as f64;
        let refused = SuitRefusal::NAMES.iter().zip(told.refused);
        self.streamed = Some(Streamed {
            rate_hz: told.rate_hz,
            // A sample does not say which of both its pose came as; there is one.
            quaternions: blocks.is_some(),
            euler: false,
            others: others
                .into_iter()
                .filter(|(block, _)| sent(*block))
                .map(|(_, name)| name.to_owned())
                .collect(),
            avatars: vec![],
            refused: refused
                .filter(|(_, count)| is_much(*count))
                .map(|(name, count)| ((*name).to_owned(), count))
                .collect(),
        });
        Ok(())
    }
}

/// The processes that take part as one of these.
fn processes_of(participants: &[Participant], roles: &[&str]) -> BTreeSet<u32> {
    let is_one = |one: &&Participant| roles.contains(&one.role.as_str());
    participants.iter().filter(is_one).map(|one| one.process_id).collect()
}

fn port_of(bound: io::Result<()>) -> Port {
    match bound {
        Ok(()) => Port::Free,
        Err(error) if error.kind() == io::ErrorKind::AddrNotAvailable => Port::NotOurs,
        Err(_) => Port::Taken,
    }
}

/// The kernel's tables of sockets.
const UDP: [&str; 2] = ["/proc/self/net/udp", "/proc/self/net/udp6"];
const TCP: [&str; 2] = ["/proc/self/net/tcp", "/proc/self/net/tcp6"];

/// The inodes of the sockets at an address's port.
fn sockets_at(tables: [&str; 2], address: SocketAddr) -> Vec<String> {
    let texts = tables.map(|table| std::fs::read_to_string(table).unwrap_or_default());
    texts.iter().flat_map(|text| inodes_at(text, address.port())).collect()
}

fn inodes_at(table: &str, port: u16) -> Vec<String> {
    let at_port = |line: &str| {
        let mut fields = line.split_whitespace();
        let (_, local_port) = fields.nth(1)?.rsplit_once(':')?;
        // The inode is the tenth field; those of connections that have ended are 0.
        let inode = fields.nth(7).filter(|inode| *inode != "0")?;
        (u16::from_str_radix(local_port, 16) == Ok(port)).then(|| inode.to_owned())
    };
    table.lines().skip(1).filter_map(at_port).collect()
}

/// Whether one of the processes has one of the sockets; one that may not be looked into is believed to.
fn holds(processes: &BTreeSet<u32>, inodes: &[String]) -> bool {
    let own = std::process::id();
    processes.iter().filter(|process| **process != own).any(|process| {
        let Ok(descriptors) = std::fs::read_dir(format!("/proc/{process}/fd")) else { return true };
        let links = descriptors.flatten().filter_map(|entry| std::fs::read_link(entry.path()).ok());
        links.into_iter().any(|link| {
            let link = link.to_string_lossy();
            let inode = link.strip_prefix("socket:[").and_then(|rest| rest.strip_suffix(']'));
            inode.is_some_and(|inode| inodes.iter().any(|held| held == inode))
        })
    })
}

/// Listens for a while; `None` if nothing that MVN sends was heard.
fn listen(socket: &UdpSocket) -> Option<Streamed> {
    socket.set_read_timeout(Some(Duration::from_millis(100))).ok()?;
    let (mut buffer, mut heard, begun) = (vec![0; DATAGRAM_MAX], Heard::default(), Instant::now());
    while begun.elapsed() < LISTEN {
        if let Ok(length) = socket.recv(&mut buffer)
            && let Ok(datagram) = Datagram::parse(&buffer[..length])
            && let Some(header) = datagram.header()
        {
            heard.take(header);
        }
    }
    heard.told(begun.elapsed())
}

/// What listening counts.
#[derive(Debug, Default)]
struct Heard {
    types: BTreeSet<DatagramType>,
    avatars: BTreeSet<u8>,
    samples: BTreeSet<(u8, u32)>,
}

impl Heard {
    fn take(&mut self, header: &Header) {
        self.types.insert(header.datagram_type);
        self.avatars.insert(header.avatar);
        self.samples.insert((header.avatar, header.sample_counter));
    }

    fn told(&self, time: Duration) -> Option<Streamed> {
        let of = |kind: DatagramType| self.types.contains(&kind);
        let poses = [DatagramType::POSE_QUATERNION, DatagramType::POSE_EULER];
        let others = self.types.iter().filter(|kind| !poses.contains(kind));
        (!self.types.is_empty()).then(|| Streamed {
            rate_hz: self.samples.len() as f64 / self.avatars.len().max(1) as f64 / time.as_secs_f64(),
            quaternions: of(DatagramType::POSE_QUATERNION),
            euler: of(DatagramType::POSE_EULER),
            others: others.map(|kind| format!("type {kind}")).collect(),
            avatars: self.avatars.iter().copied().collect(),
            refused: vec![],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_socket_is_found_by_its_port_and_its_holder_by_the_inode() {
        let table = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode \
                     ref pointer drops\n 1: 0100007F:2623 00000000:0000 07 00000000:00000000 00:00000000 00000000  \
                     104        0 4711 2 0 0\n 2: 0100007F:2624 00000000:0000 07 00000000:00000000 00:00000000 \
                     00000000   104        0 4712 2 0 0\n";
        assert_eq!(inodes_at(table, 9763), ["4711"]);
        assert!(inodes_at(table, 1).is_empty());
        assert!(!holds(&BTreeSet::new(), &["4711".to_owned()]));
    }

    #[test]
    fn listening_counts_samples_not_datagrams_and_names_the_types() {
        let mut heard = Heard::default();
        for sample in 0..120 {
            for kind in [DatagramType::POSE_QUATERNION, DatagramType::LINEAR_KINEMATICS] {
                heard.take(&Header { datagram_type: kind, ..Header::new(sample, 0, 3) });
            }
        }
        let told = heard.told(Duration::from_secs(2)).unwrap();
        assert_eq!(told.rate_hz, 60.0);
        assert!(told.quaternions && !told.euler);
        assert_eq!((told.avatars, told.others), (vec![3], vec!["type 21".to_owned()]));
        assert_eq!(Heard::default().told(Duration::from_secs(2)), None);
    }
}
