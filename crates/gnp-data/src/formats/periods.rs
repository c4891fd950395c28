//! Sites and periods that share a file. Vehicle and frame numbers begin again in every period, so
//! the key of a track is (site, period, vehicle, segment).

use std::collections::{BTreeMap, BTreeSet};

/// Time of frame 0 of two periods is further apart than this, ms; within a period it is constant
/// but for rounding.
const ANCHOR_GAP: i64 = 60_000;

/// A stretch of time without any row that ends a period whose frame numbers go on, ms.
const SILENCE: i64 = 300_000;

/// Width of the bins in which [`SILENCE`] is sought, ms.
const BIN: i64 = 10_000;

/// Time between frames of NGSIM, ms.
const FRAME_PERIOD: i64 = 100;

/// Vehicles by which rate and stride are measured.
const SAMPLE: usize = 64;

/// Which vehicle, frame and time (ms) every row of a file has.
pub(super) struct Moments<'a> {
    pub(super) vehicle: &'a [u32],
    pub(super) frame: &'a [u32],
    pub(super) time: &'a [i64],
}

/// Rows of a file: all of them, or those listed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Picked {
    All,
    Some(Vec<u32>),
}

impl Picked {
    pub(super) fn get(&self, i: usize) -> Option<&u32> {
        if let Self::Some(rows) = self { rows.get(i) } else { None }
    }

    pub(super) fn len(&self, all: usize) -> usize {
        if let Self::Some(rows) = self { rows.len() } else { all }
    }
}

/// One site and period of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Group {
    pub(super) site: String,
    /// 1 for the earliest of its site.
    pub(super) period: usize,
    pub(super) rows: Picked,
}

/// Which site every row of a file has.
pub(super) struct Sites<'a> {
    /// Place of the row's site in `names`; empty where all rows have the first.
    pub(super) codes: &'a [u16],
    /// Names; `None` for a site whose rows are left out.
    pub(super) names: Vec<Option<String>>,
}

/// Groups of a file by site, then time.
pub(super) fn separate(moments: &Moments<'_>, sites: &Sites<'_>) -> Vec<Group> {
    let Sites { codes, names } = sites;
    let mut groups = Vec::new();
    // Two spellings of a site are one site.
    let mut by_name: BTreeMap<&String, Vec<usize>> = BTreeMap::new();
    for (code, name) in names.iter().enumerate() {
        if let Some(name) = name {
            by_name.entry(name).or_default().push(code);
        }
    }
    for (name, wanted) in by_name {
        let site_is_all = codes.is_empty() || wanted.len() == names.len();
        let mine = |row: usize| site_is_all || wanted.contains(&usize::from(codes[row]));
        let ends = period_ends(moments, &mine);
        if site_is_all && ends.len() <= 1 {
            return vec![Group { site: name.clone(), period: 1, rows: Picked::All }];
        }
        let mut rows: Vec<Vec<u32>> = vec![Vec::new(); ends.len()];
        for row in (0..moments.vehicle.len()).filter(|row| mine(*row)) {
            let (anchor, time) = (moments.anchor(row), moments.time[row]);
            let period = ends.iter().position(|end| anchor <= end.anchor && time <= end.time);
            if let Some(rows) = period.and_then(|period| rows.get_mut(period)) {
                rows.push(row as u32);
            }
        }
        let groups_of_site = rows.into_iter().filter(|rows| !rows.is_empty()).enumerate();
        groups.extend(groups_of_site.map(|(i, rows)| Group {
            site: name.clone(),
            period: i + 1,
            rows: Picked::Some(rows),
        }));
    }
    groups
}

/// Where a period ends: the latest time of its frame 0, and its latest time, ms.
struct End {
    anchor: i64,
    time: i64,
}

