//! Architecture rules as tests: permitted dependencies between crates, and forbidden constructs.
//!
//! Works on the source text; comments and string literals are removed first.

#[path = "architecture/language.rs"]
mod language;
#[path = "architecture/limits.rs"]
mod limits;
#[path = "architecture/order.rs"]
mod order;
#[path = "architecture/source.rs"]
mod source;

use std::collections::BTreeSet;
use std::path::Path;

use source::{Crate, committed_texts, crates};

/// Permitted dependencies of each crate outside its tests, each crate after those that it uses. A new crate requires a
/// line here.
const MAY_USE: [(&str, &[&str]); 24] = [
    ("core", &[]),
    ("latency", &["core"]),
    ("files", &[]),
    ("bus", &["core", "latency"]),
    ("adapters", &["core", "bus", "latency", "files"]),
    ("config", &["core", "files", "adapters"]),
    ("station", &["bus", "files"]),
    // Has its own encoders: one derived from the parser would be no independent check.
    ("simulator", &["core"]),
    ("studies", &["core", "simulator", "adapters"]),
    ("view", &["core", "bus", "latency"]),
    ("recording", &["core", "latency", "bus", "files", "adapters", "config", "station", "view"]),
    ("discrepancy", &["core", "latency", "adapters", "config", "recording", "view"]),
    ("clients/rust", &["core", "bus"]),
    // Consumers that forward states.
    ("gateways", &["core", "client", "config", "station"]),
    ("export", &["core", "adapters"]),
    ("gateways/foxglove", &["core", "client", "gateways", "view"]),
    ("gateways/mqtt", &["core", "client", "files", "gateways", "view"]),
    ("gateways/opcua", &["core", "client", "files", "gateways"]),
    ("gateways/zenoh", &["core", "client", "files", "gateways", "view"]),
    // The service links no simulator, report, page or gateway.
    ("daemon", &["core", "latency", "bus", "files", "adapters", "config", "station"]),
    // The command line program.
    (
        "cli",
        &[
            "core",
            "latency",
            "bus",
            "files",
            "adapters",
            "config",
            "station",
            "recording",
            "daemon",
            "simulator",
            "discrepancy",
            "view",
            "gateways",
            "export",
        ],
    ),
    ("clients/c", &["core", "bus", "client"]),
    ("tests", &[]),
    // They measure the real loop and its threads.
    ("benches", &["core", "latency", "bus", "adapters", "config", "simulator", "daemon"]),
];

/// Parts of the core that the simulator must not use: agreement would then be no evidence.
const NOT_FOR_THE_SIMULATOR: [&str; 8] =
    ["sesc", "kalman", "overload", "exposure", "cycle", "anchor", "static_pose", "effect"];

/// The traits and derives that messages require; the core uses nothing else of iceoryx2.
const CORE_OF_ICEORYX2: [&str; 2] = ["iceoryx2-bb-derive-macros", "iceoryx2-bb-elementary-traits"];

const LINES_REPORTED: usize = 400;
const LINES_MAX: usize = 450;

/// A crate's name without the common part.
fn name_of(folder: &str) -> &str {
    if folder == "clients/rust" { "client" } else { folder }
}

#[test]
fn dependencies_follow_the_layers() {
    for found in crates() {
        let allowed = MAY_USE.iter().find(|(folder, _)| *folder == found.folder);
        let (_, allowed) = allowed.unwrap_or_else(|| panic!("{} is missing in MAY_USE", found.folder));
        for dependency in found.dependencies("dependencies") {
            if let Some(ours) = dependency.strip_prefix("equipoise-") {
                assert!(allowed.contains(&ours), "{} must not depend on {ours}", found.folder);
            }
        }
    }
}

#[test]
fn only_the_program_tests_and_benches_depend_on_the_daemon() {
    for found in
        crates().filter(|found| !["daemon", "cli", "tests", "benches"].contains(&found.folder.as_str()))
    {
        for table in ["dependencies", "dev-dependencies", "build-dependencies"] {
            let uses = found.dependencies(table).contains("equipoise-daemon");
            assert!(!uses, "{} must not depend on the daemon ({table})", found.folder);
        }
    }
}

