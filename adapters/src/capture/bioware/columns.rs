//! Maps the columns of a text export to quantities and units.

use super::{BioWareError, BioWareSettings};
use crate::units::{METRE_PER_FOOT, METRE_PER_INCH, NEWTON_PER_LBF, letters};

/// Dimension of a quantity, with its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Dimension {
    Time,
    Force,
    Moment,
    Length,
}

impl Dimension {
    fn name(self) -> &'static str {
        match self {
            Dimension::Time => "time",
            Dimension::Force => "force",
            Dimension::Moment => "moment",
            Dimension::Length => "length",
        }
    }
}

/// The supported units, as in exports (without dots and spaces), with their SI values.
const UNITS: [(&str, Dimension, f64); 18] = [
    ("s", Dimension::Time, 1.0),
    ("sec", Dimension::Time, 1.0),
    ("seconds", Dimension::Time, 1.0),
    ("ms", Dimension::Time, 1e-3),
    ("n", Dimension::Force, 1.0),
    ("newton", Dimension::Force, 1.0),
    ("kn", Dimension::Force, 1e3),
    ("lbf", Dimension::Force, NEWTON_PER_LBF),
    ("lb", Dimension::Force, NEWTON_PER_LBF),
    ("nm", Dimension::Moment, 1.0),
    ("knm", Dimension::Moment, 1e3),
    ("nmm", Dimension::Moment, 1e-3),
    ("ncm", Dimension::Moment, 1e-2),
    ("lbfin", Dimension::Moment, NEWTON_PER_LBF * METRE_PER_INCH),
    ("lbfft", Dimension::Moment, NEWTON_PER_LBF * METRE_PER_FOOT),
    ("m", Dimension::Length, 1.0),
    ("cm", Dimension::Length, 1e-2),
    ("mm", Dimension::Length, 1e-3),
];

/// SI values of the units of a file's columns, declared by the user.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Units {
    time: Option<f64>,
    force: Option<f64>,
    moment: Option<f64>,
    length: Option<f64>,
}

impl Units {
    /// Parses a list in any order: `"s,N,N.m,m"`.
    ///
    /// # Errors
    /// An undefined unit, or a second one for the same quantity.
    pub fn parse(text: &str) -> Result<Units, String> {
        let mut units = Units::default();
        for word in text.split(',').map(str::trim).filter(|word| !word.is_empty()) {
            let (dimension, size) =
                unit(word).ok_or_else(|| format!("{word} is no unit that is read; {}", known()))?;
            if units.slot(dimension).replace(size).is_some() {
                return Err(format!("{word} is a second unit of {}", dimension.name()));
            }
        }
        Ok(units)
    }

    fn slot(&mut self, dimension: Dimension) -> &mut Option<f64> {
        match dimension {
            Dimension::Time => &mut self.time,
            Dimension::Force => &mut self.force,
            Dimension::Moment => &mut self.moment,
            Dimension::Length => &mut self.length,
        }
    }
}

fn known() -> String {
    format!("known are {}", UNITS.map(|(word, ..)| word).join(", "))
}

/// The unit of a name; `N·m`, `N.m`, `N-m`, `N*m` and `N m` are equal.
fn unit(word: &str) -> Option<(Dimension, f64)> {
    let letters = letters(word)?.to_ascii_lowercase();
    UNITS.iter().find(|(name, ..)| *name == letters).map(|(_, dimension, size)| (*dimension, *size))
}

/// One number of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Column {
    pub(super) index: usize,
    pub(super) size: f64,
}

/// Quantities from which the wrench is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Layout {
    /// Force and moment about the sensor's origin: Fx Fy Fz Mx My Mz.
    Wrench([Column; 6]),
    /// Force and centre of pressure, and optionally the free moment: Fx Fy Fz Ax Ay [Tz].
    Pressure([Column; 5], Option<Column>),
    /// The eight channels of a plate with four sensors: fx12 fx34 fy14 fy23 fz1 fz2 fz3 fz4.
    Channels([Column; 8]),
}

impl Layout {
    pub(super) fn columns(&self) -> impl Iterator<Item = Column> {
        let (columns, last): (&[Column], _) = match self {
            Layout::Wrench(columns) => (columns, None),
            Layout::Pressure(columns, last) => (columns, *last),
            Layout::Channels(columns) => (columns, None),
        };
        columns.iter().copied().chain(last)
    }
}

/// Contents of a header line.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Columns {
    pub(super) time: Column,
    pub(super) layout: Layout,
    /// Whether the line after the header contains the units.
    pub(super) has_unit_line: bool,
}

/// A cell without spaces and quotation marks around it.
fn unquoted(cell: &str) -> &str {
    cell.trim().trim_matches('"').trim()
}

/// A column's name without its unit, and the unit: `Fx (N)`, `Fx [N]`, `Fx`.
fn split(cell: &str) -> (String, Option<&str>) {
    let cell = unquoted(cell);
    let (name, unit) = match cell.split_once(['(', '[']) {
        Some((name, unit)) => (name, Some(unit.trim_end_matches([')', ']']).trim())),
        None => (cell, None),
    };
    (name.trim().to_ascii_lowercase(), unit)
}

