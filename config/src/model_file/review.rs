//! An engineer's verdict on a found effect. A rejected effect stays in the file with its reason, but is not applied,
//! and `reconcile` looks for other explanations.

use serde::{Deserialize, Serialize};
use toml_edit::{ArrayOfTables, DocumentMut, InlineTable, Item, Value};

/// Characters of a reason or of a date, at most. Chosen: a paragraph.
const REASON_MAX: usize = 1000;

/// A verdict, and its reason for later readers of the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Review {
    /// The verdict.
    pub verdict: Verdict,
    /// Its time, UTC: `2026-03-01T08:30:00Z`.
    pub date: String,
    /// Why.
    pub reason: String,
    /// Pseudonym of the engineer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by: Option<String>,
}

/// An engineer's verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The effect was found in reality, too.
    Confirmed,
    /// The effect is not there.
    Rejected,
}

impl Verdict {
    /// Its word in the file.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Confirmed => "confirmed",
            Verdict::Rejected => "rejected",
        }
    }
}

impl Review {
    /// The inline table of the file.
    pub(super) fn to_toml(&self) -> Value {
        let texts = [("verdict", self.verdict.name()), ("date", &self.date), ("reason", &self.reason)];
        let by = self.by.as_deref().map(|by| ("by", by));
        Value::from(texts.into_iter().chain(by).collect::<InlineTable>())
    }

    /// The invalid key and its error message.
    pub(super) fn check(&self) -> Result<(), (String, String)> {
        let texts = [("reason", self.reason.as_str()), ("date", &self.date)];
        let by = self.by.as_deref().map(|by| ("by", by));
        for (key, text) in texts.into_iter().chain(by) {
            if text.trim().is_empty() {
                return Err((key.to_owned(), "must not be empty".to_owned()));
            }
            if text.chars().count() > REASON_MAX || text.chars().any(char::is_control) {
                let what = format!("give one line of at most {REASON_MAX} characters");
                return Err((key.to_owned(), what));
            }
        }
        Ok(())
    }
}

/// The text of a model file with this review of its effect number `index` (from 0); everything else is unchanged.
/// `None` if the text has no such effect.
pub fn with_review(text: &str, index: usize, review: &Review) -> Option<String> {
    let mut document: DocumentMut = text.parse().ok()?;
    let effects: &mut ArrayOfTables = document.get_mut("effect")?.as_array_of_tables_mut()?;
    effects.get_mut(index)?.insert("review", Item::Value(review.to_toml()));
    Some(document.to_string())
}
