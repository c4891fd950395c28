//! Stretches of following: one vehicle behind one leader without a gap, and its roll-out behind him.
use gnp_data::{NAMED_LEADER_SIZE, Recording, Slot, Track, VelocitySource};
use gnp_force::{Driver, following_acceleration};

/// A shorter stretch says nothing, s.
const SHORTEST_S: f64 = 3.;
/// Recorded gaps below this one are errors of measurement, m: the stretch ends there.
const LEAST_GAP_M: f64 = 0.5;
/// Widths of the smoothing of positions and velocities that were measured as positions, s (Thiemann, Treiber and Kesting,
/// Transportation Research Record 2088, 2008).
const SMOOTHING_S: [f64; 2] = [0.5, 1.];

/// Somebody behind one leader.
#[derive(Clone, Debug)]
pub(super) struct Stretch {
    /// Time between two frames, s.
    pub(super) dt: f64,
    /// Mean of both lengths, m.
    pub(super) body: f64,
    /// Place and speed of the leader, m and m/s.
    pub(super) leader: Vec<[f64; 2]>,
    /// Place and speed of the follower, m and m/s.
    pub(super) own: Vec<[f64; 2]>,
    /// Speed of the follower, not smoothed, m/s.
    pub(super) raw_speed: Vec<f64>,
}

/// Whom a row has ahead.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Ahead {
    /// A vehicle with a track.
    Track(usize),
    /// One that the rows of its follower name.
    Named(u32),
}

/// The vehicle ahead in the lane in a row, and the place of its centre, m.
pub(super) fn ahead(recording: &Recording, track: &Track, row: usize) -> Option<(Ahead, f64)> {
    let columns = recording.columns();
    let named = columns.named_leader.as_ref().and_then(|named| named.get(row)).filter(|named| named.vehicle != 0);
    if let Some(named) = named {
        let front = columns.x[row] + track.length / 2. + named.headway;
        return Some((Ahead::Named(named.vehicle), f64::from(front - NAMED_LEADER_SIZE[0] / 2.)));
    }
    let other = recording.neighbour(row, Slot::Preceding)?;
    let there = recording.tracks()[other].row_at(frame_of(track, row))?;
    Some((Ahead::Track(other), f64::from(columns.x[there])))
}

/// Frame of a track's row.
pub(super) fn frame_of(track: &Track, row: usize) -> u32 {
    track.first_frame + (row - track.rows.start) as u32
}

/// The stretches of a track.
pub(super) fn stretches(recording: &Recording, track: &Track) -> Vec<Stretch> {
    let rate = recording.meta().rate_hz;
    let seen: Vec<Option<(Ahead, f64)>> = track.rows.clone().map(|row| ahead(recording, track, row)).collect();
    let close = |at: usize| {
        let (who, place) = seen[at]?;
        let body = body(recording, track, who);
        let gap = place - f64::from(recording.columns().x[track.rows.start + at]) - body;
        (gap >= LEAST_GAP_M).then_some(who)
    };
    let (mut found, mut from) = (Vec::new(), 0);
    for at in 1..=seen.len() {
        let who = close(from);
        if at < seen.len() && close(at) == who {
            continue;
        }
        if let Some(who) = who
            && (at - from) as f64 >= SHORTEST_S * rate
        {
            found.push(stretch(recording, track, who, from..at, &seen[from..at]));
        }
        from = at;
    }
    found
}

fn body(recording: &Recording, track: &Track, who: Ahead) -> f64 {
    let length = match who {
        Ahead::Track(other) => recording.tracks()[other].length,
        Ahead::Named(_) => NAMED_LEADER_SIZE[0],
    };
    f64::from(track.length + length) / 2.
}

fn stretch(
    recording: &Recording,
    track: &Track,
    who: Ahead,
    at: std::ops::Range<usize>,
    seen: &[Option<(Ahead, f64)>],
) -> Stretch {
    let rate = recording.meta().rate_hz;
    let derived = recording.meta().velocities == VelocitySource::Derived;
    let columns = recording.columns();
    let rows = track.rows.start + at.start..track.rows.start + at.end;
    let own_x = columns.x[rows.clone()].iter().map(|x| f64::from(*x)).collect();
    let raw_speed: Vec<f64> = columns.vx[rows.clone()].iter().map(|v| f64::from(*v)).collect();
    let leader_x: Vec<f64> = seen.iter().flatten().map(|(_, place)| *place).collect();
    let leader_v = match who {
        Ahead::Named(_) => slopes(&leader_x, rate),
        Ahead::Track(other) => {
            let there = |row| recording.tracks()[other].row_at(frame_of(track, row));
            rows.filter_map(there).map(|row| f64::from(columns.vx[row])).collect()
        }
    };
    let moved = |x: Vec<f64>, v: &[f64], smooth: bool| -> Vec<[f64; 2]> {
        let [width_x, width_v] = SMOOTHING_S.map(|width| if smooth { width * rate } else { 0. });
        smoothed(&x, width_x).into_iter().zip(smoothed(v, width_v)).map(|(x, v)| [x, v]).collect()
    };
    let named = matches!(who, Ahead::Named(_));
    Stretch {
        dt: 1. / rate,
        body: body(recording, track, who),
        leader: moved(leader_x, &leader_v, derived || named),
        own: moved(own_x, &raw_speed, derived),
        raw_speed,
    }
}

