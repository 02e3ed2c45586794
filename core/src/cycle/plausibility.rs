//! Samples that no body and no working sensor gives.
//!
//! A device that fails seldom says so: it repeats what it said last, stops at the end of its range, loses a sign, or doubles
//! a reading for some milliseconds. Each sample is held against those before it, before it is aligned. What fails
//! makes a [`Span`] of time suspect, and no moment that touches the span is told, learnt from or counted. Torques are told
//! about half a window late, so most spans are known before the first of their moments is due.

mod leaps;

use bytemuck::{Pod, Zeroable};
use leaps::{LEAP_HOLDS_NS, LEVER_MAX_M, Leaps, Reading};

use super::memory::{EMPTY_PLATE_N, Memory};
use super::settings::Settings;
use crate::body::{JOINTS, Segment, Skeleton};
use crate::math;
use crate::message::{GroundSample, SuitSample};

/// Channels of a plate are coarse, and recorded poses may be rounded: both repeat themselves now and then. A run that a stream
/// shows less often than once in so many samples is none of its own: 3 hours at 1 kHz.
const RUN_CHANCE: f64 = 1e-7;
/// A suit that seldom repeats a pose, less than once in so many samples, does so when it lost one or froze: such a pose is left out
/// like a lost one, which costs nothing.
const REPEAT_CHANCE: f64 = 1e-2;
/// A plate that changes by more, N, shows that somebody moves: the heart of one who stands still gives the plate some 2 N.
const BODY_MOVES_N: f64 = 1.0;
/// For so long after a pose the suit shows that the body moves, ns: three samples of the slowest suit, 30 Hz.
const POSE_TELLS_NS: u64 = 100_000_000;
/// A segment that moved farther than this from the pose before, m, does not stop within one sample: 60 mm/s at 60 Hz. Recorded
/// positions are rounded to a millimetre at most.
const POSE_MOVES_M: f64 = 1e-3;
/// Runs are judged by about so many readings.
const READINGS_KEPT: f64 = 4096.0;

/// Shoulder blades slide and soft tissue gives by centimetres; a segment that is farther from where its parent's orientation
/// puts it is turned otherwise, m …
const JOINT_GAP_MAX_M: f64 = 0.1;
/// … and so is a body whose segments are that far off on the whole, RMS, m: soft tissue of a lifting body makes 0.009.
const GAPS_RMS_MAX_M: f64 = 0.03;
/// … and where the worker's own bones are not known yet, but a person's of that stature, m.
const NOMINAL_GAP_MAX_M: f64 = 0.2;

/// No pelvis moves faster, m/s: a sprint is at 10 m/s, a fall from a metre ends at 4.4 m/s.
const PELVIS_SPEED_MAX_M_PER_S: f64 = 5.0;
/// A suit corrects its drift by steps smaller than this, m …
const PELVIS_STEP_MAX_M: f64 = 0.1;
/// … and its heading, rad.
const PELVIS_TURN_MAX_RAD: f64 = 0.3;
/// No pelvis turns faster, rad/s: a figure skater spins at 30, a worker who whirls round at 8.
const PELVIS_RATE_MAX_RAD_PER_S: f64 = 15.0;

/// A time in which a sensor is not to be believed; all zero for none.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Span {
    from_ns: u64,
    to_ns: u64,
}

impl Span {
    /// Adds a time; two that are a jump's aftermath apart, or less, become one.
    fn add(&mut self, from_ns: u64, to_ns: u64) {
        if self.to_ns > 0 && from_ns <= self.to_ns.saturating_add(LEAP_HOLDS_NS) {
            *self = Span { from_ns: self.from_ns.min(from_ns), to_ns: self.to_ns.max(to_ns) };
        } else {
            *self = Span { from_ns, to_ns };
        }
    }

    /// Whether any of the time from `from_ns` to `to_ns` is in it.
    pub(super) fn touches(&self, from_ns: u64, to_ns: u64) -> bool {
        self.to_ns > 0 && self.from_ns <= to_ns && from_ns <= self.to_ns
    }

    fn is_sound(&self) -> bool {
        self.from_ns <= self.to_ns
    }
}

/// How often a reading is the same as the one before, and for how long it is now.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Repeats {
    /// Readings and repetitions among them, of runs that have ended; weighted, the newest most.
    readings: f64,
    repetitions: f64,
    /// Repetitions in the run that goes on, and the time of its first reading, ns.
    run: u64,
    begun_ns: u64,
}

