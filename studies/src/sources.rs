//! Effect of other sensors: a suit that sends its own accelerations, insoles in place of a plate.

use equipoise_core::cycle::{Accelerations, Settings};
use equipoise_core::message::Validity;

use crate::lifting::see_lifted;
use crate::sensors::{AccelerationNoise, Ground, Rig};
use crate::session::{Session, Snapshot};
use crate::subject::{Cohort, Subject, map_in_parallel};
use crate::table::{Cell, Table};
use crate::tally::{ByGroup, GROUPS, Sums, percent};
use crate::tasks::{CopErrors, publishes_cop};

/// The box that is lifted, kg.
const BOX_KG: f64 = 8.0;
/// Poses for the identification before.
const POSES_MAX: u32 = 30;
/// Steps of marching on the spot.
const STEPS: u32 = 8;
/// Joints of the tables: those independent of the foot load fractions.
const SHOWN: [&str; 3] = ["shoulder", "elbow", "back"];

/// Suits by their data, as named in the tables.
const SUITS: [(&str, Option<AccelerationNoise>); 4] = [
    ("none", None),
    ("exact", Some(AccelerationNoise::NONE)),
    ("white noise", Some(AccelerationNoise { bias_m_per_s2: 0.0, ..AccelerationNoise::ORDINARY })),
    ("noise and tilt", Some(AccelerationNoise::ORDINARY)),
];
const HOW: [(&str, Accelerations); 3] =
    [("positions", Accelerations::Positions), ("suit", Accelerations::Suit), ("blend", Accelerations::Blend)];
const GROUNDS: [(&str, Ground); 3] =
    [("plate", Ground::Plate), ("two plates", Ground::TwoPlates), ("insoles", Ground::Insoles)];

/// Results of one subject with one set of sensors.
#[derive(Debug, Clone, Copy, Default)]
pub struct Findings {
    poses: Sums,
    /// Standing, natural motion, and marching, all without a load.
    still: CopErrors,
    work: CopErrors,
    march: CopErrors,
    /// Vertical external force without a load, N.
    force_n: [Sums; 2],
    published_unloaded: [u64; 2],
    torques: ByGroup,
    published: [u64; 2],
}

impl Findings {
    fn merge(&mut self, other: &Findings) {
        self.poses.merge(&other.poses);
        for (sum, other) in
            [(&mut self.still, &other.still), (&mut self.work, &other.work), (&mut self.march, &other.march)]
        {
            sum.merge(other);
        }
        for (sum, other) in self.force_n.iter_mut().zip(&other.force_n) {
            sum.merge(other);
        }
        for (sum, other) in
            [(&mut self.published_unloaded, other.published_unloaded), (&mut self.published, other.published)]
        {
            *sum = [sum[0] + other[0], sum[1] + other[1]];
        }
        self.torques.merge(&other.torques);
    }
}

/// Identification, then standing, work and marching without a load, and a lift.
pub fn findings(subject: &Subject, accelerations: Accelerations, rig: Rig) -> Findings {
    let settings = Settings { accelerations, ..subject.settings() };
    let mut session = Session::with(subject, settings, rig, subject.habits());
    let mut findings = Findings::default();
    findings.poses.add(f64::from(session.identify(POSES_MAX).poses));
    session.stand(2.0);
    session.run(2.0, |snapshot| findings.still.add(snapshot));
    let unloaded = |snapshot: &Snapshot,
                    cop: &mut CopErrors,
                    force_n: &mut Sums,
                    published: &mut [u64; 2]| {
        cop.add(snapshot);
        if publishes_cop(snapshot.state) && !snapshot.state.validity().any_of(Validity::INVALIDATES_DELTA_F) {
            force_n.add(snapshot.state.delta_f_n[2]);
        }
        published[0] += u64::from(!snapshot.state.validity().any_of(Validity::INVALIDATES_TORQUES));
        published[1] += 1;
    };
    session.work_unloaded(|snapshot| {
        unloaded(snapshot, &mut findings.work, &mut findings.force_n[0], &mut findings.published_unloaded);
    });
    session.stand(2.0);
    session.march(STEPS, |snapshot| {
        unloaded(snapshot, &mut findings.march, &mut findings.force_n[1], &mut findings.published_unloaded);
    });
    session.stand(2.0);
    let mut tally = crate::lifting::PublicationTally::default();
    session.lift_at_work(BOX_KG, |snapshot| see_lifted(snapshot, BOX_KG, &mut findings.torques, &mut tally));
    findings.published = [tally.published, tally.samples];
    findings
}

