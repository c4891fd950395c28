//! Roads of OpenDRIVE files, against their known course.

use std::path::Path;

use gnp_road::{RoadFile, RoadFileError};

use crate::roads::{Road, beside, distance, every};

/// Two lanes of 3.75 m and a shoulder to the right, one lane of 3.5 m to the left.
const LANES: &str = r#"<lanes><laneOffset s="0" a="0.5" b="0" c="0" d="0"/><laneSection s="0">
<left><lane id="1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></left>
<center><lane id="0" type="none"/></center>
<right><lane id="-3" type="shoulder"><width sOffset="0" a="2" b="0" c="0" d="0"/></lane>
<lane id="-1" type="driving"><width sOffset="0" a="3.75" b="0" c="0" d="0"/></lane>
<lane id="-2" type="driving"><width sOffset="0" a="3.75" b="0" c="0" d="0"/></lane></right>
</laneSection></lanes>"#;

fn read(folder: &Path, roads: &[String], ids: &str) -> Result<RoadFile, RoadFileError> {
    let text = format!("<?xml version=\"1.0\"?>\n<OpenDRIVE><header revMajor=\"1\"/>\n{}</OpenDRIVE>", roads.concat());
    std::fs::write(folder.join("map.xodr"), text).unwrap();
    RoadFile::read(&folder.join(format!("map.xodr{ids}")))
}

#[test]
fn lines_arcs_and_spirals_are_where_they_are_built() {
    let folder = tempfile::tempdir().unwrap();
    let road = Road::s_curve().at([688_000., 5_334_000.], 2.5);
    let found = read(folder.path(), &[road.open_drive("7", LANES)], "").unwrap();
    assert_eq!(found.lane_lines, Some(vec![-7., -3.25, 0.5]));
    assert!((found.line.length() - road.length()).abs() < 1e-3, "{}", found.line.length());
    let at = every(3., road.length());
    for (s, pose) in at.iter().zip(road.poses(&at)) {
        assert!(distance(found.line.to_world(*s, -5.), beside(pose, -5.)) < 0.005, "{s}");
    }
}

#[test]
fn a_cubic_is_where_it_is_built() {
    // u = 100 p, v = 10 p^2 from (5, 5) along y: an arc of about 500 m.
    let cubic = |range: &str, scale: f64| {
        let (b, c) = (100. / scale, 10. / scale / scale);
        format!(
            r#"<road id="1" length="100.7"><planView><geometry s="0" x="5" y="5" hdg="1.5707963267948966" length="100.7">
            <paramPoly3 aU="0" bU="{b}" cU="0" dU="0" aV="0" bV="0" cV="{c}" dV="0"{range}/></geometry></planView></road>"#
        )
    };
    let folder = tempfile::tempdir().unwrap();
    for road in [cubic("", 1.), cubic(r#" pRange="normalized""#, 1.), cubic(r#" pRange="arcLength""#, 100.7)] {
        let line = read(folder.path(), &[road], "").unwrap().line;
        for p in [0., 0.3, 0.5, 1.] {
            let place = line.to_road([5. - 10. * p * p, 5. + 100. * p]).unwrap();
            assert!(place.d.abs() < 1e-3, "{p}: {place:?}");
        }
        assert!((line.length() - 100.66).abs() < 0.01, "{}", line.length());
    }
}

#[test]
fn roads_one_after_the_other_are_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let first = Road::new(&[[200., 0., 0.], [100., 0., 1. / 300.]]);
    let (end, heading) = first.poses(&[300.])[0];
    // Drawn the other way: from its end to the end of the first one.
    let second = Road::new(&[[150., 1. / 300., 1. / 300.]]).at(end, heading);
    let (far, back) = second.poses(&[150.])[0];
    let drawn_back = Road::new(&[[150., -1. / 300., -1. / 300.]]).at(far, back + std::f64::consts::PI);
    let lanes = |right: f64, left: f64| LANES.replace("3.75", &right.to_string()).replace("3.5", &left.to_string());
    let lanes = [lanes(3.5, 3.5), lanes(3.5, 3.5)];
    let roads = [first.open_drive("a", &lanes[0]), drawn_back.open_drive("b", &lanes[1])];

    let message = read(folder.path(), &roads, "").unwrap_err().to_string();
    assert!(message.contains("it has 2 roads: a (300 m), b (150 m)") && message.contains("FILE#ID"), "{message}");
    let message = read(folder.path(), &roads, "#c").unwrap_err().to_string();
    assert!(message.contains("has no road \"c\""), "{message}");

    let both = read(folder.path(), &roads, "#a,b").unwrap();
    assert!((both.line.length() - 450.).abs() < 1e-3, "{}", both.line.length());
    let places =
        first.poses(&[10., 250.]).into_iter().zip([10., 250.]).chain(second.poses(&[20.]).into_iter().zip([320.]));
    for ((position, _), s) in places {
        let place = both.line.to_road(position).unwrap();
        assert!((place.s - s).abs() < 0.01 && place.d.abs() < 0.01, "{s}: {place:?}");
    }
    // Two lanes along the first, one along the second: no lines of the whole.
    assert_eq!(both.lane_lines, None);
    assert_eq!(read(folder.path(), &roads, "#a").unwrap().lane_lines, Some(vec![-6.5, -3., 0.5]));
    let back = read(folder.path(), &roads, "#b,a").unwrap();
    assert!((back.line.to_road([10., 0.]).unwrap().s - 440.).abs() < 0.01);

    let away = Road::new(&[[100., 0., 0.]]).at([400., 0.], 0.);
    let message = read(folder.path(), &[roads[0].clone(), away.open_drive("c", "")], "#a,c").unwrap_err().to_string();
    assert!(message.contains("between two of the roads"), "{message}");
}

