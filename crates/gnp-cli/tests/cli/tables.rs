//! Tables of all systems and of ablations, and other people's predictions, with tiny networks.

use std::fs;
use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;

use crate::program::{data, names, root, run, smoke};

const SCENES: [&str; 2] = ["ngsim/us101-13_1.csv.gz", "ngsim/us101-24_1.csv.gz"];

fn json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

fn strings(value: &Value) -> Vec<&str> {
    value.as_array().unwrap().iter().map(|item| item.as_str().unwrap()).collect()
}

/// Windows in a part of a saved split.
fn windows_of(split: &Value, part: &str) -> u64 {
    let tracks = split[part].as_object().unwrap().values().flat_map(|tracks| tracks.as_array().unwrap());
    tracks.map(|track| track["t0"].as_array().unwrap().len() as u64).sum()
}

/// Three of the recipes that come with the project, over in a moment.
fn recipes(folder: &Path) -> String {
    let mut recipes: toml::Table =
        fs::read_to_string(root().join("configs/neural-baselines.toml")).unwrap().parse().unwrap();
    recipes.retain(|stem, _| ["shared", "column_network", "s_lstm", "cs_lstm_m"].contains(&stem));
    for (_, recipe) in recipes.iter_mut() {
        let recipe = recipe.as_table_mut().unwrap();
        for (key, value) in [("steps", 2), ("networks", 1), ("epochs", 1)] {
            if let Some(kept) = recipe.get_mut(key) {
                *kept = value.into();
            }
        }
    }
    // One network in each form of output.
    for (stem, form) in [("s_lstm", "published"), ("cs_lstm_m", "deviation")] {
        recipes[stem].as_table_mut().unwrap().insert("forms".to_owned(), vec![form].into());
    }
    let path = folder.join("recipes.toml");
    fs::write(&path, recipes.to_string()).unwrap();
    path.to_str().unwrap().to_owned()
}

fn arguments<'a>(command: &'a str, data: &'a Path, out: &'a Path, config: &'a Path, more: &[&'a str]) -> Vec<&'a str> {
    let mut arguments = vec![command, "--config", config.to_str().unwrap(), "--data-dir", data.to_str().unwrap()];
    arguments.extend(["--out", out.to_str().unwrap()]);
    arguments.extend(more);
    arguments
}

