//! Every layout of NGSIM gives the same recording, whatever the file is called.

use gnp_data::{Columns, Dataset, Recording, discover};

use super::ngsim::{HEADER, csv, rows};
use super::{gzip, put, read_all};

fn columns(recording: &Recording) -> &Columns {
    recording.columns()
}

#[test]
fn every_layout_gives_the_same_recording() {
    let rows = rows(&[(3, 1, 20.), (5, 2, 45.5), (9, 2, 300.)], 4..44);
    let fields: Vec<Vec<String>> = rows.iter().map(|row| row.fields()).collect();
    let lines = |separator: &str| fields.iter().map(|f| f.join(separator)).collect::<Vec<_>>().join("\n");
    let quoted = |f: &Vec<String>| {
        let mut f = f.clone();
        f[3] = "\"1,118,846,97".to_owned() + &f[3][9..10] + "," + &f[3][10..] + "\"";
        f[6] = "\"6,451,137.641\"".into();
        f.join(",")
    };
    let texts = [
        ("with header", csv(&rows)),
        ("without header", lines(",")),
        ("no newline at the end", csv(&rows).trim_end().to_owned()),
        ("other case of names", csv(&rows).replace("v_Length", "v_length").replace("Vehicle_ID", "VEHICLE_ID")),
        ("windows line ends", csv(&rows).replace('\n', "\r\n")),
        ("byte order mark", format!("\u{feff}{}", csv(&rows))),
        ("blank lines", csv(&rows).replace("\n5,", "\n\n5,") + "\n\n"),
        ("blanks", format!("  {}\n", lines("   ").replace('\n', "  \n  "))),
        ("tabs", lines("\t")),
        ("blanks with header", format!("{}\n{}", HEADER.replace(',', " "), lines("  "))),
        ("whole numbers as 5.0", csv(&rows).replace("\n5,", "\n5.0,")),
        ("thousands in quotes", format!("{HEADER}\n{}\n", fields.iter().map(quoted).collect::<Vec<_>>().join("\n"))),
    ];
    let folder = tempfile::tempdir().unwrap();
    let mut first: Option<Columns> = None;
    for (what, text) in &texts {
        for packed in [false, true] {
            let name = if packed { "any.txt.gz" } else { "any.csv" };
            let file = folder.path().join(name);
            if packed {
                std::fs::write(&file, gzip(text)).unwrap();
            } else {
                std::fs::write(&file, text).unwrap();
            }
            let all = read_all(&file, Dataset::NGSIM).unwrap_or_else(|e| panic!("{what}: {e}"));
            let [(recording, quality)] = &all[..] else { panic!("{what}: one recording") };
            assert_eq!((quality.rows_read, quality.vehicles), (120, 3), "{what}");
            let first = first.get_or_insert_with(|| columns(recording).clone());
            assert_eq!(columns(recording), first, "{what}, packed {packed}");
        }
    }
}

#[test]
fn a_folder_is_searched_to_the_bottom_and_named_for_uniqueness() {
    let folder = tempfile::tempdir().unwrap();
    let text = csv(&rows(&[(3, 1, 20.)], 0..5));
    put(folder.path(), "us-101/0750am-0805am/trajectories.csv", &text);
    put(folder.path(), "us-101/0805am-0820am/trajectories.csv", &text);
    put(folder.path(), "i-80/trajectories-0400-0415.csv", &text);
    put(folder.path(), "i-80/trajectories-0400-0415.txt", &text);
    put(folder.path(), "README.txt", "Vehicle trajectories of two motorways\n");
    put(folder.path(), "notes.csv", "day,weather\n1,sun\n");
    let sources = discover(folder.path(), Dataset::NGSIM).unwrap();
    let found: Vec<(&str, Option<&str>)> = sources.iter().map(|s| (s.name.as_str(), s.site.as_deref())).collect();
    assert_eq!(
        found,
        [
            ("trajectories-0400-0415", Some("i-80")),
            ("us-101-0750am-0805am-trajectories", Some("us-101")),
            ("us-101-0805am-0820am-trajectories", Some("us-101")),
        ]
    );
    assert!(sources[0].notes[0].contains("trajectories-0400-0415.txt"), "{:?}", sources[0].notes);
    assert!(sources[1].notes.is_empty());
}

#[test]
fn a_marker_in_a_folder_above_makes_recordings_simulated() {
    let folder = tempfile::tempdir().unwrap();
    let text = csv(&rows(&[(3, 1, 20.)], 0..5));
    put(folder.path(), "real/a.csv", &text);
    put(folder.path(), "made/SIMULATED", "by a simulator\n");
    let made = put(folder.path(), "made/deep/b.csv", &text);
    let all = read_all(folder.path(), Dataset::NGSIM).unwrap();
    let marks: Vec<(bool, bool)> = all.iter().map(|(r, q)| (r.meta().simulated, q.simulated)).collect();
    assert_eq!(marks, [(false, false), (true, true)]);
    assert!(read_all(&made, Dataset::NGSIM).unwrap()[0].1.simulated, "a single file looks above itself as well");
}