#[test]
fn only_the_bus_depends_on_iceoryx2() {
    for found in crates().filter(|found| found.folder != "bus") {
        let allowed: &[&str] = if found.folder == "core" { &CORE_OF_ICEORYX2 } else { &[] };
        for table in ["dependencies", "dev-dependencies", "build-dependencies"] {
            for dependency in found.dependencies(table).iter().filter(|name| name.starts_with("iceoryx2")) {
                let allowed = allowed.contains(&dependency.as_str());
                assert!(allowed, "{} names {dependency}: use bus/", found.folder);
            }
        }
        let allowed: Vec<String> = allowed.iter().map(|name| name.replace('-', "_")).collect();
        for file in found.sources() {
            for (line, word) in file.words().filter(|(_, word)| word.starts_with("iceoryx2")) {
                let place = format!("{}:{line}", file.path.display());
                assert!(allowed.contains(&word), "{place} names {word}: use bus/");
            }
        }
    }
}

#[test]
fn unsafe_is_limited_to_listed_files() {
    let expected = |path: &str| {
        path.starts_with("bus/")
            || path.starts_with("daemon/src/realtime")
            // The C interface.
            || path == "clients/c/src/ffi.rs"
            || (path.starts_with("tests/") && path.contains("alloc"))
    };
    for found in crates() {
        for file in found.sources() {
            let path = file.path.to_string_lossy();
            let line = file.words().find(|(_, word)| word == "unsafe").map(|(line, _)| line);
            assert!(line.is_none() || expected(&path), "{path}:{}: unsafe", line.unwrap_or_default());
        }
    }
}

/// Calls that open an existing file, whatever it is.
const OPENING_CALLS: [&str; 10] = [
    "File::open(",
    "File::options(",
    "File::create(",
    "OpenOptions::new(",
    "fs::copy(",
    "fs::read(",
    "fs::read_to_string(",
    "fs::write(",
    "pem_file_iter(",
    "rustix::fs::open(",
];
/// Files that open files directly, with the call.
const OPENED_DIRECTLY: [(&str, &str); 21] = [
    // The openers, and folders that are synced.
    ("files/src/open.rs", "rustix::fs::open("),
    ("files/src/atomic_file.rs", "File::open("),
    ("cli/src/deletion.rs", "File::open("),
    ("cli/src/install/files.rs", "File::open("),
    // Information of the kernel and the system.
    ("adapters/src/source/serial_line/refused.rs", "fs::read_to_string("),
    ("cli/src/commands/export.rs", "fs::read_to_string("),
    ("cli/src/doctor/facts.rs", "fs::read_to_string("),
    ("cli/src/doctor/ports.rs", "fs::read_to_string("),
    ("daemon/src/station_file.rs", "fs::read_to_string("),
    ("daemon/src/supervision/host_clock.rs", "fs::read_to_string("),
    ("station/src/proc.rs", "fs::read_to_string("),
    ("station/src/process_state.rs", "fs::read_to_string("),
    // Devices and pipes of sensors, opened without waiting.
    ("adapters/src/source/file_line.rs", "OpenOptions::new("),
    ("adapters/src/source/serial_line.rs", "rustix::fs::open("),
    // Output that a command names, which may be a pipe.
    ("adapters/src/capture/pcap_writer.rs", "File::create("),
    ("cli/src/commands/latency.rs", "OpenOptions::new("),
    ("recording/src/replay/output.rs", "File::create("),
    // Files in a folder that was just created.
    ("discrepancy/src/session_report/pdf.rs", "fs::write("),
    ("discrepancy/src/workflow/output.rs", "fs::write("),
    // The program and its units, which are installed.
    ("cli/src/install.rs", "fs::read("),
    ("cli/src/install/files.rs", "fs::read("),
];

/// The calls of [`OPENING_CALLS`] in this code; without those that never open an existing file (`create_new`).
fn opening_calls(code: &str) -> Vec<&'static str> {
    let is_opening = |(at, call): &(usize, &str)| {
        let is_call = !code[..*at].ends_with(|before: char| before.is_alphanumeric() || before == '_');
        let options = code[*at..].split(".open(").next().unwrap_or_default();
        is_call && !(*call == "OpenOptions::new(" && options.contains("create_new(true)"))
    };
    OPENING_CALLS
        .into_iter()
        .filter(|call| code.match_indices(*call).any(|found| is_opening(&found)))
        .collect()
}

