//! Physical effects that the model of subject, suit and plate may lack, identified by name.
//!
//! An effect changes the predicted measurement of the plate: it consists of columns, each the change of the CoP and of
//! the ground's force per unit of one parameter. `columns` returns them for one instant; the search for missing effects
//! fits them, and the loop adds the same columns, times the fitted parameters, to its prediction ([`Model`]):
//! measurement = prediction + columns · parameters.
//!
//! One file per subject (`load`, `plate`, `suit`, `body`); this file contains the table of all. Two effects are not
//! columns of an instant: `suit_lag` shifts the suit's time, [`plate_lowpass`] filters the prediction; both have their
//! own functions.
//!
//! Signs. Worn masses and contacts count as they act on the body. The plate's parameters are the deviation of its
//! readings from the truth, so their columns are added as they are. The suit's parameters are the deviation of its
//! output from the truth, so their columns reverse it: for a segment whose measured heading is `ψ` too far left, the
//! arm is rotated back.

mod body;
mod catalogue;
mod families;
mod geometry;
mod load;
mod plate;
pub mod plate_lowpass;
mod suit;
#[cfg(test)]
mod tests;

pub(crate) use suit::without_lag_ns;

use geometry::Column;

use crate::body::{SEGMENTS, Segment, Side};
use crate::math;
use crate::message::ground::COP_MIN_VERTICAL_N;

/// Maximum number of parameters of an effect.
pub const PARAMETERS_MAX: usize = 4;
/// Maximum number of terms in a model.
pub const TERMS_MAX: usize = 8;

/// An effect. The names are a stable interface: model files, recordings and reports contain them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Effect {
    /// A mass in one hand or both: `mass_kg`, and its first moment about the grip in the hand's axes, kg m.
    HandLoad,
    /// A hand leans on something or is supported: force on the body, N.
    HandContact,
    /// A mass worn on a segment: `mass_kg`, and its first moment about the segment's centre in its axes, kg m.
    WornMass,
    /// Shift of the plate: `dx_m`, `dy_m`.
    PlateOffset,
    /// Rotation of the plate: rad, left positive.
    PlateYaw,
    /// Gain error of the CoP: `kx`, `ky`.
    PlateGain,
    /// Crosstalk: each axis of the CoP contains a fraction `k` of the other.
    PlateCrosstalk,
    /// Height of the surface above the sensor, relative to the configured one: `dz_m`.
    PlateHeight,
    /// Gain error of the vertical force: `k`.
    ForceGain,
    /// Drift of the CoP: `vx_m_per_s`, `vy_m_per_s`; or, with a time constant, towards `ax_m`, `ay_m`.
    PlateDrift,
    /// Low pass of the plate: first order, `cutoff_hz`.
    PlateLowpass,
    /// Lag of the suit relative to the ground: `tau_s`, positive if the suit is later.
    SuitLag,
    /// Rotation rate of the whole suit about the vertical: rad/s.
    SuitHeadingDrift,
    /// Rotation of one segment about the vertical: rad. Magnetic disturbance.
    SegmentHeading,
    /// Misalignment of one segment's sensor: rotation vector in the segment's axes, rad.
    SegmentMisalignment,
    /// Missing fraction of the body's inertia, for models that omit it.
    Inertia,
    /// Breathing or sway: sine and cosine amplitude on each axis, m, at a frequency.
    PeriodicSway,
    /// Deviation from the identified subject: change of one segment's φ, m.
    UnbalancedParameters,
}

/// Part of the body on which an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// None: the plate, or the suit as a whole.
    Whole,
    /// One hand.
    Hand(Side),
    /// Both hands equally.
    BothHands,
    /// One segment.
    Segment(Segment),
}

/// One parameter of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Name with unit, as in model files: `mass_kg`.
    pub name: &'static str,
    /// Unit for display.
    pub unit: &'static str,
    /// 1-σ of its prior.
    pub prior_sigma: f64,
}