impl Repeats {
    /// Takes in whether a reading is the same as the one before, which was at `before_ns`. Returns whether its run is one that a
    /// working sensor shows with less than `chance`.
    fn take_in(&mut self, is_same: bool, before_ns: u64, chance: f64) -> bool {
        if is_same {
            if self.run == 0 {
                self.begun_ns = before_ns;
            }
            self.run += 1;
            return self.is_beyond(chance);
        }
        // One that was not believed tells of the sensor's failure, not of its habits, but habits may change, too.
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

    /// Probability that a reading is the one before: mean of its Beta distribution.
    fn probability(&self) -> f64 {
        (self.repetitions + 1.0) / (self.readings + 2.0)
    }

    /// Whether a run is as long as the one that goes on with less than `chance`.
    fn is_beyond(&self, chance: f64) -> bool {
        self.run as f64 * math::ln(self.probability()) < math::ln(chance)
    }

    fn is_sound(&self) -> bool {
        self.readings >= 0.0
            && self.readings <= 2.0 * READINGS_KEPT + self.run as f64
            && (0.0..=self.readings).contains(&self.repetitions)
    }
}

/// Bones that a pose is held against.
struct Bones {
    skeleton: Skeleton,
    /// Where a suit divides spine and shoulders is its own; arms and legs are where everybody has them.
    limbs_alone: bool,
    /// No joint may be farther apart, and not all of them together (RMS), m.
    gap_max_m: f64,
    rms_max_m: f64,
}

/// Where the pelvis is.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Whereabouts {
    time_ns: u64,
    position_m: [f64; 3],
    orientation_wxyz: [f64; 4],
}

impl Whereabouts {
    fn of(sample: &SuitSample) -> Whereabouts {
        let pelvis = Segment::Pelvis.index();
        Whereabouts {
            time_ns: sample.sample_time_ns,
            position_m: sample.position_m[pelvis],
            orientation_wxyz: sample.orientation_wxyz[pelvis],
        }
    }

    /// Whether no body comes here from there.
    fn is_beyond(&self, there: &Whereabouts) -> bool {
        let span_s = self.time_ns.saturating_sub(there.time_ns) as f64 * 1e-9;
        let by_m = length([0, 1, 2].map(|axis| self.position_m[axis] - there.position_m[axis]));
        let pairs = self.orientation_wxyz.iter().zip(&there.orientation_wxyz);
        let cos_half = pairs.map(|(here, there)| here * there).sum::<f64>().abs().min(1.0);
        let by_rad = 2.0 * math::atan2(math::sqrt(1.0 - cos_half * cos_half), cos_half);
        by_m > PELVIS_STEP_MAX_M + PELVIS_SPEED_MAX_M_PER_S * span_s
            || by_rad > PELVIS_TURN_MAX_RAD + PELVIS_RATE_MAX_RAD_PER_S * span_s
    }
}

/// What is held against the samples to come, and what was found.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Plausibility {
    /// When the plate's samples are suspect, by the ground's stamps.
    pub(super) ground: Span,
    /// When the suit's are, by the suit's.
    pub(super) suit: Span,
    channels: [Repeats; 6],
    poses: Repeats,
    leaps: Leaps,
    /// What the plate showed when the pose was another one.
    shown_at_pose: Reading,
    /// How far a segment moved at most to the newest pose that was another one, m.
    pose_step_m: f64,
    /// The plate's newest stamp when the newest pose came, ns.
    shown_newest_ns: u64,
    /// A pelvis that leapt; a time of 0 for none.
    leapt: Whereabouts,
    /// The sample with which the suit's world was another one than before, ns; 0 for none.
    pub(super) moved_ns: u64,
}

impl Plausibility {
    /// Holds a ground sample against the one `before`. Returns whether it may be believed.
    fn watch_ground(&mut self, sample: &GroundSample, before: Option<&GroundSample>) -> bool {
        let time_ns = sample.sample_time_ns;
        let from_ns = before.map_or(time_ns, |before| before.sample_time_ns);
        let mut is_plausible = true;
        if sample.force_n[2] < -EMPTY_PLATE_N {
            self.ground.add(from_ns, time_ns + LEAP_HOLDS_NS);
            is_plausible = false;
        }
        if let Some(since_ns) = self.leaps.take_in(Reading::of(sample)) {
            self.ground.add(since_ns, time_ns);
            is_plausible = false;
        }
        if let Some(begun_ns) = before.and_then(|before| self.stuck_since_ns(sample, before)) {
            self.ground.add(begun_ns, time_ns);
            is_plausible = false;
        }
        is_plausible
    }

    /// Since when a channel shows one and the same number while the suit shows that the body moves, ns.
    fn stuck_since_ns(&mut self, sample: &GroundSample, before: &GroundSample) -> Option<u64> {
        let numbers = |sample: &GroundSample| {
            let ([fx, fy, fz], [mx, my, mz]) = (sample.force_n, sample.moment_nm);
            [fx, fy, fz, mx, my, mz]
        };
        let since_pose_ns = sample.sample_time_ns.saturating_sub(self.shown_newest_ns);
        let suit_moves = self.poses.run == 0 && self.poses.readings > 0.0 && since_pose_ns < POSE_TELLS_NS;
        let mut since_ns = None;
        for (channel, (now, then)) in numbers(sample).into_iter().zip(numbers(before)).enumerate() {
            // Exactly nothing is what an empty plate shows, and one that does not measure it.
            let is_same = now == then && now != 0.0;
            let is_stuck =
                self.channels[channel].take_in(is_same, before.sample_time_ns, RUN_CHANCE) && suit_moves;
            if is_stuck {
                let begun_ns = self.channels[channel].begun_ns;
                since_ns = Some(since_ns.map_or(begun_ns, |since_ns: u64| since_ns.min(begun_ns)));
            }
        }
        since_ns
    }

