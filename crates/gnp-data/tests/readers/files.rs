//! What else lies in a folder: links, pipes, files of other kinds. It is named, and never opened where that may hang.

use std::path::{Path, PathBuf};

use gnp_data::{DataError, Dataset, Discovery, FORMATS, search};

use super::highd::scene;
use super::ngsim::{csv, rows};
use super::{gzip, put, read_all};

fn good() -> String {
    csv(&rows(&[(1, 1, 0.), (2, 2, 300.)], 0..10))
}

fn found(path: &Path, dataset: Dataset) -> Result<Discovery, DataError> {
    search(path, *FORMATS.iter().find(|format| format.dataset() == dataset).unwrap())
}

/// Files that are not read, without the folder, and what is said of them.
fn not_read(discovery: &Discovery, folder: &Path) -> Vec<(PathBuf, String)> {
    let of = |it: &gnp_data::NotRead| (it.file.strip_prefix(folder).unwrap().to_owned(), it.what.clone());
    discovery.not_read.iter().map(of).collect()
}

#[cfg(unix)]
#[test]
fn what_links_lead_to_is_read_once() {
    use std::os::unix::fs::symlink;

    let folder = tempfile::tempdir().unwrap();
    let (root, elsewhere) = (folder.path().join("data"), folder.path().join("elsewhere"));
    put(&root, "deep/x.csv", &good());
    put(&elsewhere, "made/y.csv", &good());
    put(&elsewhere, "SIMULATED", "");
    symlink(".", root.join("deep/loop")).unwrap();
    symlink(&root, root.join("above")).unwrap();
    symlink("deep/x.csv", root.join("again.csv")).unwrap();
    symlink("gone.csv", root.join("broken.csv")).unwrap();
    symlink("round", root.join("round")).unwrap();
    symlink(elsewhere.join("made"), root.join("linked")).unwrap();
    symlink(elsewhere.join("made/y.csv"), root.join("y.csv")).unwrap();
    let found = found(&root, Dataset::NGSIM).unwrap();
    let sources: Vec<_> = found.sources.iter().map(|it| (it.name.as_str(), it.files.len(), it.simulated)).collect();
    assert_eq!(sources, [("x", 1, false), ("y", 1, true)]);
    let said = not_read(&found, &root);
    let of = |name: &str| said.iter().find(|(file, _)| file == Path::new(name)).map_or("", |(_, what)| what);
    for name in ["above", "again.csv", "deep/loop", "y.csv"] {
        assert!(of(name).contains("met already"), "{name}: {said:?}");
    }
    for name in ["broken.csv", "round"] {
        assert!(of(name).contains("link to nothing"), "{name}: {said:?}");
    }
    assert_eq!(said.len(), 6);
    // A link that is asked for is read.
    assert_eq!(read_all(&root.join("again.csv"), Dataset::NGSIM).unwrap().len(), 1);
}

#[cfg(unix)]
#[test]
fn a_pipe_or_socket_is_named_and_not_opened() {
    let folder = tempfile::tempdir().unwrap();
    put(folder.path(), "a.csv", &good());
    let pipe = folder.path().join("pipe.csv");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let _socket = std::os::unix::net::UnixListener::bind(folder.path().join("socket.csv")).unwrap();
    for dataset in [Dataset::NGSIM, Dataset::HIGHD] {
        let seen = match found(folder.path(), dataset) {
            Ok(found) => found.notes().join("; "),
            Err(error) => error.to_string(),
        };
        assert!(seen.contains("pipe.csv is not read: a named pipe"), "{seen}");
        assert!(seen.contains("socket.csv is not read: a socket"), "{seen}");
        for special in [&pipe, Path::new("/dev/null")] {
            let error = read_all(special, dataset).unwrap_err();
            assert!(matches!(error, DataError::NotAFile { .. }), "{error}");
        }
    }
    // Nor by a source that somebody put together.
    let source = gnp_data::Source::new(Dataset::NGSIM, "pipe", vec![pipe]);
    let expect = gnp_data::Expectation { dataset: Dataset::NGSIM, rate_hz: None };
    assert!(matches!(gnp_data::read(&source, &expect).unwrap_err(), DataError::NotAFile { .. }));
}

