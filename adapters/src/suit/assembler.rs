//! Puts the datagrams of one suit sample together again.
//!
//! MVN sends one datagram per type and sample; nothing says which types will come. So the assembler learns the set,
//! publishes a sample as soon as the set is complete, and at the latest when the next sample begins.

use super::part::Part;
use super::refusal::SuitRefusal;
use super::settings::{SuitSettings, TypeSet};
use super::stride::Stride;
use super::subject::SuitSubject;
use crate::counts::Counts;
use crate::sequence::{Place, Sequence};
use crate::wire::mvn::{Datagram, EulerPose};
use bytemuck::Zeroable;
use equipoise_core::message::SuitSample;
use equipoise_core::time::ClockFit;

/// Suits count at 240 Hz at most; this leaves room.
const MAX_RATE_HZ: u64 = 1000;
/// So many samples are watched to their end before any is published early.
const LEARNING_SAMPLES: u32 = 3;
/// A type that was missing from so many samples in a row is no longer waited for.
const FORGET_AFTER: u8 = 8;

/// The sample whose datagrams are arriving, kept after its publication to know repetitions.
#[derive(Debug, Clone)]
struct Current {
    sample: SuitSample,
    unwrapped_counter: u64,
    seen: TypeSet,
    published: bool,
}

/// Assembles samples of one character.
///
/// A refused datagram changes nothing but its count.
#[derive(Debug, Clone)]
pub struct SuitAssembler {
    settings: SuitSettings,
    sequence: Sequence,
    stride: Stride,
    clock: ClockFit,
    session: u32,
    current: Option<Current>,
    ready: Option<SuitSample>,
    /// Last orientations handed on: a quaternion and its negative are one rotation, and we stay on one side.
    last_orientation: [[f64; 4]; equipoise_core::body::SEGMENTS],
    learnt: TypeSet,
    samples_watched: u32,
    missing: [u8; TypeSet::COUNT],
    subject: SuitSubject,
    counts: Counts,
}

impl SuitAssembler {
    /// An assembler that has seen nothing yet.
    pub fn new(settings: SuitSettings) -> Self {
        SuitAssembler {
            settings,
            sequence: Sequence::new(MAX_RATE_HZ),
            stride: Stride::default(),
            clock: ClockFit::new(),
            session: 0,
            current: None,
            ready: None,
            last_orientation: [[0.0; 4]; equipoise_core::body::SEGMENTS],
            learnt: TypeSet::default(),
            samples_watched: 0,
            missing: [0; TypeSet::COUNT],
            subject: SuitSubject::default(),
            counts: Counts::default(),
        }
    }

    /// Takes in one datagram; gives back a sample if that completed one.
    ///
    /// `arrival_ns` is the kernel's receive stamp on CLOCK_MONOTONIC. `published_ns` of the sample is left at 0 for
    /// whoever publishes it. Seldom two samples become ready at once: then [`Self::take_ready`] has the second.
    pub fn receive(&mut self, datagram: &[u8], arrival_ns: u64) -> Option<SuitSample> {
        self.counts.received += 1;
        if let Err(refusal) = self.accept(datagram, arrival_ns) {
            self.refuse(refusal);
        }
        self.take_ready()
    }

    /// A sample that is complete but was not handed out yet.
    pub fn take_ready(&mut self) -> Option<SuitSample> {
        if let Some(ready) = self.ready.take() {
            return Some(ready);
        }
        let current = self.current.as_ref()?;
        let expected = self.settings.required.unwrap_or(self.learnt);
        let known = self.settings.required.is_some() || self.samples_watched >= LEARNING_SAMPLES;
        if known && !current.published && current.seen.has_pose() && current.seen.has(expected) {
            self.publish()
        } else {
            None
        }
    }

    /// What was counted so far; `refused` in the order of [`SuitRefusal`].
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// What the suit said about its wearer.
    pub fn subject(&self) -> &SuitSubject {
        &self.subject
    }

    /// The types that samples are made of, as learnt so far.
    pub fn learnt_types(&self) -> TypeSet {
        self.learnt
    }

    /// Counts a datagram that was refused before it came here, at the socket.
    pub fn refuse_datagram(&mut self, refusal: SuitRefusal) {
        self.counts.received += 1;
        self.refuse(refusal);
    }

    fn refuse(&mut self, refusal: SuitRefusal) {
        self.counts.refuse(refusal.index());
    }

