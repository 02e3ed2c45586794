//! The current condition of a station: owners of its ports, and the data of its suit and plate.

use std::collections::BTreeSet;
use std::io;
use std::net::TcpListener;
use std::time::{Duration, Instant};

use equipoise_adapters::source::survey;
use equipoise_adapters::suit::{SuitRefusal, Survey};
use equipoise_adapters::wire::mvn::DatagramType;
use equipoise_bus::{Bus, BusError, BusSettings, Participant};
use equipoise_config::Config;
use equipoise_core::message::suit::SuitBlocks;
use equipoise_core::message::{AdapterHealth, GroundSample, State, SuitSample, Validity};
use equipoise_daemon::sensors::SUIT_ROLE;
use equipoise_station::DAEMON_ROLE;

use crate::metrics_feed::METRICS_ROLE;

use super::ports::{Port, TCP, bind_suit, holds, port_of, sockets_at};
use crate::page_feed::PAGE_ROLE;
use crate::provenance::Provenance;

/// Observation time, long enough for a message of both adapters, which arrive once a second.
const LISTEN_TIME: Duration = Duration::from_millis(2500);
/// A reason is reported if it affects at least this fraction of all datagrams; every start causes a few.
const REFUSED_FRACTION_MIN: f64 = 0.01;

/// The condition of the station, as far as it could be observed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StationFacts {
    /// Process id of the running daemon.
    pub daemon: Option<u32>,
    /// State of the suit's port.
    pub suit_port: Port,
    /// State of the page's port, if configured.
    pub page_port: Option<Port>,
    /// State of the metrics' port, if configured.
    pub metrics_port: Option<Port>,
    /// Data of the suit; `None` if none arrived.
    pub streamed: Option<Streamed>,
    /// Vertical force on the plate, N; `None` if unavailable.
    pub plate_force_n: Option<f64>,
    /// Provenance of the ground samples, in words; empty if none arrived.
    pub ground: String,
}

/// Observed data of the suit.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Streamed {
    /// Samples per second.
    pub rate_hz: f64,
    /// Whether poses arrive as quaternions (type 02).
    pub quaternions: bool,
    /// A supported substitute for the pose quaternions that arrives, if any.
    pub substitute: Option<&'static str>,
    /// Other datagrams, in words.
    pub others: Vec<String>,
    /// Characters observed; empty if only the configured one can be observed.
    pub avatars: Vec<u8>,
    /// Datagrams that the adapter refused since its start, by reason.
    pub refused: Vec<(String, u64)>,
}

impl StationFacts {
    /// Examines the station of a configuration: subscribes to the running daemon's services, or else receives on the
    /// suit's port itself.
    ///
    /// # Errors
    /// The bus cannot be joined.
    pub fn gather(config: &Config) -> Result<StationFacts, BusError> {
        let bus = Bus::join(&BusSettings::new(&config.station, "doctor"))?;
        let participants = bus.participants()?;
        let of_role = |role: &str| participants.iter().find(|one| one.role == role).map(|one| one.process_id);
        // Check each port against the processes expected on it: if the suit's adapter has taken the page's port, it is
        // not `OwnProcess`.
        let of = |bound: io::Result<()>, roles: &[&str], tables, address| match port_of(bound) {
            Port::InUse if holds(&processes_of(&participants, roles), &sockets_at(tables, address)) => {
                Port::OwnProcess
            }
            found => found,
        };
        let tcp = |roles, address| of(TcpListener::bind(address).map(drop), roles, TCP, address);
        let (suit_bound, suit_tables) = bind_suit(&config.suit);
        let mut facts = StationFacts {
            daemon: of_role(DAEMON_ROLE),
            suit_port: of(suit_bound, &[DAEMON_ROLE, SUIT_ROLE], suit_tables, config.suit.listen),
            page_port: config.page.as_ref().map(|page| tcp(&[PAGE_ROLE], page.listen)),
            metrics_port: config
                .metrics
                .as_ref()
                .map(|metrics| tcp(&[DAEMON_ROLE, METRICS_ROLE], metrics.listen)),
            ..StationFacts::default()
        };
        if facts.daemon.is_some() {
            facts.query(&bus)?;
        } else if let (Ok(settings), Port::Free) = (config.suit.mvn_settings(), facts.suit_port) {
            let survey = survey(&settings, LISTEN_TIME, &|| false).ok();
            facts.streamed = survey.and_then(|survey| streamed(&survey, config.suit.avatar));
        }
        Ok(facts)
    }