fn table(title: String, first: &'static str, second: &'static str) -> Table {
    Table::new(
        title,
        &[
            first,
            second,
            "poses",
            "static CoP mm",
            "work CoP mm",
            "work force N",
            "marching CoP mm",
            "marching force N",
            "published without load %",
            "shoulder N m",
            "elbow N m",
            "back N m",
            "published with load %",
        ],
    )
}

fn row(names: [&str; 2], cohort: &[Subject], ask: impl Fn(&Subject) -> Findings + Sync) -> Vec<Cell> {
    let mut sum = Findings::default();
    for findings in map_in_parallel(cohort, ask) {
        sum.merge(&findings);
    }
    let mut row: Vec<Cell> = names.map(Cell::from).to_vec();
    row.push(sum.poses.mean().into());
    row.push(Some(1e3 * sum.still.distance_rms_m()).into());
    for (cop, force_n) in [(&sum.work, &sum.force_n[0]), (&sum.march, &sum.force_n[1])] {
        row.push(Some(1e3 * cop.distance_rms_m()).into());
        row.push(force_n.rms().into());
    }
    row.push(percent(sum.published_unloaded[0], sum.published_unloaded[1]).into());
    for (group, (name, _)) in GROUPS.iter().enumerate() {
        if SHOWN.contains(name) {
            row.push(sum.torques.0[group].error_nm.rms().into());
        }
    }
    row.push(percent(sum.published[0], sum.published[1]).into());
    row
}

/// The tables.
pub fn study(cohort: &Cohort) -> Vec<Table> {
    let count = cohort.count;
    let cohort = cohort.subjects();
    let mut tables = Vec::new();
    for (ground_name, ground, suit_hz) in [
        ("a plate", Ground::Plate, 60),
        ("a plate, suit at 240 Hz", Ground::Plate, 240),
        ("insoles", Ground::Insoles, 60),
    ] {
        let title = format!("Sources of accelerations with {ground_name} ({count} subjects)");
        let mut by_suit = table(title, "suit data", "accelerations from");
        for (sends, accelerations) in SUITS {
            for (name, how) in HOW {
                if accelerations.is_some() || how == Accelerations::Positions {
                    let rig = |subject: &Subject| Rig { ground, accelerations, suit_hz, ..subject.rig() };
                    by_suit.push(row([sends, name], &cohort, |subject| findings(subject, how, rig(subject))));
                }
            }
        }
        tables.push(by_suit);
    }
    let mut by_ground =
        table(format!("Ground devices ({count} subjects)"), "ground device", "accelerations from");
    for (name, ground) in GROUNDS {
        let ask =
            |subject: &Subject| findings(subject, Accelerations::Positions, Rig { ground, ..subject.rig() });
        by_ground.push(row([name, "positions"], &cohort, ask));
    }
    by_ground.note("CoP: RMS distance of the estimated from the measured one; force: RMS of the published external force; both without a load");
    by_ground
        .note("torques: RMS length of published minus true torque while 8 kg are lifted at natural speed");
    tables.push(by_ground);
    tables
}

#[cfg(test)]
mod tests {
    use super::*;
    use equipoise_simulator::noise::Insoles;
    use equipoise_simulator::realism::{Realism, Severity};

