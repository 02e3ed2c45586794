//! Headers and rows of OpenSim's text files.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufWriter, Write};

/// A file being written.
#[derive(Debug)]
pub(super) struct TextFile(pub(super) BufWriter<File>);

impl TextFile {
    pub(super) fn new(file: File) -> TextFile {
        TextFile(BufWriter::new(file))
    }

    /// Header of a `.mot` or `.sto` file, and the labels; `columns` without the time. Returns the number of columns.
    pub(super) fn storage_header(
        &mut self,
        name: &str,
        rows: usize,
        columns: &[String],
    ) -> io::Result<usize> {
        let count = columns.len() + 1;
        writeln!(self.0, "{name}\nversion=1\nnRows={rows}\nnColumns={count}\ninDegrees=no")?;
        writeln!(self.0, "Units are S.I. units (second, metre, newton). X forward, Y up, Z to the right.\n")?;
        writeln!(self.0, "endheader\ntime\t{}", columns.join("\t"))?;
        Ok(count)
    }

    /// Header of a `.trc` file: three lines, two of labels, an empty one. Returns the number of columns.
    pub(super) fn marker_header(
        &mut self,
        name: &str,
        rate_hz: f64,
        frames: usize,
        markers: &[&str],
    ) -> io::Result<usize> {
        let count = markers.len();
        writeln!(self.0, "PathFileType\t4\t(X/Y/Z)\t{name}")?;
        writeln!(
            self.0,
            "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames"
        )?;
        writeln!(self.0, "{rate_hz:.2}\t{rate_hz:.2}\t{frames}\t{count}\tmm\t{rate_hz:.2}\t1\t{frames}")?;
        writeln!(self.0, "Frame#\tTime\t{}", markers.join("\t\t\t"))?;
        let axes = (1..=count).map(|number| format!("X{number}\tY{number}\tZ{number}"));
        writeln!(self.0, "\t\t{}\n", axes.collect::<Vec<_>>().join("\t"))?;
        Ok(2 + 3 * count)
    }

    /// A row: the number of the frame if the format has one, the time, the values.
    pub(super) fn row(&mut self, number: Option<usize>, time_s: f64, values: &[f64]) -> io::Result<()> {
        let mut line = number.map_or_else(String::new, |number| format!("{number}\t"));
        // Writing to a string cannot fail.
        let _ = write!(line, "{time_s:.6}");
        for value in values {
            let _ = write!(line, "\t{value:.6}");
        }
        writeln!(self.0, "{line}")
    }
}
