//! Detects static poses: the paper's double check on a window of a third of a second.
//!
//! Static means that the CoP and every joint angle hardly vary over the window (Fortini et al., §III-B), and that the
//! body is not accelerated, because at the turning point of a movement angles hardly vary either. Then the CoP is the
//! projection of the CoM. Each pose is used once: the next must differ from it by more than [`Thresholds::leave_rad`]
//! in some joint.

use bytemuck::{Pod, Zeroable};

use nalgebra::Vector3;

use crate::GRAVITY_M_PER_S2;
use crate::body::{JOINTS, SEGMENTS};
use crate::frame::{Pose, StationWorld, wxyz};
use crate::math;
use crate::motion::weights::weights;

/// Maximum number of suit samples in the window: the paper's 20 (Fortini et al., §III-B).
pub const WINDOW: usize = 20;
/// Duration of the window: 20 samples of a suit at 60 Hz, from the first to the last, less 5 % for jitter, ns.
pub(crate) const SPAN_NS: u64 = 300_800_000;
/// A sample closer than this to the previous one replaces it, ns: 19 intervals fill the window at every rate.
const SPACING_NS: u64 = SPAN_NS / (WINDOW as u64 - 1);
/// Maximum acceleration in a static pose as a fraction of gravity: the same fraction of shear over weight counts as a
/// contact.
const ACCELERATION_RATIO_MAX: f64 = 0.02;

/// Thresholds of a static pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thresholds {
    /// Largest standard deviation of any joint's angle over the window, rad.
    pub joint_rad: f64,
    /// Largest standard deviation of the centre of pressure on either axis, m.
    pub cop_m: f64,
    /// A pose is new if some joint differs from the last used pose by more than this, rad.
    pub leave_rad: f64,
    /// Maximum difference between vertical force and body weight, as a fraction of the weight.
    pub weight_fraction: f64,
}

impl Default for Thresholds {
    fn default() -> Self {
        Thresholds {
            joint_rad: 1f64.to_radians(),
            cop_m: 0.004,
            leave_rad: 7f64.to_radians(),
            weight_fraction: 0.04,
        }
    }
}

/// One aligned sample as stored in the window.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct WindowSample {
    /// Sample time of the suit.
    pub time_ns: u64,
    /// The anchor's stance.
    pub stance: u64,
    /// Segment origins, station world, m.
    pub origin_m: [[f64; 3]; SEGMENTS],
    /// `world_from_segment`, scalar first.
    pub orientation_wxyz: [[f64; 4]; SEGMENTS],
    /// `parent_from_segment`, scalar first, of one sign over the window.
    pub joint_wxyz: [[f64; 4]; JOINTS],
    /// Mean of the segment origins, m: it moves similarly to the CoM and needs no masses.
    pub middle_m: [f64; 3],
    /// Measured centre of pressure, m.
    pub cop_m: [f64; 2],
    /// Vertical ground reaction, N.
    pub vertical_n: f64,
}

/// Variation within the window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseStatistics {
    /// Largest standard deviation of a joint's angle, rad.
    pub joint_rad: f64,
    /// Standard deviation of the centre of pressure per axis, m.
    pub cop_sigma_m: [f64; 2],
    /// Mean centre of pressure, m.
    pub cop_m: [f64; 2],
    /// Mean vertical ground reaction, N.
    pub vertical_n: f64,
    /// Acceleration of the body's middle over the window, m/s².
    pub acceleration_m_per_s2: f64,
}

/// Aligned samples of one stance over the last third of a second, without gaps; at most [`WINDOW`], thinned in time.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Window {
    ring: [WindowSample; WINDOW],
    /// Index of the next sample, in [0, WINDOW).
    next: u64,
    /// Number of samples, in [0, WINDOW].
    count: u64,
}

