//! A run's configuration: one TOML file, every key written, any key overridden on the command line.

mod keys;
mod ranges;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use crate::error::{Context as _, Error, Result, bail};
use gnp_data::{Dataset, SplitConfig, WindowConfig};
use gnp_eval::EvalConfig;
use gnp_file::excerpt;
use gnp_goal::GoalConfig;
use gnp_model::{FeatureConfig, NeighbourInput, Precision, ReferencePath, Representation, Selection, Trust};
use gnp_modes::ModeParams;
use gnp_train::{GoalTraining, PathTraining, TrainConfig};
use gnp_traj::TrajConfig;
use serde::{Deserialize, Serialize};
use toml::Table;

use self::keys::QUOTED;
pub use self::keys::Setting;
pub(crate) use self::keys::first_difference;

/// Writes every key: what is known is what stands in it.
const REFERENCE: &str = include_str!("../configs/smoke.toml");

/// The configurations that come with the project.
const EMBEDDED: [(&str, &str); 6] = [
    ("ngsim", include_str!("../configs/ngsim.toml")),
    ("highd", include_str!("../configs/highd.toml")),
    ("smoke", REFERENCE),
    ("pretrained/ngsim", include_str!("../configs/pretrained/ngsim.toml")),
    ("paper/ngsim", include_str!("../configs/paper/ngsim.toml")),
    ("paper/highd", include_str!("../configs/paper/highd.toml")),
];

/// The configuration of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunConfig {
    /// Kind of data.
    pub dataset: Dataset,
    /// Added to the seeds of modes and trainings, and draws the first weights; the split keeps its
    /// own, so that runs with other seeds are scored on the same windows.
    pub seed: u64,
    /// The recordings.
    pub data: DataConfig,
    /// How recordings are cut.
    pub windows: WindowConfig,
    /// How windows are parted.
    pub split: SplitConfig,
    /// How modes are searched.
    pub modes: ModeParams,
    /// How windows become numbers.
    pub features: FeatureConfig,
    /// The goal network and its training.
    pub goal: GoalSection,
    /// The social force's networks.
    pub traj: TrajConfig,
    /// Training of the attraction.
    pub attraction: PathSection,
    /// Training of the repulsion.
    pub repulsion: PathSection,
    /// How forecasts are made.
    pub predict: PredictConfig,
    /// How they are scored.
    pub evaluate: EvalConfig,
}

/// `[data]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataConfig {
    /// Frames per second that every recording must have.
    pub rate_hz: f64,
    /// Files or file groups to read, the first by name; 0 reads all.
    pub max_recordings: usize,
    /// File of the road's line, for tracks in a plane on a road that curves: `--road`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub road: Option<PathBuf>,
    /// Where lane lines lie beside that line, m, from right to left, positive to the left: `--lines`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lane_lines: Option<Vec<f64>>,
}

impl DataConfig {
    /// Replaces what is said of the road; a line from a file comes with the lane lines of that file unless others are given.
    pub fn set_road(&mut self, file: Option<PathBuf>, lane_lines: Option<Vec<f64>>) {
        if file.is_some() || lane_lines.is_some() {
            self.lane_lines = lane_lines;
        }
        self.road = file.or(self.road.take());
    }
}

/// `[goal]`: the network, what it learns, how it is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GoalSection {
    /// Form of the network.
    #[serde(flatten)]
    pub net: GoalConfig,
    /// Its loss and augmentation.
    #[serde(flatten)]
    pub loss: GoalTraining,
    /// The loop.
    #[serde(flatten)]
    pub train: TrainConfig,
}

/// `[attraction]` and `[repulsion]`: what is learned, and how.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PathSection {
    /// Noise and augmentation.
    #[serde(flatten)]
    pub loss: PathTraining,
    /// The loop.
    #[serde(flatten)]
    pub train: TrainConfig,
}

/// `[predict]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PredictConfig {
    /// Where neighbours are while the target is driven into the future.
    pub neighbours: NeighbourInput,
    /// Which goals are given when fewer are asked for than there are modes.
    pub selection: Selection,
    /// How much of what the network expects on average beyond the reference path is believed.
    pub trust: Trust,
    /// What the force's networks multiply in. Not written where it is f32, so that a run is what it was before there was a choice.
    #[serde(default, skip_serializing_if = "Precision::is_f32")]
    pub precision: Precision,
    /// Futures a window in `predictions.parquet`; one that a protocol of `[evaluate]` asks for.
    pub k: usize,
}

