//! The last suit samples, each with the wrench at its time: a snapshot is processed once the samples after it have
//! arrived.

use bytemuck::{Pod, Zeroable};
use nalgebra::Vector3;

use super::accelerations::{self, Accelerations};
use super::inertia::{Inertia, MassDistribution, angular};
use super::weights::{Weights, weights};
use crate::body::{Anthropometry, SEGMENTS};
use crate::frame::{Pose, StationWorld, SuitWorld, rotation, wxyz};
use crate::message::GroundSample;

/// Samples stored: a window of a quarter of a second at 240 Hz.
pub const CAPACITY: usize = 64;
/// Maximum number of samples after a snapshot for which it waits, whatever their duration.
const AHEAD_MAX: usize = CAPACITY / 2 - 1;
/// Maximum interval between samples for differentiation, ns.
const GAP_MAX_NS: u64 = 120_000_000;
/// Number of samples that a parabola needs on each side.
const SIDE_MIN: usize = 2;

/// One suit sample with all data of its time.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Snapshot {
    /// Sample time of the suit.
    pub time_ns: u64,
    /// The anchor's stance.
    pub stance: u64,
    /// 1-σ of its position relative to the previous stance, per axis, m.
    pub stance_sigma_m: [f64; 2],
    /// 1 while both feet stand.
    pub both_feet_stand: u64,
    /// 1-σ of the time between suit and ground, or of the suit's alone without a ground sample, ns.
    pub time_sigma_ns: u64,
    /// Segment origins, station world, m.
    pub origin_m: [[f64; 3]; SEGMENTS],
    /// `world_from_segment`, scalar first.
    pub orientation_wxyz: [[f64; 4]; SEGMENTS],
    /// The anchor's shift of the suit world, m.
    pub station_from_suit_m: [f64; 2],
    /// CoM by the suit's maker, station world, m; valid if `has_suit_com`.
    pub suit_com_m: [f64; 3],
    /// 1 if the suit sent its centre of mass.
    pub has_suit_com: u64,
    /// Accelerations of the segment origins from the suit, m/s²; valid if `has_acceleration`.
    pub acceleration_m_per_s2: [[f64; 3]; SEGMENTS],
    /// 1 if the suit sent them.
    pub has_acceleration: u64,
    /// Centres of mass of the segments by the table, in the suit world, m: there the anchor's shifts do not appear as
    /// motion.
    centre_m: [[f64; 3]; SEGMENTS],
    /// The wrench at that time; valid if `has_ground`.
    pub ground: GroundSample,
    /// 1 if the ground was not silent at that time.
    pub has_ground: u64,
}

impl Snapshot {
    /// Combines body and ground at one time.
    pub fn new(
        time_ns: u64,
        in_suit_world: &Pose<SuitWorld>,
        pose: &Pose<StationWorld>,
        body: &Anthropometry,
    ) -> Snapshot {
        let centre = |segment: usize| {
            let offset = Vector3::from(body.com_m[segment]);
            (in_suit_world.origin[segment] + in_suit_world.world_from_segment[segment] * offset).into()
        };
        Snapshot {
            time_ns,
            origin_m: pose.origin.map(Into::into),
            station_from_suit_m: (pose.origin[0] - in_suit_world.origin[0]).xy().into(),
            orientation_wxyz: pose.world_from_segment.map(|rotation| wxyz(&rotation)),
            centre_m: core::array::from_fn(centre),
            ..Zeroable::zeroed()
        }
    }

    /// Pose of the body.
    pub fn pose(&self) -> Pose<StationWorld> {
        Pose::new(self.origin_m.map(Into::into), self.orientation_wxyz.map(rotation))
    }

