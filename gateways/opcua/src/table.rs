//! The variables of a station, each declared once; address space, values and the table of docs/consumers/opcua.md
//! derive from this declaration.

use equipoise_client::Reading;
use equipoise_core::body::Joint;
use equipoise_core::message::state::Phase;
use equipoise_core::message::{State, Validity};
use equipoise_core::overload::Level;
use opcua::types::{DataTypeId, Variant};

/// Time that a value refers to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum About {
    /// The cycle of the state (`State::time_ns`).
    Cycle,
    /// The sample time of the results (`State::suit_sample_time_ns`), tens of milliseconds before the cycle.
    Sample,
}

/// Type of a variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Type {
    /// True or false.
    Boolean,
    /// A count or a bit set.
    UInt64,
    /// Text.
    Text,
    /// List of texts.
    Texts,
    /// One number.
    Double,
    /// Array of this many numbers.
    Doubles(u32),
    /// Enumeration: UInt32, as MultiStateDiscreteType with EnumStrings.
    State(&'static [&'static str]),
}

impl Type {
    /// The standard's data type.
    pub fn data_type(self) -> DataTypeId {
        match self {
            Type::Boolean => DataTypeId::Boolean,
            Type::UInt64 => DataTypeId::UInt64,
            Type::Text | Type::Texts => DataTypeId::String,
            Type::Double | Type::Doubles(_) => DataTypeId::Double,
            Type::State(_) => DataTypeId::UInt32,
        }
    }
}

/// A unit of UNECE Recommendation 20, as OPC UA Part 8 refers to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unit {
    /// Common code of the recommendation.
    pub code: &'static str,
    /// Symbol.
    pub symbol: &'static str,
    /// Name.
    pub name: &'static str,
}

const NEWTON_METRE: Unit = Unit { code: "NU", symbol: "N·m", name: "newton metre" };
const NEWTON: Unit = Unit { code: "NEW", symbol: "N", name: "newton" };
const KILOGRAM: Unit = Unit { code: "KGM", symbol: "kg", name: "kilogram" };
const NANOSECOND: Unit = Unit { code: "C47", symbol: "ns", name: "nanosecond" };

impl Unit {
    /// `unitId` of EUInformation: the letters of the common code as one number.
    pub fn id(&self) -> i32 {
        self.code.bytes().fold(0, |id, letter| (id << 8) | i32::from(letter))
    }
}

/// One variable of the station or of each joint.
pub struct Row {
    /// Browse name, and last part of the node ID.
    pub name: &'static str,
    /// Type.
    pub of: Type,
    /// Unit; `None` if the variable has none.
    pub unit: Option<Unit>,
    /// Time that the value refers to.
    pub about: About,
    /// Validity flags that invalidate the value.
    pub invalidating: Validity,
    /// Description.
    pub meaning: &'static str,
    /// The value, if no flag invalidates it; rows of the station ignore the joint.
    pub value: fn(&Reading, Joint) -> Option<Variant>,
}

const NEVER: Validity = Validity(0);
const TORQUES: Validity = Validity::INVALIDATES_TORQUES;
const LIFTED: Validity = Validity::INVALIDATES_LIFTED_MASS;
const BACK: Validity = Validity::INVALIDATES_LOW_BACK;

/// Names of the phases, by number.
pub const PHASES: [&str; 4] = ["waiting", "identifying", "monitoring", "degraded"];
/// Names of the levels, by number.
pub const LEVELS: [&str; 6] = ["none", "green", "orange", "red", "above_max", "undecided"];

/// The station's own variables.
pub const STATION: [Row; 19] = [
    cycle("Phase", Type::State(&PHASES), None, "Phase of the station", |reading, _| {
        Phase::from_number(reading.state.phase).map(|phase| Variant::from(phase as u32))
    }),
    cycle("Valid", Type::UInt64, None, "Invalid reasons, as bits; 0: all values are valid", |reading, _| {
        Some(Variant::from(reading.state.valid))
    }),
    cycle("Reasons", Type::Texts, None, "Invalid reasons, as names", |reading, _| {
        Some(Variant::from(reading.validity().names().map(str::to_owned).collect::<Vec<String>>()))
    }),
    cycle("TorquesUsable", Type::Boolean, None, "Whether torques and levels are valid", |reading, _| {
        Some(Variant::from(!reading.validity().any_of(TORQUES)))
    }),
    cycle("LiftedMassUsable", Type::Boolean, None, "Whether the lifted mass is valid", |reading, _| {
        Some(Variant::from(!reading.validity().any_of(LIFTED)))
    }),
    cycle(
        "LowBackUsable",
        Type::Boolean,
        None,
        "Whether the values of the low back are valid",
        |reading, _| Some(Variant::from(!reading.validity().any_of(BACK))),
    ),
    cycle(
        "SequenceNumber",
        Type::UInt64,
        None,
        "Number of the cycle since the daemon's start, from 1",
        |reading, _| Some(Variant::from(reading.state.cycle)),
    ),
    cycle(
        "AgeNs",
        Type::UInt64,
        Some(NANOSECOND),
        "Time from the due time of the state's cycle to ServerTimestamp",
        |reading, _| Some(Variant::from(reading.age_ns)),
    ),
    cycle(
        "SampleAgeNs",
        Type::UInt64,
        Some(NANOSECOND),
        "Time from the sample time of torques and masses to ServerTimestamp",
        |reading, _| reading.sample_age_ns.map(Variant::from),
    ),
    sample("WorstJoint", Type::Text, None, TORQUES, "The joint closest to its limit", |reading, _| {
        Joint::ALL.get(reading.state.worst_joint as usize).map(|joint| Variant::from(joint.name()))
    }),
    sample("LiftedMass", Type::Double, Some(KILOGRAM), LIFTED, "Mass in the hands", |reading, _| {
        number(reading.state.lifted_mass_kg)
    }),
    sample("LiftedMassSigma", Type::Double, Some(KILOGRAM), LIFTED, "1-σ of LiftedMass", |reading, _| {
        number(reading.state.lifted_mass_sigma_kg)
    }),
    sample("LowBackMoment", Type::Double, Some(NEWTON_METRE), BACK, "Net moment at L5/S1", |reading, _| {
        number(reading.state.l5s1_moment_nm)
    }),
    sample(
        "LowBackMomentSigma",
        Type::Double,
        Some(NEWTON_METRE),
        BACK,
        "1-σ of LowBackMoment",
        |reading, _| number(reading.state.l5s1_moment_sigma_nm),
    ),
    sample(
        "LowBackCompression",
        Type::Double,
        Some(NEWTON),
        BACK,
        "Compression of the L5/S1 disc",
        |reading, _| number(reading.state.l5s1_compression_n),
    ),
    sample(
        "LowBackCompressionSigma",
        Type::Double,
        Some(NEWTON),
        BACK,
        "1-σ of LowBackCompression",
        |reading, _| number(reading.state.l5s1_compression_sigma_n),
    ),
    cycle("Lifts", Type::UInt64, None, "Number of lifts in the dose", |reading, _| {
        Some(Variant::from(u64::from(reading.state.lifts)))
    }),
    cycle(
        "DoseDamage",
        Type::Double,
        None,
        "Cumulative damage of the low back, 1 at failure",
        |reading, _| number(reading.state.dose_damage),
    ),
    cycle(
        "DoseProbability",
        Type::Double,
        None,
        "Probability of a high-risk job at this dose, 0 to 1",
        |reading, _| number(reading.state.dose_probability),
    ),
];

