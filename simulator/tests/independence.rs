//! The simulator's opinion is worth something only while it is its own.

use std::path::Path;

/// Names, messages and the library of poses are shared; tables and estimators are not.
const SHARED: [&str; 4] = [
    "equipoise_core::body::{",
    "equipoise_core::body::S",
    "equipoise_core::message::",
    "equipoise_core::pose_suggestion::",
];

#[test]
fn nothing_of_the_estimator_is_used() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for entry in std::fs::read_dir(source).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        for line in text.lines().filter(|line| line.contains("equipoise_core::")) {
            assert!(SHARED.iter().any(|shared| line.contains(shared)), "{}: {line}", path.display());
            assert!(!line.contains("anthropometry") && !line.contains("Anthropometry"), "{line}");
        }
    }
}
