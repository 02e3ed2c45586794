//! Whether the worker holds still: the paper's double check on a window of 20 suit samples.
//!
//! Still means that the centre of pressure and every joint angle hardly vary over the window (Fortini et al., §III-B);
//! then the centre of pressure is the projection of the centre of mass. One pose is used once: the next must differ
//! from it by more than [`Thresholds::leave_rad`] in some joint.

use bytemuck::{Pod, Zeroable};

use crate::body::{JOINTS, SEGMENTS};
use crate::frame::{Pose, StationWorld, wxyz};
use crate::math;

/// Suit samples in the window (Fortini et al., §III-B).
pub const WINDOW: usize = 20;

/// What counts as still.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thresholds {
    /// Largest standard deviation of any joint's angle over the window, rad.
    pub joint_rad: f64,
    /// Largest standard deviation of the centre of pressure on either axis, m.
    pub cop_m: f64,
    /// A pose is new if some joint differs from the last used pose by more than this, rad.
    pub leave_rad: f64,
    /// Largest share by which the vertical force may differ from the body weight.
    pub weight_share: f64,
}

impl Default for Thresholds {
    fn default() -> Self {
        Thresholds {
            joint_rad: 1f64.to_radians(),
            cop_m: 0.004,
            leave_rad: 7f64.to_radians(),
            weight_share: 0.04,
        }
    }
}

/// One aligned sample as the window keeps it.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Held {
    /// When the suit sampled it.
    pub time_ns: u64,
    /// The anchor's stance.
    pub stance: u64,
    /// Segment origins, station's world, m.
    pub origin_m: [[f64; 3]; SEGMENTS],
    /// `world_from_segment`, scalar first.
    pub orientation_wxyz: [[f64; 4]; SEGMENTS],
    /// `parent_from_segment`, scalar first, of one sign over the window.
    pub joint_wxyz: [[f64; 4]; JOINTS],
    /// Measured centre of pressure, m.
    pub cop_m: [f64; 2],
    /// Vertical ground reaction, N.
    pub vertical_n: f64,
}

/// How still the window is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stillness {
    /// Largest standard deviation of a joint's angle, rad.
    pub joint_rad: f64,
    /// Standard deviation of the centre of pressure per axis, m.
    pub cop_sigma_m: [f64; 2],
    /// Mean centre of pressure, m.
    pub cop_m: [f64; 2],
    /// Mean vertical ground reaction, N.
    pub vertical_n: f64,
}

/// The last [`WINDOW`] aligned samples of one stance, without gaps.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Window {
    held: [Held; WINDOW],
    /// Where the next sample goes, in [0, WINDOW).
    next: u64,
    /// How many samples are in, in [0, WINDOW].
    count: u64,
}

impl Window {
    /// Takes in a sample. A new stance or a gap of more than three periods empties the window first.
    pub fn push(&mut self, pose: &Pose<StationWorld>, mut held: Held, period_ns: u64) {
        let newest = self.newest();
        if newest.is_some_and(|last| {
            last.stance != held.stance || held.time_ns.saturating_sub(last.time_ns) > 3 * period_ns
        }) {
            self.count = 0;
        }
        held.origin_m = pose.origin.map(Into::into);
        held.orientation_wxyz = pose.world_from_segment.map(|rotation| wxyz(&rotation));
        held.joint_wxyz = pose.joint_rotations().map(|rotation| wxyz(&rotation));
        // q and −q are one rotation; a jump between them would look like motion.
        if let Some(last) = newest {
            for (now, before) in held.joint_wxyz.iter_mut().zip(last.joint_wxyz) {
                if now.iter().zip(before).map(|(a, b)| a * b).sum::<f64>() < 0.0 {
                    *now = now.map(|component| -component);
                }
            }
        }
        self.held[self.next as usize % WINDOW] = held;
        self.next = (self.next + 1) % WINDOW as u64;
        self.count = (self.count + 1).min(WINDOW as u64);
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// The samples of a full window, in no particular order; empty while it fills.
    pub fn samples(&self) -> &[Held] {
        if self.count as usize == WINDOW { &self.held } else { &[] }
    }

    /// The newest sample.
    pub fn newest(&self) -> Option<Held> {
        (self.count > 0).then(|| self.held[(self.next as usize + WINDOW - 1) % WINDOW])
    }

    /// Whether indices and numbers are in range; a stored window is checked before use.
    pub fn is_sound(&self) -> bool {
        self.next < WINDOW as u64
            && self.count <= WINDOW as u64
            && self.held.iter().all(|held| {
                held.vertical_n.is_finite()
                    && held.cop_m.iter().all(|value| value.is_finite())
                    && held.origin_m.iter().flatten().all(|value| value.is_finite())
                    && held.orientation_wxyz.iter().flatten().all(|value| value.is_finite())
                    && held.joint_wxyz.iter().flatten().all(|value| value.is_finite())
            })
    }

    /// How still the window is; `None` while it fills.
    pub fn stillness(&self) -> Option<Stillness> {
        let samples = self.samples();
        if samples.is_empty() {
            return None;
        }
        let mut joint_rad = 0.0_f64;
        for joint in 0..JOINTS {
            let spread: f64 =
                (0..4).map(|part| moments(samples.iter().map(|held| held.joint_wxyz[joint][part])).1).sum();
            // A small rotation by ω changes the quaternion by |ω|/2.
            joint_rad = joint_rad.max(2.0 * math::sqrt(spread));
        }
        let [x, y] = [0, 1].map(|axis| moments(samples.iter().map(|held| held.cop_m[axis])));
        let (vertical_n, _) = moments(samples.iter().map(|held| held.vertical_n));
        Some(Stillness {
            joint_rad,
            cop_sigma_m: [math::sqrt(x.1), math::sqrt(y.1)],
            cop_m: [x.0, y.0],
            vertical_n,
        })
    }
}

impl Stillness {
    /// Whether the thresholds hold.
    pub fn is_still(&self, thresholds: &Thresholds) -> bool {
        self.is_within(thresholds, 1.0)
    }

