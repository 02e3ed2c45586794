//! A moving body of point masses, with simulated measurements of plate and suit.

extern crate std;
use std::vec::Vec;

use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use crate::body::{Anthropometry, SEGMENTS, Segment, Sex, Side, Skeleton};
use crate::effect::Observation;
use crate::sesc::Phi;

pub(super) const BODY_KG: f64 = 71.0;
pub(super) const FLOOR_M: f64 = 0.03;
const STEP_S: f64 = 2e-3;
const G: f64 = 9.81;

type Vector = Vector3<f64>;
/// Position of a mass at a time, s.
pub(super) type Path<'a> = &'a dyn Fn(f64) -> Vector;

/// Second derivative by a five-point formula.
pub(super) fn second(path: impl Fn(f64) -> Vector, time_s: f64) -> Vector {
    let at = |steps: f64| path(time_s + steps * STEP_S);
    (-at(2.0) + 16.0 * at(1.0) - 30.0 * at(0.0) + 16.0 * at(-1.0) - at(-2.0)) / (12.0 * STEP_S * STEP_S)
}

/// Errors of the suit: a rotation of each segment after and before its true rotation, and of the whole.
#[derive(Clone)]
pub(super) struct SuitError {
    pub(super) in_world: [Vector; SEGMENTS],
    pub(super) in_segment: [Vector; SEGMENTS],
    /// Factor of `in_segment` at a time, s.
    pub(super) factor: fn(f64) -> f64,
    pub(super) whole_rad: f64,
}

impl SuitError {
    pub(super) fn none() -> SuitError {
        let none = [Vector::zeros(); SEGMENTS];
        SuitError { in_world: none, in_segment: none, factor: |_| 1.0, whole_rad: 0.0 }
    }
}

pub(super) struct Body {
    pub(super) skeleton: Skeleton,
    pub(super) table: Anthropometry,
}

impl Body {
    pub(super) fn new() -> Body {
        let skeleton = Skeleton::nominal(1.77);
        let table = Anthropometry::de_leva(&skeleton, 1.77, Sex::Male);
        Body { skeleton, table }
    }

    /// True rotations: every segment swings separately, so that no two columns are equal.
    pub(super) fn rotation(&self, time_s: f64) -> [UnitQuaternion<f64>; SEGMENTS] {
        core::array::from_fn(|index| {
            let i = index as f64;
            let angle = |phase: f64, size: f64| size * sine(2.1 * time_s + phase * i + 0.3);
            let [x, y, z] = [angle(0.7, 0.4), angle(1.3, 0.6), angle(2.9, 0.3)];
            UnitQuaternion::from_euler_angles(x, y, z)
        })
    }

    /// Output of a suit with exact bone lengths: rotations with its errors, and the resulting joint positions. Both
    /// feet are held at their positions, as by the anchor; the whole rotates about them.
    pub(super) fn suit_pose(
        &self,
        time_s: f64,
        error: &SuitError,
    ) -> ([Vector; SEGMENTS], [UnitQuaternion<f64>; SEGMENTS]) {
        let truth = self.rotation(time_s);
        let turned = core::array::from_fn(|index| {
            UnitQuaternion::from_scaled_axis(error.in_world[index])
                * truth[index]
                * UnitQuaternion::from_scaled_axis(error.in_segment[index] * (error.factor)(time_s))
        });
        // The middle between the feet is fixed.
        let middle = Vector::new(0.1, -0.05, FLOOR_M + 0.05);
        let mut joints = self.joints(&turned);
        let off = middle - feet(&joints);
        for joint in &mut joints {
            *joint += off;
        }
        let whole = UnitQuaternion::from_axis_angle(&Vector::z_axis(), error.whole_rad);
        (joints.map(|joint| middle + whole * (joint - middle)), turned.map(|rotation| whole * rotation))
    }

    fn joints(&self, rotation: &[UnitQuaternion<f64>; SEGMENTS]) -> [Vector; SEGMENTS] {
        let mut joints = [Vector::zeros(); SEGMENTS];
        for segment in Segment::ALL {
            if let Some(parent) = segment.parent() {
                let offset = Vector::from(self.skeleton.offset_m[segment.index()]);
                joints[segment.index()] = joints[parent.index()] + rotation[parent.index()] * offset;
            }
        }
        joints
    }

    pub(super) fn point(&self, time_s: f64, segment: Segment, from_origin_m: Vector) -> Vector {
        let (joints, rotation) = self.suit_pose(time_s, &SuitError::none());
        joints[segment.index()] + rotation[segment.index()] * from_origin_m
    }

    /// Total load on the plate at a time: the body's point masses, other masses, and a force on the body at a point.
    pub(super) fn reaction(
        &self,
        time_s: f64,
        others: &[(f64, Path)],
        push: Option<(Vector, Vector)>,
    ) -> Reaction {
        let mut reaction = Reaction { force_n: Vector::zeros(), first_nm: [0.0; 2] };
        for segment in Segment::ALL {
            let centre = Vector::from(self.table.com_m[segment.index()]);
            let mass_kg = BODY_KG * self.table.mass_fraction[segment.index()];
            reaction.add_mass(mass_kg, &|t| self.point(t, segment, centre), time_s);
        }
        for (mass_kg, path) in others {
            reaction.add_mass(*mass_kg, path, time_s);
        }
        if let Some((at, force)) = push {
            reaction.add_force(at, -force);
        }
        reaction
    }

