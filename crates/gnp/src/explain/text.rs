//! Explanations as tables and as JSON.

use gnp_data::{Account, Cause};
use serde_json::{Value, json};

use super::Explained;
use crate::what_if::ExplainedForecast;

/// Times of the columns, s.
const TIMES_S: [f64; 3] = [1., 3., 5.];

impl Explained {
    /// Tables and sentences for a terminal; lengths in m.
    #[must_use]
    pub fn text(&self) -> String {
        let key = &self.key;
        let simulated = if self.simulated { ", *simulated*" } else { "" };
        let head = format!("{}, vehicle {}, frame {}{simulated}", key.recording, self.name(), key.t0);
        let mut parts = Vec::new();
        if let Some(ExplainedForecast { account, .. }) = &self.as_it_is {
            parts.push(format!("{}\n\n{}", account.sentence(), table(account, "path")));
        }
        let words = capital(&self.changes);
        if let Some(changed) = &self.changed {
            let sentence = self.sentence_of_changed(changed);
            parts.push(format!("{words}:\n{sentence}\n\n{}", table(&changed.account, "path")));
        }
        if let Some(change) = self.change() {
            parts.push(format!("{}\n\n{}", change.sentence_of_change(&words), table(&change, "difference")));
        }
        format!("{head}\n{}", parts.join("\n\n"))
    }

    /// What the forecast of the changed scene is; and of a vehicle that is added, that there is no other.
    fn sentence_of_changed(&self, changed: &ExplainedForecast) -> String {
        let sentence = changed.account.sentence();
        match self.as_it_is {
            Some(_) => sentence,
            None => format!("{sentence} Vehicle {} is added: there is no forecast from before.", self.name()),
        }
    }

    /// Everything as JSON: displacements in m at every step, along the road and to the left.
    #[must_use]
    pub fn json(&self) -> Value {
        let key = &self.key;
        json!({
            "recording": key.recording,
            "vehicle": key.vehicle,
            "vehicle_name": self.name(),
            "segment": key.segment,
            "frame": key.t0,
            "simulated": self.simulated,
            "as_it_is": self.as_it_is.as_ref().map(|it| account(&it.account, it.account.sentence())),
            "changes": (!self.changes.is_empty()).then_some(&self.changes),
            "changed": self.changed.as_ref().map(|it| account(&it.account, self.sentence_of_changed(it))),
            "change": self.change().map(|change| {
                let sentence = change.sentence_of_change(&capital(&self.changes));
                account(&change, sentence)
            }),
        })
    }
}

/// Rows of causes, columns of times; two decimals, a true minus.
fn table(account: &Account, last: &str) -> String {
    let mut steps: Vec<usize> =
        TIMES_S.iter().map(|seconds| account.step_at(*seconds)).filter(|step| *step > 0).collect();
    steps.dedup();
    let row = |name: &str, at: &dyn Fn(usize) -> [f32; 2]| {
        let numbers = steps.iter().map(|step| {
            let [x, y] = at(*step);
            format!("{:>8}{:>7}", number(x), number(y))
        });
        (name.to_owned(), numbers.collect::<String>())
    };
    let mut rows = vec![row("constant velocity", &|step| account.constant_velocity(step))];
    rows.extend(account.parts.iter().map(|part| row(&account.cause_name(&part.cause), &|step| part.after(step))));
    rows.push(row("sum of the causes", &|step| account.sum(step)));
    rows.push(row(last, &|step| account.path_at(step)));
    let wide = rows.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    let times: String = steps
        .iter()
        .map(|step| format!("{:>15}", format!("{} s", (*step as f64 * account.dt * 100.).round() / 100.)))
        .collect();
    let axes: String = steps.iter().map(|_| format!("{:>8}{:>7}", "along", "left")).collect();
    let head = [format!("{:wide$}{times}", "m after"), format!("{:wide$}{axes}", "")];
    let body = rows.into_iter().map(|(name, numbers)| format!("{name:wide$}{numbers}"));
    head.into_iter().chain(body).collect::<Vec<_>>().join("\n")
}

fn number(value: f32) -> String {
    let text = format!("{value:.2}");
    // A rounded nothing has no sign.
    if text == "-0.00" { "0.00".to_owned() } else { text.replace('-', "\u{2212}") }
}