/// Central differences, one-sided at both ends.
fn slopes(x: &[f64], rate: f64) -> Vec<f64> {
    let last = x.len().saturating_sub(1);
    let slope = |at: usize| {
        let (from, to) = (at.saturating_sub(1), (at + 1).min(last));
        (x[to] - x[from]) * rate / (to - from).max(1) as f64
    };
    (0..x.len()).map(slope).collect()
}

/// Weighted by `exp(-|k| / width)` over three widths to either side, fewer, and as many to both sides, near the ends.
fn smoothed(values: &[f64], width: f64) -> Vec<f64> {
    let reach = (3. * width) as usize;
    let at = |i: usize| {
        let reach = reach.min(i).min(values.len() - 1 - i);
        let (mut sum, mut weights) = (values[i], 1.);
        for k in 1..=reach {
            let weight = (-(k as f64) / width).exp();
            sum += weight * (values[i - k] + values[i + k]);
            weights += 2. * weight;
        }
        sum / weights
    };
    (0..values.len()).map(at).collect()
}

/// Sums over the frames of stretches, of what a driver does wrong.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Errors {
    /// Frames.
    frames: f64,
    /// Of squared errors, m².
    squares: f64,
    /// Of squared errors by recorded gap, m.
    mixed: f64,
    /// Of recorded gaps, m.
    gaps: f64,
}

impl Errors {
    pub(super) fn add(self, other: Self) -> Self {
        Self {
            frames: self.frames + other.frames,
            squares: self.squares + other.squares,
            mixed: self.mixed + other.mixed,
            gaps: self.gaps + other.gaps,
        }
    }

    /// Root mean square, m.
    pub(super) fn metres(&self) -> f64 {
        (self.squares / self.frames.max(1.)).sqrt()
    }

    /// The mixed error measure, squared: `<e² / s> / <s>` (Treiber and Kesting 2013, section 16.3).
    pub(super) fn mixed_square(&self) -> f64 {
        self.mixed / self.gaps.max(1e-9)
    }
}

impl Stretch {
    pub(super) fn seconds(&self) -> f64 {
        self.own.len() as f64 * self.dt
    }

    /// Recorded gap in a frame, m.
    pub(super) fn gap(&self, at: usize) -> f64 {
        (self.leader[at][0] - self.own[at][0] - self.body).max(LEAST_GAP_M)
    }

    /// Acceleration of a driver in the recorded place of a frame, m/s².
    pub(super) fn acceleration(&self, driver: &Driver<f64>, at: usize) -> f64 {
        let ([place, speed], [x, v]) = (self.leader[at], self.own[at]);
        following_acceleration(place - x, self.body, v, speed, driver)
    }

    /// Errors of the gap of a driver who starts where the recorded one did and follows the recorded leader.
    pub(super) fn errors(&self, driver: &Driver<f64>) -> Errors {
        let mut errors = Errors::default();
        self.roll_out(
            driver,
            || 0.,
            |at, x| {
                let (gap, square) = (self.gap(at), (x - self.own[at][0]).powi(2));
                errors.frames += 1.;
                errors.squares += square;
                errors.mixed += square / gap;
                errors.gaps += gap;
            },
        );
        errors
    }

    /// Calls `visit` with every frame but the first and the place, m, at which a driver is then who starts where the
    /// recorded one did and follows the recorded leader, with `more` m/s² in each step; by the ballistic step, constant
    /// acceleration over each frame.
    pub(super) fn roll_out(
        &self,
        driver: &Driver<f64>,
        mut more: impl FnMut() -> f64,
        mut visit: impl FnMut(usize, f64),
    ) {
        let Some([mut x, mut v]) = self.own.first().copied() else { return };
        for at in 1..self.own.len() {
            let [place, speed] = self.leader[at - 1];
            let acceleration = following_acceleration(place - x, self.body, v, speed, driver) + more();
            let next = (v + acceleration * self.dt).max(0.);
            x += (v + next) / 2. * self.dt;
            v = next;
            visit(at, x);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoothing_keeps_straight_lines_and_takes_noise_away() {
        let line: Vec<f64> = (0..50).map(|i| 3. + 0.5 * f64::from(i)).collect();
        for (a, b) in smoothed(&line, 5.).iter().zip(&line) {
            assert!((a - b).abs() < 1e-12);
        }
        let noise: Vec<f64> = (0..50).map(|i| if i % 2 == 0 { 1. } else { -1. }).collect();
        assert!(smoothed(&noise, 5.)[25].abs() < 0.2);
        assert_eq!(smoothed(&noise, 0.), noise);
    }
}
