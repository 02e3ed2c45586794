//! What a moving body asks of the ground beyond its weight (Newton and Euler), per kilogram of body.

use nalgebra::{Quaternion, Vector3};

use super::history::{Moment, Motion};
use crate::body::{Anthropometry, SEGMENTS, Side};
use crate::frame::rotation;

/// Standard gravity as the paper rounds it, m/s².
const GRAVITY_M_PER_S2: f64 = 9.81;
/// Below this share of its weight a body leaps, and its centre of pressure means nothing.
const SPECIFIC_FORCE_MIN_M_PER_S2: f64 = 0.2 * GRAVITY_M_PER_S2;

/// A body that is accelerated more than this is struck or leaps.
const ACCELERATION_MAX_M_PER_S2: f64 = 6.0;
/// A body that turns so that its centre of pressure were this far off would fall over its feet, m: a leap of sample times.
const TURNING_SHIFT_MAX_M: f64 = 0.3;

/// How this worker's mass is spread, by the table.
#[derive(Debug, Clone, Copy)]
pub struct Build<'a> {
    /// Masses and centres.
    pub body: &'a Anthropometry,
    /// Squares of the radii of gyration about each segment's axes, m² ([`crate::body::gyration_m2`]).
    pub gyration_m2: &'a [[f64; 3]; SEGMENTS],
}

/// The motion of the whole body at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertia {
    /// Acceleration of the centre of mass C̈, m/s².
    pub acceleration_m_per_s2: [f64; 3],
    /// Rate of the angular momentum about the centre of mass over the body's mass L̇/M, m²/s².
    pub momentum_rate_m2_per_s2: [f64; 3],
    /// Acceleration of the left and the right hand's centre, m/s².
    pub hand_acceleration_m_per_s2: [[f64; 3]; 2],
    /// Whether the suit's own accelerations are in it.
    pub is_by_suit: bool,
}

impl Inertia {
    /// A body at rest.
    pub const REST: Inertia = Inertia {
        acceleration_m_per_s2: [0.0; 3],
        momentum_rate_m2_per_s2: [0.0; 3],
        hand_acceleration_m_per_s2: [[0.0; 3]; 2],
        is_by_suit: false,
    };

    /// Sums over the segments: masses and centres by the table laid on this worker's bones.
    pub(super) fn of(moment: &Moment, motion: &Motion, worker: &Build) -> Inertia {
        let mut momentum_rate = Vector3::zeros();
        for rate in momentum_rate_by_segment(moment, motion, worker) {
            momentum_rate += Vector3::from(rate);
        }
        let mut whole = Vector3::zeros();
        for (mass, acceleration) in worker.body.mass_fraction.iter().zip(&motion.acceleration_m_per_s2) {
            whole += *mass * Vector3::from(*acceleration);
        }
        Inertia {
            acceleration_m_per_s2: whole.into(),
            momentum_rate_m2_per_s2: momentum_rate.into(),
            hand_acceleration_m_per_s2: Side::BOTH
                .map(|side| motion.acceleration_m_per_s2[side.hand().index()]),
            is_by_suit: false,
        }
    }

    /// Whether the motion is one of work: no leap, no impact, for which a parabola would not do.
    pub fn is_moderate(&self) -> bool {
        let square: f64 = self.acceleration_m_per_s2.iter().map(|value| value * value).sum();
        square < ACCELERATION_MAX_M_PER_S2 * ACCELERATION_MAX_M_PER_S2
            && self.specific_force_m_per_s2().is_some_and(|force| {
                self.turning_shift_m(force).iter().all(|shift| shift.abs() < TURNING_SHIFT_MAX_M)
            })
    }

    /// Vertical force over mass that this motion needs, g + C̈_z, m/s²; `None` of a body that leaps.
    pub fn specific_force_m_per_s2(&self) -> Option<f64> {
        let force = GRAVITY_M_PER_S2 + self.acceleration_m_per_s2[2];
        (force > SPECIFIC_FORCE_MIN_M_PER_S2).then_some(force)
    }

