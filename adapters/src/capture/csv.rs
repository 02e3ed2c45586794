//! Motion and ground reaction as CSV: one row per instant.
//!
//! Columns are separated by commas or semicolons and found by name, in any order; other columns are skipped. Names end
//! with their unit, which may differ from the first one listed here (`_mm`, `_ms`, `_kN`, …):
//! - `t_s`: time since an arbitrary start, increasing;
//! - per segment in MVN's names, `NAME_px_m, _py_m, _pz_m` (origin) and `NAME_qw, _qx, _qy, _qz`
//!   (`world_from_segment`; identity = T-pose, X forward, Y left, Z up);
//! - `Fx_N, Fy_N, Fz_N, Mx_Nm, My_Nm, Mz_Nm`: the ground reaction on the person, moments about the world's origin,
//!   floor at z = 0.

use std::fs::File;
use std::io::{BufRead, BufReader, Chain, Cursor, Read};
use std::path::{Path, PathBuf};

use bytemuck::Zeroable;
use equipoise_core::message::{GroundDevice, GroundSample, SuitSample};
use equipoise_core::time::NS_PER_S;
use equipoise_files::open_regular;
use thiserror::Error;

use super::csv_columns::Columns;
use super::lines::ShortLines;
use super::rejected::Rejected;

/// Time of t = 0 on the pipeline's clock: not 0, which stands for "no sample yet".
pub const TIME_BASE_NS: u64 = NS_PER_S;
/// Latest accepted time; beyond it nanoseconds would not be exact.
const TIME_MAX_S: f64 = 4e6;
/// Tolerance of a quaternion's norm, as quaternions are written with few digits.
const NORM_TOLERANCE: f64 = 0.05;

/// Why a CSV could not be read.
#[derive(Debug, Error)]
pub enum CsvError {
    /// The file could not be opened.
    #[error("cannot read {}: {source}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// It has no header line.
    #[error("cannot read the head line of the CSV: {0}")]
    Head(#[from] csv::Error),
    /// Its numbers have a decimal comma.
    #[error(
        "line 2: {field} has a comma before its decimals: export numbers with a point, or replace the commas (with \
         semicolons between the columns: sed 's/,/./g')"
    )]
    DecimalComma {
        /// The first such number.
        field: String,
    },
    /// A quantity has no column.
    #[error(
        "the CSV has no column {missing}; the most similar one without a place is {nearest}; rename it, or add the column"
    )]
    MissingColumn {
        /// The missing name.
        missing: String,
        /// The most similar existing name that is not another quantity's.
        nearest: String,
    },
}

/// The first two lines, which are inspected first, and the rest.
type Lines<R> = Chain<Cursor<Vec<u8>>, BufReader<ShortLines<R>>>;

/// Rows of a CSV as samples; unusable rows are counted in [`CsvCapture::rejected`].
///
/// Reasons: `unreadable_row` (not text, or too few fields), `not_a_number` (also NaN and infinite),
/// `time_out_of_range`, `time_not_increasing`, `not_a_rotation` (norm outside 0.95–1.05).
#[derive(Debug)]
pub struct CsvCapture<R: Read> {
    rows: csv::Reader<Lines<R>>,
    row: csv::StringRecord,
    columns: Columns,
    sequence: u64,
    last_time_ns: u64,
    rejected: Rejected,
}

impl CsvCapture<File> {
    /// Opens a file and finds its columns.
    ///
    /// # Errors
    /// [`CsvError`] if it cannot be opened or lacks a column.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, CsvError> {
        let path = path.as_ref();
        let file = open_regular(path).map_err(|source| CsvError::Open { path: path.to_owned(), source })?;
        CsvCapture::new(file)
    }
}

impl<R: Read> CsvCapture<R> {
    /// Reads the header line and finds the columns.
    ///
    /// # Errors
    /// [`CsvError`] if it cannot be read or lacks a column.
    pub fn new(reader: R) -> Result<Self, CsvError> {
        let mut rest = BufReader::new(ShortLines::new(reader));
        let mut begin = Vec::new();
        rest.read_until(b'\n', &mut begin).map_err(csv::Error::from)?;
        let delimiter = delimiter_of(&begin);
        let second = begin.len();
        rest.read_until(b'\n', &mut begin).map_err(csv::Error::from)?;
        let comma = begin.get(second..).and_then(|row| decimal_comma(row, delimiter));
        let mut rows = csv::ReaderBuilder::new()
            .flexible(true)
            .delimiter(delimiter)
            .trim(csv::Trim::All)
            .from_reader(Cursor::new(begin).chain(rest));
        let columns = Columns::find(rows.headers()?)?;
        if let Some(field) = comma {
            return Err(CsvError::DecimalComma { field });
        }
        let row = csv::StringRecord::new();
        let rejected = Rejected::numbered_by("line");
        Ok(CsvCapture { rows, row, columns, sequence: 0, last_time_ns: 0, rejected })
    }

