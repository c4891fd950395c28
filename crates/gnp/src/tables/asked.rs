//! What a comparison was asked for, and the file of its folder that says so.

use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use toml::{Table, Value};

use super::place::ASKED;
use super::recipes::Recipes;
use crate::config::RunConfig;
use crate::error::{Context as _, Error, Result, bail};
use crate::run::folder::write;
use crate::stages::Plan;

/// Version of the file.
const FORMAT: i64 = 1;

/// What a comparison is asked for.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct CompareRequest {
    /// Recordings, configuration of GNP, and folder of the table.
    pub plan: Plan,
    /// How neural baselines are trained; those without a recipe have no row.
    pub recipes: Recipes,
    /// Seeds that everything learned is trained with, from that of the configuration on.
    pub seeds: usize,
    /// How GNP as published is trained, where it has a row.
    pub published: Option<RunConfig>,
}

/// `table.toml`.
#[derive(Deserialize)]
struct Written {
    format: i64,
    seeds: usize,
    data_dir: Option<PathBuf>,
    config: Table,
    recipes: Table,
    published: Option<Table>,
}

impl CompareRequest {
    /// A table of one seed, without GNP as published.
    #[must_use]
    pub fn new(plan: Plan, recipes: Recipes) -> Self {
        Self { plan, recipes, seeds: 1, published: None }
    }

    /// Whether a folder says what it was prepared for.
    #[must_use]
    pub fn is_in(folder: &Path) -> bool {
        folder.join(ASKED).is_file()
    }

    /// What the prepared folder was asked for, to go on with.
    ///
    /// # Errors
    /// When the folder is not prepared or the file is damaged or of another version.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(ASKED);
        if !path.is_file() {
            bail!(
                Folder,
                "{0} is not a prepared table; prepare one with `gnp compare --plan --dataset NAME --out {0}`",
                folder.display()
            );
        }
        let text = fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let damaged = || {
            let path = path.display();
            format!(
                "{path} is damaged or of another version; remove it, and prepare again with the options it was made with"
            )
        };
        let Some(written) = text.split_once('\n').filter(|(head, rest)| *head == heading(rest)) else {
            bail!(Folder, "{}", damaged());
        };
        let parsed = toml::from_str(written.1).map_err(|error| Error::Config(error.to_string().trim_end().to_owned()));
        let written: Written = parsed.with_context(damaged)?;
        if written.format != FORMAT {
            bail!(Folder, "{} has format {}, this program has {FORMAT}", path.display(), written.format);
        }
        let config = |table: Table| RunConfig::parse(&table.to_string(), &[]).with_context(damaged);
        let mut plan = Plan::new(config(written.config)?, written.data_dir, folder);
        plan.resume = true;
        Ok(Self {
            plan,
            recipes: Recipes::parse_whole(&written.recipes.to_string()).with_context(damaged)?,
            seeds: written.seeds,
            published: written.published.map(config).transpose()?,
        })
    }

    /// Writes the file into the folder of the plan.
    ///
    /// # Errors
    /// When it cannot be written or a value has no TOML form.
    pub(super) fn write(&self, config: &RunConfig) -> Result<()> {
        let mut table = Table::new();
        let seeds = i64::try_from(self.seeds).unwrap_or(i64::MAX);
        table.insert("format".to_owned(), Value::Integer(FORMAT));
        table.insert("seeds".to_owned(), Value::Integer(seeds));
        if let Some(dir) = &self.plan.data {
            table.insert("data_dir".to_owned(), Value::String(dir.to_string_lossy().into_owned()));
        }
        table.insert("config".to_owned(), Value::Table(Table::try_from(config)?));
        table.insert("recipes".to_owned(), Value::Table(Table::try_from(&self.recipes)?));
        if let Some(published) = &self.published {
            table.insert("published".to_owned(), Value::Table(Table::try_from(published)?));
        }
        let folder = &self.plan.out;
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let text = table.to_string();
        write(&folder.join(ASKED), format!("{}\n{text}", heading(&text)).as_bytes())
    }
}

/// The first line of the file, with the checksum of the others.
fn heading(text: &str) -> String {
    let sum = gnp_file::sha256([text.as_bytes()]);
    format!("# What this table was asked for; its jobs read nothing else. SHA-256 of what follows: {sum}")
}