impl RunConfig {
    /// A configuration that comes with the project: `ngsim`, `highd`, `smoke`, `pretrained/ngsim`, `paper/ngsim` or
    /// `paper/highd`.
    ///
    /// # Errors
    /// When there is none of that name, or a setting cannot be used.
    pub fn embedded(name: &str, set: &[Setting]) -> Result<Self> {
        match EMBEDDED.iter().find(|(known, _)| *known == name) {
            Some((_, text)) => Self::parse(text, set).with_context(|| format!("configs/{name}.toml")),
            None => bail!(
                Config,
                "no configuration `{name}` comes with the program; give one with --config: a file, or one of {}, for a dataset \
                 as in --config ngsim --set dataset={name}",
                EMBEDDED.map(|(name, _)| name).join(", ")
            ),
        }
    }

    /// The configuration that a user names: one that comes with the project by its name, as for
    /// [`RunConfig::embedded`], or a file. A file of such a name is given as `./ngsim`.
    ///
    /// # Errors
    /// As [`RunConfig::embedded`] and [`RunConfig::read`]; where there is no such file the message says which names
    /// there are.
    pub fn named(name: &Path, set: &[Setting]) -> Result<Self> {
        let known = EMBEDDED.map(|(name, _)| name);
        match name.to_str().filter(|name| known.contains(name)) {
            Some(name) => Self::embedded(name, set),
            None if !name.exists() => {
                let stem = name.with_extension("");
                let meant = known.iter().find(|known| stem.ends_with(known)).map(|known| format!(" (here `{known}`?)"));
                bail!(
                    Config,
                    "there is no file {}; give one, or the name of a configuration that comes with the program: {}{}",
                    name.display(),
                    known.join(", "),
                    meant.unwrap_or_default()
                )
            }
            None => Self::read(name, set),
        }
    }

    /// Reads a file and applies settings.
    ///
    /// # Errors
    /// When there is no such file, it is not TOML, or a key is unknown, missing, of the wrong type or out of range.
    pub fn read(path: &Path, set: &[Setting]) -> Result<Self> {
        let text = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        Self::parse(&text, set).with_context(|| path.display().to_string())
    }

    /// As [`RunConfig::read`], of a text.
    pub(crate) fn parse(text: &str, set: &[Setting]) -> Result<Self> {
        let mut table: Table = text.parse().map_err(syntax)?;
        let reference: Table = REFERENCE.parse().map_err(syntax).context("the embedded configuration")?;
        keys::check(&table, &reference)?;
        ranges::check(&table)?;
        // First as written, so that an error of the file has its line.
        let mut config: Self = toml::from_str(text).map_err(syntax)?;
        for setting in set {
            keys::set(&mut table, setting)?;
            ranges::check(&table)
                .with_context(|| format!("--set {}={}", setting.key, excerpt(&setting.text, QUOTED)))?;
            let applied = Self::deserialize(table.clone()).map_err(syntax);
            config = applied.with_context(|| format!("--set {}={}", setting.key, excerpt(&setting.text, QUOTED)))?;
        }
        config.check()?;
        Ok(config)
    }

    /// The same with settings applied.
    ///
    /// # Errors
    /// When a setting cannot be used.
    pub fn with(&self, set: &[Setting]) -> Result<Self> {
        Self::parse(&self.to_toml()?, set)
    }

