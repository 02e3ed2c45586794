//! Elementary functions without the standard library, and a hash.

use nalgebra::ComplexField;

/// FNV-1a of words.
pub(crate) fn hash(words: impl Iterator<Item = u64>) -> u64 {
    words.fold(0xcbf2_9ce4_8422_2325, |hash, word| (hash ^ word).wrapping_mul(0x0100_0000_01b3))
}

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

/// Angle of a vector with these components, rad.
pub(crate) fn atan2(y: f64, x: f64) -> f64 {
    nalgebra::RealField::atan2(y, x)
}

/// The same angle in (−π, π], rad.
pub(crate) fn wrapped(angle_rad: f64) -> f64 {
    let (sin, cos) = sin_cos(angle_rad);
    atan2(sin, cos)
}

/// e to a power; infinite where that is too large.
pub(crate) fn exp(power: f64) -> f64 {
    ComplexField::exp(power)
}

/// Natural logarithm.
pub(crate) fn ln(value: f64) -> f64 {
    ComplexField::ln(value)
}
