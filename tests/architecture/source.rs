//! The workspace as text: its crates, their manifests and their source files.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// A member of the workspace.
pub(crate) struct Crate {
    /// Its folder from the workspace's root.
    pub(crate) folder: String,
    /// Its Cargo.toml.
    pub(crate) manifest: toml::Table,
}

/// A Rust file.
pub(crate) struct SourceFile {
    /// From the workspace's root.
    pub(crate) path: PathBuf,
    /// Number of lines, comments included.
    pub(crate) lines: usize,
    /// Its text with comments and literals replaced by spaces, line by line.
    pub(crate) code: String,
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("tests/ lies in the workspace").to_owned()
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn manifest(folder: &Path) -> toml::Table {
    let path = folder.join("Cargo.toml");
    read(&path).parse().unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// All members of the workspace.
pub(crate) fn crates() -> impl Iterator<Item = Crate> {
    let workspace = manifest(&root());
    let members = workspace["workspace"]["members"].as_array().expect("members is a list").clone();
    members.into_iter().map(|member| {
        let folder = member.as_str().expect("a member is a folder").to_owned();
        let manifest = manifest(&root().join(&folder));
        Crate { folder, manifest }
    })
}

impl Crate {
    /// The names in one of its tables of dependencies.
    pub(crate) fn dependencies(&self, table: &str) -> BTreeSet<String> {
        let table = self.manifest.get(table).and_then(toml::Value::as_table);
        table.into_iter().flat_map(|table| table.keys().cloned()).collect()
    }

    /// Its Rust files.
    pub(crate) fn sources(&self) -> Vec<SourceFile> {
        let mut paths = Vec::new();
        walk(&root().join(&self.folder), &mut paths);
        paths.retain(|path| path.extension().is_some_and(|extension| extension == "rs"));
        assert!(!paths.is_empty(), "{}: no Rust file found", self.folder);
        let source = |path: PathBuf| {
            let text = read(&path);
            SourceFile { path: relative(&path), lines: text.lines().count(), code: without_prose(&text) }
        };
        paths.into_iter().map(source).collect()
    }
}

impl SourceFile {
    /// The same file with a part of its code.
    pub(crate) fn with_code(&self, code: &str) -> SourceFile {
        SourceFile { path: self.path.clone(), lines: self.lines, code: code.to_owned() }
    }

    /// Every identifier and keyword with its line.
    pub(crate) fn words(&self) -> impl Iterator<Item = (usize, String)> {
        self.code.lines().enumerate().flat_map(|(index, line)| {
            line.split(|c: char| !c.is_alphanumeric() && c != '_')
                .filter(|word| !word.is_empty())
                .map(move |word| (index + 1, word.to_owned()))
        })
    }

    /// The first path segment after every `name::`, groups in braces included.
    pub(crate) fn used_modules(&self, name: &str) -> BTreeSet<String> {
        let mut modules = BTreeSet::new();
        for (_, rest) in self.code.split(name).enumerate().skip(1) {
            let Some(path) = rest.trim_start().strip_prefix("::") else { continue };
            match path.trim_start().strip_prefix('{') {
                Some(group) => modules.extend(heads_of_group(group)),
                None => modules.extend(head(path)),
            }
        }
        modules
    }
}

fn head(path: &str) -> Option<String> {
    let head = path.trim_start().split(|c: char| !c.is_alphanumeric() && c != '_').next();
    head.filter(|head| !head.is_empty()).map(str::to_owned)
}

/// `a, b::{c, d}, e}` gives a, b and e.
fn heads_of_group(group: &str) -> Vec<String> {
    let (mut depth, mut start, mut heads) = (0, 0, Vec::new());
    for (at, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            ',' | '}' if depth == 0 => {
                heads.extend(head(&group[start..at]));
                start = at + 1;
                if c == '}' {
                    break;
                }
            }
            '}' => depth -= 1,
            _ => {}
        }
    }
    heads
}

/// Every text file that is committed or about to be.
pub(crate) fn committed_texts() -> impl Iterator<Item = (PathBuf, String)> {
    let mut paths = Vec::new();
    walk(&root(), &mut paths);
    let text = |path: PathBuf| Some((relative(&path), fs::read_to_string(&path).ok()?));
    paths.into_iter().filter_map(text)
}

fn relative(path: &Path) -> PathBuf {
    path.strip_prefix(root()).unwrap_or(path).to_owned()
}

fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
    let entries = fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    for entry in entries {
        let path = entry.expect("a folder that can be read").path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() {
            if !name.starts_with("target") && name != ".git" && name != "node_modules" {
                walk(&path, found);
            }
        } else if name != ".git" {
            found.push(path);
        }
    }
}

