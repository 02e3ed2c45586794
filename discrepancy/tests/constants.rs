//! Numbers that tune a decision, a prior or a threshold are declared in `src/constants.rs` only, each with unit and
//! origin.
#![expect(clippy::unwrap_used, reason = "a test may panic, and so may its helpers")]

use std::fs;
use std::path::{Path, PathBuf};

const TABLE: &str = "constants.rs";
const NUMERIC: [&str; 15] = [
    "f64", "f32", "usize", "isize", "u8", "u16", "u32", "u64", "u128", "i8", "i16", "i32", "i64", "i128",
    "Duration",
];
/// Numeric constants elsewhere, which tune nothing.
const ALLOWED: [(&str, &str); 12] = [
    // Sizes of arrays and indices into them.
    ("ask/forecast.rs", "SIGNALS"),
    ("linear.rs", "LANES"),
    ("compare/window.rs", "SIDE_MAX"),
    ("noise/cop.rs", "COUNT"),
    ("noise/cop.rs", "WHITE"),
    ("noise/force.rs", "COUNT"),
    ("noise/force.rs", "WHITE"),
    ("noise/force.rs", "ORIENTATION"),
    ("session.rs", "PARAMETERS"),
    ("session_report/exposure.rs", "LEVELS"),
    ("session_report/quality.rs", "PHASES"),
    // 180/π.
    ("report/words.rs", "DEGREE"),
];
/// Files whose numeric constants are the geometry of drawings, in their own units.
const DRAWINGS: [&str; 4] =
    ["report/svg.rs", "report/svg/", "session_report/stick_figure.rs", "session_report/strips.rs"];

/// The files below `src`, by path from there.
fn sources() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut folders = vec![root.clone()];
    let mut files: Vec<PathBuf> = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                files.push(path);
            }
        }
    }
    let relative = |path: &Path| path.strip_prefix(&root).unwrap().to_string_lossy().into_owned();
    files.iter().map(|path| (relative(path), fs::read_to_string(path).unwrap())).collect()
}

/// Name and type of the constant or static that is declared on a line, if there is one.
fn declared(line: &str) -> Option<(&str, &str)> {
    let visible = line.trim_start().strip_prefix("pub").map_or(line.trim_start(), |rest| {
        rest.strip_prefix('(')
            .and_then(|rest| rest.split_once(") "))
            .map_or(rest.trim_start(), |(_, rest)| rest)
    });
    let rest = visible.strip_prefix("const ").or_else(|| visible.strip_prefix("static "))?;
    let (name, rest) = rest.split_once(':')?;
    let is_name = name.chars().all(|c| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_');
    is_name.then(|| (name, rest.split('=').next().unwrap_or(rest)))
}

/// Whether a type contains a number; the length of an array is none.
fn is_numeric(declared_type: &str) -> bool {
    let mut words = declared_type.split(|c: char| !c.is_alphanumeric() && c != '_');
    words.any(|word| NUMERIC.contains(&word))
}

#[test]
fn tuning_numbers_are_declared_in_the_table_only() {
    let mut elsewhere = Vec::new();
    let mut exceptions = 0;
    for (path, text) in sources() {
        let is_exempt = path == TABLE
            || path.ends_with("tests.rs")
            || DRAWINGS.iter().any(|drawings| path.starts_with(drawings));
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        for (name, _) in code.lines().filter_map(declared).filter(|(_, kind)| !is_exempt && is_numeric(kind))
        {
            if ALLOWED.contains(&(path.as_str(), name)) {
                exceptions += 1;
            } else {
                elsewhere.push(format!("{path}: {name}"));
            }
        }
    }
    assert!(elsewhere.is_empty(), "move to src/{TABLE}, with unit and origin: {elsewhere:#?}");
    assert_eq!(exceptions, ALLOWED.len(), "an exception no longer exists");
}

#[test]
fn every_number_of_the_table_states_unit_and_origin() {
    let (_, table) = sources().into_iter().find(|(path, _)| path == TABLE).unwrap();
    let (mut comment, mut count) = (String::new(), 0);
    for line in table.lines() {
        if let Some(text) = line.strip_prefix("///") {
            comment.push_str(text);
            continue;
        }
        if let Some((name, _)) = declared(line) {
            count += 1;
            let [unit, origin] = ["Unit: ", "Origin: "].map(|key| comment.contains(key));
            assert!(unit && origin, "{name} lacks its unit or its origin:{comment}");
        }
        comment.clear();
    }
    assert!(count > 100, "only {count} numbers were found");
}

#[test]
fn declarations_are_recognised() {
    for (line, expected) in [
        ("const A: f64 = 1.0;", Some(("A", true))),
        ("    pub(in crate::report) const A_1: [&[f64]; 2] = [", Some(("A_1", true))),
        ("pub static A: (usize, &str) = (1, \"\");", Some(("A", true))),
        ("const A: [&str; 2] = [\"\", \"\"];", Some(("A", false))),
        ("pub const fn a(self) -> f64 {", None),
        ("let a: f64 = 1.0;", None),
    ] {
        assert_eq!(declared(line).map(|(name, kind)| (name, is_numeric(kind))), expected, "{line}");
    }
}
