//! The interval log on disk: contains complete lines only, even after write errors.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use equipoise_core::message::CycleRecord;
use equipoise_files::atomic_file::MODE;
use equipoise_files::{Existing, write_regular};
use equipoise_latency::{HlogWriter, PathHistograms};

/// Interval of the entries of each stage.
const INTERVAL: Duration = Duration::from_secs(10);

/// The interval log of one daemon process. Lines that cannot be written are retried after an interval.
pub struct HlogFile {
    path: PathBuf,
    file: Option<File>,
    /// Length of the file up to the end of its last complete line.
    complete_bytes: u64,
    /// Lines not yet written.
    lines: HlogWriter<Vec<u8>>,
    interval: PathHistograms,
    started: Instant,
    since: Instant,
    tried: Option<Instant>,
}

impl HlogFile {
    /// Begins a new log. The first [`HlogFile::write_if_due`] creates the file and replaces an existing one.
    pub fn new(path: &Path) -> HlogFile {
        HlogFile {
            path: path.to_owned(),
            file: None,
            complete_bytes: 0,
            lines: HlogWriter::new(Vec::new(), SystemTime::now()).expect("memory takes every line"),
            interval: PathHistograms::new(),
            started: Instant::now(),
            since: Instant::now(),
            tried: None,
        }
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Adds one cycle to the interval.
    pub fn record(&mut self, record: &CycleRecord) {
        self.interval.record(record);
    }

    /// Writes the header first, then an interval every ten seconds or `at_once`; `None` if nothing was due.
    ///
    /// # Errors
    /// The system's error. The file still ends with a complete line, and the interval continues.
    pub fn write_if_due(&mut self, at_once: bool) -> Option<io::Result<()>> {
        if self.tried.is_some_and(|tried| !at_once && tried.elapsed() < INTERVAL) {
            return None;
        }
        let head_only = self.tried.is_none() && !at_once;
        self.tried = Some(Instant::now());
        Some(if head_only { self.write_lines() } else { self.write_interval() })
    }

    fn write_interval(&mut self) -> io::Result<()> {
        let unwritten = self.lines.writer_mut().len();
        let since_start = self.since.duration_since(self.started);
        let written = self
            .lines
            .write_interval(since_start, self.since.elapsed(), &self.interval)
            .map_err(io::Error::other)
            .and_then(|()| self.write_lines());
        match written {
            Ok(()) => {
                self.since = Instant::now();
                self.interval.start_interval();
            }
            Err(_) => self.lines.writer_mut().truncate(unwritten),
        }
        written
    }

    fn write_lines(&mut self) -> io::Result<()> {
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(write_regular(&self.path, Existing::Truncate, MODE)?),
        };
        let lines = self.lines.writer_mut();
        if let Err(error) = file.write_all(lines) {
            // An incomplete line would end the log for every reader.
            let _ = file.set_len(self.complete_bytes);
            let _ = file.seek(SeekFrom::Start(self.complete_bytes));
            return Err(error);
        }
        self.complete_bytes += lines.len() as u64;
        lines.clear();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use rustix::fs::{CWD, Mode, mkfifoat};

    fn cycle(number: u64) -> CycleRecord {
        let due_ns = number * 1_000_000;
        CycleRecord { cycle: number, due_ns, woken_ns: due_ns + 30_000, ..CycleRecord::zeroed() }
    }

    fn tagged(path: &Path) -> usize {
        std::fs::read_to_string(path).unwrap().lines().filter(|line| line.starts_with("Tag=")).count()
    }

    #[test]
    fn the_header_is_written_first_and_every_interval_is_one_line_per_stage() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.hlog");
        let mut hlog = HlogFile::new(&path);
        hlog.write_if_due(false).unwrap().unwrap();
        assert!(std::fs::read_to_string(&path).unwrap().contains("[Histogram log format version 1.3]"));
        assert!(hlog.write_if_due(false).is_none(), "nothing is due");
        for number in 1..=3 {
            hlog.record(&cycle(number));
            hlog.write_if_due(true).unwrap().unwrap();
            assert_eq!(tagged(&path) as u64, number, "only loop.wake has stamps");
        }
    }

    #[test]
    fn failed_lines_are_written_later_and_never_truncated() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("missing").join("a.hlog");
        let mut hlog = HlogFile::new(&path);
        assert!(hlog.write_if_due(false).unwrap().is_err());
        hlog.record(&cycle(1));
        assert!(hlog.write_if_due(true).unwrap().is_err());
        std::fs::create_dir(path.parent().unwrap()).unwrap();
        hlog.record(&cycle(2));
        hlog.write_if_due(true).unwrap().unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(text.matches("Histogram log format").count(), 1, "{text}");
        assert_eq!(tagged(&path), 1);
    }

    #[test]
    fn a_pipe_instead_of_the_file_is_an_error_and_does_not_block() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.hlog");
        mkfifoat(CWD, &path, Mode::RUSR | Mode::WUSR).unwrap();
        let mut hlog = HlogFile::new(&path);
        let refusal = hlog.write_if_due(false).unwrap().unwrap_err().to_string();
        assert!(refusal.contains("no regular file"), "{refusal}");
    }

    #[test]
    fn a_full_disk_is_an_error_each_time() {
        let path = Path::new("/dev/full");
        let Ok(full) = File::options().write(true).open(path) else {
            println!("skipped: there is no /dev/full here");
            return;
        };
        let mut hlog = HlogFile { file: Some(full), ..HlogFile::new(path) };
        for number in 1..=3 {
            hlog.record(&cycle(number));
            assert!(hlog.write_if_due(true).unwrap().is_err());
        }
        assert_eq!(hlog.interval.counts().cycles, 3, "they wait for room");
    }
}
