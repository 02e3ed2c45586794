//! Signed recordings of a service: the verdict of `equipoise report` on each file, as written and after alterations.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::common::{Station, describe_output, equipoise, person};
use rustix::process::{Pid, Signal, kill_process};

fn until(what: &str, mut condition: impl FnMut() -> bool) {
    let started = Instant::now();
    while !condition() {
        assert!(started.elapsed() < Duration::from_secs(120), "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Files of a folder with this ending, in order.
fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut files: Vec<PathBuf> = entries.filter(|path| path.to_string_lossy().ends_with(ending)).collect();
    files.sort();
    files
}

fn signature_of(recording: &Path) -> PathBuf {
    PathBuf::from(format!("{}.minisig", recording.display()))
}

fn new_key(path: &Path) {
    let made = equipoise().args(["record", "--new-key"]).arg(path).output().unwrap();
    assert!(made.status.success(), "{}", describe_output(&made));
}

/// A copy of the recordings that a test may alter.
struct Copy {
    folder: tempfile::TempDir,
    public_key: PathBuf,
}

impl Copy {
    fn of(recordings: &Path, public_key: &Path) -> Copy {
        let folder = tempfile::tempdir().unwrap();
        for path in files(recordings, "") {
            fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
        }
        Copy { folder, public_key: public_key.to_owned() }
    }

    fn recording(&self, index: usize) -> PathBuf {
        files(self.folder.path(), ".mcap").swap_remove(index)
    }

    /// The line of `report` about a recording, and the exit code.
    fn line(&self, recording: &Path) -> (String, Option<i32>) {
        line(recording, &["--public-key", self.public_key.to_str().unwrap()])
    }
}

fn line(recording: &Path, options: &[&str]) -> (String, Option<i32>) {
    let page = recording.with_extension("html");
    let ended =
        equipoise().arg("report").arg(recording).args(options).arg("--out").arg(&page).output().unwrap();
    let text = String::from_utf8(ended.stdout.clone()).unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix(&format!("{}: ", recording.display())));
    let line = line.unwrap_or_else(|| panic!("{}", describe_output(&ended))).to_owned();
    // For a recording without a usable sample there is no page.
    if ended.status.code() != Some(1) {
        let page = fs::read_to_string(&page).unwrap();
        assert!(page.contains("authenticity"), "the page has the line");
    }
    (line, ended.status.code())
}

fn swap(a: &Path, b: &Path) {
    let between = a.with_extension("between");
    fs::rename(a, &between).unwrap();
    fs::rename(b, a).unwrap();
    fs::rename(&between, b).unwrap();
}

fn start(station: &Station) -> Child {
    let mut command = station.command("record");
    command.arg("--config").arg(station.file("record.toml")).stderr(Stdio::null()).spawn().unwrap()
}

/// Recordings of a service that was killed once.
struct Signed {
    folder: PathBuf,
    public_key: PathBuf,
    /// The file that was open when the service was killed.
    killed: PathBuf,
    /// All files without a signature.
    unsigned: Vec<PathBuf>,
}

impl Signed {
    /// Three signed files before the end of the first service, two after it.
    fn record(station: &Station) -> Signed {
        let folder = station.file("kept");
        let mut service = start(station);
        until("three signed files", || {
            files(&folder, ".minisig").len() >= 3 && files(&folder, ".mcap").len() >= 4
        });
        std::thread::sleep(Duration::from_secs(1));
        // The name appears before the header.
        until("the header of the newest file", || {
            files(&folder, ".mcap")
                .last()
                .is_some_and(|path| fs::metadata(path).is_ok_and(|file| file.len() > 0))
        });
        service.kill().unwrap();
        service.wait().unwrap();
        let killed = files(&folder, ".mcap").pop().unwrap();
        // The file before it may have been closed and not yet signed.
        let mut unsigned = files(&folder, ".mcap");
        unsigned.retain(|path| !signature_of(path).exists());
        let mut service = start(station);
        until("two files after it", || {
            files(&folder, ".minisig").last().is_some_and(|signed| *signed > signature_of(&killed))
        });
        kill_process(Pid::from_child(&service), Signal::TERM).unwrap();
        assert_eq!(service.wait().unwrap().code(), Some(0));
        Signed { folder, public_key: station.file("recording.key.pub"), killed, unsigned }
    }

    fn copy(&self) -> Copy {
        Copy::of(&self.folder, &self.public_key)
    }
}

#[test]
fn alterations_of_signed_recordings_are_reported() {
    let (_simulation, config) = person();
    let station = Station::start(&(config.clone() + "save_profile = false\n"));
    new_key(&station.file("recording.key"));
    let recording = "[recording]\ndirectory = \"kept\"\nfile_max_mib = 1\nfree_min_mib = 1\npictures_hz = 100\nsign_key = \
                     \"recording.key\"\n";
    fs::write(station.file("record.toml"), config + recording).unwrap();
    let signed = Signed::record(&station);
    assert_unaltered_are_valid(&signed);
    assert_key_is_required(&signed, &station);
    assert_altered_byte_is_reported(&signed);
    assert_swapped_names_are_reported(&signed);
    assert_gap_is_reported(&signed);
    assert_damaged_signature_is_reported(&signed);

    let mut delete = station.command("subject");
    delete.args(["delete", "anon-1", "--with-recordings", "--recordings"]).arg(&signed.folder);
    let deleted = delete.output().unwrap();
    assert!(
        deleted.status.success() && !describe_output(&deleted).contains("minisig"),
        "{}",
        describe_output(&deleted)
    );
    assert_eq!(files(&signed.folder, ""), [] as [PathBuf; 0]);
}

fn assert_unaltered_are_valid(signed: &Signed) {
    let copy = signed.copy();
    let all = files(copy.folder.path(), ".mcap");
    let last = all.len() - 1;
    for (index, path) in all.iter().enumerate() {
        let (line, code) = copy.line(path);
        if signed.unsigned.iter().any(|unsigned| unsigned.file_name() == path.file_name()) {
            assert!(
                line.starts_with("not valid: unsigned") && matches!(code, Some(1 | 3)),
                "{line} {code:?}"
            );
            assert!(self::line(path, &[]).0.starts_with("unsigned; previous file "), "{line}");
        } else {
            assert!(line.starts_with("valid: signed by key ") && code == Some(0), "{line} {code:?}");
        }
        assert_eq!(line.contains("; previous file "), index > 0, "{line}");
        assert_eq!(line.contains("next file"), index < last, "{line}");
    }
}

fn assert_key_is_required(signed: &Signed, station: &Station) {
    let copy = signed.copy();
    let recording = copy.recording(1);
    let (unchecked, code) = line(&recording, &[]);
    assert!(unchecked.contains("not checked: name its public key") && code == Some(0), "{unchecked}");
    // The name of a configuration's key leads to its public key.
    let config = station.file("record.toml");
    let (configured, _) = line(&recording, &["--config", config.to_str().unwrap()]);
    assert!(configured.starts_with("valid: "), "{configured}");

    new_key(&station.file("other.key"));
    let other = station.file("other.key.pub");
    let (foreign, code) = line(&recording, &["--public-key", other.to_str().unwrap()]);
    assert!(foreign.starts_with("not valid: signed by key ") && code == Some(3), "{foreign}");
}

/// One byte, in a message's payload; also of the unsigned file.
fn assert_altered_byte_is_reported(signed: &Signed) {
    let all = files(&signed.folder, ".mcap");
    let unsigned = all.iter().position(|path| *path == signed.killed).unwrap();
    for index in [1, unsigned] {
        let copy = signed.copy();
        let path = copy.recording(index);
        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(&path, bytes).unwrap();
        let (line, code) = copy.line(&path);
        assert!(line.starts_with("altered: ") && matches!(code, Some(1 | 3)), "{line} {code:?}");
        let (line, code) = copy.line(&copy.recording(index + 1));
        assert!(line.contains("is not the file whose hash this one contains") && code == Some(3), "{line}");
    }
}

fn assert_swapped_names_are_reported(signed: &Signed) {
    let swapped = signed.copy();
    let (first, second) = (swapped.recording(1), swapped.recording(2));
    swap(&first, &second);
    swap(&signature_of(&first), &signature_of(&second));
    for path in [&first, &second] {
        let (line, code) = swapped.line(path);
        assert!(line.starts_with("altered: it was signed under the name ") && code == Some(3), "{line}");
    }
}

fn assert_gap_is_reported(signed: &Signed) {
    let gap = signed.copy();
    fs::remove_file(gap.recording(1)).unwrap();
    let (line, code) = gap.line(&gap.recording(1));
    assert!(
        line.starts_with("valid: ") && line.contains("is missing, though older files are present"),
        "{line}"
    );
    assert_eq!(code, Some(3));
    // Files removed by retention are no gap.
    fs::remove_file(gap.recording(0)).unwrap();
    let (line, code) = gap.line(&gap.recording(0));
    assert!(line.contains("not checked: it is not in the folder") && code == Some(0), "{line}");
}

fn assert_damaged_signature_is_reported(signed: &Signed) {
    let damaged = signed.copy();
    let path = damaged.recording(1);
    let text = fs::read_to_string(signature_of(&path)).unwrap();
    let short: Vec<&str> = text.lines().take(3).chain(["QUJD"]).collect();
    fs::write(signature_of(&path), short.join("\n")).unwrap();
    assert!(damaged.line(&path).0.starts_with("altered: "), "a short signature");
}

#[test]
fn a_key_readable_by_others_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (key, config) = (folder.path().join("recording.key"), folder.path().join("station.toml"));
    new_key(&key);
    assert_eq!(fs::metadata(&key).unwrap().permissions().mode() & 0o777, 0o600);
    let (_simulation, text) = person();
    let recording = "[recording]\ndirectory = \"kept\"\nsign_key = \"recording.key\"\n";
    fs::write(&config, text + recording).unwrap();
    let run =
        |command: &str, option: &[&str]| equipoise().arg(command).args(option).arg(&config).output().unwrap();
    let checked = run("check", &[]);
    assert!(checked.status.success(), "{}", describe_output(&checked));

    let refused = |reason: &str| {
        for ended in [run("check", &[]), run("record", &["--config"])] {
            assert_eq!(ended.status.code(), Some(1));
            let describe_output = describe_output(&ended);
            assert!(
                describe_output.contains("recording.sign_key") && describe_output.contains(reason),
                "{describe_output}"
            );
        }
    };
    fs::set_permissions(&key, fs::Permissions::from_mode(0o640)).unwrap();
    refused("chmod 0600");
    fs::write(&key, "no key\n").unwrap();
    fs::set_permissions(&key, fs::Permissions::from_mode(0o600)).unwrap();
    refused("holds no secret key of minisign");
    fs::remove_file(&key).unwrap();
    refused("cannot read");
    // A key that is in use is not replaced.
    new_key(&folder.path().join("a.key"));
    let again = equipoise().args(["record", "--new-key"]).arg(folder.path().join("a.key")).output().unwrap();
    assert!(describe_output(&again).contains("choose a new name"), "{}", describe_output(&again));
}
