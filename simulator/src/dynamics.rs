//! Newton–Euler equations over all segments and the box: the ground reaction that the body's motion requires.

use equipoise_core::body::Segment;
use nalgebra::{Vector2, Vector3};

use crate::GRAVITY_M_PER_S2;
use crate::motion::BodyState;
use crate::person::Person;

/// A force and its moment about the world's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wrench {
    /// Force, N.
    pub force_n: Vector3<f64>,
    /// Moment about the world's origin, N m.
    pub moment_nm: Vector3<f64>,
}

impl Wrench {
    /// A force at a point (m).
    pub fn at(point_m: Vector3<f64>, force_n: Vector3<f64>) -> Wrench {
        Wrench { force_n, moment_nm: point_m.cross(&force_n) }
    }

    /// Fx Fy Fz (N), Mx My Mz (N m).
    pub fn components(&self) -> [f64; 6] {
        let [f, m] = [self.force_n, self.moment_nm];
        [f.x, f.y, f.z, m.x, m.y, m.z]
    }

    /// Centre of pressure on the floor (`z = 0`), m. Undefined without a vertical force.
    pub fn cop_m(&self) -> Vector2<f64> {
        Vector2::new(-self.moment_nm.y, self.moment_nm.x) / self.force_n.z
    }
}

/// Ground reaction on the person, from three states `step_s` apart: the rates of the momenta, minus gravity.
///
/// Each segment's angular momentum is taken at the half steps, where its angular velocity is the rotation of one step.
/// The box is a point ([`BodyState::load_m`]); while it is grasped the hands carry a growing fraction of it.
pub fn ground_reaction(person: &Person, around: &[BodyState; 3], step_s: f64) -> Wrench {
    external_wrench(person, around, step_s, |_| true)
}

/// Wrench of the surroundings on selected segments together with the box, as [`ground_reaction`] for all of them.
pub(crate) fn external_wrench(
    person: &Person,
    [before, now, after]: &[BodyState; 3],
    step_s: f64,
    wanted: impl Fn(Segment) -> bool,
) -> Wrench {
    let mut wrench = Wrench { force_n: Vector3::zeros(), moment_nm: Vector3::zeros() };
    let mut add_mass = |mass_kg: f64, past: Vector3<f64>, here: Vector3<f64>, next: Vector3<f64>| {
        let acceleration = (next - here * 2.0 + past) / (step_s * step_s);
        let force = mass_kg * (acceleration + Vector3::z() * GRAVITY_M_PER_S2);
        wrench.force_n += force;
        wrench.moment_nm += here.cross(&force);
    };
    let wanted: Vec<usize> = Segment::ALL.into_iter().filter(|s| wanted(*s)).map(Segment::index).collect();
    for &i in &wanted {
        add_mass(person.segment_mass_kg[i], before.com_m[i], now.com_m[i], after.com_m[i]);
    }
    add_mass(now.load_kg, before.load_m(), now.load_m(), after.load_m());
    for i in wanted {
        let spin = |from: &BodyState, to: &BodyState| spin_nms(person, i, from, to, step_s);
        wrench.moment_nm += (spin(now, after) - spin(before, now)) / step_s;
    }
    wrench
}

/// Angular momentum of a segment about its own centre between two states, N m s.
fn spin_nms(person: &Person, i: usize, from: &BodyState, to: &BodyState, step_s: f64) -> Vector3<f64> {
    let (start, end) = (from.world_from_segment[i], to.world_from_segment[i]);
    let turn = (end * start.inverse()).scaled_axis();
    let middle = nalgebra::UnitQuaternion::new_normalize(
        start.quaternion() + end.quaternion() * start.dot(&end).signum(),
    );
    middle * (person.inertia_kg_m2[i] * (middle.inverse() * (turn / step_s)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use equipoise_core::body::SEGMENTS;
    use nalgebra::UnitQuaternion;

    /// A body in free fall: its centre falls freely, every segment rotates with it as one rigid body about that centre.
    fn falling(person: &Person, time_s: f64) -> BodyState {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, 1.1, -0.7) * time_s);
        let fall = Vector3::new(0.5 * time_s, 0.1, 2.0 + time_s - 0.5 * GRAVITY_M_PER_S2 * time_s * time_s);
        let rest = crate::kinematics::origins_m(person, Vector3::zeros(), &[turn; SEGMENTS]);
        let com = crate::kinematics::coms_m(&person.com_m, &rest, &[turn; SEGMENTS]);
        let centre = crate::kinematics::centre_m(&person.segment_mass_kg, &com);
        let move_there = |points: [Vector3<f64>; SEGMENTS]| points.map(|point| point - centre + fall);
        BodyState {
            time_s,
            origin_m: move_there(rest),
            world_from_segment: [turn; SEGMENTS],
            com_m: move_there(com),
            grip_m: [fall; 2],
            load_kg: 0.0,
            right_hand_fraction: 0.5,
            load_ahead_m: Vector3::zeros(),
            squeeze_n: Vector3::zeros(),
            feet: crate::feet::FeetDivision::EVEN,
            foot_stands: [true; 2],
        }
    }

    #[test]
    fn a_falling_body_needs_no_ground() {
        let person = Person::new(4, 1.77, 72.0);
        let h = 1e-3;
        let around = [0.3 - h, 0.3, 0.3 + h].map(|t| falling(&person, t));
        assert!(ground_reaction(&person, &around, h).force_n.norm() < 1e-4);
    }

    #[test]
    fn the_moment_of_a_spinning_rigid_body_is_eulers() {
        // One rigid body: its moment about the centre must be ω × Iω with its total inertia.
        let person = Person::new(4, 1.77, 72.0);
        let (t, h) = (0.3, 1e-3);
        let around = [t - h, t, t + h].map(|t| falling(&person, t));
        let state = &around[1];
        let centre = crate::kinematics::centre_m(&person.segment_mass_kg, &state.com_m);
        let mut inertia = nalgebra::Matrix3::zeros();
        for i in 0..SEGMENTS {
            let r = state.com_m[i] - centre;
            let turn = state.world_from_segment[i].to_rotation_matrix();
            inertia += turn.matrix() * person.inertia_kg_m2[i] * turn.matrix().transpose();
            inertia += person.segment_mass_kg[i]
                * (nalgebra::Matrix3::identity() * r.norm_squared() - r * r.transpose());
        }
        let spin = Vector3::new(0.4, 1.1, -0.7);
        let expected = spin.cross(&(inertia * spin));
        let moment = ground_reaction(&person, &around, h).moment_nm;
        assert!((moment - expected).norm() < 1e-3, "{moment:?} {expected:?}");
    }

    #[test]
    fn a_force_has_its_centre_of_pressure_where_its_line_meets_the_floor() {
        let wrench = Wrench::at(Vector3::new(0.1, -0.2, 0.0), Vector3::new(30.0, 10.0, 700.0));
        assert!((wrench.cop_m() - Vector2::new(0.1, -0.2)).norm() < 1e-12);
    }
}