#[test]
fn every_system_is_trained_once_and_scored_on_the_same_windows() {
    let (data, out, config) = (data(&SCENES), TempDir::new().unwrap(), smoke());
    let (place, recipes) = (out.path().join("table"), recipes(out.path()));
    let table1 = |more: &[&str]| {
        let more: Vec<&str> = ["--recipes", &recipes].into_iter().chain(more.iter().copied()).collect();
        run(&arguments("table1", data.path(), &place, &config, &more))
    };
    let first = table1(&[]).well();
    for part in ["table1: fold-1/s_lstm/seed-0 started", "table1: fold-1/s_lstm/seed-0 done in ", ", 4 of 4"] {
        assert!(first.err.contains(part), "{}", first.err);
    }
    let figures = names(&place).into_iter().filter(|name| name.contains("error-by-horizon")).count();
    assert!(figures >= 2 && figures.is_multiple_of(2), "as SVG and as PNG: {:?}", names(&place));
    let others: Vec<String> = names(&place).into_iter().filter(|name| !name.contains("error-by-horizon")).collect();
    let tables = ["table.toml", "table1.csv", "table1.json", "table1.md"];
    assert_eq!(others, [&["differences.json", "gnp", "jobs", "learned"][..], &tables].concat());
    let content = json(&place.join("table1.json"));
    let blind = ["gnp", "goal head", "constant velocity", "constant acceleration", "Kalman filter", "IDM", "platoon"];
    let learned = ["column network", "S-LSTM", "CS-LSTM(M) + platoon"];
    assert_eq!(strings(&content["systems"]), [&blind[..], &learned].concat());
    assert!(strings(&content["missing"]).iter().any(|text| text.starts_with("CS-LSTM: has no recipe")));
    let test = content["windows"].as_u64().unwrap();
    for score in content["scores"].as_array().unwrap() {
        // These do not apply to every window.
        let partial = ["off_road", "lane_change_recall", "lane_change_recall_under_way"];
        let whole = score["manoeuvre"].is_null() && !partial.contains(&score["metric"].as_str().unwrap());
        assert!(!whole || score["windows"] == test, "{score}");
    }
    assert!(content["differences"].as_array().unwrap().iter().all(|row| row["a"] == "gnp"));

    let markdown = fs::read_to_string(place.join("table1.md")).unwrap();
    for part in
        ["protocol clean", "keep: IDM", "gnp minus", "printed, not re-run", "*1.86/3.91/1.59*", "CS-LSTM: has no"]
    {
        assert!(markdown.contains(part), "no `{part}` in:\n{markdown}");
    }
    let csv = fs::read_to_string(place.join("table1.csv")).unwrap();
    assert!(csv.lines().all(|line| line.matches(',').count() >= 5), "{csv}");
    assert!(csv.contains("literature printed (not re-run),\"PiP\",RMSE 5 s,4.04,,,,\n"), "{csv}");

    // The error on training windows stands beside that on the windows scored, which is that of the table.
    let training = content["training"].as_array().unwrap();
    assert_eq!(training.len(), 2 * strings(&content["systems"]).len(), "one site, and all");
    let rmse = |model: &Value| {
        let is = |s: &&Value| {
            (&s["model"], &s["protocol"], &s["metric"], &s["site"])
                == (model, &"literature".into(), &"rmse_at".into(), &"all".into())
                && s["horizon_s"] == 5.
        };
        content["scores"].as_array().unwrap().iter().find(is).unwrap()["value"].as_f64().unwrap()
    };
    for row in training.iter().filter(|row| row["site"] == "all") {
        assert!((row["test_rmse_m"].as_f64().unwrap() - rmse(&row["model"])).abs() < 1e-9, "{row}");
        assert!(row["training_windows"] != 0 && row["ratio"].as_f64().unwrap() > 1., "{row}");
        assert!(row["test_bias_m"].as_f64().unwrap().abs() <= row["test_rmse_m"].as_f64().unwrap(), "{row}");
    }
    assert!(markdown.contains("error on training windows") && csv.contains("training us-101,"), "{markdown}");

    // GNP explains itself, the others do not.
    let faithful = content["faithfulness"].as_array().unwrap();
    assert!(!faithful.is_empty() && faithful.iter().all(|row| row["model"] == "gnp" && row["windows"] != 0));
    assert!(markdown.contains("Faithfulness of explanations") && csv.contains("faithfulness,us-101: gnp,slope,"));

    // Once more: nothing is trained again, and the numbers are the same ones.
    table1(&[]).badly(&["not empty", "--resume"]);
    let again = table1(&["--resume"]).well();
    assert!(again.err.contains("4 of 4 jobs were done before") && !again.err.contains(" started"), "{}", again.err);
    assert_eq!(json(&place.join("table1.json")), content);
}

#[test]
fn over_the_folds_every_window_is_scored_once() {
    let (data, out, config) = (data(&SCENES), TempDir::new().unwrap(), smoke());
    let (place, none) = (out.path().join("table"), out.path().join("none.toml"));
    fs::write(&none, "").unwrap();
    let more = ["--recipes", none.to_str().unwrap(), "--set", "split.folds=2", "--set", "split.kind=vehicle"];
    let finished = run(&arguments("table1", data.path(), &place, &config, &more)).well();
    assert!(finished.err.contains("table1: fold-2/gnp/seed-0 done in "), "{}", finished.err);
    let content = json(&place.join("table1.json"));
    let parts = ["fold-1", "fold-2"].map(|fold| json(&place.join(fold).join("gnp/split.json")));
    let sizes = |split: &Value| ["train", "validation", "test"].map(|part| windows_of(split, part));
    let [first, second] = [sizes(&parts[0]), sizes(&parts[1])];
    assert_eq!(content["windows"].as_u64().unwrap(), first[2] + second[2]);
    assert_eq!(first.iter().sum::<u64>(), first[2] + second[2]);
    assert_eq!(strings(&content["split_hashes"]).len(), 2);
    assert!(content["split"].as_str().unwrap().contains("in 2 folds"), "{}", content["split"]);

    // The validation part instead is said to be that.
    let place = out.path().join("validation");
    let more = ["--recipes", none.to_str().unwrap(), "--set", "evaluate.subset=validation"];
    run(&arguments("table1", data.path(), &place, &config, &more)).well();
    let content = json(&place.join("table1.json"));
    let published = |content: &Value| strings(&content["systems"]).contains(&"GNP as published");
    assert!(!published(&content) && content["missing"][0].as_str().unwrap().contains("--published"));
    assert!(content["split"].as_str().unwrap().contains("validation part"), "{}", content["split"]);
    let split = json(&place.join("gnp/split.json"));
    assert_eq!(content["windows"].as_u64().unwrap(), windows_of(&split, "validation"));

    // A published model of the same form is the same model: it is trained on the table's windows, whatever its own are.
    let text = fs::read_to_string(&config).unwrap();
    let text = text.replacen("stride_s = ", "stride_s = 1", 1);
    let file = out.path().join("published.toml");
    fs::write(&file, text).unwrap();
    let asked = format!("--published={}", file.display());
    run(&arguments("table1", data.path(), &place, &config, &[&more[..], &["--resume", &asked]].concat())).well();
    let content = json(&place.join("table1.json"));
    assert!(published(&content));
    let of = |model: &str| -> Vec<Value> {
        let scores = content["scores"].as_array().unwrap().iter().filter(|score| score["model"] == model);
        scores.map(|score| score["value"].clone()).collect()
    };
    assert_eq!(of("GNP as published"), of("gnp"));
    assert_eq!(json(&place.join("published/run.json"))["split_hash"], json(&place.join("gnp/run.json"))["split_hash"]);
}

