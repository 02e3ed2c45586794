//! Forces of a plate as text: Kistler's BioWare exports, and similar files of other programs.
//!
//! Some lines of any kind, then a header line that names a time and forces, optionally a line of units, then rows;
//! cells are separated by tabs, semicolons or commas; the decimal separator is a point, or a comma if cells are not
//! separated by it. Columns are found by name: `abs time` or `time`, and
//! - `Fx Fy Fz Mx My Mz`, moments about the sensor's origin, or
//! - `Fx Fy Fz Ax Ay` and optionally `Tz`: centre of pressure and free moment; without `Tz` samples mark the free
//!   moment as not measured; or
//! - `fx12 fx34 fy14 fy23 fz1 fz2 fz3 fz4`: the channels of a plate with four sensors, whose distances must be
//!   configured.
//!
//! Units follow the names, `Fx (N)`, or are below them; otherwise they must be declared, and are never guessed. Axes
//! and pose are those of the settings: BioWare's z points down and its forces are those on the plate.

mod columns;

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use bytemuck::Zeroable;
use equipoise_core::message::GroundSample;
use equipoise_files::open_regular;
use thiserror::Error;

pub use self::columns::Units;
use self::columns::{Columns, Layout};
use super::csv::TIME_BASE_NS;
use super::lines::ShortLines;
use super::rejected::Rejected;
use crate::ground::channels::{Centre, Direct, EightChannels, ForceUnit, MomentUnit};
use crate::ground::{ChannelFault, Channels, GroundSettings, Load, SensorAxes, Wrench};

/// Maximum count of lines up to the header line.
const HEAD_LINES_MAX: u64 = 200;
/// Maximum count of columns.
const CELLS_MAX: usize = 512;
/// The longest session, s.
const SESSION_MAX_S: f64 = 4e6;
/// Lower bound of times that are seconds since 1970, …
const UNIX_FROM_S: f64 = 1e9;
/// … and upper bound: the year 2100.
const UNIX_TO_S: f64 = 4.2e9;
/// Plausibility limit, N or N m.
const LARGEST: f64 = 1e5;
/// Below this force on the plate the centre of pressure is undefined, N.
const PRESSURE_MIN_N: f64 = 5.0;

/// Properties that the file does not contain.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BioWareSettings {
    /// Sign, axes, pose and delay of the plate.
    pub ground: GroundSettings,
    /// Units for columns without one.
    pub units: Units,
    /// Number of the plate, from 1, in files with several.
    pub plate: Option<usize>,
    /// Distances a and b of the four sensors from the centre, m: for files with eight channels.
    pub sensor_offsets_m: Option<[f64; 2]>,
}

/// Why a text export could not be read.
#[derive(Debug, Clone, PartialEq, Error)]
#[expect(missing_docs, reason = "lines and names say what they are; the sentences tell the rest")]
pub enum BioWareError {
    /// The file could not be opened or read.
    #[error("cannot read {}: {reason}", path.display())]
    Open { path: PathBuf, reason: String },
    /// The file could not be read up to its rows.
    #[error("line {line}: cannot be read: {reason}")]
    Read { line: u64, reason: String },
    /// No header line.
    #[error(
        "no line of the first {HEAD_LINES_MAX} names a time and a vertical force (abs time, Fx, Fy, Fz, Mx, My, Mz); \
         export with column names, as text in UTF-8"
    )]
    NoHead,
    /// Missing columns.
    #[error(
        "line {line}: of {} the columns Fx Fy Fz Mx My Mz are needed, or Fx Fy Fz Ax Ay, or fx12 fx34 fy14 fy23 fz1 fz2 \
         fz3 fz4; there are {found}", if *of_plate { "the plate" } else { "the file" }
    )]
    MissingColumns { line: u64, found: String, of_plate: bool },
    /// An undefined unit.
    #[error(
        "line {line}: column {column} is in \"{unit}\", which is no unit of {of} that is read; declare the units"
    )]
    UnknownUnit { line: u64, column: String, unit: String, of: &'static str },
    /// A missing unit.
    #[error("line {line}: column {column} has no unit of {of}; declare the units, as in s,N,N.m,m")]
    NoUnit { line: u64, column: String, of: &'static str },
    /// Several plates without a selection.
    #[error("line {line}: the file has {plates} plates; say which of them")]
    WhichPlate { line: u64, plates: usize },
    /// A plate that does not exist.
    #[error("line {line}: there is no plate {plate}; the file has {plates}")]
    NoSuchPlate { line: u64, plate: usize, plates: usize },
    /// Eight channels without the sensors' distances.
    #[error(
        "line {line}: the file has eight channels; the distances a and b of the plate's sensors must be given, m"
    )]
    NoOffsets { line: u64 },
    /// Invalid distances or surface height.
    #[error("the plate's channels cannot be used: {0}")]
    Channels(#[from] ChannelFault),
}

