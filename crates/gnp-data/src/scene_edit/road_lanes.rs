//! Lanes of a carriageway by their order, and where a vehicle is in them that no file gives a lane.

use crate::lanes::lane_at;
use crate::recording::{Recording, Track};

/// How the lanes of a carriageway are numbered. A *rank* is a lane's place in the order from the left, 1 leftmost; 0 where
/// it is unknown.
#[derive(Clone, Debug)]
pub(super) struct RoadLanes {
    /// Where the data names neighbours, lane numbers may grow to the left: then the highest number.
    highest_leftmost: Option<i16>,
    /// Rank of the leftmost lane between the lane lines, less 1.
    first: i16,
}

impl RoadLanes {
    /// Those of a carriageway, as the last rows of `tracks` show them.
    pub(super) fn of(recording: &Recording, road: u16) -> Self {
        let columns = recording.columns();
        let here = recording.tracks().iter().filter(|track| track.road == road);
        let known: Vec<(i16, f32)> = here
            .map(|track| (columns.lane[track.rows.end - 1], columns.y[track.rows.end - 1]))
            .filter(|(number, _)| *number > 0)
            .collect();
        let count = known.len().max(1) as f32;
        let mean_lane = known.iter().map(|(number, _)| f32::from(*number)).sum::<f32>() / count;
        let mean_y = known.iter().map(|(_, y)| *y).sum::<f32>() / count;
        let slope: f32 = known.iter().map(|(number, y)| (f32::from(*number) - mean_lane) * (y - mean_y)).sum();
        let highest = known.iter().map(|(number, _)| *number).max();
        let mut lanes =
            Self { highest_leftmost: highest.filter(|_| recording.lane_order.is_none() && slope > 0.), first: 0 };
        // Lanes that no line was fitted for come before those that have some.
        let lines = &recording.roads()[usize::from(road)].lines;
        let mut differences: Vec<i16> = known
            .iter()
            .map(|(number, y)| (lanes.rank(recording, *number), lane_at(lines, *y)))
            .filter(|(rank, between)| *rank > 0 && *between > 0)
            .map(|(rank, between)| rank - between)
            .collect();
        differences.sort_unstable();
        lanes.first = differences.get(differences.len() / 2).copied().unwrap_or(0);
        lanes
    }

    /// Rank of the lane that the data calls `number`.
    pub(super) fn rank(&self, recording: &Recording, number: i16) -> i16 {
        match (&recording.lane_order, self.highest_leftmost) {
            (Some(order), _) => order.get(&number).copied().unwrap_or(0),
            (None, Some(highest)) if number > 0 => highest - number + 1,
            _ => number,
        }
    }

    /// Rank of the last row of a track.
    pub(super) fn rank_of(&self, recording: &Recording, track: &Track) -> i16 {
        self.rank(recording, recording.columns().lane[track.rows.end - 1])
    }

    /// Rank of the lane at `y`, m, between the lines of carriageway `road`; `None` where that has no lines.
    pub(super) fn rank_at(&self, recording: &Recording, road: u16, y: f32) -> Option<i16> {
        let lines = &recording.roads()[usize::from(road)].lines;
        let between = lane_at(lines, y);
        (!lines.is_empty()).then(|| if between > 0 { (between + self.first).max(0) } else { 0 })
    }

    /// What the data calls the lane of a rank; where it has no such lane, the rank.
    pub(super) fn number(&self, recording: &Recording, rank: i16) -> i16 {
        match (&recording.lane_order, self.highest_leftmost) {
            (Some(order), _) => order.iter().find(|(_, of)| **of == rank).map_or(rank, |(number, _)| *number),
            (None, Some(highest)) if rank > 0 => highest - rank + 1,
            _ => rank,
        }
    }
}
