//! Limits of size: of documents, of the service.

use std::path::Path;

use super::source::{committed_texts, crates};

#[test]
fn documents_and_service_stay_within_their_limits() {
    let is_document =
        |path: &Path| path.extension().is_some_and(|end| end == "md") && !path.starts_with(".ci/advisories");
    let documents: Vec<_> = committed_texts().filter(|(path, _)| is_document(path)).collect();
    let words: usize = documents.iter().map(|(_, text)| text.split_whitespace().count()).sum();
    assert!((20_000..=45_000).contains(&words), "{words} words in documents");
    let text = |name: &str| {
        documents.iter().find(|(path, _)| path == Path::new(name)).expect("a document").1.clone()
    };
    let readme = text("README.md").lines().count();
    assert!(readme <= 150, "README.md has {readme} lines");
    let architecture = text("ARCHITECTURE.md");
    let (_, path) =
        architecture.split_once("## From one datagram to one torque").expect("the path of a datagram");
    let lines = path.split("\n## ").next().unwrap_or_default().lines().count();
    assert!(lines <= 60, "the path of a datagram has {lines} lines");
    let daemon = crates().find(|found| found.folder == "daemon").expect("a daemon");
    let lines: usize = daemon.sources().iter().map(|file| file.lines).sum();
    assert!((5_000..=15_000).contains(&lines), "daemon/ has {lines} lines");
}
