//! Accelerations of the segments: from positions alone, or with what the suit itself sends of them (MVN type 21).
//!
//! Double differentiation of positions attenuates quick motion and amplifies jitter. A suit's own accelerations come
//! from its inertial sensors: accurate in quick motion, but a sensor tilted by half a degree has a constant error of
//! 0.09 m/s². The blend combines the advantages: a parabola through the positions minus the suit's accelerations
//! integrated twice, plus those accelerations. Constant errors of the suit's accelerations cancel, and motion that the
//! parabola attenuates is preserved.

use nalgebra::Vector3;

use super::history::{CAPACITY, Motion, Snapshot};
use super::weights::Weights;
use crate::body::SEGMENTS;

/// Source of the accelerations if the suit sends its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Accelerations {
    /// The positions alone.
    Positions,
    /// The suit's own accelerations, with the contribution of rotation at each CoM.
    Suit,
    /// Quick motion from the suit, slow motion from the positions.
    Blend,
}

/// The times, weights and number of a window's snapshots.
pub(super) struct Window<'a> {
    pub(super) times_s: &'a [f64; CAPACITY],
    pub(super) count: usize,
    pub(super) weights: &'a Weights,
}

/// Replaces the accelerations in a motion computed from positions. `at` is the snapshot at the window's own time;
/// `snapshot` returns the window's snapshots in order. Returns whether all of them have accelerations; if not, nothing
/// changes.
pub(super) fn apply_suit_accelerations<'a>(
    motion: &mut Motion,
    how: Accelerations,
    at: &Snapshot,
    window: &Window<'_>,
    snapshot: impl Fn(usize) -> &'a Snapshot,
) -> bool {
    if how == Accelerations::Positions
        || (0..window.count).any(|sample| snapshot(sample).has_acceleration != 1)
    {
        return false;
    }
    let suit = SuitAccelerations::over(window, snapshot);
    for segment in 0..SEGMENTS {
        let acceleration = if how == Accelerations::Suit {
            let arm = at.arm(segment);
            let (velocity, angular) = motion.angular(segment, &at.orientation_wxyz[segment]);
            suit.smoothed[segment] + angular.cross(&arm) + velocity.cross(&velocity.cross(&arm))
        } else {
            let slow = Vector3::from(motion.acceleration_m_per_s2[segment]);
            slow + suit.smoothed[segment] - suit.flattened[segment]
        };
        motion.acceleration_m_per_s2[segment] = acceleration.into();
    }
    true
}

/// The suit's accelerations of a window, m/s².
struct SuitAccelerations {
    /// Smoothed by a parabola, at the window's own time.
    smoothed: [Vector3<f64>; SEGMENTS],
    /// As attenuated by the parabola through positions: integrated twice over the window's times, and differentiated
    /// twice by its weights. The integration constants do not matter, because the weights cancel a straight line.
    flattened: [Vector3<f64>; SEGMENTS],
}

