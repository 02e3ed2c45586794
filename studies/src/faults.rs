//! Undeclared sensor faults during work: time to detection, withheld values, and wrong values reported as valid.

pub mod injection;
mod late_stream;

use equipoise_core::message::Validity;
use equipoise_simulator::random::Random;
use nalgebra::{Matrix2, Vector2, Vector3};

use crate::lifting::PublicationTally;
use crate::natural::Movements;
use crate::session::{Session, Snapshot};
use crate::subject::{Cohort, Subject, map_in_parallel};
use crate::table::{Cell, Table};
use crate::tally::{percent, quartiles};
use crate::tasks::publishes_torques;
use injection::Fault;

/// Poses that identify the worker before the first fault.
const POSES_MAX: u32 = 20;
/// Carried mass, kg.
const BOX_KG: f64 = 11.0;
/// Range of the time from picking up the box to the fault, s.
const BEFORE_S: [f64; 2] = [2.5, 5.0];
/// Output is evaluated for this long after the fault, s.
const AFTER_S: f64 = 1.0;
/// Time limit for the recovery before the next fault, s.
const PATIENCE_S: f64 = 40.0;
/// A mass is wrong beyond this, kg, and four of its σ.
const WRONG_KG: f64 = 3.0;
/// A joint's torque is wrong beyond this, N m, and four of its σ.
const WRONG_NM: f64 = 10.0;
/// A centre of pressure is wrong beyond this, m, and four of its σ.
const WRONG_M: f64 = 0.03;
/// Errors beyond this many σ are wrong values.
const WRONG_SIGMAS: f64 = 4.0;
/// States of two runs whose times differ by less than this are of the same suit sample, s: below half its period.
const SAME_STATE_S: f64 = 0.005;

/// Results of one fault, or of many.
#[derive(Debug, Clone, Default)]
pub struct Outcome {
    /// Number of faults.
    pub times: u64,
    /// Output during the fault and right after it, by time.
    pub tally: PublicationTally,
    /// New states in that time.
    pub states: u64,
    /// Those with a wrong value reported as valid: mass, a joint's torque, centre of pressure.
    pub wrong: [u64; 3],
    /// Of these, the states in which the same value is wrong without the fault, in the same motion with the same noise.
    pub wrong_without: [u64; 3],
    /// Times of the states with a wrong value, s.
    wrong_at_s: [Vec<f64>; 3],
    /// From the start of the fault to the first state that withheld a value because of it, s.
    noticed_s: Vec<f64>,
    /// From its end until torques or "no load" are reported again, s.
    back_s: Vec<f64>,
    /// Counted minus actual lifts.
    pub lifts_too_many: i64,
}

impl Outcome {
    fn add(&mut self, snapshot: &Snapshot) {
        self.states += 1;
        for (kind, is_wrong) in wrong_values(snapshot).into_iter().enumerate() {
            if is_wrong {
                self.wrong[kind] += 1;
                self.wrong_at_s[kind].push(snapshot.time_s);
            }
        }
    }

    /// Counts the wrong values that have nothing to do with the fault, from the states of a run without it.
    fn compare_with(&mut self, without: &Outcome) {
        for kind in 0..self.wrong.len() {
            let is_wrong_without = |at_s: &&f64| {
                without.wrong_at_s[kind].iter().any(|other_s| (*at_s - other_s).abs() < SAME_STATE_S)
            };
            self.wrong_without[kind] = self.wrong_at_s[kind].iter().filter(is_wrong_without).count() as u64;
        }
    }

    fn merge(&mut self, other: &Outcome) {
        self.times += other.times;
        self.tally.merge(&other.tally);
        self.states += other.states;
        self.noticed_s.extend(&other.noticed_s);
        self.back_s.extend(&other.back_s);
        self.lifts_too_many += other.lifts_too_many;
        let counts = other.wrong.into_iter().chain(other.wrong_without);
        for (sum, count) in self.wrong.iter_mut().chain(&mut self.wrong_without).zip(counts) {
            *sum += count;
        }
    }
}

