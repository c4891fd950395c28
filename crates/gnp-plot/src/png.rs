//! A figure as PNG. Letters come from fonts inside this crate, so that the picture does not depend on
//! what is installed.

use std::sync::Arc;

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb::Database};

use crate::figure::Figure;

/// DejaVu Sans, cut down to Latin, Greek and a few signs; its licence stands beside it.
const FONTS: [&[u8]; 2] = [include_bytes!("../fonts/DejaVuSans.ttf"), include_bytes!("../fonts/DejaVuSans-Bold.ttf")];
/// The family of [`FONTS`], which every figure asks for.
pub(crate) const FAMILY: &str = "DejaVu Sans";
/// Pixels a user unit: twice those of a page on a screen, 250 dots an inch in a column of 85 mm.
const DENSITY: f32 = 2.;

/// Why a figure could not be painted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PaintError {
    /// The text is no SVG.
    #[error("figure {figure}: cannot read its SVG; make it with this crate")]
    Svg {
        /// Name of the figure.
        figure: String,
        /// What is wrong.
        #[source]
        source: resvg::usvg::Error,
    },
    /// The picture has no pixel, or more than memory can hold.
    #[error(
        "figure {figure}: a picture of {width} x {height} units cannot be painted; draw fewer things under each other"
    )]
    Size {
        /// Name of the figure.
        figure: String,
        /// Width, user units.
        width: f32,
        /// Height, user units.
        height: f32,
    },
    /// The pixels could not be written as PNG.
    #[error("figure {figure}: cannot write its pixels as PNG: {problem}")]
    Encode {
        /// Name of the figure.
        figure: String,
        /// What the encoder says.
        problem: String,
    },
}

/// Paints figures; holds the fonts, which are read once.
#[derive(Clone, Debug)]
pub struct Painter {
    fonts: Arc<Database>,
}

impl Default for Painter {
    fn default() -> Self {
        Self::new()
    }
}

impl Painter {
    /// Reads the fonts.
    #[must_use]
    pub fn new() -> Self {
        let mut fonts = Database::new();
        for font in FONTS {
            fonts.load_font_data(font.to_vec());
        }
        fonts.set_sans_serif_family(FAMILY);
        Self { fonts: Arc::new(fonts) }
    }

    /// The figure as a PNG file, two pixels a unit: 840 wide. The same figure gives the same bytes.
    ///
    /// # Errors
    /// When the figure is not one that this crate has drawn, or too large.
    pub fn png(&self, figure: &Figure) -> Result<Vec<u8>, PaintError> {
        let name = || figure.name.clone();
        let options = Options { fontdb: Arc::clone(&self.fonts), font_family: FAMILY.to_owned(), ..Options::default() };
        let tree =
            Tree::from_str(&figure.svg, &options).map_err(|source| PaintError::Svg { figure: name(), source })?;
        let (width, height) = (tree.size().width(), tree.size().height());
        let pixels = |units: f32| (units * DENSITY).ceil() as u32;
        let mut picture = Pixmap::new(pixels(width), pixels(height)).ok_or_else(|| PaintError::Size {
            figure: name(),
            width,
            height,
        })?;
        resvg::render(&tree, Transform::from_scale(DENSITY, DENSITY), &mut picture.as_mut());
        picture.encode_png().map_err(|error| PaintError::Encode { figure: name(), problem: error.to_string() })
    }
}