#[test]
fn files_are_opened_by_the_files_crate() {
    // Crates that run at the station; studies and the simulator read only their own files.
    let shipped = [
        "adapters",
        "bus",
        "cli",
        "clients",
        "config",
        "daemon",
        "discrepancy",
        "export",
        "files",
        "gateways",
        "latency",
        "recording",
        "station",
        "view",
    ];
    let is_shipped = |found: &Crate| found.folder.split('/').next().is_some_and(|top| shipped.contains(&top));
    let mut found_directly: BTreeSet<&(&str, &str)> = BTreeSet::new();
    for found in crates().filter(is_shipped) {
        for file in
            found.sources().into_iter().filter(|file| file.path.starts_with(found.folder.clone() + "/src"))
        {
            let path = file.path.to_string_lossy().into_owned();
            let outside_tests = file.code.split("mod tests {").next().unwrap_or_default();
            for call in opening_calls(outside_tests) {
                let expected = OPENED_DIRECTLY.iter().find(|expected| **expected == (path.as_str(), call));
                assert!(
                    expected.is_some() || path.contains("/tests"),
                    "{path}: {call} …): open it by files/"
                );
                found_directly.extend(expected);
            }
        }
    }
    let unused: Vec<_> =
        OPENED_DIRECTLY.iter().filter(|expected| !found_directly.contains(*expected)).collect();
    assert!(unused.is_empty(), "do not open files directly any more: delete the lines {unused:?}");
}

#[test]
fn opening_calls_are_recognised() {
    let calls = |code: &str| opening_calls(code).join(" ");
    assert_eq!(calls("let file = std::fs::File::open(path)?; fs::write(a, b)"), "File::open( fs::write(");
    assert_eq!(calls("SomeFile::open(path); old_fs::read(path); Recording::open(path)"), "");
    assert_eq!(calls("OpenOptions::new().write(true).create(true).open(path)"), "OpenOptions::new(");
    assert_eq!(calls("OpenOptions::new().write(true).create_new(true).open(path)"), "");
}

#[test]
fn every_crate_inherits_the_workspace_lints() {
    for found in crates() {
        let inherited = found.manifest.get("lints").and_then(|lints| lints.get("workspace"));
        assert_eq!(
            inherited.and_then(toml::Value::as_bool),
            Some(true),
            "{}: [lints] workspace",
            found.folder
        );
    }
}

#[test]
fn dependency_versions_are_in_the_root_manifest_only() {
    for found in crates() {
        for table in ["dependencies", "dev-dependencies", "build-dependencies"] {
            for (name, value) in
                found.manifest.get(table).and_then(toml::Value::as_table).into_iter().flatten()
            {
                let inherits = value.get("workspace").and_then(toml::Value::as_bool) == Some(true);
                assert!(inherits, "{}: {name} needs `workspace = true`", found.folder);
            }
        }
    }
}

#[test]
fn core_is_no_std_without_unsafe() {
    let core = crates().find(|found| found.folder == "core").unwrap();
    let head = core.sources().into_iter().find(|file| file.path.ends_with("src/lib.rs")).unwrap().code;
    assert!(head.contains("#![no_std]"), "core/src/lib.rs lacks #![no_std]");
    assert!(head.contains("#![forbid(unsafe_code)]"), "core/src/lib.rs lacks #![forbid(unsafe_code)]");
    // `.ci/bare-core` checks by linking that its dependencies require neither std nor a heap.
}

#[test]
fn simulator_does_not_import_estimator_modules() {
    let simulator: Crate = crates().find(|found| found.folder == "simulator").unwrap();
    for file in simulator.sources().into_iter().filter(|file| file.path.starts_with("simulator/src")) {
        for module in file.used_modules("equipoise_core") {
            let forbidden = NOT_FOR_THE_SIMULATOR.contains(&module.as_str());
            assert!(!forbidden, "{} uses equipoise_core::{module}", file.path.display());
        }
        for (line, word) in file.words() {
            let place = format!("{}:{line}", file.path.display());
            assert!(
                !word.eq_ignore_ascii_case("anthropometry"),
                "{place}: use the simulator's own body, not the core's table"
            );
        }
    }
}