    /// `(−L̇_y, L̇_x)/(M (g + C̈_z))`: where the turning body shifts the centre of pressure to, m.
    pub fn turning_shift_m(&self, specific_force_m_per_s2: f64) -> [f64; 2] {
        let [x, y, _] = self.momentum_rate_m2_per_s2;
        [-y / specific_force_m_per_s2, x / specific_force_m_per_s2]
    }
}

/// What each segment adds to the rate of the angular momentum about the centre of mass over the body's mass, m²/s²:
/// `μ_i (c_i − C) × c̈_i + μ_i d/dt(R_i k_i² R_iᵀ ω_i)`, with ω and α from the orientation's quaternion, `ω = 2 q̇ q̄`,
/// `α = 2 q̈ q̄` (vector parts).
pub fn momentum_rate_by_segment(moment: &Moment, motion: &Motion, worker: &Build) -> [[f64; 3]; SEGMENTS] {
    let mass = &worker.body.mass_fraction;
    let mut centre = Vector3::zeros();
    for (segment, &mass) in mass.iter().enumerate() {
        centre += mass * moment.centre(segment);
    }
    core::array::from_fn(|segment| {
        let arm = moment.centre(segment) - centre;
        let acceleration = Vector3::from(motion.acceleration_m_per_s2[segment]);
        let spin = spin_rate(
            &moment.orientation_wxyz[segment],
            &motion.turning[segment],
            &worker.gyration_m2[segment],
        );
        (mass[segment] * (arm.cross(&acceleration) + spin)).into()
    })
}

/// Angular velocity and acceleration, world, from an orientation's quaternion and its derivatives, rad/s and rad/s²:
/// `ω = 2 q̇ q̄`, `α = 2 q̈ q̄`, vector parts.
pub(super) fn angular(
    orientation: &[f64; 4],
    [first, second]: &[[f64; 4]; 2],
) -> (Vector3<f64>, Vector3<f64>) {
    let back = rotation(*orientation).conjugate().into_inner();
    let twice = |[w, x, y, z]: [f64; 4]| (Quaternion::new(w, x, y, z) * back).imag() * 2.0;
    (twice(*first), twice(*second))
}

/// Rate of a segment's own angular momentum over its mass, world, m²/s²: `I α + ω × I ω`.
fn spin_rate(orientation: &[f64; 4], turning: &[[f64; 4]; 2], gyration_m2: &[f64; 3]) -> Vector3<f64> {
    let world_from_segment = rotation(*orientation);
    let back = world_from_segment.conjugate();
    let spread = |vector: Vector3<f64>| {
        world_from_segment * (back * vector).component_mul(&Vector3::from(*gyration_m2))
    };
    let (velocity, acceleration) = angular(orientation, turning);
    spread(acceleration) + velocity.cross(&spread(velocity))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leaps_impacts_and_impossible_turns_are_not_the_motion_of_work() {
        let moving = |acceleration_m_per_s2, momentum_rate_m2_per_s2| Inertia {
            acceleration_m_per_s2,
            momentum_rate_m2_per_s2,
            ..Inertia::REST
        };
        assert!(Inertia::REST.is_moderate());
        // A brisk bend: 2 m/s² and 10 cm.
        assert!(moving([2.0, 0.0, -1.0], [0.0, 0.9, 0.0]).is_moderate());
        assert!(!moving([0.0, 6.1, 0.0], [0.0; 3]).is_moderate());
        assert!(!moving([0.0, 0.0, -9.0], [0.0; 3]).is_moderate());
        assert!(!moving([0.0; 3], [0.0, -3.1, 0.0]).is_moderate());
        // About the vertical a body may turn as it likes: that moves no centre of pressure.
        assert!(moving([0.0; 3], [0.0, 0.0, 9.0]).is_moderate());
    }
}