/// The code with comments, strings and characters replaced by spaces.
fn without_prose(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let before = out.chars().next_back();
        let skipped = match first {
            '/' if rest.starts_with("//") => rest.find('\n').unwrap_or(rest.len()),
            '/' if rest.starts_with("/*") => block_comment(rest),
            '"' => string(rest),
            'r' if !before.is_some_and(|c| c.is_alphanumeric() && c != 'b' || c == '_') => raw_string(rest),
            '\'' => character(rest),
            _ => 0,
        };
        if skipped == 0 {
            out.push(first);
            rest = &rest[first.len_utf8()..];
        } else {
            out.extend(rest[..skipped].chars().filter(|c| *c == '\n'));
            out.push(' ');
            rest = &rest[skipped..];
        }
    }
    out
}

fn block_comment(text: &str) -> usize {
    let mut depth = 0;
    let mut at = 0;
    while at < text.len() {
        if text[at..].starts_with("/*") {
            depth += 1;
            at += 2;
        } else if text[at..].starts_with("*/") {
            depth -= 1;
            at += 2;
            if depth == 0 {
                return at;
            }
        } else {
            at += text[at..].chars().next().map_or(1, char::len_utf8);
        }
    }
    text.len()
}

fn string(text: &str) -> usize {
    let mut escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        match c {
            _ if escaped => escaped = false,
            '\\' => escaped = true,
            '"' => return at + 1,
            _ => {}
        }
    }
    text.len()
}

/// Length of `r"…"` or `r#"…"#`; 0 for anything else that begins with an r.
fn raw_string(text: &str) -> usize {
    let hashes = text[1..].chars().take_while(|c| *c == '#').count();
    if !text[1 + hashes..].starts_with('"') {
        return 0;
    }
    let end = format!("\"{}", "#".repeat(hashes));
    let body = 2 + hashes;
    text[body..].find(&end).map_or(text.len(), |at| body + at + end.len())
}

/// Length of a character; 0 for a lifetime.
fn character(text: &str) -> usize {
    let mut chars = text.char_indices().skip(1);
    match chars.next() {
        Some((_, '\\')) => {
            text[2..].char_indices().skip(1).find(|(_, c)| *c == '\'').map_or(0, |(at, _)| at + 3)
        }
        Some((at, c)) if text[at + c.len_utf8()..].starts_with('\'') => at + c.len_utf8() + 1,
        _ => 0,
    }
}

#[test]
fn prose_is_blanked_and_code_is_not() {
    let text = "let a = \"unsafe \\\" \"; // unsafe\n/* un /* safe */ */ b('\\'', 'x', r#\"q\"unsafe\"#); fn f<'a>(){ unsafe }";
    let code = without_prose(text);
    assert_eq!(code.matches("unsafe").count(), 1, "{code}");
    assert!(code.contains("fn f<'a>()") && code.contains("let a ="), "{code}");
    assert_eq!(code.lines().count(), 2);
}

#[test]
fn modules_are_found_in_groups() {
    let code = "use it::{a, b::{c, d}, e}; use it::f::g; it::h();".to_owned();
    let file = SourceFile { path: PathBuf::new(), lines: 1, code };
    let found: Vec<String> = file.used_modules("it").into_iter().collect();
    assert_eq!(found, ["a", "b", "e", "f", "h"]);
}
