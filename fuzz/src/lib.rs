//! The laws of `adapters/tests/laws`, for libFuzzer.
#![forbid(unsafe_code)]

mod config;
#[path = "../../adapters/tests/laws/mod.rs"]
mod laws;

use laws::Law;

fn all() -> impl Iterator<Item = &'static Law> {
    let all = laws::LAWS.iter();
    let all = all.chain(&config::LAWS);
    all
}

/// Tries one law.
///
/// # Panics
/// If the bytes break it, or there is no such law.
pub fn check(name: &str, bytes: &[u8]) {
    let law = all().find(|law| law.name == name);
    (law.unwrap_or_else(|| panic!("no law {name}")).check)(bytes);
}

/// The inputs to begin with, by law.
pub fn seeds() -> impl Iterator<Item = (&'static str, Vec<Vec<u8>>)> {
    all().map(|law| (law.name, (law.seeds)()))
}
