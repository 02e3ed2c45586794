//! The simulator must not depend on the estimator's models: otherwise its agreement would be no evidence.

use std::path::Path;

/// Shared items of the estimator's crate: names of the body's parts, messages, the library of poses. Body models and
/// estimators are not.
const SHARED: [&str; 13] = [
    "body::JOINTS",
    "body::Joint",
    "body::SEGMENTS",
    "body::Segment",
    "body::Side",
    "message::Component",
    "message::FootFrame",
    "message::GroundDevice",
    "message::GroundSample",
    "message::SuitSample",
    "message::suit::SuitBlocks",
    "pose_suggestion::Posture",
    "pose_suggestion::library::LIBRARY",
];

/// Appends the paths of a use tree or an expression that begins at `text`, each after `prefix`; returns the rest.
fn push_paths<'a>(prefix: &str, text: &'a str, paths: &mut Vec<String>) -> &'a str {
    let text = text.trim_start();
    if let Some(mut group) = text.strip_prefix('{') {
        loop {
            group = push_paths(prefix, group, paths);
            // Skips the new name after `as`.
            let end = group.find([',', '}']).expect("a group ends");
            let is_last = group.as_bytes()[end] == b'}';
            group = group[end + 1..].trim_start();
            if is_last {
                return group;
            }
            if let Some(rest) = group.strip_prefix('}') {
                return rest;
            }
        }
    }
    let is_in_name = |c: char| c.is_alphanumeric() || c == '_' || c == '*';
    let (name, rest) = text.split_at(text.find(|c| !is_in_name(c)).unwrap_or(text.len()));
    let path = format!("{prefix}{name}");
    match rest.trim_start().strip_prefix("::") {
        Some(below) => push_paths(&format!("{path}::"), below, paths),
        None => {
            paths.push(path);
            rest
        }
    }
}

/// Paths below `equipoise_core` that a source text names, comments excluded; empty for the crate itself.
fn paths(source: &str) -> Vec<String> {
    let code: Vec<&str> =
        source.lines().map(|line| line.split_once("//").map_or(line, |(code, _)| code)).collect();
    let code = code.join("\n");
    let mut paths = Vec::new();
    for (at, name) in code.match_indices("equipoise_core") {
        match code[at + name.len()..].trim_start().strip_prefix("::") {
            Some(below) => {
                push_paths("", below, &mut paths);
            }
            None => paths.push(String::new()),
        }
    }
    paths
}

fn is_shared(path: &str) -> bool {
    let below = |shared: &&str| path.strip_prefix(*shared).is_some_and(|rest| rest.starts_with("::"));
    SHARED.contains(&path) || SHARED.iter().any(below)
}

#[test]
fn nothing_of_the_estimator_is_used() {
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("src")];
    let mut count = 0;
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            for name in paths(&std::fs::read_to_string(&path).unwrap()) {
                assert!(is_shared(&name), "{}: equipoise_core::{name}", path.display());
                count += 1;
            }
        }
    }
    assert!(count > SHARED.len(), "{count}");
}

#[test]
fn models_of_the_body_are_not_shared_however_they_are_imported() {
    for (source, count) in [
        ("use equipoise_core::body::{SEGMENTS, Skeleton};", 1),
        ("use equipoise_core::body::{\n    Anthropometry,\n    Segment,\n};", 1),
        ("use equipoise_core::{body::{Segment, Skeleton as S}, sesc::Phi};", 2),
        ("let table = equipoise_core::body::Anthropometry::de_leva(&skeleton, 1.8, sex);", 1),
        ("use equipoise_core::body;", 1),
        ("use equipoise_core::body::{self, Side};", 1),
        ("use equipoise_core::body::*;", 1),
        ("use equipoise_core as core;", 1),
        ("use equipoise_core::body::{Segment, Side}; // not equipoise_core::body::Skeleton", 0),
        ("equipoise_core::body::Segment::LeftFoot.index()", 0),
    ] {
        let found = paths(source).into_iter().filter(|path| !is_shared(path)).count();
        assert_eq!(found, count, "{source}");
    }
}