    fn accept(&mut self, bytes: &[u8], arrival_ns: u64) -> Result<(), SuitRefusal> {
        let datagram = Datagram::parse(bytes)?;
        let Some(header) = datagram.header().copied() else {
            return Ok(());
        };
        if header.avatar != self.settings.avatar {
            return Err(SuitRefusal::OtherAvatar);
        }
        let check_up = self.settings.check_up_axis;
        let part = match datagram {
            Datagram::PoseQuaternion(_, items) => Part::pose(items, false, check_up)?,
            Datagram::PoseEuler(_, items) => {
                Part::pose(items.map(|item: EulerPose| item.to_z_up()), true, check_up)?
            }
            Datagram::LinearKinematics(_, items) => Part::linear(items)?,
            Datagram::AngularKinematics(_, items) => Part::angular(items)?,
            Datagram::JointAngles(_, items) => Part::joints(items)?,
            Datagram::CentreOfMass(_, com) => Part::com(&com)?,
            Datagram::Meta(_, meta) => {
                self.subject.take_meta(meta);
                return Ok(());
            }
            Datagram::Scale(_, scale) => {
                return if self.subject.take_scale(&scale) { Ok(()) } else { Err(SuitRefusal::NotFinite) };
            }
            Datagram::TrackerKinematics(..) | Datagram::TimeCode(..) | Datagram::Json => return Ok(()),
            Datagram::Unknown(_) => return Err(SuitRefusal::UnknownType),
        };
        match self.sequence.place(header.sample_counter, arrival_ns) {
            Place::Old => return Err(SuitRefusal::OutOfOrder),
            Place::Same => {}
            Place::First => self.begin(header.sample_counter, header.time_code_ms, 0, arrival_ns),
            Place::Next { gap } => {
                self.counts.lost += u64::from(self.stride.lost_in(gap));
                self.begin(header.sample_counter, header.time_code_ms, gap, arrival_ns);
            }
            Place::NewSession => {
                self.finish();
                self.current = None;
                self.session += 1;
                self.stride = Stride::default();
                self.clock.restart();
                self.begin(header.sample_counter, header.time_code_ms, 1, arrival_ns);
            }
        }
        self.merge(&part)
    }

    /// Ends the sample before and starts the one with this counter, `gap` counts later.
    fn begin(&mut self, counter: u32, time_code_ms: u32, gap: u32, arrival_ns: u64) {
        self.finish();
        let before = self.current.as_ref().map_or(0, |current| current.unwrapped_counter);
        let unwrapped_counter = before + u64::from(gap);
        self.clock.observe(unwrapped_counter, arrival_ns);
        let sample = SuitSample {
            arrival_ns,
            device_counter: counter,
            device_time_ms: time_code_ms,
            session: self.session,
            avatar: u32::from(self.settings.avatar),
            ..SuitSample::zeroed()
        };
        self.current =
            Some(Current { sample, unwrapped_counter, seen: TypeSet::default(), published: false });
    }

    fn merge(&mut self, part: &Part) -> Result<(), SuitRefusal> {
        let kind = TypeSet::of(part);
        let Some(current) = &mut self.current else {
            return Ok(());
        };
        if current.seen.has(kind) {
            return Err(SuitRefusal::Duplicate);
        }
        let has_quaternions = current.seen.has(TypeSet::POSE_QUATERNION);
        current.seen = current.seen.and(kind);
        self.learnt = self.learnt.and(kind);
        if current.published {
            return Err(SuitRefusal::Late);
        }
        // Type 01 is type 02 rounded through angles: it only stands in where 02 is not sent.
        if !(has_quaternions && kind == TypeSet::POSE_EULER) {
            part.apply(&mut current.sample);
        }
        Ok(())
    }

    /// The current sample gets no more datagrams: learn from it, and publish it if that was not done.
    fn finish(&mut self) {
        let Some(current) = &self.current else {
            return;
        };
        self.samples_watched = self.samples_watched.saturating_add(1);
        for (bit, missing) in self.missing.iter_mut().enumerate() {
            let kind = TypeSet::bit(bit);
            *missing = if current.seen.has(kind) { 0 } else { missing.saturating_add(1) };
            if *missing >= FORGET_AFTER {
                self.learnt = self.learnt.without(kind);
            }
        }
        if current.published {
            return;
        }
        if current.seen.has_pose() {
            self.ready = self.publish();
        } else {
            self.refuse(SuitRefusal::NoPose);
        }
    }

    /// Stamps the current sample and marks it as handed out.
    fn publish(&mut self) -> Option<SuitSample> {
        let current = self.current.as_mut()?;
        current.published = true;
        self.counts.published += 1;
        let sample = &mut current.sample;
        sample.sequence = self.counts.published;
        (sample.sample_time_ns, sample.sample_time_sigma_ns) =
            match self.clock.estimate(current.unwrapped_counter) {
                Some(estimate) => (estimate.host_ns, estimate.sigma_ns),
                None => (sample.arrival_ns, u64::MAX),
            };
        sample.sample_time_ns = sample.sample_time_ns.saturating_sub(self.settings.latency_ns);
        for (now, before) in sample.orientation_wxyz.iter_mut().zip(&mut self.last_orientation) {
            let dot: f64 = now.iter().zip(before.iter()).map(|(a, b)| a * b).sum();
            if dot < 0.0 {
                *now = now.map(|part| -part);
            }
            *before = *now;
        }
        Some(*sample)
    }
}