/// The ends of the periods, in order: a row belongs to the first whose end is not before it.
fn period_ends(moments: &Moments<'_>, mine: &impl Fn(usize) -> bool) -> Vec<End> {
    let mut seen = BTreeSet::new();
    let mut last = None;
    for row in (0..moments.vehicle.len()).filter(|row| mine(*row)) {
        let key = (moments.anchor(row).div_euclid(BIN), moments.time[row].div_euclid(BIN));
        // Rows of a track mostly follow one another, so that few keys are looked up.
        if last != Some(key) {
            seen.insert(key);
            last = Some(key);
        }
    }
    let mut ends = Vec::new();
    let mut times: Vec<i64> = Vec::new();
    let mut bins = seen.into_iter().peekable();
    while let Some((anchor, time)) = bins.next() {
        times.push(time);
        if bins.peek().is_some_and(|next| (next.0 - anchor) * BIN <= ANCHOR_GAP) {
            continue;
        }
        times.sort_unstable();
        let anchor = (anchor + 1) * BIN - 1;
        let silences = times.windows(2).filter(|pair| (pair[1] - pair[0]) * BIN > SILENCE);
        ends.extend(silences.map(|pair| End { anchor, time: (pair[0] + 1) * BIN - 1 }));
        ends.push(End { anchor, time: i64::MAX });
        times.clear();
    }
    ends
}

impl Moments<'_> {
    /// Time of frame 0 as this row has it, ms.
    fn anchor(&self, row: usize) -> i64 {
        self.time[row] - FRAME_PERIOD * i64::from(self.frame[row])
    }

    /// Frames and ms from each frame to the next one of the vehicles a group begins with.
    pub(super) fn steps(&self, group: &Group) -> Steps {
        let mut sample = BTreeSet::new();
        let mut rows: Vec<(u32, u32, i64)> = Vec::new();
        let mut last: Option<(u32, bool)> = None;
        for i in 0..group.rows.len(self.vehicle.len()) {
            let row = group.rows.get(i).map_or(i, |row| *row as usize);
            let vehicle = self.vehicle[row];
            let chosen = match last {
                Some((same, chosen)) if same == vehicle => chosen,
                _ => sample.contains(&vehicle) || (sample.len() < SAMPLE && sample.insert(vehicle)),
            };
            last = Some((vehicle, chosen));
            if chosen {
                rows.push((vehicle, self.frame[row], self.time[row]));
            }
        }
        // The rows of a merged export come in any order.
        rows.sort_unstable();
        let next = rows.windows(2).filter(|pair| pair[0].0 == pair[1].0 && pair[0].1 < pair[1].1);
        Steps(next.map(|pair| (pair[1].1 - pair[0].1, pair[1].2 - pair[0].2)).collect())
    }
}

/// Frames and ms from one frame of a vehicle to its next.
pub(super) struct Steps(Vec<(u32, i64)>);

impl Steps {
    /// Frames per second by the times of the rows; `otherwise` where times do not tell.
    pub(super) fn rate(&self, otherwise: f64) -> f64 {
        let timed = self.0.iter().filter(|step| step.1 > 0);
        let period = most_frequent(timed.map(|(frames, ms)| ms / i64::from(*frames)));
        period.filter(|ms| *ms > 0).map_or(otherwise, |ms| 1000. / ms as f64)
    }

    /// Frames from a row of a vehicle to its next, in most cases: 1 unless rows were left out.
    pub(super) fn stride(&self) -> u32 {
        most_frequent(self.0.iter().map(|step| step.0)).unwrap_or(1)
    }
}

/// The most frequent value, the smallest of several.
fn most_frequent<T: Ord + Copy>(values: impl Iterator<Item = T>) -> Option<T> {
    let mut counts: BTreeMap<T, usize> = BTreeMap::new();
    for value in values {
        *counts.entry(value).or_default() += 1;
    }
    counts.into_iter().rev().max_by_key(|(_, count)| *count).map(|(value, _)| value)
}

