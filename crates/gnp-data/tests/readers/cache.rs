//! A recording kept in a file comes back whole, or not at all.

use gnp_data::{DataError, Dataset, Recording};

use super::{fixtures, read_all};

fn recording() -> Recording {
    read_all(&fixtures("ngsim").join("us101-10_1.csv.gz"), Dataset::NGSIM).unwrap().remove(0).0
}

#[test]
fn comes_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("kept.gnprec");
    let before = recording();
    before.save(&file).unwrap();
    let after = Recording::load(&file).unwrap();
    assert_eq!(after.meta(), before.meta());
    assert_eq!(after.roads(), before.roads());
    assert_eq!(after.tracks(), before.tracks());
    assert_eq!(after.columns(), before.columns());
    let frame = before.tracks()[0].first_frame;
    assert_eq!(after.present(frame), before.present(frame));
    // Saved again, the bytes are the same, and nothing else is left in the folder.
    let bytes = std::fs::read(&file).unwrap();
    after.save(&file).unwrap();
    assert_eq!(std::fs::read(&file).unwrap(), bytes);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn takes_less_than_the_text_it_came_from() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("kept.gnprec");
    let recording = recording();
    recording.save(&file).unwrap();
    // The file's text has 268,680 bytes.
    let kept = std::fs::metadata(&file).unwrap().len();
    assert!(kept < 268_680 * 3 / 4, "{kept} bytes");
}

#[test]
fn a_foreign_truncated_or_changed_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("kept.gnprec");
    recording().save(&file).unwrap();
    let whole = std::fs::read(&file).unwrap();
    let mut changed = whole.clone();
    changed[whole.len() / 2] ^= 1;
    let mut newer = whole.clone();
    newer[8] = 9;
    let cases: [(&str, &[u8], &str); 6] = [
        ("foreign", b"PK\x03\x04 a zip file, say, longer than the prefix of a recording", "not a recording"),
        ("empty", b"", "not a recording"),
        ("only the prefix", &whole[..20], "truncated"),
        ("truncated", &whole[..whole.len() - 7], "truncated or changed"),
        ("changed", &changed, "truncated or changed"),
        ("newer", &newer, "version 9"),
    ];
    for (what, bytes, says) in cases {
        std::fs::write(&file, bytes).unwrap();
        let error = Recording::load(&file).unwrap_err();
        assert!(matches!(error, DataError::Cache { .. }), "{what}: {error}");
        let message = error.to_string();
        assert!(message.contains(says) && message.contains("kept.gnprec"), "{what}: {message}");
    }
    assert!(matches!(Recording::load(&folder.path().join("absent")), Err(DataError::Io { .. })));
}

#[test]
fn one_kept_recording_is_told_from_another_by_its_head() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("kept.gnprec");
    recording().save(&file).unwrap();
    let seal = Recording::seal(&file).unwrap();
    let bytes = std::fs::read(&file).unwrap();
    assert_eq!(seal.bytes, bytes.len() as u64);
    assert_eq!(seal.sha256, gnp_file::sha256([&bytes[44..]]));
    std::fs::write(&file, &bytes[..30]).unwrap();
    assert!(matches!(Recording::seal(&file), Err(DataError::Cache { .. })));
    assert!(matches!(Recording::seal(&folder.path().join("absent")), Err(DataError::Io { .. })));
}