/// Two trainings of GNP are one row; a seed is added to a table that is there.
#[test]
fn seeds_are_trained_apart_and_scored_as_one_row() {
    let (data, out, config) = (data(&SCENES), TempDir::new().unwrap(), smoke());
    let (place, none) = (out.path().join("table"), out.path().join("none.toml"));
    fs::write(&none, "").unwrap();
    let table1 = |more: &[&str]| {
        let more: Vec<&str> = ["--recipes", none.to_str().unwrap()].into_iter().chain(more.iter().copied()).collect();
        run(&arguments("table1", data.path(), &place, &config, &more))
    };
    table1(&[]).well();
    let one = json(&place.join("table1.json"));
    let second = table1(&["--resume", "--seeds", "2"]).well();
    assert!(second.err.contains("1 of 2 jobs were done before") && second.err.contains("1 of 1"), "{}", second.err);
    let two = json(&place.join("table1.json"));
    assert_eq!((&one["seeds"], &two["seeds"], &two["seed"]), (&1.into(), &2.into(), &0.into()));

    // The same windows, other weights.
    let read = |folder: &str, file: &str| fs::read(place.join(folder).join(file)).unwrap();
    assert_eq!(read("gnp", "split.json"), read("gnp-seed-1", "split.json"));
    assert_ne!(read("gnp", "goal.safetensors"), read("gnp-seed-1", "goal.safetensors"));
    assert_eq!(json(&place.join("gnp-seed-1/run.json"))["seed"], 1);
    let score = |content: &Value, model: &str| {
        let scores = content["scores"].as_array().unwrap();
        let is = |s: &&Value| {
            s["model"] == model
                && s["protocol"] == "clean"
                && s["metric"] == "fde"
                && s["horizon_s"] == 5.
                && s["site"] == "all"
                && s["manoeuvre"].is_null()
        };
        let found = scores.iter().find(is).unwrap();
        (found["value"].as_f64().unwrap(), found["seeds"].as_u64().unwrap(), found["windows"].clone())
    };
    assert_eq!(score(&one, "IDM"), score(&two, "IDM"));
    let (mean, seeds, windows) = score(&two, "gnp");
    assert!(seeds == 2 && windows == score(&one, "gnp").2);
    // The mean over seeds: the other seed lies as far on the other side.
    let mut second = gnp::Run::open(&place.join("gnp-seed-1"), &gnp::Machine::default()).unwrap();
    second.perform(gnp::Stage::Evaluate).unwrap();
    let other = second.scores().unwrap().scores.into_iter().find(|score| {
        (score.model.as_str(), score.metric.as_str(), score.horizon_s) == ("gnp", "fde", 5.)
            && score.protocol == gnp_eval::Protocol::Clean
            && score.site == gnp_eval::ALL_SITES
            && score.manoeuvre.is_none()
    });
    assert!((mean - (score(&one, "gnp").0 + other.unwrap().value) / 2.).abs() < 1e-9);
    let markdown = fs::read_to_string(place.join("table1.md")).unwrap();
    for part in ["gnp (2 seeds)", "learned was trained with 2, 0 to 1", "by driver and seed", "drivers and seeds"] {
        assert!(markdown.contains(part), "no `{part}` in:\n{markdown}");
    }
}