/// The variables of each joint.
pub const JOINT: [Row; 6] = [
    sample("Level", Type::State(&LEVELS), None, TORQUES, "Overload level of the joint", |reading, joint| {
        let level = Level::from_number(per_joint(reading, joint, |state| &state.joint_level))?;
        (level != Level::None).then(|| Variant::from(level as u32))
    }),
    sample(
        "Torque",
        Type::Doubles(3),
        Some(NEWTON_METRE),
        TORQUES,
        "Overload torque, axes of the station: X forward, Y left, Z up",
        |reading, joint| {
            let torque_nm = per_joint(reading, joint, |state| &state.torque_nm);
            torque_nm.iter().all(|nm| nm.is_finite()).then(|| Variant::from(torque_nm.to_vec()))
        },
    ),
    sample(
        "TorqueMagnitude",
        Type::Double,
        Some(NEWTON_METRE),
        TORQUES,
        "Magnitude of Torque",
        |reading, joint| {
            let torque_nm = per_joint(reading, joint, |state| &state.torque_nm);
            number(torque_nm.iter().map(|nm| nm * nm).sum::<f64>().sqrt())
        },
    ),
    sample(
        "Sigma",
        Type::Double,
        Some(NEWTON_METRE),
        TORQUES,
        "1-σ of TorqueMagnitude",
        |reading, joint| number(per_joint(reading, joint, |state| &state.torque_sigma_nm)),
    ),
    sample(
        "Limit",
        Type::Double,
        Some(NEWTON_METRE),
        TORQUES,
        "Torque limit τ_max of this subject",
        |reading, joint| {
            number(per_joint(reading, joint, |state| &state.torque_limit_nm))
                .filter(|_| per_joint(reading, joint, |state| &state.torque_limit_nm) > 0.0)
        },
    ),
    cycle("Fatigue", Type::Double, None, "Overloading fatigue, 0 to 1", |reading, joint| {
        number(per_joint(reading, joint, |state| &state.fatigue))
    }),
];

type Value = fn(&Reading, Joint) -> Option<Variant>;

/// A row that no flag invalidates.
const fn cycle(name: &'static str, of: Type, unit: Option<Unit>, meaning: &'static str, value: Value) -> Row {
    Row { name, of, unit, about: About::Cycle, invalidating: NEVER, meaning, value }
}

/// A row that refers to the sample time of the results and that flags may invalidate.
const fn sample(
    name: &'static str,
    of: Type,
    unit: Option<Unit>,
    invalidating: Validity,
    meaning: &'static str,
    value: Value,
) -> Row {
    Row { name, of, unit, about: About::Sample, invalidating, meaning, value }
}

fn per_joint<T: Copy, const N: usize>(
    reading: &Reading,
    joint: Joint,
    values: impl Fn(&State) -> &[T; N],
) -> T {
    values(&reading.state)[joint.index()]
}

fn number(value: f64) -> Option<Variant> {
    value.is_finite().then(|| Variant::from(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_have_the_numbers_of_the_standard() {
        // The rule and the numbers are from OPC UA Part 8.
        assert_eq!(NEWTON_METRE.id(), 20053);
        assert_eq!(NEWTON.id(), 5_129_559);
        assert_eq!(KILOGRAM.id(), 4_933_453);
        assert_eq!(NANOSECOND.id(), 4_404_279);
    }

    #[test]
    fn names_of_states_are_those_of_the_core() {
        for (number, name) in PHASES.iter().enumerate() {
            assert_eq!(Phase::from_number(number as u32).map(Phase::name), Some(*name));
        }
        for (number, name) in LEVELS.iter().enumerate() {
            assert_eq!(Level::from_number(number as u32).map(Level::name), Some(*name));
        }
        assert_eq!(Phase::from_number(PHASES.len() as u32), None);
        assert_eq!(Level::from_number(LEVELS.len() as u32), None);
    }
}
