//! Survey of all data on the suit's port, for commissioning. Nothing is published.

use super::assembler::SuitAssembler;
use super::part::upright_axis;
use super::refusal::SuitRefusal;
use super::settings::{SuitSettings, UpAxis};
use crate::stride::Stride;
use crate::wire::mvn::{Datagram, DatagramType, Header, Layout};
use std::collections::BTreeMap;
use std::net::IpAddr;

/// Limit of characters; datagrams of further ones are counted but not decoded.
const CHARACTERS_MAX: usize = 32;
/// Limit of distinguished senders.
const SENDERS_MAX: usize = 32;

/// Results of the survey.
#[derive(Debug, Clone)]
pub struct Survey {
    settings: SuitSettings,
    /// Datagrams by sending computer.
    pub senders: BTreeMap<IpAddr, u64>,
    /// Datagrams of computers that are not admitted, or not at present.
    pub turned_away: BTreeMap<IpAddr, u64>,
    /// Data of each character and object.
    pub characters: BTreeMap<u8, Character>,
    /// Datagrams that are not MVN's, by reason; in the order of [`SuitRefusal`].
    pub unreadable: BTreeMap<&'static str, u64>,
    /// Text messages of the remote control.
    pub texts: u64,
    /// Bytes of all datagrams of admitted senders.
    pub bytes: u64,
}

impl Survey {
    /// For a suit with these settings; `avatar` is ignored.
    pub fn new(settings: SuitSettings) -> Survey {
        Survey {
            settings,
            senders: BTreeMap::new(),
            turned_away: BTreeMap::new(),
            characters: BTreeMap::new(),
            unreadable: BTreeMap::new(),
            texts: 0,
            bytes: 0,
        }
    }

    /// Whether no data arrived.
    pub fn is_silent(&self) -> bool {
        self.senders.is_empty() && self.turned_away.is_empty()
    }

    /// Counts a datagram of a sender that is not admitted.
    pub fn turn_away(&mut self, sender: IpAddr) {
        count(&mut self.turned_away, sender, SENDERS_MAX);
    }

    /// Counts a byte stream that lost synchronisation.
    pub fn lose_step(&mut self) {
        *self.unreadable.entry(SuitRefusal::OutOfStep.name()).or_default() += 1;
    }

    /// Processes a datagram.
    pub fn take(&mut self, sender: IpAddr, bytes: &[u8], arrival_ns: u64) {
        count(&mut self.senders, sender, SENDERS_MAX);
        self.bytes += bytes.len() as u64;
        let datagram = match Datagram::parse(bytes) {
            Ok(datagram) => datagram,
            Err(malformed) => {
                *self.unreadable.entry(SuitRefusal::from(malformed).name()).or_default() += 1;
                return;
            }
        };
        let Some(header) = datagram.header() else {
            self.texts += 1;
            return;
        };
        let has_room = self.characters.len() < CHARACTERS_MAX;
        if !has_room && !self.characters.contains_key(&header.avatar) {
            return;
        }
        let settings = SuitSettings { avatar: header.avatar, ..self.settings };
        let character = self.characters.entry(header.avatar).or_insert_with(|| Character::new(settings));
        character.take(header, &datagram, bytes, arrival_ns);
    }
}

fn count(counts: &mut BTreeMap<IpAddr, u64>, sender: IpAddr, most: usize) {
    if counts.len() < most || counts.contains_key(&sender) {
        *counts.entry(sender).or_default() += 1;
    }
}

/// Data of one character or object.
#[derive(Debug, Clone)]
pub struct Character {
    assembler: SuitAssembler,
    /// Data of each type.
    pub types: BTreeMap<DatagramType, TypeCounts>,
    /// The largest count of items in a pose: 1 is a tracked object.
    pub items_max: u8,
    /// Poses that are upright along Z, along Y, and along neither (lying, or not a body).
    pub upright: [u64; 3],
    /// First and last sample counter with its time code, ms.
    clock: Option<[(u32, u32); 2]>,
}

impl Character {
    fn new(settings: SuitSettings) -> Character {
        Character {
            assembler: SuitAssembler::new(settings),
            types: BTreeMap::new(),
            items_max: 0,
            upright: [0; 3],
            clock: None,
        }
    }

