//! Plate geometry from several positions of a known mass: scale of the moments, rotation, origin.

use nalgebra::{Matrix3, Vector3};

/// 1-σ of a position measured with a ruler, m.
const RULER_SIGMA_M: f64 = 0.002;
/// Minimum extent of the positions in every direction, m.
const SPAN_MIN_M: f64 = 0.08;

/// A number and its 1-σ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The number.
    pub value: f64,
    /// 1-σ.
    pub sigma: f64,
}

/// Deviation of the plate's positions from those of the ruler.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    /// Excess of distances along x, as a fraction.
    pub scale_x: Estimate,
    /// The same along y.
    pub scale_y: Estimate,
    /// Rotation of the plate's axes to the right of the configured ones, rad.
    pub turned_rad: Estimate,
    /// Measured position of a point at the plate's origin, m.
    pub origin_m: [Estimate; 2],
    /// Root mean square residual per axis, m; 0 for three positions, which always fit.
    pub left_m: f64,
}

/// Compares measured positions with true ones, both in the plate's own frame, m.
///
/// `None` for fewer than three positions, or positions close to a line.
pub fn geometry(seen_m: &[[f64; 2]], true_m: &[[f64; 2]]) -> Option<Geometry> {
    let count = seen_m.len().min(true_m.len());
    if count < 3 || !spans(&true_m[..count]) {
        return None;
    }
    let rows: Vec<Vector3<f64>> = true_m[..count].iter().map(|[x, y]| Vector3::new(1.0, *x, *y)).collect();
    let information: Matrix3<f64> = rows.iter().map(|row| row * row.transpose()).sum();
    let inverse = information.try_inverse()?;
    let fits = [0, 1].map(|axis| {
        let right: Vector3<f64> = rows.iter().zip(seen_m).map(|(row, seen)| row * seen[axis]).sum();
        inverse * right
    });
    let square: f64 = rows
        .iter()
        .zip(seen_m)
        .map(|(row, seen)| (0..2).map(|axis| (seen[axis] - row.dot(&fits[axis])).powi(2)).sum::<f64>())
        .sum();
    let freedom = 2.0 * count as f64 - 6.0;
    let scatter_m = if freedom > 0.0 { (square / freedom).sqrt() } else { 0.0 };
    let sigma_m = scatter_m.max(RULER_SIGMA_M);
    let sigma = |parameter: usize| sigma_m * inverse[(parameter, parameter)].max(0.0).sqrt();
    let estimate = |value: f64, parameter: usize| Estimate { value, sigma: sigma(parameter) };
    let [x, y] = fits;
    Some(Geometry {
        scale_x: estimate(x[1] - 1.0, 1),
        scale_y: estimate(y[2] - 1.0, 2),
        turned_rad: Estimate { value: 0.5 * (y[1] - x[2]), sigma: 0.5 * sigma(1).hypot(sigma(2)) },
        origin_m: [estimate(x[0], 0), estimate(y[0], 0)],
        left_m: (square / (2.0 * count as f64)).sqrt(),
    })
}

/// Whether the positions are apart in every direction.
fn spans(places_m: &[[f64; 2]]) -> bool {
    (0..12).all(|index| {
        let (sine, cosine) = (core::f64::consts::PI * f64::from(index) / 12.0).sin_cos();
        let along = places_m.iter().map(|[x, y]| cosine * x + sine * y);
        let (least, most) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), m| (a.min(m), b.max(m)));
        most - least >= SPAN_MIN_M
    })
}
