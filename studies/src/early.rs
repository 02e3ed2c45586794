//! The early state: its age and errors, compared with the state at its own time and used about now and ahead.

mod errors;
mod tables;

use equipoise_core::body::JOINTS;
use equipoise_core::message::Validity;
use equipoise_simulator::truth::Truth;
use nalgebra::Vector3;
use std::collections::VecDeque;

pub use errors::{Errors, Scalar};

use crate::natural::Movements;
use crate::sensors::{AccelerationNoise, Rig};
use crate::session::{Session, Snapshot};
use crate::subject::{Cohort, Subject, map_in_parallel};
use crate::table::Table;
use crate::tally::{GROUPS, Sums, joints_of};
use crate::tasks::publishes_torques;

/// Data of a suit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SuitData {
    /// Errors of the suit's own accelerations; `None` if it sends none.
    pub accelerations: Option<AccelerationNoise>,
    /// White noise of its positions, m.
    pub white_m: f64,
}

/// Suits by their data, as named in the tables.
const SUITS: [(&str, SuitData); 3] = [
    ("positions", SuitData { accelerations: None, white_m: 0.0 }),
    ("positions, noisy", SuitData { accelerations: None, white_m: WHITE_M }),
    ("with type 21", SuitData { accelerations: Some(AccelerationNoise::ORDINARY), white_m: 0.0 }),
];
/// White noise of a noisy suit's positions per axis, m: what optical markers show.
const WHITE_M: f64 = 0.0002;
/// Boxes that are carried, kg.
const BOXES_KG: [f64; 2] = [4.0, 11.0];
/// Poses for the identification before.
const POSES_MAX: u32 = 30;
/// Natural work without a load, and with each box, s.
const UNLOADED_S: f64 = 20.0;
const LOADED_S: f64 = 15.0;
/// From this fraction of its mass on the hands a box counts as lifted.
const LIFTED: f64 = 0.999;
/// Times ahead of the early state's sample, s.
const AHEAD_S: [f64; 4] = [0.0, 0.05, 0.1, 0.2];
/// Duration over which torques are differentiated for the extrapolation, s: a quarter of the shortest movement.
const SLOPE_S: f64 = 0.1;

/// Results of one subject.
#[derive(Debug, Clone, Default)]
pub struct Findings {
    /// Ages at publication, s: of the state, and of the early state.
    pub ages_s: [Vec<f64>; 2],
    /// The state at its own time, and the early state at its own time.
    pub state: Errors,
    /// The early state.
    pub early: Errors,
    /// Without a load: external force of both.
    pub unloaded: [Errors; 2],
    /// At `AHEAD_S` after the early state's sample: the state as it is, the early state as it is, and extrapolated.
    pub ahead: [[Errors; 3]; AHEAD_S.len()],
    /// Error of the hands' positions there, m: the state's, early ones held, and at constant velocity.
    hands_m: [[Sums; 2]; AHEAD_S.len()],
    /// Magnitude of the early torque minus that of the state of the same sample, by joint group, N m.
    difference_nm: [Sums; GROUPS.len()],
    /// Samples of a carry: with torques in the state, in the early state, all.
    pub published: [u64; 3],
}

/// Prediction of one early state.
#[derive(Debug)]
struct Prediction {
    /// Index into [`AHEAD_S`], and the predicted time, s.
    index: usize,
    at_s: f64,
    /// By the state as it is, the early state as it is, and extrapolated.
    torque_nm: [[[f64; 3]; JOINTS]; 3],
    /// Held, and at constant velocity.
    hands_m: [[Vector3<f64>; 2]; 2],
}

impl Prediction {
    /// By the states of a snapshot, about [`AHEAD_S`]`[index]` after the early state's sample.
    fn of(index: usize, snapshot: &Snapshot, recent: &Recent) -> Prediction {
        let (early, ahead_s) = (snapshot.early, AHEAD_S[index]);
        Prediction {
            index,
            at_s: snapshot.early_time_s + ahead_s,
            torque_nm: [
                snapshot.state.torque_nm,
                early.torque_nm,
                extrapolated(recent, &early.torque_nm, ahead_s),
            ],
            hands_m: [0.0, ahead_s].map(|by_s| {
                [0, 1].map(|hand| {
                    let velocity = Vector3::from(early.hand_velocity_m_per_s[hand]);
                    Vector3::from(early.hand_m[hand]) + by_s * velocity
                })
            }),
        }
    }
}

/// Predictions whose time has not come, and early torques whose state has not.
#[derive(Debug, Default)]
struct Pending(VecDeque<Prediction>, Recent);

/// Recent early torques, with their times, s.
type Recent = VecDeque<(f64, [[f64; 3]; JOINTS])>;

