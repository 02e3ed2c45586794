//! Natural work without a single static pose: whether it identifies a worker, and the resulting accuracy for an
//! unloaded worker and for a carry at the same pace.

use equipoise_core::cycle::Settings;
use equipoise_core::message::Validity;
use equipoise_core::message::command::CommandKind;
use equipoise_simulator::intention::{Arm, Intention};
use equipoise_simulator::random::Random;
use equipoise_simulator::repertoire::{BOX_LOW, box_in_front};

use crate::clocks::{self, Reading};
use crate::lifting::PublicationTally;
use crate::sensors::Rig;
use crate::session::{Session, Snapshot};
use crate::subject::{Cohort, Subject, map_in_parallel};
use crate::table::{Cell, Table};
use crate::tally::{Coverage, Sums, percent, quartiles};
use crate::tasks::CopErrors;

/// Suit sample rate, and other rates of the second table.
const SUIT_HZ: u32 = 100;
const OTHER_RATES_HZ: [u32; 4] = [30, 60, 120, 240];
/// Duration of a movement's phase, from one end to the next, s.
const PHASE_S: [f64; 2] = [1.0, 2.0];
/// Duration of a movement relative to its phase: the next one begins before it has come to rest.
const OVERLAP: f64 = 1.4;
/// Delay of the plate's stamps, s, and rate of its clock relative to the suit's, ppm.
const PLATE_LATE_S: f64 = 0.138;
const PLATE_DRIFT_PPM: f64 = -400.0;
/// Times at which the clock estimates are compared with the truth, s.
const READ_S: [f64; 2] = [60.0, 300.0];
/// Identification is stopped by command after this, s.
const LEARNING_MAX_S: f64 = 120.0;
/// Held-out unloaded work, s.
const HELD_OUT_S: f64 = 30.0;
/// The box, kg.
const BOX_KG: f64 = 11.0;
/// Carries of one subject.
const CARRIES: usize = 2;
/// Identification must resume within this time after the box was put down, s.
const RESUME_MAX_S: f64 = 20.0;
/// From this fraction of its mass on the hands a box counts as lifted.
const LIFTED: f64 = 0.999;

/// Results of one subject.
#[derive(Debug, Clone, Default)]
pub struct SessionResult {
    /// From the first sample to the end of identification, s; `None` if it was stopped by command.
    identified_s: Option<f64>,
    /// Error of the measured body mass, kg.
    mass_error_kg: f64,
    /// Predicted standard deviation of the CoP at the end of identification, m.
    predicted_cop_sigma_m: f64,
    held_out: CopErrors,
    coverage: [Coverage; 2],
    unloaded: PublicationTally,
    carry: PublicationTally,
    /// Estimated minus true mass of the box, kg, over samples that publish it.
    box_error_kg: Sums,
    /// From the release of the box until motion samples update the filter again, s.
    resumed_s: Vec<f64>,
    /// Static poses used, and rows in motion.
    rows: [u32; 2],
    /// Skew and drift of the clocks at [`READ_S`].
    clocks: [Option<Reading>; 2],
}

/// Draws natural movements: each has its own amplitude, and none comes to rest.
#[derive(Clone)]
pub struct Movements {
    random: Random,
    index: usize,
    /// Time at which the next movement replaces the present one, s.
    next_s: f64,
}

impl Movements {
    /// The movements of a subject.
    pub fn of(subject: &Subject) -> Movements {
        Movements { random: Random::new(subject.seed, "natural work"), index: 0, next_s: 0.0 }
    }

    /// Works for this duration, s, or until `done` returns true. Returns whether it did.
    pub fn work(
        &mut self,
        session: &mut Session,
        for_s: f64,
        mut done: impl FnMut(&Snapshot) -> bool,
    ) -> bool {
        let end_s = session.now_s() + for_s;
        while session.now_s() < end_s {
            // A movement cut short in its middle would be an impact, not work.
            if session.now_s() >= self.next_s {
                let intention = self.next(self.index);
                self.index += 1;
                self.next_s = session.now_s() + self.begin(session, &intention);
            }
            // Within a rounding error of the end, time would not advance.
            let left_s = (self.next_s.min(end_s) - session.now_s()).max(1e-6);
            if session.run_until(left_s, &mut done) {
                return true;
            }
        }
        false
    }