/// Prepared, trained job by job in any order and gathered, a table is that of one command with two workers.
#[test]
fn job_by_job_is_the_same_table_as_all_at_once() {
    let (data, out, config) = (data(&SCENES), TempDir::new().unwrap(), smoke());
    let (parts, whole, recipes) = (out.path().join("parts"), out.path().join("whole"), recipes(out.path()));
    let options = ["--recipes", &recipes, "--seeds", "2", "--set", "split.folds=2"];
    let planned =
        run(&arguments("compare", data.path(), &parts, &config, &[&options[..], &["--plan"]].concat())).well();
    let jobs: Vec<String> =
        planned.out.lines().filter_map(|line| line.strip_prefix("to do  ")).map(str::to_owned).collect();
    assert_eq!(jobs.len(), 2 * 4 * 2, "{}", planned.out);
    assert!(
        ["fold-1/gnp/seed-0", "fold-2/cs_lstm_m_deviation/seed-1"].iter().all(|id| jobs.contains(&(*id).to_owned()))
    );
    assert!(!parts.join("fold-1/gnp/modes.safetensors").exists() && parts.join("fold-2/gnp/rules.json").exists());

    let place = parts.to_str().unwrap();
    let step = |more: &[&str]| run(&[&["compare", "--out", place], more].concat());
    step(&["--job", "fold-2/cs_lstn_m_deviation/seed-1"]).badly(&["nearest is fold-2/cs_lstm_m_deviation/seed-1"]);
    step(&["--gather"]).badly(&["16 of 16 jobs are not done: fold-1/gnp/seed-0, "]);
    // Backwards: further seeds do not need the first one.
    for id in jobs[1..].iter().rev() {
        step(&["--job", id]).well();
    }
    step(&["--gather", "--allow-missing"]).badly(&["1 of 16 jobs are not done: fold-1/gnp/seed-0;"]);
    assert!(!parts.join("table1.md").exists(), "only a whole table is written");
    let listed = step(&["--plan", "--json"]).well();
    let listed: Value = serde_json::from_str(&listed.out).unwrap();
    let states: Vec<&str> =
        listed["jobs"].as_array().unwrap().iter().map(|job| job["state"].as_str().unwrap()).collect();
    assert_eq!((states[0], states.iter().filter(|state| **state == "done").count()), ("to_do", 15));
    assert_eq!(listed["jobs"][1]["writes"], "fold-1/gnp-seed-1");
    step(&["--job", &jobs[0]]).well();
    let before = fs::metadata(parts.join("fold-1/gnp/goal.safetensors")).unwrap().modified().unwrap();
    assert!(step(&["--job", &jobs[0]]).well().err.contains("done before"));
    assert_eq!(fs::metadata(parts.join("fold-1/gnp/goal.safetensors")).unwrap().modified().unwrap(), before);
    step(&["--gather"]).well();

    let all = [&options[..], &["--workers", "2"]].concat();
    let finished = run(&arguments("compare", data.path(), &whole, &config, &all)).well();
    assert!(finished.err.contains("16 of 16") && !finished.err.contains("epoch"), "{}", finished.err);
    for file in ["table1.md", "table1.csv", "table1.json", "differences.json"] {
        assert!(fs::read(parts.join(file)).unwrap() == fs::read(whole.join(file)).unwrap(), "{file}");
    }

    // Every learned row has both seeds, a rule has none.
    let content = json(&whole.join("table1.json"));
    for score in content["scores"].as_array().unwrap() {
        let learned = ["gnp", "goal head", "column network", "S-LSTM", "CS-LSTM(M) + platoon"];
        let seeds = if learned.contains(&score["model"].as_str().unwrap()) { 2 } else { 1 };
        assert_eq!(score["seeds"], seeds, "{score}");
    }
    // A row whose training is not done is left out where that is allowed.
    fs::remove_file(parts.join("fold-1/jobs/s_lstm-seed-1.json")).unwrap();
    step(&["--gather"]).badly(&["1 of 16 jobs are not done: fold-1/s_lstm/seed-1;"]);
    step(&["--gather", "--allow-missing"]).well();
    let content = json(&parts.join("table1.json"));
    assert!(!strings(&content["systems"]).contains(&"S-LSTM"));
    assert!(content["missing"][0].as_str().unwrap().contains("fold-1/s_lstm/seed-1"), "{}", content["missing"]);

    // Another configuration is another table, and a folder that is not prepared has no jobs.
    let other = ["--recipes", &recipes, "--set", "split.folds=2", "--set", "goal.epochs=3", "--plan"];
    run(&arguments("compare", data.path(), &parts, &config, &other)).badly(&["goal.epochs", "is 3 and was 2"]);
    step(&["--plan", "--set", "goal.epochs=3"]).badly(&["has its settings"]);
    let bare = out.path().join("bare");
    run(&["compare", "--out", bare.to_str().unwrap(), "--job", &jobs[0]]).badly(&["is not a prepared table"]);
}

