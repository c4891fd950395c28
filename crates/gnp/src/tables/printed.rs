//! Figures as the papers print them, for setting beside ours. None of them was measured here.

use gnp_data::Dataset;
use serde::Serialize;

/// What every printed figure is marked with.
pub(crate) const MARK: &str = "not re-run";

/// One row of a printed table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Printed {
    /// The system, as the paper calls it.
    pub(crate) system: &'static str,
    /// What the numbers are.
    pub(crate) quantity: Quantity,
    /// By second, 1 to 5: as many as the quantity has columns; for an ablation 5 s alone.
    pub(crate) values: &'static [&'static [f64]],
}

/// What a printed row holds. Rows of different quantities cannot be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Quantity {
    /// RMSE of the prediction at the instant.
    Top1AtInstant,
    /// ADE, FDE and RMSE of the best of 20 goals, averaged up to the horizon, RMSE per coordinate as
    /// far as one can see.
    BestOf20,
}

impl Quantity {
    /// In words.
    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::Top1AtInstant => "top-1 RMSE at the instant (as protocol literature), each from its own paper",
            Self::BestOf20 => "best of 20, ADE/FDE/RMSE up to the horizon, RMSE per coordinate (as protocol paper)",
        }
    }
}

const fn row(system: &'static str, quantity: Quantity, values: &'static [&'static [f64]]) -> Printed {
    Printed { system, quantity, values }
}

use Quantity::{BestOf20, Top1AtInstant};

const NGSIM: [Printed; 5] = [
    row("S-LSTM", Top1AtInstant, &[&[0.65], &[1.31], &[2.16], &[3.25], &[4.55]]),
    row("CS-LSTM", Top1AtInstant, &[&[0.61], &[1.27], &[2.08], &[3.10], &[4.37]]),
    row("PiP", Top1AtInstant, &[&[0.55], &[1.18], &[1.94], &[2.88], &[4.04]]),
    row("STDAN", Top1AtInstant, &[&[0.42], &[1.01], &[1.69], &[2.56], &[3.67]]),
    row(
        "GNP",
        BestOf20,
        &[
            &[0.3387, 0.6228, 0.2733],
            &[0.67, 1.30, 0.55],
            &[1.03, 2.07, 0.86],
            &[1.43, 2.93, 1.21],
            &[1.86, 3.91, 1.59],
        ],
    ),
];

const HIGHD: [Printed; 5] = [
    row("S-LSTM", Top1AtInstant, &[&[0.22], &[0.62], &[1.27], &[2.15], &[3.41]]),
    row("CS-LSTM", Top1AtInstant, &[&[0.22], &[0.61], &[1.24], &[2.10], &[3.27]]),
    row("PiP", Top1AtInstant, &[&[0.17], &[0.50], &[1.05], &[1.76], &[2.63]]),
    row("STDAN", Top1AtInstant, &[&[0.29], &[0.68], &[1.17], &[1.88], &[2.76]]),
    row(
        "GNP",
        BestOf20,
        &[&[0.11, 0.19, 0.09], &[0.21, 0.38, 0.17], &[0.32, 0.57, 0.26], &[0.44, 0.80, 0.37], &[0.59, 1.07, 0.50]],
    ),
];

/// The paper's ablation on highD at 5 s.
const ABLATION: [Printed; 4] = [
    row("no modes", BestOf20, &[&[2.21, 4.02, 3.53]]),
    row("no modes, no repulsion", BestOf20, &[&[2.63, 4.11, 3.68]]),
    row("no repulsion", BestOf20, &[&[0.87, 1.46, 0.77]]),
    row("GNP", BestOf20, &[&[0.59, 1.07, 0.50]]),
];

/// The printed Table 1 of a data family.
pub(crate) fn table1(dataset: Dataset) -> &'static [Printed] {
    match dataset {
        Dataset::NGSIM => &NGSIM,
        Dataset::HIGHD => &HIGHD,
        _ => &[],
    }
}

/// The printed Table 2, which exists for highD alone.
pub(crate) fn table2(dataset: Dataset) -> &'static [Printed] {
    match dataset {
        Dataset::HIGHD => &ABLATION,
        _ => &[],
    }
}

/// The rows as Markdown, one table a quantity, in italics and marked; empty without rows.
pub(crate) fn markdown(rows: &[Printed]) -> String {
    let mut text = String::new();
    for quantity in [Top1AtInstant, BestOf20] {
        let of_kind: Vec<&Printed> = rows.iter().filter(|row| row.quantity == quantity).collect();
        let Some(first) = of_kind.first() else { continue };
        let seconds: Vec<String> =
            if first.values.len() == 1 { vec!["5 s".to_owned()] } else { (1..=5).map(|s| format!("{s} s")).collect() };
        text += &format!("\n*Printed in the papers, {MARK}: {}.*\n\n", quantity.words());
        text += &format!("| printed, {MARK} | {} |\n", seconds.join(" | "));
        text += &format!("| --- |{}\n", " ---: |".repeat(seconds.len()));
        for row in of_kind {
            let cells = row.values.iter().map(|values| {
                let numbers: Vec<String> = values.iter().map(|value| format!("{value:.2}")).collect();
                format!("*{}*", numbers.join("/"))
            });
            text += &format!("| *{}* | {} |\n", row.system, cells.collect::<Vec<_>>().join(" | "));
        }
    }
    text
}

/// The rows as lines for the CSV file of a table: `table,row,column,value` and four
/// ends of intervals, which they do not have.
pub(crate) fn csv(rows: &[Printed]) -> String {
    let mut text = String::new();
    for row in rows {
        let (kind, names): (&str, &[&str]) = match row.quantity {
            Top1AtInstant => ("literature", &["RMSE"]),
            BestOf20 => ("paper", &["ADE", "FDE", "RMSE"]),
        };
        // A row of one horizon is of the last.
        let first = if row.values.len() == 1 { 5 } else { 1 };
        for (second, values) in (first..).zip(row.values) {
            for (name, value) in names.iter().zip(*values) {
                text += &format!("{kind} printed ({MARK}),\"{}\",{name} {second} s,{value},,,,\n", row.system);
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_printed_row_is_complete_and_marked() {
        for dataset in [Dataset::NGSIM, Dataset::HIGHD] {
            for row in table1(dataset).iter().chain(table2(dataset)) {
                let wanted = if row.quantity == BestOf20 { 3 } else { 1 };
                assert!(row.values.iter().all(|values| values.len() == wanted), "{}", row.system);
                assert!(row.values.is_sorted_by(|a, b| a[0] < b[0]), "{}: errors grow with time", row.system);
            }
            let text = markdown(table1(dataset));
            assert_eq!(text.matches(MARK).count(), 4, "{text}");
        }
        assert_eq!(markdown(table2(Dataset::NGSIM)), "");
        assert_eq!(csv(table1(Dataset::NGSIM)).lines().count(), 4 * 5 + 3 * 5);
        let ablation = csv(table2(Dataset::HIGHD));
        assert!(ablation.contains("paper printed (not re-run),\"no modes\",FDE 5 s,4.02,,,,\n"), "{ablation}");
    }

    /// Jensen: of one set of errors the root mean square is not below the mean. The printed rows are,
    /// so that RMSE is another quantity, as by coordinate.
    #[test]
    fn the_printed_rmse_is_not_that_of_the_printed_ade() {
        for row in NGSIM.iter().chain(&HIGHD).filter(|row| row.quantity == BestOf20) {
            for values in row.values {
                assert!(values[2] < values[0] && values[2] * 2f64.sqrt() > values[0]);
            }
        }
    }
}
