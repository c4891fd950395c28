//! Parquet files as other programs write them.

use std::path::Path;
use std::sync::Arc;

use parquet::basic::Compression;
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, FloatType, Int64Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;

/// A column: its type and name in a schema, and its values.
#[derive(Clone)]
pub(super) enum Column {
    Double(Vec<f64>),
    Single(Vec<f32>),
    Long(Vec<i64>),
    /// Moments in us.
    Moment(Vec<i64>),
    Flag(Vec<bool>),
    Text(Vec<String>),
}

impl Column {
    fn declared(&self, name: &str) -> String {
        match self {
            Self::Double(_) => format!("required double {name};"),
            Self::Single(_) => format!("required float {name};"),
            Self::Long(_) => format!("required int64 {name};"),
            Self::Moment(_) => format!("required int64 {name} (TIMESTAMP(MICROS,true));"),
            Self::Flag(_) => format!("required boolean {name};"),
            Self::Text(_) => format!("required binary {name} (STRING);"),
        }
    }

    fn len(&self) -> usize {
        match self {
            Self::Double(v) => v.len(),
            Self::Single(v) => v.len(),
            Self::Long(v) | Self::Moment(v) => v.len(),
            Self::Flag(v) => v.len(),
            Self::Text(v) => v.len(),
        }
    }
}

/// Writes columns of one length, `group` rows at a time, packed as pandas does.
pub(super) fn write(file: &Path, columns: &[(&str, Column)], group: usize) {
    let declared: String = columns.iter().map(|(name, column)| column.declared(name)).collect();
    let schema = Arc::new(parse_message_type(&format!("message schema {{ {declared} }}")).unwrap());
    let properties = Arc::new(WriterProperties::builder().set_compression(Compression::SNAPPY).build());
    let mut writer = SerializedFileWriter::new(std::fs::File::create(file).unwrap(), schema, properties).unwrap();
    let rows = columns[0].1.len();
    for start in (0..rows).step_by(group) {
        let rows = start..rows.min(start + group);
        let mut group = writer.next_row_group().unwrap();
        for (_, column) in columns {
            let mut next = group.next_column().unwrap().unwrap();
            match column {
                Column::Double(v) => next.typed::<DoubleType>().write_batch(&v[rows.clone()], None, None),
                Column::Single(v) => next.typed::<FloatType>().write_batch(&v[rows.clone()], None, None),
                Column::Long(v) | Column::Moment(v) => {
                    next.typed::<Int64Type>().write_batch(&v[rows.clone()], None, None)
                }
                Column::Flag(v) => next.typed::<BoolType>().write_batch(&v[rows.clone()], None, None),
                Column::Text(v) => {
                    let text: Vec<ByteArray> = v[rows.clone()].iter().map(|text| text.as_str().into()).collect();
                    next.typed::<ByteArrayType>().write_batch(&text, None, None)
                }
            }
            .unwrap();
            next.close().unwrap();
        }
        group.close().unwrap();
    }
    writer.close().unwrap();
}
