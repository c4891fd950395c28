//! The time-space diagram: the busiest minute of the busiest lane of the longest recording.

use std::collections::BTreeMap;

use crate::error::Result;
use gnp_data::{Predictor as _, Recording};
use gnp_plot::{Figure, LongitudinalForecast, SpaceTime, Trace, space_time};

use super::Material;

/// Time shown, s.
pub(crate) const SHOWN_S: f64 = 60.;
/// Time between points of a line, s.
const POINT_S: f64 = 0.5;
/// Time between forecasts of a vehicle, s.
const APART_S: f64 = 10.;
/// Most forecasts.
const MOST: usize = 24;

/// A stretch of time in one lane of a carriageway.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Lane {
    /// Index of the carriageway.
    pub(crate) road: u16,
    lane: i16,
    /// First frame of the time.
    pub(crate) first_frame: u32,
}

pub(super) fn time_space(material: &Material<'_>) -> Result<Option<Figure>> {
    let tested = |i: usize| material.ids.iter().any(|id| id.recording as usize == i);
    let Some((index, lane)) = busiest_of(material.recordings, tested) else { return Ok(None) };
    let recording = &material.recordings[index];
    let rate = recording.meta().rate_hz;
    let shown = (SHOWN_S * rate) as u32;
    let seconds = |frame: u32| f64::from(frame - lane.first_frame) / rate;
    let mut traces = Vec::new();
    for track in recording.tracks().iter().filter(|track| track.road == lane.road) {
        let mut points = Vec::new();
        for row in track.rows.clone() {
            let frame = track.first_frame + (row - track.rows.start) as u32;
            let inside = (lane.first_frame..lane.first_frame + shown).contains(&frame);
            if !inside || recording.columns().lane[row] != lane.lane {
                flush(&mut points, &mut traces);
            } else if frame.is_multiple_of((POINT_S * rate) as u32) {
                points.push([seconds(frame), f64::from(recording.columns().x[row])]);
            }
        }
        flush(&mut points, &mut traces);
    }
    let title = format!(
        "{}, lane {}, from frame {}, driving direction {}",
        recording.meta().name,
        lane.lane,
        lane.first_frame,
        recording.roads()[usize::from(lane.road)].driving_direction
    );
    let forecasts = forecasts(material, index, lane, shown)?;
    Ok(Some(space_time(&SpaceTime { title, traces, forecasts }, &material.source)))
}

/// The longest of the recordings that count, and its busiest lane and time.
pub(crate) fn busiest_of(recordings: &[Recording], counts: impl Fn(usize) -> bool) -> Option<(usize, Lane)> {
    let counting = (0..recordings.len()).filter(|i| counts(*i));
    let index = counting.max_by_key(|i| (frames(&recordings[*i]), std::cmp::Reverse(*i)))?;
    let recording = &recordings[index];
    Some((index, busiest(recording, (SHOWN_S * recording.meta().rate_hz) as u32)?))
}

fn flush(points: &mut Vec<[f64; 2]>, traces: &mut Vec<Trace>) {
    let points = std::mem::take(points);
    if points.len() > 1 {
        traces.push(Trace { points });
    }
}

fn frames(recording: &Recording) -> u32 {
    let first = recording.tracks().iter().map(|track| track.first_frame).min().unwrap_or(0);
    recording.tracks().iter().map(gnp_data::Track::last_frame).max().unwrap_or(0) - first
}

/// The lane and time with the most rows; times begin at every tenth second.
fn busiest(recording: &Recording, shown: u32) -> Option<Lane> {
    let step = (10. * recording.meta().rate_hz) as u32;
    let mut rows: BTreeMap<Lane, u64> = BTreeMap::new();
    for track in recording.tracks() {
        for row in track.rows.clone() {
            let frame = track.first_frame + (row - track.rows.start) as u32;
            let bin = frame / step;
            for back in 0..(shown / step).max(1) {
                let Some(bin) = bin.checked_sub(back) else { break };
                let lane = Lane { road: track.road, lane: recording.columns().lane[row], first_frame: bin * step };
                *rows.entry(lane).or_default() += 1;
            }
        }
    }
    rows.into_iter().max_by(|a, b| a.1.cmp(&b.1).then(b.0.cmp(&a.0))).map(|(lane, _)| lane)
}

/// Forecasts of evaluated windows in that lane and time, not too close for one vehicle.
fn forecasts(material: &Material<'_>, index: usize, lane: Lane, shown: u32) -> Result<Vec<LongitudinalForecast>> {
    let recording = &material.recordings[index];
    let rate = recording.meta().rate_hz;
    let mut last: BTreeMap<u32, u32> = BTreeMap::new();
    let mut chosen = Vec::new();
    for id in material.ids.iter().filter(|id| id.recording as usize == index) {
        let Some(window) = material.set.get(*id) else { continue };
        let seen = window.observation();
        let (frame, road) = (seen.frame(), recording.tracks()[id.track as usize].road);
        let far = last.get(&id.track).is_none_or(|last| f64::from(frame - last) >= APART_S * rate);
        let inside = (lane.first_frame..lane.first_frame + shown).contains(&frame);
        if inside && far && road == lane.road && seen.lane() == lane.lane {
            last.insert(id.track, frame);
            chosen.push(seen);
        }
    }
    // More would hide the vehicles.
    let chosen: Vec<_> = chosen.iter().copied().step_by(chosen.len().div_ceil(MOST).max(1)).collect();
    let found = material.gnp.predict(&chosen, 1)?;
    let mut forecasts = Vec::with_capacity(found.len());
    for (seen, forecast) in chosen.iter().zip(found) {
        let (start, x) = (f64::from(seen.frame() - lane.first_frame) / rate, f64::from(seen.origin()[0]));
        let dt = seen.shape().dt();
        let Some(mode) = forecast.modes.first() else { continue };
        let path = mode.path.iter().enumerate().map(|(j, p)| [start + (j + 1) as f64 * dt, x + f64::from(p[0])]);
        let mut points = vec![[start, x]];
        points.extend(path.skip(4).step_by(5));
        forecasts.push(LongitudinalForecast { points });
    }
    Ok(forecasts)
}
