//! Motion exports of MVN, `.mvnx`, versions 3 and 4.
//!
//! Read frame by frame, in bounded memory. Both versions have the same elements; they differ in names of joints and
//! points, and in the axes of the arms: version 3 follows the ISB's recommendation, so that the arms' axes differ in
//! the T pose. The null pose in the file's header (`identity` in version 4, `npose` in 3) defines the axes, and every
//! frame is rotated by it into the internal axes (X forward, Y left, Z up for every segment in the T pose). A file
//! without it is refused, and a frame whose segments are not connected at their joints after this rotation is omitted.
//!
//! Time is `index` over `frameRate`: `time` and `ms` are rounded to whole milliseconds, and the last part of `tc` is a
//! frame number. If `ms`, the wall clock, leads by more than two frames, frames are missing from the file, and the time
//! follows `ms`. A wall clock that falls behind was set: the time does not follow. A clock that was set forward looks like
//! missing frames, so both are counted ([`MvnxCapture::wall_clock_steps`]).

mod frame;
mod head;
mod xml;

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use bytemuck::Zeroable;
use equipoise_core::message::{SuitBody, SuitSample};
use equipoise_files::open_regular;
use thiserror::Error;

use self::frame::{Frame, Pose};
use self::head::Head;
use self::xml::Xml;
use super::csv::TIME_BASE_NS;
use super::rejected::Rejected;
use crate::suit::SuitSubject;

/// Latest accepted time, s.
const TIME_MAX_S: f64 = 4e6;
const NS_PER_MS: i64 = 1_000_000;

/// Why an `.mvnx` could not be read, or not to its end.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[expect(missing_docs, reason = "lines and names say what they are; the sentences tell the rest")]
pub enum MvnxError {
    /// The file could not be opened.
    #[error("cannot read {}: {reason}", path.display())]
    Open { path: PathBuf, reason: String },
    /// It is another kind of file.
    #[error("not an .mvnx: it begins with {found}; in MVN, choose File > Export > MVNX")]
    NotMvnx { found: String },
    /// The XML is broken: a damaged or unfinished export.
    #[error("line {line}: {reason}; export the file again")]
    Malformed { line: u64, reason: String },
    /// The sampling rate is missing.
    #[error("line {line}: the subject's frameRate is {}, not a number of 1 to 1000 Hz", found.as_deref().unwrap_or("missing"))]
    NoFrameRate { line: u64, found: Option<String> },
    /// Frames without the list of segments cannot be interpreted.
    #[error(
        "line {line}: <frames> without <segments> before it: which number belongs to which segment is unknown"
    )]
    NoSegments { line: u64 },
    /// A body has 23 segments.
    #[error("line {line}: these segments are missing: {names}; a whole body is needed (no prop, no object)")]
    MissingSegments { line: u64, names: String },
    /// A duplicate segment name.
    #[error("line {line}: a second segment {label}; one file holds one body")]
    DuplicateSegment { line: u64, label: String },
    /// A limit that no real file reaches.
    #[error("line {line}: more than {most} {what}")]
    TooMany { line: u64, what: &'static str, most: usize },
    /// The file has only a header.
    #[error("it has no frames; in MVN, export at least \"Segment Orientation\" and \"Segment Position\"")]
    NoFrames,
    /// The axes are undefined.
    #[error(
        "line {line}: no frame of type \"identity\" (version 4) or \"npose\" (version 3) stands before the first one; \
         without it the axes of the arms are not known; export the file again from MVN"
    )]
    NoNullPose { line: u64 },
    /// The null pose is invalid.
    #[error(
        "line {line}: the null pose cannot be used ({reason}); export the file again with orientation and position"
    )]
    BadNullPose { line: u64, reason: &'static str },
}

/// Frames of an `.mvnx` as samples; unusable frames are counted in [`MvnxCapture::rejected`].
///
/// Reasons: `no_pose` (without orientation or position), `wrong_count` (not as many numbers as segments or joints),
/// `not_a_number`, `implausible` (above 10 000 in its unit), `not_a_rotation`, `joints_apart` (orientation and position
/// are inconsistent), `without_time`, `time_not_increasing`, `time_out_of_range`.
pub struct MvnxCapture<R: BufRead> {
    xml: Xml<R>,
    frames_depth: usize,
    head: Head,
    null: Pose,
    frame: Frame,
    /// Whether `frame` was read and not returned.
    waiting: bool,
    clock: Clock,
    sequence: u64,
    last_time_ns: u64,
    rejected: Rejected,
    fault: Option<MvnxError>,
}

