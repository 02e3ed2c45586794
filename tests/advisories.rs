//! Checks Cargo.lock for known vulnerabilities, by a copy of the RustSec advisories, without a network.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use semver::{Prerelease, Version, VersionReq};
use serde::Deserialize;

/// Advisories that affect a version in use and are accepted, each with the reason. Delete those that no longer affect
/// any.
const ACCEPTED: [(&str, &str); 5] = [
    (
        "RUSTSEC-2024-0436",
        "paste is no longer maintained; a macro that mcap uses while it is built, and nothing at run time",
    ),
    (
        "RUSTSEC-2023-0071",
        "rsa leaks its key by timing, in every version; OPC UA's policies are RSA, and only \
         equipoise-gateway-opcua has it (docs/consumers/opcua.md)",
    ),
    (
        "RUSTSEC-2023-0089",
        "atomic-polyfill is no longer maintained; for processors without atomics, so never built here",
    ),
    (
        "RUSTSEC-2025-0134",
        "rustls-pemfile is no longer maintained; zenoh reads the certificates of its own configuration with it",
    ),
    (
        "RUSTSEC-2026-0041",
        "lz4_flex decompresses unsafely; zenoh calls it in its feature transport_compression only, which is off",
    ),
];

#[derive(Debug, Deserialize)]
struct Deny {
    advisories: DenyAdvisories,
}

#[derive(Debug, Deserialize)]
struct DenyAdvisories {
    ignore: Vec<DenyIgnored>,
}

#[derive(Debug, Deserialize)]
struct DenyIgnored {
    id: String,
    reason: String,
}

#[derive(Debug, Deserialize)]
struct Lock {
    package: Vec<Package>,
}

#[derive(Debug, Deserialize)]
struct Package {
    name: String,
    version: Version,
    /// Absent for crates of the workspace.
    source: Option<String>,
}

/// The metadata of an advisory; other fields are ignored.
#[derive(Debug, Deserialize)]
struct Advisory {
    advisory: Head,
    #[serde(default)]
    versions: Versions,
}

#[derive(Debug, Deserialize)]
struct Head {
    id: String,
    package: String,
    withdrawn: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
struct Versions {
    #[serde(default)]
    patched: Vec<VersionReq>,
    #[serde(default)]
    unaffected: Vec<VersionReq>,
}

impl Advisory {
    fn parse(text: &str) -> Advisory {
        let rest = text.strip_prefix("```toml\n").expect("an advisory begins with its metadata");
        let (metadata, _) = rest.split_once("\n```").expect("the metadata has an end");
        toml::from_str(metadata).expect("metadata as RustSec writes it")
    }

    fn affects(&self, package: &Package) -> bool {
        // Version ranges exclude pre-releases; here one counts as its release.
        let version = Version { pre: Prerelease::EMPTY, ..package.version.clone() };
        let mut sound = self.versions.patched.iter().chain(&self.versions.unaffected);
        self.advisory.withdrawn.is_none()
            && self.advisory.package == package.name
            && !sound.any(|range| range.matches(&version))
    }
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../.ci/advisories")
}

/// Every stored advisory, with its text.
fn kept() -> Vec<(Advisory, String)> {
    let entries = |path: PathBuf| {
        std::fs::read_dir(path).expect("a folder").map(|entry| entry.expect("an entry").path())
    };
    entries(folder().join("crates"))
        .flat_map(entries)
        .map(|path| std::fs::read_to_string(path).expect("an advisory"))
        .map(|text| (Advisory::parse(&text), text))
        .collect()
}

fn locked(text: &str) -> Vec<Package> {
    let lock: Lock = toml::from_str(text).expect("Cargo.lock");
    lock.package.into_iter().filter(|package| package.source.is_some()).collect()
}

fn cargo_lock() -> Vec<Package> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../Cargo.lock");
    locked(&std::fs::read_to_string(path).expect("Cargo.lock"))
}

/// Advisory → the package that it affects, with the advisory's text.
fn affected(packages: &[Package], advisories: &[(Advisory, String)]) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    for (advisory, text) in advisories {
        for package in packages.iter().filter(|package| advisory.affects(package)) {
            let shown = format!("{} {}:\n{text}", package.name, package.version);
            found.insert(advisory.advisory.id.clone(), shown);
        }
    }
    found
}

#[test]
fn no_crate_in_use_has_a_known_weakness() {
    let advisories = kept();
    assert!(advisories.len() > 20, "only {} advisories are kept", advisories.len());
    let mut found = affected(&cargo_lock(), &advisories);
    for (id, reason) in ACCEPTED {
        assert!(found.remove(id).is_some(), "{id} ({reason}) affects nothing any more: delete the line");
    }
    let shown: Vec<_> = found.into_values().collect();
    assert!(shown.is_empty(), "take another version, or accept it with a reason:\n{}", shown.join("\n"));
}

#[test]
fn cargo_deny_accepts_what_is_accepted_here_and_nothing_else() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../deny.toml");
    let settings: Deny =
        toml::from_str(&std::fs::read_to_string(path).expect("deny.toml")).expect("its form");
    assert!(settings.advisories.ignore.iter().all(|one| !one.reason.is_empty()), "each has a reason");
    let there: Vec<_> = settings.advisories.ignore.iter().map(|one| &*one.id).collect();
    assert_eq!(there, ACCEPTED.map(|(id, _)| id), "deny.toml and ACCEPTED name the same, in one order");
}

#[test]
fn every_crate_in_use_was_looked_for() {
    let text = std::fs::read_to_string(folder().join("looked-at")).expect("the list");
    let looked_at: BTreeSet<&str> = text.lines().collect();
    let used = cargo_lock();
    let missing: BTreeSet<_> =
        used.iter().map(|package| &*package.name).filter(|name| !looked_at.contains(name)).collect();
    assert!(missing.is_empty(), "these were not looked for: {missing:?}: see .ci/advisories/README.md");
}

#[test]
fn a_weak_version_in_a_lock_would_be_found() {
    let lock = |name: &str, version: &str| {
        locked(&format!(
            "version = 4\n[[package]]\nname = \"{name}\"\nversion = \"{version}\"\nsource = \"registry\"\n"
        ))
    };
    let found = |name: &str, version: &str| affected(&lock(name, version), &kept());
    // Ranges with both ends, with one, with a caret; never-affected versions.
    assert!(found("smallvec", "0.6.9").contains_key("RUSTSEC-2019-0009"));
    assert!(!found("smallvec", "0.6.10").contains_key("RUSTSEC-2019-0009"));
    assert!(!found("smallvec", "0.6.2").contains_key("RUSTSEC-2019-0009"));
    assert!(found("bytes", "1.11.0").contains_key("RUSTSEC-2026-0007"));
    assert!(found("bytes", "1.11.0-rc.1").contains_key("RUSTSEC-2026-0007"));
    assert!(found("bytes", "1.11.1").is_empty() && found("bytes", "1.2.0").is_empty());
    assert!(found("zerocopy", "0.5.1").len() == 1 && found("zerocopy", "0.5.2").is_empty());
    assert!(found("no-such-crate", "1.0.0").is_empty());
    let withdrawn = "```toml\n[advisory]\nid = \"X\"\npackage = \"bytes\"\nwithdrawn = \"2020-01-01\"\n```\n";
    let advisories = [(Advisory::parse(withdrawn), withdrawn.to_owned())];
    assert!(affected(&lock("bytes", "1.0.0"), &advisories).is_empty());
}