    /// Arms of a movement differ a little from one to the next.
    fn varied(&mut self, arm: Arm) -> Arm {
        Arm {
            elevation_deg: arm.elevation_deg + self.random.between(-10.0, 10.0),
            elbow_deg: arm.elbow_deg + self.random.between(-7.5, 7.5),
            ..arm
        }
    }

    fn twist_deg(&mut self) -> f64 {
        self.random.between(-25.0, 25.0)
    }

    /// The lower end of a squat lift.
    fn squat(&mut self) -> Intention {
        let tilt_deg = self.random.between(25.0, 38.0);
        Intention {
            pelvis_drop: self.random.between(0.22, 0.34),
            pelvis_deg: [tilt_deg, 0.0, 0.0],
            trunk_flex_deg: self.random.between(5.0, 25.0),
            ..Intention::STAND.at_box(self.varied(BOX_LOW))
        }
    }

    /// The lower end of a bend, perhaps to a side.
    fn bend(&mut self) -> Intention {
        let (tilt_deg, twist_deg) = (self.random.between(20.0, 35.0), self.twist_deg());
        Intention {
            pelvis_deg: [tilt_deg, 0.0, 0.3 * twist_deg],
            trunk_flex_deg: self.random.between(20.0, 35.0),
            trunk_twist_deg: twist_deg,
            ..Intention::STAND.at_box(self.varied(BOX_LOW))
        }
    }

    /// The upper end: hands in front of the belly, or farther out, perhaps turned.
    fn upright(&mut self) -> Intention {
        let (twist_deg, out) = (self.twist_deg(), self.random.unit());
        Intention {
            pelvis_deg: [0.0, 0.0, 0.3 * twist_deg],
            trunk_twist_deg: twist_deg,
            ..Intention::STAND.at_box(self.varied(box_in_front(out)))
        }
    }

    /// Starts a movement; returns its phase, s.
    fn begin(&mut self, session: &mut Session, intention: &Intention) -> f64 {
        let phase_s = self.random.between(PHASE_S[0], PHASE_S[1]);
        session.order(|worker, at_s| worker.intend(intention, at_s, OVERLAP * phase_s));
        phase_s
    }

    /// Alternates between lower and upper end.
    fn next(&mut self, index: usize) -> Intention {
        match index % 4 {
            0 => self.squat(),
            2 => self.bend(),
            _ => self.upright(),
        }
    }
}

/// The subject's sensors with a suit of this rate, and a plate with delay and drift.
pub fn rig(subject: &Subject, suit_hz: u32) -> Rig {
    Rig { suit_hz, ground_late_s: PLATE_LATE_S, ground_drift_ppm: PLATE_DRIFT_PPM, ..subject.rig() }
}

/// Works without a load until identification ends, continues, carries a box, and continues until `end_s`.
pub fn simulate(subject: &Subject, settings: Settings, rig: Rig, end_s: f64) -> SessionResult {
    let mut session = Session::with(subject, settings, rig, subject.habits());
    let mut movements = Movements::of(subject);
    let mut result = SessionResult::default();
    let mut index = 0;
    while session.now_s() < LEARNING_MAX_S && result.identified_s.is_none() {
        let intention = movements.next(index);
        let phase_s = movements.begin(&mut session, &intention);
        if session.run_until(phase_s, |snapshot| snapshot.state.converged == 1) {
            result.identified_s = Some(session.now_s());
        }
        index += 1;
        result.read_clocks(&session, &rig);
    }
    if result.identified_s.is_none() {
        session.command(CommandKind::IdentifyStop);
    }
    session.run(2.0, |_| {});
    let state = session.state();
    result.mass_error_kg = state.mass_kg - subject.mass_kg;
    result.predicted_cop_sigma_m = state.predicted_cop_sigma_m;
    result.rows = [state.poses_used, state.motion_samples_used];
    let held_out_until_s = session.now_s() + HELD_OUT_S;
    while session.now_s() < held_out_until_s {
        let intention = movements.next(index);
        let phase_s = movements.begin(&mut session, &intention);
        session.run(phase_s, |snapshot| {
            result.held_out.add(snapshot);
            result.unloaded.add(snapshot.state);
            if crate::tasks::publishes_cop(snapshot.state) {
                for axis in 0..2 {
                    let measured_m = snapshot.truth().cop_without_load_in_motion_m[axis];
                    let error_m = snapshot.state.cop_estimated_m[axis] - measured_m;
                    result.coverage[axis].add(error_m, snapshot.state.cop_sigma_m[axis]);
                }
            }
        });
        index += 1;
        result.read_clocks(&session, &rig);
    }
    for _ in 0..CARRIES {
        carry(&mut session, &mut movements, &mut result);
    }
    while session.now_s() < end_s {
        let intention = movements.next(index);
        let phase_s = movements.begin(&mut session, &intention);
        session.run(phase_s, |_| {});
        index += 1;
        result.read_clocks(&session, &rig);
    }
    result
}

