//! Rejects samples that no body and no working sensor produces.
//!
//! A failing device seldom reports it: it repeats its last value, saturates, inverts a sign, or doubles a reading for
//! some milliseconds. Each sample is compared with the previous ones before alignment. A failed check marks a [`Span`]
//! of time as suspect, and no snapshot that overlaps the span is published, updates the filter or is counted. Torques
//! are published about half a window late, so most spans are detected before the first of their snapshots is due.

mod jumps;

use bytemuck::{Pod, Zeroable};
use jumps::{JUMP_HOLDS_NS, JumpDetector, LEVER_MAX_M, Reading};

use super::identification::Identification;
use super::memory::EMPTY_PLATE_N;
use super::settings::Settings;
use crate::body::{JOINTS, Segment, Skeleton};
use crate::math;
use crate::message::{GroundSample, SuitSample};

/// The channels of a plate have a coarse resolution, and recorded poses may be rounded: both contain occasional
/// repetitions. A run with a probability below this per sample (one in 3 hours at 1 kHz) is a fault.
const RUN_CHANCE: f64 = 1e-7;
/// A suit that repeats poses with a probability below this per sample does so because it lost a pose or froze: such a
/// pose is dropped like a lost one, which costs nothing.
const REPEAT_CHANCE: f64 = 1e-2;
/// A change of the plate's force above this, N, shows that the body moves: the heartbeat of a person who stands still
/// causes about 2 N.
const BODY_MOVES_N: f64 = 1.0;
/// For this time after a pose the suit counts as evidence of motion, ns: three samples of the slowest suit, 30 Hz.
const POSE_EVIDENCE_NS: u64 = 100_000_000;
/// A segment that moved farther than this from the previous pose, m, does not stop within one sample: 60 mm/s at 60 Hz.
/// Recorded positions are rounded to a millimetre at most.
const POSE_MOVES_M: f64 = 1e-3;
/// Number of readings from which the probability of repetitions is estimated.
const READINGS_KEPT: f64 = 4096.0;

/// A ground device that starts again, perhaps with another gain, is silent for longer than this, ns; lost samples rarely
/// make such a gap.
const RESTART_MIN_NS: u64 = 300_000_000;

/// Maximum distance of a segment from the position that its parent's orientation implies, m; beyond it, the orientation
/// is wrong. Shoulder blades slide and soft tissue yields by centimetres …
const JOINT_GAP_MAX_M: f64 = 0.1;
/// … and its RMS over all segments, m: soft tissue of a lifting body causes 0.009 …
const GAPS_RMS_MAX_M: f64 = 0.03;
/// … and the maximum while the subject's own bone lengths are unavailable and those of an average person of that
/// stature are used, m.
const NOMINAL_GAP_MAX_M: f64 = 0.2;

/// Maximum speed of a pelvis, m/s: a sprint reaches 10 m/s, a fall from one metre 4.4 m/s.
const PELVIS_SPEED_MAX_M_PER_S: f64 = 5.0;
/// Maximum step by which a suit corrects its drift, m …
const PELVIS_STEP_MAX_M: f64 = 0.1;
/// … and its heading, rad.
const TURN_MAX_RAD: f64 = 0.3;
/// Maximum rate of rotation of a pelvis, rad/s: a figure skater reaches 30, a worker who turns quickly 8.
const PELVIS_RATE_MAX_RAD_PER_S: f64 = 15.0;
/// Maximum rate of rotation of any segment, rad/s: a forearm reaches 40 in a baseball pitch (elbow extension; Fleisig
/// et al. 1999).
const SEGMENT_RATE_MAX_RAD_PER_S: f64 = 40.0;

/// The last two intervals in which a sensor is implausible, start and end, ns; all zero for none. The earlier one still
/// covers instants whose window is incomplete.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Span {
    last_ns: [u64; 2],
    before_ns: [u64; 2],
}

impl Span {
    /// Adds an interval; merges it if the gap is at most the time for which a jump stays suspect.
    pub(super) fn add(&mut self, from_ns: u64, to_ns: u64) {
        let [last_from_ns, last_to_ns] = self.last_ns;
        if last_to_ns > 0 && from_ns <= last_to_ns.saturating_add(JUMP_HOLDS_NS) {
            self.last_ns = [last_from_ns.min(from_ns), last_to_ns.max(to_ns)];
        } else {
            *self = Span { last_ns: [from_ns, to_ns], before_ns: self.last_ns };
        }
    }

