//! `--table faces --where .. --sort ..`: selects elements of a value and prints them as a table, CSV or JSON.

use std::fmt::Write;

use clap::Args;
use maquette_engine::six_digits;
use maquette_syntax::unknown_name_message;
use maquette_value::{AnyValue, Range, ranges};
use serde_json::{Value as Json, json};

use super::elements::{Elements, Numbers, kinds, plural};
use crate::Condition;

/// The default number of printed rows.
const DEFAULT_LIMIT: usize = 20;

/// Options that select and sort the rows.
#[derive(Args)]
pub(super) struct RowOptions {
    /// Only elements that satisfy a condition: an `Expr` on columns, such as "region == 7 and area > 2".
    #[arg(long = "where", value_name = "CONDITION", requires = "table")]
    condition: Option<String>,
    /// Sort rows by this column in ascending order; `-NAME` for descending order.
    #[arg(long, value_name = "NAME|-NAME", allow_hyphen_values = true, requires = "table")]
    sort: Option<String>,
    /// The maximum number of rows; 0 for all [default: 20, all in CSV and JSON].
    #[arg(long, value_name = "N", requires = "table")]
    limit: Option<usize>,
    /// Print only these columns.
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', requires = "table")]
    columns: Vec<String>,
    /// Write the rows to this file as CSV; `-` for stdout.
    #[arg(long, value_name = "FILE|-", requires = "table", conflicts_with = "json")]
    pub(super) csv: Option<String>,
}

impl RowOptions {
    /// Returns true if an option about rows is given. Such an option needs `--table` with a kind of elements.
    pub(super) fn are_given(&self) -> bool {
        let Self { condition, sort, limit, columns, csv } = self;
        condition.is_some()
            || sort.is_some()
            || limit.is_some()
            || !columns.is_empty()
            || csv.is_some()
    }

    /// Returns the table of the first value that has elements of the given kind, and the name of the output with this value.
    ///
    /// # Errors
    /// A message if no value has elements of this kind, or if a column is unknown.
    pub(super) fn rows<'v>(
        &self,
        of: Option<&str>,
        found: &[(&'v str, &AnyValue)],
    ) -> Result<(&'v str, Rows), String> {
        let all: Vec<_> = found.iter().flat_map(|(_, value)| kinds(value)).collect();
        let known: Vec<_> = all.iter().map(|on| plural(*on)).collect();
        let Some(word) = of else {
            let (first, some) = (known.first().unwrap_or(&"faces"), known.join(", "));
            return Err(format!("expected a kind of elements: --table {first}; there are: {some}"));
        };
        // Accept `cells` as another name for the pixels of a grid.
        let word = if matches!(word, "cell" | "cells") { "pixels" } else { word };
        let on = all
            .iter()
            .find(|on| plural(**on) == word || on.word() == word)
            .copied()
            .ok_or_else(|| {
                unknown_name_message(format!("the value has no {word}"), word, "there are", &known)
            })?;
        let found =
            found.iter().find_map(|(name, value)| Some((*name, Elements::from_value(value, on)?)));
        let (name, elements) = found.ok_or_else(|| format!("the value has no {word}"))?;
        Ok((name, Rows::new(elements, self)?))
    }
}

/// The selected and sorted rows of a table.
pub(super) struct Rows {
    elements: Elements,
    /// The indices of the columns to print.
    columns: Vec<usize>,
    /// The indices of the selected elements, in the order of the rows.
    rows: Vec<usize>,
    limit: Option<usize>,
}

impl Rows {
    fn new(elements: Elements, options: &RowOptions) -> Result<Self, String> {
        let names = elements.names();
        let what = plural(elements.on);
        fn column_index(wanted: &str, names: &[&str], what: &str) -> Result<usize, String> {
            names.iter().position(|name| *name == wanted).ok_or_else(|| {
                let message = format!("there is no column `{wanted}` of {what}");
                unknown_name_message(message, wanted, "its columns", names)
            })
        }
        let columns = match &options.columns[..] {
            [] => (0..names.len()).collect(),
            wanted => wanted
                .iter()
                .map(|name| column_index(name.trim(), &names, what))
                .collect::<Result<_, _>>()?,
        };
        let mut rows: Vec<_> = (0..elements.count).collect();
        if let Some(text) = &options.condition {
            let condition = Condition::parse(text, &names, what)?;
            let used = condition.column_names().filter_map(|name| elements.column(name));
            let used = Vec::from_iter(used);
            fn number(row: usize, name: &str, used: &[&Numbers]) -> f64 {
                used.iter()
                    .find(|column| column.name == name)
                    .map_or(f64::NAN, |it| it.numbers[row])
            }
            let mut kept = Vec::new();
            for row in rows {
                if condition.evaluate(|name| number(row, name, &used))? {
                    kept.push(row);
                }
            }
            rows = kept;
        }
        if let Some(sort) = &options.sort {
            let (name, is_falling) = match sort.strip_prefix('-') {
                Some(name) => (name, true),
                None => (&sort[..], false),
            };
            let numbers = &elements.columns[column_index(name, &names, what)?].numbers;
            // Put NaN at the end, both in ascending and in descending order.
            rows.sort_by(|&a, &b| {
                let [a, b] = [a, b].map(|row| numbers[row]);
                let by_number = if is_falling { b.total_cmp(&a) } else { a.total_cmp(&b) };
                a.is_nan().cmp(&b.is_nan()).then(by_number)
            });
        }
        Ok(Self { elements, columns, rows, limit: options.limit })
    }

