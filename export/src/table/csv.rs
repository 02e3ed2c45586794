//! CSV writer, RFC 4180 with line feeds: column names first; an empty field is an invalid value.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write};

use anyhow::Context;

use super::Sink;
use super::columns::{Column, Row, Value};

/// A CSV table being written.
pub(super) struct Table {
    file: BufWriter<File>,
    line: String,
}

impl Table {
    /// Writes the header line.
    pub(super) fn begin(file: File, columns: &[Column]) -> anyhow::Result<Table> {
        let mut file = BufWriter::new(file);
        let names: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
        writeln!(file, "{}", names.join(",")).context("cannot write the table")?;
        Ok(Table { file, line: String::new() })
    }
}

impl Sink for Table {
    fn write(&mut self, row: &Row) -> anyhow::Result<()> {
        self.line.clear();
        for (index, value) in row.0.iter().enumerate() {
            if index > 0 {
                self.line.push(',');
            }
            // No quoting: names contain neither comma nor quote. Numbers are written so that they parse back to the
            // same bits.
            match value {
                Some(Value::F64(value)) => write!(self.line, "{value}")?,
                Some(Value::U64(value)) => write!(self.line, "{value}")?,
                Some(Value::U32(value)) => write!(self.line, "{value}")?,
                Some(Value::Text(text)) => self.line.push_str(text),
                None => {}
            }
        }
        self.line.push('\n');
        self.file.write_all(self.line.as_bytes()).context("cannot write the table")
    }

    fn finish(&mut self) -> anyhow::Result<()> {
        self.file.flush().context("cannot write the table")
    }
}
