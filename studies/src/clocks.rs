//! Skew and drift between the clocks of suit and plate: injected, estimated, and the effect of the correction.

use equipoise_core::cycle::Settings;
use equipoise_core::message::Validity;
use equipoise_simulator::intention::Intention;
use equipoise_simulator::repertoire::{BOX_LOW, LIFTING};

use crate::sensors::Rig;
use crate::session::{Session, Snapshot};
use crate::subject::{Cohort, Subject, map_in_parallel};
use crate::table::{Cell, Table};
use crate::tasks::{CopErrors, publishes_cop};

/// Squat lifts and bends until this time, s.
const SESSION_S: f64 = 300.0;
/// Mass of the box, kg.
const BOX_KG: f64 = 11.0;
/// Time of the delay's change in the last case, s, and its size, s.
const STEP: (f64, f64) = (150.0, 0.300);
/// Times at which the estimates are compared with the truth, s.
const READ_S: [f64; 3] = [30.0, 60.0, 295.0];
/// Interval at which the lag in use is sampled, s.
const SLICE_S: f64 = 0.1;
/// Alignment error from which a sample counts as wrongly aligned, s.
const WRONG_S: f64 = 0.020;

/// The plate's delay, s, its drift, ppm, and a change of the delay.
type Case = (&'static str, f64, f64, Option<(f64, f64)>);

const CASES: [Case; 7] = [
    ("0 ms", 0.0, 0.0, None),
    ("43 ms", 0.043, 0.0, None),
    ("138 ms", 0.138, 0.0, None),
    ("138 ms, -400 ppm", 0.138, -400.0, None),
    ("-250 ms, +1000 ppm", -0.250, 1000.0, None),
    ("480 ms, -100 ppm", 0.480, -100.0, None),
    ("43 ms, +300 ms at 150 s", 0.043, 0.0, Some(STEP)),
];

/// The estimate at one time: errors of skew, s, and drift, s/s, each with the published 1-σ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Error of the skew, s.
    pub error_s: f64,
    /// 1-σ of the skew, s.
    pub sigma_s: f64,
    /// Error of the drift, s/s.
    pub drift_error: f64,
    /// 1-σ of the drift, s/s.
    pub drift_sigma: f64,
}

/// Sums over a session.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    /// The estimates at [`READ_S`].
    readings: [Option<Reading>; 3],
    /// Time from which the skew is published, s.
    sure_s: Option<f64>,
    /// Number of comparisons of the estimate with the truth, and of those within 1 and 2 σ.
    covered: [u64; 3],
    /// Samples, samples masked as unsynchronised, and unmasked samples with a wrong alignment; before and after the
    /// change of the delay or, without one, all before.
    samples: [[u64; 3]; 2],
    /// Centre of pressure without a load.
    cop: CopErrors,
}

/// Squat lifts and bends at a natural pace, about 11 s; `with_box`: a box is picked up in the first squat and put down
/// in the second. `see` receives every new state, and the lag in use, s.
pub fn lift_round(session: &mut Session, with_box: bool, pause_s: f64, mut see: impl FnMut(&Snapshot, f64)) {
    let stand = LIFTING[1];
    let low = stand.at_box(BOX_LOW);
    let squat = Intention { pelvis_drop: 0.32, pelvis_deg: [35.0, 0.0, 0.0], ..low };
    let bend = Intention { pelvis_deg: [40.0, 0.0, 0.0], trunk_flex_deg: 35.0, ..low };
    let script = [(squat, 1.3), (stand, 1.4), (squat, 1.2), (stand, 1.3), (bend, 1.2), (stand, 1.5)];
    let mut after_s = 0.0;
    session.order(|worker, start_s| {
        for (step, (intention, over_s)) in script.iter().enumerate() {
            worker.intend(intention, start_s + after_s, *over_s);
            let there_s = start_s + after_s + over_s;
            match step {
                0 if with_box => worker.lift(BOX_KG, there_s),
                2 if with_box => worker.put_down(there_s),
                _ => {}
            }
            after_s += over_s + pause_s;
        }
    });
    let end_s = session.now_s() + after_s;
    while session.now_s() < end_s {
        let lag_s = session.memory().skew().lag_s();
        session.run(SLICE_S, |snapshot| see(snapshot, lag_s));
    }
}

