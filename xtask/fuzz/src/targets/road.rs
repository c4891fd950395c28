//! Files of roads: any text as polyline, GeoJSON or OpenDRIVE, and lines of any points.

use arbitrary::Unstructured;
use gnp_road::{ReferenceLine, RoadFile};

use crate::finding::promise;
use crate::made::kind;
use crate::{Finding, Scratch, Target, checks};

pub(super) const TARGET: Target = Target {
    name: "road",
    about: "files of roads, and positions along and across their lines",
    run,
    seeds,
    words: &[
        "# lane lines: ",
        "x,y\n",
        "\"type\":\"LineString\",\"coordinates\":",
        "\"type\":\"Feature\"",
        "<planView>",
        "<geometry s=\"0\" x=\"",
        "<arc curvature=\"",
        "<spiral curvStart=\"",
        "<paramPoly3 pRange=\"",
        "<laneSection s=\"",
        "<width a=\"",
        "nan",
        "1e9",
    ],
};

const TEXTS: [&str; 3] = [
    "# lane lines: -3.7, 0, 3.7\nx,y\n0,0\n20,0\n40,1\n60,3\n",
    r#"{"type":"Feature","properties":{"lane_lines":[-3.5,0]},"geometry":{"type":"LineString","coordinates":[[0,0],[90,9]]}}"#,
    r#"<OpenDRIVE><road id="1" length="70"><planView>
<geometry s="0" x="0" y="0" hdg="0" length="30"><line/></geometry>
<geometry s="30" x="30" y="0" hdg="0" length="40"><spiral curvStart="0" curvEnd="0.005"/></geometry></planView>
<lanes><laneSection s="0"><right><lane id="-1" type="driving"><width a="3.5" b="0" c="0" d="0"/></lane></right>
</laneSection></lanes></road></OpenDRIVE>"#,
];

fn run(scratch: &Scratch, input: &[u8]) -> Result<(), Finding> {
    let (kind, rest) = kind(input);
    if kind == b'a' {
        let file = scratch.only("case.road", rest)?;
        return match RoadFile::read(&file) {
            Ok(road) => places(&road.line),
            Err(error) => checks::refusal(&error, "case.road"),
        };
    }
    // Steps of a walk, so that lines are found among them.
    let mut bytes = Unstructured::new(rest);
    let (mut points, mut at) = (Vec::new(), [0.; 2]);
    // Of nothing left it makes zeros without end.
    while !bytes.is_empty()
        && let Ok([length, turn]) = bytes.arbitrary::<[u8; 2]>()
    {
        points.push(at);
        let angle = f64::from(turn) / 256. - 0.5;
        at = [at[0] + f64::from(length) * angle.cos(), at[1] + f64::from(length) * angle.sin()];
    }
    match ReferenceLine::from_points(&points) {
        Ok(line) => places(&line),
        Err(error) => checks::refusal(&error, ""),
    }
}

/// There and back is the same place, all about a line.
fn places(line: &ReferenceLine) -> Result<(), Finding> {
    for part in -2..=22 {
        for d in [-60., -20., -3., 0., 3., 20., 60.] {
            let s = line.length() * f64::from(part) / 20.;
            let position = line.to_world(s, d);
            promise(position.iter().all(|c| c.is_finite()), || format!("{position:?} at {s}, {d}"))?;
            let Ok(point) = line.locate(position) else { continue };
            let back = line.to_world(point.s, point.d);
            let off = (back[0] - position[0]).hypot(back[1] - position[1]);
            promise(off < 1e-3, || format!("{position:?} comes back as {back:?}"))?;
            let velocity = point.velocity_to_world(point.velocity_to_road([20., -7.]));
            let same = (velocity[0] - 20.).abs() < 1e-6 && (velocity[1] + 7.).abs() < 1e-6;
            promise(same, || format!("a velocity comes back as {velocity:?}"))?;
        }
    }
    Ok(())
}

fn seeds(_: &Scratch) -> Result<Vec<Vec<u8>>, Finding> {
    let texts = TEXTS.map(|text| [b"a", text.as_bytes()].concat());
    let walk = |turn: u8| [&[0], [20, turn].repeat(30).as_slice()].concat();
    Ok(texts.into_iter().chain([walk(128), walk(140)]).collect())
}
