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
