//! The part before the frames: subject, sampling rate, and columns of a frame.

use std::io::BufRead;

use equipoise_core::body::{JOINTS, SEGMENTS, Segment};

use super::super::mvnx::MvnxError;
use super::xml::{Fault, Token, Xml};
use crate::suit::SuitSubject;

/// Maximum count of segments; a body with props has fewer.
pub(super) const SEGMENTS_MAX: usize = 64;
/// Maximum count of joints; a body with fingers has fewer.
pub(super) const JOINTS_MAX: usize = 128;
/// Maximum count of points on a segment.
const POINTS_MAX: usize = 64;

/// Maximum length of a stored name, characters.
const NAME_MAX: usize = 80;

/// The header of a file.
#[derive(Debug, Clone, Default)]
pub(super) struct Head {
    pub(super) version: Option<String>,
    pub(super) configuration: Option<String>,
    pub(super) rate_hz: f64,
    pub(super) subject: SuitSubject,
    pub(super) segments: Columns<SEGMENTS>,
    /// `None` if the file does not specify the segment at which each joint ends.
    pub(super) joints: Option<Columns<JOINTS>>,
}

/// Positions of the body's parts among those of the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Columns<const N: usize> {
    /// Count in the file, props included.
    pub(super) count: usize,
    /// Index of each internal part.
    pub(super) indices: [usize; N],
}

impl<const N: usize> Default for Columns<N> {
    fn default() -> Self {
        Columns { count: 0, indices: [0; N] }
    }
}

impl Head {
    /// Reads up to the start of `<frames>`.
    pub(super) fn read<R: BufRead>(xml: &mut Xml<R>) -> Result<Head, MvnxError> {
        let mut head = Head::default();
        let mut segments = None;
        loop {
            let depth = xml.depth();
            let line = xml.line();
            match xml.next()? {
                Token::Start(element) if depth == 0 => {
                    if element.name() != "mvnx" {
                        return Err(MvnxError::NotMvnx { found: element.name().chars().take(40).collect() });
                    }
                    head.version =
                        element.attribute("version").map(|text| text.chars().take(NAME_MAX).collect());
                }
                Token::Start(element) if depth == 1 && element.name() == "subject" => {
                    let rate: Option<String> =
                        element.attribute("frameRate").map(|text| text.chars().take(NAME_MAX).collect());
                    head.rate_hz = rate
                        .as_deref()
                        .and_then(|rate| rate.trim().parse().ok())
                        .filter(|rate_hz| (1.0..=1000.0).contains(rate_hz))
                        .ok_or(MvnxError::NoFrameRate { line, found: rate })?;
                    let attribute =
                        |name| element.attribute(name).map(|text| text.chars().take(NAME_MAX).collect());
                    head.configuration = attribute("configuration");
                    head.subject.name = attribute("label");
                }
                Token::Start(element) if depth == 2 => match element.name() {
                    "segments" => segments = Some(read_segments(xml, &mut head.subject)?),
                    "joints" => head.joints = read_joints(xml)?,
                    "frames" => {
                        // In a damaged file, `<frames>` may be in an element other than the subject.
                        if head.rate_hz == 0.0 {
                            return Err(MvnxError::NoFrameRate { line, found: None });
                        }
                        head.segments = segments.ok_or(MvnxError::NoSegments { line })?;
                        return Ok(head);
                    }
                    _ => {}
                },
                Token::Eof if head.version.is_none() && segments.is_none() && head.rate_hz == 0.0 => {
                    return Err(MvnxError::NotMvnx { found: "nothing".to_owned() });
                }
                Token::Eof => return Err(MvnxError::NoFrames),
                _ => {}
            }
        }
    }
}

/// The segment of a name in the file; MVN writes `ForeArm`.
fn segment_of(label: &str) -> Option<Segment> {
    Segment::ALL.into_iter().find(|segment| segment.name().eq_ignore_ascii_case(label.trim()))
}

