//! Maps the columns of a CSV to quantities: by name, with the unit as suffix.

use equipoise_core::body::{SEGMENTS, Segment};

use super::csv::CsvError;

/// A unit suffix of a column's name, and its value in the internal unit.
struct Unit {
    suffix: &'static str,
    size: f64,
}

const TIME: &[Unit] = &[
    Unit { suffix: "_s", size: 1.0 },
    Unit { suffix: "_ms", size: 1e-3 },
    Unit { suffix: "_us", size: 1e-6 },
];
const LENGTH: &[Unit] = &[
    Unit { suffix: "_m", size: 1.0 },
    Unit { suffix: "_cm", size: 1e-2 },
    Unit { suffix: "_mm", size: 1e-3 },
];
const NONE: &[Unit] = &[Unit { suffix: "", size: 1.0 }];
const FORCE: &[Unit] = &[Unit { suffix: "_N", size: 1.0 }, Unit { suffix: "_kN", size: 1e3 }];
const MOMENT: &[Unit] = &[
    Unit { suffix: "_Nm", size: 1.0 },
    Unit { suffix: "_Nmm", size: 1e-3 },
    Unit { suffix: "_kNm", size: 1e3 },
];

/// Suffixes of a segment's columns in the standard layout.
const SEGMENT_COLUMNS: [&str; 7] = ["_px_m", "_py_m", "_pz_m", "_qw", "_qx", "_qy", "_qz"];
/// The other columns of the standard layout.
const PLAIN_COLUMNS: [&str; 7] = ["t_s", "Fx_N", "Fy_N", "Fz_N", "Mx_Nm", "My_Nm", "Mz_Nm"];

/// One number of a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Column {
    index: usize,
    unit_size: f64,
}

impl Column {
    /// The number in the internal unit; `None` if it is missing, not a number, or not finite.
    pub(super) fn of(self, row: &csv::StringRecord) -> Option<f64> {
        let number: f64 = row.get(self.index)?.parse().ok()?;
        let number = number * self.unit_size;
        number.is_finite().then_some(number)
    }
}

/// Column of each quantity.
#[derive(Debug)]
pub(super) struct Columns {
    pub(super) time_s: Column,
    pub(super) position_m: [[Column; 3]; SEGMENTS],
    pub(super) orientation_wxyz: [[Column; 4]; SEGMENTS],
    pub(super) force_n: [Column; 3],
    pub(super) moment_nm: [Column; 3],
}

impl Columns {
    /// Finds every column in the header line.
    ///
    /// # Errors
    /// [`CsvError::MissingColumn`] with the name of the first missing column and the most similar existing one.
    pub(super) fn find(head: &csv::StringRecord) -> Result<Columns, CsvError> {
        let nowhere = Column { index: usize::MAX, unit_size: f64::NAN };
        let mut position_m = [[nowhere; 3]; SEGMENTS];
        let mut orientation_wxyz = [[nowhere; 4]; SEGMENTS];
        for segment in Segment::ALL {
            for (slot, axis) in position_m[segment.index()].iter_mut().zip(["px", "py", "pz"]) {
                *slot = find(head, &format!("{}_{axis}", segment.name()), LENGTH)?;
            }
            for (slot, axis) in orientation_wxyz[segment.index()].iter_mut().zip(["qw", "qx", "qy", "qz"]) {
                *slot = find(head, &format!("{}_{axis}", segment.name()), NONE)?;
            }
        }
        Ok(Columns {
            time_s: find(head, "t", TIME)?,
            position_m,
            orientation_wxyz,
            force_n: [find(head, "Fx", FORCE)?, find(head, "Fy", FORCE)?, find(head, "Fz", FORCE)?],
            moment_nm: [find(head, "Mx", MOMENT)?, find(head, "My", MOMENT)?, find(head, "Mz", MOMENT)?],
        })
    }
}

fn find(head: &csv::StringRecord, stem: &str, units: &[Unit]) -> Result<Column, CsvError> {
    for (index, name) in head.iter().enumerate() {
        let suffix = name.trim().strip_prefix(stem);
        if let Some(unit) = units.iter().find(|unit| suffix == Some(unit.suffix)) {
            return Ok(Column { index, unit_size: unit.size });
        }
    }
    let missing = format!("{stem}{}", units[0].suffix);
    // A column that belongs to another quantity is excluded, however similar (`_qw` for `_qx`).
    let free = head.iter().filter(|name| !name.trim().is_empty() && !is_taken(name.trim()));
    let nearest = free.min_by_key(|name| distance(name, &missing)).unwrap_or("none").to_owned();
    Err(CsvError::MissingColumn { missing, nearest })
}

/// Whether a name belongs to the standard layout.
fn is_taken(name: &str) -> bool {
    let of_segment = Segment::ALL.into_iter().any(|segment| {
        let axis = name.strip_prefix(segment.name());
        axis.is_some_and(|axis| SEGMENT_COLUMNS.contains(&axis))
    });
    of_segment || PLAIN_COLUMNS.contains(&name)
}

/// Edit distance (Levenshtein), not case-sensitive.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<u8> = b.bytes().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.bytes().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, to) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(!from.eq_ignore_ascii_case(to));
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_is_the_one_meant() {
        assert_eq!(distance("kitten", "sitting"), 3);
        assert_eq!(distance("PELVIS_QW", "Pelvis_qw"), 0);
        let head = csv::StringRecord::from(vec!["time_s", "Fz_kN", "Fz_lbf"]);
        let fz = find(&head, "Fz", FORCE).unwrap();
        assert_eq!(fz.of(&csv::StringRecord::from(vec!["0", "0.7", "1"])), Some(700.0));
        let error = find(&head, "t", TIME).unwrap_err().to_string();
        assert!(error.contains("t_s") && error.contains("time_s"), "{error}");
    }
}
