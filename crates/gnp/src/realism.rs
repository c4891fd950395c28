//! How real closed-loop traffic is beside recordings: rules, fitted drivers, GNP and SUMO drive on from real scenes.
mod folds;
mod sumo;

use self::folds::Folds;
use crate::data::source::read_all;
use crate::error::{Context as _, Result, bail};
use crate::machine::Machine;
use crate::run::Run;
use crate::run::folder::{write, write_json};
use crate::text::COLUMNS;
use gnp_data::{Dataset, Recording, TrackOptions};
use gnp_force::{Driver, Mobil};
use gnp_simulation::SimulationError;
use gnp_simulation::drivers::{FitConfig, fit_drivers, fit_lane_changes};
use gnp_simulation::realism::{RealismSettings, Table, compare};
use gnp_simulation::replay::{
    ClosedLoop, ConstantVelocity, DrivenBy, Drivers, Learned, Replay, ReplaySettings, RuleDrivers,
};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

/// What is compared with what.
#[derive(Clone, Debug)]
pub struct RealismPlan {
    /// The recordings; without it, those that come with the project.
    pub data: Option<PathBuf>,
    /// Their kind.
    pub dataset: Dataset,
    /// Trained runs, as of `compare --folds`: every vehicle is driven by one that was not trained on it.
    pub runs: Vec<PathBuf>,
    /// Where scenes for SUMO are written to and its courses read from.
    pub sumo: Option<PathBuf>,
    /// How recordings are cut.
    pub replay: ReplaySettings,
    /// How often, and how far.
    pub settings: RealismSettings,
}

impl RealismPlan {
    /// The recordings of a kind that come with the project, without GNP and SUMO.
    #[must_use]
    pub fn embedded(dataset: Dataset) -> Self {
        Self {
            data: None,
            dataset,
            runs: Vec::new(),
            sumo: None,
            replay: ReplaySettings::default(),
            settings: RealismSettings::default(),
        }
    }
}

/// Lets every system drive on from the scenes of recordings, and scores them: site by site, what happened first.
///
/// Drivers are fitted to all recordings of a site; in a scene the drivers that are drawn and their medians are those of
/// vehicles that are not in it. The rule for lane changes and the unsteadiness are those of the site. With a folder for SUMO
/// its scenes are written there, and rows of SUMO appear once `xtask/peer/sumo_replay.py` has written its courses.
///
/// # Errors
/// When recordings cannot be read, a run cannot be used or was trained on another kind of recordings, or a vehicle was seen by
/// all runs.
pub fn realism(plan: &RealismPlan, machine: &Machine) -> Result<Table> {
    let mut sites: BTreeMap<(String, bool), Vec<Recording>> = BTreeMap::new();
    for recording in read_all(plan.dataset, plan.data.as_deref(), &TrackOptions::default(), machine)? {
        let site = (recording.meta().site.clone(), recording.meta().simulated);
        sites.entry(site).or_default().push(recording);
    }
    let runs = plan.runs.iter().map(|folder| Run::open(folder, machine)).collect::<Result<Vec<Run>>>()?;
    if let Some(run) = runs.iter().find(|run| run.config().dataset != plan.dataset) {
        bail!(Folder, "{} was trained on {}, not on {}", run.path().display(), run.config().dataset, plan.dataset);
    }
    let folds = if runs.is_empty() { None } else { Some(Folds::new(&runs)?) };
    let mut table = Table::default();
    let work = machine.work("realism", sites.len(), "sites");
    for (done, ((site, _), recordings)) in sites.iter().enumerate() {
        machine.stop.check()?;
        work.at(done as u64, site);
        table.rows.extend(of_site(plan, recordings, &runs, folds.as_ref(), machine)?.rows);
    }
    Ok(table)
}

/// Writes a table to a folder: `realism.md`, `realism.csv` and `realism.json`.
///
/// # Errors
/// When the folder cannot be written.
pub fn save_realism(table: &Table, out: &Path) -> Result<()> {
    fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    write(&out.join("realism.md"), table.markdown().as_bytes())?;
    write(&out.join("realism.csv"), table.csv().as_bytes())?;
    write_json(&out.join("realism.json"), table)
}

/// A few columns of a table, for the terminal.
#[must_use]
pub fn realism_text(table: &Table) -> String {
    let mut text = String::new();
    for rows in table.rows.chunk_by(|a, b| (&a.site, a.simulated) == (&b.site, b.simulated)) {
        let Some(first) = rows.first() else { continue };
        let simulated = if first.simulated { ", simulated" } else { "" };
        let (site, scenes, vehicles) = (&first.site, first.scenes, first.vehicles);
        let _ = writeln!(text, "\n{site}{simulated}: {scenes} scenes, {vehicles} scored vehicles");
        let horizons = first.horizons.iter().map(|it| format!("{:>7}", format!("{:.0} s", it.horizon_s)));
        let horizons: String = horizons.collect();
        let titles = format!("{horizons}{:>9}{:>9}", "realism", "contacts");
        let _ = writeln!(text, "{}", line("mean displacement, m, over the first", &titles));
        for row in rows {
            let name = format!("{}{}", row.system, if row.uses_future { " *" } else { "" });
            let ade: String = row.horizons.iter().map(|it| format!("{:7.2}", it.ade.mean)).collect();
            let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"));
            let (realism, contacts) = (number(row.realism.map(|it| it.mean)), number(row.contacts_per_vehicle_h));
            let _ = writeln!(text, "{}", line(&name, &format!("{ade}{realism:>9}{contacts:>9}")));
        }
    }
    text.push_str(
        "\nContacts: of driven vehicles, a vehicle-hour.\n* uses what the vehicles did after the start: no forecast\n",
    );
    text
}