impl Window {
    /// Appends a sample. A new stance or a gap of more than three periods clears the window first.
    pub fn push(&mut self, pose: &Pose<StationWorld>, mut sample: WindowSample, period_ns: u64) {
        let newest = self.newest();
        if newest.is_some_and(|last| {
            last.stance != sample.stance || sample.time_ns.saturating_sub(last.time_ns) > 3 * period_ns
        }) {
            self.count = 0;
        }
        sample.origin_m = pose.origin.map(Into::into);
        sample.orientation_wxyz = pose.world_from_segment.map(|rotation| wxyz(&rotation));
        sample.joint_wxyz = pose.joint_rotations().map(|rotation| wxyz(&rotation));
        sample.middle_m = (pose.origin.iter().sum::<Vector3<f64>>() / SEGMENTS as f64).into();
        // q and −q are the same rotation; a jump between them would appear as motion.
        if let Some(last) = newest {
            for (now, before) in sample.joint_wxyz.iter_mut().zip(last.joint_wxyz) {
                if now.iter().zip(before).map(|(a, b)| a * b).sum::<f64>() < 0.0 {
                    *now = now.map(|component| -component);
                }
            }
        }
        // The newest sample is always stored; the previous one is kept if it is far enough from its predecessor.
        let before = self.samples().nth(1);
        let crowded = before
            .zip(newest)
            .is_some_and(|(before, last)| last.time_ns.saturating_sub(before.time_ns) < SPACING_NS);
        if crowded {
            self.next = (self.next + WINDOW as u64 - 1) % WINDOW as u64;
            self.count -= 1;
        }
        self.ring[self.next as usize % WINDOW] = sample;
        self.next = (self.next + 1) % WINDOW as u64;
        self.count = (self.count + 1).min(WINDOW as u64);
        // Keep the shortest sequence of samples that covers the span.
        while self.count > 2 && self.length_ns(1) >= SPAN_NS {
            self.count -= 1;
        }
    }

    /// Clears the window.
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// The samples, the newest first.
    pub fn samples(&self) -> impl Iterator<Item = &WindowSample> + Clone {
        (1..=self.count as usize).map(|back| &self.ring[(self.next as usize + WINDOW - back) % WINDOW])
    }

    /// Whether the samples cover the window's duration.
    pub fn is_full(&self) -> bool {
        self.length_ns(0) >= SPAN_NS
    }

    /// Duration from the oldest sample, without the `less` oldest, to the newest, ns.
    fn length_ns(&self, less: usize) -> u64 {
        let oldest = (self.count as usize).checked_sub(less + 1).and_then(|back| self.samples().nth(back));
        match (self.samples().next(), oldest) {
            (Some(newest), Some(oldest)) => newest.time_ns.saturating_sub(oldest.time_ns),
            _ => 0,
        }
    }

    /// The newest sample.
    pub fn newest(&self) -> Option<WindowSample> {
        self.samples().next().copied()
    }

    /// Whether indices and numbers are in range; a stored window is checked before use.
    pub fn is_sound(&self) -> bool {
        self.next < WINDOW as u64
            && self.count <= WINDOW as u64
            && self.ring.iter().all(|sample| {
                sample.vertical_n.is_finite()
                    && sample.middle_m.iter().all(|value| value.is_finite())
                    && sample.cop_m.iter().all(|value| value.is_finite())
                    && sample.origin_m.iter().flatten().all(|value| value.is_finite())
                    && sample.orientation_wxyz.iter().flatten().all(|value| value.is_finite())
                    && sample.joint_wxyz.iter().flatten().all(|value| value.is_finite())
            })
    }

    /// Variation within the window; `None` while it fills.
    pub fn statistics(&self) -> Option<PoseStatistics> {
        if !self.is_full() {
            return None;
        }
        let samples = self.samples();
        let mut joint_rad = 0.0_f64;
        for joint in 0..JOINTS {
            let spread: f64 = (0..4)
                .map(|part| moments(samples.clone().map(|sample| sample.joint_wxyz[joint][part])).1)
                .sum();
            // A small rotation by ω changes the quaternion by |ω|/2.
            joint_rad = joint_rad.max(2.0 * math::sqrt(spread));
        }
        let [x, y] = [0, 1].map(|axis| moments(samples.clone().map(|sample| sample.cop_m[axis])));
        let (vertical_n, _) = moments(samples.map(|sample| sample.vertical_n));
        Some(PoseStatistics {
            joint_rad,
            cop_sigma_m: [math::sqrt(x.1), math::sqrt(y.1)],
            cop_m: [x.0, y.0],
            vertical_n,
            acceleration_m_per_s2: self.acceleration_m_per_s2(),
        })
    }