impl<R: BufRead> std::fmt::Debug for MvnxCapture<R> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MvnxCapture").field("sequence", &self.sequence).finish_non_exhaustive()
    }
}

impl MvnxCapture<BufReader<File>> {
    /// Opens a file and reads up to its first frame.
    ///
    /// # Errors
    /// [`MvnxError`] if it cannot be opened, or does not contain a body's motion.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, MvnxError> {
        let path = path.as_ref();
        let failed =
            |error: std::io::Error| MvnxError::Open { path: path.to_owned(), reason: error.to_string() };
        MvnxCapture::new(BufReader::with_capacity(1 << 16, open_regular(path).map_err(failed)?))
    }
}

impl<R: BufRead> MvnxCapture<R> {
    /// Reads up to the first frame.
    ///
    /// # Errors
    /// [`MvnxError`] if the data are not a body's motion.
    pub fn new(reader: R) -> Result<Self, MvnxError> {
        let mut xml = Xml::new(reader);
        let mut head = Head::read(&mut xml)?;
        let frames_depth = xml.depth();
        let mut frame = Frame::default();
        let mut null = None;
        loop {
            if !frame.read(&mut xml, frames_depth)? {
                return Err(MvnxError::NoFrames);
            }
            match frame.kind.as_str() {
                "identity" | "npose" => {
                    let line = frame.line;
                    null = Some(frame.pose(&head).map_err(|reason| MvnxError::BadNullPose { line, reason })?);
                }
                "normal" => break,
                _ => {}
            }
        }
        let null = null.ok_or(MvnxError::NoNullPose { line: frame.line })?;
        head.subject.null_pose.origins_m = Some(null.origin.map(Into::into));
        let clock = Clock::of(&frame, head.rate_hz);
        Ok(MvnxCapture {
            xml,
            frames_depth,
            head,
            null,
            frame,
            waiting: true,
            clock,
            sequence: 0,
            last_time_ns: 0,
            rejected: Rejected::numbered_by("line"),
            fault: None,
        })
    }

    /// The body: name, origins of the segments in the T pose, points on them.
    pub fn subject(&self) -> &SuitSubject {
        &self.head.subject
    }

    /// The body as the message that a live suit sends; `None` if its dimensions are implausible.
    pub fn body(&self) -> Option<SuitBody> {
        let body = self.head.subject.null_pose.to_body(0).filter(SuitBody::is_plausible)?;
        Some(SuitBody { arrival_ns: TIME_BASE_NS, published_ns: TIME_BASE_NS, ..body })
    }

    /// `version` of the file.
    pub fn version(&self) -> Option<&str> {
        self.head.version.as_deref()
    }

    /// Tracker configuration (`FullBody`, `UpperBody`, …), if given; segments without a tracker are not measured.
    pub fn configuration(&self) -> Option<&str> {
        self.head.configuration.as_deref()
    }

    /// Frame rate, Hz.
    pub fn rate_hz(&self) -> f64 {
        self.head.rate_hz
    }

    /// Time of [`TIME_BASE_NS`] by the wall clock of MVN's computer, ns since 1970; `None` if the file does not contain
    /// it.
    pub fn wall_clock_ns(&self) -> Option<u64> {
        let unix_ms = self.clock.first.unix_ms?;
        u64::try_from(unix_ms).ok()?.checked_mul(NS_PER_MS as u64)
    }

    /// Steps of the wall clock so far.
    pub fn wall_clock_steps(&self) -> WallClockSteps {
        self.clock.steps
    }

    /// Frames omitted so far, by reason.
    pub fn rejected(&self) -> &Rejected {
        &self.rejected
    }

    /// The fault that ended the reading before the end of the frames, after the iterator has ended.
    pub fn fault(&self) -> Option<&MvnxError> {
        self.fault.as_ref()
    }

    fn sample(&mut self) -> Result<SuitSample, &'static str> {
        let time_ns = self.clock.time_ns(&self.frame)?;
        if time_ns <= self.last_time_ns {
            return Err("time_not_increasing");
        }
        let mut sample = SuitSample {
            sample_time_ns: time_ns,
            arrival_ns: time_ns,
            published_ns: time_ns,
            sequence: self.sequence + 1,
            device_counter: self.frame.index.map_or(self.sequence as u32, |index| index as u32),
            device_time_ms: self.frame.time_ms.map_or(0, |time_ms| time_ms as u32),
            ..Zeroable::zeroed()
        };
        self.frame.fill(&self.head, &self.null, &mut sample)?;
        Ok(sample)
    }
}