    /// Holds a suit sample against the one `before`, and against bones. Returns whether it may be used.
    fn watch_suit(&mut self, sample: &SuitSample, before: Option<&SuitSample>, bones: &Bones) -> bool {
        let time_ns = sample.sample_time_ns;
        let from_ns = before.map_or(time_ns, |before| before.sample_time_ns);
        if is_apart(sample, bones) {
            self.suit.add(from_ns, time_ns);
            return false;
        }
        let Some(before) = before.filter(|before| before.session == sample.session) else {
            self.leapt = Zeroable::zeroed();
            return true;
        };
        let is_same =
            sample.position_m == before.position_m && sample.orientation_wxyz == before.orientation_wxyz;
        let shown = self.leaps.newest();
        self.shown_newest_ns = shown.time_ns;
        if self.poses.run == 0 {
            self.shown_at_pose = shown;
        }
        let [by_n, by_nm] = self.shown_at_pose.to(&shown);
        let plate_moves = by_n > BODY_MOVES_N || by_nm > LEVER_MAX_M * BODY_MOVES_N;
        let is_frozen = self.poses.take_in(is_same, from_ns, RUN_CHANCE);
        if plate_moves && is_frozen {
            self.suit.add(from_ns, time_ns);
            return false;
        }
        if !is_same {
            self.pose_step_m = largest_step_m(before, sample);
        }
        // Only at first: a body that really stopped is static from then on.
        let has_just_moved =
            self.pose_step_m > POSE_MOVES_M && time_ns.saturating_sub(self.poses.begun_ns) < POSE_TELLS_NS;
        if is_same && (plate_moves || has_just_moved) && self.poses.probability() < REPEAT_CHANCE {
            return false;
        }
        let here = Whereabouts::of(sample);
        if !here.is_beyond(&Whereabouts::of(before)) {
            self.leapt = Zeroable::zeroed();
            return true;
        }
        self.suit.add(from_ns, time_ns);
        let agrees = self.leapt.time_ns > 0 && !here.is_beyond(&self.leapt);
        self.leapt = if agrees { Zeroable::zeroed() } else { here };
        if agrees {
            self.moved_ns = time_ns;
        }
        agrees
    }

    /// See [`Leaps::hear_of_weight`].
    pub(super) fn hear_of_weight(&mut self, agrees: Option<bool>, step_s: f64) {
        self.leaps.hear_of_weight(agrees, step_s);
    }

    pub(super) fn is_sound(&self) -> bool {
        self.ground.is_sound()
            && self.suit.is_sound()
            && self.leaps.is_sound()
            && self.pose_step_m >= 0.0
            && self.channels.iter().chain([&self.poses]).all(Repeats::is_sound)
    }
}

impl Memory {
    /// Holds a ground sample against those before it. Returns whether it may be believed; one that may not is aligned all
    /// the same: it is told as suspect.
    pub(super) fn believes_ground(&mut self, sample: &GroundSample) -> bool {
        self.plausibility.watch_ground(sample, self.alignment.newest_ground())
    }

    /// Holds a suit sample against those before it and against the worker's bones. Returns whether it may be used.
    pub(super) fn believes_suit(&mut self, sample: &SuitSample, settings: &Settings) -> bool {
        let bones = if self.identification.has_body() {
            let skeleton = self.identification.skeleton();
            Bones { skeleton, limbs_alone: false, gap_max_m: JOINT_GAP_MAX_M, rms_max_m: GAPS_RMS_MAX_M }
        } else {
            let skeleton = Skeleton::nominal(settings.height_m);
            Bones { skeleton, limbs_alone: true, gap_max_m: NOMINAL_GAP_MAX_M, rms_max_m: NOMINAL_GAP_MAX_M }
        };
        self.plausibility.watch_suit(sample, self.alignment.newest_suit(), &bones)
    }
}

fn length([x, y, z]: [f64; 3]) -> f64 {
    math::hypot([math::hypot([x, y]), z])
}

/// How far the segment moved that moved farthest, m.
fn largest_step_m(from: &SuitSample, to: &SuitSample) -> f64 {
    let pairs = from.position_m.iter().zip(&to.position_m);
    pairs.map(|(from, to)| length([0, 1, 2].map(|axis| to[axis] - from[axis]))).fold(0.0, f64::max)
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

/// Whether a segment is not where its parent's orientation puts it.
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
