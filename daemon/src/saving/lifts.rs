//! List of a subject's lifts in a file next to the profile: the input of the dose, one line for each lift.
//!
//! Lines are only appended. An undone lift has a second line, `undone`, with its number. A thousand lifts a day need
//! 100 kB.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::io::{self, Write as _};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use equipoise_core::exposure::{Lift, Shift};
use equipoise_core::time::NS_PER_S;
use equipoise_files::atomic_file::MODE;
use equipoise_files::{Existing, write_regular};
use jiff::Timestamp;

use crate::subjects::Subjects;

const HEADING: &str = "ended_utc,event,number,carried_s,mass_kg,mass_sigma_kg,distance_m,damage\n";

/// Pending lines and the lifts already processed, by subject number.
#[derive(Debug, Default)]
pub(super) struct LiftLog {
    previous: BTreeMap<u64, Progress>,
    lines: BTreeMap<u64, String>,
}

#[derive(Debug)]
struct Progress {
    /// Number of ended lifts.
    ended: u64,
    /// Numbers of the undone ones among the latest lifts.
    undone: Vec<u64>,
}

impl Progress {
    fn of(shift: &Shift) -> Progress {
        let undone = shift.latest.iter().filter(|lift| lift.undone == 1).map(|lift| lift.number);
        Progress { ended: shift.ended, undone: undone.collect() }
    }
}

impl LiftLog {
    /// Ingests a copy of a subject's shift. The first copy only sets the starting point.
    pub(super) fn ingest(&mut self, number: u64, shift: &Shift, now_ns: u64, unix_s: u64) {
        let now = Progress::of(shift);
        let Some(mut before) = self.previous.insert(number, now) else { return };
        if shift.ended < before.ended {
            // A new shift counts from one.
            before = Progress { ended: 0, undone: Vec::new() };
        }
        let mut latest: Vec<&Lift> = shift.latest.iter().filter(|lift| lift.number > 0).collect();
        latest.sort_by_key(|lift| lift.number);
        let mut lines = String::new();
        for lift in latest {
            let Lift { number, carried_s, mass_kg: [mass_kg, sigma_kg], distance_m, damage, .. } = *lift;
            let mut add = |unix_s: u64, event: &str| {
                let time = Timestamp::UNIX_EPOCH + Duration::from_secs(unix_s);
                // Writing to a string cannot fail.
                let _ = writeln!(
                    lines,
                    "{time},{event},{number},{carried_s:.2},{mass_kg:.2},{sigma_kg:.2},{distance_m:.3},{damage:e}"
                );
            };
            if number > before.ended {
                let ago_s = now_ns.saturating_sub(lift.ended_ns) / NS_PER_S;
                add(unix_s.saturating_sub(ago_s), "lift");
            }
            if lift.undone == 1 && !before.undone.contains(&number) {
                add(unix_s, "undone");
            }
        }
        if !lines.is_empty() {
            self.lines.entry(number).or_default().push_str(&lines);
        }
    }

    /// Whether no lines are pending.
    pub(super) fn is_written(&self) -> bool {
        self.lines.is_empty()
    }

    /// Appends pending lines to the files; failed ones remain pending.
    ///
    /// # Errors
    /// A file that cannot be written, and the error.
    pub(super) fn write(&mut self, subjects: &Subjects) -> Result<(), (PathBuf, io::Error)> {
        let mut failed = None;
        self.lines.retain(|number, lines| {
            let written = subjects.write(*number, |saving| {
                append(&saving.lifts, lines).map_err(|error| (saving.lifts.clone(), error))
            });
            let is_pending = written.is_err();
            failed = written.err().or(failed.take());
            is_pending
        });
        failed.map_or(Ok(()), Err)
    }
}

/// Appends complete lines to a file, or nothing.
fn append(path: &Path, lines: &str) -> io::Result<()> {
    if let Some(directory) = path.parent() {
        fs::create_dir_all(directory)?;
    }
    let mut file = write_regular(path, Existing::Append, MODE)?;
    let length = file.metadata()?.len();
    let before = match length.checked_sub(1) {
        None => HEADING,
        Some(last) => {
            let mut byte = [0];
            file.read_exact_at(&mut byte, last)?;
            // A power failure may have left an incomplete line.
            if byte == *b"\n" { "" } else { "\n" }
        }
    };
    let written = file.write_all(format!("{before}{lines}").as_bytes()).and_then(|()| file.sync_data());
    if written.is_err() {
        // An incomplete line would corrupt the next one. A failure here means a faulty disk.
        let _ = file.set_len(length);
    }
    written
}

#[cfg(test)]
mod tests {
    use equipoise_core::exposure::LATEST_LIFTS;
    use equipoise_station::state_directory::StateDirectory;

