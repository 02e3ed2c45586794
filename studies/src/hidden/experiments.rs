//! Summary of the experiments that the program asked for: how often they decided, and whether rightly.

use std::collections::BTreeMap;

use super::evaluation::{Class, Evaluation};
use super::scenario::{Experiment, Performed};
use super::summary::is_detectable;
use super::truth::Outcome;
use crate::table::{Cell, Table};

/// Edges of the bins of the stated probability that an experiment decides.
const DECIDES_BINS: [f64; 5] = [0.0, 0.2, 0.5, 0.8, 1.1];

/// A row: its name, and the sessions that it counts.
type Group = (&'static str, fn(&Evaluation) -> bool);

/// Sessions by what is hidden: description, and whether a session belongs to it.
const GROUPS: [Group; 5] = [
    ("single from the detectable size on", is_detectable),
    ("other single", |one| one.class == Class::Single && !is_detectable(one)),
    ("pair", |one| one.class == Class::Pair),
    ("clean", |one| one.class == Class::Clean),
    ("outside the catalogue", |one| one.class == Class::Outside),
];

/// The tables; none if no experiment was performed.
pub fn tables(evaluated: &[Evaluation]) -> Vec<Table> {
    let most = evaluated.iter().map(|one| one.experiments.len()).max().unwrap_or(0);
    if most == 0 {
        Vec::new()
    } else {
        vec![outcomes(evaluated, most), asked(evaluated), calibration(evaluated)]
    }
}

fn outcomes(evaluated: &[Evaluation], most: usize) -> Table {
    let columns = ["hidden", "experiments", "sessions", "right", "wrong", "undecided"];
    let mut table = Table::new("Outcomes after at most this many experiments", &columns);
    for (what, belongs) in GROUPS {
        let of: Vec<&Evaluation> = evaluated.iter().filter(|one| belongs(one)).collect();
        for after in (0..=most).filter(|_| !of.is_empty()) {
            let count =
                |outcome: Outcome| of.iter().filter(|one| one.outcome_after(after) == outcome).count() as u64;
            table.push(vec![
                what.into(),
                (after as u64).into(),
                (of.len() as u64).into(),
                count(Outcome::Right).into(),
                count(Outcome::Wrong).into(),
                count(Outcome::Undecided).into(),
            ]);
        }
    }
    table.note("right: named with right names only; clean: none; outside the catalogue: unexplained or a declared family");
    table.note("wrong: named with a wrong name");
    table
}

/// Every experiment performed, with the stated probability that it decides, and whether it did.
fn performed(evaluated: &[Evaluation]) -> impl Iterator<Item = (&Performed, bool)> {
    evaluated.iter().flat_map(|one| {
        let last = one.experiments.len();
        one.experiments
            .iter()
            .enumerate()
            .map(move |(number, each)| (each, number + 1 == last && one.decided))
    })
}

/// Number, mean stated probability and observed frequency of decisions, as cells.
fn decisions(of: &[(&Performed, bool)]) -> [Cell; 3] {
    let count = of.len() as f64;
    let stated = of.iter().map(|(each, _)| each.decides).sum::<f64>() / count;
    let decided = of.iter().filter(|(_, decided)| *decided).count() as f64 / count;
    [(of.len() as u64).into(), Cell::Number(100.0 * stated), Cell::Number(100.0 * decided)]
}

fn asked(evaluated: &[Evaluation]) -> Table {
    let mut table =
        Table::new("Experiments asked", &["experiment", "number", "mean stated to decide %", "decided %"]);
    let mut kinds: BTreeMap<&str, Vec<(&Performed, bool)>> = BTreeMap::new();
    for (each, decided) in performed(evaluated) {
        kinds.entry(kind(&each.experiment)).or_default().push((each, decided));
    }
    for (kind, of) in kinds {
        table.push([vec![kind.into()], decisions(&of).to_vec()].concat());
    }
    table
}

fn kind(experiment: &Experiment) -> &'static str {
    match experiment {
        Experiment { fast: true, .. } => "quick squats",
        Experiment { still_s, .. } if *still_s > 0.0 => "standing",
        Experiment { step_m, .. } if *step_m != [0.0; 2] => "step",
        Experiment { turn_deg, .. } if *turn_deg != 0.0 => "poses after a turn",
        _ => "poses",
    }
}