    /// Acceleration of the body's middle, m/s²: the least-squares parabola through the window's samples.
    fn acceleration_m_per_s2(&self) -> f64 {
        let (Some(newest), mut times_s) = (self.samples().next(), [0.0; WINDOW]) else { return 0.0 };
        let half_s = 0.5e-9 * self.length_ns(0) as f64;
        for (time_s, sample) in times_s.iter_mut().zip(self.samples()) {
            *time_s = half_s - newest.time_ns.saturating_sub(sample.time_ns) as f64 * 1e-9;
        }
        let Some(weights) = weights(&times_s[..self.count as usize]) else { return 0.0 };
        let sum = self.samples().zip(weights.second).fold(Vector3::zeros(), |sum, (sample, weight)| {
            sum + weight * (Vector3::from(sample.middle_m) - Vector3::from(newest.middle_m))
        });
        sum.norm()
    }
}

impl PoseStatistics {
    /// Whether the thresholds hold.
    pub fn is_static(&self, thresholds: &Thresholds) -> bool {
        self.is_within(thresholds, 1.0)
    }

    /// Whether the thresholds, widened by a factor, hold.
    pub fn is_within(&self, thresholds: &Thresholds, factor: f64) -> bool {
        self.joint_rad < factor * thresholds.joint_rad
            && self.cop_sigma_m.iter().all(|sigma| *sigma < factor * thresholds.cop_m)
            && self.acceleration_m_per_s2 < factor * ACCELERATION_RATIO_MAX * GRAVITY_M_PER_S2
    }
}

/// Largest angle between two sets of joint rotations, rad.
pub fn largest_joint_angle(a: &[[f64; 4]; JOINTS], b: &[[f64; 4]; JOINTS]) -> f64 {
    joint_angles(a, b).fold(0.0, f64::max)
}

/// Root mean square angle between two sets of joint rotations, rad.
pub fn rms_joint_angle(a: &[[f64; 4]; JOINTS], b: &[[f64; 4]; JOINTS]) -> f64 {
    math::sqrt(joint_angles(a, b).map(|angle| angle * angle).sum::<f64>() / JOINTS as f64)
}

fn joint_angles(a: &[[f64; 4]; JOINTS], b: &[[f64; 4]; JOINTS]) -> impl Iterator<Item = f64> {
    a.iter().zip(b).map(|(a, b)| {
        let cosine: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>().abs().min(1.0);
        2.0 * math::acos(cosine)
    })
}

