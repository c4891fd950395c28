//! What ingest found in a recording, besides the recording.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::dataset::Dataset;
use crate::recording::Recording;

/// Speed between two frames above which a row counts as a jump, m/s.
pub const JUMP_SPEED: f64 = 70.;

/// Acceleration above which a row counts as a jump, m/s²: about what tyres can transmit. It is the
/// second difference of positions half a second apart, because over single frames the noise of
/// NGSIM alone exceeds it.
pub const JUMP_ACCELERATION: f64 = 10.;

/// Time over which an acceleration is differenced for [`JUMP_ACCELERATION`], s.
const JUMP_SPAN: f64 = 0.5;

/// Longest time between leaving a lane number and coming back to it that counts as a flip, s.
const FLIP_SPAN: f64 = 1.;

/// Where the lane lines of a recording come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LaneSource {
    /// Markings of the data.
    Given,
    /// Fitted from lane numbers and lateral positions.
    Fitted,
    /// No lane numbers, hence no lines.
    Absent,
}

/// The report on one recording: what was read, what was dropped and why, what looks wrong.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct IngestReport {
    /// Name of the recording.
    pub recording: String,
    /// Site of the recording.
    pub site: String,
    /// Data family.
    pub dataset: Dataset,
    /// Frames per second.
    pub rate_hz: f64,
    /// Made by a simulator.
    pub simulated: bool,
    /// Rows in the file for this recording.
    pub rows_read: u64,
    /// Rows kept.
    pub rows: u64,
    /// Vehicles.
    pub vehicles: u64,
    /// Gap-free tracks: vehicles plus gaps.
    pub tracks: u64,
    /// First and last frame with a vehicle in it.
    pub frames: [u32; 2],
    /// Dropped rows that repeat an earlier row of the same vehicle and frame in every value.
    pub duplicates: u64,
    /// Dropped rows that contradict an earlier row of the same vehicle and frame.
    pub conflicts: u64,
    /// Rows that stood after a later frame of their vehicle and were put in order.
    pub out_of_order: u64,
    /// Places where a vehicle is absent for a frame or more; each starts a new track.
    pub gaps: u64,
    /// Rows with a jump: faster than [`JUMP_SPEED`] from the frame before, or an acceleration above
    /// [`JUMP_ACCELERATION`]. They are kept.
    pub jumps: u64,
    /// The bounds that define a jump: m/s, m/s².
    pub jump_bounds: [f64; 2],
    /// Pairs of boxes that overlap, summed over frames.
    pub overlaps: u64,
    /// Changes of lane number that are undone within 1 s.
    pub lane_flips: u64,
    /// Neighbour ids of the file that name a vehicle absent in that frame; the slot is left empty.
    pub unknown_neighbours: u64,
    /// Rows whose vehicle ahead is known from that row alone: it is named with its distance and has no row of its own.
    #[serde(default)]
    pub named_leaders: u64,
    /// Rows that name a vehicle ahead which is not taken from there, by reason.
    #[serde(default)]
    pub leaders_not_taken: BTreeMap<String, u64>,
    /// Vehicles left out because what the files say of them cannot be true at once, by what. Their rows count as read.
    #[serde(default)]
    pub vehicles_left_out: BTreeMap<String, u64>,
    /// What else in the files contradicts itself: how many rows, vehicles or names, by what and what was done.
    #[serde(default)]
    pub contradictions: BTreeMap<String, u64>,
    /// Rows of the file that belong to no recording, by reason. Counted with the first recording of
    /// the file.
    pub skipped_rows: BTreeMap<String, u64>,
    /// Where the lane lines come from.
    pub lanes: LaneSource,
    /// Lane lines, over all carriageways.
    pub lane_lines: u64,
    /// Anything else worth knowing.
    pub notes: Vec<String>,
}

impl IngestReport {
    /// Everything that can be counted on a finished recording; what only the reader knows is zero.
    #[must_use]
    pub fn of(recording: &Recording) -> Self {
        let meta = recording.meta();
        let lines: usize = recording.roads().iter().map(|road| road.lines.len()).sum();
        let fitted = recording.roads().iter().any(|road| road.fitted);
        let mut vehicles: Vec<u32> = recording.tracks().iter().map(|track| track.vehicle).collect();
        vehicles.dedup();
        let first = recording.tracks().iter().map(|track| track.first_frame).min().unwrap_or(0);
        let last = recording.tracks().iter().map(|track| track.last_frame()).max().unwrap_or(0);
        Self {
            recording: meta.name.clone(),
            site: meta.site.clone(),
            dataset: meta.dataset,
            rate_hz: meta.rate_hz,
            simulated: meta.simulated,
            rows_read: recording.len() as u64,
            rows: recording.len() as u64,
            vehicles: vehicles.len() as u64,
            tracks: recording.tracks().len() as u64,
            frames: [first, last],
            duplicates: 0,
            conflicts: 0,
            out_of_order: 0,
            gaps: (recording.tracks().len() - vehicles.len()) as u64,
            jumps: jumps(recording),
            jump_bounds: [JUMP_SPEED, JUMP_ACCELERATION],
            overlaps: overlaps(recording),
            lane_flips: lane_flips(recording),
            unknown_neighbours: 0,
            named_leaders: recording.columns().named_leader.iter().flatten().filter(|named| named.vehicle != 0).count()
                as u64,
            leaders_not_taken: BTreeMap::new(),
            vehicles_left_out: BTreeMap::new(),
            contradictions: BTreeMap::new(),
            skipped_rows: BTreeMap::new(),
            lanes: match (lines, fitted) {
                (0, _) => LaneSource::Absent,
                (_, true) => LaneSource::Fitted,
                (_, false) => LaneSource::Given,
            },
            lane_lines: lines as u64,
            notes: Vec::new(),
        }
    }