    /// Whether the thresholds, widened by a factor, hold.
    pub fn is_within(&self, thresholds: &Thresholds, factor: f64) -> bool {
        self.joint_rad < factor * thresholds.joint_rad
            && self.cop_sigma_m.iter().all(|sigma| *sigma < factor * thresholds.cop_m)
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
    let mean = values.clone().sum::<f64>() / WINDOW as f64;
    (mean, values.map(|value| (value - mean) * (value - mean)).sum::<f64>() / WINDOW as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{UnitQuaternion, Vector3};

    const PERIOD_NS: u64 = 16_666_667;

    fn fill(window: &mut Window, samples: u64, elbow_rad: impl Fn(u64) -> f64, cop_x_m: impl Fn(u64) -> f64) {
        for index in 0..samples {
            let mut rotation = [UnitQuaternion::identity(); SEGMENTS];
            rotation[9] = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, elbow_rad(index)));
            rotation[10] = rotation[9];
            let pose = Pose::new([Vector3::zeros(); SEGMENTS], rotation);
            let held = Held {
                time_ns: index * PERIOD_NS,
                cop_m: [cop_x_m(index), 0.0],
                vertical_n: 700.0,
                ..Zeroable::zeroed()
            };
            window.push(&pose, held, PERIOD_NS);
        }
    }

    fn empty() -> Window {
        Zeroable::zeroed()
    }

    #[test]
    fn nineteen_samples_are_no_window() {
        let mut window = empty();
        fill(&mut window, 19, |_| 0.3, |_| 0.1);
        assert_eq!(window.stillness(), None);
        fill(&mut window, 20, |_| 0.3, |_| 0.1);
        assert!(window.stillness().unwrap().is_still(&Thresholds::default()));
    }

    #[test]
    fn one_moving_joint_is_motion_and_its_spread_is_measured_in_radians() {
        let mut window = empty();
        fill(&mut window, 20, |index| 0.01 * index as f64, |_| 0.1);
        let stillness = window.stillness().unwrap();
        // The standard deviation of 0, 0.01 … 0.19 is 0.0577.
        assert!((stillness.joint_rad - 0.0577).abs() < 5e-4, "{stillness:?}");
        assert!(!stillness.is_still(&Thresholds::default()));
    }

    #[test]
    fn a_wandering_centre_of_pressure_is_motion() {
        let mut window = empty();
        fill(&mut window, 20, |_| 0.3, |index| 0.002 * index as f64);
        assert!(!window.stillness().unwrap().is_still(&Thresholds::default()));
    }

    #[test]
    fn past_half_a_turn_the_quaternion_s_sign_does_not_look_like_motion() {
        let mut window = empty();
        let around_pi =
            |index: u64| core::f64::consts::PI + if index.is_multiple_of(2) { 0.001 } else { -0.001 };
        fill(&mut window, 20, around_pi, |_| 0.1);
        assert!(window.stillness().unwrap().is_still(&Thresholds::default()));
    }

    #[test]
    fn a_gap_or_a_step_empties_the_window() {
        let mut window = empty();
        fill(&mut window, 20, |_| 0.3, |_| 0.1);
        let pose = Pose::new([Vector3::zeros(); SEGMENTS], [UnitQuaternion::identity(); SEGMENTS]);
        let mut stepped = window;
        stepped.push(&pose, Held { time_ns: 20 * PERIOD_NS, stance: 1, ..Zeroable::zeroed() }, PERIOD_NS);
        assert_eq!(stepped.stillness(), None);
        window.push(&pose, Held { time_ns: 26 * PERIOD_NS, ..Zeroable::zeroed() }, PERIOD_NS);
        assert_eq!(window.stillness(), None);
    }
}
