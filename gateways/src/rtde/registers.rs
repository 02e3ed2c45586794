//! Values of the registers.

use equipoise_client::NoReading;
use equipoise_core::body::Joint;
use equipoise_core::message::{State, Validity};

use super::wire::Word;
use crate::config::Value;
use crate::gateway::Latest;

/// Counters that the gateway itself maintains.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counts {
    /// Sequence number of the package.
    pub(super) sequence: i32,
    /// Number of the daemon's starts in the last state received; 0 before any.
    pub(super) daemon_life: u32,
}

/// The value to write now.
pub(super) fn word(value: Value, counts: Counts, latest: &Latest) -> Word {
    match value {
        Value::Sequence => Word::Int(counts.sequence),
        Value::DaemonLife => Word::Int(i32::try_from(counts.daemon_life).unwrap_or(i32::MAX)),
        Value::State => Word::Int(state_number(latest)),
        value => match latest {
            Ok(reading) => word_of_state(value, &reading.state, reading.age_ns, reading.sample_age_ns),
            Err(_) => nothing(value),
        },
    }
}

/// 1 with a state, otherwise the number of the reason why there is none.
fn state_number(latest: &Latest) -> i32 {
    match latest {
        Ok(_) => 1,
        Err(NoReading::Silent { .. }) => 2,
        Err(NoReading::Stale { .. }) => 3,
        Err(NoReading::OtherClock { .. }) => 4,
        Err(NoReading::Bus(_)) => 5,
    }
}

/// Register value while there is no state.
fn nothing(value: Value) -> Word {
    match value {
        Value::Valid | Value::Phase | Value::WorstJoint => Word::Int(-1),
        Value::AgeS | Value::SampleAgeS => Word::Double(-1.0),
        other => zero(other),
    }
}

fn zero(value: Value) -> Word {
    if value.is_whole() { Word::Int(0) } else { Word::Double(0.0) }
}

/// Register value with a state; zero if the state's value is invalid.
fn word_of_state(value: Value, state: &State, age_ns: u64, sample_age_ns: Option<u64>) -> Word {
    if value.needs().is_some_and(|invalidating| state.validity().any_of(invalidating)) {
        return zero(value);
    }
    let worst = state
        .unless(Validity::INVALIDATES_TORQUES, state.worst_joint as usize)
        .filter(|at| *at < Joint::ALL.len());
    let magnitude_nm = |at: usize| state.torque_nm[at].iter().map(|nm| nm * nm).sum::<f64>().sqrt();
    let of_worst = |number: &dyn Fn(usize) -> f64| Word::Double(worst.map_or(0.0, number));
    let whole = |number: u64| Word::Int((number & u64::from(i32::MAX.unsigned_abs())) as i32);
    match value {
        Value::Sequence | Value::State | Value::DaemonLife => zero(value),
        Value::Valid => whole(state.valid),
        Value::Usable => whole(usable(state)),
        Value::Unavailable => whole(u64::from(state.unavailable)),
        Value::Phase => whole(u64::from(state.phase)),
        Value::WorstLevel => whole(u64::from(state.joint_level.into_iter().max().unwrap_or(0))),
        Value::WorstJoint => Word::Int(worst.map_or(-1, |at| at as i32)),
        Value::AgeS => Word::Double(1e-9 * age_ns as f64),
        Value::SampleAgeS => Word::Double(sample_age_ns.map_or(-1.0, |age_ns| 1e-9 * age_ns as f64)),
        Value::WorstTorqueNm => of_worst(&magnitude_nm),
        Value::WorstSigmaNm => of_worst(&|at| state.torque_sigma_nm[at]),
        Value::WorstLimitRatio => of_worst(&|at| magnitude_nm(at) / state.torque_limit_nm[at]),
        Value::LiftedMassKg => Word::Double(state.lifted_mass_kg),
        Value::LiftedMassSigmaKg => Word::Double(state.lifted_mass_sigma_kg),
        Value::ReachM => Word::Double(state.reach_m),
        Value::ReachSigmaM => Word::Double(state.reach_sigma_m),
        Value::DeltaFzN => Word::Double(state.delta_f_n[2]),
        Value::DeltaFzSigmaN => Word::Double(state.delta_f_sigma_n),
        Value::L5s1CompressionN => Word::Double(state.l5s1_compression_n),
        Value::L5s1CompressionSigmaN => Word::Double(state.l5s1_compression_sigma_n),
        Value::AdviceX => Word::Double(state.advice_direction[0]),
        Value::AdviceY => Word::Double(state.advice_direction[1]),
        Value::AdviceZ => Word::Double(state.advice_direction[2]),
        Value::Level(joint) => whole(u64::from(state.joint_level[joint.index()])),
        Value::TorqueNm(joint) => Word::Double(magnitude_nm(joint.index())),
        Value::SigmaNm(joint) => Word::Double(state.torque_sigma_nm[joint.index()]),
        Value::Fatigue(joint) => Word::Double(state.fatigue[joint.index()]),
    }
}

fn usable(state: &State) -> u64 {
    let groups = Validity::FLAG_SETS.iter().enumerate();
    groups
        .filter(|(_, (invalidating, _))| !state.validity().any_of(*invalidating))
        .map(|(bit, _)| 1 << bit)
        .sum()
}
