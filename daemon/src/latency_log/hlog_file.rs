//! The interval log on disk: whole lines only, whatever the disk does.

use std::fs::{File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use equipoise_core::message::CycleRecord;
use equipoise_latency::{HlogWriter, PathHistograms};

/// One entry per stage this often.
const INTERVAL: Duration = Duration::from_secs(10);
/// Owner writes, group reads, nobody else.
const MODE: u32 = 0o640;

/// The interval log of one life of the daemon. What cannot be written is kept and tried again an interval later.
pub struct HlogFile {
    path: PathBuf,
    file: Option<File>,
    /// Up to here the file holds whole lines.
    whole_bytes: u64,
    /// Lines that are not in the file yet.
    lines: HlogWriter<Vec<u8>>,
    interval: PathHistograms,
    started: Instant,
    since: Instant,
    tried: Option<Instant>,
}

impl HlogFile {
    /// A log that begins now. The file is made with the first [`HlogFile::write_if_due`]; one that is there is replaced.
    pub fn new(path: &Path) -> HlogFile {
        HlogFile {
            path: path.to_owned(),
            file: None,
            whole_bytes: 0,
            lines: HlogWriter::new(Vec::new(), SystemTime::now()).expect("memory takes every line"),
            interval: PathHistograms::new(),
            started: Instant::now(),
            since: Instant::now(),
            tried: None,
        }
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Enters one cycle into the interval.
    pub fn record(&mut self, record: &CycleRecord) {
        self.interval.record(record);
    }

    /// Writes the head at first, then an interval every ten seconds or `at_once`; `None` if nothing was due.
    ///
    /// # Errors
    /// What the system said. The file ends with a whole line then too, and the interval goes on.
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
            none => none.insert(
                OpenOptions::new().write(true).create(true).truncate(true).mode(MODE).open(&self.path)?,
            ),
        };
        let lines = self.lines.writer_mut();
        if let Err(error) = file.write_all(lines) {
            // Half a line would end the log for every reader.
            let _ = file.set_len(self.whole_bytes);
            let _ = file.seek(SeekFrom::Start(self.whole_bytes));
            return Err(error);
        }
        self.whole_bytes += lines.len() as u64;
        lines.clear();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn cycle(number: u64) -> CycleRecord {
        let due_ns = number * 1_000_000;
        CycleRecord { cycle: number, due_ns, woken_ns: due_ns + 30_000, ..CycleRecord::zeroed() }
    }

    fn tagged(path: &Path) -> usize {
        std::fs::read_to_string(path).unwrap().lines().filter(|line| line.starts_with("Tag=")).count()
    }

    #[test]
    fn the_head_is_there_at_once_and_every_interval_is_a_line_a_stage() {
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
    fn what_could_not_be_written_is_written_later_and_no_line_is_cut() {
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
    fn a_full_disk_is_an_error_each_time() {
        let path = Path::new("/dev/full");
        if !path.exists() {
            println!("skipped: there is no /dev/full here");
            return;
        }
        let mut hlog = HlogFile::new(path);
        for number in 1..=3 {
            hlog.record(&cycle(number));
            assert!(hlog.write_if_due(true).unwrap().is_err());
        }
        assert_eq!(hlog.interval.counts().cycles, 3, "they wait for room");
    }
}