    /// Rigid bones and exact clocks: only the ground device differs.
    fn of(ground: Ground, insoles: Insoles) -> Findings {
        let realism = Realism { soft_tissue: Severity::Ideal, clocks: Severity::Ideal, ..Realism::REALISTIC };
        let subject = Subject { realism, ..Subject::random(5) };
        findings(&subject, Accelerations::Positions, Rig { ground, insoles, ..subject.rig() })
    }

    /// Measured centres of pressure of natural motion by time, a suit without error, m.
    fn centres_m(ground: Ground) -> Vec<(f64, [f64; 2])> {
        let subject = Subject::random(5);
        let rig = Rig { ground, ..Rig::PERFECT };
        let mut session = Session::with(&subject, subject.settings(), rig, subject.habits());
        session.run(1.0, |_| {});
        session.order(|worker, at_s| worker.intend(&equipoise_simulator::repertoire::LIFTING[3], at_s, 0.8));
        let mut published = Vec::new();
        session.run(1.5, |snapshot| {
            if publishes_cop(snapshot.state) {
                published.push((snapshot.time_s, snapshot.state.cop_measured_m));
            }
        });
        published
    }

    #[test]
    fn where_insoles_put_the_centre_is_where_plates_measure_it_but_for_where_the_sole_s_middle_is() {
        let (plates, insoles) = (centres_m(Ground::TwoPlates), centres_m(Ground::Insoles));
        let both = plates.iter().filter_map(|(time_s, plates_m)| {
            let (_, insoles_m) = insoles.iter().find(|(other_s, _)| other_s == time_s)?;
            Some([0, 1].map(|axis| insoles_m[axis] - plates_m[axis]))
        });
        let apart_m: Vec<[f64; 2]> = both.collect();
        assert!(apart_m.len() > 60, "{}", apart_m.len());
        let moved_m =
            plates.iter().map(|(_, [x, _])| *x).fold(0.0_f64, |a, x| a.max((x - plates[0].1[0]).abs()));
        assert!(moved_m > 0.02, "nothing moved: {moved_m} m");
        for axis in 0..2 {
            let of_axis = || apart_m.iter().map(|apart| apart[axis]);
            let (low, high) = (of_axis().fold(f64::MAX, f64::min), of_axis().fold(f64::MIN, f64::max));
            // The simulated sole differs from the average one: its middle has a constant offset, and there is no other
            // error.
            assert!(high - low < 0.002, "axis {axis}: from {low} to {high} m");
            assert!(low.abs() < 0.03, "axis {axis}: {low} m");
        }
    }

    #[test]
    fn insoles_without_error_measure_what_two_plates_measure_except_the_shear() {
        let both =
            map_in_parallel(&[Ground::TwoPlates, Ground::Insoles], |ground| of(*ground, Insoles::NONE));
        let [plates, insoles] = both[..] else { panic!("{} results", both.len()) };
        let mm = |cop: &CopErrors| 1e3 * cop.distance_rms_m();
        assert!(mm(&insoles.still) < 6.0, "{} mm standing", mm(&insoles.still));
        // With insoles, only the suit measures the body's acceleration in motion; with plates shear does.
        let (moving, sheared) = (mm(&insoles.work), mm(&plates.work));
        assert!(moving > sheared && moving < sheared + 8.0, "{moving} mm by insoles, {sheared} mm by plates");
        for (group, known) in GROUPS.iter().enumerate() {
            let [by_insoles, by_plates] = [&insoles, &plates]
                .map(|findings| findings.torques.0[group].error_nm.rms().unwrap_or(f64::MAX));
            let name = known.0;
            assert!(
                by_insoles < 1.4 * by_plates + 3.0,
                "{name}: {by_insoles} N m, by plates {by_plates} N m"
            );
        }
        let fraction = |[published, of]: [u64; 2]| published as f64 / of as f64;
        assert!(fraction(insoles.published) > 0.6, "{}", fraction(insoles.published));
        assert!(fraction(insoles.published_unloaded) < 0.1, "{}", fraction(insoles.published_unloaded));
    }
}