    fn is_sound(&self) -> bool {
        let numbers = self.origin_m.iter().flatten().chain(self.centre_m.iter().flatten());
        let wrench =
            self.ground.force_n.iter().chain(&self.ground.moment_nm).chain([&self.ground.surface_z_m]);
        let numbers = numbers
            .chain(&self.station_from_suit_m)
            .chain(&self.stance_sigma_m)
            .chain(&self.suit_com_m)
            .chain(self.acceleration_m_per_s2.iter().flatten());
        let turned = self.orientation_wxyz.iter().all(|q| {
            let square: f64 = q.iter().map(|part| part * part).sum();
            self.time_ns == 0 || (square - 1.0).abs() < 1e-2
        });
        turned
            && numbers
                .chain(self.orientation_wxyz.iter().flatten())
                .chain(wrench)
                .all(|value| value.is_finite())
    }

    /// The wrench, unless the ground was silent.
    pub fn ground(&self) -> Option<&GroundSample> {
        (self.has_ground == 1).then_some(&self.ground)
    }
}

/// A ring of snapshots. Each is released once, when the window around it is full.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct History {
    snapshots: [Snapshot; CAPACITY],
    /// Numbers of snapshots pushed and released.
    count_in: u64,
    count_out: u64,
    /// Time of the last released snapshot, ns; 0 before it.
    released_ns: u64,
}

/// More samples than arrive in a century.
const COUNT_MAX: u64 = 1 << 48;

impl History {
    /// Appends the newest snapshot.
    pub fn push(&mut self, mut snapshot: Snapshot) {
        if self.newest().is_some_and(|newest| snapshot.time_ns.saturating_sub(newest.time_ns) > GAP_MAX_NS) {
            // The windows of the waiting snapshots stay incomplete, and the snapshots are outdated.
            self.count_out = self.count_in;
        }
        if let Some(newest) = self.newest() {
            // q and −q are the same rotation; a jump between them would appear as motion.
            for (now, before) in snapshot.orientation_wxyz.iter_mut().zip(&newest.orientation_wxyz) {
                if now.iter().zip(before).map(|(a, b)| a * b).sum::<f64>() < 0.0 {
                    *now = now.map(|part| -part);
                }
            }
        }
        self.snapshots[self.count_in as usize % CAPACITY] = snapshot;
        self.count_in += 1;
    }

    /// Clears the history.
    pub fn clear(&mut self) {
        self.count_in = 0;
        self.count_out = 0;
    }

    /// The newest snapshot.
    pub fn newest(&self) -> Option<&Snapshot> {
        Some(self.at(self.count_in.checked_sub(1)?))
    }

    /// The stored snapshots after a time, oldest first, whether released or not.
    pub fn since(&self, time_ns: u64) -> impl Iterator<Item = &Snapshot> {
        let oldest = self.count_in.saturating_sub(CAPACITY as u64);
        let mut first = self.count_in;
        while first > oldest && self.at(first - 1).time_ns > time_ns {
            first -= 1;
        }
        (first..self.count_in).map(|index| self.at(index))
    }

    /// Time of the last released snapshot, ns; 0 before it. Clearing the history does not change it.
    pub fn released_ns(&self) -> u64 {
        self.released_ns
    }

    /// The next snapshot that has `half_window_ns` of motion after it, with its inertia if the window is sufficient. Its
    /// time is as uncertain as any in the window.
    pub fn next(
        &mut self,
        half_window_ns: u64,
        accelerations: Accelerations,
        masses: &MassDistribution<'_>,
    ) -> Option<(Snapshot, Option<Inertia>)> {
        let newest_ns = self.newest()?.time_ns;
        if self.count_out == self.count_in {
            return None;
        }
        let mut snapshot = *self.at(self.count_out);
        let ahead = (self.count_in - 1 - self.count_out) as usize;
        if newest_ns.saturating_sub(snapshot.time_ns) < half_window_ns && ahead < AHEAD_MAX {
            return None;
        }
        let inertia = self.inertia_at(self.count_out, half_window_ns, accelerations, masses);
        snapshot.time_sigma_ns = inertia.map_or(snapshot.time_sigma_ns, |inertia| inertia.time_sigma_ns);
        self.count_out += 1;
        self.released_ns = snapshot.time_ns;
        Some((snapshot, inertia))
    }

