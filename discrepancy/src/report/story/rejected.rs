//! Step 3: rejected explanations, with reasons.

use super::super::Report;
use super::super::document::{Section, Table, Text, code, strong};
use super::super::figures_by_row;
use super::super::words::{self, odds};
use super::equivalent_sets;
use crate::finding::{Named, SetAside, Verdict};

pub(super) fn section(report: &Report) -> Section {
    let finding = report.finding;
    let mut section = Section::new("3. Rejected effects");
    section.say(format!(
        "Every effect of the catalogue was tested, alone and in addition to those accepted before it. The threshold is a log \
         odds of {}: the data must be {} times more likely with the effect than without it. It accounts for the number of \
         effects tested.",
        odds(report.picture.threshold_log_odds),
        words::times(report.picture.threshold_log_odds).unwrap_or_else(|| "less than 2".to_owned())
    ));
    section
        .figures(figures_by_row::evidence(finding, report.picture.threshold_log_odds).into_iter().collect());
    section.list(finding.effects.iter().map(runner_up).collect());
    if finding.verdict == Verdict::Ambiguous {
        for set in equivalent_sets(report).iter().filter(|set| set.len() > 1) {
            section.say("These effects explain the data equally well:");
            let in_words = |name: &String| code(name).plain(": ").plain(words::candidate(name));
            section.list(set.iter().map(in_words).collect());
        }
    }
    section.table(table(report, &finding.set_aside));
    if finding.candidates.is_empty() && finding.set_aside.is_empty() {
        section.say("No candidate is close to the threshold.");
    }
    section
}

/// The second-best explanation of a named effect's evidence, in words.
fn runner_up(named: &Named) -> Text {
    let text = strong(words::candidate(&words::full_name(named))).plain(format!(
        " makes the data {} times more likely than without it (log odds {}). ",
        words::times(named.log_odds).unwrap_or_else(|| "less than 2".to_owned()),
        odds(named.log_odds)
    ));
    let Some(second) = &named.runner_up else { return text.plain("No other effect is close.") };
    let behind = named.log_odds - second.log_odds;
    let how = match words::times(-behind) {
        Some(factor) => format!("{factor} times more likely, but rejected"),
        None => words::less_likely(behind),
    };
    text.plain("Next best: ").strong(words::candidate(&second.name)).plain(format!(", {how}."))
}

fn table(report: &Report, set_aside: &[SetAside]) -> Table {
    let mut table = Table::new(&["rejected", "description", "reason", "relative to the best", ">log odds"]);
    let best = report.finding.candidates.first().map(|candidate| candidate.log_odds);
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