    /// Checks every value: of a file after its types, of a program's own configuration before it is used.
    ///
    /// # Errors
    /// Names the first key that is out of its range or does not go with another one.
    pub(crate) fn check(&self) -> Result<()> {
        ranges::check(&Table::try_from(self).context("the configuration has no TOML form")?)?;
        self.windows.shape_for(self.data.rate_hz).context("[windows]")?;
        self.split.check().context("[split]")?;
        self.modes.check().context("[modes]")?;
        self.features.check().context("[features]")?;
        self.goal.net.check().context("[goal]")?;
        self.goal.loss.check().context("[goal]")?;
        self.goal.train.check().context("[goal]")?;
        let following =
            self.traj.terms.iter().find(|term| ["free_road", "car_following"].contains(&term.name.as_str()));
        if let (Some(term), ReferencePath::Platoon) = (following, self.features.reference) {
            bail!(
                Config,
                "traj.terms: `{}` acts along the platoon's path already; leave it out, or set features.reference = \
                 \"constant_velocity\"",
                term.name
            );
        }
        self.traj.check().context("[traj]")?;
        for (name, section) in [("[attraction]", &self.attraction), ("[repulsion]", &self.repulsion)] {
            section.loss.check().context(name)?;
            section.train.check().context(name)?;
        }
        if self.features.representation == Representation::Position && self.predict.trust != Trust::Share(1.) {
            bail!(
                Config,
                "predict.trust = {}: with features.representation = \"position\" there is no reference to believe instead; \
                 set it to 1.0",
                self.predict.trust
            );
        }
        self.evaluate.check().context("[evaluate]")?;
        let asked: Vec<usize> = self.evaluate.protocols.iter().flat_map(|protocol| protocol.asks()).copied().collect();
        if !asked.contains(&self.predict.k) {
            let asked: BTreeSet<usize> = asked.into_iter().collect();
            bail!(
                Config,
                "predict.k = {}: the protocols of [evaluate] ask for {asked:?} futures; take one of these",
                self.predict.k
            );
        }
        Ok(())
    }

    /// The parts with the run's seed added to their own.
    pub(crate) fn seeded(&self) -> Self {
        let mut seeded = self.clone();
        let seeds = [
            &mut seeded.modes.seed,
            &mut seeded.goal.train.seed,
            &mut seeded.attraction.train.seed,
            &mut seeded.repulsion.train.seed,
        ];
        for seed in seeds {
            *seed = seed.wrapping_add(self.seed);
        }
        seeded
    }

    /// As TOML, for the run folder.
    ///
    /// # Errors
    /// When a value has no TOML form.
    pub fn to_toml(&self) -> Result<String> {
        let body = toml::to_string(self).context("the configuration has no TOML form")?;
        Ok(format!("# The configuration of this run: its file, then --set.\n{body}"))
    }

    /// Refuses to go on with a run with another configuration.
    ///
    /// # Errors
    /// Names the first key that differs, with both values.
    pub(crate) fn expect_same(&self, earlier: &Self, root: &Path) -> Result<()> {
        let table = |config: &Self| Table::try_from(config).context("the configuration has no TOML form");
        match keys::first_difference(&table(earlier)?, &table(self)?) {
            Some((key, then, now)) => Err(Error::Config(format!(
                "cannot resume {}: `{key}` is {now} and was {then}; resume without --config and --set, \
                 or take another --out",
                root.display()
            ))),
            None => Ok(()),
        }
    }
}

