//! Fits the position of one horizontal plane in another from pairs of points: `c = A p + t`, A = ((a, −b), (b, a)).
//!
//! Recursive least squares (a Kalman filter with a constant state) in a, b and t, in which the map is linear: any
//! heading, no initial guess, no iteration. The points are the accurate quantities, the images those with the errors:
//! the other way round, errors would shrink the map. A rigid map has a² + b² = 1. The fit does not use this; it serves
//! as a check ([`PlanarFit::is_rigid`]), which inconsistent pairs fail.

use bytemuck::{Pod, Zeroable};
use nalgebra::{Matrix4, Vector4};

use crate::frame::Turn;
use crate::math;

/// Exceeded with a probability of 0.001 for two degrees of freedom.
const NIS_OUTLIER: f64 = 13.8;
/// A map that scales by more than this factor is not that of a rigid body. Errors common to points and images shrink
/// the map, and so does a filter applied to one of the two: natural work gave 0.75.
const SCALE_MAX: f64 = 2.0;

/// Heading and position of a plane in another, with their covariance. All zero before [`PlanarFit::start`].
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct PlanarFit {
    /// Origin of the points, m: that of the first pair, so that t needs no prior.
    pivot_m: [f64; 2],
    /// a, b, t in x and y, m.
    state: [f64; 4],
    covariance: [[f64; 4]; 4],
    /// Pairs accepted since the first.
    pairs: u64,
}

impl PlanarFit {
    /// Discards all pairs. The heading is 0 with the 1-σ `heading_sigma_rad`; from π/2 on it is uniform. Mean and
    /// variance of a = cos and b = sin are those of such a heading: 0 and ½ if it is uniform, else 1 and σ⁴/2, 0 and
    /// σ².
    pub fn start(&mut self, heading_sigma_rad: f64) {
        let variance = heading_sigma_rad * heading_sigma_rad;
        let is_unknown = heading_sigma_rad >= core::f64::consts::FRAC_PI_2;
        let (mean, [of_a, of_b]) =
            if is_unknown { (0.0, [0.5; 2]) } else { (1.0, [0.5 * variance * variance, variance]) };
        *self = PlanarFit { state: [mean, 0.0, 0.0, 0.0], ..Zeroable::zeroed() };
        (self.covariance[0][0], self.covariance[1][1]) = (of_a, of_b);
    }

    /// Ingests a pair: a point of the plane, and its position in the other, m, each axis with its own variance, m². A
    /// pair that contradicts the earlier ones is rejected. Returns whether it was accepted.
    pub fn ingest_pair(&mut self, point_m: [f64; 2], image_m: [f64; 2], variance_m2: [f64; 2]) -> bool {
        let numbers = point_m.iter().chain(&image_m).chain(&variance_m2);
        if !numbers.copied().all(f64::is_finite) || variance_m2.iter().any(|variance| *variance <= 0.0) {
            return false;
        }
        if self.pairs == 0 {
            self.pivot_m = point_m;
            (self.state[2], self.state[3]) = (image_m[0], image_m[1]);
            (self.covariance[2][2], self.covariance[3][3]) = (variance_m2[0], variance_m2[1]);
            self.pairs = 1;
            return true;
        }
        let taken = self.update(self.rows(point_m), image_m, variance_m2);
        self.pairs += u64::from(taken);
        taken
    }

    /// Ingests a vector of the plane and its image in the other, each component with its own variance: it depends on
    /// the heading alone. Returns whether it was accepted.
    pub fn ingest_vector(&mut self, [x, y]: [f64; 2], image: [f64; 2], variance: [f64; 2]) -> bool {
        let numbers = [x, y].into_iter().chain(image).chain(variance);
        let is_sound = numbers.clone().all(f64::is_finite) && variance.iter().all(|variance| *variance > 0.0);
        is_sound
            && self.update([Vector4::new(x, -y, 0.0, 0.0), Vector4::new(y, x, 0.0, 0.0)], image, variance)
    }

    /// Performs two scalar measurements, unless they are outliers.
    fn update(&mut self, rows: [Vector4<f64>; 2], measured: [f64; 2], variance: [f64; 2]) -> bool {
        let before = (self.state, self.covariance);
        let mut nis = 0.0;
        for (axis, row) in rows.into_iter().enumerate() {
            let (state, covariance) = (Vector4::from(self.state), Matrix4::from(self.covariance));
            let spread = covariance * row;
            let expected = row.dot(&spread).max(0.0) + variance[axis];
            let innovation = measured[axis] - row.dot(&state);
            nis += innovation * innovation / expected;
            self.state = (state + spread * (innovation / expected)).into();
            self.covariance = (covariance - spread * spread.transpose() / expected).into();
            for index in 0..4 {
                // Corrects rounding errors.
                self.covariance[index][index] = self.covariance[index][index].max(0.0);
            }
        }
        if nis >= NIS_OUTLIER {
            (self.state, self.covariance) = before;
        }
        nis < NIS_OUTLIER
    }