impl SuitAccelerations {
    /// Computed in one pass, because snapshots are large.
    fn over<'a>(window: &Window<'_>, snapshot: impl Fn(usize) -> &'a Snapshot) -> SuitAccelerations {
        let nothing = [Vector3::zeros(); SEGMENTS];
        let mut suit = SuitAccelerations { smoothed: nothing, flattened: nothing };
        let (mut position, mut velocity, mut before) = (nothing, nothing, nothing);
        for sample in 0..window.count {
            let (value, second) = (window.weights.value[sample], window.weights.second[sample]);
            let step_s = match sample.checked_sub(1) {
                Some(last) => window.times_s[sample] - window.times_s[last],
                None => 0.0,
            };
            for (segment, now) in snapshot(sample).acceleration_m_per_s2.iter().enumerate() {
                let now = Vector3::from(*now);
                // Linear between two samples.
                position[segment] +=
                    step_s * velocity[segment] + step_s * step_s * (before[segment] / 3.0 + now / 6.0);
                velocity[segment] += 0.5 * step_s * (before[segment] + now);
                before[segment] = now;
                suit.smoothed[segment] += value * now;
                suit.flattened[segment] += second * position[segment];
            }
        }
        suit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Anthropometry, Sex, Skeleton, gyration_m2};
    use crate::frame::{Pose, SuitWorld};
    use crate::motion::{History, Inertia, MassDistribution};
    use nalgebra::UnitQuaternion;

    extern crate std;
    use std::boxed::Box;

    const PERIOD_NS: u64 = 1_000_000_000 / 60;
    const HALF_NS: u64 = 70_000_000;
    /// An oscillation that a parabola over 140 ms attenuates.
    const HZ: f64 = 3.0;
    const AMPLITUDE_M: f64 = 0.01;

    /// A rigid body that oscillates forward and back while it rotates slowly about the vertical; its suit's
    /// accelerations have the constant error `bias`. Returns the true and the computed acceleration of the CoM, m/s².
    fn shaken(how: Accelerations, bias: f64, sends: bool) -> (f64, f64, bool) {
        let skeleton = Skeleton::nominal(1.77);
        let body = Anthropometry::de_leva(&skeleton, 1.77, Sex::Male);
        let gyration_m2 = gyration_m2(&skeleton, 1.77);
        let masses = MassDistribution { body: &body, gyration_m2: &gyration_m2 };
        let mut history: Box<History> = bytemuck::zeroed_box();
        let omega = core::f64::consts::TAU * HZ;
        let (turn_rate, mut worst, mut largest, mut by_suit) = (0.5, 0.0_f64, 0.0_f64, false);
        for index in 1..=120u64 {
            let time_s = (index * PERIOD_NS) as f64 * 1e-9;
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn_rate * time_s);
            let shake = Vector3::new(AMPLITUDE_M * (omega * time_s).sin(), 0.0, 0.95);
            let arms = skeleton.t_pose_m().map(|origin| turn * Vector3::from(origin));
            let pose = Pose::<SuitWorld>::new(arms.map(|arm| shake + arm), [turn; SEGMENTS]);
            let mut snapshot =
                Snapshot::new(index * PERIOD_NS, &pose, &pose.shifted(Vector3::zeros()), &body);
            if sends {
                let along = -AMPLITUDE_M * omega * omega * (omega * time_s).sin();
                let spin = Vector3::z() * turn_rate;
                snapshot.acceleration_m_per_s2 = arms
                    .map(|arm| (Vector3::new(along + bias, 0.0, 0.0) + spin.cross(&spin.cross(&arm))).into());
                snapshot.has_acceleration = 1;
            }
            history.push(snapshot);
            while let Some((snapshot, inertia)) = history.next(HALF_NS, how, &masses) {
                let Some(Inertia { acceleration_m_per_s2: [x, ..], is_by_suit, .. }) = inertia else {
                    continue;
                };
                let time_s = snapshot.time_ns as f64 * 1e-9;
                let truth = -AMPLITUDE_M * omega * omega * (omega * time_s).sin();
                largest = largest.max(truth.abs());
                // The table's CoM lies slightly off the axis and revolves around it: 2 mm/s².
                worst = worst.max((x - truth).abs());
                by_suit = is_by_suit;
            }
        }
        (worst, largest, by_suit)
    }

    #[test]
    fn the_suit_s_accelerations_are_not_flattened_and_the_blend_s_neither() {
        let (positions, largest, by_suit) = shaken(Accelerations::Positions, 0.0, true);
        assert!(positions > 0.1 * largest && !by_suit, "the parabola flattens: {positions} of {largest}");
        for how in [Accelerations::Suit, Accelerations::Blend] {
            let (error, _, by_suit) = shaken(how, 0.0, true);
            assert!(by_suit && error < 0.3 * positions, "{how:?}: {error}, by positions {positions}");
        }
    }

    #[test]
    fn what_is_constant_in_their_error_drops_out_of_the_blend() {
        let clean = shaken(Accelerations::Blend, 0.0, true).0;
        let (blend, suit) =
            (shaken(Accelerations::Blend, 0.3, true).0, shaken(Accelerations::Suit, 0.3, true).0);
        assert!((blend - clean).abs() < 1e-9, "{blend} {clean}");
        assert!(suit > 0.25, "{suit}");
    }

    #[test]
    fn without_them_positions_are_taken() {
        let reported = shaken(Accelerations::Blend, 0.0, false);
        assert_eq!(reported, shaken(Accelerations::Positions, 0.0, false));
        assert!(!reported.2);
    }
}
