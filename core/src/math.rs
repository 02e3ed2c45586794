//! Elementary functions without the standard library.

use nalgebra::ComplexField;

/// Square root.
pub(crate) fn sqrt(value: f64) -> f64 {
    ComplexField::sqrt(value)
}

/// Length of a horizontal vector.
pub(crate) fn hypot([x, y]: [f64; 2]) -> f64 {
    sqrt(x * x + y * y)
}

/// Sine and cosine of an angle, rad.
pub(crate) fn sin_cos(angle_rad: f64) -> (f64, f64) {
    ComplexField::sin_cos(angle_rad)
}

/// Angle of a cosine, rad.
pub(crate) fn acos(cosine: f64) -> f64 {
    ComplexField::acos(cosine)
}

/// e to a power; infinite where that is too large.
pub(crate) fn exp(power: f64) -> f64 {
    ComplexField::exp(power)
}

/// Natural logarithm.
pub(crate) fn ln(value: f64) -> f64 {
    ComplexField::ln(value)
}
