//! Cases: what happened beside the best of K futures and the others.

use crate::figure::{Figure, Sheet, Source};
use crate::road_view::{AXIS_SPACE, Paths, RoadView, path_legend};
use crate::scene::Scene;

/// Highest view, user units: six of them have to fit on a page.
const HIGHEST: f64 = 88.;

/// A case and what kind it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// What the driver did, such as `left`.
    pub kind: String,
    /// The window.
    pub scene: Scene,
}

/// Cases under each other, the future that ends nearest to the truth dark red, the others lime green
/// (GNP paper, qualitative results).
#[must_use]
pub fn cases(cases: &[Case], source: &Source) -> Figure {
    let mut sheet = Sheet::new("cases", "Best of K futures in straight driving and lane changes");
    let k = cases.iter().map(|case| case.scene.modes.len()).max().unwrap_or(0);
    sheet.y = path_legend(&mut sheet.svg, sheet.y, &format!("best of {k}"), "other futures");
    for case in cases {
        let scene = &case.scene;
        let miss = match (scene.modes.get(scene.best()).and_then(|m| m.path.last()), scene.truth.last()) {
            (Some(p), Some(t)) => format!("; best ends {:.1} m off", (p[0] - t[0]).hypot(p[1] - t[1])),
            _ => String::new(),
        };
        sheet.note(&format!("{}: {}{miss}", case.kind, scene.title));
        let view = RoadView::fit(scene, sheet.y + 3., HIGHEST);
        sheet.svg.group(&format!("class=\"case {}\"", case.kind));
        sheet.svg.clipped("cases", view.panel.place);
        view.road(&mut sheet.svg, scene);
        view.vehicles(&mut sheet.svg, scene);
        view.paths(&mut sheet.svg, scene, Paths::Best);
        sheet.svg.end();
        view.frame(&mut sheet.svg);
        sheet.svg.end();
        sheet.y = view.bottom() + AXIS_SPACE - 2.;
    }
    let caption = "Straight driving, lane changes to the left and to the right, two of each where the data has them: the future of K that ends \
                   nearest to the truth dark red, the others lime green, what happened dashed, what was observed \
                   grey; a diamond is where the lane number changes. Chosen by rule: in each class the windows a third \
                   and two thirds up the ranking by the best future's final error.";
    sheet.finish(caption, source)
}