#[test]
fn foreign_files_are_named_and_what_accompanies_data_is_not() {
    let folder = tempfile::tempdir().unwrap();
    put(folder.path(), "a.csv", &good());
    put(folder.path(), "weather.csv", "day,sun\n1,2\n");
    put(folder.path(), "deep/map.xml", "<?xml version='1.0'?>\n<OpenDRIVE/>\n");
    put(folder.path(), "tracks.dat", "1 2 3\n");
    scene().put(folder.path(), "05");
    for name in ["README.txt", "readme.md", "LICENSE", "SIMULATED", "picture.png", "terms.pdf", ".hidden.csv"] {
        put(folder.path(), name, "words of no table\n");
    }
    let found = found(folder.path(), Dataset::NGSIM).unwrap();
    assert_eq!(found.sources.len(), 1);
    let said = not_read(&found, folder.path());
    assert_eq!(said.len(), 6, "{said:?}");
    let says = |name: &str, part: &str| {
        let what = said.iter().find(|(file, _)| file == Path::new(name)).map_or("", |(_, what)| what);
        assert!(what.contains(part), "{name}: {what}");
    };
    says("weather.csv", "another kind than NGSIM");
    says("05_tracks.csv", "highD; choose that dataset");
    says("tracks.dat", "ends otherwise");
    says("deep/map.xml", "XML");
    let notes = found.notes();
    assert_eq!(notes.len(), 6);
    assert_eq!(notes[5], "1 more file is not read");
}

/// Files of other kinds: name, first bytes, what the message must say.
fn foreign() -> Vec<(&'static str, Vec<u8>, [&'static str; 2])> {
    let utf16: Vec<u8> = good().encode_utf16().flat_map(u16::to_le_bytes).collect();
    let exid = "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,yVelocity,\
                lonVelocity,latVelocity,laneletId,leftAlongsideId,rightAlongsideId\n39,0,1,0,1,2,3,4,5,6,7,8,9,0,-1,-1\n";
    let exid_meta = "recordingId,trackId,initialFrame,finalFrame,numFrames,width,length,class\n39,0,1,9,9,2,5,car\n";
    let ind_meta = "recordingId,locationId,frameRate,speedLimit,numVRUs,xUtmOrigin,yUtmOrigin,orthoPxToMeter\n\
                    7,1,25,13,0,1,2,0.1\n";
    let round =
        "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity\n1,2,3,4,5,6,7,8,9,1\n";
    let text = |text: &str| text.as_bytes().to_vec();
    vec![
        ("39_tracks.csv", text(exid), ["exiD", "highD"]),
        ("39_tracksMeta.csv", text(exid_meta), ["exiD", "docs/data.md"]),
        ("07_recordingMeta.csv", text(ind_meta), ["inD", "docs/data.md"]),
        ("00_tracks.csv", text(round), ["rounD", "docs/data.md"]),
        (
            "pneuma.csv",
            text("track_id; type; traveled_d; avg_speed; lat; lon\n1; Car; 48.8; 9.7; 37.9; 23.7\n"),
            ["pNEUMA", "streets"],
        ),
        (
            "i24.csv",
            text("[{\"_id\": 1, \"road_segment_ids\": [1], \"x_position\": [1.0]}]"),
            ["I-24 MOTION", "docs/data.md"],
        ),
        ("sample.csv", text("[\n{\"token\": \"a\", \"sample_token\": \"b\"}\n]\n"), ["nuScenes", "docs/data.md"]),
        ("a.csv", text("{\"a\": 1}"), ["JSON", "docs/data.md"]),
        ("scenario.csv", text("PAR1\x15\x04\n"), ["Argoverse 2", "CSV"]),
        ("a.csv", text("PK\x03\x04\x14\n"), ["zip", "unpack"]),
        ("a.csv", [b"PK\x03\x04".as_slice(), &[0; 26], b"[Content_Types].xml\n"].concat(), ["Excel", "CSV"]),
        ("a.csv", b"7z\xbc\xaf\x27\x1c\n".to_vec(), ["7z", "unpack"]),
        ("a.tar.gz", gzip(&("\0".repeat(257) + "ustar\n")), ["tar archive", "unpack"]),
        ("a.csv", [b"\xff\xfe".as_slice(), &utf16].concat(), ["UTF-16", "save it as UTF-8"]),
        ("a.csv", utf16, ["UTF-16", "save it as UTF-8"]),
        ("a.csv", good().replace('\n', "\r").into_bytes(), ["carriage return", "line feeds"]),
        ("a.csv", text("<!DOCTYPE html>\n<html><body>Not found</body></html>\n"), ["web page", "download"]),
        ("a.csv", b"vehicle_\xe4hnlich,frame\n1,2\n".to_vec(), ["not in UTF-8", "save it as UTF-8"]),
        ("a.csv", vec![0; 100_000], ["NUL", "again"]),
        ("a.csv", vec![b'1'; 100_000], ["64 KiB", "original"]),
        ("a.csv", text("version https://git-lfs.github.com/spec/v1\noid sha256:0\n"), ["Git LFS", "git lfs pull"]),
    ]
}

