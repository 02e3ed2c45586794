//! The physical effects that a model of worker, suit and plate may lack, known by name.
//!
//! An effect is a change of what the plate is predicted to measure: some columns, each per unit of one parameter, on the
//! centre of pressure and on the ground's force. `columns` says what they are at one moment; the workflow that looks
//! for a missing effect fits them, and the loop adds the very same columns times the fitted parameters to what it
//! predicts ([`Model`]). Prediction plus columns times parameters is what is measured.
//!
//! One file per effect; this file is the table of all. Two effects are more than columns of a moment: [`suit_lag`]
//! shifts the suit's time, [`plate_lowpass`] filters the prediction; both have their own functions.
//!
//! Signs. What is worn or leans on the body counts as it acts on the body. The plate's parameters say how its readings
//! differ from the truth, so their columns are added as they are. The suit's parameters say how what it shows differs
//! from the truth, so their columns undo it: a segment whose heading is read `ψ` too far left has its arm turned back.

mod catalogue;
mod families;
mod force_gain;
mod geometry;
mod hand_contact;
mod hand_load;
mod inertia;
mod mass;
mod periodic_sway;
mod plate_crosstalk;
mod plate_drift;
mod plate_gain;
mod plate_height;
pub mod plate_lowpass;
mod plate_offset;
mod plate_yaw;
mod reoriented;
mod segment_heading;
mod segment_misalignment;
mod suit_heading_drift;
pub mod suit_lag;
#[cfg(test)]
mod tests;
mod unbalanced_parameters;
mod worn_mass;

use geometry::Column;

use crate::body::{SEGMENTS, Segment, Side};
use crate::message::ground::COP_MIN_VERTICAL_N;

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
    /// Time since the station's first moment (the recording's begin), s. Drifts and sways count from its zero:
    /// [`Term::columns`] counts from where the term's span begins.
    pub time_s: f64,
    /// Body mass, kg.
    pub mass_kg: f64,
    /// Height of the walking surface, m.
    pub floor_m: f64,
    /// Middle between the standing feet, m.
    pub feet_m: [f64; 2],
    /// Whether the standing feet hold the body in its place, as they do where the suit's position drifts: an error of a
    /// leg's orientation then carries all that stands on it along.
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
    /// Where the hands grip, from each hand's origin in its axes, m: left, right ([`Side::BOTH`]).
    pub grip_m: [[f64; 3]; 2],
    /// Centres of mass of the segments by the table, segment axes, m.
    pub centre_m: [[f64; 3]; SEGMENTS],
    /// Share of the body mass in each segment by the table; all zero where the model leaves out that the body turns.
    pub mass_share: [f64; SEGMENTS],
    /// Centre of mass by the chain, m.
    pub com_m: [f64; 3],
    /// Its acceleration by the suit, m/s².
    pub com_acceleration_m_per_s2: [f64; 3],
    /// Shift of the predicted centre of pressure by the turning of the body, m.
    pub turning_m: [f64; 2],
    /// Horizontal over vertical force, as it entered the prediction: measured shear where there is one, over the
    /// vertical force that the body alone needs by the suit (`force_predicted_n[2]`, not the measured one: that already
    /// bears what the model may lack); else the suit's acceleration over the same.
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

    /// These, one a parameter; at most [`PARAMETERS_MAX`].
    fn of(columns: &[Column]) -> Columns {
        let mut all = Columns::zero(columns.len().min(PARAMETERS_MAX));
        for (index, column) in columns.iter().take(PARAMETERS_MAX).enumerate() {
            all.cop_m[index] = column.cop_m;
            all.force_n[index] = column.force_n;
        }
        all
    }

    /// What parameters of these values change: of the centre of pressure, m, and of the force, N.
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

/// The columns of an effect at one moment; nothing while nobody stands on the plate, at a place where the effect cannot
/// be, and for the two effects that are no columns ([`suit_lag`], [`plate_lowpass`]).
///
/// `shape` is [`Term::shape`]. What grows with time counts from `observation.time_s` = 0. Turns are small ones.
pub fn columns(effect: Effect, place: Place, shape: f64, observation: &Observation) -> Columns {
    columns_about(effect, place, shape, &[0.0; PARAMETERS_MAX], observation)
}

/// Columns of a small misalignment of any segment, also of those of which the catalogue has none: there it is noise.
pub fn misaligned(segment: Segment, observation: &Observation) -> Columns {
    segment_misalignment::columns(Place::Segment(segment), [0.0; 3], observation)
}

/// How far the predicted centre of mass follows a turn of one segment: a small turn ε of it, world axes, moves the centre by
/// `ε × arm`, m.
pub fn arm_m(segment: Segment, observation: &Observation) -> [f64; 3] {
    observation.arm(segment).at
}

/// As [`columns`], with large turns as they are: columns × `about` is then exact, and what is near it nearly so.
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
        Effect::HandLoad => hand_load::columns(place, o),
        Effect::HandContact => hand_contact::columns(place, o),
        Effect::WornMass => worn_mass::columns(place, o),
        Effect::PlateOffset => plate_offset::columns(),
        Effect::PlateYaw => plate_yaw::columns(o),
        Effect::PlateGain => plate_gain::columns(o),
        Effect::PlateCrosstalk => plate_crosstalk::columns(o),
        Effect::PlateHeight => plate_height::columns(o),
        Effect::ForceGain => force_gain::columns(o),
        Effect::PlateDrift => plate_drift::columns(shape, o),
        Effect::PlateLowpass | Effect::SuitLag => none,
        Effect::SuitHeadingDrift => suit_heading_drift::columns(o),
        Effect::SegmentHeading => segment_heading::columns(place, about[0], o),
        Effect::SegmentMisalignment => {
            segment_misalignment::columns(place, [about[0], about[1], about[2]], o)
        }
        Effect::Inertia => inertia::columns(o),
        Effect::PeriodicSway => periodic_sway::columns(shape, o),
        Effect::UnbalancedParameters => unbalanced_parameters::columns(place, o),
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
    /// From when to when it holds, s since the station's first moment; the end may be infinite.
    pub span_s: [f64; 2],
}

impl Term {
    /// Whether it holds at a time, s since the station's first moment.
    pub fn holds_at(&self, time_s: f64) -> bool {
        (self.span_s[0]..self.span_s[1]).contains(&time_s)
    }

    /// Its columns at a moment, drifts and sways counted from where its span begins, turns as large as they are; nothing
    /// outside the span.
    pub fn columns(&self, observation: &Observation) -> Columns {
        if !self.holds_at(observation.time_s) {
            return Columns::zero(self.effect.parameters().len());
        }
        let since = Observation { time_s: observation.time_s - self.span_s[0], ..*observation };
        columns_about(self.effect, self.place, self.shape, &self.value, &since)
    }
}

/// What a model has beside the body: at most [`TERMS_MAX`] terms.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Model {
    /// The terms.
    pub terms: [Option<Term>; TERMS_MAX],
}

impl Model {
    /// Whether it has no term.
    pub fn is_empty(&self) -> bool {
        self.terms.iter().all(Option::is_none)
    }

    /// The terms that hold at a time, s since the station's first moment.
    pub fn at(&self, time_s: f64) -> impl Iterator<Item = &Term> {
        self.terms.iter().flatten().filter(move |term| term.holds_at(time_s))
    }

    /// What all terms together change at a moment: of the centre of pressure, m, and of the force, N.
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