    /// Adds a process variance on each axis: the plane may have moved, m².
    pub fn add_process_noise(&mut self, variance_m2: f64) {
        for axis in [2, 3] {
            self.covariance[axis][axis] += variance_m2;
        }
    }

    /// Ingests the heading, with the 1-σ `sigma_rad`.
    pub fn ingest_heading(&mut self, heading_rad: f64, sigma_rad: f64) {
        let variance = sigma_rad * sigma_rad;
        let rows = [Vector4::new(1.0, 0.0, 0.0, 0.0), Vector4::new(0.0, 1.0, 0.0, 0.0)];
        self.update(rows, Turn::by(heading_rad).of([1.0, 0.0]), [variance, variance]);
    }

    /// Whether any pair was accepted.
    pub fn has_begun(&self) -> bool {
        self.pairs > 0
    }

    /// From the plane's heading to the other's, rad.
    pub fn heading_rad(&self) -> f64 {
        math::atan2(self.state[1], self.state[0])
    }

    /// 1-σ of the heading, rad; π if it is unavailable.
    pub fn heading_sigma_rad(&self) -> f64 {
        let [a, b, ..] = self.state;
        let square = a * a + b * b;
        if square <= 0.0 {
            return core::f64::consts::PI;
        }
        math::sqrt(self.variance_along([-b, a]) / (square * square)).min(core::f64::consts::PI)
    }

    /// Whether the map is consistent with a rigid body.
    pub fn is_rigid(&self) -> bool {
        let [a, b, ..] = self.state;
        let scale = math::hypot([a, b]);
        let sigma = math::sqrt(self.variance_along([a, b])) / scale.max(f64::MIN_POSITIVE);
        scale > 0.0 && (scale + sigma) * SCALE_MAX >= 1.0 && scale - sigma <= SCALE_MAX
    }

    /// Image of a point of the plane in the other, m.
    pub fn image_m(&self, point_m: [f64; 2]) -> [f64; 2] {
        self.rows(point_m).map(|row| row.dot(&Vector4::from(self.state)))
    }

    /// Variance of [`PlanarFit::image_m`] per axis, m².
    pub fn variance_m2(&self, point_m: [f64; 2]) -> [f64; 2] {
        self.rows(point_m).map(|row| row.dot(&(Matrix4::from(self.covariance) * row)).max(0.0))
    }

    /// Transforms the fit after the other plane was rotated about its origin by `turn` and then moved by `by_m`.
    pub fn transform(&mut self, turn: Turn, by_m: [f64; 2]) {
        let [cos, sin] = turn.of([1.0, 0.0]);
        let with = Matrix4::new(
            cos, -sin, 0.0, 0.0, //
            sin, cos, 0.0, 0.0, //
            0.0, 0.0, cos, -sin, //
            0.0, 0.0, sin, cos,
        );
        let state = with * Vector4::from(self.state);
        self.state = (state + Vector4::new(0.0, 0.0, by_m[0], by_m[1])).into();
        self.covariance = (with * Matrix4::from(self.covariance) * with.transpose()).into();
    }

    /// Whether every number is in range; a stored fit is checked before use.
    pub fn is_sound(&self) -> bool {
        let numbers = self.pivot_m.iter().chain(&self.state).chain(self.covariance.iter().flatten());
        numbers.copied().all(f64::is_finite)
            && (0..4).all(|index| self.covariance[index][index] >= 0.0)
            && self.pairs < 1 << 48
    }

    fn variance_along(&self, [along_a, along_b]: [f64; 2]) -> f64 {
        let [[aa, ab, ..], [_, bb, ..], ..] = self.covariance;
        (along_a * along_a * aa + 2.0 * along_a * along_b * ab + along_b * along_b * bb).max(0.0)
    }