/// Rows of a text export as samples; unusable rows are counted in [`BioWareCapture::rejected`].
///
/// Reasons: `unreadable_row` (too few cells), `not_a_number` (also NaN and infinite), `implausible` (more than 100 kN),
/// `time_out_of_range`, `time_not_increasing`.
#[derive(Debug)]
pub struct BioWareCapture<R: Read> {
    lines: BufReader<ShortLines<R>>,
    text: Vec<u8>,
    line: u64,
    /// The line in `text` was not used yet.
    waiting: bool,
    separator: char,
    columns: Columns,
    channels: Channels,
    settings: BioWareSettings,
    first_s: Option<f64>,
    sequence: u64,
    last_time_ns: u64,
    rejected: Rejected,
    /// Line and cause at which reading failed.
    fault: Option<(u64, String)>,
}

impl BioWareCapture<File> {
    /// Opens a file and finds its columns.
    ///
    /// # Errors
    /// [`BioWareError`].
    pub fn open(path: impl AsRef<Path>, settings: BioWareSettings) -> Result<Self, BioWareError> {
        let path = path.as_ref();
        let file = open_regular(path)
            .map_err(|error| BioWareError::Open { path: path.to_owned(), reason: error.to_string() })?;
        BioWareCapture::new(file, settings)
    }
}

impl<R: Read> BioWareCapture<R> {
    /// Reads up to the first row.
    ///
    /// # Errors
    /// [`BioWareError`] if columns or units are missing.
    pub fn new(reader: R, settings: BioWareSettings) -> Result<Self, BioWareError> {
        let mut lines = BufReader::new(ShortLines::new(reader));
        let (mut text, mut below) = (Vec::new(), Vec::new());
        for line in 1..=HEAD_LINES_MAX {
            if !next_line(&mut lines, &mut text).map_err(unreadable(line))? {
                break;
            }
            let head = String::from_utf8_lossy(&text).into_owned();
            let separator =
                ['\t', ';', ','].into_iter().find(|separator| head.contains(*separator)).unwrap_or('\t');
            let cells: Vec<&str> = head.split(separator).take(CELLS_MAX).collect();
            if !columns::is_head(&cells) {
                continue;
            }
            let waiting = next_line(&mut lines, &mut below).map_err(unreadable(line + 1))?;
            let below_text = String::from_utf8_lossy(&below).into_owned();
            let below_cells: Vec<&str> = below_text.split(separator).take(CELLS_MAX).collect();
            let columns = Columns::find(line, &cells, &below_cells, &settings)?;
            let channels = channels_of(&columns.layout, &settings, line)?;
            let mut capture = BioWareCapture {
                lines,
                text: below,
                line: line + 1,
                waiting: waiting && !columns.has_unit_line,
                separator,
                columns,
                channels,
                settings,
                first_s: None,
                sequence: 0,
                last_time_ns: 0,
                rejected: Rejected::numbered_by("line"),
                fault: None,
            };
            capture.find_first_time();
            return Ok(capture);
        }
        Err(BioWareError::NoHead)
    }

    /// Wall-clock time of [`TIME_BASE_NS`], ns since 1970, if the file's times are seconds since then.
    pub fn wall_clock_ns(&self) -> Option<u64> {
        let first_s = self.first_s.filter(|first_s| (UNIX_FROM_S..UNIX_TO_S).contains(first_s))?;
        Some((first_s * 1e9).round() as u64)
    }

    /// The file's own time of [`TIME_BASE_NS`], s: that of its first row.
    pub fn first_s(&self) -> Option<f64> {
        self.first_s
    }

    /// Rows omitted so far, by reason.
    pub fn rejected(&self) -> &Rejected {
        &self.rejected
    }

    /// Line and cause at which reading failed before the end of the file: the rows after it are missing.
    pub fn fault(&self) -> Option<(u64, &str)> {
        self.fault.as_ref().map(|(line, cause)| (*line, cause.as_str()))
    }

    /// Reads up to the first row with a time, which is the origin of all times.
    fn find_first_time(&mut self) {
        while self.waiting || self.advance() {
            match self.number(self.columns.time) {
                Ok(first_s) if first_s.abs() < UNIX_TO_S => {
                    self.first_s = Some(first_s);
                    self.waiting = true;
                    return;
                }
                Ok(_) => self.rejected.count("time_out_of_range", self.line),
                Err(reason) => self.rejected.count(reason, self.line),
            }
            self.waiting = false;
        }
    }

    /// Reads the next line that is not blank into `text`; `false` at the end of the file, or after a fault.
    fn advance(&mut self) -> bool {
        loop {
            match next_line(&mut self.lines, &mut self.text) {
                Ok(true) if self.fault.is_none() => {}
                Ok(_) => return false,
                Err(error) => {
                    self.fault.get_or_insert((self.line + 1, error.to_string()));
                    return false;
                }
            }
            self.line += 1;
            if !self.text.iter().all(u8::is_ascii_whitespace) {
                return true;
            }
        }
    }

