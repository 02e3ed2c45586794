//! Runs a program's reconciliation on sessions of unknown truth, and evaluates its findings.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use serde_json::Value;

use super::evaluation::{Evaluation, evaluate};
use super::make::{self, Order};
use super::scenario::{Experiment, Performed};
use super::truth::Truth;
use crate::subject::map_in_parallel;

/// How to run the program.
#[derive(Debug, Clone)]
pub struct Asking {
    /// The program: `equipoise`.
    pub program: PathBuf,
    /// Whether the program has to find the spans itself.
    pub finds_spans: bool,
    /// Largest number of experiments that the simulated person does for the program, one after the other, in [`bench()`].
    pub experiments: usize,
}

impl Asking {
    /// Checks that the program exists, before rather than after an hour of sessions.
    fn check(&self) -> Result<(), String> {
        let asked = Command::new(&self.program).arg("--version").output();
        let missing = |error| {
            format!(
                "cannot run {}: {error}; build it with `cargo build --release`, or set --program",
                self.program.display()
            )
        };
        asked.map(|_| ()).map_err(missing)
    }
}

/// Files of a session: recording, truth, and clean twin if there is one.
#[derive(Debug, Clone)]
struct Files {
    recording: PathBuf,
    truth: PathBuf,
    twin: Option<PathBuf>,
}

impl Files {
    fn of(folder: &Path, session: &str) -> Files {
        let name = format!("{session}.mcap");
        Files {
            recording: folder.join(&name),
            truth: folder.join("truth").join(format!("{session}.json")),
            twin: Some(folder.join("twins").join(&name)).filter(|twin| twin.exists()),
        }
    }

    fn delete(&self) {
        for file in [Some(&self.recording), self.twin.as_ref()].into_iter().flatten() {
            // A file that cannot be deleted does no harm.
            let _ = std::fs::remove_file(file);
        }
    }
}

/// Evaluates every session of a folder, in parallel on all processors; `done` is called for each.
///
/// # Errors
/// A message: the folder has no truth, or a truth cannot be read.
pub fn score(
    folder: &Path,
    asking: &Asking,
    done: impl Fn(&Evaluation) + Sync,
) -> Result<Vec<Evaluation>, String> {
    let entries = std::fs::read_dir(folder.join("truth")).map_err(|error| {
        format!("{}: {error}; generate sessions first with hidden make", folder.join("truth").display())
    })?;
    let mut sessions: Vec<String> = entries
        .filter_map(|entry| Some(entry.ok()?.path().file_stem()?.to_string_lossy().into_owned()))
        .collect();
    sessions.sort();
    asking.check()?;
    let evaluated = map_in_parallel(&sessions, |session| {
        let (evaluated, _) = score_one(&Files::of(folder, session), asking)?;
        done(&evaluated);
        Ok(evaluated)
    });
    evaluated.into_iter().collect()
}

/// Generates sessions one by one, evaluates each, and deletes its recording.
///
/// # Errors
/// A message, as of generation and [`score`].
pub fn bench(
    order: &Order,
    asking: &Asking,
    done: impl Fn(&Evaluation) + Sync,
) -> Result<Vec<Evaluation>, String> {
    let plans = make::plans(order)?;
    asking.check()?;
    make::prepare(order)?;
    let evaluated = map_in_parallel(&plans, |plan| {
        let mut performed: Vec<Performed> = Vec::new();
        loop {
            let files = Files::of(&order.out, &plan.session);
            let experiments: Vec<Experiment> = performed.iter().map(|one| one.experiment.clone()).collect();
            let scored = make::make_one(plan, order, &experiments).and_then(|_| score_one(&files, asking));
            files.delete();
            let (evaluated, next) = scored?;
            match next.filter(|_| !evaluated.decided && performed.len() < asking.experiments) {
                Some(next) => performed.push(Performed { before: evaluated.outcome(), ..next }),
                None => {
                    let evaluated = Evaluation { experiments: performed, ..evaluated };
                    done(&evaluated);
                    return Ok(evaluated);
                }
            }
        }
    });
    evaluated.into_iter().collect()
}

