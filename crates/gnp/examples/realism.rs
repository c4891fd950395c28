//! How real closed-loop traffic is: `realism [--data DIR] [--dataset NAME] [--run DIR]... [--sumo DIR] [--roll-outs N] [--out DIR]`.
use gnp::{Machine, RealismPlan, realism};
use gnp_data::Dataset;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut plan = RealismPlan::embedded(Dataset::NGSIM);
    let mut out = None;
    let mut arguments = std::env::args().skip(1);
    while let Some(name) = arguments.next() {
        let value = arguments.next().ok_or_else(|| format!("{name} needs a value"))?;
        match name.as_str() {
            "--data" => plan.data = Some(value.into()),
            "--dataset" => plan.dataset = value.parse()?,
            "--run" => plan.runs.push(value.into()),
            "--sumo" => plan.sumo = Some(value.into()),
            "--roll-outs" => plan.settings.roll_outs = value.parse()?,
            "--out" => out = Some(PathBuf::from(value)),
            _ => return Err(format!("there is no {name}").into()),
        }
    }
    let table = realism(&plan, &Machine::default())?;
    println!("{}", table.markdown());
    if let Some(out) = out {
        std::fs::create_dir_all(&out)?;
        std::fs::write(out.join("realism.md"), table.markdown())?;
        std::fs::write(out.join("realism.csv"), table.csv())?;
        std::fs::write(out.join("realism.json"), serde_json::to_string_pretty(&table)?)?;
    }
    Ok(())
}