    /// What is not a column of a table: rows, vehicles and neighbours left out, contradictions, vehicles ahead, notes; a sentence
    /// each.
    #[must_use]
    pub fn remarks(&self) -> Vec<String> {
        let many = |n: u64, one: &str| if n == 1 { format!("1 {one}") } else { format!("{n} {one}s") };
        let skipped = self.skipped_rows.iter();
        let mut remarks: Vec<String> =
            skipped.map(|(reason, rows)| format!("{} left out: {reason}", many(*rows, "row"))).collect();
        remarks.extend(self.vehicles_left_out.iter().map(|(why, n)| match n {
            1 => format!("1 vehicle left out, of those that {why}"),
            n => format!("{n} vehicles left out: they {why}"),
        }));
        remarks.extend(self.contradictions.iter().map(|(what, n)| format!("{n} {what}")));
        match self.unknown_neighbours {
            0 => {}
            1 => remarks.push("1 neighbour named has no row in the frame: not taken".to_owned()),
            n => remarks.push(format!("{n} neighbours named have no row in the frame: not taken")),
        }
        if self.named_leaders > 0 {
            remarks.push(format!("{} rows tell a vehicle ahead that has no row of its own", self.named_leaders));
        }
        let not_taken = self.leaders_not_taken.iter();
        remarks.extend(
            not_taken.map(|(reason, rows)| format!("{rows} rows name a vehicle ahead not taken from there: {reason}")),
        );
        remarks.extend(self.notes.iter().cloned());
        remarks
    }

    /// What a table of recordings has in columns: rows that came twice; a sentence each. For who shows no table.
    #[must_use]
    pub fn repeated_rows(&self) -> Vec<String> {
        let rows = |n: u64| if n == 1 { "1 row tells".to_owned() } else { format!("{n} rows tell") };
        let duplicates = format!("{} of a vehicle and time again what another one tells", rows(self.duplicates));
        let conflicts = format!(
            "{} of a vehicle and time something else than an earlier one, which is taken",
            rows(self.conflicts)
        );
        let said = [(self.duplicates, duplicates), (self.conflicts, conflicts)];
        said.into_iter().filter_map(|(count, sentence)| (count > 0).then_some(sentence)).collect()
    }
}

/// Rows faster than [`JUMP_SPEED`] or accelerating above [`JUMP_ACCELERATION`].
fn jumps(recording: &Recording) -> u64 {
    let rate = recording.meta().rate_hz;
    let c = recording.columns();
    let span = ((JUMP_SPAN * rate).round() as usize).max(1);
    let far = (JUMP_SPEED / rate).powi(2) as f32;
    let hard = (JUMP_ACCELERATION * (span as f64 / rate).powi(2)).powi(2) as f32;
    let mut count = 0;
    for track in recording.tracks() {
        let (x, y) = (&c.x[track.rows.clone()], &c.y[track.rows.clone()]);
        for i in 1..x.len() {
            let jump = (x[i] - x[i - 1]).powi(2) + (y[i] - y[i - 1]).powi(2) > far;
            let pulled = i >= span && i + span < x.len() && {
                let ax = x[i + span] - 2. * x[i] + x[i - span];
                let ay = y[i + span] - 2. * y[i] + y[i - span];
                ax * ax + ay * ay > hard
            };
            count += u64::from(jump || pulled);
        }
    }
    count
}

/// Pairs of overlapping boxes on one carriageway, summed over frames.
fn overlaps(recording: &Recording) -> u64 {
    use rayon::prelude::*;

    let tracks = recording.tracks();
    let Some(first) = tracks.iter().map(|track| track.first_frame).min() else { return 0 };
    let last = tracks.iter().map(|track| track.last_frame()).max().unwrap_or(first);
    let longest = tracks.iter().map(|track| track.length).fold(0f32, f32::max);
    let c = recording.columns();
    (first..=last)
        .into_par_iter()
        .map_init(Vec::new, |boxes: &mut Vec<(u16, f32, f32, f32, f32)>, frame| {
            boxes.clear();
            for track in recording.present(frame) {
                let track = &tracks[*track as usize];
                let Some(row) = track.row_at(frame) else { continue };
                boxes.push((track.road, c.x[row], c.y[row], track.length / 2., track.width / 2.));
            }
            boxes.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
            let mut count = 0;
            for (i, a) in boxes.iter().enumerate() {
                for b in &boxes[i + 1..] {
                    if b.0 != a.0 || b.1 - a.1 >= longest {
                        break;
                    }
                    count += u64::from(b.1 - a.1 < a.3 + b.3 && (b.2 - a.2).abs() < a.4 + b.4);
                }
            }
            count
        })
        .sum()
}

/// Lane numbers left and taken up again within [`FLIP_SPAN`].
fn lane_flips(recording: &Recording) -> u64 {
    let within = (FLIP_SPAN * recording.meta().rate_hz).round() as usize;
    let mut count = 0;
    for track in recording.tracks() {
        let lane = &recording.columns().lane[track.rows.clone()];
        // Lane before the last change, and where that change was.
        let mut before: Option<(i16, usize)> = None;
        for i in 1..lane.len() {
            if lane[i] == lane[i - 1] {
                continue;
            }
            match before {
                Some((from, at)) if from == lane[i] && i - at <= within => {
                    count += 1;
                    before = None;
                }
                _ => before = Some((lane[i - 1], i)),
            }
        }
    }
    count
}
