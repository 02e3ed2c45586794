//! Static properties of each effect: names, parameters, places, and the smallest size of interest.

use super::{Effect, PARAMETERS_MAX, Parameter, Place, body, load, plate, plate_lowpass, suit};
use crate::body::{Segment, Side};

const fn on(segment: Segment) -> Place {
    Place::Segment(segment)
}

const WHOLE: &[Place] = &[Place::Whole];
const HAND_LOAD: &[Place] = &[Place::Hand(Side::Right), Place::Hand(Side::Left), Place::BothHands];
const HAND_CONTACT: &[Place] = &[Place::Hand(Side::Right), Place::Hand(Side::Left)];
/// Places of worn masses and of body changes.
const BODY: &[Place] = &[
    on(Segment::Pelvis),
    on(Segment::T8),
    on(Segment::Head),
    on(Segment::RightUpperArm),
    on(Segment::LeftUpperArm),
    on(Segment::RightForearm),
    on(Segment::LeftForearm),
    on(Segment::RightUpperLeg),
    on(Segment::LeftUpperLeg),
    on(Segment::RightLowerLeg),
    on(Segment::LeftLowerLeg),
];
/// Segments with a sensor whose lever arm is long enough to reveal its errors.
const SENSED: &[Place] = &[
    on(Segment::Pelvis),
    on(Segment::T8),
    on(Segment::RightUpperArm),
    on(Segment::LeftUpperArm),
    on(Segment::RightForearm),
    on(Segment::LeftForearm),
    on(Segment::RightUpperLeg),
    on(Segment::LeftUpperLeg),
    on(Segment::RightLowerLeg),
    on(Segment::LeftLowerLeg),
];

const DEGREE_RAD: f64 = core::f64::consts::PI / 180.0;
const MINUTE_S: f64 = 60.0;
/// Time in which the smallest constant drift of interest accumulates the smallest offset of interest, 4 mm, s.
const DRIFT_S: f64 = 160.0;

impl Effect {
    /// All effects, in the order of the enumeration.
    pub const ALL: [Effect; 18] = [
        Effect::HandLoad,
        Effect::HandContact,
        Effect::WornMass,
        Effect::PlateOffset,
        Effect::PlateYaw,
        Effect::PlateGain,
        Effect::PlateCrosstalk,
        Effect::PlateHeight,
        Effect::ForceGain,
        Effect::PlateDrift,
        Effect::PlateLowpass,
        Effect::SuitLag,
        Effect::SuitHeadingDrift,
        Effect::SegmentHeading,
        Effect::SegmentMisalignment,
        Effect::Inertia,
        Effect::PeriodicSway,
        Effect::UnbalancedParameters,
    ];