impl SessionResult {
    fn read_clocks(&mut self, session: &Session, rig: &Rig) {
        for (at_s, kept) in READ_S.iter().zip(&mut self.clocks) {
            if kept.is_none() && session.now_s() >= *at_s {
                *kept = clocks::read(session, rig);
            }
        }
    }
}

/// Squats to the box, carries it and puts it down in a squat, and continues without it.
fn carry(session: &mut Session, movements: &mut Movements, result: &mut SessionResult) {
    let first = movements.squat();
    let mut phase_s = movements.begin(session, &first);
    session.run(phase_s, |_| {});
    session.order(|worker, at_s| worker.lift(BOX_KG, at_s));
    for step in 0..8 {
        let intention = if step == 7 { movements.squat() } else { movements.upright() };
        phase_s = movements.begin(session, &intention);
        session.run(phase_s, |snapshot| {
            if snapshot.worker.sample(snapshot.time_s).load_kg < LIFTED * BOX_KG {
                return;
            }
            result.carry.add(snapshot.state);
            if !snapshot.state.validity().any_of(Validity::INVALIDATES_LIFTED_MASS) {
                result.box_error_kg.add(snapshot.state.lifted_mass_kg - BOX_KG);
            }
        });
    }
    session.order(equipoise_simulator::motion::Worker::put_down);
    let let_go_s = session.now_s();
    // Identification has resumed when rows in motion are accepted again.
    session.command(CommandKind::IdentifyStart);
    let mut resumed_s = None;
    for step in 0.. {
        let used = session.state().motion_samples_used;
        let intention = movements.next(1 + step);
        phase_s = movements.begin(session, &intention);
        let resumed = session.run_until(phase_s, |snapshot| {
            let more = snapshot.state.motion_samples_used > used;
            if more && resumed_s.is_none() {
                resumed_s = Some(snapshot.time_s - let_go_s);
            }
            more
        });
        if resumed || session.now_s() - let_go_s > RESUME_MAX_S {
            break;
        }
    }
    session.command(CommandKind::IdentifyStop);
    result.resumed_s.push(resumed_s.unwrap_or(RESUME_MAX_S));
    session.run(2.0, |_| {});
}

/// Results of all subjects.
#[derive(Debug, Default)]
struct Together {
    identified_s: Vec<f64>,
    resumed_s: Vec<f64>,
    sum: SessionResult,
}

impl Together {
    fn of(results: &[SessionResult]) -> Together {
        let mut all = Together::default();
        for result in results {
            all.identified_s.extend(result.identified_s);
            all.resumed_s.extend(&result.resumed_s);
            all.sum.box_error_kg.merge(&result.box_error_kg);
            all.sum.held_out.merge(&result.held_out);
            all.sum.unloaded.merge(&result.unloaded);
            all.sum.carry.merge(&result.carry);
            for (sum, coverage) in all.sum.coverage.iter_mut().zip(&result.coverage) {
                sum.merge(coverage);
            }
        }
        all
    }

    fn row(&self, rate_hz: u32) -> Vec<Cell> {
        let slowest = |seconds: &[f64]| seconds.iter().copied().reduce(f64::max);
        let [forward, sideways] = self.sum.coverage.map(|coverage| coverage.percent());
        vec![
            u64::from(rate_hz).into(),
            (self.identified_s.len() as u64).into(),
            quartiles(self.identified_s.clone()).map(|[_, median, _]| median).into(),
            slowest(&self.identified_s).into(),
            (1e3 * self.sum.held_out.distance_rms_m()).into(),
            forward[0].into(),
            sideways[0].into(),
            forward[1].into(),
            sideways[1].into(),
            percent(self.sum.unloaded.published, self.sum.unloaded.samples).into(),
            percent(self.sum.unloaded.coloured, self.sum.unloaded.samples).into(),
            withheld_percent(&self.sum.carry).into(),
            self.sum.carry.reasons().as_str().into(),
            self.sum.box_error_kg.mean().into(),
            self.sum.box_error_kg.rms().into(),
            slowest(&self.resumed_s).into(),
        ]
    }
}