/// The estimate compared with the truth.
pub fn read(session: &Session, rig: &Rig) -> Option<Reading> {
    let skew = session.memory().skew().estimate()?;
    let sign_of_drift = -1.0;
    Some(Reading {
        error_s: skew.skew_s - rig.skew_at_s(session.now_s()),
        sigma_s: skew.sigma_s,
        drift_error: skew.drift - sign_of_drift * 1e-6 * rig.ground_drift_ppm,
        drift_sigma: skew.drift_sigma,
    })
}

fn work(subject: &Subject, (_, ground_late_s, ground_drift_ppm, step): Case, align_streams: bool) -> Sums {
    let (suit_hz, ground_delay_step) = (100, step);
    let rig = Rig { suit_hz, ground_late_s, ground_drift_ppm, ground_delay_step, ..subject.rig() };
    let settings = Settings { align_streams, ..subject.settings() };
    let mut session = Session::with(subject, settings, rig, subject.habits());
    let mut sums = Sums::default();
    session.run(2.0, |_| {});
    for index in 0.. {
        lift_round(&mut session, index % 2 == 1, 0.4 + 0.3 * f64::from(index % 3), |snapshot, lag_s| {
            let state = snapshot.state;
            let is_masked = state.validity().any_of(Validity::CLOCK_UNSYNCHRONISED);
            let is_after = step.is_some_and(|(at_s, _)| snapshot.time_s > at_s);
            let is_wrong = (lag_s - rig.skew_at_s(snapshot.time_s)).abs() > WRONG_S;
            let [samples, masked, wrong] = &mut sums.samples[usize::from(is_after)];
            *samples += 1;
            *masked += u64::from(is_masked);
            *wrong += u64::from(is_wrong && !is_masked && publishes_cop(state));
            if state.suit_skew_sigma_s > 0.0 {
                sums.sure_s = sums.sure_s.or(Some(snapshot.time_s));
            }
            if snapshot.time_s > READ_S[1]
                && !is_masked
                && snapshot.worker.sample(snapshot.time_s).load_kg == 0.0
            {
                sums.cop.add(snapshot);
            }
        });
        let reading = read(&session, &rig);
        for (at_s, kept) in READ_S.iter().zip(&mut sums.readings) {
            if kept.is_none() && session.now_s() >= *at_s {
                *kept = reading;
            }
        }
        if let Some(Reading { error_s, sigma_s, .. }) =
            reading.filter(|_| session.state().suit_skew_sigma_s > 0.0)
        {
            let within = |sigmas: f64| u64::from(error_s.abs() < sigmas * sigma_s);
            sums.covered = std::array::from_fn(|at| sums.covered[at] + [1, within(1.0), within(2.0)][at]);
        }
        if session.now_s() > SESSION_S {
            break;
        }
    }
    sums
}

fn rms(values: impl Iterator<Item = f64>) -> Cell {
    let (count, square) = values.fold((0, 0.0), |(count, square), value| (count + 1, square + value * value));
    (count > 0).then(|| (square / f64::from(count)).sqrt()).into()
}

fn percent(part: u64, of: u64) -> Cell {
    (of > 0).then(|| 100.0 * part as f64 / of as f64).into()
}

/// The tables.
pub fn study(cohort: &Cohort) -> Vec<Table> {
    let subjects = cohort.subjects();
    let questions: Vec<(Case, Subject, bool)> = CASES
        .iter()
        .flat_map(|case| subjects.iter().map(move |subject| (*case, *subject)))
        .flat_map(|(case, subject)| [false, true].map(|align| (case, subject, align)))
        .collect();
    let sums = map_in_parallel(&questions, |(case, subject, align)| work(subject, *case, *align));
    vec![skew_table(cohort.count, &sums), effect_table(cohort.count, &sums)]
}

