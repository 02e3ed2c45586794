//! Tables of texts, one file per language. They contain all texts of the page; the plain English of a state
//! ([`crate::words`]) comes from the English table.

use std::collections::BTreeMap;
use std::sync::LazyLock;

/// All languages: code, and table as JSON from keys to texts.
pub const TABLES: [(&str, &str); 3] =
    [("en", include_str!("en.json")), ("de", include_str!("de.json")), ("it", include_str!("it.json"))];

type Table = BTreeMap<String, String>;

// Tests parse every table, so this cannot fail.
static ENGLISH: LazyLock<Table> = LazyLock::new(|| serde_json::from_str(TABLES[0].1).unwrap_or_default());

/// The English text of a key.
pub fn english(key: &str) -> Option<&'static str> {
    ENGLISH.get(key).map(String::as_str)
}

/// The English text of `key` in a group of keys; `name` itself if it has none, as for names of a later version.
pub(crate) fn english_or(group: &str, name: &'static str) -> &'static str {
    english(&format!("{group}.{name}")).unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use equipoise_core::body::Joint;
    use equipoise_core::message::{Incident, Validity};
    use equipoise_core::overload::Level;
    use equipoise_core::pose_suggestion::library::LIBRARY;

    use super::*;

    fn tables() -> Vec<(&'static str, Table)> {
        TABLES.iter().map(|(code, text)| (*code, serde_json::from_str(text).unwrap())).collect()
    }

    /// Placeholders in braces.
    fn placeholders(sentence: &str) -> BTreeSet<&str> {
        sentence.split('{').skip(1).filter_map(|rest| rest.split_once('}')).map(|(place, _)| place).collect()
    }

    #[test]
    fn every_language_has_every_text_with_the_same_placeholders() {
        let tables = tables();
        let (_, english) = &tables[0];
        for (code, table) in &tables {
            assert!(table.keys().eq(english.keys()), "{code} has other keys than en");
            for (key, sentence) in table {
                assert!(!sentence.trim().is_empty(), "{code} {key}");
                assert_eq!(placeholders(sentence), placeholders(&english[key]), "{code} {key}");
            }
        }
    }

    #[test]
    fn every_reason_has_the_cause_and_after_a_colon_the_remedy() {
        for (code, table) in tables() {
            for (key, sentence) in table.iter().filter(|(key, _)| key.starts_with("reason.")) {
                let (what, to_do) = sentence.split_once(": ").unwrap_or_else(|| panic!("{code} {key}"));
                assert!(!what.contains(':') && !to_do.is_empty(), "{code} {key}");
            }
        }
    }

    #[test]
    fn every_name_in_a_state_has_a_text() {
        let english = &tables()[0].1;
        let reasons = Validity::NAMES.iter().map(|(_, name)| format!("reason.{name}"));
        let joints = Joint::ALL.map(|joint| format!("joint.{}", joint.name()));
        let poses = LIBRARY.iter().map(|pose| format!("pose.{}", pose.name));
        let incidents = Incident::ALL
            .iter()
            .flat_map(|kind| ["meaning", "do"].map(|part| format!("incident.{}.{part}", kind.name())));
        let levels = (0..8).filter_map(Level::from_number).map(|level| format!("level.{}", level.name()));
        for key in reasons.into_iter().chain(joints).chain(poses).chain(incidents).chain(levels) {
            assert!(english.contains_key(&key), "{key}");
        }
        for pose in LIBRARY {
            assert_eq!(english[&format!("pose.{}", pose.name)], pose.name);
        }
    }

    /// Detects a table that was copied and never translated.
    #[test]
    fn languages_differ() {
        let tables = tables();
        for (code, table) in &tables[1..] {
            let same = table.iter().filter(|(key, sentence)| tables[0].1[*key] == **sentence).count();
            assert!(same * 10 < table.len(), "{code}: {same} of {} sentences are English", table.len());
        }
    }
}
