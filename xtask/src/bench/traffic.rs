//! Made-up traffic of any length in NGSIM's file layout: twice as long is twice as many rows at the
//! same density, so that a cost that grows faster than the rows shows.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result};
use candle_core::Device;
use gnp_baselines::{Drivers, PlatoonRule};
use gnp_data::{Dataset, Expectation, Recording, WindowConfig, WindowSet, discover, read};
use gnp_model::{AugmentedView, Features, Situation};

use gnp::RunConfig;
use gnp::memory;

use crate::project;

const LANES: usize = 5;
/// Frames from one vehicle of a lane to the next.
const HEADWAY: usize = 30;
/// Frames that a vehicle takes to drive through.
const STAY: usize = 330;
/// Sets of windows held while memory is looked at.
const SETS: usize = 32;
const HEADER: &str = "Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,Global_X,Global_Y,v_Length,v_Width,\
                      v_Class,v_Vel,v_Acc,Lane_ID,Preceding,Following,Space_Headway,Time_Headway,Location";

/// A folder with one file of traffic, in which `vehicles` pass in each lane; and the file's rows.
///
/// # Errors
/// When it cannot be written.
pub(super) fn write(vehicles: usize) -> Result<(tempfile::TempDir, usize)> {
    let folder = tempfile::tempdir().context("cannot make a folder for the rows of the benchmark")?;
    fs::write(folder.path().join("made-up.csv"), text(vehicles)).context("cannot write the rows of the benchmark")?;
    Ok((folder, LANES * vehicles * STAY))
}

fn text(vehicles: usize) -> String {
    let mut text = format!("{HEADER}\n");
    for vehicle in 0..LANES * vehicles {
        let (lane, place) = (vehicle % LANES, vehicle / LANES);
        let first = place * HEADWAY + lane * 7;
        for i in 0..STAY {
            let (frame, time) = (first + i, i as f32 * 0.1);
            // ft: 12 ft a lane, a slow weave in it, 50 ft/s that vary a little.
            let x = 12. * (lane as f32 + 0.5) + 0.8 * (0.3 * time + vehicle as f32).sin();
            let y = 20. + 50. * time + 3. * (0.2 * time + vehicle as f32).sin();
            let global = 1_113_433_000_000 + 100 * frame as u64;
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{},{},{STAY},{global},{x:.3},{y:.3},0.0,0.0,15.0,6.0,2,50.0,0.0,{},0,0,0.0,0.0,i-80",
                vehicle + 1,
                frame + 1,
                lane + 1
            );
        }
    }
    text
}

/// Reads the recordings of a folder made by [`write()`].
///
/// # Errors
/// Those of the reader.
pub(super) fn ingest(folder: &Path) -> Result<Vec<Recording>> {
    let expect = Expectation { dataset: Dataset::NGSIM, rate_hz: Some(10.) };
    let mut recordings = Vec::new();
    for source in discover(folder, Dataset::NGSIM)? {
        recordings.extend(read(&source, &expect)?.into_iter().map(|(recording, _)| recording));
    }
    Ok(recordings)
}

/// Windows of 3 s + 5 s at 10 Hz, one every `stride_s`.
pub(super) fn windows(stride_s: f64) -> WindowConfig {
    let site_stride_s = std::collections::BTreeMap::new();
    WindowConfig { observed_s: 3., predicted_s: 5., rate_hz: 10., stride_s, site_stride_s }
}

/// Features fitted on the windows of `recordings`, as configured for NGSIM.
///
/// # Errors
/// Those of cutting and fitting.
pub(super) fn features(recordings: &[Recording]) -> Result<Features> {
    let (set, _) = WindowSet::cut(recordings, &windows(5.))?;
    let config = RunConfig::read(&project::root().join("configs/ngsim.toml"), &[])?.features;
    let seen: Vec<_> = set.iter().map(|window| window.observation()).collect();
    let platoon = PlatoonRule::of_drivers(Drivers::TYPICAL)?;
    Ok(Features::fit(&config, set.shape(), Some(&platoon), seen.into_iter())?)
}

/// Cuts all windows and turns them into network inputs, 64 at a time; returns their number.
///
/// # Errors
/// Those of cutting and of the features.
pub(super) fn cut_and_see(recordings: &[Recording], features: &Features) -> Result<usize> {
    let (set, _) = WindowSet::cut(recordings, &windows(1.))?;
    for ids in set.ids().chunks(64) {
        let situations: Vec<Situation<'_>> = ids
            .iter()
            .filter_map(|id| set.get(*id))
            .map(|window| features.situation(AugmentedView::recorded(window.observation())))
            .collect::<Result<_, _>>()?;
        features.goal_inputs(&situations, &Device::Cpu)?;
    }
    Ok(set.len())
}

/// Bytes by which the program grows for each window that is cut; `None` where the system does not tell.
///
/// # Errors
/// Those of cutting.
pub(super) fn bytes_a_window(recordings: &[Recording]) -> Result<Option<f64>> {
    let Some(before) = memory::now() else { return Ok(None) };
    // Many sets at a time, so that memory that was free before does not hide them.
    let sets: Vec<_> = (0..SETS).map(|_| Ok(WindowSet::cut(recordings, &windows(0.1))?.0)).collect::<Result<_>>()?;
    let Some(after) = memory::now() else { return Ok(None) };
    let windows: usize = sets.iter().map(WindowSet::len).sum();
    Ok(Some(after.saturating_sub(before) as f64 / windows as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_traffic_reads_as_it_was_written() -> Result<()> {
        let (folder, rows) = write(4)?;
        let recordings = ingest(folder.path())?;
        assert_eq!(recordings.iter().map(Recording::len).sum::<usize>(), rows);
        assert_eq!(recordings.iter().map(|r| r.tracks().len()).sum::<usize>(), 4 * LANES, "no gap, nothing lost");
        let features = features(&recordings)?;
        assert_eq!(cut_and_see(&recordings, &features)?, 4 * LANES * (STAY - 81).div_ceil(10));
        Ok(())
    }

    #[test]
    fn twice_the_vehicles_are_twice_the_rows() -> Result<()> {
        assert_eq!(write(6)?.1, 2 * write(3)?.1);
        assert_eq!(text(6).lines().count() - 1, 2 * (text(3).lines().count() - 1));
        Ok(())
    }
}