#[test]
fn lanes_that_change_are_no_lines() {
    let folder = tempfile::tempdir().unwrap();
    let road = Road::new(&[[100., 0., 0.]]);
    let lines = |lanes: &str| read(folder.path(), &[road.open_drive("1", lanes)], "").unwrap().lane_lines;
    let taper = LANES.replacen("a=\"3.75\" b=\"0\"", "a=\"3.75\" b=\"0.01\"", 1);
    assert_ne!(taper, LANES);
    assert_eq!(lines(&taper), None);
    assert_eq!(
        lines(&LANES.replace("laneSection s=\"0\">", "laneSection s=\"0\"></laneSection><laneSection s=\"50\">")),
        None
    );
    assert_eq!(lines(""), None);
    // Lanes on the left alone: vehicles drive against the line, which is turned round.
    let left = LANES.replace(
        "type=\"driving\"><width sOffset=\"0\" a=\"3.75\"",
        "type=\"sidewalk\"><width sOffset=\"0\" a=\"3.75\"",
    );
    let turned = read(folder.path(), &[road.open_drive("1", &left)], "").unwrap();
    assert_eq!(turned.lane_lines, Some(vec![-4., -0.5]));
    assert!((turned.line.to_road([90., 0.]).unwrap().s - 10.).abs() < 1e-6);
}

#[test]
fn what_cannot_be_read_is_named_with_its_line() {
    let folder = tempfile::tempdir().unwrap();
    let road = Road::new(&[[100., 0., 0.]]).open_drive("1", "");
    let cases = [
        (road.replace("<line/>", "<poly3 a=\"0\"/>"), "line 3: element <poly3>: poly3 is not read"),
        (road.replace("hdg=\"0\"", "hdg=\"north\""), "line 3: element <geometry>: attribute `hdg`"),
        (road.replace("length=\"100\">", "length=\"1e30\">"), "that of no road"),
        (road.replace("planView", "plan"), "there is no planView"),
        (String::new(), "it has 0 roads"),
    ];
    for (road, part) in cases {
        let message = read(folder.path(), &[road], "").unwrap_err().to_string();
        assert!(message.contains(part), "{part}: {message}");
    }
}
