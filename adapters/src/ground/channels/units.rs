//! Units of force and moment that plates use.

use crate::units::{METRE_PER_FOOT, METRE_PER_INCH, NEWTON_PER_KGF, NEWTON_PER_LBF};

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
