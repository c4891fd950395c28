//! Columns of a table as a Parquet file.

use std::io::{self, Write};
use std::sync::Arc;

use parquet::basic::{Compression, ConvertedType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

/// Rows of a group.
const GROUP_ROWS: usize = 1 << 18;

/// The values of a column, by row.
pub(super) enum Cells<'a> {
    Flag(Box<dyn Fn(usize) -> bool + 'a>),
    Whole(Box<dyn Fn(usize) -> i64 + 'a>),
    Real(Box<dyn Fn(usize) -> f64 + 'a>),
    Text(Box<dyn Fn(usize) -> &'a str + 'a>),
}

/// Writes `rows` rows of columns with their names.
pub(super) fn write_columns(out: impl Write + Send, rows: usize, columns: &[(&str, Cells<'_>)]) -> io::Result<()> {
    write(out, rows, columns).map_err(|error| match error {
        ParquetError::External(source) => match source.downcast::<io::Error>() {
            Ok(error) => *error,
            Err(other) => io::Error::other(other),
        },
        other => io::Error::other(other),
    })
}

fn write(out: impl Write + Send, rows: usize, columns: &[(&str, Cells<'_>)]) -> Result<(), ParquetError> {
    let fields = columns.iter().map(|(name, cells)| {
        let (physical, converted) = match cells {
            Cells::Flag(_) => (Physical::BOOLEAN, ConvertedType::NONE),
            Cells::Whole(_) => (Physical::INT64, ConvertedType::NONE),
            Cells::Real(_) => (Physical::DOUBLE, ConvertedType::NONE),
            Cells::Text(_) => (Physical::BYTE_ARRAY, ConvertedType::UTF8),
        };
        let field = Type::primitive_type_builder(name, physical).with_converted_type(converted);
        field.with_repetition(Repetition::REQUIRED).build().map(Arc::new)
    });
    let fields = fields.collect::<Result<Vec<_>, _>>()?;
    let schema = Arc::new(Type::group_type_builder("tracks").with_fields(fields).build()?);
    let properties = Arc::new(WriterProperties::builder().set_compression(Compression::SNAPPY).build());
    let mut file = SerializedFileWriter::new(out, schema, properties)?;
    for start in (0..rows).step_by(GROUP_ROWS) {
        let part = start..rows.min(start + GROUP_ROWS);
        let mut group = file.next_row_group()?;
        for (_, cells) in columns {
            let Some(mut column) = group.next_column()? else { break };
            match cells {
                Cells::Flag(of) => {
                    let values: Vec<bool> = part.clone().map(of).collect();
                    column.typed::<BoolType>().write_batch(&values, None, None)?;
                }
                Cells::Whole(of) => {
                    let values: Vec<i64> = part.clone().map(of).collect();
                    column.typed::<Int64Type>().write_batch(&values, None, None)?;
                }
                Cells::Real(of) => {
                    let values: Vec<f64> = part.clone().map(of).collect();
                    column.typed::<DoubleType>().write_batch(&values, None, None)?;
                }
                Cells::Text(of) => {
                    let values: Vec<ByteArray> = part.clone().map(|row| ByteArray::from(of(row))).collect();
                    column.typed::<ByteArrayType>().write_batch(&values, None, None)?;
                }
            }
            column.close()?;
        }
        group.close()?;
    }
    file.close()?;
    Ok(())
}
