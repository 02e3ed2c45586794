//! Files of OpenSim 4: ground reaction (`.mot`), overload torques (`.sto`), joint centres (`.trc`).
//!
//! Formats: OpenSim documentation, "Preparing Your Data": Motion (.mot) Files, Storage (.sto) Files, Marker (.trc) Files,
//! <https://opensimconfluence.atlassian.net/wiki/spaces/OpenSim/pages/53089415>, `53089996` and `53089972`.
//!
//! OpenSim's ground frame has X forward, Y up, Z to the right: the station's `(x, y, z)` becomes `(x, z, -y)`.
//!
//! Invalid values: OpenSim's tools replace NaN in `.mot` and `.sto` by zero and drop the rows after it, so neither file
//! contains one. A `.mot` file must have a constant interval and holds the longest run of valid frames; a `.sto` file omits
//! the rows without torques; `.trc` has NaN, which OpenSim reads as a missing marker.

mod text;

use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use equipoise_core::body::{Joint, SEGMENTS, Segment};

use crate::motion::Motion;
use crate::motion::frame::Frame;
use crate::part::Part;
use crate::{Progress, Written};
use text::TextFile;

/// Millimetres per metre.
const MM_PER_M: f64 = 1000.0;
/// Names of the files in a folder.
const FOLDER_FILES: [(Kind, &str); 3] = [
    (Kind::GroundReaction, "ground_reaction.mot"),
    (Kind::Torques, "overload_torques.sto"),
    (Kind::JointCentres, "joint_centres.trc"),
];

/// One of the files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// `.mot`: force, point and torque on the person, as external load.
    GroundReaction,
    /// `.sto`: overload torque of each joint with its 1-σ.
    Torques,
    /// `.trc`: joint centres.
    JointCentres,
}

/// A vector of the station's world in OpenSim's ground frame.
fn y_up([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x, z, -y]
}

/// Name of the point at a segment's origin: its proximal joint; the pelvis has none.
pub(crate) fn point_name(segment: Segment) -> &'static str {
    segment.proximal_joint().map_or(segment.name(), Joint::name)
}

/// Writes one file.
pub(crate) fn write_file(
    motion: &Motion<'_>,
    kind: Kind,
    out: &Path,
    progress: &mut Progress<'_>,
) -> anyhow::Result<Report> {
    write(motion, &[(kind, out.to_owned())], progress)
}

/// Writes all files into a folder, which is created; a file without valid values is left out and noted.
pub(crate) fn write_folder(
    motion: &Motion<'_>,
    folder: &Path,
    progress: &mut Progress<'_>,
) -> anyhow::Result<Report> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    write(motion, &FOLDER_FILES.map(|(kind, name)| (kind, folder.join(name))), progress)
}

/// Written files, and remarks on them.
#[derive(Debug, Default)]
pub(crate) struct Report {
    pub(crate) files: Vec<Written>,
    pub(crate) notes: Vec<String>,
}

fn write(
    motion: &Motion<'_>,
    wanted: &[(Kind, PathBuf)],
    progress: &mut Progress<'_>,
) -> anyhow::Result<Report> {
    let coverage = Coverage::of(motion, progress)?;
    let (mut report, mut open) = (Report::default(), Vec::new());
    for (kind, path) in wanted {
        match coverage.refusal(*kind) {
            Some(reason) if wanted.len() == 1 => bail!("{}: {reason}", path.display()),
            Some(reason) => report.notes.push(format!("{} is not written: {reason}", path.display())),
            None => open.push(OpenFile::begin(motion, &coverage, *kind, path)?),
        }
    }
    if open.is_empty() {
        bail!("nothing to write:\n{}", report.notes.join("\n"));
    }
    progress.begin("writing");
    motion.frames(progress, &mut |index, frame| {
        open.iter_mut().try_for_each(|file| file.write(motion, &coverage, index, frame))
    })?;
    for file in open {
        report.notes.extend(coverage.note(motion, file.kind));
        report.files.push(file.finish()?);
    }
    Ok(report)
}

