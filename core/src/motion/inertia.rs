//! Ground reaction of a moving body in addition to its weight (Newton and Euler), per kilogram of body.

use nalgebra::{Quaternion, Vector3};

use super::history::{Motion, Snapshot};
use crate::GRAVITY_M_PER_S2;
use crate::body::{Anthropometry, SEGMENTS, Segment, Side};
use crate::frame::rotation;

/// Below this fraction of its weight the body leaps, and its CoP is meaningless.
const SPECIFIC_FORCE_MIN_M_PER_S2: f64 = 0.2 * GRAVITY_M_PER_S2;

/// Larger accelerations of a body are impacts or leaps.
const ACCELERATION_MAX_M_PER_S2: f64 = 6.0;
/// Larger shifts of the CoP by rotation, m, would make the body fall: they result from a jump of sample times.
const TURNING_SHIFT_MAX_M: f64 = 0.3;

/// Mass distribution of this subject, by the table.
#[derive(Debug, Clone, Copy)]
pub struct MassDistribution<'a> {
    /// Masses and centres.
    pub body: &'a Anthropometry,
    /// Squares of the radii of gyration about each segment's axes, m² ([`crate::body::gyration_m2`]).
    pub gyration_m2: &'a [[f64; 3]; SEGMENTS],
}

/// Inertial force and moment of the body above L5/S1, by the table's masses, over the mass of the whole body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UpperInertia {
    /// `Σ μ_i c̈_i` over the segments above the joint, m/s².
    pub force_m_per_s2: [f64; 3],
    /// `Σ μ_i [(c_i − o) × c̈_i + d/dt(R_i k_i² R_iᵀ ω_i)]` about the joint o, world axes, m²/s².
    pub moment_m2_per_s2: [f64; 3],
}

impl UpperInertia {
    /// A body at rest.
    pub const REST: UpperInertia = UpperInertia { force_m_per_s2: [0.0; 3], moment_m2_per_s2: [0.0; 3] };

    /// From the rates of each segment's angular momentum about the whole body's centre of mass.
    fn of(
        snapshot: &Snapshot,
        motion: &Motion,
        masses: &MassDistribution,
        rates: &[[f64; 3]; SEGMENTS],
    ) -> UpperInertia {
        let (mut force, mut rate) = (Vector3::zeros(), Vector3::zeros());
        for segment in Segment::ALL.into_iter().filter(|segment| segment.is_distal_to(Segment::L5)) {
            let index = segment.index();
            force += masses.body.mass_fraction[index] * Vector3::from(motion.acceleration_m_per_s2[index]);
            rate += Vector3::from(rates[index]);
        }
        // (c_i − o) = (c_i − C) + (C − o).
        let l5 = Segment::L5.index();
        let joint = snapshot.centre(l5) - snapshot.arm(l5);
        let moment_about_joint = rate + (centre_of_mass(snapshot, masses) - joint).cross(&force);
        UpperInertia { force_m_per_s2: force.into(), moment_m2_per_s2: moment_about_joint.into() }
    }
}

/// Motion of the whole body at one snapshot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertia {
    /// Acceleration of the centre of mass C̈, m/s².
    pub acceleration_m_per_s2: [f64; 3],
    /// Rate of the angular momentum about the centre of mass over the body's mass L̇/M, m²/s².
    pub momentum_rate_m2_per_s2: [f64; 3],
    /// Acceleration of the left and the right hand's centre, m/s².
    pub hand_acceleration_m_per_s2: [[f64; 3]; 2],
    /// Inertia of the body above L5/S1.
    pub upper: UpperInertia,
    /// Whether the suit's own accelerations are included.
    pub is_by_suit: bool,
    /// Half the window around the snapshot, ns: less than requested if the history stores less.
    pub half_window_ns: u64,
    /// Largest 1-σ of a time in the window, ns.
    pub time_sigma_ns: u64,
}

