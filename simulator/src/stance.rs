//! Two feet flat on the floor, and their support polygon.

use equipoise_core::body::{Segment, Side};
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use crate::person::Person;

/// Placement of the feet. Arrays are indexed by [`Side::BOTH`]: left, right.
#[derive(Debug, Clone, PartialEq)]
pub struct Stance {
    /// Ankle joints in the world, m.
    pub ankle_m: [Vector3<f64>; 2],
    /// `world_from_foot`: a rotation about Z, since the soles are flat.
    pub world_from_foot: [UnitQuaternion<f64>; 2],
    /// Corners of the support polygon, counter-clockwise, m.
    pub support_m: Vec<Vector2<f64>>,
}

impl Stance {
    /// Feet a little wider than the hips with toes slightly out, their ankles left and right of the origin.
    pub fn shoulder_wide(person: &Person) -> Stance {
        Stance::new(person, Vector2::zeros(), 0.075 * person.height_m, 7.0)
    }

    /// Feet left and right of `middle_m`, each `half_width_m` away and turned out by `toe_out_deg`.
    pub fn new(person: &Person, middle_m: Vector2<f64>, half_width_m: f64, toe_out_deg: f64) -> Stance {
        let place = |side: f64| {
            let ankle = Vector3::new(middle_m.x, middle_m.y + side * half_width_m, person.ankle_height_m);
            (ankle, UnitQuaternion::from_scaled_axis(Vector3::z() * side * toe_out_deg.to_radians()))
        };
        let feet = [1.0, -1.0].map(place);
        let (ankle_m, world_from_foot) = (feet.map(|foot| foot.0), feet.map(|foot| foot.1));
        let support_m = Stance::support_of(person, &ankle_m, &world_from_foot, [true; 2]);
        Stance { ankle_m, world_from_foot, support_m }
    }

    /// Corners of the support polygon of the loaded soles, counter-clockwise, m.
    pub fn support_of(
        person: &Person,
        ankle_m: &[Vector3<f64>; 2],
        world_from_foot: &[UnitQuaternion<f64>; 2],
        carries: [bool; 2],
    ) -> Vec<Vector2<f64>> {
        let mut corners = Vec::new();
        for k in (0..2).filter(|&k| carries[k]) {
            for x in [-person.foot_outline_m.back, person.foot_outline_m.forward] {
                for y in [-person.foot_outline_m.half_width, person.foot_outline_m.half_width] {
                    corners.push((ankle_m[k] + world_from_foot[k] * Vector3::new(x, y, 0.0)).xy());
                }
            }
        }
        convex_hull(corners)
    }

    /// A point between the feet, `forward_m` in front of the line between the ankles.
    pub fn between_the_feet_m(&self, forward_m: f64) -> Vector2<f64> {
        (self.ankle_m[0].xy() + self.ankle_m[1].xy()) * 0.5 + Vector2::new(forward_m, 0.0)
    }

    /// Distance of a point inside the support polygon from its boundary, m; negative outside.
    pub fn margin_m(&self, point_m: Vector2<f64>) -> f64 {
        let next = self.support_m.iter().cycle().skip(1);
        self.support_m
            .iter()
            .zip(next)
            .map(|(a, b)| (b - a).perp(&(point_m - a)) / (b - a).norm())
            .fold(f64::INFINITY, f64::min)
    }

    /// Upper leg, lower leg, foot and toe of a side.
    pub fn leg(side: Side) -> [Segment; 4] {
        let foot = side.foot().index();
        [foot - 2, foot - 1, foot, foot + 1].map(|index| Segment::ALL[index])
    }
}

/// Andrew's monotone chain; counter-clockwise.
fn convex_hull(mut point: Vec<Vector2<f64>>) -> Vec<Vector2<f64>> {
    point.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let half = |points: &mut dyn Iterator<Item = &Vector2<f64>>| {
        let mut chain: Vec<Vector2<f64>> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..] {
                if (b - a).perp(&(point - a)) > 0.0 {
                    break;
                }
                chain.pop();
            }
            chain.push(*point);
        }
        chain.pop();
        chain
    };
    let mut hull = half(&mut point.iter());
    hull.extend(half(&mut point.iter().rev()));
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_is_inside_and_a_step_away_is_not() {
        let stance = Stance::shoulder_wide(&Person::nominal(1.77, 72.0));
        assert!(stance.margin_m(stance.between_the_feet_m(0.04)) > 0.05);
        assert!(stance.margin_m(Vector2::new(0.4, 0.0)) < 0.0);
        assert!(stance.margin_m(Vector2::new(0.0, 0.3)) < 0.0);
        assert!(stance.support_m.len() >= 6);
    }
}
