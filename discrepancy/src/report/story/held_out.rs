//! Step 5: the same figure on held-out data.

use super::super::Report;
use super::super::document::{Section, Table, Text};
use super::super::figures::{self, HELD_OUT, When};
use super::super::figures_by_row;
use super::super::words::{number, ratio};
use super::{changed, with_unit};
use crate::block::Phase;
use crate::constants::GAP_IN_WORDS;
use crate::finding::{Finding, Gap, Verdict};

pub(super) fn section(report: &Report) -> Section {
    let finding = report.finding;
    let gap = &finding.gap;
    let mut section = Section::new("5. Residual after the change, on held-out data");
    if !changed(finding) {
        section.paragraph("Nothing was added: the residual is that of step 1.");
        section.table(phases(report));
        return section;
    }
    section.paragraph(
        Text::from("On held-out blocks, which were not used to fit the change, the gap changes from ")
            .then(with_unit(gap.before_mm, "mm"))
            .plain(" to ")
            .then(with_unit(gap.after_mm, "mm"))
            .plain("; noise alone: ")
            .then(with_unit(gap.noise_floor_mm, "mm"))
            .plain(format!(". {}", remainder_in_words(finding))),
    );
    if let Some(fz) = gap.per_axis.get("fz") {
        section.paragraph(
            Text::from("The gap of the vertical force changes from ")
                .then(with_unit(fz.before, fz.unit))
                .plain(" to ")
                .then(with_unit(fz.after, fz.unit))
                .plain("; noise alone: ")
                .then(with_unit(fz.noise_floor, fz.unit))
                .plain("."),
        );
    }
    let picture = report.picture;
    let mut pairs = Vec::new();
    for plot in &picture.time {
        for when in [When::Before, When::After] {
            pairs.push(figures::over_time(HELD_OUT, picture, plot, &finding.spans, when));
        }
    }
    for (n, plot) in picture.pose.iter().enumerate() {
        for when in [When::Before, When::After] {
            pairs.push(figures::over_pose(HELD_OUT, n + 1, plot, when));
        }
    }
    section.figures(pairs);
    section.figures(figures_by_row::gap(HELD_OUT, gap, true).into_iter().collect());
    section.table(axes(gap));
    section.table(phases(report));
    section
}

fn remainder_in_words(finding: &Finding) -> &'static str {
    let gap = &finding.gap;
    let [noise, little_more] = GAP_IN_WORDS;
    match gap.after_mm / gap.noise_floor_mm {
        rest if rest <= noise && finding.verdict == Verdict::Unexplained => {
            "The remaining residual is as small as noise but not white: see step 6."
        }
        rest if rest <= noise => "The remaining residual is noise.",
        rest if rest <= little_more => "The remaining residual is slightly above noise.",
        rest if rest < gap.before_mm / gap.noise_floor_mm => "Part of the gap remains: see step 6.",
        _ => "The change did not reduce the gap.",
    }
}

fn axes(gap: &Gap) -> Table {
    let mut table =
        Table::new(&["axis", ">before", ">after, held out", ">noise alone", ">times noise before", ">after"]);
    for (name, axis) in figures_by_row::axes(gap) {
        let value = |value: f64| format!("{} {}", number(value), axis.unit).into();
        let times = |value: f64| ratio(value, axis.noise_floor).trim_end_matches(" times").to_owned().into();
        table.rows.push(vec![
            figures_by_row::axis(name).into(),
            value(axis.before),
            value(axis.after),
            value(axis.noise_floor),
            times(axis.before),
            times(axis.after),
        ]);
    }
    table
}

fn phases(report: &Report) -> Table {
    let changed = changed(report.finding);
    let mut table = if changed {
        Table::new(&["phase", "signal", ">before", ">after, held out", ">noise alone"])
    } else {
        Table::new(&["phase", "signal", ">gap", ">noise alone"])
    };
    for each in &report.picture.phases {
        let phase = match each.phase {
            Phase::Identify => "identification",
            Phase::Reference => "reference (clean work)",
            Phase::Work => "work in question",
        };
        let value = |value: f64| Text::from(format!("{} {}", number(value), each.signal.unit()));
        let mut row = vec![phase.into(), figures::signal(each.signal).into(), value(each.before)];
        row.extend(changed.then(|| value(each.after)));
        row.push(value(each.noise_floor));
        table.rows.push(row);
    }
    table
}
