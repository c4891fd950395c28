//! The run and the configuration that a command line asks for.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use gnp::{Plan, RunConfig};

use crate::arguments::RunArgs;
use crate::program::Program;

/// The run that the command line names.
pub(crate) fn plan(args: &RunArgs, from: Option<&Path>, program: &Program) -> Result<Plan> {
    let out = |name: &str| args.out.clone().unwrap_or_else(|| program.run_folder(name));
    // Where nothing says what a run would be started from, there is one or none.
    if args.resume && args.config.is_none() && args.dataset.is_none() && from.is_none() {
        match &args.out {
            None => bail!("which run is to be resumed? give its folder: --out DIR"),
            Some(out) if !Plan::resume(out).is_started()? => bail!(
                "there is no run in {0} to resume; start one with --dataset NAME --out {0}, or give the folder of one",
                out.display()
            ),
            Some(_) => {}
        }
    }
    // A run is resumed with its own configuration, unless the command line says more than where it is and what it is of.
    if args.resume && args.config.is_none() && args.set.is_empty() && !args.road.any() {
        let there: Option<PathBuf> = match (&args.out, args.dataset) {
            (Some(out), _) => Some(out.clone()),
            (None, Some(dataset)) => Some(out(dataset.as_str())),
            (None, None) => None,
        };
        if let Some(place) = there {
            let mut plan = Plan::resume(place);
            plan.data.clone_from(&args.data_dir);
            plan.dataset = args.dataset;
            plan.from = from.map(Path::to_owned);
            if plan.is_started()? {
                return Ok(plan);
            }
        }
    }
    let (config, name) = resolve(args, from)?;
    let mut plan = Plan::new(config, args.data_dir.clone(), out(&name));
    plan.resume = args.resume;
    plan.from = from.map(Path::to_owned);
    Ok(plan)
}

/// The configuration that the command line asks for, and the name it gives a run: that of the run to start `from`
/// unless there is another one.
pub(crate) fn resolve(args: &RunArgs, from: Option<&Path>) -> Result<(RunConfig, String)> {
    let stem = |path: &Path| path.file_stem().map_or_else(|| "run".into(), |stem| stem.to_string_lossy().into_owned());
    let (mut config, name, shown) = match (&args.config, from, args.dataset) {
        (Some(path), ..) => {
            // `paper/ngsim` is another run than `ngsim`.
            let name = if path.is_file() { stem(path) } else { path.display().to_string().replace('/', "-") };
            (RunConfig::named(path, &args.set)?, name, path.display().to_string())
        }
        (None, Some(from), _) => {
            let path = from.join("config.toml");
            let name = format!("{}-tuned", stem(from));
            (RunConfig::read(&path, &args.set)?, name, path.display().to_string())
        }
        (None, None, Some(dataset)) => {
            let name = dataset.as_str();
            (RunConfig::embedded(name, &args.set)?, name.to_owned(), format!("configs/{name}.toml"))
        }
        (None, None, None) => bail!("which data? give --dataset ngsim or --dataset highd, or a --config"),
    };
    if let Some(asked) = args.dataset
        && asked != config.dataset
    {
        bail!("--dataset {asked} but {shown} is for {}", config.dataset);
    }
    let (road, lane_lines) = args.road.parts()?;
    config.data.set_road(road, lane_lines);
    Ok((config, name))
}