/// Which frames have valid values.
#[derive(Debug, Default)]
struct Coverage {
    frames: usize,
    /// Frames with force, point and free moment.
    wrench: LongestRun,
    /// Frames with force and point.
    force: LongestRun,
    /// Number of frames with torques.
    torques: usize,
    /// Number of frames with joint centres.
    centres: usize,
}

/// Longest run of consecutive valid frames.
#[derive(Debug, Default)]
struct LongestRun {
    current: Range<usize>,
    longest: Range<usize>,
    count: usize,
}

impl LongestRun {
    fn add(&mut self, index: usize, is_valid: bool) {
        if !is_valid {
            return;
        }
        self.count += 1;
        let continues = self.current.end == index && !self.current.is_empty();
        self.current = if continues { self.current.start..index + 1 } else { index..index + 1 };
        if self.current.len() > self.longest.len() {
            self.longest = self.current.clone();
        }
    }
}

impl Coverage {
    fn of(motion: &Motion<'_>, progress: &mut Progress<'_>) -> anyhow::Result<Coverage> {
        let mut coverage = Coverage { frames: motion.grid.frames, ..Coverage::default() };
        progress.begin("finding valid frames");
        motion.frames(progress, &mut |index, frame| {
            coverage.force.add(index, frame.has_force());
            coverage.wrench.add(index, frame.has_force() && frame.free_moment_nm.is_finite());
            coverage.torques += usize::from(frame.has_torques());
            coverage.centres += usize::from(frame.origin_m[0][0].is_finite());
            Ok(())
        })?;
        Ok(coverage)
    }

    /// Whether the free moment is available at all; otherwise its columns are omitted.
    fn has_free_moment(&self) -> bool {
        self.wrench.count > 0
    }

    /// Frames of the ground reaction.
    fn ground(&self) -> &LongestRun {
        if self.has_free_moment() { &self.wrench } else { &self.force }
    }

    /// Why a file would have no rows.
    fn refusal(&self, kind: Kind) -> Option<&'static str> {
        match kind {
            Kind::GroundReaction if self.force.count == 0 => Some(
                "no frame has a force with a point of application: the recording needs samples of a plate that measures \
                 shear, and a person on it",
            ),
            Kind::Torques if self.torques == 0 => {
                Some("no frame has valid overload torques: they need an identified worker with a load")
            }
            Kind::JointCentres if self.centres == 0 => Some("no frame has valid joint centres"),
            _ => None,
        }
    }

    fn rows(&self, kind: Kind) -> usize {
        match kind {
            Kind::GroundReaction => self.ground().longest.len(),
            Kind::Torques => self.torques,
            Kind::JointCentres => self.frames,
        }
    }

    /// A remark on omitted frames.
    fn note(&self, motion: &Motion<'_>, kind: Kind) -> Option<String> {
        let run = &self.ground().longest;
        let at = |frame: usize| motion.time_s(motion.grid.time_ns(frame));
        match kind {
            Kind::GroundReaction if run.len() < self.frames => Some(format!(
                "ground reaction: the longest run of valid frames, {:.3} to {:.3} s; {} of {} frames are valid; other \
                 runs: --span{}",
                at(run.start),
                at(run.end - 1),
                self.ground().count,
                self.frames,
                if self.has_free_moment() { "" } else { "; without the free moment, which is unavailable" }
            )),
            Kind::Torques if self.torques < self.frames => {
                Some(format!("overload torques: valid in {} of {} frames", self.torques, self.frames))
            }
            Kind::JointCentres if self.centres < self.frames => {
                Some(format!("joint centres: valid in {} of {} frames", self.centres, self.frames))
            }
            _ => None,
        }
    }
}

/// A file being written.
struct OpenFile {
    kind: Kind,
    path: PathBuf,
    part: Part,
    text: TextFile,
    rows: u64,
    columns: usize,
}

