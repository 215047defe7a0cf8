//! `--table faces --where .. --sort ..`: some elements of a value, as a table, CSV or JSON.

use std::fmt::Write;

use clap::Args;
use maquette_engine::six;
use maquette_syntax::unknown;
use maquette_value::{AnyValue, Range, ranges};
use serde_json::{Value as Json, json};

use super::elements::{Elements, Numbers, kinds, plural};
use crate::Condition;

/// So many rows are printed if nothing else is said.
const FEW: usize = 20;

/// Which elements, in which order.
#[derive(Args)]
pub(super) struct RowOptions {
    /// Only elements for which this holds: an `Expr` on columns, as "region == 7 and area > 2".
    #[arg(long = "where", value_name = "CONDITION", requires = "table")]
    condition: Option<String>,
    /// Order rows by this column, from the least on; `-NAME` from the greatest on.
    #[arg(long, value_name = "NAME|-NAME", allow_hyphen_values = true, requires = "table")]
    sort: Option<String>,
    /// Print so many rows; 0 is all. If left out, 20, and all as CSV and JSON.
    #[arg(long, value_name = "N", requires = "table")]
    limit: Option<usize>,
    /// Print these columns alone.
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', requires = "table")]
    columns: Vec<String>,
    /// Write the rows to this file as CSV; `-` prints them.
    #[arg(long, value_name = "FILE|-", requires = "table", conflicts_with = "json")]
    pub(super) csv: Option<String>,
}

impl RowOptions {
    /// Whether something is said of rows, which must be of some kind of elements then.
    pub(super) fn are_given(&self) -> bool {
        let Self { condition, sort, limit, columns, csv } = self;
        condition.is_some()
            || sort.is_some()
            || limit.is_some()
            || !columns.is_empty()
            || csv.is_some()
    }

