//! The results as a table, and its copy in the documents.

use std::path::Path;

use crate::cases::Case;
use crate::questions::{Answer, Question};

/// One adapter's results.
pub(crate) struct Row<'a> {
    pub(crate) case: &'a Case,
    pub(crate) answers: Result<Vec<(Question, Answer)>, String>,
}

impl Row<'_> {
    fn cell(&self, question: Question, notes: &mut Vec<&'static str>) -> String {
        if let Some(reason) = self.case.reason_not_tested(question) {
            let at = notes.iter().position(|note| *note == reason).unwrap_or_else(|| {
                notes.push(reason);
                notes.len() - 1
            });
            return format!("n/a ({})", at + 1);
        }
        let answers = self.answers.as_ref().map_or(&[][..], Vec::as_slice);
        match answers.iter().find(|(spawned, _)| *spawned == question) {
            Some((_, Ok(cell))) => cell.clone(),
            Some((_, Err(_))) | None => "**no**".into(),
        }
    }
}

/// Markdown: adapters as rows, checks as columns, and the reasons for checks that are not applicable.
pub(crate) fn written(rows: &[Row<'_>]) -> String {
    let mut notes = Vec::new();
    let titles: Vec<_> = Question::ALL.iter().map(|question| question.title()).collect();
    let mut text = format!("| adapter | {} |\n|---|{}\n", titles.join(" | "), "---|".repeat(titles.len()));
    for row in rows {
        let cells: Vec<_> = Question::ALL.iter().map(|question| row.cell(*question, &mut notes)).collect();
        text += &format!("| {} | {} |\n", row.case.name, cells.join(" | "));
    }
    for (number, note) in (1..).zip(&notes) {
        text += &format!("\n{number}. {note}");
    }
    text + "\n"
}

/// All failures, one sentence each.
pub(crate) fn wrong(rows: &[Row<'_>]) -> Vec<String> {
    let mut wrong = Vec::new();
    for row in rows {
        match &row.answers {
            Err(error) => wrong.push(format!("{}: {error}", row.case.name)),
            Ok(answers) => wrong.extend(answers.iter().filter_map(|(question, answer)| {
                answer.as_ref().err().map(|error| format!("{}: {}: {error}", row.case.name, question.title()))
            })),
        }
    }
    wrong
}

/// The copy in `docs/sensors/README.md` is this table.
pub(crate) fn compare_with_the_documents(table: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/sensors/README.md");
    let (begin, end) = ("<!-- conformance: begin -->\n", "<!-- conformance: end -->");
    let document = std::fs::read_to_string(&path).unwrap();
    let (before, rest) =
        document.split_once(begin).expect("docs/sensors/README.md has a place for the table");
    let (copy, after) = rest.split_once(end).expect("docs/sensors/README.md has an end of the table");
    if std::env::var_os("EQUIPOISE_WRITE").is_some() {
        std::fs::write(&path, format!("{before}{begin}\n{table}\n{end}{after}")).unwrap();
        return;
    }
    assert_eq!(
        copy.trim(),
        table.trim(),
        "docs/sensors/README.md has another table; EQUIPOISE_WRITE=1 writes this one"
    );
}
