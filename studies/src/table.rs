//! Tables as aligned text for people, and as JSON for programs.

use std::fmt;

use serde_json::{Map, Value, json};

/// One cell.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// A word.
    Text(String),
    /// A count.
    Count(u64),
    /// A measured number: shown to three significant digits.
    Number(f64),
    /// No value.
    Nothing,
}

impl From<&str> for Cell {
    fn from(text: &str) -> Cell {
        Cell::Text(text.into())
    }
}

impl From<Option<f64>> for Cell {
    fn from(number: Option<f64>) -> Cell {
        number.map_or(Cell::Nothing, Cell::Number)
    }
}

impl From<f64> for Cell {
    fn from(number: f64) -> Cell {
        Cell::Number(number)
    }
}

impl From<u64> for Cell {
    fn from(count: u64) -> Cell {
        Cell::Count(count)
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Cell::Text(text) => f.pad(text),
            Cell::Count(count) => f.pad(&count.to_string()),
            Cell::Number(number) => f.pad(&three_digits(*number)),
            Cell::Nothing => f.pad("-"),
        }
    }
}

/// Three significant digits without an exponent.
fn three_digits(number: f64) -> String {
    if number.abs() < 1e-9 {
        return "0".into();
    }
    let whole_digits = number.abs().log10().floor() as i32 + 1;
    format!("{number:.*}", (3 - whole_digits).clamp(0, 5) as usize)
}

/// A table with its title, and the definitions of its measures.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    title: String,
    columns: Vec<&'static str>,
    rows: Vec<Vec<Cell>>,
    notes: Vec<String>,
}

impl Table {
    /// An empty table; the columns' names contain the units.
    ///
    /// # Panics
    /// If two columns have one name: in JSON one would overwrite the other.
    pub fn new(title: impl Into<String>, columns: &[&'static str]) -> Table {
        for (index, column) in columns.iter().enumerate() {
            assert!(!columns[..index].contains(column), "two columns are called {column}");
        }
        Table { title: title.into(), columns: columns.to_vec(), rows: Vec::new(), notes: Vec::new() }
    }

    /// Adds a row: one cell for each column.
    pub fn push(&mut self, row: Vec<Cell>) {
        debug_assert_eq!(row.len(), self.columns.len(), "{}", self.title);
        self.rows.push(row);
    }

    /// Adds the definition of a measure.
    pub fn note(&mut self, note: impl Into<String>) {
        self.notes.push(note.into());
    }

    /// The rows so far.
    pub fn rows(&self) -> &[Vec<Cell>] {
        &self.rows
    }

    /// The table for programs: one object per row, keyed by column; missing values are absent.
    pub fn json(&self) -> Value {
        let rows = self.rows.iter().map(|row| {
            let mut object = Map::new();
            for (column, cell) in self.columns.iter().zip(row) {
                let value = match cell {
                    Cell::Text(text) => json!(text),
                    Cell::Count(count) => json!(count),
                    Cell::Number(number) => json!(number),
                    Cell::Nothing => continue,
                };
                object.insert((*column).into(), value);
            }
            Value::Object(object)
        });
        json!({ "title": self.title, "rows": rows.collect::<Vec<_>>(), "notes": self.notes })
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is_text =
            |column: usize| matches!(self.rows.first().map(|row| &row[column]), Some(Cell::Text(_)));
        let width = |column: usize| {
            let cells = self.rows.iter().map(|row| row[column].to_string().chars().count());
            cells.chain([self.columns[column].chars().count()]).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        writeln!(f, "{}", self.title)?;
        let heads: Vec<Cell> = self.columns.iter().map(|column| Cell::from(*column)).collect();
        for row in [&heads].into_iter().chain(&self.rows) {
            let mut line = String::from(" ");
            for (column, (cell, width)) in row.iter().zip(&widths).enumerate() {
                if is_text(column) {
                    line += &format!(" {cell:<width$} ");
                } else {
                    line += &format!(" {cell:>width$} ");
                }
            }
            writeln!(f, "{}", line.trim_end())?;
        }
        for note in &self.notes {
            writeln!(f, "  * {note}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits_that_count() {
        let shown = [0.001_234_5, 0.123_45, 1.234_5, 12.345, 123.45, 1234.5, -2.0, 0.0].map(three_digits);
        assert_eq!(shown, ["0.00123", "0.123", "1.23", "12.3", "123", "1234", "-2.00", "0"]);
    }

    #[test]
    #[should_panic(expected = "two columns")]
    fn a_name_stands_once() {
        let _ = Table::new("title", &["error mm", "true mm", "error mm"]);
    }

    #[test]
    fn columns_stand_under_their_heads_and_the_unknown_is_absent() {
        let mut table = Table::new("title", &["what", "error mm"]);
        table.push(vec!["hip".into(), 1.5.into()]);
        table.push(vec!["a long name".into(), None.into()]);
        table.note("error: of something");
        let text = table.to_string();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[1].find("error mm").unwrap() + 8, lines[2].len());
        assert_eq!(lines[3].chars().last(), Some('-'));
        assert_eq!(table.json()["rows"][1].as_object().unwrap().len(), 1);
    }
}