/// Data of one instant from which an effect's columns are computed. Station world: X forward, Y left, Z up.
#[derive(Debug, Clone, Copy)]
pub struct Observation {
    /// Time since the origin of the spans ([`Model::origin_ns`]), s. Drifts and sways start at time zero:
    /// [`Term::columns`] subtracts the start of the term's span.
    pub time_s: f64,
    /// Body mass, kg.
    pub mass_kg: f64,
    /// Height of the walking surface, m.
    pub floor_m: f64,
    /// Middle between the standing feet, m.
    pub feet_m: [f64; 2],
    /// Whether the anchor holds the standing feet, as it does if the suit's position drifts: an error of a leg's
    /// orientation then displaces all segments above it.
    pub feet_hold: bool,
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
    /// Grip points, from each hand's origin in its axes, m: left, right ([`Side::BOTH`]).
    pub grip_m: [[f64; 3]; 2],
    /// Centres of mass of the segments by the table, segment axes, m.
    pub centre_m: [[f64; 3]; SEGMENTS],
    /// Fraction of the body mass in each segment by the table; all zero if the model omits the rotation of the body.
    pub mass_fraction: [f64; SEGMENTS],
    /// CoM by the chain, m.
    pub com_m: [f64; 3],
    /// Its acceleration by the suit, m/s².
    pub com_acceleration_m_per_s2: [f64; 3],
    /// Shift of the predicted CoP by the rotation of the body, m.
    pub turning_m: [f64; 2],
    /// Horizontal over vertical force, as used in the prediction: measured shear if available, over the vertical force
    /// that the body alone requires by the suit (`force_predicted_n[2]`, not the measured one, which already contains
    /// effects that the model may lack); else the suit's acceleration over the same.
    pub slope: [f64; 2],
    /// Whether `slope` is measured.
    pub slope_is_measured: bool,
    /// CoP that the model predicts without any term, m.
    pub cop_predicted_m: [f64; 2],
    /// Ground force on the body that the model predicts from the suit's motion without any term, N.
    pub force_predicted_n: [f64; 3],
    /// Measured CoP, m.
    pub cop_measured_m: [f64; 2],
    /// Measured force on the body, N.
    pub force_measured_n: [f64; 3],
}

/// Change of the prediction at one instant by each parameter of an effect, per unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Columns {
    /// Number of parameters; the remaining columns are zero.
    pub count: usize,
    /// Change of the CoP, m per unit.
    pub cop_m: [[f64; 2]; PARAMETERS_MAX],
    /// Change of the ground's force on the body, N per unit.
    pub force_n: [[f64; 3]; PARAMETERS_MAX],
}

impl Columns {
    /// Zero columns for this number of parameters.
    pub const fn zero(count: usize) -> Columns {
        Columns { count, cop_m: [[0.0; 2]; PARAMETERS_MAX], force_n: [[0.0; 3]; PARAMETERS_MAX] }
    }

    /// Collects one column per parameter; at most [`PARAMETERS_MAX`].
    fn of(columns: &[Column]) -> Columns {
        let mut all = Columns::zero(columns.len().min(PARAMETERS_MAX));
        for (index, column) in columns.iter().take(PARAMETERS_MAX).enumerate() {
            all.cop_m[index] = column.cop_m;
            all.force_n[index] = column.force_n;
        }
        all
    }

    /// Columns times parameter values: change of the CoP, m, and of the force, N.
    pub fn times(&self, value: &[f64; PARAMETERS_MAX]) -> ([f64; 2], [f64; 3]) {
        let (mut cop_m, mut force_n) = ([0.0; 2], [0.0; 3]);
        for (index, value) in value.iter().enumerate().take(self.count) {
            for (sum, part) in cop_m.iter_mut().zip(self.cop_m[index]) {
                *sum += value * part;
            }
            for (sum, part) in force_n.iter_mut().zip(self.force_n[index]) {
                *sum += value * part;
            }
        }
        (cop_m, force_n)
    }
}

/// Columns of an effect at one instant; zero if nothing stands on the plate, if the effect does not accept the place,
/// and for the two effects without columns (`suit_lag`, [`plate_lowpass`]).
///
/// `shape` is [`Term::shape`]. Effects that grow with time start at `observation.time_s` = 0. Rotations are linearised
/// for small angles.
pub fn columns(effect: Effect, place: Place, shape: f64, observation: &Observation) -> Columns {
    columns_about(effect, place, shape, &[0.0; PARAMETERS_MAX], observation)
}

/// Columns of a small misalignment of any segment, including those not in the catalogue, where it counts as noise.
pub fn misaligned(segment: Segment, observation: &Observation) -> Columns {
    suit::segment_misalignment(Place::Segment(segment), [0.0; 3], observation)
}

/// As [`misaligned`] for a misalignment times a time-dependent factor, such as soft tissue that moves with a joint.
///
/// `turned`: the factor (1) times `world_from_segment`, row by row; `acceleration`: its second derivative, 1/s².
pub fn misaligned_by_factor(
    segment: Segment,
    turned: &[[f64; 3]; 3],
    acceleration: &[[f64; 3]; 3],
    observation: &Observation,
) -> Columns {
    suit::varying_misalignment(segment, [turned, acceleration], observation)
}

/// Lever arm of a segment's rotation: a small rotation ε, world axes, moves the predicted CoM by `ε × arm`, m.
pub fn arm_m(segment: Segment, observation: &Observation) -> [f64; 3] {
    observation.arm(segment).at
}