impl Inertia {
    /// A body at rest.
    pub const REST: Inertia = Inertia {
        acceleration_m_per_s2: [0.0; 3],
        momentum_rate_m2_per_s2: [0.0; 3],
        hand_acceleration_m_per_s2: [[0.0; 3]; 2],
        upper: UpperInertia::REST,
        is_by_suit: false,
        half_window_ns: 0,
        time_sigma_ns: 0,
    };

    /// Sums over the segments: masses and centres by the table, scaled to this subject's bone lengths.
    pub(super) fn of(snapshot: &Snapshot, motion: &Motion, masses: &MassDistribution) -> Inertia {
        let rates = momentum_rate_by_segment(snapshot, motion, masses);
        let momentum_rate: Vector3<f64> = rates.iter().map(|rate| Vector3::from(*rate)).sum();
        let mut whole = Vector3::zeros();
        for (mass, acceleration) in masses.body.mass_fraction.iter().zip(&motion.acceleration_m_per_s2) {
            whole += *mass * Vector3::from(*acceleration);
        }
        Inertia {
            acceleration_m_per_s2: whole.into(),
            momentum_rate_m2_per_s2: momentum_rate.into(),
            hand_acceleration_m_per_s2: Side::BOTH
                .map(|side| motion.acceleration_m_per_s2[side.hand().index()]),
            upper: UpperInertia::of(snapshot, motion, masses, &rates),
            ..Inertia::REST
        }
    }

    /// Whether the motion is one of work: no leap and no impact, to which a parabola does not apply.
    pub fn is_moderate(&self) -> bool {
        let square: f64 = self.acceleration_m_per_s2.iter().map(|value| value * value).sum();
        square < ACCELERATION_MAX_M_PER_S2 * ACCELERATION_MAX_M_PER_S2
            && self.specific_force_m_per_s2().is_some_and(|force| {
                self.turning_shift_m(force).iter().all(|shift| shift.abs() < TURNING_SHIFT_MAX_M)
            })
    }

    /// Vertical force over mass that this motion requires, g + C̈_z, m/s²; `None` for a leaping body.
    pub fn specific_force_m_per_s2(&self) -> Option<f64> {
        let force = GRAVITY_M_PER_S2 + self.acceleration_m_per_s2[2];
        (force > SPECIFIC_FORCE_MIN_M_PER_S2).then_some(force)
    }

    /// `(−L̇_y, L̇_x)/(M (g + C̈_z))`: shift of the CoP by the rotation of the body, m.
    pub fn turning_shift_m(&self, specific_force_m_per_s2: f64) -> [f64; 2] {
        let [x, y, _] = self.momentum_rate_m2_per_s2;
        [-y / specific_force_m_per_s2, x / specific_force_m_per_s2]
    }
}

/// Contribution of each segment to the rate of the angular momentum about the CoM over the body's mass, m²/s²: `μ_i
/// (c_i − C) × c̈_i + μ_i d/dt(R_i k_i² R_iᵀ ω_i)`, with ω and α from the orientation's quaternion, `ω = 2 q̇ q̄`, `α =
/// 2 q̈ q̄` (vector parts).
pub fn momentum_rate_by_segment(
    snapshot: &Snapshot,
    motion: &Motion,
    masses: &MassDistribution,
) -> [[f64; 3]; SEGMENTS] {
    let mass = &masses.body.mass_fraction;
    let centre = centre_of_mass(snapshot, masses);
    core::array::from_fn(|segment| {
        let arm = snapshot.centre(segment) - centre;
        let acceleration = Vector3::from(motion.acceleration_m_per_s2[segment]);
        let spin = spin_rate(
            &snapshot.orientation_wxyz[segment],
            &motion.turning[segment],
            &masses.gyration_m2[segment],
        );
        (mass[segment] * (arm.cross(&acceleration) + spin)).into()
    })
}