    /// The model's observation from the suit's output, and the plate's reading of `truth`.
    pub(super) fn observation(
        &self,
        time_s: f64,
        error: &SuitError,
        phi: &Phi,
        truth: &Reaction,
        shear: bool,
    ) -> Observation {
        let (joints, rotation) = self.suit_pose(time_s, error);
        let centre = |t: f64| {
            let (joints, rotation) = self.suit_pose(t, error);
            (0..SEGMENTS).fold(joints[0], |sum, index| sum + rotation[index] * Vector::from(phi.0[index]))
        };
        let matrix = |t: f64, index: usize| *self.suit_pose(t, error).1[index].to_rotation_matrix().matrix();
        let column =
            |t: f64, index: usize, axis: usize| -> Vector { matrix(t, index).column(axis).into_owned() };
        let rows =
            |columns: [Vector; 3]| [0, 1, 2].map(|row| [columns[0][row], columns[1][row], columns[2][row]]);
        let acceleration = second(centre, time_s);
        let specific = G + acceleration.z;
        let turning = self.turning_m2_per_s2(time_s, error) / specific;
        let com = centre(time_s);
        let slope = [0, 1].map(|axis| {
            let push = if shear { truth.force_n[axis] / BODY_KG } else { acceleration[axis] };
            push / specific
        });
        let cop = [0, 1].map(|axis| com[axis] - slope[axis] * (com.z - FLOOR_M) + turning[axis]);
        let middle = feet(&joints);
        Observation {
            time_s: 0.0,
            mass_kg: BODY_KG,
            floor_m: FLOOR_M,
            feet_m: [middle.x, middle.y],
            feet_hold: true,
            origin_m: joints.map(Into::into),
            origin_acceleration_m_per_s2: core::array::from_fn(|index| {
                second(|t| self.suit_pose(t, error).0[index], time_s).into()
            }),
            rotation: core::array::from_fn(|index| {
                let turned: Rotation3<f64> = rotation[index].to_rotation_matrix();
                rows([0, 1, 2].map(|axis| turned.matrix().column(axis).into_owned()))
            }),
            rotation_acceleration_per_s2: core::array::from_fn(|index| {
                rows([0, 1, 2].map(|axis| second(|t| column(t, index, axis), time_s)))
            }),
            phi_m: phi.0,
            grip_m: Side::BOTH.map(|side| self.table.grip_m(side.hand())),
            centre_m: self.table.com_m,
            mass_fraction: self.table.mass_fraction,
            com_m: com.into(),
            com_acceleration_m_per_s2: acceleration.into(),
            turning_m: turning.into(),
            slope,
            slope_is_measured: shear,
            cop_predicted_m: cop,
            force_predicted_n: (BODY_KG * (acceleration + Vector::new(0.0, 0.0, G))).into(),
            cop_measured_m: truth.cop_m(),
            force_measured_n: truth.force_n.into(),
        }
    }

    /// `(−L̇_y, L̇_x)/M` of the motion measured by the suit.
    fn turning_m2_per_s2(&self, time_s: f64, error: &SuitError) -> nalgebra::Vector2<f64> {
        let paths: Vec<_> = Segment::ALL
            .iter()
            .map(|segment| {
                let centre = Vector::from(self.table.com_m[segment.index()]);
                let path = move |t: f64| {
                    let (joints, rotation) = self.suit_pose(t, error);
                    joints[segment.index()] + rotation[segment.index()] * centre
                };
                (self.table.mass_fraction[segment.index()], path(time_s), second(path, time_s))
            })
            .collect();
        let middle: Vector = paths.iter().map(|(mass_fraction, at, _)| *mass_fraction * at).sum();
        let rate: Vector =
            paths.iter().map(|(mass_fraction, at, pull)| *mass_fraction * (at - middle).cross(pull)).sum();
        nalgebra::Vector2::new(-rate.y, rate.x)
    }
}

fn feet(joints: &[Vector; SEGMENTS]) -> Vector {
    let ends = [Segment::LeftFoot, Segment::LeftToe, Segment::RightFoot, Segment::RightToe];
    ends.iter().map(|end| joints[end.index()]).sum::<Vector>() * 0.25
}

pub(super) fn sine(angle: f64) -> f64 {
    crate::math::sin_cos(angle).0
}

/// Force of the ground, and its first moments, from which the CoP follows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reaction {
    pub(super) force_n: Vector,
    pub(super) first_nm: [f64; 2],
}

impl Reaction {
    fn add_mass(&mut self, mass_kg: f64, path: Path, time_s: f64) {
        let pull = second(path, time_s) + Vector::new(0.0, 0.0, G);
        self.add_force(path(time_s), mass_kg * pull);
    }

    /// Adds the ground force that acts on a mass at a position above it.
    fn add_force(&mut self, at: Vector, force: Vector) {
        self.force_n += force;
        for axis in 0..2 {
            self.first_nm[axis] += force.z * at[axis] - force[axis] * (at.z - FLOOR_M);
        }
    }

    pub(super) fn cop_m(&self) -> [f64; 2] {
        self.first_nm.map(|first| first / self.force_n.z)
    }
}
