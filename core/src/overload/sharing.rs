//! Projections that distribute a force between two points: ζ between the feet, η between the hands.

use crate::math;

/// Points closer than this count as one point; the line between them has no direction, m.
pub const TOO_CLOSE_M: f64 = 0.05;

/// Projection of a point on the line from `from` to `to`, clamped to [0, 1], and the distance of the point from it, m.
/// The middle for points closer than [`TOO_CLOSE_M`].
pub fn project(point: [f64; 2], [from, to]: [[f64; 2]; 2]) -> (f64, f64) {
    let along = [to[0] - from[0], to[1] - from[1]];
    let square = along[0] * along[0] + along[1] * along[1];
    let fraction = if square > TOO_CLOSE_M * TOO_CLOSE_M {
        (((point[0] - from[0]) * along[0] + (point[1] - from[1]) * along[1]) / square).clamp(0.0, 1.0)
    } else {
        0.5
    };
    let off = [point[0] - from[0] - fraction * along[0], point[1] - from[1] - fraction * along[1]];
    (fraction, math::hypot(off))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_on_the_line_shares_by_distance_and_one_beyond_it_is_clamped() {
        let line = [[0.0, 0.2], [0.0, -0.2]];
        assert_eq!(project([0.0, 0.1], line), (0.25, 0.0));
        assert_eq!(project([0.3, 0.0], line), (0.5, 0.3));
        let (fraction, distance) = project([0.0, -0.5], line);
        assert!((fraction - 1.0).abs() < 1e-15 && (distance - 0.3).abs() < 1e-12);
    }

    #[test]
    fn points_together_share_evenly() {
        assert_eq!(project([0.5, 0.0], [[0.4, 0.01], [0.4, -0.01]]).0, 0.5);
    }
}