/// Centre of mass by the table, suit world, m.
fn centre_of_mass(snapshot: &Snapshot, masses: &MassDistribution) -> Vector3<f64> {
    let weighed = masses.body.mass_fraction.iter().enumerate();
    weighed.map(|(segment, mass)| *mass * snapshot.centre(segment)).sum()
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
    use crate::body::{Sex, Skeleton, gyration_m2};
    use crate::frame::{Pose, SuitWorld};
    use crate::motion::{Accelerations, History, MassDistribution};
    use nalgebra::UnitQuaternion;

    extern crate std;
    use std::boxed::Box;

    #[test]
    fn a_stiff_trunk_that_pitches_about_l5s1_has_the_moment_of_a_physical_pendulum() {
        let skeleton = Skeleton::nominal(1.77);
        let body = Anthropometry::de_leva(&skeleton, 1.77, Sex::Male);
        let gyration_m2 = gyration_m2(&skeleton, 1.77);
        let masses = MassDistribution { body: &body, gyration_m2: &gyration_m2 };
        let (omega, amplitude_rad) = (core::f64::consts::TAU * 0.7, 0.4);
        let joint = Vector3::new(0.02, 0.01, 1.05);
        let rest = skeleton.t_pose_m().map(Vector3::from);
        let above = |segment: usize| Segment::ALL[segment].is_distal_to(Segment::L5);
        let arm =
            |segment: usize| rest[segment] + Vector3::from(body.com_m[segment]) - rest[Segment::L5.index()];
        // Moment of inertia about the lateral axis through the joint, and first moment, over the body's mass.
        let (mut inertia_m2, mut first) = (0.0, Vector3::zeros());
        for segment in (0..SEGMENTS).filter(|segment| above(*segment)) {
            let (mass, arm) = (body.mass_fraction[segment], arm(segment));
            inertia_m2 += mass * (arm.x * arm.x + arm.z * arm.z + gyration_m2[segment][1]);
            first += mass * arm;
        }
        let mut history: Box<History> = bytemuck::zeroed_box();
        let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
        for index in 1..=200u64 {
            let time_ns = index * 10_000_000;
            let angle = amplitude_rad * (omega * time_ns as f64 * 1e-9).sin();
            let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
            let l5 = rest[Segment::L5.index()];
            let origin = core::array::from_fn(|segment| {
                let from_joint = rest[segment] - l5;
                joint + if above(segment) { turn * from_joint } else { from_joint }
            });
            let rotation =
                core::array::from_fn(
                    |segment| if above(segment) { turn } else { UnitQuaternion::identity() },
                );
            let pose = Pose::<SuitWorld>::new(origin, rotation);
            // The result must not depend on the anchor's shift.
            let shifted = pose.shifted(Vector3::new(0.4, -0.3, 0.0));
            history.push(Snapshot::new(time_ns, &pose, &shifted, &body));
            while let Some((snapshot, inertia)) = history.next(40_000_000, Accelerations::Positions, &masses)
            {
                let Some(Inertia { upper, .. }) = inertia else { continue };
                let time_s = snapshot.time_ns as f64 * 1e-9;
                if time_s < 0.05 {
                    // A one-sided window.
                    continue;
                }
                let (sin, cos) = (omega * time_s).sin_cos();
                let rate = amplitude_rad * omega * cos;
                let acceleration = -amplitude_rad * omega * omega * sin;
                let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), amplitude_rad * sin);
                let force = Vector3::y().cross(&(turn * first)) * acceleration
                    - turn * Vector3::new(first.x, 0.0, first.z) * (rate * rate);
                worst = worst.max((upper.moment_m2_per_s2[1] - inertia_m2 * acceleration).abs());
                worst = worst.max((Vector3::from(upper.force_m_per_s2) - force).norm());
                largest = largest.max((inertia_m2 * acceleration).abs());
            }
        }
        assert!(largest > 0.5 && worst < 0.02 * largest, "{worst} of {largest} m²/s²");
    }

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
        // Rotation about the vertical is not limited, because it shifts no CoP.
        assert!(moving([0.0; 3], [0.0, 0.0, 9.0]).is_moderate());
    }
}