    fn take(&mut self, header: &Header, datagram: &Datagram<'_>, bytes: &[u8], arrival_ns: u64) {
        self.types.entry(header.datagram_type).or_default().take(header, bytes, arrival_ns);
        if let Datagram::PoseQuaternion(..) | Datagram::PoseEuler(..) | Datagram::Unity(..) = datagram {
            self.items_max = self.items_max.max(header.items);
            let here = (header.sample_counter, header.time_code_ms);
            let [first, _] = self.clock.unwrap_or([here; 2]);
            self.clock = Some([first, here]);
        }
        if let Datagram::PoseQuaternion(_, items) = datagram {
            let axis = upright_axis(items.map(|item| (item.segment_id, item.position_m)));
            self.upright[match axis {
                Some(UpAxis::Z) => 0,
                Some(UpAxis::Y) => 1,
                None => 2,
            }] += 1;
        }
        self.assembler.receive(bytes, arrival_ns);
        while self.assembler.take_ready().is_some() {}
    }

    /// Whether it is a tracked object: a single segment, and no body.
    pub fn is_object(&self) -> bool {
        self.items_max == 1
    }

    /// The character's name in MVN, if it was sent.
    pub fn name(&self) -> Option<&str> {
        self.assembler.subject().name.as_deref()
    }

    /// Props and fingers.
    pub fn layout(&self) -> Option<Layout> {
        self.assembler.layout()
    }

    /// Whether the null pose's segments were received, and the count of its points.
    pub fn null_pose(&self) -> (bool, usize) {
        let null_pose = &self.assembler.subject().null_pose;
        (null_pose.origins_m.is_some(), null_pose.points.len())
    }

    /// Nonzero counts of what the adapter would have refused, by reason.
    pub fn refused(&self) -> impl Iterator<Item = (SuitRefusal, u64)> + '_ {
        let counts = self.assembler.counts().refused;
        SuitRefusal::ALL.iter().copied().zip(counts).filter(|(_, count)| *count > 0)
    }

    /// Samples that the adapter would have published.
    pub fn published(&self) -> u64 {
        self.assembler.counts().published
    }

    /// Data of a type.
    pub fn of(&self, kind: DatagramType) -> Option<&TypeCounts> {
        self.types.get(&kind)
    }

    /// The best type that contains its pose.
    pub fn pose(&self) -> Option<(DatagramType, &TypeCounts)> {
        let poses = [DatagramType::POSE_QUATERNION, DatagramType::POSE_EULER, DatagramType::UNITY];
        poses.into_iter().find_map(|kind| self.of(kind).map(|seen| (kind, seen)))
    }

    /// Rate at which the suit itself counts samples, by its own clock, Hz; `None` while that clock does not run.
    pub fn suit_rate_hz(&self) -> Option<f64> {
        let [(first, first_ms), (last, last_ms)] = self.clock?;
        let (counts, ms) = (last.wrapping_sub(first), last_ms.wrapping_sub(first_ms));
        // A jump of either, or too short an interval.
        (counts > 0 && (1..i32::MAX as u32).contains(&ms) && counts <= ms)
            .then(|| f64::from(counts) * 1000.0 / f64::from(ms))
    }
}

/// Data of one type of one character.
#[derive(Debug, Clone, Default)]
pub struct TypeCounts {
    /// Count of datagrams.
    pub datagrams: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Count of datagrams with a new counter.
    pub samples: u64,
    /// Count of datagrams with the counter of the preceding one.
    pub repeated: u64,
    /// Count of missing samples, by counter and stride.
    pub lost: u64,
    /// Items of the last datagram.
    pub items: u8,
    stride: Stride,
    last_counter: Option<u32>,
    first_ns: u64,
    last_ns: u64,
}

impl TypeCounts {
    fn take(&mut self, header: &Header, bytes: &[u8], arrival_ns: u64) {
        self.datagrams += 1;
        self.bytes += bytes.len() as u64;
        self.items = header.items;
        let steps = self.last_counter.map(|last| header.sample_counter.wrapping_sub(last).cast_signed());
        match steps {
            Some(0) => self.repeated += 1,
            // Reordered, or a counter that restarted.
            Some(..0) => self.last_counter = Some(header.sample_counter),
            Some(gap @ 1..) => {
                self.lost += u64::from(self.stride.lost_in(gap.unsigned_abs()));
                self.samples += 1;
                self.last_ns = arrival_ns;
            }
            None => (self.samples, self.first_ns, self.last_ns) = (1, arrival_ns, arrival_ns),
        }
        self.last_counter = Some(header.sample_counter);
    }

    /// Rate of new samples, Hz; 0 for a single one.
    pub fn rate_hz(&self) -> f64 {
        let seconds = self.last_ns.saturating_sub(self.first_ns) as f64 * 1e-9;
        if seconds > 0.0 { self.samples.saturating_sub(1) as f64 / seconds } else { 0.0 }
    }

    /// Interval of samples without loss, in counts; `None` before the second.
    pub fn stride(&self) -> Option<u32> {
        self.stride.usual()
    }
}
