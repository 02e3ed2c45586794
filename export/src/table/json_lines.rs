//! JSON lines writer: an object per row with the column names as keys; an invalid value has no key.

use std::fs::File;
use std::io::{BufWriter, Write};

use anyhow::Context;

use super::Sink;
use super::columns::{Column, Row, Value};

/// JSON lines being written.
pub(super) struct Table {
    file: BufWriter<File>,
    /// Keys in the form `"name":`.
    keys: Vec<String>,
    line: Vec<u8>,
}

impl Table {
    /// Prepares the keys.
    pub(super) fn begin(file: File, columns: &[Column]) -> Table {
        let keys = columns.iter().map(|column| format!("\"{}\":", column.name)).collect();
        Table { file: BufWriter::new(file), keys, line: Vec::new() }
    }
}

impl Sink for Table {
    fn write(&mut self, row: &Row) -> anyhow::Result<()> {
        self.line.clear();
        for (key, value) in self.keys.iter().zip(&row.0) {
            let Some(value) = value else { continue };
            self.line.push(if self.line.is_empty() { b'{' } else { b',' });
            self.line.extend(key.as_bytes());
            match value {
                Value::F64(value) => serde_json::to_writer(&mut self.line, value)?,
                Value::U64(value) => serde_json::to_writer(&mut self.line, value)?,
                Value::U32(value) => serde_json::to_writer(&mut self.line, value)?,
                Value::Text(text) => serde_json::to_writer(&mut self.line, text)?,
            }
        }
        // The time is always valid, so a line is never empty.
        self.line.extend(b"}\n");
        self.file.write_all(&self.line).context("cannot write the table")
    }

    fn finish(&mut self) -> anyhow::Result<()> {
        self.file.flush().context("cannot write the table")
    }
}
