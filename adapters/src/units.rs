//! Units of force and moment that plates use, their conversion to SI, and parsing of unit names.

/// One pound of force, N: exact by definition of pound and standard gravity.
pub const NEWTON_PER_LBF: f64 = 4.448_221_615_260_5;
/// One kilogram under standard gravity, N: exact.
pub(crate) const NEWTON_PER_KGF: f64 = 9.806_65;
/// One inch, m: exact.
pub const METRE_PER_INCH: f64 = 0.0254;
/// One foot, m: exact.
pub(crate) const METRE_PER_FOOT: f64 = 12.0 * METRE_PER_INCH;

/// Unit of a force.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ForceUnit {
    /// N.
    Newton,
    /// kN.
    Kilonewton,
    /// Pound-force.
    PoundForce,
    /// Kilogram-force, the "kilogram" of scales.
    KilogramForce,
}

/// Unit of a moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MomentUnit {
    /// N m.
    NewtonMetre,
    /// N mm.
    NewtonMillimetre,
    /// kN m.
    KilonewtonMetre,
    /// Pound-force inch.
    PoundForceInch,
    /// Pound-force foot.
    PoundForceFoot,
}

impl ForceUnit {
    /// Newtons per unit.
    pub fn newtons(self) -> f64 {
        match self {
            ForceUnit::Newton => 1.0,
            ForceUnit::Kilonewton => 1e3,
            ForceUnit::PoundForce => NEWTON_PER_LBF,
            ForceUnit::KilogramForce => NEWTON_PER_KGF,
        }
    }
}

impl MomentUnit {
    /// Newton metres per unit.
    pub fn newton_metres(self) -> f64 {
        match self {
            MomentUnit::NewtonMetre => 1.0,
            MomentUnit::NewtonMillimetre => 1e-3,
            MomentUnit::KilonewtonMetre => 1e3,
            MomentUnit::PoundForceInch => NEWTON_PER_LBF * METRE_PER_INCH,
            MomentUnit::PoundForceFoot => NEWTON_PER_LBF * METRE_PER_FOOT,
        }
    }
}

/// The letters of a product of units, without separators: "N m", "N·m", "N-m" and "N*m" are equal. `None` for a
/// quotient or a power, which is a different unit with the same letters: "N/m".
pub(crate) fn letters(unit: &str) -> Option<String> {
    let is_product = !unit.chars().any(|sign| matches!(sign, '/' | '^' | '⁻') || sign.is_numeric());
    is_product.then(|| unit.chars().filter(char::is_ascii_alphabetic).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_product_is_its_letters_and_a_quotient_or_a_power_is_none() {
        for written in ["Nm", "N m", "N·m", "N.m", "N-m", "N*m", "N\u{fffd}m", "N_m", "N×m"] {
            assert_eq!(letters(written).as_deref(), Some("Nm"), "{written}");
        }
        for other in ["N/m", "N / m", "N/m²", "Nm²", "N^m", "Nm^2", "Nm⁻¹", "N m2", "Nm-1"] {
            assert_eq!(letters(other), None, "{other}");
        }
    }
}
