//! Values that `[gateways.rtde]` can write into registers: names, types, groups.

use equipoise_core::body::Joint;
use equipoise_core::message::Validity;

/// Default registers.
pub(super) const DEFAULT: [(&str, u8); 12] = [
    ("sequence", 24),
    ("state", 25),
    ("valid", 26),
    ("usable", 27),
    ("worst_level", 28),
    ("worst_joint", 29),
    ("age_s", 24),
    ("sample_age_s", 25),
    ("worst_torque_nm", 26),
    ("worst_limit_ratio", 27),
    ("lifted_mass_kg", 28),
    ("reach_m", 29),
];

/// Names of the previous release, accepted for one release, and their present names.
const RENAMED: [(&str, &str); 3] =
    [("moment_age_s", "sample_age_s"), ("not_given", "unavailable"), ("worst_share", "worst_limit_ratio")];

/// A value for a register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Value {
    /// Increments with each package: 1 … 2³¹ − 1, then 1 again. 0: not written yet.
    Sequence,
    /// 0: not written yet; 1: there is a current state; otherwise the reason why there is none, see the table below.
    State,
    /// Daemon starts counted by this gateway, from 1; 0 before the first state. Without a state, the last value.
    DaemonLife,
    /// The 31 lower bits of `State::valid`; −1 without a state.
    Valid,
    /// Groups of usable values: bit n is the n-th of [`Validity::FLAG_SETS`].
    Usable,
    /// Quantities that the station's sensors never provide.
    Unavailable,
    /// Number of the phase; −1 without a state.
    Phase,
    /// The highest level of all joints; an undecided joint counts as the worst.
    WorstLevel,
    /// Index of the joint closest to its limit; −1 while torques are invalid.
    WorstJoint,
    /// Age of the state, s; −1 without a state.
    AgeS,
    /// Age of the sample time of the results, s; −1 without one.
    SampleAgeS,
    /// Overload torque of the worst joint, N m.
    WorstTorqueNm,
    /// 1-σ of the worst joint's torque, N m.
    WorstSigmaNm,
    /// Torque of the worst joint divided by its limit.
    WorstLimitRatio,
    /// Lifted mass, kg.
    LiftedMassKg,
    /// 1-σ of the lifted mass, kg.
    LiftedMassSigmaKg,
    /// Horizontal distance from the middle of the ankles to the load, m.
    ReachM,
    /// 1-σ of the same distance, m.
    ReachSigmaM,
    /// Vertical external force, N.
    DeltaFzN,
    /// 1-σ of the vertical external force, N.
    DeltaFzSigmaN,
    /// Compression of the L5/S1 disc, N.
    L5s1CompressionN,
    /// 1-σ of the compression of the L5/S1 disc, N.
    L5s1CompressionSigmaN,
    /// Direction in which moving the load relieves the worst joint: world X.
    AdviceX,
    /// The same direction, world Y.
    AdviceY,
    /// The same direction, world Z.
    AdviceZ,
    /// Level of one joint.
    Level(Joint),
    /// Overload torque of one joint, N m.
    TorqueNm(Joint),
    /// 1-σ of the overload torque of one joint, N m.
    SigmaNm(Joint),
    /// Fatigue of one joint, 0 to 1.
    Fatigue(Joint),
}

/// One row: value, name, whether it is an integer, group of values it belongs to, description.
type Row = (Value, &'static str, bool, Option<Validity>, &'static str);

const TORQUES: Option<Validity> = Some(Validity::INVALIDATES_TORQUES);
const LIFTED: Option<Validity> = Some(Validity::INVALIDATES_LIFTED_MASS);

