//! Text that is almost a table: blanks, commas, NUL bytes, endless lines, floods. Each has a line in its message.

use gnp_data::{DataError, Dataset, IngestReport, Recording};

use super::ngsim::{HEADER, csv, rows};
use super::{gzip, put, read_all};

fn read(text: &str) -> Result<Vec<(Recording, IngestReport)>, DataError> {
    let folder = tempfile::tempdir().unwrap();
    let file = put(folder.path(), "a.csv", text);
    read_all(&file, Dataset::NGSIM)
}

fn good() -> String {
    csv(&rows(&[(1, 1, 0.), (2, 2, 300.), (3, 3, 600.)], 0..10))
}

/// The text with a field of line 17 changed.
fn with(column: usize, change: impl Fn(&str) -> String) -> String {
    let mut lines: Vec<String> = good().lines().map(str::to_owned).collect();
    let mut fields: Vec<String> = lines[16].split(',').map(str::to_owned).collect();
    fields[column] = change(&fields[column]);
    lines[16] = fields.join(",");
    lines.join("\n") + "\n"
}

#[test]
fn blanks_around_values_do_not_matter() {
    let expected = read(&good()).unwrap();
    let spread = good().lines().map(|line| line.replace(',', " ,\t ")).collect::<Vec<_>>().join("\n");
    let quoted = with(4, |value| format!("\" {value} \""));
    for text in [with(4, |value| format!(" {value} ")), with(0, |value| format!(" {value}")), spread, quoted] {
        let found = read(&text).unwrap();
        assert_eq!(found[0].0.columns(), expected[0].0.columns());
    }
}

#[test]
fn a_value_that_only_looks_like_a_number_has_its_line_and_column() {
    for value in ["12 .5", "\u{a0}12.5", "1_000", "0x1F", "12,5", "--3", "1e", "١٢"] {
        // A comma makes another field unless it is quoted.
        let quoted = if value.contains(',') { format!("\"{value}\"") } else { value.to_owned() };
        let error = read(&with(4, |_| quoted.clone())).unwrap_err();
        assert!(matches!(&error, DataError::Value { line: 17, column, .. } if column == "Local_X"), "{value}: {error}");
    }
    assert!(read(&with(4, |_| "\"12,5\"".to_owned())).unwrap_err().to_string().contains("point before decimals"));
}

#[test]
fn bytes_that_are_no_text_have_their_line() {
    let error = read(&with(6, |_| "12\0".to_owned())).unwrap_err().to_string();
    assert!(error.contains("line 17") && error.contains("NUL"), "{error}");
    // Behind the first bytes that a file is told by.
    let long = csv(&rows(&[(1, 1, 0.), (2, 2, 300.)], 0..900));
    let error = read(&format!("{long}1,2\0\n")).unwrap_err().to_string();
    assert!(error.contains("line 1802") && error.contains("NUL"), "{error}");
}

#[test]
fn an_endless_line_has_its_number() {
    let long = csv(&rows(&[(1, 1, 0.), (2, 2, 300.)], 0..900));
    for flood in ["1".repeat(70_000), "1,".repeat(35_000)] {
        let error = read(&format!("{long}{flood}\n{}", "1,2\n".repeat(9))).unwrap_err().to_string();
        assert!(error.contains("line 1802") && error.contains("64 KiB"), "{error}");
    }
}

#[test]
fn columns_and_words_are_bounded() {
    let many = format!("{HEADER},{}\n", (0..2000).map(|i| format!("c{i}")).collect::<Vec<_>>().join(","));
    let error = read(&format!("{many}1,2\n")).unwrap_err().to_string();
    assert!(error.contains("2018 columns"), "{error}");

    let sites = |count: usize| {
        let fields: Vec<String> = rows(&[(1, 1, 0.)], 0..600)
            .iter()
            .enumerate()
            .map(|(i, row)| {
                let site = if i % 2 == 0 { "us-101".to_owned() } else { format!("street {}", i / 2 % count) };
                format!("{},{site}", row.fields().join(","))
            })
            .collect();
        read(&format!("{HEADER},Location\n{}\n", fields.join("\n")))
    };
    // Of 257 words the last comes in row 2 * 255 + 1, from 0.
    let error = sites(300).unwrap_err();
    assert!(matches!(&error, DataError::Value { line: 513, column, .. } if column == "Location"), "{error}");
    assert!(!matches!(sites(200).unwrap_err(), DataError::Value { .. }), "every second frame is missing, no more");
}

#[test]
fn a_flood_out_of_a_little_gzip_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.csv.gz");
    let row = rows(&[(1, 1, 0.)], 0..1)[0].fields().join(",") + "\n";
    // Forty million bytes.
    let refused = |flood: &str| {
        std::fs::write(&file, gzip(flood)).unwrap();
        read_all(&file, Dataset::NGSIM).unwrap_err()
    };
    let error = refused(&"\0".repeat(40_000_000));
    assert!(matches!(error, DataError::Inflated { .. } | DataError::Foreign { .. }), "{error}");
    // A table that would have been read.
    let error = refused(&format!("{HEADER}\n{}", row.repeat(40_000_000 / row.len())));
    assert!(matches!(error, DataError::Inflated { .. }), "{error}");
}