/// A line of the table; a name that is too long for it stands above.
fn line(name: &str, numbers: &str) -> String {
    let room = COLUMNS.saturating_sub(numbers.chars().count());
    if name.chars().count() <= room {
        format!("{name:<room$}{numbers}")
    } else {
        format!("{name}\n{:room$}{numbers}", "")
    }
}

/// The rows of a site.
fn of_site(
    plan: &RealismPlan,
    recordings: &[Recording],
    runs: &[Run],
    folds: Option<&Folds>,
    machine: &Machine,
) -> Result<Table> {
    let mut replays = Vec::new();
    for recording in recordings {
        replays.extend(Replay::all(recording, &plan.replay)?);
    }
    let shared_vehicles = recordings.len() > 1 && plan.dataset == Dataset::NGSIM;
    let traffic = fit_drivers(recordings, &FitConfig { shared_vehicles, ..FitConfig::default() })?;
    let changes = fit_lane_changes(recordings, &traffic)?.mobil;
    let fitted: Vec<(u32, Driver<f64>)> = traffic.drivers().iter().map(|(key, it)| (key.vehicle, it.driver)).collect();
    let noise = traffic.noise();
    let unsteady = |driver: &Driver<f64>| DrivenBy { noise, ..DrivenBy::from(*driver) };
    let drawn: Vec<(u32, DrivenBy)> = fitted.iter().map(|(vehicle, driver)| (*vehicle, unsteady(driver))).collect();
    let steady = fitted.iter().map(|(vehicle, driver)| (*vehicle, (*driver).into())).collect();
    let own: BTreeMap<u32, DrivenBy> = fitted.iter().map(|(vehicle, driver)| (*vehicle, (*driver).into())).collect();
    let typical = traffic.typical(gnp_data::VehicleClass::Car);
    let standard = DrivenBy::from(Driver::motorway());
    let median = RuleDrivers::new("IDM, medians of other drivers", Drivers::Median(fitted.clone()));
    let of_rules = [
        RuleDrivers::new("IDM, standard", Drivers::Same(standard)),
        RuleDrivers::new("IDM, standard, MOBIL", Drivers::Same(standard)).changing_lanes(Mobil::standard()),
        RuleDrivers::new("motorway rule", Drivers::Same(DrivenBy::motorway_rule())),
        median.clone(),
        RuleDrivers::new("IDM, other drivers drawn, unsteady", Drivers::Drawn(drawn.clone())),
        RuleDrivers::new("IDM, others who fit the past, unsteady, MOBIL fitted", Drivers::Matched(drawn.clone()))
            .changing_lanes(changes),
        RuleDrivers::new("IDM, others who fit the past, unsteady", Drivers::Matched(drawn.clone())),
        RuleDrivers::new("IDM, others who fit the past", Drivers::Matched(steady)),
        RuleDrivers::new("IDM, his own driver", Drivers::Own(own, typical.into())),
    ];
    let is_a_sample = replays.iter().any(|replay| replay.scene().is_a_sample);
    let mut systems: Vec<&dyn ClosedLoop> = vec![&ConstantVelocity];
    // In a sample of the traffic nobody changes lanes: the rows would be the same.
    let rules = of_rules.iter().filter(|rules| !is_a_sample || rules.lane_change.is_none());
    systems.extend(rules.map(|rules| rules as &dyn ClosedLoop));
    let imported = match &plan.sumo {
        Some(folder) => sumo::exchange(folder, &replays, &median, machine)?,
        None => Vec::new(),
    };
    systems.extend(imported.iter().map(|sumo| sumo as &dyn ClosedLoop));
    let rate = recordings.first().map_or(1.0, |recording| recording.meta().rate_hz);
    let learned: Vec<Learned<'_>> = match (folds, runs.first()) {
        (Some(folds), Some(run)) => {
            let shape = run.config().windows.shape_for(rate)?;
            let until = DrivenBy::from(typical);
            let likeliest = Learned::new("GNP, its prediction", folds, shape, false, until);
            vec![likeliest, Learned::new("GNP, drawn", folds, shape, true, until)]
        }
        _ => Vec::new(),
    };
    systems.extend(learned.iter().map(|learned| learned as &dyn ClosedLoop));
    let replays: Vec<Replay> = replays.into_iter().filter(|replay| replay.scene().frames as f64 >= rate).collect();
    compare(&replays, &systems, &plan.settings).map_err(|error: SimulationError| error.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_below_each_other_at_the_end_of_eighty_columns() {
        let numbers = "   0.41   1.62    0.71     0.00";
        for (name, lines) in [("drivers", 1), ("drivers of the intelligent driver model, fitted to other vehicles", 2)]
        {
            let text = line(name, numbers);
            assert_eq!(text.lines().count(), lines, "{text}");
            let last = text.lines().last().unwrap();
            assert!(last.chars().count() == COLUMNS && last.ends_with(numbers), "{text}");
        }
    }
}
