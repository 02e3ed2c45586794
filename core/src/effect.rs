//! The physical effects that a model of worker, suit and plate may lack, known by name.
//!
//! An effect is a change of what the plate is predicted to measure: some columns, each per unit of one parameter, on the
//! centre of pressure and on the ground's force. `columns` says what they are at one moment; the workflow that looks
//! for a missing effect fits them, and the loop adds the very same columns times the fitted parameters to what it
//! predicts ([`Model`]). Prediction plus columns times parameters is what is measured.
//!
//! One file per effect; this file is the table of all. Two effects are more than columns of a moment: `suit_lag`
//! shifts the suit's time, `plate_lowpass` filters the prediction; both have their own functions.

use crate::body::{SEGMENTS, Segment, Side};

/// Most parameters that an effect has.
pub const PARAMETERS_MAX: usize = 4;
/// Most terms in a model.
pub const TERMS_MAX: usize = 8;

/// An effect, by name. The names are a contract: model files, recordings and reports bear them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Effect {
    /// A mass in a hand or in both: `mass_kg`, and its first moment about the grip in the hand's axes, kg m.
    HandLoad,
    /// A hand leans on something or is held up: force on the body, N.
    HandContact,
    /// A mass worn on a segment: `mass_kg`, and its first moment about the segment's centre in its axes, kg m.
    WornMass,
    /// The plate lies elsewhere: `dx_m`, `dy_m`.
    PlateOffset,
    /// The plate is turned: rad, left positive.
    PlateYaw,
    /// The centre of pressure is stretched: `kx`, `ky`.
    PlateGain,
    /// Each axis of the centre of pressure sees a share `k` of the other.
    PlateCrosstalk,
    /// The surface lies `dz_m` higher above the sensor than was configured.
    PlateHeight,
    /// The vertical force is stretched: `k`.
    ForceGain,
    /// The centre of pressure drifts: `vx_m_per_s`, `vy_m_per_s`; or, with a time constant, towards `ax_m`, `ay_m`.
    PlateDrift,
    /// The plate's filter: first order, `cutoff_hz`.
    PlateLowpass,
    /// The suit is later than the ground: `tau_s`, positive where it is.
    SuitLag,
    /// The whole suit turns about the upright: rad/s.
    SuitHeadingDrift,
    /// One segment is turned about the upright: rad. Magnetic disturbance.
    SegmentHeading,
    /// One segment's sensor sits crooked: rotation vector in the segment's axes, rad.
    SegmentMisalignment,
    /// The body's inertia, for models run without it: share of it that is missing.
    Inertia,
    /// Breath or sway: sine and cosine amplitude on each axis, m, at a frequency.
    PeriodicSway,
    /// The person is no longer the identified one: change of one segment's φ, m.
    UnbalancedParameters,
}

/// Which part of the body an effect acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// None: the plate, or the suit as a whole.
    Whole,
    /// One hand.
    Hand(Side),
    /// Both hands alike.
    BothHands,
    /// One segment.
    Segment(Segment),
}

/// One parameter of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Name with unit, as in model files: `mass_kg`.
    pub name: &'static str,
    /// Unit for people.
    pub unit: &'static str,
    /// 1-σ of what is believed of it before any data.
    pub prior_sigma: f64,
}

/// Everything of one moment that an effect's columns are made of. Station's world: X forward, Y left, Z up.
#[derive(Debug, Clone, Copy)]
pub struct Observation {
    /// Time since the station's first moment (the recording's begin), s.
    pub time_s: f64,
    /// Body mass, kg.
    pub mass_kg: f64,
    /// Height of the walking surface, m.
    pub floor_m: f64,
    /// Middle between the standing feet, m.
    pub feet_m: [f64; 2],
    /// Segment origins, m, and their second derivatives, m/s².
    pub origin_m: [[f64; 3]; SEGMENTS],
    /// Second derivative of each, m/s².
    pub origin_acceleration_m_per_s2: [[f64; 3]; SEGMENTS],
    /// `world_from_segment` as matrices, row by row.
    pub rotation: [[[f64; 3]; 3]; SEGMENTS],
    /// Second derivative of each matrix, 1/s².
    pub rotation_acceleration_per_s2: [[[f64; 3]; 3]; SEGMENTS],
    /// The chain's parameters φ, segment axes, m.
    pub phi_m: [[f64; 3]; SEGMENTS],
    /// Where the hands grip, from each hand's origin in its axes, m: left, right ([`Side::BOTH`]).
    pub grip_m: [[f64; 3]; 2],
    /// Centres of mass of the segments by the table, segment axes, m.
    pub centre_m: [[f64; 3]; SEGMENTS],
    /// Centre of mass by the chain, m.
    pub com_m: [f64; 3],
    /// Its acceleration by the suit, m/s².
    pub com_acceleration_m_per_s2: [f64; 3],
    /// Shift of the predicted centre of pressure by the turning of the body, m.
    pub turning_m: [f64; 2],
    /// Horizontal over vertical force, as it entered the prediction: measured shear where there is one, else the suit's.
    pub slope: [f64; 2],
    /// Whether `slope` is measured.
    pub slope_is_measured: bool,
    /// Centre of pressure that the model predicts without any term, m.
    pub cop_predicted_m: [f64; 2],
    /// Force of the ground on the body that the model predicts by the suit's motion without any term, N.
    pub force_predicted_n: [f64; 3],
    /// Measured centre of pressure, m.
    pub cop_measured_m: [f64; 2],
    /// Measured force on the body, N.
    pub force_measured_n: [f64; 3],
}

/// What each parameter of an effect changes of the prediction at one moment, per unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Columns {
    /// How many parameters there are; the rest is zero.
    pub count: usize,
    /// Of the centre of pressure, m per unit.
    pub cop_m: [[f64; 2]; PARAMETERS_MAX],
    /// Of the ground's force on the body, N per unit.
    pub force_n: [[f64; 3]; PARAMETERS_MAX],
}

impl Columns {
    /// Nothing, for so many parameters.
    pub const fn zero(count: usize) -> Columns {
        Columns { count, cop_m: [[0.0; 2]; PARAMETERS_MAX], force_n: [[0.0; 3]; PARAMETERS_MAX] }
    }
}

/// One term of a model: an effect, where it acts, how strong it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Term {
    /// Which effect.
    pub effect: Effect,
    /// Where.
    pub place: Place,
    /// What is not linear: time constant (s) of a drift, 0 for a linear one; cutoff (Hz) of a low pass; lag (s);
    /// frequency (Hz) of a sway; else 0.
    pub shape: f64,
    /// The parameters, in the order and units of [`Effect::parameters`].
    pub value: [f64; PARAMETERS_MAX],
    /// From when to when it holds, s since the station's first moment.
    pub span_s: [f64; 2],
}

/// What a model has beside the body: at most [`TERMS_MAX`] terms.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Model {
    /// The terms.
    pub terms: [Option<Term>; TERMS_MAX],
}