fn account(account: &Account, sentence: String) -> Value {
    let steps = || 1..=account.steps();
    let part = |part: &gnp_data::Contribution| {
        let kind = match &part.cause {
            Cause::FreeRoad => "free_road",
            Cause::Leader { .. } => "leader",
            Cause::Intention => "intention",
            Cause::Neighbour { .. } => "neighbour",
            _ => "term",
        };
        let mut value = json!({
            "cause": account.cause_name(&part.cause),
            "kind": kind,
            "physical": part.cause.is_physical(),
            "displacement": part.displacement,
        });
        // What another kind has is left out.
        if let Some(vehicle) = part.cause.vehicle() {
            value["vehicle"] = vehicle.into();
            value["id"] = account.name(vehicle).into();
        }
        if let Cause::Leader { place, .. } = part.cause {
            value["place"] = place.into();
        }
        value
    };
    json!({
        "sentence": sentence,
        "dt": account.dt,
        "velocity": account.velocity,
        "constant_velocity": steps().map(|step| account.constant_velocity(step)).collect::<Vec<_>>(),
        "parts": account.parts.iter().map(part).collect::<Vec<_>>(),
        "sum": steps().map(|step| account.sum(step)).collect::<Vec<_>>(),
        "path": account.path,
    })
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use gnp_data::{Contribution, Forecast, WindowKey};

    use super::*;

    fn explained() -> Explained {
        let part = |cause, by: f32| Contribution {
            cause,
            displacement: (1..=5).map(|step| [by * (step * step) as f32, -0.001]).collect(),
        };
        let account = |leader: f32| {
            let parts = vec![part(Cause::Leader { vehicle: 34, place: 1 }, leader), part(Cause::Intention, 0.1)];
            let at = |step: usize| {
                let square = (step * step) as f32;
                [10. * step as f32 + (leader + 0.1) * square, 0.5 * step as f32 - 0.002]
            };
            let (path, names) = ((1..=5).map(at).collect(), BTreeMap::new());
            let account = Account { vehicle: 12, dt: 1., velocity: [10., 0.5], parts, path, names };
            ExplainedForecast { at: [0.; 2], account, forecast: Forecast::default() }
        };
        Explained {
            key: WindowKey { recording: "us101-2".to_owned(), vehicle: 12, segment: 0, t0: 130 },
            simulated: false,
            as_it_is: Some(account(-0.5)),
            changed: Some(account(-0.3)),
            changes: "with vehicle 34 at 12 m/s".to_owned(),
            figures: Vec::new(),
        }
    }

    #[test]
    fn the_table_adds_up_and_stands_in_columns() {
        let text = explained().text();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "us101-2, vehicle 12, frame 130");
        assert_eq!(lines[3], "m after                      1 s            3 s            5 s");
        assert_eq!(lines[5], "constant velocity   10.00   0.50   30.00   1.50   50.00   2.50");
        assert_eq!(lines[6], "leader 34           \u{2212}0.50   0.00   \u{2212}4.50   0.00  \u{2212}12.50   0.00");
        assert_eq!(lines[8], "sum of the causes   \u{2212}0.40   0.00   \u{2212}3.60   0.00  \u{2212}10.00   0.00");
        assert_eq!(lines[9], "path                 9.60   0.50   26.40   1.50   40.00   2.50");
        assert!(text.contains("\nWith vehicle 34 at 12 m/s:\nIn 5 s vehicle 12 gets 5.0 m less far than"), "{text}");
        assert!(text.contains("With vehicle 34 at 12 m/s, vehicle 12 gets 5.0 m farther in 5 s: leader 34 +5.0 m."));
        assert!(lines.last().unwrap().starts_with("difference           0.20"), "{text}");
    }

    #[test]
    fn json_has_every_step_and_the_kinds() {
        let value = explained().json();
        assert_eq!((value["vehicle"].as_u64(), value["frame"].as_u64()), (Some(12), Some(130)));
        let parts = value["as_it_is"]["parts"].as_array().unwrap();
        assert_eq!((&parts[0]["kind"], &parts[0]["vehicle"]), (&json!("leader"), &json!(34)));
        assert_eq!((&parts[0]["id"], &parts[0]["place"]), (&json!("34"), &json!(1)));
        let fields: BTreeSet<&str> = parts[1].as_object().unwrap().keys().map(String::as_str).collect();
        assert_eq!(fields, BTreeSet::from(["cause", "displacement", "kind", "physical"]), "of an intention");
        assert_eq!((&parts[1]["physical"], parts[1]["displacement"].as_array().unwrap().len()), (&json!(false), 5));
        assert!((value["change"]["path"][4][0].as_f64().unwrap() - 5.).abs() < 1e-5);
        let alone = Explained { changed: None, changes: String::new(), ..explained() };
        assert!(alone.json()["changed"].is_null() && !alone.text().contains("difference"));
    }

    #[test]
    fn who_is_added_has_no_forecast_from_before() {
        let added = Explained { as_it_is: None, ..explained() };
        let value = added.json();
        assert!(value["as_it_is"].is_null() && value["change"].is_null());
        let sentence = value["changed"]["sentence"].as_str().unwrap();
        assert!(sentence.starts_with("In 5 s vehicle 12 gets 5.0 m less far than"), "{sentence}");
        assert!(sentence.ends_with(" Vehicle 12 is added: there is no forecast from before."), "{sentence}");
        let text = added.text();
        assert!(text.starts_with("us101-2, vehicle 12, frame 130\nWith vehicle 34 at 12 m/s:\nIn 5 s "), "{text}");
        assert!(text.contains(sentence) && !text.contains("difference"), "{text}");
    }
}