    use super::*;
    use bytemuck::Zeroable;
    use rustix::fs::{CWD, Mode, mkfifoat};

    use crate::subjects::{CONFIGURED, ProfileDestination};

    fn end_one(shift: &mut Shift, ended_ns: u64) {
        shift.ended += 1;
        shift.latest[(shift.ended - 1) as usize % LATEST_LIFTS] = Lift {
            number: shift.ended,
            ended_ns,
            carried_s: 2.5,
            mass_kg: [8.25, 0.5],
            distance_m: 0.4,
            damage: 5e-6,
            undone: 0,
        };
    }

    #[test]
    fn every_lift_and_every_undo_is_written_as_one_line() {
        let directory = tempfile::tempdir().unwrap();
        let state = StateDirectory::at(directory.path());
        let subjects = Subjects::new(state.clone(), "s", ProfileDestination::of(&state, "a", None, true));
        let (mut log, mut shift) = (LiftLog::default(), Shift::zeroed());
        // Lifts from before the start of the daemon are already in the list.
        (0..20).for_each(|_| end_one(&mut shift, 0));
        let mut step = |shift: &Shift| {
            log.ingest(CONFIGURED, shift, 100 * NS_PER_S, 1_795_256_100);
            log.write(&subjects).unwrap();
            assert!(log.is_written());
        };
        step(&shift);
        assert!(!state.lifts("a").exists());
        end_one(&mut shift, 90 * NS_PER_S);
        step(&shift);
        step(&shift);
        end_one(&mut shift, 95 * NS_PER_S);
        shift.latest[(22 - 1) % LATEST_LIFTS].undone = 1;
        shift.latest[(21 - 1) % LATEST_LIFTS].undone = 1;
        step(&shift);
        step(&shift);
        let text = fs::read_to_string(state.lifts("a")).unwrap();
        let rest = "2.50,8.25,0.50,0.400,5e-6";
        assert_eq!(
            text,
            format!(
                "{HEADING}2026-11-21T10:14:50Z,lift,21,{rest}\n2026-11-21T10:15:00Z,undone,21,{rest}\n\
                 2026-11-21T10:14:55Z,lift,22,{rest}\n2026-11-21T10:15:00Z,undone,22,{rest}\n"
            )
        );
    }

    #[test]
    fn an_incomplete_last_line_is_terminated() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.lifts.csv");
        append(&path, "1\n").unwrap();
        append(&path, "2\n").unwrap();
        fs::write(&path, format!("{HEADING}1\n2026-11-2")).unwrap();
        append(&path, "2\n").unwrap();
        append(&path, "3\n").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), format!("{HEADING}1\n2026-11-2\n2\n3\n"));
    }

    #[test]
    fn a_pipe_instead_of_the_file_is_an_error() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.lifts.csv");
        mkfifoat(CWD, &path, Mode::RUSR | Mode::WUSR).unwrap();
        assert!(append(&path, "1\n").unwrap_err().to_string().contains("no regular file"));
    }

    #[test]
    fn a_new_shift_counts_from_one() {
        let directory = tempfile::tempdir().unwrap();
        let state = StateDirectory::at(directory.path());
        let subjects = Subjects::new(state.clone(), "s", ProfileDestination::of(&state, "a", None, true));
        let (mut log, mut shift) = (LiftLog::default(), Shift::zeroed());
        (0..20).for_each(|_| end_one(&mut shift, 0));
        log.ingest(CONFIGURED, &shift, 0, 0);
        shift = Shift::zeroed();
        end_one(&mut shift, 90 * NS_PER_S);
        log.ingest(CONFIGURED, &shift, 100 * NS_PER_S, 1_795_256_100);
        log.write(&subjects).unwrap();
        assert!(fs::read_to_string(state.lifts("a")).unwrap().contains(",lift,1,"));
    }

    #[test]
    fn failed_writes_are_retried_and_deleted_subjects_are_not_written() {
        let directory = tempfile::tempdir().unwrap();
        let state = StateDirectory::at(directory.path());
        let subjects = Subjects::new(state.clone(), "s", ProfileDestination::of(&state, "a", None, true));
        let (mut log, mut shift) = (LiftLog::default(), Shift::zeroed());
        log.ingest(CONFIGURED, &shift, 0, 0);
        end_one(&mut shift, 0);
        log.ingest(CONFIGURED, &shift, 0, 0);
        // A folder with the name of the file makes writing fail.
        fs::create_dir_all(state.lifts("a")).unwrap();
        assert_eq!(log.write(&subjects).unwrap_err().0, state.lifts("a"));
        assert!(!log.is_written());
        fs::remove_dir(state.lifts("a")).unwrap();
        subjects.delete("a");
        log.write(&subjects).unwrap();
        assert!(log.is_written() && !state.lifts("a").exists());
    }
}