fn withheld_percent(carry: &PublicationTally) -> Option<f64> {
    percent(carry.samples - carry.published, carry.samples)
}

/// The tables.
pub fn study(cohort: &Cohort) -> Vec<Table> {
    let subjects = cohort.subjects();
    let ask = |suit_hz: u32, end_s: f64| {
        map_in_parallel(&subjects, |subject| {
            simulate(subject, subject.settings(), rig(subject, suit_hz), end_s)
        })
    };
    let results = ask(SUIT_HZ, READ_S[1]);
    let each = subject_table(&subjects, &results);
    let mut rates = rate_table(cohort.count);
    rates.push(Together::of(&results).row(SUIT_HZ));
    for rate_hz in OTHER_RATES_HZ {
        rates.push(Together::of(&ask(rate_hz, 0.0)).row(rate_hz));
    }
    vec![each, rates]
}

/// One row per subject.
fn subject_table(subjects: &[Subject], results: &[SessionResult]) -> Table {
    let count = subjects.len();
    let mut table = Table::new(
        format!("Natural work without static poses ({count} subjects, suit at {SUIT_HZ} Hz)"),
        &[
            "seed",
            "identified s",
            "poses",
            "motion samples",
            "mass error kg",
            "predicted CoP sigma mm",
            "CoP error mm",
            "box error kg",
            "carry withheld %",
            "resumed s",
            "60 s: lag error ms",
            "60 s: drift error ppm",
            "300 s: lag error ms",
            "300 s: drift error ppm",
        ],
    );
    for (subject, result) in subjects.iter().zip(results) {
        let mut row: Vec<Cell> = vec![
            subject.seed.into(),
            result.identified_s.into(),
            u64::from(result.rows[0]).into(),
            u64::from(result.rows[1]).into(),
            result.mass_error_kg.into(),
            (1e3 * result.predicted_cop_sigma_m).into(),
            (1e3 * result.held_out.distance_rms_m()).into(),
            result.box_error_kg.mean().into(),
            withheld_percent(&result.carry).into(),
            result.resumed_s.iter().copied().reduce(f64::max).into(),
        ];
        for reading in result.clocks {
            row.push(reading.map(|reading| 1e3 * reading.error_s).into());
            row.push(reading.map(|reading| 1e6 * reading.drift_error).into());
        }
        table.push(row);
    }
    table.note("squats and bends of 1 to 2 s a phase, each started before the previous one has ended; soft tissue, offset of the suit's world, plate delayed by 138 ms with a drift of -400 ppm");
    table.note(
        "identified: from the first sample until the stop rule is met; empty: stopped by a command after 120 s",
    );
    table.note("CoP error: RMS distance of estimated from measured over 30 s of other movements; 1-sigma, 2-sigma: coverage of the true CoP");
    table
        .note("resumed: from the release of 11 kg until motion samples are accepted, maximum of two carries");
    table
}

/// Without rows; see [`Together::row`].
fn rate_table(count: usize) -> Table {
    Table::new(
        format!("Natural work by sample rate of the suit ({count} subjects)"),
        &[
            "suit Hz",
            "identified",
            "median s",
            "maximum s",
            "CoP error mm",
            "forward 1-sigma %",
            "sideways 1-sigma %",
            "forward 2-sigma %",
            "sideways 2-sigma %",
            "unloaded: torques %",
            "unloaded: above green %",
            "carry withheld %",
            "most frequent reasons",
            "box bias kg",
            "box RMS kg",
            "resumed s",
        ],
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn natural_work_without_a_held_pose_identifies_by_default() {
        let subject = Subject::random(5);
        let result = simulate(&subject, subject.settings(), rig(&subject, SUIT_HZ), 0.0);
        assert!(result.identified_s.is_some_and(|seconds| seconds < 60.0), "{:?}", result.identified_s);
        assert!(result.mass_error_kg.abs() < 0.4, "{}", result.mass_error_kg);
        assert!(result.held_out.distance_rms_m() < 0.009, "{}", result.held_out.distance_rms_m());
        assert!(withheld_percent(&result.carry).is_some_and(|percent| percent < 2.0), "{:?}", result.carry);
        assert!(result.resumed_s.iter().all(|seconds| *seconds < 3.0), "{:?}", result.resumed_s);
    }
}
