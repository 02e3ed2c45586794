//! Rows as an Apache Parquet file: a column each, null where a value must not be used; what it is stands in the footer.

use std::fs::File;
use std::io::BufWriter;
use std::sync::Arc;

use anyhow::Context;
use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int32Type, Int64Type};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::Type;

use super::Sink;
use super::columns::{Column, Kind, Row, Value};

/// Rows of a group, which is kept in memory until it is full: about 20 MB of states.
const GROUP_ROWS: usize = 8192;
/// An optional value that is there.
const THERE: i16 = 1;

/// A table being written.
pub(super) struct Table {
    writer: SerializedFileWriter<BufWriter<File>>,
    columns: Vec<Values>,
    rows: usize,
}

/// The values of a column that are there, and which are.
struct Values {
    there: Vec<i16>,
    values: Typed,
}

enum Typed {
    F64(Vec<f64>),
    U64(Vec<i64>),
    U32(Vec<i32>),
    Text(Vec<ByteArray>),
}

impl Table {
    /// Begins a file; `metadata` goes into its footer.
    pub(super) fn begin(
        file: File,
        columns: &[Column],
        metadata: Vec<(String, String)>,
    ) -> anyhow::Result<Table> {
        let fields = columns.iter().map(|column| Ok(Arc::new(field(column)?)));
        let fields: anyhow::Result<Vec<_>> = fields.collect();
        let schema = Type::group_type_builder("equipoise").with_fields(fields?).build()?;
        let metadata = metadata.into_iter().map(|(key, value)| KeyValue::new(key, value)).collect();
        let properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .set_key_value_metadata(Some(metadata))
            .set_created_by(concat!("Equipoise ", env!("CARGO_PKG_VERSION")).to_owned())
            .build();
        let file = BufWriter::new(file);
        let writer = SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties))?;
        let columns = columns.iter().map(|column| Values::of(column.kind)).collect();
        Ok(Table { writer, columns, rows: 0 })
    }

    fn write_group(&mut self) -> anyhow::Result<()> {
        if self.rows == 0 {
            return Ok(());
        }
        self.rows = 0;
        let mut group = self.writer.next_row_group()?;
        for values in &mut self.columns {
            let mut column = group.next_column()?.context("a column is missing")?;
            values.write(&mut column)?;
            column.close()?;
        }
        group.close().context("cannot write the table")?;
        Ok(())
    }
}

impl Sink for Table {
    fn write(&mut self, row: &Row) -> anyhow::Result<()> {
        for (values, value) in self.columns.iter_mut().zip(&row.0) {
            values.push(value.as_ref());
        }
        self.rows += 1;
        if self.rows == GROUP_ROWS { self.write_group() } else { Ok(()) }
    }

    fn finish(&mut self) -> anyhow::Result<()> {
        self.write_group()?;
        self.writer.finish().context("cannot write the table")?;
        Ok(())
    }
}

fn field(column: &Column) -> anyhow::Result<Type> {
    let (physical, logical) = match column.kind {
        Kind::F64 => (Physical::DOUBLE, None),
        Kind::U64 => (Physical::INT64, Some(LogicalType::integer(64, false))),
        Kind::U32 => (Physical::INT32, Some(LogicalType::integer(32, false))),
        Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
    };
    let field = Type::primitive_type_builder(&column.name, physical)
        .with_repetition(Repetition::OPTIONAL)
        .with_logical_type(logical)
        .build()?;
    Ok(field)
}

impl Values {
    fn of(kind: Kind) -> Values {
        let values = match kind {
            Kind::F64 => Typed::F64(Vec::new()),
            Kind::U64 => Typed::U64(Vec::new()),
            Kind::U32 => Typed::U32(Vec::new()),
            Kind::Text => Typed::Text(Vec::new()),
        };
        Values { there: Vec::new(), values }
    }

    fn push(&mut self, value: Option<&Value>) {
        self.there.push(if value.is_some() { THERE } else { 0 });
        // Parquet stores unsigned numbers as signed ones with the same bits; the schema marks them as unsigned.
        match (&mut self.values, value) {
            (Typed::F64(values), Some(Value::F64(value))) => values.push(*value),
            (Typed::U64(values), Some(Value::U64(value))) => values.push(value.cast_signed()),
            (Typed::U32(values), Some(Value::U32(value))) => values.push(value.cast_signed()),
            (Typed::Text(values), Some(Value::Text(text))) => values.push(text.as_str().into()),
            // Unreachable: rows are built for these columns.
            (_, _) => {}
        }
    }

    /// Writes them and begins again.
    fn write(&mut self, column: &mut SerializedColumnWriter<'_>) -> anyhow::Result<()> {
        let there = Some(self.there.as_slice());
        match &mut self.values {
            Typed::F64(values) => {
                column.typed::<DoubleType>().write_batch(values, there, None)?;
                values.clear();
            }
            Typed::U64(values) => {
                column.typed::<Int64Type>().write_batch(values, there, None)?;
                values.clear();
            }
            Typed::U32(values) => {
                column.typed::<Int32Type>().write_batch(values, there, None)?;
                values.clear();
            }
            Typed::Text(values) => {
                column.typed::<ByteArrayType>().write_batch(values, there, None)?;
                values.clear();
            }
        }
        self.there.clear();
        Ok(())
    }
}
