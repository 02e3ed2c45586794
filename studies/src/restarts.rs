//! Restarts of suit, plate and daemon during work, the suit with another origin and heading: time until the worker's
//! position is estimated again, and its accuracy.

use std::f64::consts::PI;

use equipoise_core::message::Validity;
use equipoise_simulator::random::Random;
use equipoise_simulator::suit_sender::SuitWorld;
use nalgebra::Vector2;

use crate::natural::Movements;
use crate::session::{Session, Snapshot};
use crate::subject::{Cohort, Subject, map_in_parallel};
use crate::table::{Cell, Table};
use crate::tally::{percent, quartiles};

/// Poses that identify the worker before the first restart.
const POSES_MAX: u32 = 20;
/// Work before the first box is lifted: the longest movement, s.
pub const BEGINS_S: f64 = 3.0;
/// Range of a device's or the daemon's downtime, s.
const AWAY_S: [f64; 2] = [0.4, 4.0];
/// Maximum distance of the suit's new origin from the old one along each axis, m.
const ORIGIN_M: f64 = 2.0;
/// Range of the time between restarts, s.
const WORK_S: [f64; 2] = [1.0, 8.0];
/// The position must be estimated again within this, s.
const PATIENCE_S: f64 = 60.0;
/// … and should be within this.
const SOON_S: f64 = 10.0;
/// After that the position is compared with the truth for this long, s.
const EVALUATED_S: f64 = 8.0;
/// The torques of a box lifted afterwards are reported within this, s.
const LIFTING_S: f64 = 6.0;
/// Mass carried in some of the restarts, and lifted at the end, kg.
const BOX_KG: f64 = 8.0;
/// Restarts of each subject.
const RESTARTS: usize = 6;

/// Restarted component.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Restart {
    /// The suit's software: it counts from zero, with another origin and heading.
    Suit,
    /// The plate's device.
    Ground,
    /// The daemon, which resumes from its saved state.
    Daemon,
    /// The suit while the daemon is away.
    SuitBehindTheDaemon,
}

impl Restart {
    /// All, in the order of the table.
    pub const ALL: [Restart; 4] =
        [Restart::Suit, Restart::Ground, Restart::Daemon, Restart::SuitBehindTheDaemon];

    fn name(self) -> &'static str {
        match self {
            Restart::Suit => "suit",
            Restart::Ground => "plate",
            Restart::Daemon => "daemon",
            Restart::SuitBehindTheDaemon => "suit while the daemon is away",
        }
    }
}

/// Errors of the reported values.
#[derive(Debug, Clone, Copy, Default)]
pub struct Errors {
    /// States with a centre of pressure.
    pub published: u64,
    square_m2: f64,
    /// The largest error of the centre of pressure, m.
    pub cop_max_m: f64,
    /// The largest error of the pelvis' position, m.
    pub pelvis_max_m: f64,
    /// States whose centre of pressure is more than three of its σ off on an axis.
    pub beyond_three_sigma: u64,
}

impl Errors {
    /// Whether a centre of pressure is reported.
    fn are_of(snapshot: &Snapshot) -> bool {
        !snapshot.state.validity().any_of(Validity::INVALIDATES_COP_ESTIMATED.and(Validity::NOT_IDENTIFIED))
    }

    fn add(&mut self, snapshot: &Snapshot) {
        let state = snapshot.state;
        if !Errors::are_of(snapshot) {
            return;
        }
        let truth = snapshot.truth();
        let off_m = Vector2::from(state.cop_estimated_m) - truth.cop_without_load_in_motion_m;
        let [x, y, _] = state.segment_origin_m[0];
        let pelvis = truth.body.origin_m[0];
        self.published += 1;
        self.square_m2 += off_m.norm_squared();
        self.cop_max_m = self.cop_max_m.max(off_m.norm());
        self.pelvis_max_m = self.pelvis_max_m.max((Vector2::new(x, y) - pelvis.xy()).norm());
        let is_beyond = (0..2).any(|axis| off_m[axis].abs() > 3.0 * state.cop_sigma_m[axis]);
        self.beyond_three_sigma += u64::from(is_beyond);
    }