/// What an interrupt leaves goes on with the folder alone, to the same table.
#[cfg(unix)]
#[test]
fn an_interrupted_comparison_goes_on() {
    use std::io::{BufRead as _, BufReader};
    use std::process::{Command, Stdio};

    let (data, out, config) = (data(&SCENES), TempDir::new().unwrap(), smoke());
    let (place, whole, recipes) = (out.path().join("table"), out.path().join("whole"), recipes(out.path()));
    let options = ["--recipes", &recipes, "--workers", "2"];
    let mut command = crate::program::program(&arguments("compare", data.path(), &place, &config, &options));
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    assert!(lines.any(|line| line.unwrap().contains(" started")));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let rest: String = lines.map(|line| line.unwrap() + "\n").collect();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{rest}");
    assert!(rest.contains(&format!("go on with `gnp compare --resume --out {}`", place.display())), "{rest}");
    assert!(!place.join("table1.md").exists());

    run(&["compare", "--resume", "--out", place.to_str().unwrap()]).well();
    run(&arguments("compare", data.path(), &whole, &config, &["--recipes", &recipes, "--workers", "1"])).well();
    for file in ["table1.md", "table1.json"] {
        assert!(fs::read(place.join(file)).unwrap() == fs::read(whole.join(file)).unwrap(), "{file}");
    }
}

#[test]
fn ablations_share_what_they_do_not_change() {
    let (data, out, config) = (data(&SCENES), TempDir::new().unwrap(), smoke());
    let place = out.path().join("table");
    let finished = run(&arguments("table2", data.path(), &place, &config, &[])).well();
    assert!(finished.err.contains("table2: 16 of 20, explicit Euler"), "{}", finished.err);
    let content = json(&place.join("table2.json"));
    let systems = strings(&content["systems"]);
    assert_eq!((systems.len(), systems[0]), (18, "gnp"));
    let missing = ["sees who is behind and beside: ", "joint neighbours: "];
    let told = strings(&content["missing"]);
    assert!(told.len() == 2 && told.iter().zip(missing).all(|(told, row)| told.starts_with(row)), "{told:?}");

    // A goal network with one mode takes the forces over and the other way round.
    let same = |variant: &str, file: &str| {
        let read = |folder: &str| fs::read(place.join(folder).join(file)).unwrap();
        read("gnp") == read(&format!("variants/{variant}"))
    };
    for (variant, file, expected) in [
        ("modes-modes-1", "goal.safetensors", false),
        ("modes-modes-1", "repulsion.safetensors", true),
        ("traj-lines-false", "goal.safetensors", true),
        ("traj-lines-false", "repulsion.safetensors", false),
        ("predict-neighbours-oracle", "attraction.safetensors", true),
        ("predict-neighbours-constant_velocity", "goal.safetensors", true),
        ("predict-neighbours-constant_velocity", "repulsion.safetensors", false),
        ("goal-mean_weight-0.0", "modes.safetensors", true),
        ("goal-mean_weight-0.0", "goal.safetensors", false),
        ("features-vehicles_ahead-1", "goal.safetensors", false),
        ("features-vehicles_ahead-1", "repulsion.safetensors", true),
        ("features-reference-constant_velocity", "modes.safetensors", false),
        ("features-reference-constant_velocity", "split.json", true),
        ("modes-modes-16", "split.json", true),
    ] {
        assert_eq!(same(variant, file), expected, "{variant}/{file}");
    }

    // One goal means one future; what uses the future is marked and stays out of clean.
    let score = |model: &str, protocol: &str, metric: &str, k: u64| {
        let scores = content["scores"].as_array().unwrap();
        let found = scores.iter().find(|s| {
            s["model"] == model
                && s["protocol"] == protocol
                && s["metric"] == metric
                && s["k"] == k
                && s["horizon_s"] == 5.
        });
        found.map(|score| (score["value"].as_f64().unwrap(), score["uses_future"].as_bool().unwrap()))
    };
    assert_eq!(score("no modes", "clean", "min_fde", 6), score("no modes", "clean", "fde", 1));
    assert_ne!(score("no modes", "clean", "fde", 1), score("no modes, no repulsion", "clean", "fde", 1));
    // What is read when there is a model needs no folder.
    assert!(systems.contains(&"selection: medoids") && score("selection: medoids", "clean", "fde", 1).is_some());
    assert!(names(&place.join("variants")).iter().all(|name| !name.contains("selection")));
    assert_ne!(score("full trust in the network", "clean", "fde", 1), score("gnp", "clean", "fde", 1));
    for oracle in ["true goal", "oracle neighbours"] {
        assert_eq!(score(oracle, "clean", "fde", 1), None);
        assert!(score(oracle, "paper", "min_fde", 20).unwrap().1);
    }
    assert!(score("true goal", "paper", "min_fde", 20).unwrap().0 < score("gnp", "paper", "min_fde", 20).unwrap().0);
}