impl<R: BufRead> Iterator for MvnxCapture<R> {
    type Item = SuitSample;

    fn next(&mut self) -> Option<SuitSample> {
        while self.fault.is_none() {
            if !std::mem::take(&mut self.waiting) {
                match self.frame.read(&mut self.xml, self.frames_depth) {
                    Ok(true) => {}
                    Ok(false) => return None,
                    Err(fault) => {
                        self.fault = Some(fault.into());
                        return None;
                    }
                }
            }
            if self.frame.kind != "normal" {
                continue;
            }
            match self.sample() {
                Ok(sample) => {
                    self.sequence = sample.sequence;
                    self.last_time_ns = sample.sample_time_ns;
                    return Some(sample);
                }
                Err(reason) => self.rejected.count(reason, self.frame.line),
            }
        }
        None
    }
}

/// Clock of the frames.
#[derive(Debug, Clone, Copy)]
struct Clock {
    rate_hz: f64,
    first: Stamps,
    /// Lead of `ms` over `index`.
    lead_ns: i64,
    /// Part of it caused by missing frames.
    ahead_ns: i64,
    steps: WallClockSteps,
}

/// Steps of the wall clock in a file by more than two frames.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct WallClockSteps {
    /// Steps forward, which the time follows as if frames were missing.
    pub forward: u64,
    /// Total of them, ns.
    pub forward_ns: u64,
    /// Steps back, which the time does not follow.
    pub back: u64,
}

#[derive(Debug, Clone, Copy)]
struct Stamps {
    index: Option<i64>,
    time_ms: Option<i64>,
    unix_ms: Option<i64>,
}

impl Stamps {
    fn of(frame: &Frame) -> Stamps {
        // MVN writes zero for an unavailable time.
        let unix_ms = frame.unix_ms.filter(|ms| *ms > 0);
        Stamps { index: frame.index, time_ms: frame.time_ms, unix_ms }
    }
}

impl Clock {
    fn of(first: &Frame, rate_hz: f64) -> Clock {
        Clock { rate_hz, first: Stamps::of(first), lead_ns: 0, ahead_ns: 0, steps: WallClockSteps::default() }
    }

    fn time_ns(&mut self, frame: &Frame) -> Result<u64, &'static str> {
        let now = Stamps::of(frame);
        let since = |now: Option<i64>, first: Option<i64>| now?.checked_sub(first?);
        let wall_ms = since(now.unix_ms, self.first.unix_ms);
        let elapsed_s =
            match (since(now.index, self.first.index), since(now.time_ms, self.first.time_ms), wall_ms) {
                (Some(frames), ..) => frames as f64 / self.rate_hz,
                (None, Some(ms), _) | (None, None, Some(ms)) => ms as f64 * 1e-3,
                _ => return Err("without_time"),
            };
        if !(0.0..TIME_MAX_S).contains(&elapsed_s) {
            return Err("time_out_of_range");
        }
        let elapsed_ns = (elapsed_s * 1e9).round() as i64;
        if let Some(wall_ns) = wall_ms.and_then(|ms| ms.checked_mul(NS_PER_MS)) {
            let interval_ns = (1e9 / self.rate_hz) as i64;
            let lead_ns = wall_ns.saturating_sub(elapsed_ns);
            let limit_ns = (TIME_MAX_S * 1e9) as i64;
            if (-limit_ns..limit_ns).contains(&wall_ns)
                && lead_ns.abs_diff(self.lead_ns) > 2 * interval_ns.unsigned_abs() + NS_PER_MS as u64
            {
                let step_ns = lead_ns.saturating_sub(self.lead_ns);
                self.lead_ns = lead_ns;
                if step_ns > 0 {
                    self.ahead_ns = self.ahead_ns.saturating_add(step_ns);
                    self.steps.forward += 1;
                    self.steps.forward_ns = self.steps.forward_ns.saturating_add(step_ns.unsigned_abs());
                } else {
                    self.steps.back += 1;
                }
            }
        }
        let time_ns = elapsed_ns.saturating_add(self.ahead_ns);
        u64::try_from(time_ns).map(|ns| TIME_BASE_NS + ns).map_err(|_| "time_not_increasing")
    }
}
