//! Subject, file mode and atomic replacement of a table.
#![expect(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use bytemuck::Zeroable;
use equipoise_adapters::recording::{Recorder, RecordingHeader};
use equipoise_core::message::State;
use equipoise_export::{Export, Format, Progress, Summary, Topic};
use parquet::file::reader::{FileReader, SerializedFileReader};

fn recording(path: &Path, subject: &str, later: &[&str]) {
    let profile = |id: &&str| format!("subject = \"{id}\"\n");
    let header = RecordingHeader {
        config_toml: "station = \"bench-1\"\n[subject]\nid = \"configured\"\n".to_owned(),
        subject_toml: if subject.is_empty() { String::new() } else { profile(&subject) },
        ..RecordingHeader::default()
    };
    let mut recorder = Recorder::create(path, &header).unwrap();
    recorder.write(5, &State { time_ns: 5, ..State::zeroed() }).unwrap();
    for profile in later.iter().map(profile) {
        recorder.add_subject(5, &profile).unwrap();
    }
    recorder.finish().unwrap();
}

fn export(recording: &Path, out: &Path) -> anyhow::Result<Summary> {
    let (topic, format) = (Topic::State, Format::of(out)?);
    let export = Export { recording, states: None, is_replayed: false, topic, format, span_s: None, out };
    export.run(&mut Progress::new(&mut |_, _| {}))
}

#[test]
fn the_subject_is_who_was_in_use() {
    let folder = tempfile::tempdir().unwrap();
    for (number, (subject, later, reported)) in [
        ("", &[][..], "configured"),
        ("anon-1", &[], "anon-1"),
        ("anon-1", &["anon-77", "anon-1"], "anon-1, anon-77"),
        ("", &["anon-77"], "configured, anon-77"),
    ]
    .into_iter()
    .enumerate()
    {
        let (made, out) = (folder.path().join(format!("{number}.mcap")), folder.path().join("out.parquet"));
        recording(&made, subject, later);
        export(&made, &out).unwrap();
        let reader = SerializedFileReader::new(std::fs::File::open(&out).unwrap()).unwrap();
        let pairs = reader.metadata().file_metadata().key_value_metadata().unwrap();
        let found = pairs.iter().find(|pair| pair.key == "equipoise.subject").unwrap();
        assert_eq!(found.value.as_deref(), Some(reported));
    }
}

#[test]
fn a_table_is_not_for_everybody_and_what_others_have_stays() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    recording(&file("made.mcap"), "anon-1", &[]);
    for name in ["notes.txt.part", "out.csv.part", "half.csv.part"] {
        std::fs::write(file(name), "another's").unwrap();
    }
    assert!(export(&file("made.mcap"), &file("notes.txt")).is_err());
    export(&file("made.mcap"), &file("out.csv")).unwrap();
    let mode = std::fs::metadata(file("out.csv")).unwrap().permissions().mode();
    assert_eq!(mode & 0o027, 0, "{mode:o}: no more than a recording's");
    // A folder with the result's name cannot be replaced; no partial file may remain.
    std::fs::create_dir(file("half.csv")).unwrap();
    assert!(export(&file("made.mcap"), &file("half.csv")).is_err());
    for name in ["notes.txt.part", "out.csv.part", "half.csv.part"] {
        assert_eq!(std::fs::read_to_string(file(name)).unwrap(), "another's", "{name}");
    }
    let parts = std::fs::read_dir(folder.path()).unwrap().flatten();
    let parts = parts.filter(|entry| entry.file_name().to_string_lossy().ends_with(".part"));
    assert_eq!(parts.count(), 3);
}