    fn rows(&self, point_m: [f64; 2]) -> [Vector4<f64>; 2] {
        let [x, y] = [0, 1].map(|axis| point_m[axis] - self.pivot_m[axis]);
        [Vector4::new(x, -y, 1.0, 0.0), Vector4::new(y, x, 0.0, 1.0)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VARIANCE_M2: [f64; 2] = [1e-4; 2];

    fn sine(angle_rad: f64) -> f64 {
        math::sin_cos(angle_rad).0
    }

    /// Points of a body that sways and reaches: ± 6 cm.
    fn point_m(index: u32) -> [f64; 2] {
        let phase = f64::from(index) * 0.7;
        [2.0 + 0.06 * sine(phase), -1.0 + 0.04 * sine(1.7 * phase)]
    }

    fn fitted(heading_rad: f64, by_m: [f64; 2], sigma_rad: f64, pairs: u32) -> PlanarFit {
        let mut fit: PlanarFit = Zeroable::zeroed();
        fit.start(sigma_rad);
        for index in 0..pairs {
            let [x, y] = Turn::by(heading_rad).of(point_m(index));
            assert!(fit.ingest_pair(point_m(index), [x + by_m[0], y + by_m[1]], VARIANCE_M2));
        }
        fit
    }

    #[test]
    fn recovers_any_heading_and_position() {
        for heading_rad in [-3.0, -1.5, -0.2, 0.0, 0.7, 2.2, 3.1] {
            let fit = fitted(heading_rad, [0.3, -5.0], core::f64::consts::PI, 100);
            let off_rad = fit.heading_rad() - heading_rad;
            assert!(off_rad.abs() < 3.0 * fit.heading_sigma_rad(), "{heading_rad}: {off_rad}");
            assert!(fit.heading_sigma_rad() < 0.03 && fit.is_rigid(), "{fit:?}");
            let [x, y] = Turn::by(heading_rad).of(point_m(17));
            let image = fit.image_m(point_m(17));
            assert!((image[0] - x - 0.3).abs() < 0.003 && (image[1] - y + 5.0).abs() < 0.003, "{image:?}");
        }
    }

    #[test]
    fn standing_determines_the_position_and_not_the_heading() {
        let mut fit: PlanarFit = Zeroable::zeroed();
        fit.start(core::f64::consts::PI);
        for _ in 0..100 {
            fit.ingest_pair([2.0, -1.0], [0.1, 0.2], VARIANCE_M2);
        }
        assert!(fit.heading_sigma_rad() > 1.0);
        let [x, y] = fit.image_m([2.0, -1.0]);
        assert!((x - 0.1).abs() < 1e-9 && (y - 0.2).abs() < 1e-9);
        assert!(fit.variance_m2([2.0, -1.0])[0] < 1.1e-6);
        assert!(fit.variance_m2([2.5, -1.0])[0] > 0.01, "half a metre off, the fit is free");
    }

    #[test]
    fn a_heading_prior_needs_no_motion() {
        let fit = fitted(0.0, [0.3, 0.0], 0.01, 10);
        assert!(fit.heading_sigma_rad() <= 0.01 && fit.variance_m2(point_m(0))[0] < 2e-5, "{fit:?}");
    }

    #[test]
    fn pairs_of_another_body_are_not_rigid() {
        let mut fit: PlanarFit = Zeroable::zeroed();
        fit.start(core::f64::consts::PI);
        for index in 0..200 {
            let [x, y] = point_m(index);
            fit.ingest_pair([x, y], [0.4 * x, 0.4 * y], VARIANCE_M2);
        }
        assert!(!fit.is_rigid());
    }

    #[test]
    fn outliers_and_non_finite_values_change_nothing() {
        let mut fit = fitted(0.3, [0.0, 0.0], core::f64::consts::PI, 50);
        let before = bytemuck::bytes_of(&fit).to_vec();
        assert!(!fit.ingest_pair(point_m(3), [9.0, 9.0], VARIANCE_M2));
        assert!(!fit.ingest_pair([f64::NAN, 0.0], [0.0; 2], VARIANCE_M2));
        assert!(!fit.ingest_pair(point_m(3), [0.0; 2], [0.0, 1.0]));
        assert_eq!(before, bytemuck::bytes_of(&fit));
    }

    #[test]
    fn vectors_determine_the_heading_and_no_position() {
        let mut fit: PlanarFit = Zeroable::zeroed();
        fit.start(core::f64::consts::PI);
        for index in 0..100 {
            let vector = [sine(f64::from(index)), sine(1.3 * f64::from(index) + 1.0)];
            assert!(fit.ingest_vector(vector, Turn::by(-2.0).of(vector), [0.01; 2]));
        }
        assert!((fit.heading_rad() + 2.0).abs() < 0.01 && fit.heading_sigma_rad() < 0.02 && fit.is_rigid());
        assert!(!fit.has_begun());
    }

    #[test]
    fn transforming_the_fit_applies_the_correction() {
        let mut fit = fitted(1.1, [0.3, -5.0], core::f64::consts::PI, 100);
        let sigma_rad = fit.heading_sigma_rad();
        let (turn, point) = (Turn::by(-fit.heading_rad()), point_m(5));
        let turned = turn.of(fit.image_m(point));
        let by_m = [0, 1].map(|axis| point[axis] - turned[axis]);
        fit.transform(turn, by_m);
        assert!(fit.heading_rad().abs() < 1e-12);
        assert!((fit.heading_sigma_rad() - sigma_rad).abs() < 1e-12);
        let again = fit.image_m(point);
        assert!((again[0] - point[0]).abs() < 1e-12 && (again[1] - point[1]).abs() < 1e-12);
    }
}
