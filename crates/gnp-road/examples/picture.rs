//! Draws a road in the plane and the same road along its line: `cargo run --package gnp-road --example picture -- OUT.svg`.
//! The picture of docs/roads.md.

use std::error::Error;
use std::fmt::Write as _;

use gnp_road::ReferenceLine;

/// Offsets of lane lines, m.
const LINES: [f64; 4] = [-7.4, -3.7, 0., 3.7];

/// Vehicles: along and across, m.
const VEHICLES: [[f64; 2]; 5] = [[60., 1.85], [105., -1.85], [150., -5.55], [195., 1.85], [240., -1.85]];

fn main() -> Result<(), Box<dyn Error>> {
    let out = std::env::args().nth(1).ok_or("give OUT.svg")?;
    // A bend with a radius of 120 m between two straights, as points 15 m apart.
    let (mut position, mut points) = ([0., 0.], Vec::new());
    for i in 0..21 {
        points.push(position);
        let heading = 15. / 120. * f64::from((i - 5).clamp(0, 10)) + 15. / 240.;
        position = [position[0] + 15. * heading.cos(), position[1] + 15. * heading.sin()];
    }
    let line = ReferenceLine::from_points(&points)?;

    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 680 300\" width=\"680\" height=\"300\" \
         font-family=\"Verdana, Arial, sans-serif\" font-size=\"11\">\n<title>A road in the plane and along its line</title>\n\
         <rect width=\"680\" height=\"300\" fill=\"#fff\"/>\n",
    );
    // In the plane, y up; below one another: along the line, across it twice as large.
    let in_plane = |s: f64, d: f64| {
        let [x, y] = line.to_world(s, d);
        [40. + 1.05 * x, 285. - 1.05 * y]
    };
    let along = |s: f64, d: f64| [350. + s, 150. - 2. * d];
    draw(&mut svg, "the tracks' coordinates: x, y", [20., 20.], in_plane)?;
    draw(&mut svg, "along and across the line: s, d (d enlarged)", [350., 120.], along)?;
    for point in &points {
        writeln!(
            svg,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"1.8\" fill=\"#8b0000\"/>",
            40. + 1.05 * point[0],
            285. - 1.05 * point[1]
        )?;
    }
    svg.push_str("</svg>\n");
    Ok(std::fs::write(out, svg)?)
}

/// The road and its vehicles by a map from `s` and `d` to the picture.
fn draw(svg: &mut String, title: &str, [x, y]: [f64; 2], at: impl Fn(f64, f64) -> [f64; 2]) -> std::fmt::Result {
    writeln!(svg, "<text x=\"{x}\" y=\"{y}\">{title}</text>")?;
    for (i, d) in LINES.iter().enumerate() {
        let path: Vec<String> =
            (0..=60).map(|i| at(5. * f64::from(i), *d)).map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let edge = i == 0 || i + 1 == LINES.len();
        let dashes = if edge { "" } else { " stroke-dasharray=\"6 4\"" };
        let colour = if *d == 0. { "#8b0000" } else { "#56606e" };
        writeln!(svg, "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\"{dashes}/>", path.join(" "))?;
    }
    for [s, d] in VEHICLES {
        let corners = [[-6., -1.], [6., -1.], [6., 1.], [-6., 1.]].map(|[ds, dd]| at(s + ds, d + dd));
        let corners: Vec<String> = corners.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        writeln!(svg, "<polygon points=\"{}\" fill=\"#8fc1e3\" stroke=\"#4a5260\"/>", corners.join(" "))?;
    }
    Ok(())
}
