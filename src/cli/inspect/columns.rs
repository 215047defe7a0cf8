//! Formats the data columns of a value as a table or JSON.

use std::fmt::Write;

use maquette_engine::six_digits;
use maquette_value::{Part, Parts, Range};
use serde_json::{Value as Json, json};

/// The maximum number of components per element whose minimum, maximum and mean are shown separately. A wider column has one range for all
/// of its components.
const MAX_SEPARATE: usize = 4;

/// Formats the facts of a value, and a line for each of its columns.
pub(super) fn column_table(parts: &Parts<'_>) -> String {
    let mut text = String::new();
    for fact in &parts.facts {
        let _ = writeln!(text, "  {}: {}", fact.name, fact.value);
    }
    let head = ["name", "on", "meaning", "width", "count", "least", "greatest", "mean"];
    let rows: Vec<[String; 8]> = parts.columns.iter().map(row).collect();
    let rows: Vec<_> = std::iter::once(head.map(str::to_owned)).chain(rows).collect();
    let widths: [usize; 8] = std::array::from_fn(|column: usize| {
        rows.iter().map(|row| row[column].len()).max().unwrap_or(0)
    });
    for row in &rows {
        let mut line = String::new();
        for (cell, width) in row.iter().zip(widths) {
            let _ = write!(line, "  {cell:<width$}");
        }
        text += line.trim_end();
        text.push('\n');
    }
    text
}

fn row(part: &Part<'_>) -> [String; 8] {
    let ranges = match part.width {
        ..=MAX_SEPARATE => part.ranges(),
        _ => maquette_value::ranges(&part.items.numbers(), 1),
    };
    fn numbers(of: fn(&Range) -> f64, ranges: &[Option<Range>]) -> String {
        let numbers =
            ranges.iter().map(|range| range.as_ref().map_or("-".into(), |it| six_digits(of(it))));
        let numbers: Vec<String> = numbers.collect();
        match &numbers[..] {
            [number] => number.clone(),
            numbers => format!("({})", numbers.join(", ")),
        }
    }
    [
        part.name.clone().into_owned(),
        part.element_kind.word().to_owned(),
        part.meaning.word().to_owned(),
        part.width.to_string(),
        part.count().to_string(),
        numbers(|range| range.min, &ranges),
        numbers(|range| range.max, &ranges),
        numbers(|range| range.mean, &ranges),
    ]
}

/// Returns the facts and the columns of a value as JSON. `least`, `greatest` and `mean` contain one number for each component of an
/// element. The number is null if the component has no finite value in any element.
pub(super) fn columns_json(parts: &Parts<'_>) -> Json {
    let facts =
        parts.facts.iter().map(|fact| (fact.name.to_string(), json!(fact.value.to_string())));
    json!({
        "facts": facts.collect::<serde_json::Map<_, _>>(),
        "row": parts.row,
        "columns": parts.columns.iter().map(column_json).collect::<Vec<_>>(),
    })
}

fn column_json(part: &Part<'_>) -> Json {
    let ranges = part.ranges();
    fn numbers(of: fn(&Range) -> f64, ranges: &[Option<Range>]) -> Vec<Option<f64>> {
        ranges.iter().map(|range| range.as_ref().map(of)).collect::<Vec<_>>()
    }
    json!({
        "name": part.name,
        "on": part.element_kind.word(),
        "meaning": part.meaning.word(),
        "width": part.width,
        "count": part.count(),
        "least": numbers(|range| range.min, &ranges),
        "greatest": numbers(|range| range.max, &ranges),
        "mean": numbers(|range| range.mean, &ranges),
        "compared": !part.is_hidden,
    })
}