    fn merge(&mut self, other: &Errors) {
        self.published += other.published;
        self.square_m2 += other.square_m2;
        self.cop_max_m = self.cop_max_m.max(other.cop_max_m);
        self.pelvis_max_m = self.pelvis_max_m.max(other.pelvis_max_m);
        self.beyond_three_sigma += other.beyond_three_sigma;
    }

    /// Root mean square error of the centre of pressure, m.
    pub fn cop_rms_m(&self) -> f64 {
        (self.square_m2 / self.published.max(1) as f64).sqrt()
    }
}

/// One restart and its results.
#[derive(Debug, Clone, Copy)]
pub struct Outcome {
    /// The restarted component.
    pub restart: Restart,
    /// Whether a box was carried during it; it is put down afterwards.
    pub carrying: bool,
    /// From the end of the interruption until a centre of pressure is reported again, s; `None`: not within a minute.
    pub found_s: Option<f64>,
    /// Whether torques of a box lifted afterwards are reported.
    pub publishes_torques: bool,
    /// Errors of all values reported from the restart to the end of the evaluated time.
    pub errors: Errors,
}

/// Identifies the subject, who then works through a sequence of restarts.
pub fn restarts(subject: &Subject, of: impl Fn(&mut Random) -> Restart) -> Vec<Outcome> {
    let mut session = Session::new(subject, subject.settings());
    session.identify(POSES_MAX);
    let mut movements = Movements::of(subject);
    let mut random = Random::new(subject.seed, "restarts");
    // The hands come from the last pose to the sides of a box.
    movements.work(&mut session, BEGINS_S, |_| false);
    (0..RESTARTS).map(|_| one(&mut session, &mut movements, of(&mut random), &mut random)).collect()
}

fn one(session: &mut Session, movements: &mut Movements, restart: Restart, random: &mut Random) -> Outcome {
    let carrying = random.happens(0.3);
    if carrying {
        session.order(|worker, at_s| worker.lift(BOX_KG, at_s));
    }
    movements.work(session, random.between(WORK_S[0], WORK_S[1]), |_| false);
    let away_s = random.between(AWAY_S[0], AWAY_S[1]);
    let origin_m = [random.between(-ORIGIN_M, ORIGIN_M), random.between(-ORIGIN_M, ORIGIN_M), 0.0];
    let world = SuitWorld { origin_m, yaw_rad: random.between(-PI, PI) };
    match restart {
        Restart::Suit => session.restart_suit(away_s, world),
        Restart::Ground => session.restart_ground(away_s),
        Restart::Daemon => assert!(session.restart_daemon(away_s), "what was kept is not used"),
        Restart::SuitBehindTheDaemon => {
            session.restart_suit(0.5 * away_s, world);
            assert!(session.restart_daemon(away_s), "what was kept is not used");
        }
    }
    let mut errors = Errors::default();
    // The daemon has restarted already; a device restarts by itself.
    let is_device = matches!(restart, Restart::Suit | Restart::Ground);
    let back_s = session.now_s() + if is_device { away_s } else { 0.0 };
    let mut found_s = None;
    let mut evaluate = |snapshot: &Snapshot| {
        errors.add(snapshot);
        // States pending for later samples at a restart are still published afterwards.
        if found_s.is_none() && snapshot.time_s > back_s && Errors::are_of(snapshot) {
            found_s = Some(snapshot.time_s - back_s);
        }
        found_s.is_some()
    };
    movements.work(session, AWAY_S[1], |snapshot| {
        evaluate(snapshot);
        false
    });
    if carrying {
        session.order(equipoise_simulator::motion::Worker::put_down);
    }
    movements.work(session, PATIENCE_S, &mut evaluate);
    movements.work(session, EVALUATED_S, |snapshot| {
        errors.add(snapshot);
        false
    });
    session.order(|worker, at_s| worker.lift(BOX_KG, at_s));
    let is_published = |snapshot: &Snapshot| !snapshot.state.validity().any_of(Validity::INVALIDATES_TORQUES);
    let publishes_torques = movements.work(session, LIFTING_S, is_published);
    session.order(equipoise_simulator::motion::Worker::put_down);
    Outcome { restart, carrying, found_s, publishes_torques, errors }
}

