//! Reassembles the datagrams of one suit sample.
//!
//! MVN sends one datagram for each type and sample, and does not announce the types. The assembler therefore determines
//! the set from the stream, publishes a sample as soon as the set is complete, and at the latest when the next sample
//! begins.

use super::part::{Part, axis_like_pose, upright_axis};
use super::refusal::SuitRefusal;
use super::settings::{SuitSettings, TypeSet, UpAxis};
use super::subject::SuitSubject;
use crate::counts::Counts;
use crate::sequence::{Sequence, SequencePosition};
use crate::stride::Stride;
use crate::wire::mvn::{Datagram, EulerPose, Layout, LinearKinematics};
use bytemuck::Zeroable;
use equipoise_core::body::SEGMENTS;
use equipoise_core::message::{SuitBody, SuitSample};
use equipoise_core::time::ClockFit;

/// Suits count at 240 Hz at most; this leaves a margin.
const MAX_RATE_HZ: u64 = 1000;
/// Count of samples that are observed to their end before any is published early.
const LEARNING_SAMPLES: u32 = 3;
/// A type that was missing from this many samples in a row is no longer waited for.
const FORGET_AFTER: u8 = 8;

/// The sample whose datagrams are arriving, kept after its publication to recognise duplicates.
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
    /// Last published orientations: a quaternion and its negative represent one rotation, and the sign is kept
    /// continuous.
    last_orientation: [[f64; 4]; SEGMENTS],
    learnt: TypeSet,
    samples_watched: u32,
    missing: [u8; TypeSet::COUNT],
    subject: SuitSubject,
    layout: Option<Layout>,
    /// World of type 21 if type 02 has Y up, determined from a pose: a setting of MVN for its stream.
    linear_up: Option<UpAxis>,
    last_position_m: Option<[[f64; 3]; SEGMENTS]>,
    counts: Counts,
}

impl SuitAssembler {
    /// Creates an assembler before any data.
    pub fn new(settings: SuitSettings) -> Self {
        SuitAssembler {
            settings,
            sequence: Sequence::new(MAX_RATE_HZ),
            stride: Stride::default(),
            clock: ClockFit::new(),
            session: 0,
            current: None,
            ready: None,
            last_orientation: [[0.0; 4]; SEGMENTS],
            learnt: TypeSet::default(),
            samples_watched: 0,
            missing: [0; TypeSet::COUNT],
            subject: SuitSubject::default(),
            layout: None,
            linear_up: None,
            last_position_m: None,
            counts: Counts::default(),
        }
    }

    /// Processes one datagram; returns a sample if the datagram completed one.
    ///
    /// `arrival_ns` is the kernel's receive stamp on CLOCK_MONOTONIC. `published_ns` of the sample is left at 0 for the
    /// publisher to set. Rarely two samples become ready at once: [`Self::take_ready`] then returns the second.
    pub fn receive(&mut self, datagram: &[u8], arrival_ns: u64) -> Option<SuitSample> {
        self.counts.received += 1;
        if let Err(refusal) = self.accept(datagram, arrival_ns) {
            self.refuse(refusal);
        }
        self.take_ready()
    }

    /// A sample that is complete but was not returned yet.
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

    /// Counts since the start; `refused` in the order of [`SuitRefusal`].
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Properties of the wearer that the suit reported.
    pub fn subject(&self) -> &SuitSubject {
        &self.subject
    }

    /// Body scale of the wearer, as a message; `None` until the suit reported it.
    pub fn body(&self) -> Option<SuitBody> {
        self.subject.null_pose.to_body(self.settings.avatar)
    }

    /// Props and fingers of the last body pose; both are ignored. `None` unless the sender is of 2019 or later.
    pub fn layout(&self) -> Option<Layout> {
        self.layout
    }

    /// The types of a sample, as determined so far.
    pub fn learnt_types(&self) -> TypeSet {
        self.learnt
    }

    /// Counts a datagram that the socket layer refused.
    pub fn refuse_datagram(&mut self, refusal: SuitRefusal) {
        self.counts.received += 1;
        self.refuse(refusal);
    }

    fn refuse(&mut self, refusal: SuitRefusal) {
        self.counts.refuse(refusal.index());
    }

    /// The datagram's part of a sample; `None` if it is valid but not part of one.
    fn part_of(&mut self, datagram: Datagram<'_>, arrival_ns: u64) -> Result<Option<Part>, SuitRefusal> {
        let check_up = self.settings.check_up_axis;
        let up = self.settings.up;
        let part = match datagram {
            Datagram::PoseQuaternion(_, items) => match up {
                UpAxis::Z => Part::pose(items, TypeSet::POSE_QUATERNION, check_up)?,
                UpAxis::Y => {
                    Part::pose(items.map(|item| item.y_up_to_z_up()), TypeSet::POSE_QUATERNION, check_up)?
                }
            },
            Datagram::PoseEuler(_, items) => {
                Part::pose(items.map(|item: EulerPose| item.to_z_up()), TypeSet::POSE_EULER, check_up)?
            }
            Datagram::Unity(_, body) => {
                Part::pose(body.to_z_up().into_iter(), TypeSet::POSE_UNITY, check_up)?
            }
            Datagram::AngularKinematics(..) | Datagram::CentreOfMass(..) if up == UpAxis::Y => {
                return Ok(None);
            }
            Datagram::LinearKinematics(_, items) => {
                let up = self.linear_up(items).ok_or(SuitRefusal::UpsideDown)?;
                Part::linear(items, up)?
            }
            Datagram::AngularKinematics(_, items) => Part::angular(items)?,
            Datagram::JointAngles(_, items) => Part::joints(items)?,
            Datagram::CentreOfMass(_, com) => Part::com(&com)?,
            Datagram::Meta(_, meta) => {
                self.subject.take_meta(meta);
                return Ok(None);
            }
            Datagram::Scale(_, scale) => {
                let taken = self.subject.take_scale(&scale, self.session, arrival_ns);
                return if taken { Ok(None) } else { Err(SuitRefusal::NotFinite) };
            }
            // Valid, but not part of a sample.
            Datagram::Unused(_) | Datagram::Json => return Ok(None),
            Datagram::Unknown(_) => return Err(SuitRefusal::UnknownType),
        };
        Ok(Some(part))
    }

