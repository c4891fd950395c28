//! Figures as SVG text and as PNG, and a report as one HTML file: data in, text or bytes out, nothing read and
//! nothing written.
//!
//! The road frame is drawn as it is: forward to the right, left up. A lateral axis that is stretched
//! says so. Colours are told apart by colour-blind readers and in grey; forces have the colours of
//! the GNP paper (goal yellow, neighbours blue, lines black). Every figure names its data, and says
//! *simulated* where any of it is. The same data gives the same text.
//!
//! Figures are 340 units wide with letters of 9 to 12, which are 6.4 to 8.5 points at the width of one column of a
//! page, 85 mm.

mod axes;
mod cases;
mod causes;
mod chart;
mod clip;
mod contributions;
mod dots;
mod field;
mod figure;
mod force_chart;
mod intention;
pub mod palette;
mod png;
mod reliability;
mod report;
mod road_view;
mod scene;
mod select;
mod space_time;
mod svg;
mod traffic;
mod what_if;

pub use crate::cases::{Case, cases};
pub use crate::chart::{ChartPanel, Scaling, Series, charts};
pub use crate::clip::{Clip, ClipForecast, ClipNeighbour, ClipSpan, ClipVehicle, Evaluated, TimedState, class_name};
pub use crate::contributions::contributions;
pub use crate::dots::{Dot, DotPanel, DotRow, DotScaling, dot_note, dot_rows};
pub use crate::field::{Potential, potential_field};
pub use crate::figure::{Figure, Source};
pub use crate::force_chart::force_scenes;
pub use crate::intention::{Intentions, intentions};
pub use crate::png::{PaintError, Painter};
pub use crate::reliability::{GivenMode, ReliabilityBin, reliability, reliability_bins};
pub use crate::report::{Report, ReportCell, ReportSection, ReportTable, SCENE_SCRIPT, SCENE_STYLE};
pub use crate::scene::{Other, Scene, VehicleBox};
pub use crate::select::{LateralManoeuvre, SceneRule, find_scene, lateral_manoeuvre, quantiles};
pub use crate::space_time::{LongitudinalForecast, SpaceTime, Trace, space_time};
pub use crate::traffic::{DetectorSeries, FlowDensity, SpeedField, detector_series, flow_density, speed_field};
pub use crate::what_if::{Mark, WhatIf, what_if};