/// Mean and variance.
fn moments(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / count;
    (mean, values.map(|value| (value - mean) * (value - mean)).sum::<f64>() / count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::Segment;
    use nalgebra::UnitQuaternion;

    const PERIOD_NS: u64 = 16_666_667;

    fn fill(window: &mut Window, samples: u64, elbow_rad: impl Fn(u64) -> f64, cop_x_m: impl Fn(u64) -> f64) {
        for index in 0..samples {
            let mut rotation = [UnitQuaternion::identity(); SEGMENTS];
            rotation[9] = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, elbow_rad(index)));
            rotation[10] = rotation[9];
            let pose = Pose::new([Vector3::zeros(); SEGMENTS], rotation);
            let sample = WindowSample {
                time_ns: index * PERIOD_NS,
                cop_m: [cop_x_m(index), 0.0],
                vertical_n: 700.0,
                ..Zeroable::zeroed()
            };
            window.push(&pose, sample, PERIOD_NS);
        }
    }

    fn empty() -> Window {
        Zeroable::zeroed()
    }

    #[test]
    fn nineteen_samples_are_no_window() {
        let mut window = empty();
        fill(&mut window, 19, |_| 0.3, |_| 0.1);
        assert_eq!(window.statistics(), None);
        let mut window = empty();
        fill(&mut window, 20, |_| 0.3, |_| 0.1);
        assert!(window.statistics().unwrap().is_static(&Thresholds::default()));
    }

    /// A squat through its lowest point, at `middle` of the time, with a suit of that rate: whether any window is
    /// static.
    fn is_static_somewhere(rate_hz: f64, path: impl Fn(f64) -> f64, seconds: f64) -> bool {
        let (mut window, mut any) = (empty(), false);
        let period_ns = (1e9 / rate_hz) as u64;
        for index in 0..(seconds * rate_hz) as u64 {
            let depth = path(index as f64 / rate_hz);
            let knee = UnitQuaternion::from_scaled_axis(Vector3::y() * (1.6 * depth));
            let mut rotation = [UnitQuaternion::identity(); SEGMENTS];
            let mut origin = [Vector3::new(0.0, 0.0, 0.95 - 0.35 * depth); SEGMENTS];
            for leg in [Segment::RightLowerLeg, Segment::LeftLowerLeg] {
                rotation[leg.index()] = knee;
                origin[leg.index()].z = 0.5 - 0.1 * depth;
            }
            for foot in [Segment::RightFoot, Segment::LeftFoot, Segment::RightToe, Segment::LeftToe] {
                origin[foot.index()].z = 0.05;
            }
            let sample = WindowSample {
                time_ns: (index as f64 / rate_hz * 1e9) as u64,
                cop_m: [0.02 * depth, 0.0],
                vertical_n: 700.0,
                ..Zeroable::zeroed()
            };
            window.push(&Pose::new(origin, rotation), sample, period_ns);
            assert!(window.is_sound() && window.samples().count() <= WINDOW);
            any |= window.statistics().is_some_and(|statistics| statistics.is_static(&Thresholds::default()));
        }
        any
    }

    #[test]
    fn the_turning_point_of_a_squat_is_not_static_at_any_rate_and_a_hold_of_a_second_is() {
        for rate_hz in [240.0, 120.0, 100.0, 60.0, 30.0] {
            for phase_s in [1.0, 1.5, 2.0] {
                let middle = |time_s: f64| (time_s / (2.0 * phase_s)).clamp(0.0, 1.0);
                // From the middle of the descent to the middle of the ascent.
                let inner = |time_s: f64| middle(time_s + 0.5 * phase_s);
                let sine = |time_s: f64| (core::f64::consts::PI * inner(time_s)).sin().powi(2);
                let jerk = |time_s: f64| (4.0 * inner(time_s) * (1.0 - inner(time_s))).powi(3);
                assert!(!is_static_somewhere(rate_hz, sine, phase_s), "{rate_hz} Hz, {phase_s} s");
                assert!(!is_static_somewhere(rate_hz, jerk, phase_s), "{rate_hz} Hz, {phase_s} s");
            }
            assert!(is_static_somewhere(rate_hz, |_| 1.0, 1.0), "{rate_hz} Hz");
        }
    }

    #[test]
    fn a_window_lasts_as_long_at_every_rate() {
        for (rate_hz, longest_s) in [(240.0, 0.32), (100.0, 0.33), (60.0, 0.32), (30.0, 0.34)] {
            let first_s = (1..100)
                .map(|samples| f64::from(samples) / rate_hz)
                .find(|seconds| is_static_somewhere(rate_hz, |_| 1.0, *seconds + 1e-9));
            assert!(
                first_s.is_some_and(|seconds| (0.3..longest_s + 1.0 / rate_hz).contains(&seconds)),
                "{rate_hz}: {first_s:?}"
            );
        }
    }

    #[test]
    fn one_moving_joint_is_motion_and_its_spread_is_measured_in_radians() {
        let mut window = empty();
        fill(&mut window, 20, |index| 0.01 * index as f64, |_| 0.1);
        let statistics = window.statistics().unwrap();
        // The standard deviation of 0, 0.01 … 0.19 is 0.0577.
        assert!((statistics.joint_rad - 0.0577).abs() < 5e-4, "{statistics:?}");
        assert!(!statistics.is_static(&Thresholds::default()));
    }

    #[test]
    fn a_drifting_centre_of_pressure_is_motion() {
        let mut window = empty();
        fill(&mut window, 20, |_| 0.3, |index| 0.002 * index as f64);
        assert!(!window.statistics().unwrap().is_static(&Thresholds::default()));
    }

    #[test]
    fn past_half_a_turn_the_quaternion_s_sign_does_not_look_like_motion() {
        let mut window = empty();
        let around_pi =
            |index: u64| core::f64::consts::PI + if index.is_multiple_of(2) { 0.001 } else { -0.001 };
        fill(&mut window, 20, around_pi, |_| 0.1);
        assert!(window.statistics().unwrap().is_static(&Thresholds::default()));
    }

    #[test]
    fn a_gap_or_a_step_empties_the_window() {
        let mut window = empty();
        fill(&mut window, 20, |_| 0.3, |_| 0.1);
        let pose = Pose::new([Vector3::zeros(); SEGMENTS], [UnitQuaternion::identity(); SEGMENTS]);
        let mut stepped = window;
        stepped.push(
            &pose,
            WindowSample { time_ns: 20 * PERIOD_NS, stance: 1, ..Zeroable::zeroed() },
            PERIOD_NS,
        );
        assert_eq!(stepped.statistics(), None);
        window.push(&pose, WindowSample { time_ns: 26 * PERIOD_NS, ..Zeroable::zeroed() }, PERIOD_NS);
        assert_eq!(window.statistics(), None);
    }
}