    fn accept(&mut self, bytes: &[u8], arrival_ns: u64) -> Result<(), SuitRefusal> {
        let datagram = Datagram::parse(bytes)?;
        let Some(header) = datagram.header().copied() else {
            return Ok(());
        };
        if header.avatar != self.settings.avatar {
            return Err(SuitRefusal::OtherAvatar);
        }
        let Some(part) = self.part_of(datagram, arrival_ns)? else { return Ok(()) };
        self.layout = header.layout().or(self.layout);
        match self.sequence.classify(header.sample_counter, arrival_ns) {
            SequencePosition::Old => return Err(SuitRefusal::OutOfOrder),
            SequencePosition::Same => {}
            SequencePosition::First => self.begin(header.sample_counter, header.time_code_ms, 0, arrival_ns),
            SequencePosition::Next { gap } => {
                self.counts.lost += u64::from(self.stride.lost_in(gap));
                self.begin(header.sample_counter, header.time_code_ms, gap, arrival_ns);
            }
            SequencePosition::NewSession => {
                self.finish();
                let ended_ns = self.current.take().map_or(0, |current| current.sample.arrival_ns);
                self.session += 1;
                self.subject.null_pose.begin_session(self.session, ended_ns);
                self.stride = Stride::default();
                (self.linear_up, self.last_position_m) = (None, None);
                self.clock.restart();
                self.begin(header.sample_counter, header.time_code_ms, 1, arrival_ns);
            }
        }
        self.merge(&part)
    }

    /// World of type 21: that of its pose or, before any pose, that in which the body is upright.
    fn linear_up(&mut self, items: impl Iterator<Item = LinearKinematics> + Clone) -> Option<UpAxis> {
        if self.settings.up == UpAxis::Z {
            return Some(UpAxis::Z);
        }
        if self.linear_up.is_none() {
            let current = self.current.as_ref().filter(|current| current.seen.has_pose());
            let pose_m = current.map(|current| current.sample.position_m).or(self.last_position_m);
            self.linear_up = pose_m.and_then(|pose_m| axis_like_pose(items.clone(), &pose_m));
        }
        self.linear_up.or_else(|| upright_axis(items.map(|item| (item.segment_id, item.position_m))))
    }

    /// Ends the preceding sample and starts the one with this counter, `gap` counts later.
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
        current.seen = current.seen.and(kind);
        self.learnt = self.learnt.and(kind);
        if current.published {
            return Err(SuitRefusal::Late);
        }
        // A pose of lower quality is used only if no better one is sent.
        if !current.seen.has_better_pose_than(kind) {
            part.apply(&mut current.sample);
        }
        Ok(())
    }

    /// The current sample is complete: updates the set of types, and publishes the sample if that is pending.
    fn finish(&mut self) {
        let Some(current) = &self.current else {
            return;
        };
        let (seen, published) = (current.seen, current.published);
        let expected = self.settings.required.unwrap_or(self.learnt);
        self.samples_watched = self.samples_watched.saturating_add(1);
        for (bit, missing) in self.missing.iter_mut().enumerate() {
            let kind = TypeSet::bit(bit);
            *missing = if seen.has(kind) { 0 } else { missing.saturating_add(1) };
            if *missing >= FORGET_AFTER {
                self.learnt = self.learnt.without(kind);
            }
        }
        if published {
            return;
        }
        if !seen.has_pose() {
            self.refuse(SuitRefusal::NoPose);
            // If the stream contains poses, this one was lost; the other parts of the sample are useless without it.
            self.counts.lost += u64::from(expected.has_pose());
            return;
        }
        if !seen.has(expected) {
            self.refuse(SuitRefusal::Incomplete);
        }
        self.ready = self.publish();
    }

    /// Stamps the current sample and marks it as published.
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
        sample.clock_epoch = self.clock.epoch();
        for (now, before) in sample.orientation_wxyz.iter_mut().zip(&mut self.last_orientation) {
            let dot: f64 = now.iter().zip(before.iter()).map(|(a, b)| a * b).sum();
            if dot < 0.0 {
                *now = now.map(|part| -part);
            }
            *before = *now;
        }
        self.last_position_m = Some(sample.position_m);
        Some(*sample)
    }
}
