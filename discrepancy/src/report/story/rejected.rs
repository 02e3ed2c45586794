//! Step 3: rejected explanations, with reasons.

use super::super::Report;
use super::super::document::{Section, Table, Text, code, strong};
use super::super::figures_by_row;
use super::super::words::{self, odds};
use super::equivalent_sets;
use crate::finding::{Named, SetAside, Verdict};

pub(super) fn section(report: &Report) -> Section {
    let finding = report.finding;
    let mut section = Section::new("3. What was considered and set aside");
    section.say(format!(
        "Every effect of the catalogue was tried, alone and together with those accepted before it. It counts from a log odds \
         of {} on: the data must be {} times more likely with it than without it, which covers that many were tried.",
        odds(report.picture.threshold_log_odds),
        words::times(report.picture.threshold_log_odds).unwrap_or_else(|| "hardly".to_owned())
    ));
    section
        .figures(figures_by_row::evidence(finding, report.picture.threshold_log_odds).into_iter().collect());
    section.list(finding.effects.iter().map(runner_up).collect());
    if finding.verdict == Verdict::Ambiguous {
        for set in equivalent_sets(report).iter().filter(|set| set.len() > 1) {
            section.say("These explain the data alike:");
            let in_words = |name: &String| code(name).plain(": ").plain(words::candidate(name));
            section.list(set.iter().map(in_words).collect());
        }
    }
    section.table(table(report, &finding.set_aside));
    if finding.candidates.is_empty() && finding.set_aside.is_empty() {
        section.say("No candidate came near.");
    }
    section
}

/// The second-best explanation of a named effect's evidence, in words.
fn runner_up(named: &Named) -> Text {
    let text = strong(words::candidate(&words::full_name(named))).plain(format!(
        " makes the data {} times more likely than without it (log odds {}). ",
        words::times(named.log_odds).unwrap_or_else(|| "hardly any".to_owned()),
        odds(named.log_odds)
    ));
    let Some(second) = &named.runner_up else { return text.plain("Nothing else came near.") };
    let behind = named.log_odds - second.log_odds;
    let how = match words::times(-behind) {
        Some(factor) => format!("{factor} times likelier, but not taken"),
        None => words::less_likely(behind),
    };
    text.plain("Next best: ").strong(words::candidate(&second.name)).plain(format!(", {how}."))
}

fn table(report: &Report, set_aside: &[SetAside]) -> Table {
    let mut table = Table::new(&["set aside", "that is", "why", "against the best", ">log odds"]);
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