/// A TOML error without the trailing line break of its picture.
fn syntax(error: toml::de::Error) -> Error {
    Error::Config(error.to_string().trim_end().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_configuration_reads_and_survives_writing() {
        for (name, _) in EMBEDDED {
            let config = RunConfig::embedded(name, &[]).unwrap();
            let again = RunConfig::parse(&config.to_toml().unwrap(), &[]).unwrap();
            assert_eq!(again, config, "{name}");
        }
    }

    #[test]
    fn every_key_has_a_comment() {
        for (name, text) in EMBEDDED {
            for line in text.lines().filter(|line| line.contains(" = ") && !line.starts_with('#')) {
                assert!(line.contains(" # "), "{name}: {line}");
            }
        }
    }

    #[test]
    fn an_error_of_the_file_has_its_line() {
        let text = REFERENCE.replace("probability = \"", "probability = \"un");
        let message = RunConfig::parse(&text, &[]).unwrap_err().chain();
        assert!(message.contains("unknown variant"), "{message}");
        let message = RunConfig::parse("dataset = \n", &[]).unwrap_err().chain();
        assert!(message.contains("line 1"), "{message}");
    }

    #[test]
    fn unknown_keys_are_refused_with_their_path() {
        let text = REFERENCE.replace("\n[windows]", "\nepoch = 3\n[windows]");
        let message = RunConfig::parse(&text, &[]).unwrap_err().chain();
        assert!(message.contains("`data.epoch`"), "{message}");
    }

    /// Keys of earlier versions, in a file and on the command line.
    #[test]
    fn a_renamed_key_names_the_new_one() {
        for (before, now) in [
            ("goal.nobody", "goal.null_token"),
            ("goal.slot_code", "goal.slot_embedding"),
            ("attraction.stretch", "attraction.longitudinal_scale"),
            ("features.following_hint", "features.car_following_features"),
            ("repulsion.site_balance", "repulsion.site_sampling_exponent"),
            ("traj.code", "traj.latent_dim"),
            ("evaluate.part", "evaluate.subset"),
        ] {
            let set = RunConfig::parse(REFERENCE, &[format!("{before}=1").parse().unwrap()]).unwrap_err().chain();
            assert!(set.contains(&format!("`{before}` is now called `{now}`")), "{set}");
            let (table, last) = before.split_once('.').unwrap();
            let key = now.rsplit('.').next().unwrap();
            let text = REFERENCE.replacen(&format!("[{table}]"), &format!("[ {table} ]"), 1);
            let start = text.find(&format!("[ {table} ]")).unwrap();
            let text =
                text[..start].to_owned() + &text[start..].replacen(&format!("\n{key} ="), &format!("\n{last} ="), 1);
            let file = RunConfig::parse(&text, &[]).unwrap_err().chain();
            assert!(file.contains(&format!("`{before}` is now called `{now}`")), "{file}");
        }
    }

    #[test]
    fn settings_are_checked() {
        let parse = |text: &str| RunConfig::parse(REFERENCE, &[text.parse().unwrap()]);
        assert_eq!(parse("goal.epochs=3").unwrap().goal.train.epochs, 3);
        for (text, part) in [
            ("goal.epochs=0", "epochs"),
            ("goal.heads=3", "heads"),
            ("goal.probability=nobody", "--set goal.probability=nobody"),
            ("goal.epoch=3", "goal.epochs"),
            ("split.train=0.9", "train"),
            ("predict.k=3", "predict.k"),
            ("predict.trust=1.5", "predict.trust"),
            ("predict.precision=f16", "expected `f32` or `bf16`"),
            ("traj.terms=[{ name = \"free_road\", parameters = {} }]", "acts along the platoon's path already"),
            ("windows.rate_hz=3.0", "rate"),
            ("goal.schedule={kind=\"linear\"}", "goal.schedule"),
        ] {
            let message = parse(text).unwrap_err().chain();
            assert!(message.contains(part), "{text}: {message}");
        }
    }

    /// A run that was made before there was a choice is one in f32.
    #[test]
    fn a_precision_need_not_be_said() {
        let config = |set: &[Setting]| RunConfig::parse(REFERENCE, set).unwrap();
        let written = config(&[]).to_toml().unwrap();
        assert!(!written.contains("precision"));
        assert_eq!(RunConfig::parse(&written, &[]).unwrap(), config(&[]));
        let set = ["predict.precision=bf16".parse().unwrap()];
        let rounded = RunConfig::parse(&written, &set).unwrap();
        assert_eq!((&rounded, rounded.predict.precision), (&config(&set), Precision::Bf16));
        assert!(rounded.to_toml().unwrap().contains("precision = \"bf16\""));
    }

    #[test]
    fn another_configuration_is_told_apart() {
        let first = RunConfig::parse(REFERENCE, &[]).unwrap();
        let other = RunConfig::parse(REFERENCE, &["traj.hidden=12".parse().unwrap()]).unwrap();
        assert!(first.expect_same(&first, Path::new("runs/x")).is_ok());
        let message = other.expect_same(&first, Path::new("runs/x")).unwrap_err().to_string();
        assert!(message.contains("`traj.hidden` is 12"), "{message}");
    }

    #[test]
    fn the_run_seed_moves_all_but_the_split() {
        let one = RunConfig::parse(REFERENCE, &["seed=5".parse().unwrap()]).unwrap();
        let seeded = one.seeded();
        assert_eq!(seeded.goal.train.seed, one.goal.train.seed + 5);
        assert_eq!(seeded.split, one.split);
    }
}