    /// Acceleration of the body at a snapshot; `None` with too few samples on either side, or a gap between them.
    fn inertia_at(
        &self,
        index: u64,
        half_window_ns: u64,
        accelerations: Accelerations,
        masses: &MassDistribution<'_>,
    ) -> Option<Inertia> {
        let (first, count, times_s, weights) = self.window_at(index, half_window_ns)?;
        let (mut motion, mut time_sigma_ns) = (Motion::zeroed(), 0);
        for (position, number) in (first..first + count as u64).enumerate() {
            motion.add(self.at(number), weights.first[position], weights.second[position]);
            time_sigma_ns = self.at(number).time_sigma_ns.max(time_sigma_ns);
        }
        let window = accelerations::Window { times_s: &times_s, count, weights: &weights };
        let snapshot = |position: usize| self.at(first + position as u64);
        let is_by_suit = accelerations::apply_suit_accelerations(
            &mut motion,
            accelerations,
            self.at(index),
            &window,
            snapshot,
        );
        let edges = [first, first + count as u64 - 1].into_iter();
        let full = edges.filter(|edge| edge.abs_diff(index) == AHEAD_MAX as u64);
        let half_window_ns = full
            .map(|edge| self.at(edge).time_ns.abs_diff(self.at(index).time_ns))
            .fold(half_window_ns, u64::min);
        let inertia = Inertia::of(self.at(index), &motion, masses);
        Some(Inertia { is_by_suit, half_window_ns, time_sigma_ns, ..inertia })
    }

    /// Passes every snapshot of the window around the last released one to `visit`, with its weight in a second
    /// derivative there, 1/s². Returns whether there is such a window.
    pub fn differentiate_twice(&self, half_window_ns: u64, mut visit: impl FnMut(f64, &Snapshot)) -> bool {
        let Some(index) = self.count_out.checked_sub(1) else { return false };
        let Some((first, count, _, weights)) = self.window_at(index, half_window_ns) else { return false };
        for (position, number) in (first..first + count as u64).enumerate() {
            visit(weights.second[position], self.at(number));
        }
        true
    }

    /// First snapshot of the window around one, number of snapshots, their times, and their weights.
    fn window_at(&self, index: u64, half_window_ns: u64) -> Option<(u64, usize, [f64; CAPACITY], Weights)> {
        let centre = self.at(index);
        let oldest = self.count_in.saturating_sub(CAPACITY as u64);
        let belongs = |other: u64, neighbour: u64| {
            let (other, neighbour) = (self.at(other).time_ns, self.at(neighbour).time_ns);
            other.abs_diff(centre.time_ns) <= half_window_ns && other.abs_diff(neighbour) <= GAP_MAX_NS
        };
        let (mut first, mut last) = (index, index);
        while first > oldest && (index - first) < AHEAD_MAX as u64 && belongs(first - 1, first) {
            first -= 1;
        }
        while last + 1 < self.count_in && (last - index) < AHEAD_MAX as u64 && belongs(last + 1, last) {
            last += 1;
        }
        let sides = [index - first, last - index];
        if sides.iter().any(|side| *side < SIDE_MIN as u64) {
            return None;
        }
        let mut times_s = [0.0; CAPACITY];
        for (time_s, number) in times_s.iter_mut().zip(first..=last) {
            *time_s = (self.at(number).time_ns as f64 - centre.time_ns as f64) * 1e-9;
        }
        let count = (last - first + 1) as usize;
        Some((first, count, times_s, weights(&times_s[..count])?))
    }

