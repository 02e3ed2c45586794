//! The order of the stages in `core::cycle::step` and `process` is a property of their types: exchanging two adjacent
//! stages of which one uses the output of the other does not compile.
//!
//! The stages are private to the core, so a `compile_fail` documentation test cannot name them. This test compiles a
//! copy of the core to which one copy of the function is appended per pair of adjacent statements, with this pair
//! exchanged, and reads the compiler's errors.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// Adjacent statements that may be exchanged: none of a pair accesses what the other changes, so that both
/// orders give the same state.
const INDEPENDENT: [[&str; 2]; 5] = [
    ["compare_with_suggestion", "predict_unloaded"],
    ["m.ground.ingest_load", "test_lag"],
    ["update_exposure", "m.early.ingest"],
    ["m.early.ingest", "residual"],
    ["residual", "m.publication.hold"],
];

/// A copy of a function with two adjacent statements exchanged, and its lines in the compiled file, from 1.
struct Exchanged {
    /// Functions that the two statements call first.
    pair: [String; 2],
    lines: std::ops::Range<u64>,
}

#[test]
fn exchanged_stages_do_not_compile() {
    let copy = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("stage_order");
    copy_core(&copy);
    let file = copy.join("core/src/cycle.rs");
    let mut source = std::fs::read_to_string(&file).unwrap();
    let mut exchanged = append_exchanged(&mut source, "step");
    assert!(exchanged.len() > 5, "found {} pairs in `step`", exchanged.len());
    let of_instant = append_exchanged(&mut source, "process");
    assert!(of_instant.len() > 10, "found {} pairs in `process`", of_instant.len());
    exchanged.extend(of_instant);
    std::fs::write(&file, source).unwrap();

    let error_lines = error_lines(&copy);
    let first = exchanged[0].lines.start;
    assert!(error_lines.iter().all(|line| *line >= first), "the unchanged core has errors: {error_lines:?}");
    let compiles = |one: &&Exchanged| error_lines.range(one.lines.clone()).next().is_none();
    let compiling: Vec<[&str; 2]> =
        exchanged.iter().filter(compiles).map(|one| one.pair.each_ref().map(String::as_str)).collect();
    assert_eq!(compiling, INDEPENDENT, "pairs that compile");
}

/// Copies the core into a workspace of its own, with the same versions of its dependencies.
fn copy_core(copy: &Path) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let manifest = std::fs::read_to_string(root.join("Cargo.toml")).expect("cannot read Cargo.toml");
    let mut manifest: toml::Table = manifest.parse().expect("Cargo.toml is invalid");
    let workspace = manifest["workspace"].as_table_mut().expect("no workspace");
    workspace.insert("members".to_owned(), vec!["core"].into());
    workspace.remove("default-members");
    let _ = std::fs::remove_dir_all(copy.join("core"));
    std::fs::create_dir_all(copy).expect("cannot create the copy");
    std::fs::write(copy.join("Cargo.toml"), manifest.to_string()).expect("cannot write Cargo.toml");
    std::fs::copy(root.join("Cargo.lock"), copy.join("Cargo.lock")).expect("cannot copy Cargo.lock");
    copy_directory(&root.join("core"), &copy.join("core"));
}

fn copy_directory(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("cannot create a directory");
    for entry in std::fs::read_dir(from).expect("cannot list a directory").flatten() {
        let target = to.join(entry.file_name());
        if entry.file_type().expect("cannot read a file type").is_dir() {
            copy_directory(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).expect("cannot copy a file");
        }
    }
}

/// Appends one copy of a function per pair of adjacent statements.
fn append_exchanged(source: &mut String, name: &str) -> Vec<Exchanged> {
    let is_named = |at: &usize| source[at + 3 + name.len()..].starts_with(['(', '<']);
    let head = format!("fn {name}");
    let mut starts = source.match_indices(&head).map(|(at, _)| at).filter(is_named);
    let start = starts.next().unwrap_or_else(|| panic!("cycle.rs has no function `{name}`"));
    let length = source[start..].find("\n}\n").expect("the function has no end");
    let function = source[start..start + length].to_owned();
    let (head, body) = function.split_once(" {\n").expect("the function has no body");
    let (statements, result) = statements(body);
    (1..statements.len())
        .map(|second| {
            let mut order = statements.clone();
            order.swap(second - 1, second);
            let head = head.replacen(&format!("fn {name}"), &format!("fn {name}_exchanged_{second}"), 1);
            let from = source.lines().count() as u64 + 1;
            source.push_str(&format!(
                "#[allow(warnings, clippy::all)]\n{head} {{\n{}{result}\n}}\n",
                order.concat()
            ));
            let pair = [second - 1, second].map(|index| called(&statements[index]));
            Exchanged { pair, lines: from..source.lines().count() as u64 + 1 }
        })
        .collect()
}

/// The statements of a function's body, and the expression that it ends with, if any.
fn statements(body: &str) -> (Vec<String>, String) {
    let (mut statements, mut statement, mut depth) = (Vec::new(), String::new(), 0_i32);
    for line in body.lines() {
        statement.push_str(line);
        statement.push('\n');
        let count = |brackets: &[char]| line.matches(brackets).count() as i32;
        depth += count(&['(', '{']) - count(&[')', '}']);
        if depth == 0 && line.ends_with([';', '}']) {
            statements.push(std::mem::take(&mut statement));
        }
    }
    assert!(statement.lines().count() <= 1, "the last statement is incomplete: {statement}");
    (statements, statement)
}

/// The function that a statement calls first; the variable that it sets if it calls none.
fn called(statement: &str) -> String {
    let name = |text: &str| text.rsplit([' ', '\n', '!']).next().unwrap_or(text).to_owned();
    statement
        .split_once('(')
        .map_or_else(|| name(statement.split(" = ").next().unwrap_or_default()), |(head, _)| name(head))
}

/// Lines of `cycle.rs` with compiler errors.
fn error_lines(copy: &Path) -> BTreeSet<u64> {
    let output = Command::new(env!("CARGO"))
        .args(["check", "--offline", "--quiet", "--message-format=json", "--lib"])
        .env("CARGO_TARGET_DIR", copy.join("target"))
        .current_dir(copy)
        .output()
        .expect("cannot start cargo");
    let stdout = String::from_utf8_lossy(&output.stdout);
    let messages = stdout.lines().map(|line| serde_json::from_str::<Value>(line).unwrap_or_default());
    let errors = messages.filter(|message| message["message"]["level"] == "error");
    let lines: BTreeSet<u64> = errors
        .flat_map(|error| error["message"]["spans"].as_array().cloned().unwrap_or_default())
        .filter(|span| {
            span["is_primary"] == true
                && span["file_name"].as_str().is_some_and(|file| file.ends_with("cycle.rs"))
        })
        .filter_map(|span| span["line_start"].as_u64())
        .collect();
    assert!(!lines.is_empty(), "no errors in cycle.rs: {}", String::from_utf8_lossy(&output.stderr));
    lines
}