/// All values except those per joint.
#[rustfmt::skip]
const ROWS: [Row; 25] = [
    (Value::Sequence, "sequence", true, None, "increments with each package, 1 to 2³¹ − 1, then 1 again; 0: not written yet"),
    (Value::State, "state", true, None, "1: there is a current state; 0: not written yet; otherwise there is none: 2 silent, 3 stale, 4 other_clock, 5 bus"),
    (Value::DaemonLife, "daemon_life", true, None, "daemon starts counted by this gateway, from 1 (sums restart; another subject: `model_changed` in `valid`); 0 before the first state; without a state, the last value"),
    (Value::Valid, "valid", true, None, "invalid reasons (bits); −1 without a state"),
    (Value::Usable, "usable", true, None, "groups of valid values (bits); 0 without a state"),
    (Value::Unavailable, "unavailable", true, None, "quantities that the station's sensors do not provide (bits)"),
    (Value::Phase, "phase", true, None, "0 waiting, 1 identifying, 2 monitoring, 3 degraded; −1 without a state"),
    (Value::WorstLevel, "worst_level", true, TORQUES, "the highest level of all joints: 1 green, 2 orange, 3 red, 4 above_max, 5 undecided; 0: invalid"),
    (Value::WorstJoint, "worst_joint", true, None, "index of the joint closest to its limit; −1 while torques are invalid"),
    (Value::AgeS, "age_s", false, None, "age of the state at writing, s; −1 without a state"),
    (Value::SampleAgeS, "sample_age_s", false, None, "age of the sample time that the values refer to, s; −1 without one"),
    (Value::WorstTorqueNm, "worst_torque_nm", false, TORQUES, "overload torque of the worst joint, N m"),
    (Value::WorstSigmaNm, "worst_sigma_nm", false, TORQUES, "1-σ of `worst_torque_nm`, N m"),
    (Value::WorstLimitRatio, "worst_limit_ratio", false, TORQUES, "`worst_torque_nm` over the joint's torque limit"),
    (Value::LiftedMassKg, "lifted_mass_kg", false, LIFTED, "mass in the hands, kg"),
    (Value::LiftedMassSigmaKg, "lifted_mass_sigma_kg", false, LIFTED, "1-σ of `lifted_mass_kg`, kg"),
    (Value::ReachM, "reach_m", false, TORQUES, "horizontal distance of the load from the midpoint of the ankles, m"),
    (Value::ReachSigmaM, "reach_sigma_m", false, TORQUES, "1-σ of `reach_m`, m"),
    (Value::DeltaFzN, "delta_fz_n", false, Some(Validity::INVALIDATES_DELTA_F), "vertical external force, N"),
    (Value::DeltaFzSigmaN, "delta_fz_sigma_n", false, Some(Validity::INVALIDATES_DELTA_F), "1-σ of `delta_fz_n`, N"),
    (Value::L5s1CompressionN, "l5s1_compression_n", false, Some(Validity::INVALIDATES_LOW_BACK), "compression of the L5/S1 disc, N"),
    (Value::L5s1CompressionSigmaN, "l5s1_compression_sigma_n", false, Some(Validity::INVALIDATES_LOW_BACK), "1-σ of `l5s1_compression_n`, N"),
    (Value::AdviceX, "advice_x", false, TORQUES, "relieving direction of load motion, unit vector, world X; all three 0: none"),
    (Value::AdviceY, "advice_y", false, TORQUES, "world Y"),
    (Value::AdviceZ, "advice_z", false, TORQUES, "world Z, up"),
];

impl Value {
    /// The value with this name in the configuration.
    pub fn of_name(name: &str) -> Option<Value> {
        let name = RENAMED.iter().find(|(old, _)| *old == name).map_or(name, |(_, new)| new);
        if let Some((value, ..)) = ROWS.iter().find(|(_, row, ..)| *row == name) {
            return Some(*value);
        }
        Joint::ALL
            .into_iter()
            .flat_map(|joint| {
                [Value::Level(joint), Value::TorqueNm(joint), Value::SigmaNm(joint), Value::Fatigue(joint)]
            })
            .find(|value| value.name() == name)
    }

    /// Its name in the configuration.
    pub fn name(self) -> String {
        match self {
            Value::Level(joint) => format!("level_{}", joint.name()),
            Value::TorqueNm(joint) => format!("torque_{}_nm", joint.name()),
            Value::SigmaNm(joint) => format!("sigma_{}_nm", joint.name()),
            Value::Fatigue(joint) => format!("fatigue_{}", joint.name()),
            _ => self.row().map_or_else(String::new, |(_, name, ..)| (*name).to_owned()),
        }
    }

    fn row(self) -> Option<&'static Row> {
        ROWS.iter().find(|(value, ..)| *value == self)
    }

    /// Whether it is an integer.
    pub fn is_whole(self) -> bool {
        self.row().map_or(matches!(self, Value::Level(_)), |(_, _, whole, ..)| *whole)
    }

    /// Validity flags that invalidate it; `None` for values that are always valid.
    pub fn needs(self) -> Option<Validity> {
        match self {
            Value::Level(_) | Value::TorqueNm(_) | Value::SigmaNm(_) => TORQUES,
            Value::Fatigue(_) => None,
            _ => self.row().and_then(|(_, _, _, needs, _)| *needs),
        }
    }
}

/// The table of docs/consumers/rtde.md: name, type, group, description.
pub fn rtde_values() -> impl Iterator<Item = (&'static str, &'static str, &'static str, &'static str)> {
    ROWS.iter().map(|(_, name, whole, needs, says)| {
        let group = Validity::FLAG_SETS.iter().find(|(invalidating, _)| Some(*invalidating) == *needs);
        (*name, if *whole { "int" } else { "double" }, group.map_or("", |(_, name)| *name), *says)
    })
}

/// A value and its register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Register {
    /// The value written.
    pub value: Value,
    /// Register number, 24 to 47.
    pub number: u8,
}

impl Register {
    /// Name of the register in the controller.
    pub fn name(self) -> String {
        let kind = if self.value.is_whole() { "int" } else { "double" };
        format!("input_{kind}_register_{}", self.number)
    }
}
