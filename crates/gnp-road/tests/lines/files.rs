//! Roads from files, and files that hold none.

use std::error::Error as _;

use gnp_road::{LaneLinesError, RoadFile, RoadFileError, parse_lane_lines};

fn read(text: &str) -> Result<RoadFile, RoadFileError> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("road.txt");
    std::fs::write(&file, text).unwrap();
    RoadFile::read(&file)
}

/// The message with its causes.
fn message(text: &str) -> String {
    let error = read(text).unwrap_err();
    let mut message = error.to_string();
    let mut cause = error.source();
    while let Some(next) = cause {
        message += &format!(": {next}");
        cause = next.source();
    }
    message
}

#[test]
fn one_line_in_every_form_is_the_same_line() {
    let plain = read("x,y\n100.5,0\n120,1\n140,3.5\n160,7\n").unwrap();
    assert_eq!(plain.line.points()[0], [100.5, 0.]);
    assert_eq!(plain.lane_lines, None);
    let line = r#"{"type":"LineString","coordinates":[[100.5,0],[120,1,0],[140,3.5],[160,7]]}"#;
    let feature = |properties: &str| format!(r#"{{"type":"Feature","geometry":{line},"properties":{properties}}}"#);
    let point = r#"{"type":"Feature","geometry":{"type":"Point","coordinates":[1,2]},"properties":null}"#;
    let texts = [
        "100.5 0\n120 1\n140 3.5\n160 7".to_owned(),
        "# drawn by hand\r\nname;Y;X\r\na;0;100.5\r\na;1;120\r\n\r\na;3.5;140\r\na;7;160\r\n".to_owned(),
        "\u{feff}\"easting\",\"northing\"\n100.5,0\n120,1\n140,3.5\n160,7\n".to_owned(),
        line.to_owned(),
        feature("null"),
        format!(r#"{{"type":"FeatureCollection","features":[{point},{}]}}"#, feature("{}")),
        line.replace("LineString", "MultiLineString").replace("[[1", "[[[1").replace("]]", "]]]"),
    ];
    for text in texts {
        let road = read(&text).unwrap();
        assert_eq!((&road.line, &road.lane_lines), (&plain.line, &None), "{text}");
    }
    let lanes = Some(vec![-3.7, 0., 3.7]);
    assert_eq!(read("# lane lines: -3.7, 0, 3.7\nx,y\n0,0\n100,0\n").unwrap().lane_lines, lanes);
    assert_eq!(read(&feature(r#"{"lane_lines":[-3.7,0,3.7]}"#)).unwrap().lane_lines, lanes);
}

#[test]
fn a_file_without_a_road_says_where_and_why() {
    let line = |coordinates: &str| format!(r#"{{"type":"LineString","coordinates":{coordinates}}}"#);
    let cases = [
        ("", "is empty"),
        ("a,b\n1,2\n", "line 1: no columns x and y"),
        ("lon,lat\n11.5,48.1\n11.6,48.2\n", "line 1: longitude and latitude"),
        ("x,y\n0,0\n10,here\n", r#"line 3: column y is "here""#),
        ("x,y\n0,0\n10\n", r#"line 3: column y is """#),
        ("x,y\n0,0\n\n10,0\n10,0\n", "line 4: no reference line: points 2 and 3 are 0.000 m apart"),
        ("x,y\n0,0\nNaN,0\n", "line 3: no reference line: point 2 is (NaN, 0)"),
        ("x,y\n0,0\n100,0\n100,100\n", "line 3: no reference line: the line turns by 90 degrees"),
        ("x,y\n0,0\n", "1 points make no line"),
        ("# lane lines: 0,20\nx,y\n0,0\n100,0\n", "line 1: a lane of 20 m"),
        ("11.50,48.1\n11.51,48.11\n", "ogr2ogr -t_srs EPSG:32632"),
        ("-70.1,-33.1\n-70.2,-33.2\n", "EPSG:32719"),
        ("<osm></osm>", "but not OpenDRIVE"),
        ("<OpenDRIVE>", "line 1: is no XML"),
        ("{\"type\":", "line 1: is no GeoJSON"),
        ("{}", "without a `type`"),
        (r#"{"type":"Point","coordinates":[0,0]}"#, "has no LineString"),
        (&line(r#"[[0,0],["a",1]]"#), "position 2"),
        (&line("[[11.5,48.1],[11.6,48.2]]"), "degrees"),
        (&format!(r#"{{"type":"GeometryCollection","geometries":[{0},{0}]}}"#, line("[[0,0],[50,0]]")), "has 2 lines"),
    ];
    for (text, part) in cases {
        let message = message(text);
        assert!(message.contains(part) && message.contains("road.txt"), "{text:?}: {message}");
    }
    // Nested beyond any file's need, it is refused without a word about the stack.
    let deep = "{\"type\":\"FeatureCollection\",\"features\":[".repeat(100_000);
    assert!(message(&deep).contains("no GeoJSON"));
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(RoadFile::read(folder.path()), Err(RoadFileError::Content { .. })));
    assert!(matches!(RoadFile::read(&folder.path().join("none")), Err(RoadFileError::Io { .. })));
    std::fs::write(folder.path().join("binary"), [0xff, 0xfe, 0, 1]).unwrap();
    assert!(RoadFile::read(&folder.path().join("binary")).unwrap_err().to_string().contains("is no text"));
}

#[test]
fn lane_lines_make_lanes_or_are_refused() {
    assert_eq!(parse_lane_lines("-7.5,-3.75,0"), Ok(vec![-7.5, -3.75, 0.]));
    assert_eq!(parse_lane_lines("0,x"), Err(LaneLinesError::Number("x".into())));
    assert_eq!(parse_lane_lines("0"), Err(LaneLinesError::Count(1)));
    assert_eq!(parse_lane_lines("3.5,0"), Err(LaneLinesError::Width { from: 3.5, to: 0., width: -3.5 }));
    // In feet.
    assert!(matches!(parse_lane_lines("0,12,24"), Err(LaneLinesError::Width { width: 12., .. })));
    assert!(matches!(parse_lane_lines("NaN,0"), Err(LaneLinesError::Far(_))));
    assert_eq!(parse_lane_lines("500,503"), Err(LaneLinesError::Far(500.)));
}
