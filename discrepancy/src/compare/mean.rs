//! Means over a block.

use equipoise_core::body::SEGMENTS;
use equipoise_core::effect::Observation;
use nalgebra::{Quaternion, UnitQuaternion};

use super::changes::Timing;
use super::options::Options;
use super::point::Point;
use super::window::{Window, matrix};
use super::worker::Worker;
use crate::block::{Block, Change, Phase, heading_rad, joint_rad};
use crate::constants::{BLOCK_REACH, CUTOFFS_HZ};

/// A block under construction.
#[derive(Debug)]
pub(super) struct BlockMean {
    /// Number of the block since the recording's start.
    pub(super) number: f64,
    /// Start and end, s.
    pub(super) span_s: [f64; 2],
    stance: u64,
    has_inertia: bool,
    count: f64,
    /// Times of the first and the last point, s.
    reach_s: [f64; 2],
    sum: Sum,
    by_cutoff: [Change; CUTOFFS_HZ.len()],
    /// Number of the first contributing snapshot, and the summed weights of each in values and second derivatives.
    first_snapshot: usize,
    weights: Vec<[f64; 2]>,
    bodies: Box<Bodies>,
}

/// Sums over points.
#[derive(Debug, Default)]
struct Sum {
    time_s: f64,
    floor_m: f64,
    feet_m: [f64; 2],
    com_m: [f64; 3],
    com_velocity_m_per_s: [f64; 3],
    com_acceleration_m_per_s2: [f64; 3],
    turning_by_group_m: [[f64; 2]; 4],
    slope: [f64; 2],
    measured_slopes: f64,
    cop_predicted_m: [f64; 2],
    force_predicted_n: [f64; 3],
    cop_measured_m: [f64; 2],
    force_measured_n: [f64; 3],
}

/// Sums over snapshots: positions and orientations of the segments.
#[derive(Debug)]
struct Bodies {
    origin_m: [[f64; 3]; SEGMENTS],
    origin_acceleration_m_per_s2: [[f64; 3]; SEGMENTS],
    rotation: [[[f64; 3]; 3]; SEGMENTS],
    rotation_acceleration_per_s2: [[[f64; 3]; 3]; SEGMENTS],
    joint_weighted_rotation_acceleration: [[[[f64; 3]; 3]; 3]; SEGMENTS],
    quaternion: [[f64; 4]; SEGMENTS],
}

impl BlockMean {
    pub(super) fn new(number: f64, options: &Options) -> BlockMean {
        let from_s = number * options.block_s;
        BlockMean {
            number,
            span_s: [from_s, from_s + options.block_s],
            stance: 0,
            has_inertia: false,
            count: 0.0,
            reach_s: [f64::INFINITY, f64::NEG_INFINITY],
            sum: Sum::default(),
            by_cutoff: [Change::NONE; CUTOFFS_HZ.len()],
            first_snapshot: 0,
            weights: Vec::new(),
            bodies: Box::new(Bodies {
                origin_m: [[0.0; 3]; SEGMENTS],
                origin_acceleration_m_per_s2: [[0.0; 3]; SEGMENTS],
                rotation: [[[0.0; 3]; 3]; SEGMENTS],
                rotation_acceleration_per_s2: [[[0.0; 3]; 3]; SEGMENTS],
                joint_weighted_rotation_acceleration: [[[[0.0; 3]; 3]; 3]; SEGMENTS],
                quaternion: [[0.0; 4]; SEGMENTS],
            }),
        }
    }

    /// Adds a point and the change of its prediction by each filter.
    pub(super) fn add(&mut self, point: &Point, by_cutoff: &[Change; CUTOFFS_HZ.len()]) {
        self.count += 1.0;
        self.stance = point.stance;
        self.has_inertia = point.has_inertia;
        self.reach_s = [self.reach_s[0].min(point.time_s), self.reach_s[1].max(point.time_s)];
        let sum = &mut self.sum;
        sum.time_s += point.time_s;
        sum.floor_m += point.floor_m;
        add(&mut sum.feet_m, &point.feet_m);
        add(&mut sum.com_m, point.com_m.as_ref());
        add(&mut sum.com_velocity_m_per_s, point.com_velocity_m_per_s.as_ref());
        add(&mut sum.com_acceleration_m_per_s2, point.com_acceleration_m_per_s2.as_ref());
        for (sum, group) in sum.turning_by_group_m.iter_mut().zip(&point.turning_by_group_m) {
            add(sum, group);
        }
        add(&mut sum.slope, &point.slope);
        sum.measured_slopes += f64::from(u8::from(point.slope_is_measured));
        add(&mut sum.cop_predicted_m, &point.cop_predicted_m);
        add(&mut sum.force_predicted_n, &point.force_predicted_n);
        add(&mut sum.cop_measured_m, &point.cop_measured_m);
        add(&mut sum.force_measured_n, &point.force_measured_n);
        self.by_cutoff.iter_mut().zip(by_cutoff).for_each(|(sum, change)| sum.add(1.0, change));
        self.weigh_snapshots(point);
    }