    fn number(&self, column: columns::Column) -> Result<f64, &'static str> {
        let separator = self.separator as u8;
        let cell = self.text.split(|byte| *byte == separator).nth(column.index).ok_or("unreadable_row")?;
        let cell = std::str::from_utf8(cell).map_err(|_| "not_a_number")?.trim().trim_matches('"');
        let number: f64 = match cell.parse() {
            Ok(number) => number,
            Err(_) => cell.replacen(',', ".", 1).parse().map_err(|_| "not_a_number")?,
        };
        let number = number * column.size;
        if number.is_finite() { Ok(number) } else { Err("not_a_number") }
    }

    fn sample(&self) -> Result<GroundSample, &'static str> {
        let since_s = self.number(self.columns.time)? - self.first_s.unwrap_or_default();
        if since_s.abs() >= SESSION_MAX_S {
            return Err("time_out_of_range");
        }
        let time_ns = TIME_BASE_NS.saturating_add_signed((since_s * 1e9).round() as i64);
        if time_ns <= self.last_time_ns {
            return Err("time_not_increasing");
        }
        let (sensor, not_measured) = self.wrench()?;
        if sensor.force_n.iter().chain(&sensor.moment_nm).any(|number| number.abs() > LARGEST) {
            return Err("implausible");
        }
        let ground = &self.settings.ground;
        let person = ground.frame.person_from_sensor(sensor, ground.measures);
        Ok(GroundSample {
            sample_time_ns: time_ns.saturating_sub(ground.latency_ns),
            arrival_ns: time_ns,
            published_ns: time_ns,
            sequence: self.sequence + 1,
            device_counter: (self.sequence + 1) as u32,
            force_n: person.force_n,
            moment_nm: person.moment_nm,
            surface_z_m: ground.frame.surface_z_m(),
            not_measured,
            devices: ground.device as u32,
            ..GroundSample::zeroed()
        }
        .mask_unmeasured())
    }

    fn wrench(&self) -> Result<(Wrench, u32), &'static str> {
        let mut numbers = [0.0; 8];
        for (number, column) in numbers.iter_mut().zip(self.columns.layout.columns()) {
            *number = self.number(column)?;
        }
        if let (Layout::Pressure(..), [_, _, fz, x, y, ..]) = (&self.columns.layout, &mut numbers)
            && fz.abs() < PRESSURE_MIN_N
        {
            // For an empty plate, exports contain a centre at (0, 0), or noise.
            (*x, *y) = (0.0, 0.0);
        }
        match self.channels.load(&numbers) {
            Load::Wrench(wrench) => Ok((wrench, 0)),
            Load::Part { wrench, not_measured } => Ok((wrench, not_measured)),
            // No layout contains insoles.
            Load::Insoles(_) => Err("not_a_number"),
        }
    }
}

/// Meaning of the columns; their numbers are in N, N m and m.
fn channels_of(layout: &Layout, settings: &BioWareSettings, line: u64) -> Result<Channels, BioWareError> {
    Ok(match layout {
        Layout::Wrench(_) => {
            let direct = Direct { force: [Some(0), Some(1), Some(2)], moment: [Some(3), Some(4), Some(5)] };
            Channels::direct(6, direct, ForceUnit::Newton, MomentUnit::NewtonMetre)?
        }
        Layout::Pressure(_, free) => {
            let frame = &settings.ground.frame;
            let centre = Centre {
                shear: Some([0, 1]),
                vertical: 2,
                cop: [3, 4],
                free_moment: free.map(|_| 5),
                surface_z_m: match frame.axes {
                    SensorAxes::ZUp => frame.surface_height_m,
                    SensorAxes::ZDown => -frame.surface_height_m,
                },
                newtons_per_unit: 1.0,
                newton_metres_per_unit: 1.0,
                metres_per_unit: 1.0,
            };
            Channels::centre(6, centre)?
        }
        Layout::Channels(_) => {
            let [a_m, b_m] = settings.sensor_offsets_m.ok_or(BioWareError::NoOffsets { line })?;
            let channels = std::array::from_fn(|channel| channel);
            let eight = EightChannels { channels, a_m, b_m, newtons_per_unit: [1.0; 8], zero: [0.0; 8] };
            Channels::eight(8, &eight)?
        }
    })
}

/// Reads a line without its end; `false` at the end of the file.
fn next_line<R: Read>(lines: &mut BufReader<ShortLines<R>>, text: &mut Vec<u8>) -> io::Result<bool> {
    text.clear();
    if lines.read_until(b'\n', text)? == 0 {
        return Ok(false);
    }
    while matches!(text.last(), Some(b'\n' | b'\r')) {
        text.pop();
    }
    Ok(true)
}

fn unreadable(line: u64) -> impl Fn(io::Error) -> BioWareError {
    move |error| BioWareError::Read { line, reason: error.to_string() }
}

impl<R: Read> Iterator for BioWareCapture<R> {
    type Item = GroundSample;

    fn next(&mut self) -> Option<GroundSample> {
        loop {
            if !std::mem::take(&mut self.waiting) && !self.advance() {
                return None;
            }
            match self.sample() {
                Ok(sample) => {
                    self.sequence = sample.sequence;
                    self.last_time_ns = sample.arrival_ns;
                    return Some(sample);
                }
                Err(reason) => self.rejected.count(reason, self.line),
            }
        }
    }
}
