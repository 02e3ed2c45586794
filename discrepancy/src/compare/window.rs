//! The snapshots around the current one, and the weights of their averages and derivatives.

use std::collections::VecDeque;

use equipoise_core::body::SEGMENTS;
use equipoise_core::frame::StationWorld;
use equipoise_core::frame::{Pose, rotation};
use equipoise_core::message::Component;
use equipoise_core::motion::Snapshot;
use equipoise_core::motion::history::CAPACITY;
use equipoise_core::motion::weights::{Weights, weights};
use nalgebra::Vector3;

use super::options::Options;
use super::point::Point;
use super::worker::Worker;
use crate::block::{heading_rad, joint_rad};
use crate::constants::{SNAPSHOT_RESERVE_S, TIME_TOLERANCE_S, WINDOW_REACH, WINDOW_SIDE_MIN};

/// Maximum number of snapshots on each side.
const SIDE_MAX: usize = CAPACITY / 2 - 1;

/// A snapshot and its quantities to be smoothed.
#[derive(Debug, Clone)]
pub(super) struct Sample {
    /// Time since the recording's start, s.
    pub(super) time_s: f64,
    pub(super) snapshot: Snapshot,
    /// Centre of mass by the chain in the suit's own world, m: the anchor's shifts are no motion of the body.
    pub(super) centre_m: Vector3<f64>,
    /// As [`crate::block::Block::joint_rad`].
    pub(super) joint_rad: [[f64; 3]; SEGMENTS],
    /// Plate data; `None` without a centre of pressure.
    pub(super) ground: Option<PlateReading>,
}

/// Plate data at a snapshot.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlateReading {
    pub(super) force_n: [f64; 3],
    /// Whether the horizontal part of it was measured.
    pub(super) has_shear: bool,
    /// Centre of pressure times vertical force, N m: unlike the quotient, this may be averaged.
    pub(super) cop_nm: [f64; 2],
}

/// The snapshots of the last second.
#[derive(Debug)]
pub(super) struct Window {
    half_s: f64,
    /// Snapshots older than this are dropped, s.
    kept_s: f64,
    samples: VecDeque<Sample>,
    /// Number of dropped snapshots, and number of the next snapshot to be processed.
    dropped: usize,
    next: usize,
}

/// The window around a snapshot: number of its first snapshot, and the weights of all snapshots in it.
#[derive(Debug)]
pub(super) struct Neighbourhood {
    pub(super) first: usize,
    pub(super) count: usize,
    pub(super) weights: Weights,
}

impl Window {
    pub(super) fn new(half_s: f64, block_s: f64) -> Window {
        // A block, half a window on both sides of it, and a gap.
        let kept_s = block_s + 2.0 * half_s + SNAPSHOT_RESERVE_S;
        Window { half_s, kept_s, samples: VecDeque::new(), dropped: 0, next: 0 }
    }

    pub(super) fn clear(&mut self) {
        self.dropped += self.samples.len();
        self.next = self.dropped;
        self.samples.clear();
    }

    /// Ingests a snapshot; returns whether the plate has a centre of pressure.
    pub(super) fn push(&mut self, time_s: f64, snapshot: &Snapshot, worker: &Worker) -> bool {
        let oldest_s = time_s - self.kept_s;
        let old = |sample: &mut Sample| sample.time_s < oldest_s;
        while self.next > self.dropped && self.samples.pop_front_if(old).is_some() {
            self.dropped += 1;
        }
        let [x, y] = snapshot.station_from_suit_m;
        let centre_m = chain(&snapshot.pose(), worker) - Vector3::new(x, y, 0.0);
        let ground = snapshot.ground().and_then(|ground| {
            let [x, y] = ground.cop_m().ok()?;
            let vertical_n = ground.force_n[2];
            // A device that does not declare shear as unmeasured but reports exactly zero does not measure it either.
            let has_shear = ground.measures(Component::Shear) && ground.force_n[..2] != [0.0; 2];
            Some(PlateReading {
                force_n: ground.force_n,
                has_shear,
                cop_nm: [x * vertical_n, y * vertical_n],
            })
        });
        let has_cop = ground.is_some();
        let turned = snapshot.orientation_wxyz.map(rotation);
        let joint_rad = joint_rad(&turned, heading_rad(&turned));
        self.samples.push_back(Sample { time_s, snapshot: *snapshot, centre_m, joint_rad, ground });
        has_cop
    }

    /// Compares the next snapshot whose following samples have arrived; skips snapshots with an incomplete window.
    pub(super) fn next(&mut self, worker: &Worker, options: &Options) -> Option<Point> {
        let newest_s = self.samples.back()?.time_s;
        while self.next < self.dropped + self.samples.len() {
            let number = self.next;
            if self.at(number).time_s + self.half_s > newest_s + TIME_TOLERANCE_S {
                return None;
            }
            self.next += 1;
            let point =
                self.neighbourhood(number).and_then(|near| Point::of(self, number, near, worker, options));
            if point.is_some() {
                return point;
            }
        }
        None
    }