    /// Rows omitted so far, by reason.
    pub fn rejected(&self) -> &Rejected {
        &self.rejected
    }

    fn samples(&self) -> Result<(SuitSample, GroundSample), &'static str> {
        let number = |column: super::csv_columns::Column| column.of(&self.row).ok_or("not_a_number");
        let time_s = number(self.columns.time_s)?;
        // The base allows a start slightly before 0, as some programs write it.
        if !(-1.0 < time_s && time_s < TIME_MAX_S) {
            return Err("time_out_of_range");
        }
        let time_ns = TIME_BASE_NS.saturating_add_signed((time_s * 1e9).round() as i64);
        if time_ns <= self.last_time_ns {
            return Err("time_not_increasing");
        }
        let sequence = self.sequence + 1;
        let mut suit = SuitSample {
            sample_time_ns: time_ns,
            arrival_ns: time_ns,
            published_ns: time_ns,
            sequence,
            device_counter: sequence as u32,
            device_time_ms: ((time_ns - TIME_BASE_NS.min(time_ns)) / 1_000_000) as u32,
            ..Zeroable::zeroed()
        };
        for (origin, columns) in suit.position_m.iter_mut().zip(&self.columns.position_m) {
            for (slot, column) in origin.iter_mut().zip(columns) {
                *slot = number(*column)?;
            }
        }
        for (orientation, columns) in suit.orientation_wxyz.iter_mut().zip(&self.columns.orientation_wxyz) {
            for (slot, column) in orientation.iter_mut().zip(columns) {
                *slot = number(*column)?;
            }
            normalise(orientation)?;
        }
        let mut ground = GroundSample {
            sample_time_ns: time_ns,
            arrival_ns: time_ns,
            published_ns: time_ns,
            sequence,
            device_counter: sequence as u32,
            devices: GroundDevice::Plate as u32,
            ..Zeroable::zeroed()
        };
        for axis in 0..3 {
            ground.force_n[axis] = number(self.columns.force_n[axis])?;
            ground.moment_nm[axis] = number(self.columns.moment_nm[axis])?;
        }
        Ok((suit, ground))
    }
}

/// Spreadsheets use semicolons in locales with a decimal comma.
fn delimiter_of(head: &[u8]) -> u8 {
    let count = |sign: u8| head.iter().filter(|byte| **byte == sign).count();
    if count(b';') > count(b',') { b';' } else { b',' }
}

/// The first field of a row with a decimal comma. It cannot be recognised if commas separate the columns.
fn decimal_comma(row: &[u8], delimiter: u8) -> Option<String> {
    let row = std::str::from_utf8(row).ok().filter(|_| delimiter != b',')?;
    let mut fields = row.split(char::from(delimiter)).map(|field| field.trim().trim_matches('"'));
    let field =
        fields.find(|field| field.contains(',') && field.replacen(',', ".", 1).parse::<f64>().is_ok())?;
    Some(field.to_owned())
}

fn normalise(orientation: &mut [f64; 4]) -> Result<(), &'static str> {
    let norm = orientation.iter().map(|q| q * q).sum::<f64>().sqrt();
    if (norm - 1.0).abs() > NORM_TOLERANCE {
        return Err("not_a_rotation");
    }
    for q in orientation {
        *q /= norm;
    }
    Ok(())
}

impl<R: Read> Iterator for CsvCapture<R> {
    type Item = (SuitSample, GroundSample);

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let line = self.rows.position().line();
            match self.rows.read_record(&mut self.row) {
                Ok(false) => return None,
                Ok(true) => {}
                Err(error) => {
                    self.rejected.count("unreadable_row", line);
                    // A row that is not text affects only this row; a read error ends the file.
                    if error.is_io_error() {
                        return None;
                    }
                    continue;
                }
            }
            let line = self.row.position().map_or(line, csv::Position::line);
            match self.samples() {
                Ok((suit, ground)) => {
                    self.sequence = suit.sequence;
                    self.last_time_ns = suit.sample_time_ns;
                    return Some((suit, ground));
                }
                Err(reason) => self.rejected.count(reason, line),
            }
        }
    }
}