impl OpenFile {
    fn begin(motion: &Motion<'_>, coverage: &Coverage, kind: Kind, path: &Path) -> anyhow::Result<OpenFile> {
        let part = Part::next_to(path)?;
        let mut text = TextFile::new(part.file()?);
        let rows = coverage.rows(kind);
        let columns = match kind {
            Kind::GroundReaction => {
                text.storage_header("ground_reaction", rows, &ground_columns(coverage.has_free_moment()))?
            }
            Kind::Torques => text.storage_header("overload_torques", rows, &torque_columns())?,
            Kind::JointCentres => {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                text.marker_header(&name, motion.grid.rate_hz, rows, &Segment::ALL.map(point_name))?
            }
        };
        Ok(OpenFile { kind, path: path.to_owned(), part, text, rows: 0, columns })
    }

    fn write(
        &mut self,
        motion: &Motion<'_>,
        coverage: &Coverage,
        index: usize,
        frame: &Frame,
    ) -> anyhow::Result<()> {
        let time_s = motion.time_s(frame.time_ns);
        let is_row = match self.kind {
            Kind::GroundReaction => coverage.ground().longest.contains(&index),
            Kind::Torques => frame.has_torques(),
            Kind::JointCentres => true,
        };
        if !is_row {
            return Ok(());
        }
        self.rows += 1;
        let file = &mut self.text;
        match self.kind {
            Kind::GroundReaction => file.row(None, time_s, &ground_row(frame, coverage.has_free_moment())),
            Kind::Torques => file.row(None, time_s, &torque_row(frame)),
            Kind::JointCentres => file.row(Some(index + 1), time_s, &centres_mm(frame)),
        }
        .context("cannot write the file")
    }

    fn finish(mut self) -> anyhow::Result<Written> {
        self.text.0.flush().context("cannot write the file")?;
        self.part.take_place(&self.path)?;
        Ok(Written { path: self.path, rows: self.rows, columns: self.columns })
    }
}

/// Columns of an external load: force, point, torque, as in OpenSim's gait models.
fn ground_columns(has_free_moment: bool) -> Vec<String> {
    let mut groups = vec!["ground_force_v", "ground_force_p"];
    groups.extend(has_free_moment.then_some("ground_torque_"));
    groups.iter().flat_map(|group| ["x", "y", "z"].map(|axis| format!("{group}{axis}"))).collect()
}

/// The moment at the centre of pressure has a vertical component only.
fn ground_row(frame: &Frame, has_free_moment: bool) -> Vec<f64> {
    let mut row = [y_up(frame.force_n), y_up(frame.cop_m)].concat();
    if has_free_moment {
        row.extend([0.0, frame.free_moment_nm, 0.0]);
    }
    row
}

fn torque_columns() -> Vec<String> {
    let of =
        |joint: Joint| ["x", "y", "z", "sigma"].map(|end| format!("{}_overload_torque_{end}", joint.name()));
    Joint::ALL.into_iter().flat_map(of).collect()
}

fn torque_row(frame: &Frame) -> Vec<f64> {
    let joints = frame.torque_nm.iter().zip(frame.torque_sigma_nm);
    joints.flat_map(|(torque_nm, sigma_nm)| y_up(*torque_nm).into_iter().chain([sigma_nm])).collect()
}

fn centres_mm(frame: &Frame) -> [f64; 3 * SEGMENTS] {
    let mm = frame.origin_m.map(|origin_m| y_up(origin_m).map(|metres| MM_PER_M * metres));
    std::array::from_fn(|index| mm[index / 3][index % 3])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_axes_are_turned_and_not_mirrored() {
        let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(y_up);
        assert_eq!((x, y, z), ([1.0, 0.0, -0.0], [0.0, 0.0, -1.0], [0.0, 1.0, -0.0]));
        let cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
        assert_eq!(cross, z, "right-handed as before");
    }

    #[test]
    fn the_longest_run_ends_at_an_invalid_frame() {
        let mut run = LongestRun::default();
        for (index, valid) in [true, false, true, true, false, true].into_iter().enumerate() {
            run.add(index, valid);
        }
        assert_eq!((run.longest, run.count), (2..4, 4));
    }

    #[test]
    fn every_point_has_a_name_of_its_own() {
        let names: std::collections::BTreeSet<_> = Segment::ALL.map(point_name).into();
        assert_eq!(names.len(), SEGMENTS);
        assert!(names.contains("Pelvis") && names.contains("RightKnee"));
    }
}
