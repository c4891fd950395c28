//! How vehicles move by their positions, to compare with what else a file says of it.

use std::ops::Range;

use rayon::prelude::*;

use super::periods::Picked;
use crate::lanes::median;

/// Positions are differenced over twice this time, s: longer than the noise of single frames and
/// the rounding of centimetres, shorter than a manoeuvre.
const HALF_SPAN: f64 = 0.25;

/// A vehicle whose steps sum up to less is driving backwards, m: no one backs so far on a motorway,
/// and noise does not add up to it.
const BACKWARDS: f32 = -5.;

/// Speeds may differ by this much in m/s, and by this fraction, in the median of a vehicle: smoothing
/// and noise make 0.1 m/s in highD's layout and up to 1.2 m/s in NGSIM, another unit or sign far more.
const SPEED_TOLERANCE: (f32, f32) = (1., 0.1);
const NOISY_SPEED_TOLERANCE: (f32, f32) = (2., 0.2);

/// A row's velocity may differ by this much, m/s: in highD's layout it does by 0.2.
const ROW_TOLERANCE: f32 = 3.;

/// Lateral speed from which on its sign and size are compared, m/s, and what they may differ by.
const LATERAL: f32 = 0.3;
const LATERAL_TOLERANCE: (f32, f32) = (0.2, 0.5);

/// Least time that a vehicle must move laterally to be judged by it, s.
const LATERAL_TIME: f64 = 0.2;

/// Rows in the road frame by vehicle and frame.
pub(crate) struct Motion<'a> {
    pub(crate) frame: &'a [u32],
    /// Forward, m.
    pub(crate) x: &'a [f32],
    /// To the left, m.
    pub(crate) y: &'a [f32],
    pub(crate) rate_hz: f64,
}

impl Motion<'_> {
    /// Whether the vehicle whose rows these are drives backwards.
    pub(super) fn is_backwards(&self, rows: Range<usize>) -> bool {
        let steps = rows.skip(1).filter(|i| self.frame[*i].wrapping_sub(self.frame[i - 1]) == 1);
        steps.map(|i| self.x[i] - self.x[i - 1]).sum::<f32>() < BACKWARDS
    }

    /// Whether the velocity along the road that its rows state, m/s, is another than that of its positions.
    pub(crate) fn contradicts(&self, rows: Range<usize>, stated: &[f32]) -> bool {
        let (mut off, mut speeds): (Vec<f32>, Vec<f32>) =
            self.slopes(rows).map(|(i, [dx, _])| ((stated[i] - dx).abs(), dx.abs())).unzip();
        exceeds(&mut off, &mut speeds, SPEED_TOLERANCE)
    }

    /// Whether the velocity across the road that its rows state, m/s, is another than that of its positions; `None`
    /// where it does not move sideways for long enough to tell.
    pub(super) fn contradicts_sideways(&self, rows: Range<usize>, stated: &[f32]) -> Option<bool> {
        let (mut moving, mut wrong) = (0, 0);
        for (i, [_, dy]) in self.slopes(rows).filter(|(_, [_, dy])| dy.abs() > LATERAL) {
            moving += 1;
            wrong += usize::from((stated[i] - dy).abs() > LATERAL_TOLERANCE.0 + LATERAL_TOLERANCE.1 * dy.abs());
        }
        (moving as f64 >= LATERAL_TIME * self.rate_hz).then_some(wrong * 2 > moving)
    }

    /// How many of its rows state another velocity, m/s, than that of their positions, and the first.
    pub(super) fn other_rows(&self, rows: Range<usize>, stated: impl Fn(usize) -> [f32; 2]) -> (usize, Option<usize>) {
        let off = |(i, [dx, dy]): &(usize, [f32; 2])| {
            let [vx, vy] = stated(*i);
            (vx - dx).hypot(vy - dy) > ROW_TOLERANCE
        };
        let mut other = self.slopes(rows).filter(off).map(|(i, _)| i);
        let first = other.next();
        (usize::from(first.is_some()) + other.count(), first)
    }

    /// Whether the speed that its rows state, m/s, is another than that of its noisy positions.
    pub(super) fn contradicts_speed(&self, rows: Range<usize>, stated: &[f32]) -> bool {
        let slopes = self.slopes(rows).map(|(i, [dx, dy])| (i, dx.hypot(dy)));
        let (mut off, mut speeds): (Vec<f32>, Vec<f32>) =
            slopes.map(|(i, speed)| ((stated[i].abs() - speed).abs(), speed)).unzip();
        exceeds(&mut off, &mut speeds, NOISY_SPEED_TOLERANCE)
    }

    /// Central differences of positions, m/s, of the rows that have others a quarter of a second
    /// before and after without a gap; nearer in a short track.
    fn slopes(&self, rows: Range<usize>) -> impl Iterator<Item = (usize, [f32; 2])> {
        let half = ((HALF_SPAN * self.rate_hz).round() as usize).max(1).min(rows.len().saturating_sub(1) / 2);
        let per_second = (self.rate_hz / (2 * half).max(1) as f64) as f32;
        let inner = if half == 0 { 0..0 } else { rows.start + half..rows.end - half };
        inner.filter(move |i| self.frame[i + half].wrapping_sub(self.frame[i - half]) as usize == 2 * half).map(
            move |i| {
                let slope = |p: &[f32]| (p[i + half] - p[i - half]) * per_second;
                (i, [slope(self.x), slope(self.y)])
            },
        )
    }
}