    /// Subscribes to the services of a running daemon's station.
    fn query(&mut self, bus: &Bus) -> Result<(), BusError> {
        let mut states = bus.subscriber::<State>(1)?;
        let mut suit = bus.subscriber::<SuitSample>(64)?;
        let mut health = bus.subscriber::<AdapterHealth>(8)?;
        let mut ground = bus.subscriber::<GroundSample>(1)?;
        let (mut blocks, mut newest, started) = (None::<u32>, None, Instant::now());
        while started.elapsed() < LISTEN_TIME {
            while let Some(sample) = suit.receive()? {
                blocks = Some(blocks.unwrap_or(0) | sample.blocks);
            }
            while let Some(adapter) = health.receive()? {
                newest = Some(adapter).filter(|adapter| adapter.stream == 1).or(newest);
            }
            if let Some(sample) = ground.latest()? {
                let provenance = Provenance::of(&sample);
                self.ground = format!(" ({}{})", provenance.devices(), provenance.missing());
            }
            if let Some(state) = states.latest()? {
                let force_n = state.unless(Validity::INVALIDATES_GROUND_FORCE, state.ground_force_n[2]);
                self.plate_force_n = force_n.or(self.plate_force_n);
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let Some(adapter) = newest.filter(|adapter| adapter.received > 0) else { return Ok(()) };
        let sent = |block: SuitBlocks| blocks.unwrap_or(0) & block as u32 != 0;
        let others = [
            (SuitBlocks::JointAngles, "joint angles (20)"),
            (SuitBlocks::LinearKinematics, "linear kinematics (21)"),
            (SuitBlocks::AngularKinematics, "angular kinematics (22)"),
            (SuitBlocks::CentreOfMass, "centre of mass (24)"),
        ];
        let is_significant = |count: u64| count as f64 > REFUSED_FRACTION_MIN * adapter.received as f64;
        let refused = SuitRefusal::NAMES.iter().zip(adapter.refused);
        self.streamed = Some(Streamed {
            rate_hz: adapter.rate_hz,
            // A sample lacks the format of its pose.
            quaternions: blocks.is_some(),
            substitute: None,
            others: others
                .into_iter()
                .filter(|(block, _)| sent(*block))
                .map(|(_, name)| name.to_owned())
                .collect(),
            avatars: vec![],
            refused: refused
                .filter(|(_, count)| is_significant(*count))
                .map(|(name, count)| ((*name).to_owned(), count))
                .collect(),
        });
        Ok(())
    }
}

/// The processes that participate in one of these roles.
pub(super) fn processes_of(participants: &[Participant], roles: &[&str]) -> BTreeSet<u32> {
    let is_one = |one: &&Participant| roles.contains(&one.role.as_str());
    participants.iter().filter(is_one).map(|one| one.process_id).collect()
}

/// A summary of the configured character, or of the first one otherwise; `None` if no MVN data arrived.
fn streamed(survey: &Survey, avatar: u8) -> Option<Streamed> {
    let character = survey.characters.get(&avatar).or_else(|| survey.characters.values().next())?;
    let of = |kind: DatagramType| character.of(kind).is_some();
    let poses = [DatagramType::POSE_QUATERNION, DatagramType::POSE_EULER, DatagramType::UNITY];
    let substitutes =
        [(DatagramType::POSE_EULER, "Euler angles (01)"), (DatagramType::UNITY, "Unity's poses (05)")];
    let others = character.types.keys().filter(|kind| !poses.contains(kind));
    Some(Streamed {
        rate_hz: character.pose().map_or(0.0, |(_, seen)| seen.rate_hz()),
        quaternions: of(DatagramType::POSE_QUATERNION),
        substitute: substitutes.iter().find(|(kind, _)| of(*kind)).map(|(_, name)| *name),
        others: others.map(|kind| format!("type {kind}")).collect(),
        avatars: survey.characters.keys().copied().collect(),
        refused: vec![],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use equipoise_adapters::suit::SuitSettings;
    use equipoise_adapters::wire::mvn::{
        Header, LinearKinematics, SegmentPose, linear_kinematics, pose_quaternion,
    };

    #[test]
    fn observing_counts_samples_and_names_the_types() {
        let mut survey = Survey::new(SuitSettings::default());
        assert_eq!(streamed(&survey, 3), None);
        let pose =
            SegmentPose { segment_id: 1, position_m: [0.0; 3], orientation_wxyz: [1.0, 0.0, 0.0, 0.0] };
        let linear = LinearKinematics {
            segment_id: 1,
            position_m: [0.0; 3],
            velocity_m_per_s: [0.0; 3],
            acceleration_m_per_s2: [0.0; 3],
        };
        let sender = std::net::Ipv4Addr::LOCALHOST.into();
        for sample in 0..=120u32 {
            let (header, mut bytes) = (Header::new(sample, 0, 3), Vec::new());
            let arrival_ns = u64::from(sample) * 1_000_000_000 / 60;
            pose_quaternion::encode(&header, &[pose; 23], &mut bytes).unwrap();
            survey.take(sender, &bytes, arrival_ns);
            linear_kinematics::encode(&header, &[linear; 23], &mut bytes).unwrap();
            survey.take(sender, &bytes, arrival_ns);
        }
        let stream = streamed(&survey, 3).unwrap();
        assert!((stream.rate_hz - 60.0).abs() < 0.01, "{}", stream.rate_hz);
        assert!(stream.quaternions && stream.substitute.is_none());
        assert_eq!((stream.avatars, stream.others), (vec![3], vec!["type 21".to_owned()]));
    }
}