    /// Name in model files, recordings and reports.
    pub const fn name(self) -> &'static str {
        match self {
            Effect::HandLoad => "hand_load",
            Effect::HandContact => "hand_contact",
            Effect::WornMass => "worn_mass",
            Effect::PlateOffset => "plate_offset",
            Effect::PlateYaw => "plate_yaw",
            Effect::PlateGain => "plate_gain",
            Effect::PlateCrosstalk => "plate_crosstalk",
            Effect::PlateHeight => "plate_height",
            Effect::ForceGain => "force_gain",
            Effect::PlateDrift => "plate_drift",
            Effect::PlateLowpass => "plate_lowpass",
            Effect::SuitLag => "suit_lag",
            Effect::SuitHeadingDrift => "suit_heading_drift",
            Effect::SegmentHeading => "segment_heading",
            Effect::SegmentMisalignment => "segment_misalignment",
            Effect::Inertia => "inertia",
            Effect::PeriodicSway => "periodic_sway",
            Effect::UnbalancedParameters => "unbalanced_parameters",
        }
    }

    /// The effect of that name.
    pub fn from_name(name: &str) -> Option<Effect> {
        Effect::ALL.into_iter().find(|effect| effect.name() == name)
    }

    /// Its parameters in the order of columns and [`super::Term::value`]; for a drift, those of a constant drift.
    pub const fn parameters(self) -> &'static [Parameter] {
        match self {
            Effect::HandLoad => &load::HAND_LOAD,
            Effect::HandContact => &load::HAND_CONTACT,
            Effect::WornMass => &load::WORN_MASS,
            Effect::PlateOffset => &plate::OFFSET,
            Effect::PlateYaw => &plate::YAW,
            Effect::PlateGain => &plate::GAIN,
            Effect::PlateCrosstalk => &plate::CROSSTALK,
            Effect::PlateHeight => &plate::HEIGHT,
            Effect::ForceGain => &plate::FORCE_GAIN,
            Effect::PlateDrift => &plate::DRIFT,
            Effect::PlateLowpass => &plate_lowpass::PARAMETERS,
            Effect::SuitLag => &suit::LAG,
            Effect::SuitHeadingDrift => &suit::HEADING_DRIFT,
            Effect::SegmentHeading => &suit::SEGMENT_HEADING,
            Effect::SegmentMisalignment => &suit::SEGMENT_MISALIGNMENT,
            Effect::Inertia => &body::INERTIA,
            Effect::PeriodicSway => &body::PERIODIC_SWAY,
            Effect::UnbalancedParameters => &body::UNBALANCED_PARAMETERS,
        }
    }

    /// Its parameters for a shape ([`super::Term::shape`]): the parameters of a drift with a time constant are its end
    /// point.
    pub fn parameters_of(self, shape: f64) -> &'static [Parameter] {
        if self == Effect::PlateDrift && shape > 0.0 { &plate::ENDING_DRIFT } else { self.parameters() }
    }

    /// Whether it grows with time without a bound: outside its recording its size is unknown.
    pub fn grows_without_bound(self, shape: f64) -> bool {
        self == Effect::SuitHeadingDrift || (self == Effect::PlateDrift && shape == 0.0)
    }

    /// Name with unit of the nonlinear parameter ([`super::Term::shape`]); `None` if all parameters are linear. For the
    /// lag and the low pass it is the parameter itself.
    pub const fn shape_name(self) -> Option<&'static str> {
        match self {
            Effect::PlateDrift | Effect::SuitLag => Some("tau_s"),
            Effect::PlateLowpass => Some("cutoff_hz"),
            Effect::PeriodicSway => Some("hz"),
            _ => None,
        }
    }

    /// Prior 1-σ of its parameters at a place, in their units. The prior of a first moment is the prior mass times
    /// [`Effect::arm_sigma_m`].
    pub fn prior_sigma(self, place: Place, shape: f64) -> [f64; PARAMETERS_MAX] {
        let mut sigma = [0.0; PARAMETERS_MAX];
        for (sigma, parameter) in sigma.iter_mut().zip(self.parameters_of(shape)) {
            *sigma = parameter.prior_sigma;
        }
        match (self, place) {
            (Effect::HandLoad, Place::BothHands) => sigma[0] = load::BOTH_HANDS_SIGMA_KG,
            (Effect::WornMass, Place::Segment(segment)) => {
                let mass_kg = load::worn_mass_sigma_kg(segment);
                let moment_kg_m = mass_kg * load::worn_arm_sigma_m(segment);
                sigma = [mass_kg, moment_kg_m, moment_kg_m, moment_kg_m];
            }
            _ => {}
        }
        sigma
    }

    /// 1-σ per axis of the distance of a mass's centre from the nominal position, m; `None` if the effect is no mass.
    pub fn arm_sigma_m(self, place: Place) -> Option<f64> {
        match (self, place) {
            (Effect::HandLoad, _) => Some(load::GRIP_ARM_SIGMA_M),
            (Effect::WornMass, Place::Segment(segment)) => Some(load::worn_arm_sigma_m(segment)),
            _ => None,
        }
    }

    /// Places that are tested.
    pub const fn places(self) -> &'static [Place] {
        match self {
            Effect::HandLoad => HAND_LOAD,
            Effect::HandContact => HAND_CONTACT,
            Effect::WornMass | Effect::UnbalancedParameters => BODY,
            Effect::SegmentHeading | Effect::SegmentMisalignment => SENSED,
            _ => WHOLE,
        }
    }

    /// Whether the effect can act at a place: any segment is accepted if [`Effect::places`] lists segments.
    pub fn accepts(self, place: Place) -> bool {
        let any_segment = matches!(self.places(), [Place::Segment(_), ..]);
        self.places().contains(&place) || (any_segment && matches!(place, Place::Segment(_)))
    }

    /// Below this [`Effect::size`] an effect is irrelevant, and noise often resembles it: kg of a mass, N of a contact,
    /// m of an offset, of a height, of a sway, of a changed φ and of a drift's end, rad of a rotation, rad/s of a
    /// rotating suit, 1 of gains and of a fraction of the inertia, s of a lag and of a filter's time constant; m/s of a
    /// constant drift.
    pub fn smallest_of_interest(self) -> f64 {
        match self {
            Effect::HandLoad => 0.12,
            Effect::HandContact => 4.0,
            Effect::WornMass => 0.2,
            Effect::PlateOffset | Effect::UnbalancedParameters => 0.004,
            Effect::PlateYaw => 0.6 * DEGREE_RAD,
            Effect::PlateGain | Effect::PlateCrosstalk => 0.012,
            Effect::PlateHeight => 0.020,
            Effect::ForceGain => 0.002,
            Effect::PlateDrift => 0.0015 / MINUTE_S,
            // The prototype showed 5 Hz, 32 ms, in every session.
            Effect::PlateLowpass => 0.015,
            Effect::SuitLag => 0.003,
            Effect::SuitHeadingDrift => 0.6 * DEGREE_RAD / MINUTE_S,
            Effect::SegmentHeading => 2.5 * DEGREE_RAD,
            Effect::SegmentMisalignment => 2.0 * DEGREE_RAD,
            Effect::Inertia => 0.1,
            Effect::PeriodicSway => 0.001,
        }
    }

    /// Size for these parameters, in the unit of [`Effect::smallest_of_interest`]. A drift with an end is measured by
    /// the constant drift that reaches the end in 160 s: it is of interest from 4 mm on, as an offset is.
    pub fn size(self, shape: f64, value: &[f64; PARAMETERS_MAX]) -> f64 {
        use crate::math::{hypot, sqrt};
        let [a, b, c, d] = *value;
        match self {
            Effect::HandContact | Effect::SegmentMisalignment | Effect::UnbalancedParameters => {
                sqrt(a * a + b * b + c * c)
            }
            Effect::PlateDrift if shape > 0.0 => hypot([a, b]) / DRIFT_S,
            Effect::PlateOffset | Effect::PlateGain | Effect::PlateDrift => hypot([a, b]),
            Effect::PeriodicSway => sqrt(a * a + b * b + c * c + d * d),
            Effect::PlateLowpass if a > 0.0 => 1.0 / (core::f64::consts::TAU * a),
            Effect::PlateLowpass => 0.0,
            _ => a.abs(),
        }
    }
}