    /// Whether the interval from `from_ns` to `to_ns` overlaps one of the intervals.
    pub(super) fn overlaps(&self, from_ns: u64, to_ns: u64) -> bool {
        [self.last_ns, self.before_ns]
            .iter()
            .any(|[begin_ns, end_ns]| *end_ns > 0 && *begin_ns <= to_ns && from_ns <= *end_ns)
    }

    fn is_sound(&self) -> bool {
        [self.last_ns, self.before_ns].iter().all(|[from_ns, to_ns]| from_ns <= to_ns)
    }
}

/// Frequency of repeated readings, and the length of the present run.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Repeats {
    /// Readings, and repetitions among them, in completed runs; exponentially weighted.
    readings: f64,
    repetitions: f64,
    /// Repetitions in the current run, and the time of its first reading, ns.
    run: u64,
    begun_ns: u64,
}

impl Repeats {
    /// Ingests whether a reading equals the previous one, of `before_ns`. Returns whether the probability of such a run
    /// from a working sensor is below `chance`.
    fn ingest(&mut self, is_same: bool, before_ns: u64, chance: f64) -> bool {
        if is_same {
            if self.run == 0 {
                self.begun_ns = before_ns;
            }
            self.run += 1;
            return self.is_beyond(chance);
        }
        // A rejected run results from a fault and counts as one repetition only, so that the estimate still adapts if
        // the sensor's behaviour changes.
        let repetitions = if self.is_beyond(chance) { 1.0 } else { self.run as f64 };
        self.readings += 1.0 + repetitions;
        self.repetitions += repetitions;
        if self.readings > READINGS_KEPT {
            self.readings *= 0.5;
            self.repetitions *= 0.5;
        }
        self.run = 0;
        false
    }

    /// Probability that a reading repeats the previous one: mean of its Beta distribution.
    fn probability(&self) -> f64 {
        (self.repetitions + 1.0) / (self.readings + 2.0)
    }

    /// Whether the probability of a run as long as the current one is below `chance`.
    fn is_beyond(&self, chance: f64) -> bool {
        self.run as f64 * math::ln(self.probability()) < math::ln(chance)
    }

    fn is_sound(&self) -> bool {
        self.readings >= 0.0
            && self.readings <= 2.0 * READINGS_KEPT + self.run as f64
            && (0.0..=self.readings).contains(&self.repetitions)
    }
}

/// Bone lengths against which a pose is checked.
pub(super) struct Bones {
    skeleton: Skeleton,
    /// Whether to check arms and legs only: suits divide spine and shoulders differently.
    limbs_alone: bool,
    /// Maximum distance at a joint, and maximum RMS over all joints, m.
    gap_max_m: f64,
    rms_max_m: f64,
}

/// Pose of the pelvis.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct PelvisPose {
    time_ns: u64,
    position_m: [f64; 3],
    orientation_wxyz: [f64; 4],
}

impl PelvisPose {
    fn of(sample: &SuitSample) -> PelvisPose {
        let pelvis = Segment::Pelvis.index();
        PelvisPose {
            time_ns: sample.sample_time_ns,
            position_m: sample.position_m[pelvis],
            orientation_wxyz: sample.orientation_wxyz[pelvis],
        }
    }

    /// Whether no body can move from `there` to here in the elapsed time.
    fn is_beyond(&self, there: &PelvisPose) -> bool {
        let span_s = self.time_ns.saturating_sub(there.time_ns) as f64 * 1e-9;
        let by_m = length([0, 1, 2].map(|axis| self.position_m[axis] - there.position_m[axis]));
        let by_rad = angle_rad(&self.orientation_wxyz, &there.orientation_wxyz);
        by_m > PELVIS_STEP_MAX_M + PELVIS_SPEED_MAX_M_PER_S * span_s
            || by_rad > TURN_MAX_RAD + PELVIS_RATE_MAX_RAD_PER_S * span_s
    }
}

/// State of the checks, and their results.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Plausibility {
    /// Interval in which the plate's samples are suspect, by the ground's stamps.
    pub(super) ground: Span,
    /// Interval in which the suit's samples are suspect, by the suit's stamps.
    pub(super) suit: Span,
    channels: [Repeats; 6],
    poses: Repeats,
    jumps: JumpDetector,
    /// Stamp of the first ground sample after the last gap, ns; 0 for none.
    pub(super) resumed_ns: u64,
    /// Reading of the plate when the pose last changed; a time of 0 for none.
    reading_at_pose: Reading,
    /// Largest distance that a segment moved to the newest distinct pose, m.
    pose_step_m: f64,
    /// The plate's newest stamp when the newest pose arrived, ns.
    newest_reading_ns: u64,
    /// Pelvis pose of a sample rejected for a jump; a time of 0 for none.
    jumped_to: PelvisPose,
    /// Time of the sample from which on the suit world is another one, ns; 0 for none.
    pub(super) moved_ns: u64,
}

