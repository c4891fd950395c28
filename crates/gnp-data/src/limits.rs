//! What a vehicle on a road can be: the bounds beyond which no reader, no program's own track and no
//! kept recording passes.

use std::ops::RangeInclusive;

/// Largest coordinate, m: 2^17. Up to there neighbouring `f32` are less than 8 mm apart, so that
/// positions keep their centimetre and differences of them their speed; beyond, choose an origin
/// nearer to the road.
pub const MAX_POSITION: f32 = 131_072.;

/// No road vehicle is faster, m/s: 360 km/h.
pub const MAX_SPEED: f32 = 100.;

/// No vehicle of a recorded motorway is faster, m/s: a file with more is in another unit.
pub const MAX_RECORDED_SPEED: f32 = 70.;

/// Lengths of vehicles, m: the longest road trains are below 37 m.
pub const LENGTH: RangeInclusive<f32> = 0.5..=40.;

/// Widths of vehicles, m: a motorcycle without its mirrors; an oversize load.
pub const WIDTH: RangeInclusive<f32> = 0.3..=5.;

/// No lane is wider, m.
pub const MAX_LANE_WIDTH: f32 = 8.;

/// Lines of a carriageway of 16 lanes; the widest ones have 13.
pub const MAX_LINES: usize = 17;

/// Highest rate of a recording, Hz: no camera over a road has more.
pub const MAX_RATE_HZ: f64 = 1000.;

/// Lowest rate of a recording, Hz: a frame in a hundred seconds.
pub const MIN_RATE_HZ: f64 = 0.01;

/// Whether a rate, Hz, is that of a recording.
#[must_use]
pub fn is_rate(rate_hz: f64) -> bool {
    (MIN_RATE_HZ..=MAX_RATE_HZ).contains(&rate_hz)
}

/// Whether both coordinates of a position, m, are within [`MAX_POSITION`].
#[must_use]
pub fn is_position(position: [f32; 2]) -> bool {
    position.iter().all(|value| value.abs() <= MAX_POSITION)
}

/// Whether a velocity, m/s, is within [`MAX_SPEED`].
#[must_use]
pub fn is_velocity([vx, vy]: [f32; 2]) -> bool {
    vx.hypot(vy) <= MAX_SPEED
}

/// Whether a length and a width, m, are those of a vehicle.
#[must_use]
pub fn is_size([length, width]: [f32; 2]) -> bool {
    LENGTH.contains(&length) && WIDTH.contains(&width)
}

/// [`LENGTH`] and [`WIDTH`] for a message.
pub(crate) fn sizes() -> String {
    format!("{} to {} m long and {} to {} m wide", LENGTH.start(), LENGTH.end(), WIDTH.start(), WIDTH.end())
}
