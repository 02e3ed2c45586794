//! Words that hide a technical term, in identifiers, comments, strings and documents.

use std::path::Path;

use crate::source::committed_texts;

/// Words of a private idiom; each has a term of the field in its place (`published`, `again`, `invalid`, …).
const RARE: [&str; 20] = [
    "told",
    "tells",
    "nobody",
    "whoever",
    "anew",
    "wherever",
    "whichever",
    "shall",
    "thereof",
    "beside",
    "bear",
    "bears",
    "spoil",
    "spoilt",
    "hearsay",
    "mend",
    "mended",
    "promise",
    "promised",
    "promises",
];
/// Files in which such a word is right: a user's name, an object of JavaScript, licences.
const ALLOWED: [(&str, &str); 5] = [
    ("files/src/secret.rs", "nobody"),
    (".ci/browser.py", "promise"),
    (".ci/packages", "nobody"),
    (".ci/systemd", "nobody"),
    ("view/assets/LIBRARIES.md", "shall"),
];

/// Sources, settings, units, documents and checks. Not this list, and not the texts of others.
fn is_of_the_project(path: &Path) -> bool {
    let has_ending = |wanted: &[&str]| {
        path.extension().and_then(|end| end.to_str()).is_some_and(|end| wanted.contains(&end))
    };
    let is_excluded = path.ends_with("architecture/language.rs") || path.starts_with(".ci/advisories/crates");
    let is_check = path.starts_with(".ci") && !has_ending(&["json", "lock"]);
    !is_excluded && (is_check || has_ending(&["rs", "toml", "service", "conf", "sh", "bash", "md"]))
}

#[test]
fn texts_use_the_terms_of_the_field() {
    let mut found = Vec::new();
    let (mut files, mut sources) = (0, 0);
    for (path, text) in committed_texts().filter(|(path, _)| is_of_the_project(path)) {
        files += 1;
        sources += usize::from(path.extension().is_some_and(|end| end == "rs"));
        for (index, line) in text.lines().enumerate() {
            for word in words(line).filter(|word| RARE.contains(&word.as_str())) {
                if !ALLOWED.iter().any(|(file, allowed)| path == Path::new(file) && *allowed == word) {
                    found.push(format!("{}:{}: {word}", path.display(), index + 1));
                }
            }
        }
    }
    assert!(sources > 600 && files > sources + 100, "only {files} files with {sources} sources were read");
    assert!(found.is_empty(), "{} words:\n{}", found.len(), found.join("\n"));
}

/// Lower-case words of a line; the parts of `snake_case` and `CamelCase` names are words.
fn words(line: &str) -> impl Iterator<Item = String> {
    line.split(|c: char| !c.is_alphabetic()).flat_map(|run| {
        let mut parts: Vec<String> = Vec::new();
        let mut last_is_upper = true;
        for c in run.chars() {
            if parts.is_empty() || (c.is_uppercase() && !last_is_upper) {
                parts.push(String::new());
            }
            last_is_upper = c.is_uppercase();
            parts.last_mut().expect("a part was pushed").extend(c.to_lowercase());
        }
        parts
    })
}

#[test]
fn parts_of_names_are_words() {
    let found: Vec<String> = words("fn isTold(TOLD_NM: ToldNm) -> told_s; // Told").collect();
    assert_eq!(found, ["fn", "is", "told", "told", "nm", "told", "nm", "told", "s", "told"]);
}