    /// The samples of the last `span_ns`, at most all that are stored: number of the first, and their count. `None` with
    /// fewer than `samples_min`, or if a gap or the start lies within the span.
    pub(super) fn last_samples(&self, span_ns: u64, samples_min: usize) -> Option<(u64, usize)> {
        let last = self.count_in.checked_sub(1)?;
        let newest_ns = self.at(last).time_ns;
        let oldest = self.count_in.saturating_sub(CAPACITY as u64);
        let mut first = last;
        loop {
            // The sample before the span shows that the span is filled.
            let before_ns = self.at(first.checked_sub(1).filter(|before| *before >= oldest)?).time_ns;
            if self.at(first).time_ns.saturating_sub(before_ns) > GAP_MAX_NS {
                return None;
            }
            if newest_ns.saturating_sub(before_ns) > span_ns || last - first + 2 == CAPACITY as u64 {
                break;
            }
            first -= 1;
        }
        let count = (last - first + 1) as usize;
        (count >= samples_min).then_some((first, count))
    }

    pub(super) fn at(&self, index: u64) -> &Snapshot {
        &self.snapshots[index as usize % CAPACITY]
    }

    /// Whether indices and numbers are in range; a stored history is checked before use.
    pub fn is_sound(&self) -> bool {
        self.count_out <= self.count_in
            && self.count_in - self.count_out <= CAPACITY as u64
            && self.count_in < COUNT_MAX
            && self.snapshots.iter().all(Snapshot::is_sound)
    }
}

/// Derivatives at a snapshot: sums over the snapshots of the window around it.
#[derive(Debug, Clone, Copy)]
pub struct Motion {
    /// Second derivative of each segment's centre, m/s².
    pub(super) acceleration_m_per_s2: [[f64; 3]; SEGMENTS],
    /// First and second derivative of each orientation's quaternion, 1/s and 1/s².
    pub(super) turning: [[[f64; 4]; 2]; SEGMENTS],
}

impl Motion {
    /// The empty sum.
    pub fn zeroed() -> Motion {
        Motion { acceleration_m_per_s2: [[0.0; 3]; SEGMENTS], turning: [[[0.0; 4]; 2]; SEGMENTS] }
    }

    /// Angular velocity and acceleration of a segment, world, rad/s and rad/s².
    pub(super) fn angular(&self, segment: usize, orientation: &[f64; 4]) -> (Vector3<f64>, Vector3<f64>) {
        angular(orientation, &self.turning[segment])
    }

    /// Adds one snapshot of the window with its weights in the first and the second derivative, 1/s and 1/s².
    pub fn add(&mut self, snapshot: &Snapshot, first: f64, second: f64) {
        for (sum, value) in
            self.acceleration_m_per_s2.iter_mut().flatten().zip(snapshot.centre_m.iter().flatten())
        {
            *sum += second * value;
        }
        for (sums, values) in self.turning.iter_mut().zip(&snapshot.orientation_wxyz) {
            for (part, value) in values.iter().enumerate() {
                sums[0][part] += first * value;
                sums[1][part] += second * value;
            }
        }
    }
}

impl Snapshot {
    /// From a segment's origin to its centre of mass by the table, world axes, m.
    pub(super) fn arm(&self, segment: usize) -> Vector3<f64> {
        let [x, y] = self.station_from_suit_m;
        self.centre(segment) + Vector3::new(x, y, 0.0) - Vector3::from(self.origin_m[segment])
    }

    /// Centre of mass of a segment by the table, suit world, m.
    pub(super) fn centre(&self, segment: usize) -> Vector3<f64> {
        Vector3::from(self.centre_m[segment])
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::boxed::Box;
    use std::vec::Vec;

    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::body::{Segment, Sex, Skeleton, gyration_m2};

    const PERIOD_NS: u64 = 10_000_000;
    const HALF_NS: u64 = 70_000_000;

    fn skeleton() -> Skeleton {
        Skeleton::nominal(1.77)
    }

    /// A rigid body that is thrown forward while it rotates about its vertical axis.
    fn snapshot_at(index: u64, body: &Anthropometry) -> Snapshot {
        let time_s = (index * PERIOD_NS) as f64 * 1e-9;
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 1.5 * time_s);
        let pelvis = Vector3::new(0.8 * time_s * time_s, 0.3 * time_s, 0.95);
        let origin = skeleton().t_pose_m().map(|origin| pelvis + turn * Vector3::from(origin));
        let in_suit_world = Pose::<SuitWorld>::new(origin, [turn; SEGMENTS]);
        // The anchor's shift jumps in the middle, as at a step.
        let shift = Vector3::new(if index < 20 { 0.1 } else { 0.3 }, -0.2, 0.0);
        Snapshot::new(index * PERIOD_NS, &in_suit_world, &in_suit_world.shifted(shift), body)
    }