/// Formulas of the estimator, by their names in the core, from which the truth must not be computed.
const ESTIMATOR_FORMULAS: [&str; 12] = [
    "Loading",
    "FootLoads",
    "FootReaction",
    "foot_reactions",
    "LoadPosition",
    "UpperBody",
    "LoadAtBack",
    "Inertia",
    "turning_shift_m",
    "specific_force_m_per_s2",
    "centre_of_mass",
    "sigma_of_length",
];
/// Modules of the core that consist of such formulas.
const ESTIMATOR_MODULES: [&str; 6] = ["kalman", "exposure", "motion", "anchor", "effect", "static_pose"];

#[test]
fn truth_does_not_use_estimator_formulas() {
    let truth_sources = [("studies", "studies/src"), ("tests", "tests/soak"), ("cli", "cli/src/demo")];
    let mut files = 0;
    for (folder, under) in truth_sources {
        let found = crates().find(|found| found.folder == folder).unwrap();
        for file in found.sources().into_iter().filter(|file| file.path.starts_with(under)) {
            // One reads the estimator's own static window, the other the published lever of its model: as inputs of a
            // comparison, not as truth.
            let is_exempt = ["poses.rs", "back.rs"].iter().any(|name| file.path.ends_with(name));
            files += 1;
            for (line, word) in file.words() {
                let place = format!("{}:{line}", file.path.display());
                assert!(!ESTIMATOR_FORMULAS.contains(&word.as_str()), "{place} uses {word} of the estimator");
            }
            for module in file.used_modules("equipoise_core") {
                let allowed = is_exempt || !ESTIMATOR_MODULES.contains(&module.as_str());
                assert!(allowed, "{} uses equipoise_core::{module}", file.path.display());
            }
        }
    }
    assert!(files > 25, "only {files} files were read");
}

#[test]
fn source_files_have_a_maximum_length() {
    let mut too_long = Vec::new();
    for file in crates().flat_map(|found| found.sources()) {
        let lines = file.lines;
        if file.path.components().any(|part| part.as_os_str() == "src") && lines > LINES_REPORTED {
            println!("{}: {lines} lines", file.path.display());
            if lines > LINES_MAX {
                too_long.push((file.path, lines));
            }
        }
    }
    assert!(too_long.is_empty(), "more than {LINES_MAX} lines: {too_long:?}");
}

#[test]
fn relative_links_of_documents_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let (mut links, mut broken) = (0, Vec::new());
    for (page, text) in committed_texts().filter(|(path, _)| path.extension().is_some_and(|end| end == "md"))
    {
        for (at, _) in text.match_indices("](") {
            let Some((target, _)) = text[at + 2..].split_once(')') else { continue };
            let file = target.split('#').next().unwrap_or_default();
            if file.is_empty() || file.contains(':') || file.contains(char::is_whitespace) {
                continue;
            }
            links += 1;
            if !root.join(&page).parent().is_some_and(|folder| folder.join(file).exists()) {
                broken.push(format!("{}: {file}", page.display()));
            }
        }
    }
    assert!(links > 20, "only {links} links were found");
    assert!(broken.is_empty(), "broken links: {broken:#?}");
}

#[test]
fn no_file_contains_a_path_of_a_developers_machine() {
    // Composed here, so that this file does not contain the paths either.
    let homes: BTreeSet<String> =
        ["work/", "root/", "home/", "Users/"].iter().map(|end| format!("/{end}")).collect();
    for (path, text) in committed_texts() {
        for (number, line) in text.lines().enumerate() {
            for home in &homes {
                let named = line.match_indices(home.as_str()).any(|(at, _)| {
                    // `a/root/b` and `https://host/work/` are not absolute paths of this machine.
                    let before = line[..at].chars().next_back();
                    before.is_none_or(|c| c.is_whitespace() || "\"'`(=:[<".contains(c))
                });
                assert!(!named, "{}:{}: {}", path.display(), number + 1, line.trim());
            }
        }
    }
}
