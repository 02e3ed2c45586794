//! Step 1: the discrepancy, its size and location.

use super::super::Report;
use super::super::document::{Section, Table, Text};
use super::super::figures::{self, When};
use super::super::figures_by_row;
use super::super::words::{number, ratio};
use super::with_unit;

pub(super) fn section(report: &Report) -> Section {
    let gap = &report.finding.gap;
    let mut section = Section::new("1. The shape of it: what disagrees");
    section.say(
        Text::from("In the work in question the centre of pressure that the plate measures and the one that the model predicts are ")
            .then(with_unit(gap.before_mm, "mm"))
            .plain(" farther apart than the clean part of the recording makes one expect (root mean square). Noise alone (sway, the suit's drift, soft tissue, the plate) would leave ")
            .then(with_unit(gap.noise_floor_mm, "mm"))
            .plain(format!(": it is {} as much.", ratio(gap.before_mm, gap.noise_floor_mm))),
    );
    if let Some(fz) = gap.per_axis.get("fz") {
        section.say(
            Text::from("The vertical force is off by ")
                .then(with_unit(fz.before, fz.unit))
                .plain(" where noise would leave ")
                .then(with_unit(fz.noise_floor, fz.unit))
                .plain(format!(" ({}).", ratio(fz.before, fz.noise_floor))),
        );
    }
    section.note(
        "How to read the pictures: the line is measured less predicted, and less what was off in the clean part already \
         (errors of the worker's parameters, where the feet were put down). While it stays in the grey band, noise explains \
         it. The green strip at the foot marks held poses; orange stretches are those of step 2.",
    );
    let picture = report.picture;
    let mut all: Vec<_> = (picture.time.iter())
        .map(|plot| figures::over_time("shape", picture, plot, &report.finding.spans, When::Before))
        .collect();
    all.extend(figures_by_row::gap("shape", gap, false));
    section.figures(all);

    let mut table = Table::new(&["axis", ">gap", ">noise alone", ">times noise"]);
    for (name, axis) in figures_by_row::axes(gap) {
        table.rows.push(vec![
            figures_by_row::axis(name).into(),
            format!("{} {}", number(axis.before), axis.unit).into(),
            format!("{} {}", number(axis.noise_floor), axis.unit).into(),
            ratio(axis.before, axis.noise_floor).trim_end_matches(" times").to_owned().into(),
        ]);
    }
    section.table(table);
    section
}
