//! The simulator must not depend on the estimator's models: otherwise its agreement would be no evidence.

use std::path::Path;

/// Names, frames, messages and the library of poses are shared; tables and estimators are not.
const SHARED: [&str; 6] = [
    "equipoise_core::body::{",
    "equipoise_core::body::S",
    "equipoise_core::body::JOINTS",
    "equipoise_core::frame::",
    "equipoise_core::message::",
    "equipoise_core::pose_suggestion::",
];

#[test]
fn nothing_of_the_estimator_is_used() {
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("src")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let text = std::fs::read_to_string(&path).unwrap();
            for line in text.lines().filter(|line| line.contains("equipoise_core::")) {
                assert!(SHARED.iter().any(|shared| line.contains(shared)), "{}: {line}", path.display());
                assert!(!line.contains("anthropometry") && !line.contains("Anthropometry"), "{line}");
            }
        }
    }
}