/// Evaluates one session; also returns the experiment that the program asks for.
fn score_one(files: &Files, asking: &Asking) -> Result<(Evaluation, Option<Performed>), String> {
    let text = std::fs::read_to_string(&files.truth)
        .map_err(|error| format!("cannot read {}: {error}", files.truth.display()))?;
    let truth: Truth =
        serde_json::from_str(&text).map_err(|error| format!("{}: {error}", files.truth.display()))?;
    // Only the truth's spans are used for the command line; the hidden effect is not accessed before the finding.
    let started = Instant::now();
    let printed = ask(&files.recording, &truth, asking);
    let seconds = started.elapsed().as_secs_f64();
    let next = printed.as_ref().ok().and_then(|finding| Performed::asked(&finding["ask"]));
    let twin_mm = files.twin.as_ref().and_then(|twin| {
        let finding = ask(twin, &truth, asking).ok()?;
        finding["gap"]["before_mm"].as_f64()
    });
    Ok((evaluate(&truth, printed.as_ref().map_err(String::as_str), twin_mm, seconds), next))
}

/// Runs `reconcile` on a recording; returns its output, or the reason if there is none.
fn ask(recording: &Path, truth: &Truth, asking: &Asking) -> Result<Value, String> {
    let out = recording.with_extension("reconciled");
    let mut command = Command::new(&asking.program);
    command.arg("reconcile").arg(recording);
    if !asking.finds_spans {
        let span = |[from_s, to_s]: [f64; 2]| format!("{from_s:.3}:{to_s:.3}");
        command.args(["--identify", &span(truth.spans.identify), "--work", &span(truth.spans.work)]);
        if truth.reports_reference {
            command.args(["--reference", &span(truth.spans.reference)]);
        }
    }
    command.arg("--json").arg("--out").arg(&out);
    let output = command.output().map_err(|error| format!("{}: {error}", asking.program.display()))?;
    // The report is not used here.
    let _ = std::fs::remove_dir_all(&out);
    serde_json::from_slice(&output.stdout).map_err(|error| {
        let published = String::from_utf8_lossy(&output.stderr);
        let mut why = format!("{}: no finding ({error})", output.status);
        if let Some(line) = published.lines().rfind(|line| !line.trim().is_empty()) {
            let _ = write!(why, ": {line}");
        }
        why
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hidden::evaluation::Class;
    use crate::hidden::evaluation::tests::{finding, truth};
    use crate::hidden::truth::Outcome;
    use serde_json::json;
    use std::os::unix::fs::PermissionsExt;

    /// A program that prints the same finding for every recording, if its arguments are as expected.
    fn program(folder: &Path, said: &Value, asked_for: &str) -> PathBuf {
        let path = folder.join("equipoise");
        let script = format!(
            "#!/bin/sh\ncase \"$*\" in\n*'{asked_for}'*) cat <<'END'\n{said}\nEND\n;;\n\
             *) echo \"asked: $*\" >&2; exit 1;;\nesac\n"
        );
        std::fs::write(&path, script).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
        path
    }

    fn sessions(folder: &Path) {
        std::fs::create_dir(folder.join("truth")).unwrap();
        let hidden = truth(&[("hand_load", Some(("hand", "right")), ("mass_kg", 0.5))]);
        for (session, truth) in [("session-0001", hidden), ("session-0002", truth(&[]))] {
            let truth = Truth { session: session.into(), ..truth };
            let text = serde_json::to_string(&truth).unwrap();
            std::fs::write(folder.join("truth").join(format!("{session}.json")), text).unwrap();
        }
    }

    #[test]
    fn every_session_is_asked_with_its_spans_and_evaluated() {
        let folder = tempfile::tempdir().unwrap();
        sessions(folder.path());
        let load = json!({"mass_kg": {"value": 0.52, "sigma": 0.05, "unit": "kg"}});
        let said = finding("named", &[("hand_load", json!({"hand": "right"}), load)], &[]);
        let asked = "--identify 0.000:60.000 --work 180.000:270.000 --reference 60.000:180.000 --json --out";
        let asking =
            Asking { program: program(folder.path(), &said, asked), finds_spans: false, experiments: 0 };
        let evaluated = score(folder.path(), &asking, |_| {}).unwrap();
        assert_eq!(evaluated.len(), 2);
        assert!(evaluated[0].exact && evaluated[0].class == Class::Single, "{:?}", evaluated[0].failure);
        assert!(evaluated[1].is_false_alarm(), "{:?}", evaluated[1].failure);
    }

    #[test]
    fn a_refusal_is_reported_with_the_last_line_of_the_program() {
        let folder = tempfile::tempdir().unwrap();
        sessions(folder.path());
        let asking = Asking {
            program: program(folder.path(), &json!({}), "--identify"),
            finds_spans: true,
            experiments: 0,
        };
        let evaluated = score(folder.path(), &asking, |_| {}).unwrap();
        assert_eq!(evaluated[0].verdict, "failed");
        let failure = evaluated[0].failure.as_deref().unwrap();
        assert!(failure.contains("asked: reconcile") && !failure.contains("--work"), "{failure}");
    }

    #[test]
    fn an_undecided_session_is_continued_by_what_is_asked_until_it_is_decided() {
        let folder = tempfile::tempdir().unwrap();
        let load = json!({"mass_kg": {"value": 0.5, "sigma": 0.05, "unit": "kg"}});
        let effects = [("hand_load", json!({"hand": "right"}), load)];
        let [mut open, mut decided] = ["ambiguous", "named"].map(|verdict| finding(verdict, &effects, &[]));
        open["ask"] =
            json!({"turn_deg": 0.0, "step_m": [0.0, 0.0], "still_s": 20.0, "fast": false, "decides": 0.7});
        open["decided"] = false.into();
        // A decided finding may ask for more; nothing is done.
        decided["ask"] = open["ask"].clone();
        decided["decided"] = true.into();
        let path = program(folder.path(), &open, "reconcile");
        let script = std::fs::read_to_string(&path).unwrap();
        let second = format!(
            "#!/bin/sh\nif [ \"$1\" = reconcile ] && [ -e {0} ]; then echo '{decided}'; exit; fi\n[ \"$1\" = reconcile ] && touch {0}\n",
            folder.path().join("asked").display()
        );
        std::fs::write(&path, script.replacen("#!/bin/sh\n", &second, 1)).unwrap();
        let bench = |experiments: usize| {
            let out = folder.path().join(experiments.to_string());
            let (only, fast) = (Some("hand_load right".into()), true);
            let order = Order { out, sessions: 1, seed: 3, only, fast, twins: false };
            let asking = Asking { program: path.clone(), finds_spans: false, experiments };
            bench(&order, &asking, |_| {}).unwrap().remove(0)
        };
        let without = bench(0);
        assert_eq!((without.outcome(), without.experiments.len()), (Outcome::Undecided, 0));
        std::fs::remove_file(folder.path().join("asked")).unwrap();
        let with = bench(2);
        assert_eq!((with.outcome(), with.experiments.len()), (Outcome::Right, 1), "{:?}", with.failure);
        assert_eq!(
            [0, 1, 2].map(|after| with.outcome_after(after)),
            [Outcome::Undecided, Outcome::Right, Outcome::Right]
        );
        assert!((with.experiments[0].decides - 0.7).abs() < 1e-12);
        assert!(with.length_s - without.length_s > 20.0, "{} after {} s", with.length_s, without.length_s);
    }

    #[test]
    fn a_folder_without_truth_is_an_error_that_says_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let asking = Asking { program: PathBuf::from("equipoise"), finds_spans: false, experiments: 0 };
        assert!(
            score(folder.path(), &asking, |_| {})
                .unwrap_err()
                .contains("generate sessions first with hidden make")
        );
        sessions(folder.path());
        let asking = Asking { program: folder.path().join("none"), finds_spans: false, experiments: 0 };
        assert!(score(folder.path(), &asking, |_| {}).unwrap_err().contains("cargo build --release"));
    }
}