#[test]
fn known_kinds_are_answered_with_their_name_and_what_to_do() {
    for (name, bytes, parts) in foreign() {
        for dataset in [Dataset::NGSIM, Dataset::HIGHD] {
            // Asked for alone.
            let folder = tempfile::tempdir().unwrap();
            let file = folder.path().join(name);
            std::fs::write(&file, &bytes).unwrap();
            let error = read_all(&file, dataset).unwrap_err();
            assert!(matches!(error, DataError::Foreign { .. }), "{name} for {dataset}: {error}");
            // Alone in a folder.
            let empty = read_all(folder.path(), dataset).unwrap_err();
            assert!(matches!(empty, DataError::NoRecordings { .. }), "{name} for {dataset}: {empty}");
            // Beside a recording.
            put(folder.path(), "good.csv", &good());
            scene().put(folder.path(), "05");
            let found = found(folder.path(), dataset).unwrap();
            assert_eq!(found.sources.len(), 1, "{name} for {dataset}");
            for said in [error.to_string(), empty.to_string(), found.notes().join("; ")] {
                assert!(parts.iter().all(|part| said.contains(part)), "{parts:?} for {dataset} not in: {said}");
            }
        }
    }
}

#[test]
fn a_copy_of_a_file_of_highd_is_named_and_not_read() {
    let folder = tempfile::tempdir().unwrap();
    scene().put(folder.path(), "05");
    let good = read_all(folder.path(), Dataset::HIGHD).unwrap();
    let copy = put(folder.path(), "05_tracks (1).csv", &scene().tracks.replace(",25,", ",24,"));
    let all = read_all(folder.path(), Dataset::HIGHD).unwrap();
    assert_eq!(all[0].0.columns(), good[0].0.columns());
    let note = all[0].1.notes.last().unwrap();
    assert!(note.contains("05_tracks (1).csv is of the same recording as"), "{note}");
    assert!(note.contains("05_tracks.csv and was not read"), "{note}");
    // Unless it is asked for.
    let all = read_all(&copy, Dataset::HIGHD).unwrap();
    assert!(all[0].1.notes.last().unwrap().contains("(1).csv and was not read"));
}

#[test]
fn empty_files_and_lists_of_numbers_beside_recordings() {
    for dataset in [Dataset::NGSIM, Dataset::HIGHD] {
        let folder = tempfile::tempdir().unwrap();
        put(folder.path(), "good.csv", &good());
        scene().put(folder.path(), "05");
        for (name, text) in [("empty.csv", ""), ("blank.csv", " \n\n"), ("notes.csv", "1,2\n"), ("pairs.csv", "1;2\n")]
        {
            put(folder.path(), name, text);
        }
        let found = found(folder.path(), dataset).unwrap();
        assert_eq!(found.sources.len(), 1, "{dataset}");
        let said = not_read(&found, folder.path());
        for (name, part) in [
            ("empty.csv", "an empty file; download it again"),
            ("blank.csv", "an empty file"),
            ("notes.csv", "another kind"),
            ("pairs.csv", "another kind"),
        ] {
            let what = said.iter().find(|(file, _)| file == Path::new(name)).map(|(_, what)| what);
            assert!(what.is_some_and(|what| what.contains(part)), "{dataset}: {said:?}");
        }
        let alone = read_all(&folder.path().join("empty.csv"), dataset).unwrap_err();
        assert!(matches!(alone, DataError::Empty { .. }), "{alone}");
    }
}

#[test]
fn a_message_about_an_empty_folder_says_what_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let said = || found(folder.path(), Dataset::NGSIM).unwrap_err().to_string();
    assert!(said().contains("there are no tables"), "{}", said());
    for i in 0..8 {
        put(folder.path(), &format!("weather-{i}.csv"), "day,sun\n1,2\n");
    }
    assert!(said().contains("weather-4.csv") && said().contains("3 more files are not read"), "{}", said());
}