fn exceeds(off: &mut [f32], speeds: &mut [f32], (least, fraction): (f32, f32)) -> bool {
    let (off, speed) = (median(off).unwrap_or(0.), median(speeds).unwrap_or(0.));
    off > least + fraction * speed
}

/// Vehicles whose rows are `wrong`, each with the place of its first row; `spans` are the rows of each.
pub(super) fn flagged(
    spans: &[Range<usize>],
    place: impl Fn(usize) -> usize,
    vehicle: &[u32],
    wrong: &(dyn Fn(Range<usize>) -> bool + Sync),
) -> Vec<(u32, usize)> {
    let found: Vec<usize> = spans.par_iter().filter(|rows| wrong((*rows).clone())).map(|rows| rows.start).collect();
    found.into_iter().map(|i| (vehicle[i], place(i))).collect()
}

/// Rows of each vehicle, of rows by vehicle.
pub(super) fn by_vehicle(vehicle: &[u32]) -> Vec<Range<usize>> {
    let runs = vehicle.chunk_by(|a, b| a == b).scan(0, |end, run| {
        let start = *end;
        *end += run.len();
        Some(start..*end)
    });
    runs.collect()
}

/// `rows` of a file by vehicle and frame, the earlier of the file first.
pub(super) fn in_order(vehicle: &[u32], frame: &[u32], rows: &Picked) -> Picked {
    let count = rows.len(vehicle.len());
    let at = |i: usize| rows.get(i).map_or(i, |row| *row as usize);
    let key = |row: usize| (vehicle[row], frame[row], row);
    if (1..count).all(|i| key(at(i - 1)) < key(at(i))) {
        return rows.clone();
    }
    let mut order: Vec<u32> = (0..count).map(|i| at(i) as u32).collect();
    order.par_sort_unstable_by_key(|row| key(*row as usize));
    Picked::Some(order)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 30 rows at 10 Hz of 20 m/s forward, `drift` m/s to the left.
    fn made(drift: f32) -> (Vec<u32>, Vec<f32>, Vec<f32>) {
        let t = |i: u8| 0.1 * f32::from(i);
        ((0..30).collect(), (0..30).map(|i| 20. * t(i)).collect(), (0..30).map(|i| drift * t(i)).collect())
    }

    #[test]
    fn a_velocity_is_compared_in_sign_and_size() {
        let (frame, x, y) = made(0.5);
        let motion = Motion { frame: &frame, x: &x, y: &y, rate_hz: 10. };
        for (speed, wrong) in
            [20., 22.5, 18., 0., -20., 72., 25.].into_iter().zip([false, false, false, true, true, true, true])
        {
            assert_eq!(motion.contradicts(0..30, &[speed; 30]), wrong, "{speed}");
        }
        for (drift, wrong) in [0.5, 0.6, 0.3, -0.5, 0.].into_iter().zip([false, false, false, true, true]) {
            assert_eq!(motion.contradicts_sideways(0..30, &[drift; 30]), Some(wrong), "{drift}");
        }
        let (_, x, y) = made(0.2);
        let straight = Motion { frame: &frame, x: &x, y: &y, rate_hz: 10. };
        assert_eq!(straight.contradicts_sideways(0..30, &[-0.2; 30]), None);
        let speed = |v: f32| motion.contradicts_speed(0..30, &[v; 30]);
        assert!(!speed(20.) && !speed(25.) && speed(0.) && speed(65.));
    }

    #[test]
    fn a_gap_is_no_step() {
        let (_, x, y) = made(0.);
        // The number returns after a gap, at the beginning of the road.
        let mut again = x.clone();
        again[20..].iter_mut().for_each(|x| *x -= 40.);
        let frame: Vec<u32> = (0..30).map(|i| if i < 20 { i } else { i + 100 }).collect();
        let motion = Motion { frame: &frame, x: &again, y: &y, rate_hz: 10. };
        assert!(!motion.is_backwards(0..30) && !motion.contradicts(0..30, &[20.; 30]));
        let reversed: Vec<f32> = x.iter().rev().copied().collect();
        assert!(Motion { x: &reversed, ..motion }.is_backwards(0..30));
    }

    #[test]
    fn rows_come_in_order() {
        assert_eq!(in_order(&[1, 1, 2], &[4, 5, 0], &Picked::All), Picked::All);
        assert_eq!(in_order(&[2, 1, 1, 1], &[0, 5, 4, 5], &Picked::All), Picked::Some(vec![2, 1, 3, 0]));
        assert_eq!(by_vehicle(&[4, 4, 7]), [0..2, 2..3]);
    }
}
