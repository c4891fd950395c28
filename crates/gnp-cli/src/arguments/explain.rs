//! Arguments of `explain`.

use std::path::PathBuf;

use clap::{ArgGroup, Args};
use gnp::AddedCar;
use gnp_data::Dataset;

use super::{MachineArgs, RoadArgs};
use crate::names::{Place, added, dataset, moved, place, speed};

/// What to explain, what to change, where to.
#[derive(Clone, Debug, Args)]
#[command(group = ArgGroup::new("of").args(["run", "input"]).required(true))]
pub struct ExplainArgs {
    /// The trained run, one of whose forecasts is explained.
    #[arg(long, value_name = "DIR")]
    pub(crate) run: Option<PathBuf>,
    /// Instead of a run: a file of tracks, or a folder of such files.
    #[arg(long, value_name = "PATH")]
    pub(crate) input: Option<PathBuf>,
    /// Model for the tracks: model folder, run folder, or name of one that comes with the program [default: ngsim].
    #[arg(long, value_name = "MODEL", requires = "input", conflicts_with = "run")]
    pub(crate) model: Option<PathBuf>,
    /// Format of the tracks [default: the one that fits].
    #[arg(long, value_parser = dataset, value_name = "NAME", requires = "input", conflicts_with = "run")]
    pub(crate) format: Option<Dataset>,
    /// On which road, of tracks.
    #[command(flatten)]
    pub(crate) road: RoadArgs,
    /// Recording of the vehicle [default: any].
    #[arg(long, value_name = "NAME")]
    pub(crate) recording: Option<String>,
    /// The vehicle, as its recording calls it [default: one that its leader moves far].
    #[arg(long, value_name = "VEHICLE")]
    pub(crate) vehicle: Option<String>,
    /// Of a run the last observed frame [default: of the vehicle's windows the one in which a leader moves it most]; of
    /// tracks the time, s [default: the last of the vehicle].
    #[arg(long, value_name = "FRAME|S", allow_hyphen_values = true)]
    pub(crate) at: Option<f64>,
    /// Leave a vehicle out of the scene; repeatable.
    #[arg(long, value_name = "VEHICLE")]
    pub(crate) without: Vec<String>,
    /// Give a vehicle another speed, such as 549=5 for 5 m/s; repeatable.
    #[arg(long, value_name = "VEHICLE=MPS", value_parser = speed)]
    pub(crate) speed: Vec<(String, f32)>,
    /// Put a vehicle elsewhere, such as 549=-10,3.5 for 10 m back and 3.5 m to the left, its past with it; repeatable.
    #[arg(long = "move", value_name = "VEHICLE=DX,DY", value_parser = moved)]
    pub(crate) moved: Vec<(String, [f32; 2])>,
    /// Add a car, such as 20,0,12 for one 20 m ahead of where the vehicle is, 0 m to the left, at 12 m/s; repeatable.
    #[arg(long, value_name = "X,Y,MPS", value_parser = added, allow_hyphen_values = true)]
    pub(crate) add: Vec<AddedCar>,
    /// Explain another vehicle of the changed scene, such as "new 1", the first that is added; places of --add and --goal
    /// still count from --vehicle.
    #[arg(long, value_name = "VEHICLE")]
    pub(crate) watch: Option<String>,
    /// Switch a term of the force off, such as neighbours; repeatable.
    #[arg(long, value_name = "NAME")]
    pub(crate) without_term: Vec<String>,
    /// Draw the vehicle to a place, m ahead and to the left of where it is, instead of where the network expects it.
    #[arg(long, value_name = "X,Y", value_parser = place, allow_hyphen_values = true)]
    pub(crate) goal: Option<Place>,
    /// Folder for the figures [default: in explain/ of the run folder; of tracks explain/]; figures there are replaced.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Print JSON, with every step, instead of the table.
    #[arg(long)]
    pub(crate) json: bool,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;

    #[derive(Debug, clap::Parser)]
    struct Cli {
        #[command(flatten)]
        args: ExplainArgs,
    }

    fn understood(words: &[&str]) -> Result<ExplainArgs, clap::Error> {
        Cli::try_parse_from([&["explain"], words].concat()).map(|cli| cli.args)
    }

    #[test]
    fn changes_of_a_scene_are_understood() {
        let line = "--run a --without 3 --without flow.4 --speed 5=2.5 --speed a=b=3 --goal -1.5,3 --move 6=-10,3.5 \
                    --add -20,0,12 --without-term lines";
        let args = understood(&line.split(' ').collect::<Vec<_>>()).unwrap();
        assert_eq!(args.without, ["3", "flow.4"]);
        assert_eq!(args.speed, [("5".to_owned(), 2.5), ("a=b".to_owned(), 3.)]);
        assert_eq!(args.goal, Some(Place([-1.5, 3.])));
        assert_eq!((args.moved, args.without_term), (vec![("6".to_owned(), [-10., 3.5])], vec!["lines".to_owned()]));
        assert_eq!(args.add, [AddedCar { at: [-20., 0.], speed_mps: 12. }]);
    }

    #[test]
    fn wrong_use_is_refused() {
        for line in [
            &["--vehicle", "3"][..],
            &["--run", "a", "--input", "b"],
            &["--run", "a", "--model", "b"],
            &["--run", "a", "--speed", "5=1e30"],
            &["--run", "a", "--goal", "1e30,0"],
            &["--run", "a", "--move", "5=1e30,0"],
            &["--run", "a", "--move", "5=1"],
            &["--run", "a", "--add", "1,2"],
            &["--run", "a", "--add", "1,2,-300"],
            &["--run", "a", "--speed", "5"],
            &["--run", "a", "--speed", "5=fast"],
            &["--run", "a", "--goal", "60"],
            &["--run", "a", "--goal", "60,left"],
            &["--run", "a", "--speed", "=5"],
            &["--run", "a", "--move", " =1,0"],
        ] {
            assert!(understood(line).is_err(), "{line:?}");
        }
    }
}
