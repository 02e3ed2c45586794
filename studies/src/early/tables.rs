//! The tables of the study: one function per table, from the sums over all subjects by name of the suit's data.

use super::{AHEAD_S, Errors, Findings, Scalar, quantile_ms};
use crate::table::{Cell, Table};
use crate::tally::{GROUPS, percent};

/// Ages at publication.
pub(super) fn ages(count: usize, suits: &[(&str, Findings)]) -> Table {
    let mut table = Table::new(
        format!("Age at publication ({count} subjects, suit at 60 Hz, natural pace)"),
        &[
            "suit data",
            "state p50 ms",
            "state p99 ms",
            "early p50 ms",
            "early p99 ms",
            "state published %",
            "early published %",
        ],
    );
    for (name, sum) in suits {
        let age = |which: usize, probability: f64| quantile_ms(&sum.ages_s[which], probability).into();
        let published_percent = |which: usize| percent(sum.published[which], sum.published[2]).into();
        table.push(vec![
            (*name).into(),
            age(0, 0.5),
            age(0, 0.99),
            age(1, 0.5),
            age(1, 0.99),
            published_percent(0),
            published_percent(1),
        ]);
    }
    table.note("age: from the sample's stamp to the due time of the cycle of a 1 kHz loop; without network, computation and publication; suit and plate without a constant latency");
    table
}

/// Errors of both states while a load is carried, and of force and centre of pressure without one.
pub(super) fn errors(suits: &[(&str, Findings)]) -> Table {
    let mut table = Table::new(
        "Errors while 4 and 11 kg are carried, each at its own time".to_owned(),
        &[
            "suit data",
            "quantity",
            "state",
            "state sigma",
            "state 1-sigma %",
            "early",
            "early sigma",
            "early 1-sigma %",
            "state as now",
            "sigma ratio",
            "difference",
        ],
    );
    for (name, sum) in suits {
        for (group, (joints, _)) in GROUPS.iter().enumerate() {
            table.push(group_row([name, joints], sum, group));
        }
        table.push(all_joints_row(name, sum));
        let [unloaded_state, unloaded_early] = &sum.unloaded;
        for (quantity, state, early) in [
            ("force, loaded", &sum.state.force_n, &sum.early.force_n),
            ("force, no load", &unloaded_state.force_n, &unloaded_early.force_n),
            ("CoP, no load", &unloaded_state.cop_mm, &unloaded_early.cop_mm),
        ] {
            table.push(scalar_row([name, quantity], state, early));
        }
    }
    table.note("torques in N m, force in N, CoP per axis in mm: RMS length of the error, mean sigma, coverage of the magnitude by 1 sigma; state as now: the newest state compared with the truth at the early state's sample");
    table.note("truth: inverse dynamics of the simulated motion with the box less that without it");
    table.note("difference: RMS of the early torque's magnitude minus that of the state of the same sample; noisy: 0.2 mm of white noise per axis and sample in all positions");
    table
}

/// Torques of one group of joints.
fn group_row(names: [&str; 2], sum: &Findings, group: usize) -> Vec<Cell> {
    let mut row: Vec<Cell> = names.map(Cell::from).into();
    for errors in [&sum.state, &sum.early] {
        row.push(errors.error_nm[group].rms().into());
        row.push(errors.sigma_nm[group].mean().into());
        row.push(errors.coverage[group].percent()[0].into());
    }
    row.push(stale(sum).error_nm[group].rms().into());
    row.push(sigma_ratio(sum.state.sigma_nm[group].mean(), sum.early.sigma_nm[group].mean()));
    row.push(sum.difference_nm[group].rms().into());
    row
}

/// Torques of all joints.
fn all_joints_row(name: &str, sum: &Findings) -> Vec<Cell> {
    let mut row: Vec<Cell> = vec![name.into(), "all joints".into()];
    for errors in [&sum.state, &sum.early] {
        let cells = [errors.rms_nm(), errors.mean_sigma_nm(), errors.covered_percent()];
        row.extend(cells.map(Cell::from));
    }
    row.push(stale(sum).rms_nm().into());
    row.push(sigma_ratio(sum.state.mean_sigma_nm(), sum.early.mean_sigma_nm()));
    row.push(Cell::Nothing);
    row
}

/// A quantity that is not a torque.
fn scalar_row(names: [&str; 2], state: &Scalar, early: &Scalar) -> Vec<Cell> {
    let mut row: Vec<Cell> = names.map(Cell::from).into();
    for scalar in [state, early] {
        row.push(scalar.error.rms().into());
        row.push(scalar.sigma.mean().into());
        row.push(scalar.coverage.percent()[0].into());
    }
    row.push(Cell::Nothing);
    row.push(sigma_ratio(state.sigma.mean(), early.sigma.mean()));
    row.push(Cell::Nothing);
    row
}

/// The newest state compared with the truth at the early state's sample.
fn stale(sum: &Findings) -> &Errors {
    &sum.ahead[0][0]
}

/// σ of the early state over that of the state.
fn sigma_ratio(state: Option<f64>, early: Option<f64>) -> Cell {
    early.zip(state).map(|(early, state)| early / state).into()
}

/// Errors of predictions about later times.
pub(super) fn ahead(suits: &[(&str, Findings)]) -> Table {
    let mut table = Table::new(
        "Torques of all joints and positions of the hands, ahead of the early state's sample".to_owned(),
        &[
            "suit data",
            "ahead ms",
            "state as is N m",
            "early as is N m",
            "early extrapolated N m",
            "hands held mm",
            "hands at constant velocity mm",
        ],
    );
    for (name, sum) in suits {
        for (index, ahead_s) in AHEAD_S.into_iter().enumerate() {
            let mut row: Vec<Cell> = vec![(*name).into(), (1e3 * ahead_s).into()];
            row.extend(sum.ahead[index].iter().map(|errors| Cell::from(errors.rms_nm())));
            row.extend(sum.hands_m[index].iter().map(|sums| Cell::from(sums.rms().map(|m| 1e3 * m))));
            table.push(row);
        }
    }
    table.note("extrapolated: by the mean slope of the early torques over the last 100 ms");
    table
}