/// Rows whose frame is before that of an earlier row of the same vehicle: how many, and the first of
/// them with the frame it falls behind.
pub(super) fn out_of_order(vehicle: &[u32], frame: &[u32], rows: &Picked) -> (u64, Option<(usize, u32)>) {
    let mut latest: BTreeMap<u32, u32> = BTreeMap::new();
    let (mut count, mut first) = (0, None);
    // The vehicle of the row before and its latest frame, so that runs of a vehicle look up nothing.
    let mut current: Option<(u32, u32)> = None;
    for i in 0..rows.len(vehicle.len()) {
        let row = rows.get(i).map_or(i, |row| *row as usize);
        let (id, now) = (vehicle[row], frame[row]);
        let before = match current {
            Some((same, before)) if same == id => Some(before),
            _ => {
                if let Some((other, before)) = current {
                    latest.insert(other, before);
                }
                latest.get(&id).copied()
            }
        };
        if let Some(before) = before.filter(|before| now < *before) {
            count += 1;
            first = first.or(Some((row, before)));
        }
        current = Some((id, before.map_or(now, |before| before.max(now))));
    }
    (count, first)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SITE: &str = "us-101";

    fn groups(rows: &[(u32, u32, i64)], codes: &[u16], names: &[Option<&str>]) -> Vec<(String, usize, Picked)> {
        let vehicle: Vec<u32> = rows.iter().map(|row| row.0).collect();
        let frame: Vec<u32> = rows.iter().map(|row| row.1).collect();
        let time: Vec<i64> = rows.iter().map(|row| row.2).collect();
        let names = names.iter().map(|name| name.map(str::to_owned)).collect();
        let moments = Moments { vehicle: &vehicle, frame: &frame, time: &time };
        separate(&moments, &Sites { codes, names }).into_iter().map(|g| (g.site, g.period, g.rows)).collect()
    }

    #[test]
    fn frame_numbers_that_begin_again_begin_a_period() {
        let start = 1_118_846_978_900;
        let rows = [(1, 10, start + 1000), (1, 11, start + 1100), (1, 10, start + 901_000), (2, 2000, start + 200_000)];
        let [first, second] = &groups(&rows, &[], &[Some(SITE)])[..] else { panic!("two periods") };
        assert_eq!(first, &(SITE.into(), 1, Picked::Some(vec![0, 1, 3])));
        assert_eq!(second, &(SITE.into(), 2, Picked::Some(vec![2])));
    }

    #[test]
    fn a_long_silence_ends_a_period_even_if_frames_go_on() {
        let rows = [(1, 0, 0), (2, 9000, 900_000), (2, 9001, 900_100)];
        assert_eq!(groups(&rows, &[], &[Some(SITE)]).len(), 2);
    }

    #[test]
    fn one_site_and_period_is_not_copied() {
        let rows = [(1, 0, 0), (1, 1, 100), (2, 1, 100)];
        assert_eq!(groups(&rows, &[0, 0, 0], &[Some(SITE)]), [(SITE.into(), 1, Picked::All)]);
    }

    #[test]
    fn sites_part_and_streets_are_left_out() {
        let rows = [(1, 0, 0), (1, 0, 0), (1, 0, 0), (1, 1, 100)];
        let found = groups(&rows, &[2, 0, 1, 2], &[Some("us-101"), None, Some("i-80")]);
        assert_eq!(found, [("i-80".into(), 1, Picked::Some(vec![0, 3])), ("us-101".into(), 1, Picked::Some(vec![1]))]);
    }

    #[test]
    fn rows_without_times_are_one_period() {
        let rows: Vec<(u32, u32, i64)> = (0..9000).map(|frame| (1, frame, 0)).collect();
        assert_eq!(groups(&rows, &[], &[Some(SITE)]), [(SITE.into(), 1, Picked::All)]);
    }

    #[test]
    fn finds_the_row_that_falls_behind_its_vehicle() {
        let order = |rows: &[(u32, u32)]| {
            let (vehicle, frame): (Vec<u32>, Vec<u32>) = rows.iter().copied().unzip();
            out_of_order(&vehicle, &frame, &Picked::All)
        };
        assert_eq!(order(&[(1, 5), (2, 1), (1, 6), (2, 2), (1, 6)]), (0, None));
        assert_eq!(order(&[(1, 5), (2, 1), (1, 4), (1, 6), (1, 5)]), (2, Some((2, 5))));
    }
}