    /// The snapshot of a number.
    pub(super) fn at(&self, number: usize) -> &Sample {
        &self.samples[number - self.dropped]
    }

    /// The snapshot of a number, unless it has been dropped.
    pub(super) fn get(&self, number: usize) -> Option<&Sample> {
        self.samples.get(number.checked_sub(self.dropped)?)
    }

    fn neighbourhood(&self, number: usize) -> Option<Neighbourhood> {
        let centre_s = self.at(number).time_s;
        let near = |other: usize| {
            self.get(other)
                .is_some_and(|sample| (sample.time_s - centre_s).abs() <= self.half_s + TIME_TOLERANCE_S)
        };
        let (mut first, mut last) = (number, number);
        while first > self.dropped && number - first < SIDE_MAX && near(first - 1) {
            first -= 1;
        }
        while last - number < SIDE_MAX && near(last + 1) {
            last += 1;
        }
        let reach_s = [centre_s - self.at(first).time_s, self.at(last).time_s - centre_s];
        let counts = [number - first, last - number];
        let cut_short = |side: usize| counts[side] < SIDE_MAX && reach_s[side] < WINDOW_REACH * self.half_s;
        if counts.iter().any(|count| *count < WINDOW_SIDE_MIN) || cut_short(0) || cut_short(1) {
            return None;
        }
        let mut times_s = [0.0; CAPACITY];
        let count = last - first + 1;
        for (time_s, other) in times_s.iter_mut().zip(first..=last) {
            *time_s = self.at(other).time_s - centre_s;
        }
        let mut weights = weights(&times_s[..count])?;
        average_as_second_derivative(&times_s[..count], &mut weights);
        Some(Neighbourhood { first, count, weights })
    }
}

/// Replaces the weights of the value by those with which `weights.second` averages the true second derivative. Means of
/// forces and accelerations then agree in motion of any frequency: `Σ_k w_k x(t_k) = ∫ K(t) ẍ(t) dt` with
/// `K(t) = Σ_k w_k max(t_k − t, 0)` (Peano), linear between the samples. The integral over a sampled force is the mean
/// of the trapezoidal rule and of the exact integral over the linearly interpolated force, whose errors are opposite.
fn average_as_second_derivative(times_s: &[f64], weights: &mut Weights) {
    let mut kernel_per_s = [0.0; CAPACITY];
    for (place, time_s) in times_s.iter().enumerate() {
        let later = times_s.iter().zip(&weights.second).skip(place + 1);
        kernel_per_s[place] = later.map(|(later_s, weight)| weight * (later_s - time_s)).sum();
    }
    weights.value = [0.0; CAPACITY];
    for earlier in 0..times_s.len() - 1 {
        let later = earlier + 1;
        let step_s = times_s[later] - times_s[earlier];
        let [before, after] = [kernel_per_s[earlier], kernel_per_s[later]];
        weights.value[earlier] += step_s * (5.0 * before + after) / 12.0;
        weights.value[later] += step_s * (before + 5.0 * after) / 12.0;
    }
}

/// Centre of mass by the chain (Fortini et al., Eq. 3), m.
fn chain(pose: &Pose<StationWorld>, worker: &Worker) -> Vector3<f64> {
    equipoise_core::sesc::centre_of_mass(pose, &worker.phi)
}

/// `world_from_segment` of a snapshot as a matrix, row by row.
pub(super) fn matrix(snapshot: &Snapshot, segment: usize) -> [[f64; 3]; 3] {
    let matrix = rotation(snapshot.orientation_wxyz[segment]).to_rotation_matrix();
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| matrix[(row, column)]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_average_of_a_force_is_that_of_the_acceleration() {
        // A centre of mass that oscillates at 2 Hz, at the uneven times of a suit whose samples are not all received.
        let times_s = [-0.100, -0.083, -0.067, -0.033, -0.017, 0.0, 0.016, 0.034, 0.067, 0.083, 0.1];
        let omega_rad_per_s = core::f64::consts::TAU * 2.0;
        let mut weights = weights(&times_s).unwrap();
        let by_parabola = weights.value;
        average_as_second_derivative(&times_s, &mut weights);
        let mean = |weights: &[f64], value: &dyn Fn(f64) -> f64| -> f64 {
            times_s.iter().zip(weights).map(|(time_s, weight)| weight * value(*time_s)).sum()
        };
        for phase in [0.0, 0.7, 1.5] {
            let position = |time_s: f64| (omega_rad_per_s * time_s + phase).sin();
            let acceleration = |time_s: f64| -omega_rad_per_s * omega_rad_per_s * position(time_s);
            let differentiated = mean(&weights.second, &position);
            let largest = omega_rad_per_s * omega_rad_per_s;
            let error = |weights: &[f64]| (mean(weights, &acceleration) - differentiated).abs() / largest;
            assert!(error(&weights.value) < 0.004, "{}", error(&weights.value));
            assert!(phase == 0.0 || error(&by_parabola) > 0.06 * phase.sin(), "{}", error(&by_parabola));
        }
        assert!((mean(&weights.value, &|_| 1.0) - 1.0).abs() < 1e-12);
    }
}
