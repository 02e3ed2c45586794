//! Summary of many evaluated findings.

use std::collections::{BTreeMap, BTreeSet};

use super::evaluation::{Class, Evaluation};
use super::experiments;
use super::ladder::{NOMINAL, RUNGS};
use crate::table::{Cell, Table};
use crate::tally::percent;

/// An effect counts as detected at a size from this fraction of sessions on.
const DETECTED: f64 = 0.8;

/// Edges of the bins of stated probabilities.
const STATED_BINS: [f64; 8] = [0.02, 0.2, 0.5, 0.8, 0.95, 0.99, 0.999, 1.1];

/// All tables.
pub fn tables(evaluated: &[Evaluation]) -> Vec<Table> {
    let mut tables = vec![
        overview(evaluated),
        reliability(evaluated),
        by_size(evaluated),
        confusion(evaluated),
        outside(evaluated),
        parameters(evaluated),
    ];
    tables.extend(experiments::tables(evaluated));
    tables
}

fn percentage(part: usize, whole: usize) -> Cell {
    if whole == 0 { Cell::Nothing } else { Cell::Number(100.0 * part as f64 / whole as f64) }
}

/// Single effects of defined size: not those present during identification.
fn singles(evaluated: &[Evaluation]) -> impl Iterator<Item = &Evaluation> {
    evaluated.iter().filter(|one| one.class == Class::Single && !one.from_beginning)
}