impl Plausibility {
    /// Compares a ground sample with the previous one. Returns whether it is plausible; an implausible sample is aligned
    /// nevertheless, and published as suspect.
    pub(super) fn check_ground(&mut self, sample: &GroundSample, before: Option<&GroundSample>) -> bool {
        let time_ns = sample.sample_time_ns;
        let from_ns = before.map_or(time_ns, |before| before.sample_time_ns);
        if time_ns.saturating_sub(from_ns) > RESTART_MIN_NS {
            self.resumed_ns = time_ns;
        }
        let mut is_plausible = true;
        if sample.force_n[2] < -EMPTY_PLATE_N {
            self.ground.add(from_ns, time_ns + JUMP_HOLDS_NS);
            is_plausible = false;
        }
        if let Some(since_ns) = self.jumps.ingest(Reading::of(sample)) {
            self.ground.add(since_ns, time_ns);
            is_plausible = false;
        }
        if let Some(begun_ns) = before.and_then(|before| self.stuck_since_ns(sample, before)) {
            self.ground.add(begun_ns, time_ns);
            is_plausible = false;
        }
        is_plausible
    }

    /// Time since when a channel has been constant while the suit shows that the body moves, ns.
    fn stuck_since_ns(&mut self, sample: &GroundSample, before: &GroundSample) -> Option<u64> {
        let numbers = |sample: &GroundSample| {
            let ([fx, fy, fz], [mx, my, mz]) = (sample.force_n, sample.moment_nm);
            [fx, fy, fz, mx, my, mz]
        };
        let since_pose_ns = sample.sample_time_ns.saturating_sub(self.newest_reading_ns);
        let suit_moves = self.poses.run == 0 && self.poses.readings > 0.0 && since_pose_ns < POSE_EVIDENCE_NS;
        let mut since_ns = None;
        for (channel, (now, then)) in numbers(sample).into_iter().zip(numbers(before)).enumerate() {
            // Exactly zero is the reading of an empty plate, or of a channel that is not measured.
            let is_same = now == then && now != 0.0;
            let is_stuck =
                self.channels[channel].ingest(is_same, before.sample_time_ns, RUN_CHANCE) && suit_moves;
            if is_stuck {
                let begun_ns = self.channels[channel].begun_ns;
                since_ns = Some(since_ns.map_or(begun_ns, |since_ns: u64| since_ns.min(begun_ns)));
            }
        }
        since_ns
    }

    /// Compares a suit sample with the previous one and with the bone lengths. Returns whether it may be used.
    pub(super) fn check_suit(
        &mut self,
        sample: &SuitSample,
        before: Option<&SuitSample>,
        bones: &Bones,
    ) -> bool {
        let time_ns = sample.sample_time_ns;
        let from_ns = before.map_or(time_ns, |before| before.sample_time_ns);
        if is_apart(sample, bones) {
            self.suit.add(from_ns, time_ns);
            return false;
        }
        let Some(before) = before.filter(|before| before.session == sample.session) else {
            self.jumped_to = Zeroable::zeroed();
            return true;
        };
        let is_same =
            sample.position_m == before.position_m && sample.orientation_wxyz == before.orientation_wxyz;
        let reading = self.jumps.newest();
        self.newest_reading_ns = reading.time_ns;
        if self.poses.run == 0 || self.reading_at_pose.time_ns == 0 {
            self.reading_at_pose = reading;
        }
        let [by_n, by_nm] = self.reading_at_pose.to(&reading);
        let plate_moves = by_n > BODY_MOVES_N || by_nm > LEVER_MAX_M * BODY_MOVES_N;
        let is_frozen = self.poses.ingest(is_same, from_ns, RUN_CHANCE);
        if plate_moves && is_frozen {
            self.suit.add(from_ns, time_ns);
            return false;
        }
        if !is_same {
            self.pose_step_m = largest_step_m(before, sample);
        }
        // Only at the start of the run: a body that really stopped is static from then on.
        let has_just_moved =
            self.pose_step_m > POSE_MOVES_M && time_ns.saturating_sub(self.poses.begun_ns) < POSE_EVIDENCE_NS;
        if is_same && (plate_moves || has_just_moved) && self.poses.probability() < REPEAT_CHANCE {
            return false;
        }
        if turns_too_fast(before, sample) {
            self.suit.add(from_ns, time_ns);
        }
        let here = PelvisPose::of(sample);
        if !here.is_beyond(&PelvisPose::of(before)) {
            self.jumped_to = Zeroable::zeroed();
            return true;
        }
        self.suit.add(from_ns, time_ns);
        let agrees = self.jumped_to.time_ns > 0 && !here.is_beyond(&self.jumped_to);
        self.jumped_to = if agrees { Zeroable::zeroed() } else { here };
        if agrees {
            self.moved_ns = time_ns;
        }
        agrees
    }

