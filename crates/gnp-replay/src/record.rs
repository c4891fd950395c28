//! Which entity shows what, and when, without anything of Rerun.

use crate::colour::Colour;

/// What an entity of the viewer shows over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Path of the entity, such as `/vehicles/12`.
    pub entity: String,
    /// By frame; what is always shown comes first.
    pub rows: Vec<Row>,
}

/// What is shown from a frame on, until the next row of the entity.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Frame of the recording; `None` for what does not change.
    pub frame: Option<u32>,
    /// What.
    pub drawing: Drawing,
}

/// Something to be shown. Positions are in the road frame, m.
#[derive(Clone, Debug, PartialEq)]
pub enum Drawing {
    /// A vehicle.
    Box {
        /// Centre.
        centre: [f32; 2],
        /// Length and width.
        size: [f32; 2],
        /// Of the box.
        colour: Colour,
        /// Words, shown when it is pointed at.
        label: String,
    },
    /// Lines through points.
    Strips {
        /// Points of each line.
        strips: Vec<Vec<[f32; 2]>>,
        /// Colour of each line.
        colours: Vec<Colour>,
        /// Half the width on the screen, in points.
        radius: f32,
        /// Words at each line, shown when it is pointed at; or none.
        labels: Vec<String>,
    },
    /// Arrows.
    Arrows {
        /// Where each starts.
        origins: Vec<[f32; 2]>,
        /// From start to tip, m.
        vectors: Vec<[f32; 2]>,
        /// Of all of them.
        colour: Colour,
    },
    /// Values of the series that [`Drawing::Series`] names.
    Scalars(Vec<f32>),
    /// Names of series.
    Series(Vec<String>),
    /// Text in Markdown.
    Text(String),
    /// Nothing any more, neither of the entity nor of those below it.
    Gone,
}