/// The sums of each case: without the correction, with it, alternately for each subject.
fn by_case(count: usize, sums: &[Sums]) -> impl Iterator<Item = (&'static str, &[Sums])> {
    CASES.into_iter().map(|case| case.0).zip(sums.chunks(2 * count))
}

/// Those with the correction.
fn corrected(sums: &[Sums]) -> impl Iterator<Item = &Sums> {
    sums.iter().skip(1).step_by(2)
}

/// Errors of the estimated skew and drift.
fn skew_table(count: usize, sums: &[Sums]) -> Table {
    let mut table = Table::new(
        format!(
            "Skew and drift estimated from squat lifts and bends ({count} subjects): RMS error, RMS 1-sigma"
        ),
        &[
            "plate delay",
            "published after s",
            "30 s: ms",
            "30 s: sigma",
            "60 s: ms",
            "60 s: sigma",
            "60 s: ppm",
            "60 s: ppm sigma",
            "300 s: ms",
            "300 s: sigma",
            "300 s: ppm",
            "300 s: ppm sigma",
            "1-sigma %",
            "2-sigma %",
        ],
    );
    for (name, sums) in by_case(count, sums) {
        let mut row: Vec<Cell> = vec![name.into()];
        row.push(corrected(sums).map(|sums| sums.sure_s).try_fold(0.0, |a: f64, b| Some(a.max(b?))).into());
        for at in 0..READ_S.len() {
            let readings = || corrected(sums).filter_map(|sums| sums.readings[at]);
            row.push(rms(readings().map(|reading| 1e3 * reading.error_s)));
            row.push(rms(readings().map(|reading| 1e3 * reading.sigma_s)));
            if at > 0 {
                row.push(rms(readings().map(|reading| 1e6 * reading.drift_error)));
                row.push(rms(readings().map(|reading| 1e6 * reading.drift_sigma)));
            }
        }
        let [all, one, two] = [0, 1, 2].map(|at| corrected(sums).map(|sums| sums.covered[at]).sum::<u64>());
        row.extend([percent(one, all), percent(two, all)]);
        table.push(row);
    }
    table.note("suit at 100 Hz, plate at 1 kHz; every other round with a box of 11 kg; published after: time until the published sigma of the skew is below 10 ms");
    table.note("1-sigma, 2-sigma: fraction of errors of the published skew below 1 and 2 sigma, one sample per round of 11 s");
    table
}

/// Effect of the correction on the centre of pressure, and on the samples that are masked or wrongly aligned.
fn effect_table(count: usize, sums: &[Sums]) -> Table {
    let mut table = Table::new(
        format!("Effect of the lag correction ({count} subjects)"),
        &[
            "plate delay",
            "CoP not corrected mm",
            "CoP corrected mm",
            "masked %",
            "misaligned %",
            "after the change: masked s",
            "misaligned s",
        ],
    );
    for (name, sums) in by_case(count, sums) {
        let mut row: Vec<Cell> = vec![name.into()];
        for first in 0..2 {
            let mut cop = CopErrors::default();
            sums.iter().skip(first).step_by(2).for_each(|sums| cop.merge(&sums.cop));
            row.push((1e3 * cop.distance_rms_m()).into());
        }
        let of = |after: usize| {
            [0, 1, 2].map(|at| corrected(sums).map(|sums| sums.samples[after][at]).sum::<u64>())
        };
        let [samples, masked, wrong] = of(0);
        row.extend([percent(masked, samples), percent(wrong, samples)]);
        let [samples, masked, wrong] = of(1);
        let seconds = |part: u64| (samples > 0).then(|| part as f64 / 100.0 / count as f64).into();
        row.extend([seconds(masked), seconds(wrong)]);
        table.push(row);
    }
    table.note("CoP: RMS distance of estimated from measured, without a load, from 60 s on, excluding samples masked as unsynchronised");
    table.note(
        "masked: samples with clock_unsynchronised; misaligned: not masked, with an alignment error above 20 ms",
    );
    table
}