fn is_time(name: &str) -> bool {
    matches!(name, "abs time" | "time" | "t" | "rel time")
}

/// Whether a line can be the header: it names a time and a vertical force.
pub(super) fn is_head(cells: &[&str]) -> bool {
    let names: Vec<String> = cells.iter().map(|cell| split(cell).0).collect();
    names.iter().any(|name| is_time(name)) && names.iter().any(|name| name == "fz" || name == "fz1")
}

impl Columns {
    /// Finds the columns in the header line; `below` is the line after it.
    pub(super) fn find(
        line: u64,
        head: &[&str],
        below: &[&str],
        settings: &BioWareSettings,
    ) -> Result<Columns, BioWareError> {
        let is_number = |cell: &&str| unquoted(cell).replace(',', ".").parse::<f64>().is_ok();
        let has_unit_line = !below.iter().any(is_number);
        let names: Vec<(String, Option<&str>)> = head.iter().map(|cell| split(cell)).collect();
        let plates = names.iter().filter(|(name, _)| name == "fz" || name == "fz1").count();
        let plate = match settings.plate {
            None if plates > 1 => return Err(BioWareError::WhichPlate { line, plates }),
            None => 0,
            Some(plate) if (1..=plates).contains(&plate) => plate - 1,
            Some(plate) => return Err(BioWareError::NoSuchPlate { line, plate, plates }),
        };
        let search = Search { line, names, below, has_unit_line, units: settings.units, plate };
        let time = search.names.iter().position(|(name, _)| is_time(name)).unwrap_or_default();
        let time = search.column(time, Dimension::Time)?;
        Ok(Columns { time, layout: search.layout(settings.plate.is_some())?, has_unit_line })
    }
}

struct Search<'a> {
    line: u64,
    names: Vec<(String, Option<&'a str>)>,
    below: &'a [&'a str],
    has_unit_line: bool,
    units: Units,
    plate: usize,
}

impl Search<'_> {
    fn layout(&self, chosen: bool) -> Result<Layout, BioWareError> {
        use Dimension::{Force, Length, Moment};
        let wrench =
            [("fx", Force), ("fy", Force), ("fz", Force), ("mx", Moment), ("my", Moment), ("mz", Moment)];
        let pressure = [("fx", Force), ("fy", Force), ("fz", Force), ("ax", Length), ("ay", Length)];
        let channels = ["fx12", "fx34", "fy14", "fy23", "fz1", "fz2", "fz3", "fz4"].map(|name| (name, Force));
        if let Some(columns) = self.all(wrench)? {
            return Ok(Layout::Wrench(columns));
        }
        if let Some(columns) = self.all(pressure)? {
            let free = self.all([("tz", Moment)])?.or(self.all([("mz'", Moment)])?);
            return Ok(Layout::Pressure(columns, free.map(|[column]| column)));
        }
        if let Some(columns) = self.all(channels)? {
            return Ok(Layout::Channels(columns));
        }
        let found: Vec<&str> =
            self.names.iter().map(|(name, _)| name.as_str()).filter(|name| !name.is_empty()).collect();
        let found = found.iter().take(40).copied().collect::<Vec<_>>().join(", ");
        Err(BioWareError::MissingColumns { line: self.line, found, of_plate: chosen })
    }

    /// These columns of the plate, if all exist.
    fn all<const N: usize>(
        &self,
        wanted: [(&str, Dimension); N],
    ) -> Result<Option<[Column; N]>, BioWareError> {
        let mut columns = [Column { index: 0, size: 0.0 }; N];
        for (column, (name, dimension)) in columns.iter_mut().zip(wanted) {
            let mut of_name = self.names.iter().enumerate().filter(|(_, (other, _))| other == name);
            let Some((index, _)) = of_name.nth(self.plate) else {
                return Ok(None);
            };
            *column = self.column(index, dimension)?;
        }
        Ok(Some(columns))
    }

    /// The column with its unit: after its name, below it, or declared; never guessed.
    fn column(&self, index: usize, dimension: Dimension) -> Result<Column, BioWareError> {
        let (name, in_brackets) = &self.names[index];
        let below = self.has_unit_line.then(|| self.below.get(index)).flatten().map(|cell| cell.trim());
        let unit_word = in_brackets
            .or(below)
            .map(|word| word.trim_matches(['(', ')', '[', ']', '"']))
            .filter(|word| !word.is_empty());
        let mut declared = self.units;
        let declared = *declared.slot(dimension);
        let size = match unit_word.map(|word| (word, unit(word))) {
            Some((_, Some((found, size)))) if found == dimension => size,
            Some((word, _)) if declared.is_none() => {
                let (line, column, unit) = (self.line, name.clone(), word.chars().take(40).collect());
                return Err(BioWareError::UnknownUnit { line, column, unit, of: dimension.name() });
            }
            _ => declared.ok_or_else(|| BioWareError::NoUnit {
                line: self.line,
                column: name.clone(),
                of: dimension.name(),
            })?,
        };
        Ok(Column { index, size })
    }
}