/// Whether a state has a wrong value reported as valid: mass, a joint's torque, centre of pressure.
fn wrong_values(snapshot: &Snapshot) -> [bool; 3] {
    let (state, truth) = (snapshot.state, snapshot.truth());
    let valid = state.validity();
    let off_kg = (state.lifted_mass_kg - snapshot.worker.sample(snapshot.time_s).load_kg).abs();
    let bound_kg = WRONG_KG.max(WRONG_SIGMAS * state.lifted_mass_sigma_kg);
    let is_joint_wrong = |joint: usize| {
        let off_nm = Vector3::from(state.torque_nm[joint]) - truth.overload_in_motion_nm[joint];
        let [xx, xy, yy] = state.torque_covariance_nm2[joint];
        let deviation = Matrix2::new(xx, xy, xy, yy)
            .try_inverse()
            .map_or(f64::INFINITY, |inverse| off_nm.xy().dot(&(inverse * off_nm.xy())).sqrt());
        exceeds(off_nm.norm(), WRONG_NM) && exceeds(deviation, WRONG_SIGMAS)
    };
    let off_m = (Vector2::from(state.cop_estimated_m) - truth.cop_without_load_in_motion_m).norm();
    let bound_m = WRONG_M.max(WRONG_SIGMAS * state.cop_sigma_m[0].hypot(state.cop_sigma_m[1]));
    let withholds_cop = Validity::INVALIDATES_COP_ESTIMATED.and(Validity::NOT_IDENTIFIED);
    [
        !valid.any_of(Validity::INVALIDATES_LIFTED_MASS) && exceeds(off_kg, bound_kg),
        publishes_torques(state) && (0..state.torque_nm.len()).any(is_joint_wrong),
        !valid.any_of(withholds_cop) && exceeds(off_m, bound_m),
    ]
}

/// Whether an error is larger than a bound; one that is not a number is.
fn exceeds(error: f64, bound: f64) -> bool {
    error.is_nan() || error > bound
}

/// Invalid reasons that count as detection of a fault: those of torques, without those of an absent or small load.
const REASONS: Validity = Validity(
    Validity::INVALIDATES_TORQUES.0
        & !Validity::BELOW_LOAD_THRESHOLD.0
        & !Validity::LOAD_BELOW_DETECTION_LIMIT.0,
);

/// Identifies the subject, who then works while one sensor fault after the other occurs. With `compares`, a run without
/// the fault follows each one with wrong values ([`Outcome::wrong_without`]).
pub fn faults(subject: &Subject, of: &[Fault], compares: bool) -> Vec<(Fault, Outcome)> {
    let mut session = Session::new(subject, subject.settings());
    session.identify(POSES_MAX);
    let mut movements = Movements::of(subject);
    let mut random = Random::new(subject.seed, "faults");
    movements.work(&mut session, 10.0, |_| false);
    let mut one = |fault| one(&mut session, &mut movements, fault, &mut random, compares);
    of.iter().map(|fault| (*fault, one(*fault))).collect()
}