/// As [`columns`], linearised about large rotations: columns × `about` is exact, and nearby parameters are
/// approximately so.
fn columns_about(
    effect: Effect,
    place: Place,
    shape: f64,
    about: &[f64; PARAMETERS_MAX],
    o: &Observation,
) -> Columns {
    let none = Columns::zero(effect.parameters().len());
    let stands = o.force_measured_n[2] >= COP_MIN_VERTICAL_N && o.force_predicted_n[2] >= COP_MIN_VERTICAL_N;
    if !stands || !effect.accepts(place) {
        return none;
    }
    match effect {
        Effect::HandLoad => load::hand_load(place, o),
        Effect::HandContact => load::hand_contact(place, o),
        Effect::WornMass => load::worn_mass(place, o),
        Effect::PlateOffset => plate::offset(),
        Effect::PlateYaw => plate::yaw(o),
        Effect::PlateGain => plate::cop_gain(o),
        Effect::PlateCrosstalk => plate::crosstalk(o),
        Effect::PlateHeight => plate::height(o),
        Effect::ForceGain => plate::force_gain(o),
        Effect::PlateDrift => plate::drift(shape, o),
        Effect::PlateLowpass | Effect::SuitLag => none,
        Effect::SuitHeadingDrift => suit::heading_drift(o),
        Effect::SegmentHeading => suit::segment_heading(place, about[0], o),
        Effect::SegmentMisalignment => suit::segment_misalignment(place, [about[0], about[1], about[2]], o),
        Effect::Inertia => body::inertia(o),
        Effect::PeriodicSway => body::periodic_sway(shape, o),
        Effect::UnbalancedParameters => body::unbalanced_parameters(place, o),
    }
}

/// One term of a model: an effect, its place and its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Term {
    /// Which effect.
    pub effect: Effect,
    /// Place on the body.
    pub place: Place,
    /// Nonlinear parameter: time constant (s) of a drift, 0 for a linear one; cutoff (Hz) of a low pass; lag (s);
    /// frequency (Hz) of a sway; else 0.
    pub shape: f64,
    /// The parameters, in the order and units of [`Effect::parameters`].
    pub value: [f64; PARAMETERS_MAX],
    /// Interval in which it applies, s since [`Model::origin_ns`]; the end may be infinite.
    pub span_s: [f64; 2],
}

impl Term {
    /// Whether it applies at a time, s since [`Model::origin_ns`].
    pub fn applies_at(&self, time_s: f64) -> bool {
        (self.span_s[0]..self.span_s[1]).contains(&time_s)
    }

    /// Its columns at an instant, drifts and sways relative to the start of its span, rotations at their full size;
    /// zero outside the span.
    pub fn columns(&self, observation: &Observation) -> Columns {
        if !self.applies_at(observation.time_s) {
            return Columns::zero(self.effect.parameters().len());
        }
        let since = Observation { time_s: observation.time_s - self.span_s[0], ..*observation };
        columns_about(self.effect, self.place, self.shape, &self.value, &since)
    }
}

/// Model terms besides the body: at most [`TERMS_MAX`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Model {
    /// The terms.
    pub terms: [Option<Term>; TERMS_MAX],
    /// Time zero of the spans, CLOCK_MONOTONIC ns: the start of the recording in which they were found; `None`: the
    /// station's first snapshot.
    pub origin_ns: Option<u64>,
}

impl Model {
    /// Whether it has no term.
    pub fn is_empty(&self) -> bool {
        self.terms.iter().all(Option::is_none)
    }

    /// Hash of its terms, to detect another model.
    pub fn fingerprint(&self) -> u64 {
        math::hash(self.terms.iter().flatten().flat_map(|term| {
            let place = match term.place {
                Place::Whole => 0,
                Place::BothHands => 1,
                Place::Hand(side) => 2 + side as u64,
                Place::Segment(segment) => 4 + segment.index() as u64,
            };
            let numbers = term.value.into_iter().chain(term.span_s).chain([term.shape]);
            [term.effect as u64, place].into_iter().chain(numbers.map(f64::to_bits))
        }))
    }

    /// The terms that apply at a time, s since the origin of the spans.
    pub fn at(&self, time_s: f64) -> impl Iterator<Item = &Term> {
        self.terms.iter().flatten().filter(move |term| term.applies_at(time_s))
    }

    /// Total change by all terms at an instant: of the CoP, m, and of the force, N.
    pub fn change(&self, observation: &Observation) -> ([f64; 2], [f64; 3]) {
        let (mut cop_m, mut force_n) = ([0.0; 2], [0.0; 3]);
        for term in self.terms.iter().flatten() {
            let (cop, force) = term.columns(observation).times(&term.value);
            for (sum, part) in cop_m.iter_mut().zip(cop) {
                *sum += part;
            }
            for (sum, part) in force_n.iter_mut().zip(force) {
                *sum += part;
            }
        }
        (cop_m, force_n)
    }
}
