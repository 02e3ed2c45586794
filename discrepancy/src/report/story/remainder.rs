//! Step 6: the remaining residual.

use super::super::Report;
use super::super::document::{Section, Table, Text, strong};
use super::super::figures;
use super::super::figures_remainder;
use super::super::words::{self, number};
use super::changed;
use crate::constants::WHITE_OUTSIDE_MAX;
use crate::finding::Verdict;
use crate::picture::Whiteness;

pub(super) fn section(report: &Report) -> Section {
    let picture = report.picture;
    let mut section = Section::new("6. Remaining residual");
    section.paragraph(
        "If the model is complete, the whitened residual is white noise: it has no autocorrelation, and its squares have \
         the distribution of noise.",
    );
    section.list(picture.whiteness.iter().map(|each| white(each, changed(report.finding))).collect());
    let mut all: Vec<_> = (picture.whiteness.iter())
        .map(|each| figures_remainder::whiteness(each, picture.block_s, changed(report.finding)))
        .collect();
    all.extend(figures_remainder::surprise(&picture.surprise, changed(report.finding)));
    section.figures(all);
    windows(report, &mut section);
    unexplained(report, &mut section);
    next(report, &mut section);
    section
}

fn white(of: &Whiteness, changed: bool) -> Text {
    let outside = |lags: &[f64]| {
        let out = lags.iter().filter(|value| value.abs() > of.bound).count();
        out as f64 / lags.len().max(1) as f64
    };
    let (before, after) = (outside(&of.before), outside(&of.after));
    let verdict = if after <= WHITE_OUTSIDE_MAX { "white" } else { "not white" };
    let text = Text::from(format!("{}: ", figures::signal(of.signal))).strong(verdict);
    let text =
        text.plain(format!(", {:.0} % of the lags outside the bounds (white noise: 5 %)", 100.0 * after));
    text.plain(if changed { format!("; before the change {:.0} %.", 100.0 * before) } else { ".".to_owned() })
}

fn windows(report: &Report, section: &mut Section) {
    let mut table = Table::new(&[">from", ">to", "signal", ">times noise before", ">after"]);
    for window in &report.picture.windows {
        table.rows.push(vec![
            words::seconds(window.from_s).into(),
            words::seconds(window.to_s).into(),
            figures::signal(window.signal).into(),
            number(window.times_noise_before).into(),
            number(window.times_noise_after).into(),
        ]);
    }
    if !table.rows.is_empty() {
        section.paragraph("Windows with the largest residual relative to noise (1: noise alone):");
    }
    section.table(table);
}

fn unexplained(report: &Report, section: &mut Section) {
    let terms = &report.finding.unexplained;
    if terms.is_empty() {
        if report.finding.verdict == Verdict::Unexplained {
            section
                .paragraph("No generic term (force, mass, heading) describes the remaining residual either.");
        }
        return;
    }
    section.paragraph(
        "Generic terms that describe the unexplained part. They are descriptions, not causes, and are not in the model:",
    );
    let describe = |term: &crate::finding::Generic| {
        let times = words::times(term.log_odds).unwrap_or_else(|| "less than 2".to_owned());
        strong(&term.what).plain(format!(
            ": {times} times more likely than without it (log odds {})",
            words::odds(term.log_odds)
        ))
    };
    section.list(terms.iter().map(describe).collect());
}

fn next(report: &Report, section: &mut Section) {
    match &report.finding.ask_next {
        Some(ask) => section.paragraph(strong("Next measurement: ").plain(ask)),
        None if report.finding.verdict == Verdict::Ambiguous => section.paragraph(
            "No pose of the library distinguishes these effects better: inspect worker and station.",
        ),
        None => section.paragraph("No further pose or motion is needed to distinguish effects."),
    }
}
