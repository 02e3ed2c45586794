//! Words that hide a technical term, in identifiers, comments and strings.

use std::path::Path;

use crate::source::committed_texts;

/// Words of a private idiom; each has a term of the field in its place (`published`, `again`, `invalid`, …).
const RARE: [&str; 17] = [
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
];
/// Files in which such a word is right: a user's name in a list of secrets.
const ALLOWED: [(&str, &str); 1] = [("files/src/secret.rs", "nobody")];

#[test]
fn rust_sources_use_the_terms_of_the_field() {
    let mut found = Vec::new();
    let mut files = 0;
    let is_rust = |path: &Path| {
        path.extension().is_some_and(|end| end == "rs") && !path.ends_with("architecture/language.rs")
    };
    for (path, text) in committed_texts().filter(|(path, _)| is_rust(path)) {
        files += 1;
        for (index, line) in text.lines().enumerate() {
            for word in words(line).filter(|word| RARE.contains(&word.as_str())) {
                if !ALLOWED.iter().any(|(file, allowed)| path == Path::new(file) && *allowed == word) {
                    found.push(format!("{}:{}: {word}", path.display(), index + 1));
                }
            }
        }
    }
    assert!(files > 600, "only {files} files were read");
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