#[test]
fn predictions_of_others_are_scored_like_ours() {
    let (data, out, config) = (data(&SCENES), TempDir::new().unwrap(), smoke());
    let made = out.path().join("run");
    run(&arguments("pipeline", data.path(), &made, &config, &[])).well();
    let file = made.join("predictions.parquet");
    let score = |more: &[&str]| {
        let mut arguments = vec!["score", "--predictions", file.to_str().unwrap()];
        arguments.extend(more);
        run(&arguments)
    };
    let (made_text, place) = (made.to_str().unwrap(), out.path().join("scores"));
    let place_text = place.to_str().unwrap();
    let well = ["--dataset", "ngsim", "--run", made_text, "--protocol", "clean", "--out", place_text];
    score(&well).well();
    assert_eq!(names(&place), ["differences.json", "metrics.csv", "metrics.json", "metrics.md"]);
    // The file holds the six futures that clean asks for: the same numbers as the model's own.
    let value = |path: &Path, model: &str| {
        let scores = json(path);
        let found = scores.as_array().unwrap().iter().find(|s| {
            s["model"] == model
                && s["protocol"] == "clean"
                && s["metric"] == "min_fde"
                && s["k"] == 6
                && s["horizon_s"] == 5.
        });
        found.unwrap()["value"].as_f64().unwrap()
    };
    for model in ["gnp", "constant velocity"] {
        let (theirs, ours) = (value(&place.join("metrics.json"), model), value(&made.join("metrics.json"), model));
        assert!((theirs - ours).abs() < 1e-6, "{model}: {theirs}, {ours}");
    }
    let printed = score(&["--dataset", "ngsim", "--run", made_text, "--protocol", "waymo", "--protocol", "av2"]).well();
    assert!(printed.out.contains("protocol waymo") && printed.out.contains("protocol av2"), "{}", printed.out);

    // All windows of the data are more than the test part: what is missing is counted and named.
    let data_text = data.path().to_str().unwrap();
    score(&["--dataset", "ngsim", "--config", config.to_str().unwrap(), "--data-dir", data_text]).badly(&[
        "of 193 windows have no prediction",
        "recording us101-13_1, vehicle ",
        "more",
    ]);
    // Of what is not there at all nothing is passed over.
    let fewer = self::data(&SCENES[..1]);
    let fewer = fewer.path().to_str().unwrap();
    score(&["--config", "smoke", "--data-dir", fewer])
        .badly(&["has predictions for what is not in these recordings: recording us101-", "leave these rows out"]);
    score(&["--dataset", "highd"]).badly(&["predictions for ngsim, not for highd"]);
    score(&["--dataset", "ngsim", "--run", made_text, "--out", place_text]).badly(&["not empty"]);
}