    /// Drops the plate's readings for comparison: a tare has changed their zero.
    pub(super) fn change_zero(&mut self) {
        self.jumps.restart();
        self.reading_at_pose = Zeroable::zeroed();
    }

    /// See [`JumpDetector::ingest_weight_agreement`].
    pub(super) fn ingest_weight_agreement(&mut self, agrees: Option<bool>, step_s: f64) {
        self.jumps.ingest_weight_agreement(agrees, step_s);
    }

    pub(super) fn is_sound(&self) -> bool {
        self.ground.is_sound()
            && self.suit.is_sound()
            && self.jumps.is_sound()
            && self.pose_step_m >= 0.0
            && self.channels.iter().chain([&self.poses]).all(Repeats::is_sound)
    }
}

impl Bones {
    /// The subject's bone lengths, or those of an average person of that stature.
    pub(super) fn of(subject: &Identification, settings: &Settings) -> Bones {
        if subject.has_body() {
            let skeleton = subject.skeleton();
            Bones { skeleton, limbs_alone: false, gap_max_m: JOINT_GAP_MAX_M, rms_max_m: GAPS_RMS_MAX_M }
        } else {
            let skeleton = Skeleton::nominal(settings.height_m);
            Bones { skeleton, limbs_alone: true, gap_max_m: NOMINAL_GAP_MAX_M, rms_max_m: NOMINAL_GAP_MAX_M }
        }
    }
}

fn length([x, y, z]: [f64; 3]) -> f64 {
    math::hypot([math::hypot([x, y]), z])
}

/// Largest distance that any segment moved, m.
fn largest_step_m(from: &SuitSample, to: &SuitSample) -> f64 {
    let pairs = from.position_m.iter().zip(&to.position_m);
    pairs.map(|(from, to)| length([0, 1, 2].map(|axis| to[axis] - from[axis]))).fold(0.0, f64::max)
}

/// Angle between two orientations, rad.
fn angle_rad(from_wxyz: &[f64; 4], to_wxyz: &[f64; 4]) -> f64 {
    let pairs = from_wxyz.iter().zip(to_wxyz);
    let cos_half = pairs.map(|(from, to)| from * to).sum::<f64>().abs().min(1.0);
    2.0 * math::atan2(math::sqrt(1.0 - cos_half * cos_half), cos_half)
}

/// Whether a segment turned faster than any body.
fn turns_too_fast(from: &SuitSample, to: &SuitSample) -> bool {
    let span_s = to.sample_time_ns.saturating_sub(from.sample_time_ns) as f64 * 1e-9;
    let limit_rad = TURN_MAX_RAD + SEGMENT_RATE_MAX_RAD_PER_S * span_s;
    let mut pairs = from.orientation_wxyz.iter().zip(&to.orientation_wxyz);
    pairs.any(|(from, to)| angle_rad(from, to) > limit_rad)
}

fn is_long_bone(segment: Segment) -> bool {
    use Segment::{
        LeftForearm, LeftLowerLeg, LeftUpperArm, LeftUpperLeg, RightForearm, RightLowerLeg, RightUpperArm,
        RightUpperLeg,
    };
    matches!(
        segment,
        LeftUpperArm
            | LeftForearm
            | LeftUpperLeg
            | LeftLowerLeg
            | RightUpperArm
            | RightForearm
            | RightUpperLeg
            | RightLowerLeg
    )
}

/// Whether a segment is not at the position that its parent's orientation implies.
fn is_apart(sample: &SuitSample, bones: &Bones) -> bool {
    let pose = sample.pose();
    let (mut largest_m, mut sum_m2) = (0.0_f64, 0.0);
    for segment in Segment::ALL {
        let Some(parent) = segment.parent().filter(|parent| !bones.limbs_alone || is_long_bone(*parent))
        else {
            continue;
        };
        let here_m = pose.offset_in(parent, segment);
        let by_m =
            length([0, 1, 2].map(|axis| here_m[axis] - bones.skeleton.offset_m[segment.index()][axis]));
        largest_m = largest_m.max(by_m);
        sum_m2 += by_m * by_m;
    }
    largest_m > bones.gap_max_m || sum_m2 > JOINTS as f64 * bones.rms_max_m * bones.rms_max_m
}

#[cfg(test)]
mod tests;