    /// The rows of the first of these values that has such elements, and the name of its output.
    ///
    /// # Errors
    /// In words, if none has, or a column is named that is not there.
    pub(super) fn rows<'v>(
        &self,
        of: Option<&str>,
        found: &[(&'v str, &AnyValue)],
    ) -> Result<(&'v str, Rows), String> {
        let all: Vec<_> = found.iter().flat_map(|(_, value)| kinds(value)).collect();
        let known: Vec<_> = all.iter().map(|on| plural(*on)).collect();
        let Some(word) = of else {
            let (first, some) = (known.first().unwrap_or(&"faces"), known.join(", "));
            return Err(format!("say of which elements: --table {first}; there are: {some}"));
        };
        // Cells of a grid are its pixels.
        let word = if matches!(word, "cell" | "cells") { "pixels" } else { word };
        let on = all
            .iter()
            .find(|on| plural(**on) == word || on.word() == word)
            .copied()
            .ok_or_else(|| unknown(format!("it has no {word}"), word, "there are", &known))?;
        let found = found.iter().find_map(|(name, value)| Some((*name, Elements::of(value, on)?)));
        let (name, elements) = found.ok_or_else(|| format!("it has no {word}"))?;
        Ok((name, Rows::new(elements, self)?))
    }
}

/// Some rows of a table, in their order.
pub(super) struct Rows {
    elements: Elements,
    /// The places of the columns that are shown.
    columns: Vec<usize>,
    /// The elements for which the condition holds.
    rows: Vec<usize>,
    limit: Option<usize>,
}

impl Rows {
    fn new(elements: Elements, options: &RowOptions) -> Result<Self, String> {
        let names = elements.names();
        let what = plural(elements.on);
        fn place(wanted: &str, names: &[&str], what: &str) -> Result<usize, String> {
            names.iter().position(|name| *name == wanted).ok_or_else(|| {
                let message = format!("there is no column `{wanted}` of {what}");
                unknown(message, wanted, "its columns", names)
            })
        }
        let columns = match &options.columns[..] {
            [] => (0..names.len()).collect(),
            wanted => wanted
                .iter()
                .map(|name| place(name.trim(), &names, what))
                .collect::<Result<_, _>>()?,
        };
        let mut rows: Vec<_> = (0..elements.count).collect();
        if let Some(text) = &options.condition {
            let condition = Condition::read(text, &names, what)?;
            let used = condition.names().filter_map(|name| elements.column(name));
            let used = Vec::from_iter(used);
            fn number(row: usize, name: &str, used: &[&Numbers]) -> f64 {
                used.iter()
                    .find(|column| column.name == name)
                    .map_or(f64::NAN, |it| it.numbers[row])
            }
            let mut kept = Vec::new();
            for row in rows {
                if condition.holds(|name| number(row, name, &used))? {
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
            let numbers = &elements.columns[place(name, &names, what)?].numbers;
            // What is no number comes last either way.
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

    /// The rows that are shown where so many are if nothing is said.
    fn shown(&self, usual: usize) -> &[usize] {
        let limit = self.limit.unwrap_or(usual);
        let count = if limit == 0 { self.rows.len() } else { limit.min(self.rows.len()) };
        &self.rows[..count]
    }

    /// Least, greatest and mean of a column over all rows that were found.
    fn range(&self, column: &Numbers) -> Option<Range> {
        let numbers: Vec<_> = self.rows.iter().map(|&row| column.numbers[row]).collect();
        ranges(&numbers, 1).remove(0)
    }

    /// A line for each row, then the least, the greatest and the mean of all that were found.
    pub(super) fn table(&self) -> String {
        let shown = self.shown(FEW);
        let mut cells = vec![self.columns().map(|column| column.name.clone()).collect::<Vec<_>>()];
        for &row in shown {
            cells.push(self.columns().map(|column| six(column.numbers[row])).collect());
        }
        let ranges: Vec<_> = self.columns().map(|column| self.range(column)).collect();
        fn summary(of: fn(&Range) -> f64, ranges: &[Option<Range>]) -> Vec<String> {
            ranges
                .iter()
                .map(|range| range.as_ref().map_or("-".into(), |it| six(of(it))))
                .collect::<Vec<_>>()
        }
        cells.push(summary(|range| range.least, &ranges));
        cells.push(summary(|range| range.greatest, &ranges));
        cells.push(summary(|range| range.mean, &ranges));
        let heads = ["", "least", "greatest", "mean"];
        let head = |line: usize| match line.checked_sub(shown.len() + 1) {
            Some(last) => heads[last + 1],
            None => heads[0],
        };
        let widths: Vec<_> = (0..cells[0].len())
            .map(|column: usize| cells.iter().map(|row| row[column].len()).max().unwrap_or(0))
            .collect();
        let mut text = String::new();
        for (line, row) in cells.iter().enumerate() {
            let _ = write!(text, "  {:<8}", head(line));
            for (cell, width) in row.iter().zip(&widths) {
                let _ = write!(text, "  {cell:>width$}");
            }
            text.push('\n');
        }
        let (found, count, what) = (self.rows.len(), self.elements.count, plural(self.elements.on));
        let _ = match found - shown.len() {
            0 => writeln!(text, "  {found} of {count} {what}"),
            rest => {
                writeln!(text, "  {found} of {count} {what}, {rest} of them not shown: --limit 0")
            }
        };
        text
    }

    /// A line of names, then a line for each row, with every digit.
    pub(super) fn csv(&self) -> String {
        let mut text = self.columns().map(|column| &column.name[..]).collect::<Vec<_>>().join(",");
        text.push('\n');
        for &row in self.shown(0) {
            for (place, column) in self.columns().enumerate() {
                let comma = if place > 0 { "," } else { "" };
                let _ = write!(text, "{comma}{}", column.numbers[row]);
            }
            text.push('\n');
        }
        text
    }

    pub(super) fn json(&self) -> Json {
        let column = |column: &Numbers| {
            let range = self.range(column);
            fn of(of: fn(&Range) -> f64, range: &Option<Range>) -> Option<f64> {
                range.as_ref().map(of)
            }
            json!({
                "name": column.name,
                "least": of(|range| range.least, &range),
                "greatest": of(|range| range.greatest, &range),
                "mean": of(|range| range.mean, &range),
            })
        };
        let row =
            |&row: &usize| self.columns().map(|column| column.numbers[row]).collect::<Vec<_>>();
        json!({
            "on": self.elements.on.word(),
            "count": self.elements.count,
            "found": self.rows.len(),
            "columns": self.columns().map(column).collect::<Vec<_>>(),
            "rows": self.shown(0).iter().map(row).collect::<Vec<_>>(),
        })
    }
}