fn calibration(evaluated: &[Evaluation]) -> Table {
    let mut table = Table::new(
        "Stated probability that an experiment decides",
        &["stated from", "to", "experiments", "mean stated %", "decided %"],
    );
    for bin in DECIDES_BINS.windows(2) {
        let of: Vec<(&Performed, bool)> =
            performed(evaluated).filter(|(each, _)| (bin[0]..bin[1]).contains(&each.decides)).collect();
        if !of.is_empty() {
            let edges = vec![Cell::Number(bin[0]), Cell::Number(bin[1].min(1.0))];
            table.push([edges, decisions(&of).to_vec()].concat());
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hidden::evaluation::evaluate;
    use crate::hidden::evaluation::tests::{finding, truth};
    use serde_json::json;

    /// A session with a hidden load after some experiments, given by their stated probability and the finding before.
    fn session(named: &str, hand: &str, experiments: &[(f64, Outcome)]) -> Evaluation {
        let truth = truth(&[("hand_load", Some(("hand", "right")), ("mass_kg", 0.5))]);
        let found = finding(named, &[("hand_load", json!({"hand": hand}), json!({}))], &[]);
        let experiment = Experiment { turn_deg: 90.0, poses: vec!["T-pose".into()], ..Experiment::default() };
        let performed = |&(decides, before)| Performed { experiment: experiment.clone(), decides, before };
        Evaluation {
            decided: named == "named",
            experiments: experiments.iter().map(performed).collect(),
            ..evaluate(&truth, Ok(&found), None, 1.0)
        }
    }

    #[test]
    fn sessions_are_counted_before_and_after_each_experiment() {
        use Outcome::Undecided;
        let evaluated = [
            session("named", "right", &[]),
            session("named", "right", &[(0.9, Undecided)]),
            session("named", "left", &[(0.3, Undecided), (0.6, Undecided)]),
            session("ambiguous", "right", &[(0.1, Undecided)]),
        ];
        let [outcomes, asked, calibration] = tables(&evaluated).try_into().unwrap();
        let counts = |table: &Table, from: usize| -> Vec<Vec<Cell>> {
            table.rows().iter().map(|row| row[from..].to_vec()).collect()
        };
        let cells = |counts: [u64; 5]| counts.map(Cell::Count).to_vec();
        // After 0, 1 and 2 experiments: sessions, right, wrong, undecided.
        let expected = [[0, 4, 1, 0, 3], [1, 4, 2, 0, 2], [2, 4, 2, 1, 1]];
        assert_eq!(counts(&outcomes, 1), expected.map(cells));
        assert_eq!(asked.rows()[0][..2], ["poses after a turn".into(), Cell::Count(4)]);
        let [_, _, _, Cell::Number(stated), Cell::Number(decided)] = calibration.rows()[0][..] else {
            panic!()
        };
        assert!((stated - 10.0).abs() < 1e-9 && decided == 0.0, "{stated} {decided}");
        assert_eq!(calibration.rows().len(), 4, "{:?}", calibration.rows());
        assert_eq!(calibration.rows()[3][4], Cell::Number(100.0));
        // The first experiment of the third session did not decide, the second did.
        assert_eq!(
            [1, 2].map(|row: usize| calibration.rows()[row][4].clone()),
            [0.0, 100.0].map(Cell::Number)
        );
    }

    #[test]
    fn no_experiment_no_table() {
        assert!(tables(&[session("named", "right", &[])]).is_empty());
    }

    #[test]
    fn a_verdict_is_right_by_what_is_hidden() {
        let found =
            |verdict: &str, name: &str| finding(verdict, &[(name, json!({"hand": "right"}), json!({}))], &[]);
        let of = |hidden: &[_], finding| evaluate(&truth(hidden), Ok(&finding), None, 1.0).outcome();
        let load = [("hand_load", Some(("hand", "right")), ("mass_kg", 0.5))];
        let outside = [("outside", None, ("of", 1.0))];
        assert_eq!(of(&load, found("named", "hand_load")), Outcome::Right);
        assert_eq!(of(&load, found("named", "hand_contact")), Outcome::Wrong);
        assert_eq!(of(&load, found("ambiguous", "hand_load")), Outcome::Undecided);
        assert_eq!(of(&load, finding("none", &[], &[])), Outcome::Undecided);
        assert_eq!(of(&[], finding("none", &[], &[])), Outcome::Right);
        assert_eq!(of(&[], found("named", "hand_load")), Outcome::Wrong);
        assert_eq!(of(&outside, finding("unexplained", &[], &[])), Outcome::Right);
        assert_eq!(of(&outside, found("named", "hand_load")), Outcome::Wrong);
    }
}