    fn weigh_snapshots(&mut self, point: &Point) {
        let neighbourhood = &point.neighbourhood;
        if self.weights.is_empty() {
            self.first_snapshot = neighbourhood.first;
        }
        let offset = neighbourhood.first.saturating_sub(self.first_snapshot);
        self.weights.resize(self.weights.len().max(offset + neighbourhood.count), [0.0; 2]);
        for (place, sums) in self.weights[offset..offset + neighbourhood.count].iter_mut().enumerate() {
            sums[0] += neighbourhood.weights.value[place];
            sums[1] += neighbourhood.weights.second[place];
        }
    }

    /// Whether the points cover most of the block.
    pub(super) fn is_complete(&self, options: &Options) -> bool {
        self.reach_s[1] - self.reach_s[0] >= BLOCK_REACH * options.block_s
    }

    /// Sums the snapshots with their weights once all points are added: the mean over points of linearly smoothed or
    /// differentiated quantities is one weighted sum over snapshots.
    pub(super) fn add_snapshots(&mut self, window: &Window) {
        let bodies = &mut *self.bodies;
        for (place, weights) in self.weights.iter().enumerate() {
            let Some(sample) = window.get(self.first_snapshot + place) else { continue };
            let [value, second] = weights.map(|weight| weight / self.count);
            let [shift_x, shift_y] = sample.snapshot.station_from_suit_m;
            for segment in 0..SEGMENTS {
                let [x, y, z] = sample.snapshot.origin_m[segment];
                add_scaled(&mut bodies.origin_m[segment], value, &[x, y, z]);
                // In the suit's own world: the anchor's shift is no motion of the body.
                let in_suit_world = [x - shift_x, y - shift_y, z];
                add_scaled(&mut bodies.origin_acceleration_m_per_s2[segment], second, &in_suit_world);
                add_scaled(
                    &mut bodies.quaternion[segment],
                    value,
                    &sample.snapshot.orientation_wxyz[segment],
                );
                for (row, entries) in matrix(&sample.snapshot, segment).iter().enumerate() {
                    add_scaled(&mut bodies.rotation[segment][row], value, entries);
                    add_scaled(&mut bodies.rotation_acceleration_per_s2[segment][row], second, entries);
                    let bent = bodies.joint_weighted_rotation_acceleration[segment].iter_mut();
                    for (bent, joint_rad) in bent.zip(sample.joint_rad[segment]) {
                        add_scaled(&mut bent[row], second * joint_rad, entries);
                    }
                }
            }
        }
    }

    /// The block.
    pub(super) fn block(self, phase: Phase, still: bool, timing: &Timing, worker: &Worker) -> Block {
        let (sum, bodies, count) = (&self.sum, &*self.bodies, self.count);
        let rotation = bodies
            .quaternion
            .map(|[w, x, y, z]| UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)));
        let heading_rad = heading_rad(&rotation);
        let turning_by_group_m = sum.turning_by_group_m.map(|group| mean(group, count));
        let observation = Observation {
            time_s: sum.time_s / count,
            mass_kg: worker.mass_kg,
            floor_m: sum.floor_m / count,
            feet_m: mean(sum.feet_m, count),
            feet_hold: worker.feet_hold,
            origin_m: bodies.origin_m,
            origin_acceleration_m_per_s2: bodies.origin_acceleration_m_per_s2,
            rotation: bodies.rotation,
            rotation_acceleration_per_s2: bodies.rotation_acceleration_per_s2,
            phi_m: worker.phi.0,
            grip_m: worker.grip_m(),
            centre_m: worker.body.com_m,
            mass_fraction: if self.has_inertia { worker.body.mass_fraction } else { [0.0; SEGMENTS] },
            com_m: mean(sum.com_m, count),
            com_acceleration_m_per_s2: mean(sum.com_acceleration_m_per_s2, count),
            turning_m: [0, 1].map(|axis| turning_by_group_m.iter().map(|group| group[axis]).sum()),
            slope: mean(sum.slope, count),
            slope_is_measured: sum.measured_slopes > 0.5 * count,
            cop_predicted_m: mean(sum.cop_predicted_m, count),
            force_predicted_n: mean(sum.force_predicted_n, count),
            cop_measured_m: mean(sum.cop_measured_m, count),
            force_measured_n: mean(sum.force_measured_n, count),
        };
        Block {
            phase,
            stance: self.stance,
            still,
            observation,
            com_velocity_m_per_s: mean(sum.com_velocity_m_per_s, count),
            turning_by_group_m,
            joint_rad: joint_rad(&rotation, heading_rad),
            joint_weighted_rotation_acceleration: bodies.joint_weighted_rotation_acceleration,
            heading_rad,
            by_lag: timing.by_lag,
            by_cutoff: std::array::from_fn(|k| timing.by_cutoff(k, &self.by_cutoff[k], count)),
        }
    }
}

fn add<const N: usize>(sum: &mut [f64; N], value: &[f64; N]) {
    add_scaled(sum, 1.0, value);
}

fn add_scaled<const N: usize>(sum: &mut [f64; N], scale: f64, value: &[f64; N]) {
    for (sum, value) in sum.iter_mut().zip(value) {
        *sum += scale * value;
    }
}

fn mean<const N: usize>(sum: [f64; N], count: f64) -> [f64; N] {
    sum.map(|sum| sum / count)
}