fn one(
    session: &mut Session,
    movements: &mut Movements,
    fault: Fault,
    random: &mut Random,
    compares: bool,
) -> Outcome {
    let carrying = random.happens(0.7);
    let lifts = session.state().lifts;
    if carrying {
        session.order(|worker, at_s| worker.lift(BOX_KG, at_s));
    }
    let [begins_s, ends_s] = session.fail(fault, random.between(BEFORE_S[0], BEFORE_S[1]));
    movements.work(session, begins_s - session.now_s(), |_| false);
    let twin = compares.then(|| (session.clone(), movements.clone()));
    let mut outcome = Outcome { times: 1, ..Outcome::default() };
    session.record_outputs();
    let observe = |session: &mut Session, movements: &mut Movements, outcome: &mut Outcome| {
        movements.work(session, ends_s + AFTER_S - session.now_s(), |snapshot| {
            outcome.add(snapshot);
            false
        });
    };
    observe(session, movements, &mut outcome);
    if let Some((mut twin, mut same_movements)) = twin.filter(|_| outcome.wrong != [0; 3]) {
        let mut without = Outcome::default();
        twin.fail(Fault::None, 0.0);
        observe(&mut twin, &mut same_movements, &mut without);
        outcome.compare_with(&without);
    }
    let outputs = session.take_outputs();
    outputs.iter().for_each(|output| outcome.tally.add_output(output));
    let first = outputs.iter().find(|output| output.validity.any_of(REASONS));
    outcome.noticed_s.extend(first.map(|output| output.time_s - begins_s));
    if carrying {
        session.order(equipoise_simulator::motion::Worker::put_down);
    }
    if movements.work(session, PATIENCE_S, |snapshot| !snapshot.state.validity().any_of(REASONS)) {
        outcome.back_s.push(session.now_s() - ends_s - AFTER_S);
    }
    movements.work(session, 2.0, |_| false);
    outcome.lifts_too_many = i64::from(session.state().lifts) - i64::from(lifts) - i64::from(carrying);
    outcome
}