impl Findings {
    fn add_carry(&mut self, snapshot: &Snapshot, box_kg: f64, recent: &mut Recent, pending: &mut Pending) {
        let carries = |time_s: f64| snapshot.worker.sample(time_s).load_kg >= LIFTED * box_kg;
        self.add_ahead(snapshot, carries, pending);
        let (state, early) = (snapshot.state, snapshot.early);
        let has_early = early.cycle == state.cycle && !early.validity().any_of(Validity::INVALIDATES_TORQUES);
        if !has_early {
            recent.clear();
        }
        if !carries(snapshot.time_s) || !carries(snapshot.early_time_s) {
            return;
        }
        self.published[2] += 1;
        self.published[0] += u64::from(publishes_torques(state));
        self.published[1] += u64::from(has_early);
        if !publishes_torques(state) {
            return;
        }
        self.add_difference(snapshot, pending);
        let truth = snapshot.truth();
        self.state.add(&state.torque_nm, &state.torque_sigma_nm, &truth);
        self.state.add_force(state.delta_f_n[2], state.delta_f_sigma_n, &truth);
        self.ages_s[0].push(1e-9 * (state.time_ns - state.suit_sample_time_ns) as f64);
        if !has_early {
            return;
        }
        self.ages_s[1].push(1e-9 * early.sample_age_ns as f64);
        let now_s = snapshot.early_time_s;
        recent.push_back((now_s, early.torque_nm));
        pending.1.push_back((now_s, early.torque_nm));
        if pending.1.len() > 30 {
            pending.1.pop_front();
        }
        while recent.front().is_some_and(|(time_s, _)| *time_s < now_s - SLOPE_S - 1e-3) {
            recent.pop_front();
        }
        let truth = Truth::of(snapshot.worker, now_s);
        self.early.add(&early.torque_nm, &early.torque_sigma_nm, &truth);
        self.early.add_force(early.delta_f_n[2], early.delta_f_sigma_n, &truth);
        pending.0.extend((0..AHEAD_S.len()).map(|index| Prediction::of(index, snapshot, recent)));
    }

    /// Compares the state with the early state of the same sample, if there was one.
    fn add_difference(&mut self, snapshot: &Snapshot, pending: &Pending) {
        let of_sample = pending.1.iter().find(|(time_s, _)| (time_s - snapshot.time_s).abs() < 1e-6);
        let Some((_, early_nm)) = of_sample else { return };
        for (group, sums) in self.difference_nm.iter_mut().enumerate() {
            for joint in joints_of(group) {
                let [early, state] = [early_nm[joint], snapshot.state.torque_nm[joint]].map(Vector3::from);
                sums.add(early.norm() - state.norm());
            }
        }
    }

    /// Compares predictions with the truth once their time has come: until then the worker's orders may change.
    fn add_ahead(&mut self, snapshot: &Snapshot, carries: impl Fn(f64) -> bool, pending: &mut Pending) {
        let due = |ahead: &Prediction| ahead.at_s <= snapshot.early_time_s + 1e-6;
        for ahead in pending.0.iter().filter(|ahead| due(ahead) && carries(ahead.at_s)) {
            let truth = Truth::of(snapshot.worker, ahead.at_s);
            for (errors, torque_nm) in self.ahead[ahead.index].iter_mut().zip(&ahead.torque_nm) {
                errors.add(torque_nm, &[0.0; JOINTS], &truth);
            }
            for (sums, hands_m) in self.hands_m[ahead.index].iter_mut().zip(&ahead.hands_m) {
                for (at_m, real_m) in hands_m.iter().zip(truth.body.grip_m) {
                    sums.add((at_m - real_m).norm());
                }
            }
        }
        pending.0.retain(|ahead| !due(ahead));
    }

    fn add_unloaded(&mut self, snapshot: &Snapshot) {
        let (state, early) = (snapshot.state, snapshot.early);
        let unusable = Validity::INVALIDATES_DELTA_F.and(Validity::INVALIDATES_COP_ESTIMATED);
        if !state.validity().any_of(unusable) {
            let truth = snapshot.truth();
            self.unloaded[0].add_force(state.delta_f_n[2], state.delta_f_sigma_n, &truth);
            self.unloaded[0].add_cop(state.cop_estimated_m, state.cop_sigma_m, &truth);
        }
        if !early.validity().any_of(unusable) {
            let truth = Truth::of(snapshot.worker, snapshot.early_time_s);
            self.unloaded[1].add_force(early.delta_f_n[2], early.delta_f_sigma_n, &truth);
            self.unloaded[1].add_cop(early.cop_estimated_m, early.cop_sigma_m, &truth);
        }
    }

    fn merge(&mut self, other: &Findings) {
        for (sum, ages) in self.ages_s.iter_mut().zip(&other.ages_s) {
            sum.extend(ages);
        }
        self.state.merge(&other.state);
        self.early.merge(&other.early);
        for (sum, errors) in self.unloaded.iter_mut().zip(&other.unloaded) {
            sum.merge(errors);
        }
        for (sum, errors) in self.ahead.iter_mut().flatten().zip(other.ahead.iter().flatten()) {
            sum.merge(errors);
        }
        for (sum, errors) in self.hands_m.iter_mut().flatten().zip(other.hands_m.iter().flatten()) {
            sum.merge(errors);
        }
        for (sum, errors) in self.difference_nm.iter_mut().zip(&other.difference_nm) {
            sum.merge(errors);
        }
        for (sum, count) in self.published.iter_mut().zip(other.published) {
            *sum += count;
        }
    }
}