fn read_segments<R: BufRead>(
    xml: &mut Xml<R>,
    subject: &mut SuitSubject,
) -> Result<Columns<SEGMENTS>, MvnxError> {
    let parent_depth = xml.depth() - 1;
    let mut indices = [usize::MAX; SEGMENTS];
    let (mut count, mut current, mut points) = (0, None, 0_u16);
    let (mut point, mut in_position) = (None, false);
    loop {
        let depth = xml.depth();
        let line = xml.line();
        match xml.next()? {
            Token::Start(element) if depth == parent_depth + 1 && element.name() == "segment" => {
                let label: String =
                    element.attribute("label").unwrap_or_default().chars().take(NAME_MAX).collect();
                current = segment_of(&label);
                if let Some(segment) = current {
                    if indices[segment.index()] != usize::MAX {
                        return Err(MvnxError::DuplicateSegment { line, label });
                    }
                    indices[segment.index()] = count;
                }
                points = 0;
                count += 1;
                if count > SEGMENTS_MAX {
                    return Err(MvnxError::TooMany { line, what: "segments", most: SEGMENTS_MAX });
                }
            }
            Token::Start(element) if element.name() == "point" => {
                points += 1;
                if usize::from(points) > POINTS_MAX {
                    return Err(MvnxError::TooMany { line, what: "points of a segment", most: POINTS_MAX });
                }
                point = element.attribute("label").map(|label| label.chars().take(NAME_MAX).collect());
            }
            // Version 3 has pos_s, version 4 pos_b: both relative to the segment's origin.
            Token::Start(element) => in_position = matches!(element.name(), "pos_s" | "pos_b"),
            Token::Text(text) if in_position && !text.trim().is_empty() => {
                if let (Some(segment), Some(label), Some(offset_m)) = (current, point.take(), offset_m(text))
                {
                    // Ids as in the datagram of the null pose: from 1, in the order of the file.
                    let key = (segment.index() as u16 + 1, points);
                    subject.null_pose.points.insert(key, (label, offset_m));
                }
            }
            Token::End => {
                in_position = false;
                if xml.depth() == parent_depth {
                    break;
                }
            }
            Token::Eof => return Err(MvnxError::NoFrames),
            _ => {}
        }
    }
    let missing: Vec<_> =
        Segment::ALL.into_iter().filter(|segment| indices[segment.index()] == usize::MAX).collect();
    if !missing.is_empty() {
        let names = missing.iter().map(|segment| segment.name()).collect::<Vec<_>>().join(", ");
        return Err(MvnxError::MissingSegments { line: xml.line(), names });
    }
    Ok(Columns { count, indices })
}

/// Maps joints by the segment at which each ends, as versions name the joints differently.
fn read_joints<R: BufRead>(xml: &mut Xml<R>) -> Result<Option<Columns<JOINTS>>, MvnxError> {
    let parent_depth = xml.depth() - 1;
    let mut indices = [usize::MAX; JOINTS];
    let (mut count, mut in_child) = (0_usize, false);
    loop {
        let line = xml.line();
        match xml.next()? {
            Token::Start(element) => {
                in_child = element.name() == "connector2";
                count += usize::from(element.name() == "joint");
                if count > JOINTS_MAX {
                    return Err(MvnxError::TooMany { line, what: "joints", most: JOINTS_MAX });
                }
            }
            Token::Text(text) if in_child => {
                let child = text.trim().split('/').next().and_then(segment_of);
                // Joint j ends at segment j + 1; no joint ends at the pelvis.
                let joint = child.and_then(|segment| segment.index().checked_sub(1));
                if let (Some(joint), Some(index)) = (joint, count.checked_sub(1)) {
                    indices[joint] = index;
                }
            }
            Token::End => {
                in_child = false;
                if xml.depth() == parent_depth {
                    break;
                }
            }
            Token::Eof => return Err(MvnxError::NoFrames),
            _ => {}
        }
    }
    Ok(indices.iter().all(|index| *index != usize::MAX).then_some(Columns { count, indices }))
}

/// Three coordinates of a point on a segment, m; `None` unless there are three within ±10 m.
fn offset_m(text: &str) -> Option<[f64; 3]> {
    let mut numbers = text.split_ascii_whitespace().map(|number| number.parse::<f64>().ok());
    let offset_m = [numbers.next()??, numbers.next()??, numbers.next()??];
    (numbers.next().is_none() && offset_m.iter().all(|metres| metres.abs() <= 10.0)).then_some(offset_m)
}

impl From<Fault> for MvnxError {
    fn from(fault: Fault) -> MvnxError {
        MvnxError::Malformed { line: fault.line, reason: fault.reason }
    }
}
