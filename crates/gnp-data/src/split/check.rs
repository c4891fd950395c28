//! No frame of a vehicle, and no driver, in two parts.

use std::collections::BTreeMap;

use super::{Split, SplitKind, Subset, frames_of, kind_of};
use crate::error::DataError;
use crate::overlap::{Drivers, Overlap};
use crate::recording::Recording;
use crate::window::WindowId;
use crate::windows::WindowSet;

impl Split {
    /// Checks that no window stands in two parts; at all sites but those of kind `window`, that no recorded frame of a target vehicle
    /// stands in two parts, that under `vehicle` all stretches of a vehicle are in one part, and
    /// under `recording` all windows of a recording and of those that overlap it, and under both all windows of a driver.
    ///
    /// # Errors
    /// [`DataError::SharedFrame`] with a vehicle that stands in two parts,
    /// [`DataError::SharedVehicles`] with two recordings that overlap and do, [`DataError::SharedDriver`] with a driver of
    /// two recordings who does,
    /// [`DataError::ForeignSplit`] when `set` does not hold the windows.
    pub fn check(&self, set: &WindowSet<'_>) -> Result<(), DataError> {
        self.check_windows(set)?;
        let mut whole: BTreeMap<(u32, Option<u32>), Subset> = BTreeMap::new();
        let mut spans: BTreeMap<(u32, u32), Vec<Span>> = BTreeMap::new();
        for part in Subset::ALL {
            for id in self.subset(part) {
                let recording = set.recording(*id).ok_or(DataError::ForeignSplit)?;
                let (first, last) = frames_of(set, *id).ok_or(DataError::ForeignSplit)?;
                let vehicle = recording.tracks()[id.track as usize].vehicle;
                let group = match kind_of(set, *id, &self.kinds) {
                    Some(SplitKind::Window) => continue,
                    Some(SplitKind::Recording) => Some(None),
                    Some(SplitKind::Vehicle) => Some(Some(vehicle)),
                    Some(SplitKind::Time) | None => None,
                };
                if group.is_some_and(|group| *whole.entry((id.recording, group)).or_insert(part) != part) {
                    return Err(shared(recording, vehicle, first));
                }
                spans.entry((id.recording, vehicle)).or_default().push((first, last, part));
            }
        }
        for ((recording, vehicle), mut spans) in spans {
            spans.sort_unstable();
            // A window that starts at or before the last frame of an earlier one shares that frame.
            let mut reached: [Option<u32>; 3] = [None; 3];
            for (first, last, part) in spans {
                let others = Subset::ALL.into_iter().filter(|other| *other != part);
                if others.filter_map(|other| reached[other as usize]).any(|reached| reached >= first) {
                    return Err(shared(&set.recordings()[recording as usize], vehicle, first));
                }
                let reached = &mut reached[part as usize];
                *reached = (*reached).max(Some(last));
            }
        }
        let part_of: BTreeMap<&str, Subset> = whole
            .iter()
            .filter(|((_, vehicle), _)| vehicle.is_none())
            .map(|((recording, _), part)| (set.recordings()[*recording as usize].meta().name.as_str(), *part))
            .collect();
        for Overlap { first, second, .. } in &self.overlaps {
            if let (Some(a), Some(b)) = (part_of.get(first.as_str()), part_of.get(second.as_str()))
                && a != b
            {
                return Err(DataError::SharedVehicles { first: first.clone(), second: second.clone() });
            }
        }
        self.check_drivers(set)
    }

    fn check_windows(&self, set: &WindowSet<'_>) -> Result<(), DataError> {
        let mut ids: Vec<WindowId> = Subset::ALL.iter().flat_map(|part| self.subset(*part)).copied().collect();
        ids.sort_unstable();
        let Some(twice) = ids.windows(2).find(|pair| pair[0] == pair[1]) else { return Ok(()) };
        let recording = set.recording(twice[0]).ok_or(DataError::ForeignSplit)?;
        let (frame, _) = frames_of(set, twice[0]).ok_or(DataError::ForeignSplit)?;
        Err(shared(recording, recording.tracks()[twice[0].track as usize].vehicle, frame))
    }

    fn check_drivers(&self, set: &WindowSet<'_>) -> Result<(), DataError> {
        let whole =
            |id: &&WindowId| matches!(kind_of(set, **id, &self.kinds), Some(SplitKind::Recording | SplitKind::Vehicle));
        let drivers = Drivers::of(set.recordings(), &self.overlaps);
        let mut seen: BTreeMap<usize, (Subset, WindowId)> = BTreeMap::new();
        for part in Subset::ALL {
            for id in self.subset(part).iter().filter(whole) {
                let Some(driver) = drivers.driver(id.recording as usize, id.track as usize) else { continue };
                let (first_part, first) = *seen.entry(driver).or_insert((part, *id));
                if first_part != part {
                    let of = |id: WindowId| {
                        let recording = &set.recordings()[id.recording as usize];
                        (recording.meta().name.clone(), recording.tracks()[id.track as usize].vehicle)
                    };
                    let ((first, vehicle), (second, other)) = (of(first), of(*id));
                    return Err(DataError::SharedDriver { first, vehicle, second, other });
                }
            }
        }
        Ok(())
    }
}

/// First and last frame of a window, and its part.
type Span = (u32, u32, Subset);

fn shared(recording: &Recording, vehicle: u32, frame: u32) -> DataError {
    DataError::SharedFrame { recording: recording.meta().name.clone(), vehicle, frame }
}