    fn columns(&self) -> impl Iterator<Item = &Numbers> {
        self.columns.iter().map(|&column| &self.elements.columns[column])
    }

    /// Returns the rows to print. `usual` is the maximum number of rows if the user gives no limit.
    fn visible_rows(&self, usual: usize) -> &[usize] {
        let limit = self.limit.unwrap_or(usual);
        let count = if limit == 0 { self.rows.len() } else { limit.min(self.rows.len()) };
        &self.rows[..count]
    }

    /// Returns the minimum, maximum and mean of a column over all selected rows, including those that are not printed.
    fn range(&self, column: &Numbers) -> Option<Range> {
        let numbers: Vec<_> = self.rows.iter().map(|&row| column.numbers[row]).collect();
        ranges(&numbers, 1).remove(0)
    }

    /// Formats a line for each row to print, followed by the minimum, maximum and mean over all selected rows.
    pub(super) fn table(&self) -> String {
        let shown = self.visible_rows(DEFAULT_LIMIT);
        let mut cells = vec![self.columns().map(|column| column.name.clone()).collect::<Vec<_>>()];
        for &row in shown {
            cells.push(self.columns().map(|column| six_digits(column.numbers[row])).collect());
        }
        let ranges: Vec<_> = self.columns().map(|column| self.range(column)).collect();
        fn summary(of: fn(&Range) -> f64, ranges: &[Option<Range>]) -> Vec<String> {
            ranges
                .iter()
                .map(|range| range.as_ref().map_or("-".into(), |it| six_digits(of(it))))
                .collect::<Vec<_>>()
        }
        cells.push(summary(|range| range.min, &ranges));
        cells.push(summary(|range| range.max, &ranges));
        cells.push(summary(|range| range.mean, &ranges));
        let heads = std::iter::repeat_n("", shown.len() + 1).chain(["least", "greatest", "mean"]);
        let widths: Vec<_> = (0..cells[0].len())
            .map(|column: usize| cells.iter().map(|row| row[column].len()).max().unwrap_or(0))
            .collect();
        let mut text = String::new();
        for (head, row) in heads.zip(&cells) {
            let _ = write!(text, "  {head:<8}");
            for (cell, width) in row.iter().zip(&widths) {
                let _ = write!(text, "  {cell:>width$}");
            }
            text.push('\n');
        }
        let (found, count, what) = (self.rows.len(), self.elements.count, plural(self.elements.on));
        let _ = match found - shown.len() {
            0 => writeln!(text, "  {found} of {count} {what}"),
            rest => {
                writeln!(
                    text,
                    "  {found} of {count} {what}, {rest} of them not shown; use --limit 0 to show all"
                )
            }
        };
        text
    }

    /// Formats the rows as CSV: a header line, and a line for each row. Numbers are written without loss.
    pub(super) fn csv(&self) -> String {
        let mut text = self.columns().map(|column| &column.name[..]).collect::<Vec<_>>().join(",");
        text.push('\n');
        for &row in self.visible_rows(0) {
            for (place, column) in self.columns().enumerate() {
                let comma = if place > 0 { "," } else { "" };
                let _ = write!(text, "{comma}{}", column.numbers[row]);
            }
            text.push('\n');
        }
        text
    }

    pub(super) fn json(&self) -> Json {
        let rows = self.visible_rows(0).iter();
        let rows = rows.map(|&row| self.columns().map(|it| it.numbers[row]).collect::<Vec<_>>());
        json!({
            "on": self.elements.on.word(),
            "count": self.elements.count,
            "found": self.rows.len(),
            "columns": self.columns().map(|column| self.column_json(column)).collect::<Vec<_>>(),
            "rows": rows.collect::<Vec<_>>(),
        })
    }

    fn column_json(&self, column: &Numbers) -> Json {
        let range = self.range(column);
        fn statistic(of: fn(&Range) -> f64, range: &Option<Range>) -> Option<f64> {
            range.as_ref().map(of)
        }
        json!({
            "name": column.name,
            "least": statistic(|range| range.min, &range),
            "greatest": statistic(|range| range.max, &range),
            "mean": statistic(|range| range.mean, &range),
        })
    }
}