/// A criterion: its description, and whether a session counts and whether it is met.
type Criterion = (&'static str, fn(&Evaluation) -> bool, fn(&Evaluation) -> bool);

const CRITERIA: [Criterion; 12] = [
    ("present during identification: exact or in the family", is_early, |one| one.family),
    ("in part of the work or with a change of sign: exact or in the family", is_partial, |one| one.family),
    ("single from the detectable size on: first name right", is_detectable, |one| {
        one.named.first().is_some_and(|first| one.is_right(first))
    }),
    ("single from the detectable size on: verdict named, all names right", is_detectable, |one| {
        is_named(one) && one.names_are_right()
    }),
    ("single from the detectable size on: verdict named, a wrong name", is_detectable, |one| {
        is_named(one) && !one.names_are_right()
    }),
    ("pairs: both found", |one| one.class == Class::Pair, |one| one.found == 2),
    ("pairs: at least one found", |one| one.class == Class::Pair, |one| one.found > 0),
    ("clean: verdict named (false positive)", |one| one.class == Class::Clean, is_named),
    (
        "clean: verdict other than none, or no finding",
        |one| one.class == Class::Clean,
        Evaluation::is_false_alarm,
    ),
    (
        "outside the catalogue: unexplained, ambiguous or a declared family",
        |one| one.class == Class::Outside,
        is_outside_or_declared,
    ),
    (
        "outside the catalogue from twice the detectable size on: unexplained, ambiguous or a declared family",
        |one| one.class == Class::Outside && one.sizes.iter().all(|size| *size >= 2.0),
        is_outside_or_declared,
    ),
    ("sessions without a finding", |_| true, |one| one.verdict == "failed"),
];

fn is_early(one: &Evaluation) -> bool {
    one.class == Class::Single && one.from_beginning
}

fn is_partial(one: &Evaluation) -> bool {
    one.class == Class::Single && one.comes_and_goes
}

/// Whether one effect of at least its nominal detectable size is hidden, and not present during identification.
pub(super) fn is_detectable(one: &Evaluation) -> bool {
    one.class == Class::Single && !one.from_beginning && one.sizes.iter().all(|size| *size >= 1.0)
}

fn is_outside_or_declared(one: &Evaluation) -> bool {
    ["unexplained", "ambiguous"].contains(&one.verdict.as_str()) || one.declared
}

fn is_named(one: &Evaluation) -> bool {
    one.verdict == "named"
}

fn overview(evaluated: &[Evaluation]) -> Table {
    let mut table =
        Table::new(format!("Blind bench: {} sessions", evaluated.len()), &["criterion", "count", "of", "%"]);
    let mut add = |what: String, right: usize, of: usize| {
        table.push(vec![Cell::Text(what), (right as u64).into(), (of as u64).into(), percentage(right, of)]);
    };
    for size in RUNGS {
        let at: Vec<&Evaluation> = singles(evaluated).filter(|one| one.sizes == [size]).collect();
        let count = |is: fn(&Evaluation) -> bool| at.iter().filter(|one| is(one)).count();
        let what = format!("first named effect exact at {size} times the detectable size");
        add(what, count(|one| one.exact), at.len());
        let what = format!("first named effect exact or in the family at {size} times the detectable size");
        add(what, count(|one| one.family), at.len());
    }
    for (what, counts, is_met) in CRITERIA {
        let of: Vec<&Evaluation> = evaluated.iter().filter(|one| counts(one)).collect();
        add(what.to_owned(), of.iter().filter(|one| is_met(one)).count(), of.len());
    }
    let exact = evaluated.iter().filter(|one| one.exact).flat_map(|one| &one.parameters);
    let off: Vec<f64> = exact.map(|one| one.error_over_sigma().abs()).collect();
    let within = off.iter().filter(|off| **off <= 2.0).count();
    add("parameters of exactly named effects within 2 sigma".into(), within, off.len());
    let hidden = |one: &&Evaluation| one.class == Class::Single && one.family;
    let over: Vec<f64> = evaluated.iter().filter(hidden).filter_map(Evaluation::over_the_oracle).collect();
    add(
        "held-out gap after at most 1.1 times the oracle's, where exact or in the family".into(),
        over.iter().filter(|over| **over <= 1.1).count(),
        over.len(),
    );
    notes(&mut table, evaluated, over);
    table
}

fn notes(table: &mut Table, evaluated: &[Evaluation], over: Vec<f64>) {
    let middle = |values: Vec<f64>| {
        crate::tally::quartiles(values)
            .map_or("-".into(), |[_, median, upper]| format!("median {median:.2}, upper quartile {upper:.2}"))
    };
    table.note(format!("gap after / oracle's gap, where exact or in the family: {}", middle(over)));
    table.note(format!("run time, s: {}", middle(evaluated.iter().map(|one| one.seconds).collect())));
    let per_ten_minutes = evaluated.iter().map(|one| one.seconds / one.length_s * 600.0).collect();
    table.note(format!("run time for ten minutes of recording, s: {}", middle(per_ten_minutes)));
    table.note("oracle: gap of the clean twin before any effect is named; without twins, sqrt(gap before^2 - effect^2), not below the noise floor");
    table.note(
        "present during identification: excluded from the rows by size, because identification absorbs a part of the effect",
    );
}

/// Stated probabilities against how often the name was right.
fn reliability(evaluated: &[Evaluation]) -> Table {
    let mut table = Table::new(
        "Reliability of the stated probabilities",
        &["stated from", "to", "names", "mean stated %", "right %"],
    );
    let stated: Vec<(f64, bool)> = evaluated
        .iter()
        .flat_map(Evaluation::statements)
        .filter(|(probability, _)| *probability >= STATED_BINS[0])
        .collect();
    let mut error = 0.0;
    for bin in STATED_BINS.windows(2) {
        let inside: Vec<&(f64, bool)> =
            stated.iter().filter(|(probability, _)| (bin[0]..bin[1]).contains(probability)).collect();
        if inside.is_empty() {
            continue;
        }
        let count = inside.len() as f64;
        let mean = inside.iter().map(|(probability, _)| probability).sum::<f64>() / count;
        let right = inside.iter().filter(|(_, right)| *right).count() as f64 / count;
        error += (mean - right).abs() * count / stated.len() as f64;
        table.push(vec![
            Cell::Number(bin[0]),
            Cell::Number(bin[1].min(1.0)),
            (inside.len() as u64).into(),
            Cell::Number(100.0 * mean),
            Cell::Number(100.0 * right),
        ]);
    }
    table.note(format!("expected calibration error: {error:.3}"));
    table.note("effects with the same columns count as one name; of unexplained findings only what is outside the catalogue");
    table
}

/// Name without place.
fn name_of(label: &str) -> &str {
    label.split_once(' ').map_or(label, |(name, _)| name)
}

fn by_size(evaluated: &[Evaluation]) -> Table {
    let columns = ["effect", "x0.5", "x1", "x2", "x4", "exact %", "exact or family %"];
    let mut table = Table::new(
        "First named effect by size over the detectable size: exact / exact or family / sessions",
        &columns,
    );
    let kinds: BTreeSet<&str> = singles(evaluated).map(|one| one.kind.as_str()).collect();
    for kind in kinds {
        let of_kind: Vec<&Evaluation> = singles(evaluated).filter(|one| one.kind == kind).collect();
        let mut row = vec![Cell::from(kind)];
        for size in RUNGS {
            let at: Vec<&&Evaluation> = of_kind.iter().filter(|one| one.sizes == [size]).collect();
            let exact = at.iter().filter(|one| one.exact).count();
            let family = at.iter().filter(|one| one.family).count();
            row.push(if at.is_empty() {
                Cell::Nothing
            } else {
                Cell::Text(format!("{exact}/{family}/{}", at.len()))
            });
        }
        row.push(percentage(of_kind.iter().filter(|one| one.exact).count(), of_kind.len()));
        row.push(percentage(of_kind.iter().filter(|one| one.family).count(), of_kind.len()));
        table.push(row);
    }
    table
}

/// The first reported effect of a session, or its verdict.
fn first_reported(one: &Evaluation) -> String {
    match (one.verdict.as_str(), one.named.first()) {
        ("named", Some(label)) => name_of(label).to_owned(),
        (verdict, _) => format!("({verdict})"),
    }
}

fn confusion(evaluated: &[Evaluation]) -> Table {
    let mut table = Table::new(
        "Confusion matrix: hidden effect, first reported effect",
        &["hidden", "first reported", "sessions"],
    );
    let mut counts: BTreeMap<(String, String), u64> = BTreeMap::new();
    for one in evaluated.iter().filter(|one| one.class != Class::Pair) {
        let hidden =
            if one.class == Class::Single { name_of(&one.kind).to_owned() } else { one.kind.clone() };
        *counts.entry((hidden, first_reported(one))).or_default() += 1;
    }
    for ((hidden, reported), count) in counts {
        table.push(vec![Cell::Text(hidden), Cell::Text(reported), count.into()]);
    }
    table
}

fn outside(evaluated: &[Evaluation]) -> Table {
    let columns =
        ["outside the catalogue", "unexplained", "ambiguous", "declared family", "named", "none", "failed"];
    let mut table = Table::new("Verdicts for effects outside the catalogue", &columns);
    let kinds: BTreeSet<&str> =
        evaluated.iter().filter(|one| one.class == Class::Outside).map(|one| one.kind.as_str()).collect();
    for kind in kinds {
        let of_kind: Vec<&Evaluation> = evaluated.iter().filter(|one| one.kind == kind).collect();
        let count = |is: &dyn Fn(&Evaluation) -> bool| of_kind.iter().filter(|one| is(one)).count() as u64;
        table.push(vec![
            kind.into(),
            count(&|one| one.verdict == "unexplained").into(),
            count(&|one| one.verdict == "ambiguous").into(),
            count(&|one| one.verdict == "named" && one.declared).into(),
            count(&|one| one.verdict == "named" && !one.declared).into(),
            count(&|one| one.verdict == "none").into(),
            count(&|one| one.verdict == "failed").into(),
        ]);
    }
    table
}

fn parameters(evaluated: &[Evaluation]) -> Table {
    let mut table = Table::new(
        "Parameter errors of exactly named effects",
        &["parameter", "compared", "within 2 sigma", "mean error / sigma", "rms error / sigma"],
    );
    let mut errors: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for compared in evaluated.iter().filter(|one| one.exact).flat_map(|one| &one.parameters) {
        let parameter = compared.name.rsplit_once(' ').map_or("", |(_, parameter)| parameter);
        errors
            .entry(format!("{} {parameter}", name_of(&compared.name)))
            .or_default()
            .push(compared.error_over_sigma());
    }
    for (parameter, errors) in errors {
        let count = errors.len();
        let within = errors.iter().filter(|off| off.abs() <= 2.0).count() as u64;
        let mean = errors.iter().sum::<f64>() / count as f64;
        let square = errors.iter().map(|off| off * off).sum::<f64>() / count as f64;
        let cells = [
            Cell::Count(count as u64),
            percent(within, count as u64).into(),
            Cell::Number(mean),
            Cell::Number(square.sqrt()),
        ];
        table.push([vec![Cell::Text(parameter)], cells.to_vec()].concat());
    }
    table.note("a varying force is compared with its mean; effects with a change of sign are excluded");
    table
}

/// The smallest size of each effect at and above which it is named in four of five sessions; sizes without a session
/// count neither way.
pub fn detectable(evaluated: &[Evaluation]) -> Table {
    let columns = ["effect", "exact", "exact or family", "unit", "sessions by size"];
    let mut table = Table::new("Minimum detectable size", &columns);
    for (kind, nominal, unit) in NOMINAL {
        let of_kind: Vec<&Evaluation> = singles(evaluated).filter(|one| one.kind == kind).collect();
        let smallest = |is: fn(&Evaluation) -> bool| {
            let mut found = None;
            for size in RUNGS.iter().rev() {
                let at: Vec<&&Evaluation> = of_kind.iter().filter(|one| one.sizes == [*size]).collect();
                let right = at.iter().filter(|one| is(one)).count();
                if (right as f64) < DETECTED * at.len() as f64 {
                    break;
                }
                if at.is_empty() {
                    continue;
                }
                found = Some(if kind == "plate_lowpass" { nominal / size } else { nominal * size });
            }
            Cell::from(found)
        };
        let cells = [smallest(|one| one.exact), smallest(|one| one.family), unit.into()];
        let by_size = RUNGS.map(|size| of_kind.iter().filter(|one| one.sizes == [size]).count().to_string());
        table.push([vec![Cell::from(kind)], cells.to_vec(), vec![Cell::Text(by_size.join(", "))]].concat());
    }
    table.note("smallest tested size at and above which at least four of five sessions are correct; -: none");
    table.note("tested sizes: 0.5, 1, 2 and 4 times the nominal detectable size of each effect");
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hidden::evaluation::evaluate;
    use crate::hidden::evaluation::tests::{finding, truth};
    use crate::hidden::ladder::nominal;
    use serde_json::json;

    fn of_yaw(size: f64, right: bool) -> Evaluation {
        let mut truth = truth(&[("plate_yaw", None, ("psi_rad", 0.1))]);
        truth.effects[0].size = size;
        let name = if right { "plate_yaw" } else { "plate_gain" };
        evaluate(&truth, Ok(&finding("named", &[(name, json!({}), json!({}))], &[])), None, 2.0)
    }

    #[test]
    fn the_detectable_size_is_the_smallest_above_which_nothing_is_missed() {
        let row_of = |evaluated: &[Evaluation]| {
            let table = detectable(evaluated);
            table.rows().iter().find(|row| row[0] == Cell::from("plate_yaw")).unwrap().clone()
        };
        let evaluated = [of_yaw(4.0, true), of_yaw(2.0, true), of_yaw(1.0, false), of_yaw(0.5, true)];
        assert_eq!(row_of(&evaluated)[1], Cell::Number(2.0 * nominal("plate_yaw")));
        assert_eq!(row_of(&evaluated)[4], Cell::Text("1, 1, 1, 1".into()));
        assert_eq!(row_of(&evaluated[2..])[1], Cell::Nothing);
        // 4 times the nominal size was not tested.
        assert_eq!(row_of(&evaluated[1..3])[1], Cell::Number(2.0 * nominal("plate_yaw")));
        assert_eq!(row_of(&evaluated[1..3])[4], Cell::Text("0, 1, 1, 0".into()));
    }

    #[test]
    fn the_tables_count_verdicts_and_names() {
        let clean = evaluate(&truth(&[]), Ok(&finding("none", &[], &[])), None, 1.0);
        let evaluated = [of_yaw(2.0, true), of_yaw(2.0, false), clean];
        let overview = overview(&evaluated);
        let row = |what: &str| {
            let rows = overview.rows().iter();
            rows.clone()
                .find(|row| matches!(&row[0], Cell::Text(text) if text.starts_with(what)))
                .unwrap()
                .clone()
        };
        assert_eq!(row("first named effect exact at 2")[1..3], [Cell::Count(1), Cell::Count(2)]);
        assert_eq!(row("clean: verdict other than none")[1..3], [Cell::Count(0), Cell::Count(1)]);
        assert_eq!(confusion(&evaluated).rows().len(), 3);
        assert_eq!(tables(&evaluated).len(), 6);
        // Two names with 0.98, of which one is right.
        let reliability = reliability(&evaluated);
        assert_eq!(reliability.rows().len(), 1, "{:?}", reliability.rows());
        assert_eq!(reliability.rows()[0][2], Cell::Count(2));
        assert_eq!(reliability.rows()[0][4], Cell::Number(50.0));
    }
}