/// The table.
pub fn study(cohort: &Cohort) -> Vec<Table> {
    let all = map_in_parallel(&cohort.subjects(), |subject| faults(subject, &Fault::ALL, true));
    let mut table = Table::new(
        format!("Detection of undeclared sensor faults during work ({} subjects)", cohort.count),
        &[
            "fault",
            "count",
            "detected",
            "median delay s",
            "maximum delay s",
            "withheld %",
            "most frequent reasons",
            "valid but wrong: mass",
            "torque",
            "CoP",
            "mass without the fault",
            "torque without the fault",
            "CoP without the fault",
            "of states",
            "excess lifts",
            "median recovery s",
            "maximum recovery s",
        ],
    );
    for (index, fault) in Fault::ALL.into_iter().enumerate() {
        let mut sum = Outcome::default();
        all.iter().for_each(|outcomes| sum.merge(&outcomes[index].1));
        let slowest = |seconds: &[f64]| seconds.iter().copied().reduce(f64::max);
        let median = |seconds: &[f64]| quartiles(seconds.to_vec()).map(|[_, median, _]| median);
        let (ticks, published) = (sum.tally.samples, sum.tally.published);
        let row: Vec<Cell> = vec![
            fault.name().into(),
            sum.times.into(),
            (sum.noticed_s.len() as u64).into(),
            median(&sum.noticed_s).into(),
            slowest(&sum.noticed_s).into(),
            percent(ticks - published, ticks).into(),
            sum.tally.reasons().as_str().into(),
            sum.wrong[0].into(),
            sum.wrong[1].into(),
            sum.wrong[2].into(),
            sum.wrong_without[0].into(),
            sum.wrong_without[1].into(),
            sum.wrong_without[2].into(),
            sum.states.into(),
            sum.lifts_too_many.to_string().as_str().into(),
            median(&sum.back_s).into(),
            slowest(&sum.back_s).into(),
        ];
        table.push(row);
    }
    table.note("squats and bends at natural speed, 7 times of 10 with a box of 11 kg; faults last 3 s unless stated otherwise");
    table.note("withheld: fraction of the time from the start of the fault to 1 s after its end without a current state with torques");
    table.note(
        "wrong: states beyond 4 sigma and 3 kg, 10 N m or 30 mm, from the start of the fault to 1 s after its end",
    );
    table.note(
        "without the fault: those of them that are wrong in the same motion with the same noise and no fault",
    );
    vec![table]
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;
    use equipoise_core::message::SuitSample;

    use super::*;
    use crate::faults::injection::Injection;
    use crate::sensors::{EPOCH_NS, simulated_s};
    use crate::session::TICK_NS;

    #[test]
    fn an_error_that_is_not_a_number_is_wrong() {
        assert_eq!([2.9, 3.1, f64::NAN].map(|error| exceeds(error, 3.0)), [false, true, true]);
    }

    #[test]
    fn a_late_suit_is_stamped_by_the_clock_fit_of_the_adapter() {
        let mut injection = Injection::default();
        injection.replace(10.0, Fault::LateSuit);
        let (mut arrived, mut late_s) = (0, 0.0);
        for index in 0..1400_u64 {
            let (time_s, taken_ns) = (0.01 * index as f64, EPOCH_NS + 10_000_000 * index);
            let com_m = [time_s, 0.0, 0.0];
            let sample = SuitSample {
                sample_time_ns: taken_ns,
                device_counter: index as u32,
                com_m,
                ..SuitSample::zeroed()
            };
            let mut suit = vec![sample];
            injection.put(Fault::LateSuit, taken_ns, &mut suit, &mut Vec::new());
            for sample in suit {
                assert_eq!(sample.device_counter, arrived, "each once, in order");
                arrived += 1;
                late_s = simulated_s(sample.sample_time_ns) - sample.com_m[0];
                let is_stamped_right = late_s.abs() < 1e-3;
                let admits_an_error = sample.sample_time_sigma_ns > 290_000_000;
                assert!(is_stamped_right || admits_an_error || time_s > 11.3, "{time_s} s: {late_s} s late");
                assert!(
                    !(10.0..11.2).contains(&time_s) || admits_an_error,
                    "{time_s} s: a pause is not excluded"
                );
            }
        }
        assert_eq!(arrived, 1400 - 30);
        assert!((late_s - 0.3).abs() < 1e-3, "{late_s}");
    }

    #[test]
    fn no_fault_gives_a_wrong_valid_mass_and_sound_sensors_are_accepted() {
        let wanted = [
            Fault::None,
            Fault::DoubleGlitch,
            Fault::HalfGain,
            Fault::Saturated,
            Fault::Flipped,
            Fault::FrozenPlate,
            Fault::FrozenSuit,
            Fault::IdentityQuaternions,
            Fault::IdentityArms,
            Fault::HighAfterGap,
            Fault::DoubleAfterGap,
            Fault::LateSuit,
        ];
        let seeds = [3, 4];
        let all = map_in_parallel(&seeds, |seed| faults(&Subject::random(*seed), &wanted, false));
        for (seed, outcomes) in seeds.iter().zip(all) {
            for (fault, outcome) in outcomes {
                let Outcome { wrong, noticed_s, back_s, tally, states, .. } = &outcome;
                assert_eq!(wrong[0], 0, "{seed} {fault:?}: {outcome:?}");
                assert_eq!(back_s.len(), 1, "{seed} {fault:?}: {outcome:?}");
                let is_noticed = noticed_s.iter().any(|after_s| *after_s < 3.0);
                // A vertical force below the rail is unaffected.
                assert!(
                    is_noticed != (fault == Fault::None) || fault == Fault::Saturated,
                    "{seed} {fault:?}: {outcome:?}"
                );
                let span_s = fault.lasts_s() + AFTER_S;
                let tallied_s = tally.samples as f64 * TICK_NS as f64 * 1e-9;
                assert!((tallied_s - span_s).abs() < 0.02, "{seed} {fault:?}: {tallied_s} of {span_s} s");
                // The estimator makes no state of a suit that it rejects.
                if matches!(fault, Fault::FrozenSuit | Fault::IdentityQuaternions) {
                    let withheld = (tally.samples - tally.published) as f64 / tally.samples as f64;
                    assert!(withheld > 0.9 * fault.lasts_s() / span_s, "{seed} {fault:?}: {withheld}");
                    assert!((*states as f64) < 60.0 * span_s, "{seed} {fault:?}: {outcome:?}");
                }
            }
        }
    }
}
