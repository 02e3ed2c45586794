//! Step 4: effects added to the model.

use super::super::Report;
use super::super::document::{Section, Table, Text, code, strong};
use super::super::escape::shell;
use super::super::figures;
use super::super::words;
use super::mostly_unexplained;
use crate::finding::{Named, Verdict};
use crate::picture::Unseen;

pub(super) fn section(report: &Report) -> Section {
    let mut section = Section::new("4. Change of the model");
    let finding = report.finding;
    if finding.verdict == Verdict::Ambiguous && !finding.effects.is_empty() {
        section.paragraph(if finding.ask_next.is_some() {
            "This is the most likely explanation, but it is not certain. Confirm it by the measurement of step 6 before use."
        } else {
            "This is the most likely explanation, but it is not certain. Inspect whether it is present before use."
        });
    }
    if finding.verdict == Verdict::Unexplained && mostly_unexplained(finding) {
        section.paragraph(
            "These effects explain less of the residual than a cause that is not in the catalogue. Find that cause first; \
             do not run this model before.",
        );
    }
    for number in 0..report.finding.effects.len() {
        effect(report, number, &mut section);
    }
    if report.finding.effects.is_empty() {
        nothing(report, &mut section);
    }
    match (&report.finding.model, report.model_toml) {
        (Some(path), toml) => model_file(report, path, toml, &mut section),
        (None, _) if report.finding.effects.is_empty() => {}
        (None, _) => section.paragraph("No model file was written."),
    }
    section
}

fn effect(report: &Report, number: usize, section: &mut Section) {
    let named = &report.finding.effects[number];
    let full_name = words::full_name(named);
    section.head(code(&full_name).plain(": ").plain(words::candidate(&full_name)));
    section.table(parameters(named));
    if let [Some(from), Some(to)] = ["from_s", "to_s"].map(|key| named.place.get(key)?.as_f64()) {
        let text = Text::from("It acts from ").strong(words::seconds(from)).plain(" to ");
        section.paragraph(text.strong(words::seconds(to)).plain(" of the recording."));
    }
    if !named.family.is_empty() {
        let family: Vec<String> = named.family.iter().map(|name| words::candidate(name)).collect();
        section.paragraph(
            strong("Also consistent with these data: ")
                .plain(super::enumeration_with(&family, "or"))
                .plain("."),
        );
    }
    if let Some(remedy) = words::remedy(&named.name) {
        section.paragraph(strong("Remedy at the station: ").plain(remedy));
    }
    // Draw an effect that occurs in two parts of the work once, with both parts.
    if report.finding.effects[..number].iter().any(|earlier| words::full_name(earlier) == full_name) {
        return;
    }
    let plots = report.picture.predictors.iter().enumerate().filter(|(_, plot)| plot.effect == full_name);
    let figures: Vec<_> = plots.map(|(n, plot)| figures::over_predictor(n + 1, plot)).collect();
    section.figures(figures);
}

/// The everyday unit only where one of the values has it.
fn parameters(named: &Named) -> Table {
    let everyday: Vec<_> = named.parameters.values().map(words::in_everyday_units).collect();
    let heads = ["parameter", ">value ± 1 σ", ">in other units"];
    let mut table = Table::new(if everyday.iter().any(Option::is_some) { &heads } else { &heads[..2] });
    for ((name, estimate), everyday) in named.parameters.iter().zip(everyday) {
        let second = Text::from(everyday.unwrap_or_else(|| "–".to_owned()));
        let cells = [code(name), words::estimate(estimate).into(), second];
        table.rows.push(cells.into_iter().take(table.head.len()).collect());
    }
    table
}

fn nothing(report: &Report, section: &mut Section) {
    section.paragraph(match report.finding.verdict {
        Verdict::Unexplained => {
            "Nothing is added to the model, because no effect of the catalogue fits. Step 6 describes the unexplained part."
        }
        Verdict::Named | Verdict::Ambiguous | Verdict::None => "Nothing is added to the model, because these data show no effect that it lacks.",
    });
    let table = unseen(&report.picture.unseen);
    if !table.rows.is_empty() {
        section.paragraph(
            "Smaller effects than these are below the detection limit (per kind, at the place with the highest limit):",
        );
    }
    section.table(table);
}

/// One row per effect: the place with the largest bound.
fn unseen(all: &[Unseen]) -> Table {
    let mut table = Table::new(&["effect", "description", "parameter", ">upper bound (95 %)"]);
    let kind = |each: &Unseen| each.effect.split(' ').next().unwrap_or_default().to_owned();
    for (n, first) in all.iter().enumerate() {
        let same = |each: &&Unseen| kind(each) == kind(first) && each.unit == first.unit;
        if all[..n].iter().any(|each| same(&each)) {
            continue;
        }
        let most = all.iter().filter(same).max_by(|a, b| a.at_most.total_cmp(&b.at_most)).unwrap_or(first);
        let size = words::size(most.at_most, most.unit);
        let words = words::candidate(&most.effect);
        table.rows.push(vec![code(&most.effect), words.into(), code(&most.parameter), size.into()]);
    }
    table
}

fn model_file(report: &Report, path: &str, toml: Option<&str>, section: &mut Section) {
    section.head("The model file");
    section.paragraph(
        Text::from("The change is in ").code(path).plain(". The real-time loop applies the same terms."),
    );
    if let Some(toml) = toml {
        section.code("toml", toml);
    }
    section
        .paragraph("Check the effect on the loop's residual by a replay, or run the daemon with the model:");
    let recordings: Vec<String> = report.origin.recordings.iter().map(|each| shell(&each.name)).collect();
    let path = shell(path);
    section.code(
        "sh",
        format!("equipoise replay {} --model {path}\nequipoise run --model {path}", recordings.join(" ")),
    );
}