    fn released(upto: u64) -> (Box<History>, Vec<(Snapshot, Option<Inertia>)>) {
        let body = Anthropometry::de_leva(&skeleton(), 1.77, Sex::Male);
        let gyration_m2 = gyration_m2(&skeleton(), 1.77);
        let masses = MassDistribution { body: &body, gyration_m2: &gyration_m2 };
        let mut history: Box<History> = bytemuck::zeroed_box();
        let mut out = Vec::new();
        for index in 1..=upto {
            history.push(snapshot_at(index, &body));
            while let Some(next) = history.next(HALF_NS, Accelerations::Positions, &masses) {
                out.push(next);
            }
        }
        (history, out)
    }

    #[test]
    fn each_snapshot_is_released_once_in_order_when_its_window_is_full() {
        let (_, out) = released(200);
        assert_eq!(out.len(), 200 - 7);
        for (index, (snapshot, inertia)) in out.iter().enumerate() {
            assert_eq!(snapshot.time_ns, (index as u64 + 1) * PERIOD_NS);
            assert_eq!(inertia.is_some(), index >= 2, "{index}: two samples before it are needed");
        }
    }

    #[test]
    fn a_step_of_the_anchor_is_no_acceleration() {
        // On the vertical axis only the throw accelerates; the table's CoM lies slightly off it and rotates.
        let (_, out) = released(60);
        for (_, inertia) in out.into_iter().skip(8) {
            let [x, _, z] = inertia.unwrap().acceleration_m_per_s2;
            assert!((x - 1.6).abs() < 0.2 && z.abs() < 1e-9, "{x} {z}");
        }
    }

    #[test]
    fn differentiated_by_hand_the_chain_accelerates_as_the_inertia_says() {
        let body = Anthropometry::de_leva(&skeleton(), 1.77, Sex::Male);
        let (history, out) = released(60);
        let mut sum = Vector3::zeros();
        assert!(history.differentiate_twice(HALF_NS, |weight, near| {
            let shift = Vector3::new(near.station_from_suit_m[0], near.station_from_suit_m[1], 0.0);
            for segment in Segment::ALL {
                let index = segment.index();
                let centre = near.pose().point_on(segment, body.com_m[index]) - shift;
                sum += weight * body.mass_fraction[index] * centre;
            }
        }));
        let inertia = out.last().unwrap().1.unwrap();
        assert!((sum - Vector3::from(inertia.acceleration_m_per_s2)).norm() < 1e-9, "{sum} {inertia:?}");
    }

    #[test]
    fn samples_next_to_a_gap_have_no_inertia() {
        let body = Anthropometry::de_leva(&skeleton(), 1.77, Sex::Male);
        let gyration_m2 = gyration_m2(&skeleton(), 1.77);
        let masses = MassDistribution { body: &body, gyration_m2: &gyration_m2 };
        let mut history: Box<History> = bytemuck::zeroed_box();
        let mut without = 0;
        for index in (1..30).chain(60..90) {
            history.push(snapshot_at(index, &body));
            while let Some((_, inertia)) = history.next(HALF_NS, Accelerations::Positions, &masses) {
                without += u32::from(inertia.is_none());
            }
        }
        // Two at the start, two after the gap; the seven before the gap with incomplete windows are never released.
        assert_eq!(without, 4);
        assert!(history.is_sound());
    }
}
