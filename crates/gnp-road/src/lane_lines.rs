//! Lane lines beside a reference line: where they lie, m.

/// Most lines of a carriageway: 16 lanes.
const MAX_LINES: usize = 17;

/// Widths of lanes, m.
const WIDTH: std::ops::RangeInclusive<f64> = 1. ..=8.;

/// Farthest that a lane line lies from the reference line, m.
const FARTHEST: f64 = 100.;

/// Offsets that make no lanes.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LaneLinesError {
    /// A text that is no list of numbers.
    #[error("{0:?} is no number; give the offsets of lane lines in m from right to left, such as -3.7,0,3.7")]
    Number(String),
    /// Fewer than two lines, or more than a carriageway has.
    #[error("{0} lane lines; a carriageway has from 2 to {MAX_LINES}, its edges among them")]
    Count(usize),
    /// An offset that is not finite, or far away from the road.
    #[error("a lane line {0} m from the reference line; the farthest may be {FARTHEST} m")]
    Far(f64),
    /// A lane of a width that no lane has, or lines that do not grow.
    #[error(
        "a lane of {width} m between the lines at {from} and {to} m; give them from right to left, in m: lanes are {} to {} m wide",
        WIDTH.start(), WIDTH.end()
    )]
    Width {
        /// The line on its right, m.
        from: f64,
        /// The line on its left, m.
        to: f64,
        /// From one to the other, m.
        width: f64,
    },
}

/// Lane lines from a text: offsets in m from the reference line, positive to the left, from right to left, with commas
/// between them. The outer two are the edges of the carriageway.
///
/// # Errors
/// [`LaneLinesError`] for what makes no lanes.
///
/// ```
/// assert_eq!(gnp_road::parse_lane_lines("-3.7, 0, 3.7")?, [-3.7, 0., 3.7]);
/// assert!(gnp_road::parse_lane_lines("3.7, 0").is_err());
/// # Ok::<(), gnp_road::LaneLinesError>(())
/// ```
pub fn parse_lane_lines(text: &str) -> Result<Vec<f64>, LaneLinesError> {
    let number = |field: &str| {
        let field = field.trim();
        field.parse().map_err(|_| LaneLinesError::Number(field.chars().take(30).collect()))
    };
    let lines: Vec<f64> = text.split(',').map(number).collect::<Result<_, _>>()?;
    check_lane_lines(&lines)?;
    Ok(lines)
}

/// Refuses offsets of lane lines, m, that make no lanes.
///
/// # Errors
/// [`LaneLinesError`].
pub fn check_lane_lines(lines: &[f64]) -> Result<(), LaneLinesError> {
    if !(2..=MAX_LINES).contains(&lines.len()) {
        return Err(LaneLinesError::Count(lines.len()));
    }
    if let Some(far) = lines.iter().find(|line| line.is_nan() || line.abs() > FARTHEST) {
        return Err(LaneLinesError::Far(*far));
    }
    match lines.windows(2).find(|pair| !WIDTH.contains(&(pair[1] - pair[0]))) {
        Some(pair) => Err(LaneLinesError::Width { from: pair[0], to: pair[1], width: pair[1] - pair[0] }),
        None => Ok(()),
    }
}