/// The table.
pub fn study(cohort: &Cohort) -> Vec<Table> {
    let subjects = cohort.subjects();
    let outcomes: Vec<Outcome> = map_in_parallel(&subjects, |subject| {
        restarts(subject, |random| Restart::ALL[(4.0 * random.unit()) as usize % 4])
    })
    .into_iter()
    .flatten()
    .collect();
    let mut table = Table::new(
        format!("Restarts during work ({} subjects, {RESTARTS} restarts each)", cohort.count),
        &[
            "restarted",
            "carrying",
            "count",
            "position estimated",
            "within 10 s",
            "torques valid",
            "median s",
            "maximum s",
            "CoP error mm",
            "CoP maximum mm",
            "pelvis maximum mm",
            "beyond 3 sigma %",
        ],
    );
    for restart in Restart::ALL {
        for carrying in [false, true] {
            let of: Vec<&Outcome> = outcomes
                .iter()
                .filter(|outcome| outcome.restart == restart && outcome.carrying == carrying)
                .collect();
            let seconds: Vec<f64> = of.iter().filter_map(|outcome| outcome.found_s).collect();
            let mut errors = Errors::default();
            of.iter().for_each(|outcome| errors.merge(&outcome.errors));
            let row: Vec<Cell> = vec![
                restart.name().into(),
                if carrying { "yes" } else { "no" }.into(),
                (of.len() as u64).into(),
                (seconds.len() as u64).into(),
                (seconds.iter().filter(|seconds| **seconds <= SOON_S).count() as u64).into(),
                (of.iter().filter(|outcome| outcome.publishes_torques).count() as u64).into(),
                quartiles(seconds.clone()).map(|[_, median, _]| median).into(),
                seconds.iter().copied().reduce(f64::max).into(),
                (1e3 * errors.cop_rms_m()).into(),
                (1e3 * errors.cop_max_m).into(),
                (1e3 * errors.pelvis_max_m).into(),
                percent(errors.beyond_three_sigma, errors.published).into(),
            ];
            table.push(row);
        }
    }
    table.note("squats and bends at natural speed; the suit's new origin is up to 2 m off on each axis, with any heading");
    table.note("median s, maximum s: time from the return of all devices until the position is estimated, by sample time; a carried load is put down 4 s after the restart");
    table.note("errors: of all values published from the restart on, relative to the simulated person");
    vec![table]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_restart_publishes_a_wrong_centre_of_pressure() {
        let (mut all_published, mut all_beyond) = (0, 0);
        // Motion that says little about the heading takes longer in one of 20 restarts of a suit (docs/state.md).
        let (mut times, mut late) = (0, 0);
        let seeds = [0, 1, 2];
        let all = map_in_parallel(&seeds, |seed| {
            restarts(&Subject::random(*seed), |random| Restart::ALL[(4.0 * random.unit()) as usize % 4])
        });
        for (seed, outcomes) in seeds.iter().zip(all) {
            for outcome in outcomes {
                let found_s = outcome.found_s.unwrap_or(f64::INFINITY);
                assert!(found_s < AWAY_S[1] + SOON_S, "{seed}: {outcome:?}");
                times += 1;
                late += u32::from(found_s > SOON_S && !outcome.carrying);
                assert!(outcome.publishes_torques, "{seed}: {outcome:?}");
                let Errors { published, cop_max_m, beyond_three_sigma, .. } = outcome.errors;
                assert!(published > 300, "{seed}: {outcome:?}");
                (all_published, all_beyond) = (all_published + published, all_beyond + beyond_three_sigma);
                assert!(cop_max_m < 0.15 && outcome.errors.cop_rms_m() < 0.03, "{seed}: {outcome:?}");
            }
        }
        assert!(all_beyond * 50 < all_published, "{all_beyond} of {all_published}");
        assert!(late * 10 <= times, "{late} of {times} restarts later than {SOON_S} s");
    }
}