/// Torques at `ahead_s` by their mean slope over the recent ones.
fn extrapolated(recent: &Recent, now_nm: &[[f64; 3]; JOINTS], ahead_s: f64) -> [[f64; 3]; JOINTS] {
    let (Some((from_s, from_nm)), Some((to_s, _))) = (recent.front(), recent.back()) else { return *now_nm };
    let over_s = to_s - from_s;
    if over_s < 0.5 * SLOPE_S {
        return *now_nm;
    }
    std::array::from_fn(|joint| {
        std::array::from_fn(|axis| {
            let slope = (now_nm[joint][axis] - from_nm[joint][axis]) / over_s;
            now_nm[joint][axis] + ahead_s * slope
        })
    })
}

/// Identification, natural work without a load, then with each box.
pub fn findings(subject: &Subject, suit: SuitData) -> Findings {
    let SuitData { accelerations, white_m } = suit;
    let rig = Rig { accelerations, suit_white_m: white_m, ground_late_s: 0.0, ..subject.rig() };
    let mut session = Session::with(subject, subject.settings(), rig, subject.habits());
    let mut findings = Findings::default();
    session.identify_by_windows(POSES_MAX);
    session.stand(1.0);
    session.run_at_1_khz();
    let mut movements = Movements::of(subject);
    movements.work(&mut session, UNLOADED_S, |snapshot| {
        findings.add_unloaded(snapshot);
        false
    });
    for box_kg in BOXES_KG {
        session.order(|worker, at_s| worker.lift(box_kg, at_s));
        let (mut recent, mut pending) = (Recent::new(), Pending::default());
        movements.work(&mut session, LOADED_S, |snapshot| {
            findings.add_carry(snapshot, box_kg, &mut recent, &mut pending);
            false
        });
        session.order(equipoise_simulator::motion::Worker::put_down);
        movements.work(&mut session, 4.0, |_| false);
    }
    findings
}

fn quantile_ms(values_s: &[f64], probability: f64) -> Option<f64> {
    let mut values = values_s.to_vec();
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    Some(1e3 * values[(probability * last as f64).round() as usize])
}

/// The tables.
pub fn study(cohort: &Cohort) -> Vec<Table> {
    let subjects = cohort.subjects();
    let suits = SUITS.map(|(name, suit)| {
        let mut sum = Findings::default();
        for one in map_in_parallel(&subjects, |subject| findings(subject, suit)) {
            sum.merge(&one);
        }
        (name, sum)
    });
    vec![tables::ages(cohort.count, &suits), tables::errors(&suits), tables::ahead(&suits)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wrong sign of the acceleration or a wrench of another time fails these bounds by a multiple.
    #[test]
    fn the_early_state_is_nearly_as_accurate_as_the_state_and_better_than_it_used_about_now() {
        let suits: Vec<_> = SUITS.into_iter().filter(|(_, suit)| suit.white_m == 0.0).collect();
        let questions: Vec<_> =
            [3, 4].into_iter().flat_map(|seed| suits.iter().map(move |suit| (seed, *suit))).collect();
        let all = map_in_parallel(&questions, |(seed, (_, suit))| findings(&Subject::random(*seed), *suit));
        for (name, _) in suits {
            let mut sum = Findings::default();
            for (_, one) in questions.iter().zip(&all).filter(|((_, (of, _)), _)| *of == name) {
                sum.merge(one);
            }
            assert!(quantile_ms(&sum.ages_s[1], 0.99).is_some_and(|age_ms| age_ms < 2.0), "{name}");
            let [published, early, samples] = sum.published;
            assert!(samples > 2000 && 20 * early > 19 * published, "{name}: {early} of {published}");
            let rms = |errors: &Errors| errors.rms_nm().unwrap_or(f64::MAX);
            let (state_nm, early_nm, stale_nm) = (rms(&sum.state), rms(&sum.early), rms(&sum.ahead[0][0]));
            assert!(
                early_nm < 1.1 * state_nm && early_nm < stale_nm,
                "{name}: {early_nm} {state_nm} {stale_nm}"
            );
            let mut differences = Sums::default();
            sum.difference_nm.iter().for_each(|sums| differences.merge(sums));
            // What the early state adds does not exceed the error that both share.
            let difference_nm = differences.rms().unwrap_or(f64::MAX);
            assert!(difference_nm < state_nm, "{name}: {difference_nm} N m of {state_nm} N m");
            let [state, early] = sum.unloaded.map(|errors| errors.force_n.error.rms().unwrap_or(f64::MAX));
            assert!(early < 1.7 * state, "{name}: {early} N, by the state {state} N");
            let sigmas = [&sum.state, &sum.early].map(|errors| errors.mean_sigma_nm().unwrap_or(0.0));
            assert!(sigmas[1] > sigmas[0] && sigmas[1] < 1.3 * sigmas[0], "{name}: {sigmas:?}");
        }
    }
}
