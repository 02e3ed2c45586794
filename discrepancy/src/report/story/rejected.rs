//! Step 3: rejected explanations, with reasons.

use super::super::Report;
use super::super::document::{Section, Table, Text, code, strong};
use super::super::figures_by_row;
use super::super::words::{self, odds};
use crate::constants::{NAMED_PROBABILITY, RIVAL_PROBABILITY_MIN};
use crate::finding::{Named, SetAside, percent};

pub(super) fn section(report: &Report) -> Section {
    let finding = report.finding;
    let mut section = Section::new("3. Rejected effects");
    section.paragraph(format!(
        "Every effect of the catalogue was tested, alone and in addition to others, each with its own misfit. An effect is \
         named from a probability of {} on; less certain ones are ambiguous. By chance alone, an effect reaches log odds of {} \
         in at most one of a hundred recordings like this one.",
        percent(NAMED_PROBABILITY),
        odds(report.picture.threshold_log_odds)
    ));
    section
        .figures(figures_by_row::evidence(finding, report.picture.threshold_log_odds).into_iter().collect());
    section.list(finding.effects.iter().map(runner_up).collect());
    for named in finding.effects.iter().filter(|named| !named.family.is_empty()) {
        section.paragraph(format!("These data do not distinguish {} from:", words::full_name(named)));
        let in_words = |name: &String| code(name).plain(": ").plain(words::candidate(name));
        section.list(named.family.iter().map(in_words).collect());
    }
    section.table(table(report, &finding.set_aside));
    if finding.candidates.is_empty() && finding.set_aside.is_empty() {
        section.paragraph("No effect makes the data more likely.");
    }
    section
}

/// The second-best explanation of a named effect's evidence, in words.
fn runner_up(named: &Named) -> Text {
    let text = strong(words::candidate(&words::full_name(named))).plain(format!(
        ": probability {}; in addition to the effects above it makes the data {} times more likely (log odds {}). ",
        percent(named.probability),
        words::times(named.log_odds).unwrap_or_else(|| "less than 2".to_owned()),
        odds(named.log_odds)
    ));
    let Some(second) = &named.runner_up else {
        return text
            .plain(format!("No other effect in its place has {} or more.", percent(RIVAL_PROBABILITY_MIN)));
    };
    text.plain("In its place: ")
        .strong(words::candidate(&second.name))
        .plain(format!(", probability {}.", percent(second.probability)))
}

fn table(report: &Report, set_aside: &[SetAside]) -> Table {
    let mut table = Table::new(&["rejected", "description", "reason", "relative to the best", ">log odds"]);
    let best = report.finding.candidates.first().and_then(|candidate| candidate.log_odds);
    for each in set_aside {
        let against = best.map_or("–".to_owned(), |best| words::less_likely(best - each.log_odds));
        table.rows.push(vec![
            code(&each.name),
            words::candidate(&each.name).into(),
            each.why.as_str().into(),
            against.into(),
            odds(each.log_odds).into(),
        ]);
    }
    table
}
